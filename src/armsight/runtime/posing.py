"""Frames with where their cameras were, from the joints at the exposure."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

import numpy as np

from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.geometry.camera import PinholeCamera
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot


def posed(
    frame: RgbdFrame, info: RgbdCameraInfo, robot: Robot, history: JointHistory
) -> PosedFrame:
    """A frame with the joints at its exposure and the pose of its camera."""
    joints = history.at(frame.stamp) if math.isfinite(frame.stamp) else None
    if joints is not None and not np.isfinite(joints.position).all():
        joints = None
    T = frame.T_base_camera
    if T is None and info.mounted_on == "base":
        T = info.T_mount_camera
    elif T is None and joints is not None:
        T = flange_pose(robot, joints.position) @ info.T_mount_camera
    return PosedFrame(frame, info, joints, T, color_lens(frame, info))


def color_lens(frame: RgbdFrame, info: RgbdCameraInfo) -> PinholeCamera | None:
    """The lens of a frame's colour picture at the size it came in; None without one."""
    if frame.color is None or info.color is None:
        return None
    width = frame.color.shape[1]
    return info.color if width == info.color.width else info.color.scaled(width / info.color.width)


class NewestFrames:
    """The newest frame of each camera that a subscriber wants; written and read by any thread."""

    def __init__(self, uses: Sequence[CameraUse]) -> None:
        self._names = {use.camera for use in uses}
        self._lock = threading.Lock()
        self._newest: dict[str, RgbdFrame] = {}
        self._fresh: set[str] = set()

    def use(self, uses: Sequence[CameraUse]) -> None:
        """The subscriber wants other cameras from now on; what came before is forgotten."""
        with self._lock:
            self._names = {use.camera for use in uses}
            self._newest.clear()
            self._fresh.clear()

    def wants(self, camera: str) -> bool:
        """Whether a camera's frames are subscribed to."""
        return "" in self._names or camera in self._names

    def put(self, frame: RgbdFrame) -> None:
        """A frame came in."""
        if self.wants(frame.camera):
            with self._lock:
                self._newest[frame.camera] = frame
                self._fresh.add(frame.camera)

    @property
    def waiting(self) -> bool:
        """Whether a frame came in since the last :meth:`take`."""
        with self._lock:
            return bool(self._fresh)

    def take(self) -> list[RgbdFrame]:
        """The newest frames that came in since the last time, by exposure."""
        with self._lock:
            frames = [self._newest[name] for name in self._fresh]
            self._fresh.clear()
        return sorted(frames, key=lambda frame: (frame.stamp, frame.camera))

    def newest(self) -> list[RgbdFrame]:
        """The newest frame of every camera that ever sent one, by name."""
        with self._lock:
            return [self._newest[name] for name in sorted(self._newest)]
