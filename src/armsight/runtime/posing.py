"""Frames with where their cameras were, from the joints at the exposure."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import (
    JointState,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
)
from armsight.devices.history import JointHistory
from armsight.geometry.camera import PinholeCamera
from armsight.motion.perception import CameraUse, PosedFrame, PosedPair
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot


def posed(
    frame: RgbdFrame, info: RgbdCameraInfo, robot: Robot, history: JointHistory
) -> PosedFrame:
    """A frame with the joints at its exposure and the pose of its camera."""
    joints = _joints_at(frame.stamp, history)
    T = frame.T_base_camera
    if T is None:
        T = _mounted(info, robot, joints)
    return PosedFrame(frame, info, joints, T, color_lens(frame, info))


def posed_pair(
    frame: StereoFrame, info: StereoInfo, robot: Robot, history: JointHistory
) -> PosedPair:
    """A pair's pictures with the joints at their exposure and the pose of its left lens."""
    joints = _joints_at(frame.stamp, history)
    return PosedPair(frame, info, joints, _mounted(info, robot, joints))


def _joints_at(stamp: float, history: JointHistory) -> JointState | None:
    joints = history.at(stamp) if math.isfinite(stamp) else None
    return joints if joints is not None and np.isfinite(joints.position).all() else None


def _mounted(
    info: RgbdCameraInfo | StereoInfo, robot: Robot, joints: JointState | None
) -> Pose | None:
    if info.mounted_on == "base":
        return info.T_mount_camera
    if joints is None:
        return None
    return np.asarray(flange_pose(robot, joints.position) @ info.T_mount_camera)


def color_lens(frame: RgbdFrame, info: RgbdCameraInfo) -> PinholeCamera | None:
    """The lens of a frame's colour picture at the size it came in; None without one."""
    if frame.color is None or info.color is None:
        return None
    width = frame.color.shape[1]
    return info.color if width == info.color.width else info.color.scaled(width / info.color.width)


class NewestFrames:
    """The newest frame of each camera that a subscriber wants; written and read by any thread.

    Of a camera whose colour is wanted, a picture that nobody has looked at yet is not replaced by
    a frame without one: colour comes seldom, and who is behind would hardly ever see any.
    """

    def __init__(self, uses: Sequence[CameraUse], pairs: Sequence[str] = ()) -> None:
        self._names = {use.camera for use in uses}
        self._pictured = {use.camera for use in uses if use.color_rate > 0.0}
        self._pairs = frozenset(pairs)
        self._lock = threading.Lock()
        self._newest: dict[str, Any] = {}
        self._fresh: set[str] = set()

    def use(self, uses: Sequence[CameraUse]) -> None:
        """The subscriber wants other cameras from now on; what came before is forgotten."""
        with self._lock:
            self._names = {use.camera for use in uses}
            self._pictured = {use.camera for use in uses if use.color_rate > 0.0}
            self._newest.clear()
            self._fresh.clear()

    def wants(self, frame: RgbdFrame | StereoFrame) -> bool:
        """Whether a camera's or a pair's frames are subscribed to."""
        if isinstance(frame, StereoFrame):
            return frame.camera in self._pairs
        return "" in self._names or frame.camera in self._names

    def put(self, frame: RgbdFrame | StereoFrame) -> None:
        """A frame came in."""
        if not self.wants(frame):
            return
        name = frame.camera
        with self._lock:
            if name in self._fresh and self._keeps(self._newest[name], frame):
                return
            self._newest[name] = frame
            self._fresh.add(name)

    def _keeps(self, waiting: Any, frame: Any) -> bool:
        """Whether a picture that waits is worth more than a newer frame."""
        wanted = not self._pictured.isdisjoint(("", frame.camera))
        return wanted and _has_picture(waiting) and not _has_picture(frame)

    @property
    def waiting(self) -> bool:
        """Whether a frame came in since the last :meth:`take`."""
        with self._lock:
            return bool(self._fresh)

    def take(self) -> list[Any]:
        """The newest frames that came in since the last time, by exposure."""
        with self._lock:
            frames = [self._newest[name] for name in self._fresh]
            self._fresh.clear()
        return sorted(frames, key=lambda frame: (frame.stamp, frame.camera))

    def newest(self) -> list[Any]:
        """The newest frame of every camera that ever sent one, by name."""
        with self._lock:
            self._fresh.clear()
            return [self._newest[name] for name in sorted(self._newest)]


def _has_picture(frame: RgbdFrame | StereoFrame) -> bool:
    if isinstance(frame, StereoFrame):
        return True
    return frame.color is not None or frame.infrared is not None
