"""A perceiver that calibrates a camera again, from the arm's own work, once it has been moved.

Whoever notices (the map's own check, the board in passing) excludes the camera: it frees no space
any more, and the arm slows where nobody else looks. From then on its depth pictures of the arm, at
the joint angles that the encoders say, are kept; as soon as they place it, it counts again from
there. Nothing is written: ``armsight calibrate --markerless`` does that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np

from armsight.devices.data import RgbdCameraInfo
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.robots.robot import Robot
from armsight.tasks.markerless import ArmViews, find_camera, own_error
from armsight.workcell import Cell

LEAST, MOST = 3, 8
"""Views from which a pose is asked for, and that are kept."""
GOOD = 0.006
"""Standard deviation on the arm from which a pose is taken [m]."""


@dataclass(frozen=True)
class ArmSeen:
    """What the arm says of the cameras.

    Attributes:
        stamp: exposure of the newest picture that it rests on [s].
        placed: cameras that were calibrated again, with their poses.
        warning: what is going on, in words; or empty.
    """

    stamp: float
    placed: tuple[RgbdCameraInfo, ...] = ()
    warning: str = ""


def arm_watch(cell: Cell) -> tuple[ArmWatch, ...]:
    """The watch of a cell; none without a calibrated camera that stands.

    The map itself aligns a camera anew whose pose nobody has measured.
    """
    cameras = [
        c.info
        for c in cell.cameras
        if c.info.mounted_on == "base" and c.info.covariance is not None
    ]
    if not cameras or not cell.robot.meshes:
        return ()
    return (ArmWatch(cell.robot, cameras),)


class ArmWatch:
    """Keeps views of the arm by the cameras that are excluded, and places them by these.

    Args:
        robot: the arm.
        cameras: that stand, and were calibrated.
    """

    name = "arm watch"
    period = 0.2
    latency = 0.5

    def __init__(self, robot: Robot, cameras: Sequence[RgbdCameraInfo]) -> None:
        self.cameras: Sequence[CameraUse] = tuple(CameraUse(c.name) for c in cameras)
        self._robot = robot
        self._names = {c.name for c in cameras}
        self._told: SimpleQueue[str] = SimpleQueue()
        self.reset()

    def reset(self) -> None:
        """No camera has been moved."""
        while not self._told.empty():
            self._told.get()
        self._views: dict[str, ArmViews] = {}
        self._tried: dict[str, int] = {}
        self._placed: dict[str, RgbdCameraInfo] = {}
        self._words: dict[str, str] = {}

    def told_excluded(self, camera: str, reason: str) -> None:
        """A camera does not count any more; from any thread."""
        if camera in self._names:
            self._told.put(camera)

    def update(self, frames: Sequence[PosedFrame]) -> ArmSeen | None:
        """Look at the arm through the cameras that are excluded; None while there is none."""
        while not self._told.empty():
            self._begin(self._told.get())
        looked = [posed for posed in frames if posed.info.name in self._views]
        for posed in looked:
            name = posed.info.name
            if self._views[name].update([posed]) is not None:
                self._ask(posed.info, self._views[name])
        if not looked:
            return None
        warning = "; ".join(self._words.values())
        return ArmSeen(max(p.frame.stamp for p in looked), tuple(self._placed.values()), warning)

    def _begin(self, name: str) -> None:
        self._views[name] = ArmViews([name], MOST)
        self._tried[name] = LEAST - 1
        self._words[name] = f"camera {name} is calibrated again: let the arm move in its view"

    def _ask(self, info: RgbdCameraInfo, kept: ArmViews) -> None:
        """Place a camera, once for each new view."""
        name, views = info.name, kept.views[info.name]
        if len(views) <= self._tried[name]:
            return
        self._tried[name] = len(views)
        answer = find_camera(self._robot, info, views)
        if answer.believed and answer.sigma <= GOOD:
            covariance = answer.covariance + own_error(self._robot)
            self._placed[name] = replace(
                info, T_mount_camera=answer.T_base_camera, covariance=covariance
            )
            shift = answer.T_base_camera[:3, 3] - info.T_mount_camera[:3, 3]
            self._words[name] = (
                f"camera {name} stood {1e3 * float(np.linalg.norm(shift)):.0f} mm off and was "
                "calibrated again from the arm; 'armsight calibrate --markerless' keeps it"
            )
            del self._views[name]
        elif len(views) == MOST:  # perhaps it was moved once more meanwhile
            self._begin(name)
