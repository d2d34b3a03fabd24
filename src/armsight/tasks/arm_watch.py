"""A perceiver that calibrates a camera again, from the arm's own work, once it has been moved.

Of a camera whose pictures the map refuses, one picture of the arm, at the joint angles that the
encoders say, tells whether it was moved: then it is excluded, frees no space any more, and the arm
goes on as if it were not there, slowly where nobody else looks. More of its pictures of the moving
arm are kept, and as soon as they place it, it counts again from there. The same begins where the
map's own check or the board in passing has named it. Nothing is written: ``armsight calibrate
--markerless`` does that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from queue import SimpleQueue

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.recognition.own_arm import OwnArmPose, arm_surface
from armsight.robots.robot import Robot
from armsight.tasks.markerless import ArmViews, find_camera, own_error
from armsight.workcell import Cell

LEAST, MOST = 3, 8
"""Views from which a camera is placed, and that are kept."""
STILL = 5.0
"""The arm does not move in its view, perhaps for want of this camera: fewer views must do [s]."""
GOOD = 0.010
"""Standard deviation on the arm from which a pose is taken at once [m]: of a sensor whose depth
nobody has calibrated most of it is what that may be wrong by."""
MOVED, SURE = 0.02, 2.0
"""A camera was moved that places the arm so far off [m], and so many standard deviations."""


@dataclass(frozen=True)
class ArmSeen:
    """What the arm says of the cameras.

    Attributes:
        stamp: exposure of the newest picture that it rests on [s].
        excluded: (camera, why nothing that it says may count).
        placed: cameras that were calibrated again, with their poses.
        warning: what is going on, in words; or empty.
    """

    stamp: float
    excluded: tuple[tuple[str, str], ...] = ()
    placed: tuple[RgbdCameraInfo, ...] = ()
    warning: str = ""


def arm_watch(cell: Cell) -> tuple[ArmWatch, ...]:
    """The watch of a cell; none where no camera of the guard's stands, or the arm has no shape.

    The map itself aligns a camera anew whose pose is only declared, where one picture is enough.
    """
    cameras = [c.info for c in cell.cameras if c.info.mounted_on == "base" and c.info.guard]
    if not cameras or not cell.robot.meshes:
        return ()
    return (ArmWatch(cell.robot, cameras),)


class ArmWatch:
    """Keeps views of the arm by the cameras that do not count, and places them by these.

    Args:
        robot: the arm.
        cameras: that stand.
    """

    name = "arm watch"
    period = 0.2
    latency = 0.5

    def __init__(self, robot: Robot, cameras: Sequence[RgbdCameraInfo]) -> None:
        self.cameras: Sequence[CameraUse] = tuple(CameraUse(c.name) for c in cameras)
        self._robot = robot
        self._names = {c.name for c in cameras}
        self._told: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        self.reset()

    def reset(self) -> None:
        """No camera has been moved."""
        while not self._told.empty():
            self._told.get()
        self._views: dict[str, ArmViews] = {}
        self._tried: dict[str, int] = {}
        self._answers: dict[str, tuple[OwnArmPose, float]] = {}
        self._moved: dict[str, str] = {}
        self._excluded: set[str] = set()
        self._placed: dict[str, RgbdCameraInfo] = {}
        self._words: dict[str, str] = {}

    def doubted(self, camera: str, excluded: bool) -> None:
        """A camera does not count any more, or its pictures are refused; from any thread."""
        if camera in self._names:
            self._told.put((camera, excluded))

    def update(self, frames: Sequence[PosedFrame]) -> ArmSeen | None:
        """Look at the arm through the cameras that do not count; None while there is none."""
        while not self._told.empty():
            name, out = self._told.get()
            if out:
                self._excluded.add(name)
            if name not in self._views:
                self._begin(name)
        looked = [posed for posed in frames if posed.info.name in self._views]
        for posed in looked:
            if self._views[posed.info.name].update([posed]) is not None:
                self._ask(posed.info, posed.frame.stamp)
        if not looked:
            return None
        stamp = max(p.frame.stamp for p in looked)
        excluded, placed = tuple(self._moved.items()), tuple(self._placed.values())
        return ArmSeen(stamp, excluded, placed, "; ".join(self._words.values()))

    def _begin(self, name: str) -> None:
        self._views[name] = ArmViews([name], MOST)
        self._tried[name] = 0
        self._answers.pop(name, None)

    def _ask(self, info: RgbdCameraInfo, stamp: float) -> None:
        """What a camera's views say, once for each new one."""
        name, views = info.name, self._views[info.name].views[info.name]
        if len(views) <= self._tried[name]:
            answer, since = self._answers.get(name, (None, stamp))
            if answer is not None and stamp - since >= STILL:
                self._conclude(info, answer)
            return
        self._tried[name] = len(views)
        self._answers.pop(name, None)
        answer = find_camera(self._robot, info, views)
        if answer.believed:
            off = self._off(info, answer.T_base_camera)
            if name not in self._moved and off > max(MOVED, SURE * answer.sigma):
                self._moved[name] = (
                    f"was moved since it was calibrated: it sees the arm {1e3 * off:.0f} mm off; "
                    "it is calibrated again as the arm moves in its view"
                )
            self._answers[name] = answer, stamp
            if len(views) >= LEAST and answer.sigma <= GOOD:
                self._conclude(info, answer)
                return
        if len(views) == MOST:  # perhaps it was moved once more meanwhile
            self._begin(name)

    def _conclude(self, info: RgbdCameraInfo, answer: OwnArmPose) -> None:
        """Enough is seen: a camera that was moved is placed.

        Any other stands where it did, and something else is wrong with its pictures.
        """
        name = info.name
        del self._views[name]
        if name not in self._moved and name not in self._excluded:
            return
        off = self._off(info, answer.T_base_camera)
        covariance = answer.covariance + own_error(self._robot)
        self._placed[name] = replace(
            info, T_mount_camera=answer.T_base_camera, covariance=covariance
        )
        self._words[name] = (
            f"camera {name} saw the arm {1e3 * off:.0f} mm off and was calibrated again by it; "
            "'armsight calibrate --markerless' keeps that"
        )
        self._moved.pop(name, None)
        self._excluded.discard(name)

    def _off(self, info: RgbdCameraInfo, T_base_camera: Pose) -> float:
        """How far another pose of a camera moves what it sees of the arm, root mean square [m]."""
        points = arm_surface(self._robot).posed_points(self._robot.home)[0]
        moved = transform(T_base_camera @ inverse(info.T_mount_camera), points)
        return float(np.sqrt(((moved - points) ** 2).sum(axis=1).mean()))
