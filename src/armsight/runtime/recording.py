"""Records a running session as MCAP with ROS 2 types: an observer that never holds the loop up.

The loop's thread only hands over immutable values; a thread of the recorder's own encodes,
compresses and writes. Every frame and joint reading that sensing takes in is recorded once, with
its exposure as the stamp and its coming into the session as the log time, so that a replay feeds
the map at the same moments.
"""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from armsight.arrays import JointPath, Pose
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame
from armsight.errors import RecordingError
from armsight.robots.kinematics import link_poses, tip_pose
from armsight.runtime import messages
from armsight.runtime.byte_queue import ByteQueue
from armsight.runtime.description import CellDescription, to_metadata
from armsight.runtime.markers import encode_movers, encode_solids
from armsight.runtime.mcap_file import McapWriter
from armsight.runtime.messages import to_ns
from armsight.runtime.robot_description import robot_description
from armsight.runtime.status_messages import guard_to_status, health_to_statuses
from armsight.runtime.view import SessionView

if TYPE_CHECKING:
    from armsight.workcell import Cell

WAITING_BYTES = 256 * 1024 * 1024
"""Most that may wait for the disk."""
FLUSH_SECONDS = 1.0
"""A recording that is killed loses at most this much [s] and what was waiting."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class Watched(Protocol):
    """What the recorder needs of a session."""

    def view(self) -> SessionView:
        """One consistent look."""
        ...


def depth_frame(camera: str) -> str:
    """Name of the frame of a camera's depth lens."""
    return f"{camera}_depth_optical_frame"


def color_frame(camera: str) -> str:
    """Name of the frame of a camera's colour lens."""
    return f"{camera}_color_optical_frame"


def depth_topic(info: RgbdCameraInfo) -> str:
    """ROS calls an image rectified only when its lens has no distortion left."""
    return f"/{info.name}/depth/{'image_rect_raw' if info.depth.is_ideal else 'image_raw'}"


class Recorder:
    """Writes ``NAME.mcap``; until :meth:`close` it is ``NAME.mcap.partial``.

    A full disk ends the recording, not the session: :attr:`problem` says so, and the file is closed
    with everything written until then.

    Args:
        path: ends in ``.mcap``; never overwritten.
        cell: what is recorded.
        cloud_period: between point clouds and voxels [s].
        waiting_bytes: what may wait for the disk; see ``wait``.
        wait: when that is reached, hold the session up (right under the simulated clock, which has
            time) or drop frames and count them (right in real time).
    """

    name = "recorder"

    def __init__(
        self,
        path: str | Path,
        cell: Cell,
        *,
        period: float = 1.0 / 30.0,
        cloud_period: float = 0.2,
        waiting_bytes: int = WAITING_BYTES,
        wait: bool = True,
    ) -> None:
        """Create the file and write what is known before the start.

        Raises:
            RecordingError: the file exists already or cannot be written.
        """
        self.period = period
        self.problem = ""
        self.dropped = 0
        self._wait = wait
        self._cloud_period = cloud_period
        self._cell = cell
        self._robot = cell.robot
        self._infos = {camera.info.name: camera.info for camera in cell.cameras}
        self._topics = {name: depth_topic(info) for name, info in self._infos.items()}
        self._view: Callable[[], SessionView] | None = None
        self._start: float | None = None
        self._last = 0.0
        self._joints = -np.inf
        self._done: dict[str, float] = {}
        self._seen: dict[str, object] = {}
        self._writer = McapWriter(Path(path))
        self._queue = ByteQueue(waiting_bytes)
        try:
            self._describe()
        except OSError as error:
            self._fail(error)
        self._thread = threading.Thread(target=self._work, name="armsight-recording", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file's name once it is closed."""
        return self._writer.path

    def attach(self, session: Watched) -> None:
        """Watch a session; its sensing calls :meth:`on_joints` and :meth:`on_frame`."""
        self._view = session.view

    # -- called by sensing ----------------------------------------------------------------------

    def on_joints(self, state: JointState, now: float) -> None:
        """Record a joint reading that came in at ``now`` [s]; one seen before is ignored."""
        if state.stamp <= self._joints:
            return
        self._joints = state.stamp
        names = self._robot.joint_names
        self._put(
            256,
            lambda: self._write(
                "/joint_states",
                messages.JOINT_STATE,
                messages.encode_joint_state(state, names),
                now,
                state.stamp,
            ),
            now,
        )

    def on_frame(self, frame: RgbdFrame, now: float) -> None:
        """Record a frame that came in at ``now`` [s]."""
        size = frame.depth.nbytes + (0 if frame.color is None else frame.color.nbytes)
        if not self._put(size, lambda: self._write_frame(frame, now), now):
            self.dropped += 1
            self.problem = f"{self.dropped} frames not recorded: the disk is too slow"

    # -- called by the loop ---------------------------------------------------------------------

    def update(self, now: float) -> None:
        """Record what can be seen from outside: status, links, map, people, health."""
        if self._view is None or self._queue.closed:
            return
        view = self._view()
        if view.guard is not None and self._changed("guard", view.guard):
            guard = view.guard
            self._put(1024, lambda: self._write_guard(guard, now), now)
        if view.joints is not None and self._changed("links", view.joints):
            joints = view.joints
            self._put(1024, lambda: self._write_links(joints, now), now)
        if view.movers:
            movers = view.movers
            fresh = self._changed("movers", len(movers))
            self._put(
                512 * len(movers),
                lambda: self._write(
                    "/movers", messages.MARKERS, encode_movers(movers, now, fresh=fresh), now, now
                ),
                now,
            )
        snapshot = view.snapshot
        if snapshot is not None and self._due("cloud", now, self._cloud_period):
            cloud = snapshot.cloud
            self._put(
                cloud.nbytes,
                lambda: self._write(
                    "/workspace/cloud",
                    messages.POINT_CLOUD,
                    messages.encode_cloud(cloud, snapshot.stamp, "base"),
                    now,
                    snapshot.stamp,
                ),
                now,
            )
        if self._due("health", now, 1.0):
            cameras = () if snapshot is None else snapshot.cameras
            statuses = health_to_statuses(view.health, cameras)
            self._put(
                1024,
                lambda: self._write(
                    "/diagnostics",
                    messages.DIAGNOSTICS,
                    messages.encode_diagnostics(statuses, now),
                    now,
                    now,
                ),
                now,
            )

    def close(self) -> Path:
        """Write what is waiting, the index, and give the file its name; may be repeated.

        Raises:
            RecordingError: writing ended early; the message says how much there is.
        """
        self._queue.close()
        self._thread.join()
        if self._failure:
            raise RecordingError(self._failure)
        return self.path

    # -- the writing thread ---------------------------------------------------------------------

    _failure = ""

    def _work(self) -> None:
        try:
            flushed = time.monotonic()
            while (job := self._queue.get()) is not None:
                job()
                if time.monotonic() - flushed > FLUSH_SECONDS:
                    self._writer.flush()
                    flushed = time.monotonic()
            if not self._failure:
                self._writer.close()
        except OSError as error:
            self._fail(error)
        except Exception as error:  # a bug must not leave a torn file behind
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """End the recording: close what there is, and say what happened."""
        self._queue.close(drop=True)
        full = getattr(error, "errno", 0) in _FULL
        what = "the disk is full" if full else f"{type(error).__name__}: {error}"
        seconds = self._last - (self._start or 0.0)
        try:
            kept = self._writer.abandon()
            self._failure = (
                f"recording stopped: {what}; {kept} is complete up to {seconds:.1f} s"
                + ". Free some space, or record to another disk" * full
            )
        except OSError as second:
            self._failure = (
                f"recording stopped: {what}, and {self._writer.partial} could not be closed "
                f"({second.strerror}); it is readable up to its cut, {seconds:.1f} s"
            )
        self.problem = self._failure

    def _put(self, size: int, job: Callable[[], None], now: float) -> bool:
        if self._start is None:
            self._start = now
        return self._queue.put(size, job, wait=self._wait)

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
        self._last = max(self._last, now)
        self._writer.write(
            topic,
            kind,
            data,
            max(0, to_ns(now)),
            max(0, to_ns(stamp)),  # MCAP's times are unsigned
            sequence=sequence,
            latched=latched,
        )

    def _write_frame(self, frame: RgbdFrame, now: float) -> None:
        info = self._infos[frame.camera]
        place, stamp = depth_frame(info.name), frame.stamp
        if frame.T_base_camera is not None:
            tree = [("base", place, frame.T_base_camera)]
            data = messages.encode_transforms(tree, stamp)
            self._write("/tf", messages.TRANSFORMS, data, now, stamp)
        lens = messages.encode_camera_info(info.depth, stamp, place)
        self._write(f"/{info.name}/depth/camera_info", messages.CAMERA_INFO, lens, now, stamp)
        if frame.color is not None and info.color is not None:
            place = color_frame(info.name)
            lens = messages.encode_camera_info(info.color, stamp, place)
            self._write(f"/{info.name}/color/camera_info", messages.CAMERA_INFO, lens, now, stamp)
            self._write(
                f"/{info.name}/color/image_raw",
                messages.IMAGE,
                messages.encode_color(frame.color, stamp, place),
                now,
                stamp,
                sequence=frame.sequence,
            )
        # Depth comes last: when a reader meets it, everything else of the exposure is there.
        self._write(
            self._topics[info.name],
            messages.IMAGE,
            messages.encode_depth(frame.depth, stamp, depth_frame(info.name)),
            now,
            stamp,
            sequence=frame.sequence,
        )

    def _write_guard(self, guard: object, now: float) -> None:
        from armsight.motion.data import GuardStatus

        assert isinstance(guard, GuardStatus)
        for topic, path in (("/guard/path", guard.path), ("/guard/executed", guard.executed)):
            slow = topic == "/guard/executed" and not self._due(topic, now, 0.5)
            if not slow and self._changed(topic, path):
                self._write_path(topic, path, now)
        data = messages.encode_diagnostics([guard_to_status(guard)], guard.stamp)
        self._write("/guard/status", messages.DIAGNOSTICS, data, now, guard.stamp)
        for topic, value in (
            ("/guard/distance", guard.distance),
            ("/guard/protective_distance", guard.protective_distance),
            ("/guard/speed_scale", guard.speed_scale),
        ):
            data = messages.encode_float(value)
            self._write(topic, messages.FLOAT, data, now, guard.stamp)

    def _write_path(self, topic: str, path: JointPath | None, now: float) -> None:
        way = np.zeros((0, self._robot.n)) if path is None else path
        data = messages.encode_trajectory(way, self._robot.joint_names, now)
        self._write(topic, messages.TRAJECTORY, data, now, now)
        tips = np.array([tip_pose(self._robot, q)[:3, 3] for q in way]).reshape(-1, 3)
        self._write(
            f"{topic}_tip", messages.PATH, messages.encode_path(tips, now, "base"), now, now
        )

    def _write_links(self, joints: JointState, now: float) -> None:
        poses = link_poses(self._robot, joints.position)
        names = self._robot.link_names
        tree = [
            (names[i], names[i + 1], np.linalg.inv(poses[i]) @ poses[i + 1])
            for i in range(self._robot.n)
        ]
        if tree:
            data = messages.encode_transforms(tree, joints.stamp)
            self._write("/tf", messages.TRANSFORMS, data, now, joints.stamp)

    def _describe(self) -> None:
        """Everything that does not change: metadata, the cell file, fixed transforms, the robot."""
        cell, robot = self._cell, self._robot
        description = CellDescription(
            robot.name,
            "none" if robot.tool is None else robot.tool.name,
            cell.T_world_base,
            robot.joint_names,
            tuple(self._infos.values()),
            cell.static,
            datetime.now(UTC).isoformat(timespec="seconds"),
        )
        text = cell.workcell.text if cell.workcell is not None else ""
        attachments = {"workcell.toml": text.encode()} if text else {}
        self._writer.describe(to_metadata(description), attachments)
        now = cell.clock.now()
        tree: list[tuple[str, str, Pose]] = [("world", "base", cell.T_world_base)]
        if robot.link_names[0] != "base":
            tree.append(("base", robot.link_names[0], np.eye(4)))
        if "flange" not in robot.link_names:
            tree.append((robot.link_names[-1], "flange", robot.T_last_flange))
        if robot.tool is not None:
            tree.append(("flange", "tool_tip", robot.tool.T_flange_tip))
        for info in self._infos.values():
            tree.append((info.mounted_on, depth_frame(info.name), info.T_mount_camera))
            if info.color is not None:
                place = color_frame(info.name)
                tree.append((depth_frame(info.name), place, info.T_depth_color))
        self._latch("/tf_static", messages.TRANSFORMS, messages.encode_transforms(tree, now), now)
        text = robot_description(robot)
        self._latch("/robot_description", messages.STRING, messages.encode_string(text), now)
        data = encode_solids(cell.static, now, "base")
        self._latch("/workcell/solids", messages.MARKERS, data, now)
        self._writer.flush()

    def _latch(self, topic: str, kind: str, data: bytes, now: float) -> None:
        self._write(topic, kind, data, now, now, latched=True)

    def _changed(self, key: str, value: object) -> bool:
        """Whether this is another object than last time."""
        before = self._seen.get(key, self)
        self._seen[key] = value
        return before is not value

    def _due(self, key: str, now: float, period: float) -> bool:
        if now < self._done.get(key, -np.inf) + period - 1e-9:
            return False
        self._done[key] = now
        return True
