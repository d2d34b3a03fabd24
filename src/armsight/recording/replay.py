"""Opens recordings as cells: the same map and the same page as when they were made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from armsight.arrays import ColorImage, JointPath
from armsight.devices.data import JointState, RgbdFrame
from armsight.devices.recorded import RecordedArm, RecordedCamera, RecordedClock
from armsight.devices.world import MovingSurfaces
from armsight.errors import ArmsightError, RecordingError
from armsight.geometry.shapes import Surface
from armsight.recording import messages
from armsight.recording.description import CellDescription
from armsight.recording.layout import FrameTree, Layout, layout_of
from armsight.recording.markers import decode_looks, decode_movers
from armsight.recording.mcap_file import McapReader
from armsight.recording.messages import NANOSECONDS, to_seconds
from armsight.recording.no_robot import NAME as NO_ROBOT
from armsight.recording.no_robot import no_robot
from armsight.recording.playback import Delivery, Moved, Playback, Source
from armsight.recording.status_messages import GUARD, guard_from_status
from armsight.robots import load_robot, load_tool
from armsight.robots.robot import Robot
from armsight.workcell import Cell, Workcell, parse_workcell, robot_in

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
    playback = Playback(source, clock, arm, cameras)
    return Cell(
        workcell,
        robot,
        description.T_world_base,
        clock,
        arm,
        cameras,
        description.static,
        playback,
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
        text = reader.contents.attachments.get("workcell.toml")
        if text is not None:
            workcell = parse_workcell(_without_people(text.decode()), str(reader.path))
            return workcell, robot_in(workcell)
        robot = load_robot(description.robot)
        if description.tool != "none":
            robot = robot.with_tool(load_tool(description.tool))
    except RecordingError:
        raise
    except ArmsightError as error:
        raise RecordingError(f"{reader.path}: its cell cannot be built again: {error}") from error
    return bare_workcell(reader.path.stem, description.robot), robot


def _without_people(text: str) -> str:
    """Nobody needs to be simulated, and motion clips that the file names may not be here."""
    document = tomlkit.parse(text)
    for key in ("person", "object", "undeclared"):
        document.get("simulation", {}).pop(key, None)
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
    )


def _deliveries(
    reader: McapReader, layout: Layout, joint_names: Sequence[str], shift: int
) -> Iterator[Delivery]:
    """Decode a recording from its start."""
    decoder = _Decoder(layout, joint_names, shift)
    topics = [topic for topic in reader.topics if decoder.wants(topic)]
    for topic, kind, record in reader.messages(topics):
        item = decoder.take(topic, messages.decode(record.data, kind), record)
        if item is not None:
            yield Delivery(record.log_time - shift, item)


class _Decoder:
    """Turns messages into deliveries, remembering what belongs to those that follow."""

    def __init__(self, layout: Layout, joint_names: Sequence[str], shift: int) -> None:
        self._layout = layout
        self._joint_names = joint_names
        self._shift = to_seconds(shift)
        self._colors: dict[str, tuple[float, ColorImage]] = {}
        self._counts: dict[str, int] = {}
        self._moved: set[str] = set()
        self._path: JointPath | None = None
        self._executed: JointPath | None = None
        self._tree: FrameTree = layout.tree
        self._looks: dict[str, tuple[Surface, ...]] = {}

    def wants(self, topic: str) -> bool:
        """Whether a topic is replayed."""
        return (
            topic in self._layout.depth
            or topic in self._layout.color
            or topic == self._layout.joints
            or topic in ("/guard/status", "/guard/path", "/guard/executed", "/tf", "/tf_static")
            or topic in ("/movers", "/people")
        )

    def take(self, topic: str, message: Any, record: Any) -> Any:
        """The delivery that a message makes, if any."""
        layout = self._layout
        if topic in layout.depth:
            return self._frame(layout.depth[topic], message, record)
        if topic in layout.color:
            stamp = messages.stamp_of(message)
            self._colors[layout.color[topic]] = (stamp, messages.decode_color(message))
        elif topic == layout.joints:
            state = messages.decode_joint_state(message, self._joint_names)
            return None if state is None else self._shifted(state)
        elif topic in ("/tf", "/tf_static"):
            return self._transforms(message, fixed=topic == "/tf_static")
        elif topic == "/guard/path":
            self._path = _or_none(messages.decode_trajectory(message))
        elif topic == "/guard/executed":
            self._executed = _or_none(messages.decode_trajectory(message))
        elif topic == "/guard/status":
            _, reason, values = messages.decode_diagnostics(message).get(GUARD, (0, "", {}))
            status = guard_from_status(reason, values, self._path, self._executed)
            return None if status is None else replace(status, stamp=status.stamp - self._shift)
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
            self._tree.set(parent, child, T)
            if not fixed:
                self._moved.add(child)
        return Moved(bodies=tuple(people)) if people else None

    def _shifted(self, state: JointState) -> JointState:
        return replace(state, stamp=state.stamp - self._shift) if self._shift else state

    def _frame(self, camera: str, message: Any, record: Any) -> RgbdFrame:
        stamp = messages.stamp_of(message)
        color_stamp, color = self._colors.pop(camera, (np.nan, None))
        place = self._layout.posed.get(camera)
        pose = None
        if place is not None and (self._layout.moving or place in self._moved):
            pose = self._tree.pose(self._layout.base, place)
        count = self._counts.get(camera, -1) + 1
        self._counts[camera] = count
        return RgbdFrame(
            camera,
            record.sequence or count,
            stamp - self._shift,
            to_seconds(record.log_time) - self._shift,
            messages.decode_depth(message),
            color if color_stamp == stamp else None,
            pose,
        )


def _or_none(path: JointPath) -> JointPath | None:
    """An empty path was recorded for none."""
    return path if len(path) else None
