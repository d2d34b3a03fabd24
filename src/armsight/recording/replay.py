"""Opens recordings as cells: the same map and the same page as when they were made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from armsight.arrays import JointPath
from armsight.devices.data import GripperState, JointState, RgbdFrame, StereoFrame, Wrench
from armsight.devices.recorded import (
    RecordedArm,
    RecordedCamera,
    RecordedClock,
    RecordedGripper,
    RecordedSensor,
    RecordedStereo,
    RecordedWrench,
)
from armsight.devices.world import MovingSurfaces
from armsight.errors import ArmsightError, RecordingError
from armsight.geometry.shapes import Surface
from armsight.recording import messages
from armsight.recording.codec import Decoding
from armsight.recording.description import CellDescription
from armsight.recording.face_messages import FACE_TOPIC, FaceReader
from armsight.recording.layout import Layout, layout_of
from armsight.recording.markers import decode_looks, decode_movers
from armsight.recording.mcap_file import McapReader
from armsight.recording.messages import NANOSECONDS, to_seconds
from armsight.recording.no_robot import NAME as NO_ROBOT
from armsight.recording.no_robot import no_robot
from armsight.recording.playback import Delivery, Moved, Playback, Source
from armsight.recording.status_messages import GUARD, guard_from_status
from armsight.recording.streams import STREAMS
from armsight.robots import load_robot, load_tool, tools
from armsight.robots.catalogue import is_path
from armsight.robots.robot import Robot
from armsight.workcell import Cell, Workcell, parse_workcell, robot_in
from armsight.workcell.calibration_file.reading import calibrated_robot, parse_calibration
from armsight.workcell.calibration_file.schema import CellCalibration

LATE_START = 60 * NANOSECONDS
"""A recording whose clock starts later moves to 0: float32 times would lose their digits [ns]."""


def open_recording(path: str | Path) -> Cell:
    """Open an MCAP recording; its cameras and arm replay, and ignore what they are told.

    The cell's ``world`` is a :class:`.Playback`; its ``note`` says where a recording was cut short.

    Raises:
        RecordingError: it cannot be read, or holds no depth images whose camera is known.
    """
    reader = McapReader(Path(path))
    try:
        layout = layout_of(reader)
        workcell, robot = _robot(layout.description, reader)
        source = _source(reader, layout, robot)
    except BaseException:
        reader.close()
        raise
    return recorded_cell(source, layout.description, workcell, robot)


def recorded_cell(
    source: Source, description: CellDescription, workcell: Workcell, robot: Robot
) -> Cell:
    """A cell whose devices replay a source."""
    clock = RecordedClock(source.span[0])
    arm = RecordedArm(robot.joint_names)
    cameras = tuple(RecordedCamera(info) for info in description.cameras)
    stereo = tuple(RecordedStereo(info) for info in description.stereo)
    wrench = RecordedWrench() if description.wrench else None
    gripper = None if description.gripper is None else RecordedGripper(description.gripper)
    sensors: dict[tuple[type, str], RecordedSensor[Any]] = {
        (StereoFrame, pair.info.name): pair for pair in stereo
    }
    if wrench is not None:
        sensors[Wrench, ""] = wrench
    if gripper is not None:
        sensors[GripperState, ""] = gripper
    playback = Playback(source, clock, arm, cameras, sensors)
    return Cell(
        workcell,
        robot,
        description.T_world_base,
        clock,
        arm,
        cameras,
        description.static,
        playback,
        stereo=stereo,
        wrench=wrench,
        gripper=gripper,
    )


def bare_workcell(name: str, robot: str, mapping: dict[str, Any] | None = None) -> Workcell:
    """The workcell of a recording that came without a file."""
    safe = "".join(c if c.isalnum() or c in "_-" else "_" for c in name) or "recording"
    return Workcell.model_validate(
        {"cell": {"name": safe}, "robot": {"model": robot}, "mapping": mapping or {}}
    )


def _robot(description: CellDescription, reader: McapReader) -> tuple[Workcell, Robot]:
    """The recorded cell's file and robot."""
    if description.robot == NO_ROBOT:
        return bare_workcell(reader.path.stem, NO_ROBOT), no_robot()
    try:
        file = reader.contents.attachments.get("workcell.toml")
        if file is not None:
            text = _as_recorded(file.decode(), description)
            workcell = parse_workcell(text, str(reader.path))
            return workcell, calibrated_robot(robot_in(workcell), _calibration(reader))
        robot = load_robot(description.robot)
        if description.tool != "none":
            robot = robot.with_tool(load_tool(description.tool))
    except RecordingError:
        raise
    except (ArmsightError, TOMLKitError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise RecordingError(f"{reader.path}: its cell cannot be built again: {error}") from error
    return bare_workcell(reader.path.stem, description.robot), robot


def _calibration(reader: McapReader) -> CellCalibration | None:
    """What was believed of the arm and its board when it was recorded."""
    text = reader.contents.attachments.get("calibration.toml")
    return None if text is None else parse_calibration(text.decode(), str(reader.path))


def _as_recorded(text: str, description: CellDescription) -> str:
    """The cell's file without people and drivers: none are needed, and they may not be here.

    A user's own robot and tool were named relative to the file; the recording knows where they lay.
    """
    document = tomlkit.parse(text)
    if is_path(description.robot):
        document["robot"]["model"] = description.robot
    if tools.is_path(description.tool):
        document["robot"]["tool"] = description.tool
    for key in ("person", "object", "undeclared", "target"):
        document.get("simulation", {}).pop(key, None)
    for key in ("camera", "stereo", "wrench", "gripper", "empty_switch", "tip", "patrol"):
        document.pop(key, None)
    for key in ("driver", "connection"):
        document.get("robot", {}).pop(key, None)
    return tomlkit.dumps(document)


def _source(reader: McapReader, layout: Layout, robot: Robot) -> Source:
    first, last = reader.span
    shift = first if first > LATE_START else 0
    note = ""
    if reader.contents.cut:
        note = (
            f"{reader.path.name} was cut short ({reader.contents.cut}); "
            f"it is replayed up to {to_seconds(last - shift):.1f} s"
        )
    return Source(
        name=reader.path.name,
        span=(to_seconds(first - shift), to_seconds(last - shift)),
        deliveries=lambda: _deliveries(reader, layout, robot.joint_names, shift),
        note=note,
        close=reader.close,
        shows_task=FACE_TOPIC in reader.topics,
    )


def _deliveries(
    reader: McapReader, layout: Layout, joint_names: Sequence[str], shift: int
) -> Iterator[Delivery]:
    """Decode a recording from its start."""
    decoder = _Decoder(layout, joint_names, shift)
    topics = [topic for topic in reader.topics if decoder.wants(topic)]
    none = np.zeros(0)
    for topic, kind, record in reader.messages(topics):
        try:
            item = decoder.take(topic, messages.decode(record.data, kind), record)
        except Exception as error:  # whatever somebody else may have written
            at = to_seconds(record.log_time - shift)
            raise RecordingError(
                f"{reader.path}: what {topic} says at {at:.3f} s cannot be: {error}"
            ) from error
        if isinstance(item, RgbdFrame) and not joint_names:
            # No arm, no joints: known at every exposure, or the map would wait for them for ever.
            yield Delivery(record.log_time - shift, JointState(item.stamp, none, none))
        if item is not None:
            yield Delivery(record.log_time - shift, item)


class _Decoder:
    """Turns messages into deliveries, remembering what belongs to those that follow."""

    def __init__(self, layout: Layout, joint_names: Sequence[str], shift: int) -> None:
        self._memory = Decoding(layout, tuple(joint_names), to_seconds(shift), layout.tree)
        self._streams = {topic: stream for stream in STREAMS for topic in stream.topics(layout)}
        self._path: JointPath | None = None
        self._executed: JointPath | None = None
        self._looks: dict[str, tuple[Surface, ...]] = {}
        self._face = FaceReader(self._memory.shift)

    def wants(self, topic: str) -> bool:
        """Whether a topic is replayed."""
        return topic in self._streams or topic in _SESSION or self._face.wants(topic)

    def take(self, topic: str, message: Any, record: Any) -> Any:
        """The delivery that a message makes, if any."""
        if topic in self._streams:
            return self._streams[topic].decode(topic, message, record, self._memory)
        if self._face.wants(topic):
            return self._face.take(topic, message)
        if topic in ("/tf", "/tf_static"):
            return self._transforms(message, fixed=topic == "/tf_static")
        if topic == "/guard/path":
            self._path = _or_none(messages.decode_trajectory(message))
        elif topic == "/guard/executed":
            self._executed = _or_none(messages.decode_trajectory(message))
        elif topic == "/guard/status":
            _, reason, values = messages.decode_diagnostics(message).get(GUARD, (0, "", {}))
            status = guard_from_status(reason, values, self._path, self._executed)
            if status is not None:
                return replace(status, stamp=status.stamp - self._memory.shift)
        elif topic == "/movers":
            return Moved(movers=decode_movers(message))
        elif topic == "/people":
            self._looks = decode_looks(message)
        return None

    def _transforms(self, message: Any, *, fixed: bool) -> Moved | None:
        """Keep what poses cameras; what poses people is told."""
        people = []
        for _, parent, child, T in messages.decode_transforms(message):
            if child in self._looks:
                people.append(MovingSurfaces(child, self._looks[child], T))
                continue
            self._memory.tree.set(parent, child, T)
            if not fixed:
                self._memory.moved.add(child)
        return Moved(bodies=tuple(people)) if people else None


_SESSION = (
    "/guard/status",
    "/guard/path",
    "/guard/executed",
    "/tf",
    "/tf_static",
    "/movers",
    "/people",
)
"""Topics of the session, not of a device, that are replayed."""


def _or_none(path: JointPath) -> JointPath | None:
    """An empty path was recorded for none."""
    return path if len(path) else None
