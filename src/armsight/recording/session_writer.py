"""Writes what a session shows into a recording: which topic, which type, which frame.

Topics are named as ROS names them, so that Foxglove and rosbag2 know what to do with them; the
table is in ``docs/recording.md``.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import JointPath, Pose
from armsight.devices.data import JointState
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.face import ShownFace
from armsight.recording import messages
from armsight.recording.changes import Changes
from armsight.recording.codec import Known
from armsight.recording.description import CellDescription, to_metadata
from armsight.recording.face_messages import (
    CURVES,
    FACE_TOPIC,
    MARKS_TOPIC,
    PICTURES,
    encode_face,
    encode_marks,
    encode_picture,
    topic_of,
)
from armsight.recording.markers import encode_looks, encode_movers, encode_solids
from armsight.recording.mcap_file import McapWriter
from armsight.recording.messages import to_ns
from armsight.recording.robot_description import robot_description
from armsight.recording.small_pictures import thinned
from armsight.recording.status_messages import guard_to_status, health_to_statuses
from armsight.recording.streams import BY_READING
from armsight.recording.topics import color_frame, depth_frame, stereo_frame
from armsight.robots.kinematics import link_poses, tcp_pose
from armsight.runtime.view import SessionView
from armsight.workcell.calibration_file.writing import updated

if TYPE_CHECKING:
    from armsight.workcell import Cell

PATH_PERIOD = 0.2
"""Between records of the path ahead, which shortens all the time [s]."""
EXECUTED_PERIOD = 0.5
"""Between records of the driven path, which grows all the time [s]."""
PICTURE_PERIOD = 0.2
"""Between records of a picture that a task shows [s]."""
TIP_POINTS = 100
"""About the most points of a recorded path of the tip."""


class Scribe:
    """Encodes and writes; belongs to the recorder's thread.

    Every method takes the time at which the session had its news: the message's log time.

    Args:
        cell: what is recorded; writer: into what.
        small: pictures are compressed, and there are fewer (:mod:`.small_pictures`).
    """

    def __init__(self, cell: Cell, writer: McapWriter, small: bool = False) -> None:
        self._cell = cell
        self._robot = cell.robot
        self._writer = writer
        self._infos = {camera.info.name: camera.info for camera in cell.cameras}
        self._pairs = {pair.info.name: pair.info for pair in cell.stereo}
        self._known = Known(cell.robot.joint_names, self._infos, self._pairs, small)
        self._changes = Changes()
        self._marked = False

    def _write(
        self,
        topic: str,
        kind: str,
        data: bytes,
        now: float,
        stamp: float,
        *,
        sequence: int = 0,
        latched: bool = False,
    ) -> None:
        self._writer.write(
            topic,
            kind,
            data,
            max(0, to_ns(now)),
            max(0, to_ns(stamp)),  # MCAP's times are unsigned
            sequence=sequence,
            latched=latched,
        )

    def reading(self, reading: Any, now: float) -> None:
        """Write whatever a device said."""
        stream = BY_READING[type(reading)]
        for message in stream.encode(reading, self._known):
            self._write(
                message.topic,
                message.kind,
                message.data,
                now,
                message.stamp,
                sequence=message.sequence,
            )

    def movers(self, view: SessionView, now: float) -> None:
        """Write where people and things are, and once what people look like."""
        people = {body.name.split("/")[0] for body in view.bodies}
        if view.bodies:
            names = tuple(body.name for body in view.bodies)
            if self._changes.changed("people", names):
                data = encode_looks(view.bodies, now)
                self._write("/people", messages.MARKERS, data, now, now, latched=True)
            tree = [("world", body.name, body.T_world_body) for body in view.bodies]
            data = messages.encode_transforms(tree, now)
            self._write("/tf", messages.TRANSFORMS, data, now, now)
        rest = [mover for mover in view.movers if mover.name.split("/")[0] not in people]
        if rest:
            data = encode_movers(rest, now, fresh=self._changes.changed("movers", len(rest)))
            self._write("/movers", messages.MARKERS, data, now, now)

    def guard(self, guard: GuardStatus, now: float) -> None:
        """Write a tick of the guard: its words, what is plotted, and its paths when they change."""
        for topic, path, period in (
            ("/guard/path", guard.path, PATH_PERIOD),
            ("/guard/executed", guard.executed, EXECUTED_PERIOD),
        ):
            if self._changes.due(topic, now, period) and self._changes.changed(topic, path):
                self._path(topic, path, now)
        data = messages.encode_diagnostics([guard_to_status(guard)], guard.stamp)
        self._write("/guard/status", messages.DIAGNOSTICS, data, now, guard.stamp)
        for topic, value in (
            ("/guard/distance", guard.distance),
            ("/guard/protective_distance", guard.protective_distance),
            ("/guard/speed_scale", guard.speed_scale),
        ):
            data = messages.encode_float(value)
            self._write(topic, messages.FLOAT, data, now, guard.stamp)

    def face(self, shown: ShownFace, now: float) -> None:
        """Write what the task shows: marks, new pictures, curves, and last the words."""
        face, stamp = shown.face, shown.stamp
        if face.marks or self._marked:  # none at all clears those of before, once
            self._marked = bool(face.marks)
            data = encode_marks(face.marks, stamp)
            self._write(MARKS_TOPIC, messages.MARKERS, data, now, stamp)
        for picture in face.pictures:
            topic = topic_of(PICTURES, picture.name)
            if self._changes.due(topic, now, PICTURE_PERIOD) and self._changes.changed(
                topic, picture.image
            ):
                data = encode_picture(picture, stamp)
                self._write(topic, messages.COMPRESSED, data, now, stamp)
        for curve in face.curves:
            data = messages.encode_float(curve.value)
            self._write(topic_of(CURVES, curve.name), messages.FLOAT, data, now, stamp)
        self._write(FACE_TOPIC, messages.DIAGNOSTICS, encode_face(shown), now, stamp)

    def _path(self, topic: str, path: JointPath | None, now: float) -> None:
        """The joints' path as it is, and the tip's, thinned, for those who look at it."""
        robot = self._robot
        way = np.zeros((0, robot.n)) if path is None else path
        data = messages.encode_trajectory(way, robot.joint_names, now)
        self._write(topic, messages.TRAJECTORY, data, now, now)
        few = way[:: 1 + len(way) // TIP_POINTS]
        tips = np.array([tcp_pose(robot, q)[:3, 3] for q in few]).reshape(-1, 3)
        data = messages.encode_path(tips, now, "base")
        self._write(f"{topic}_tip", messages.PATH, data, now, now)

    def links(self, joints: JointState, now: float) -> None:
        """Write where the arm's links are."""
        poses = link_poses(self._robot, joints.position)
        names = self._robot.link_names
        tree = [
            (names[i], names[i + 1], np.linalg.inv(poses[i]) @ poses[i + 1])
            for i in range(self._robot.n)
        ]
        if tree:
            data = messages.encode_transforms(tree, joints.stamp)
            self._write("/tf", messages.TRANSFORMS, data, now, joints.stamp)

    def describe(self) -> None:
        """Everything that does not change: metadata, the cell file, fixed transforms, the robot."""
        cell, robot, small = self._cell, self._robot, self._known.small
        description = CellDescription(
            robot.name if cell.workcell is None else cell.workcell.robot.model,
            _tool_of(cell),
            cell.T_world_base,
            robot.joint_names,
            tuple(map(thinned, self._infos.values()) if small else self._infos.values()),
            cell.static,
            datetime.now(UTC).isoformat(timespec="seconds"),
            tuple(map(thinned, self._pairs.values()) if small else self._pairs.values()),
            wrench=cell.wrench is not None,
            gripper=None if cell.gripper is None else cell.gripper.opening,
        )
        text = cell.workcell.text if cell.workcell is not None else ""
        attachments = {"workcell.toml": text.encode()} if text else {}
        found = cell.calibration
        if found is not None:
            text = updated("", cell.workcell, found.camera, found.arm, board=found.board)
            attachments["calibration.toml"] = text.encode()
        self._writer.describe(to_metadata(description), attachments)
        now = cell.clock.now()
        tree: list[tuple[str, str, Pose]] = [("world", "base", cell.T_world_base)]
        if robot.link_names[0] != "base":
            tree.append(("base", robot.link_names[0], np.eye(4)))
        if "flange" not in robot.link_names:
            tree.append((robot.link_names[-1], "flange", robot.T_last_flange))
        if robot.tool is not None:
            tree.append(("flange", "tcp", robot.tool.T_flange_tcp))
        for info in self._infos.values():
            tree.append((info.mounted_on, depth_frame(info.name), info.T_mount_camera))
            if info.color is not None:
                place = color_frame(info.name)
                tree.append((depth_frame(info.name), place, info.T_depth_color))
        for pair in self._pairs.values():
            left, right = (stereo_frame(pair.name, side) for side in ("left", "right"))
            tree.append((pair.mounted_on, left, pair.T_mount_camera))
            tree.append((left, right, pair.T_left_right))
        self._latch("/tf_static", messages.TRANSFORMS, messages.encode_transforms(tree, now), now)
        text = robot_description(robot)
        self._latch("/robot_description", messages.STRING, messages.encode_string(text), now)
        data = encode_solids(cell.static, now, "base")
        self._latch("/workcell/solids", messages.MARKERS, data, now)
        self._writer.flush()

    def cloud(self, snapshot: WorkspaceSnapshot, now: float) -> None:
        """Write the map's merged cloud."""
        data = messages.encode_cloud(snapshot.cloud, snapshot.stamp, "base")
        self._write("/workspace/cloud", messages.POINT_CLOUD, data, now, snapshot.stamp)

    def health(self, view: SessionView, now: float) -> None:
        """Write how components and cameras are."""
        cameras = () if view.snapshot is None else view.snapshot.cameras
        data = messages.encode_diagnostics(
            health_to_statuses(view.health, cameras, view.devices), now
        )
        self._write("/diagnostics", messages.DIAGNOSTICS, data, now, now)

    def _latch(self, topic: str, kind: str, data: bytes, now: float) -> None:
        self._write(topic, kind, data, now, now, latched=True)


def _tool_of(cell: Cell) -> str:
    """What the flange carries: a name of the catalogue, or where the user's own tool lies."""
    tool = cell.robot.tool
    if tool is None:
        return "none"
    return tool.name if cell.workcell is None else cell.workcell.robot.tool
