"""Calibrating cameras by the arm itself: it patrols, guarded as ever, and the cameras watch it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, JointVector
from armsight.devices.data import RgbdCameraInfo
from armsight.motion.intents import JointIntent
from armsight.motion.perception import CameraUse, PosedFrame
from armsight.motion.task import Observation
from armsight.recognition.own_arm import (
    DepthOptions,
    DepthView,
    OwnArmPose,
    arm_surface,
    register_depth,
    search_depth,
)
from armsight.robots.robot import Robot
from armsight.tasks.patrol import PatrolTask
from armsight.workcell.calibration_file.schema import CalibratedCamera
from armsight.workcell.calibration_file.writing import camera_entry
from armsight.workcell.schema import Workcell

WANTED = 6
"""Views of each camera."""
APART = 0.3
"""Greatest joint difference between two views, at least [rad]."""
SLOW = 0.6
"""A joint that is faster blurs the picture, and a late stamp shows [rad/s]."""
LEAST_SEARCHED = 3
"""Views without which no pose is searched for."""


@dataclass(frozen=True)
class ViewCount:
    """Views so far by camera; ``stamp``: of the newest frame [s]."""

    stamp: float
    views: Mapping[str, int]


class ArmViews:
    """A perceiver that keeps depth views of the arm in different poses, a few a camera.

    Attributes:
        views: by camera.
    """

    name = "own arm"
    period = 0.2

    def __init__(self, cameras: Sequence[str], wanted: int = WANTED) -> None:
        self.cameras = tuple(CameraUse(name) for name in cameras)
        self.views: dict[str, list[DepthView]] = {name: [] for name in cameras}
        self._wanted = wanted

    def reset(self) -> None:
        """Forget all views."""
        for views in self.views.values():
            views.clear()

    @property
    def complete(self) -> bool:
        """Whether every camera has its views."""
        return all(len(v) >= self._wanted for v in self.views.values())

    def update(self, frames: Sequence[PosedFrame]) -> ViewCount | None:
        """Keep what shows the arm as it was not seen before."""
        for posed in frames:
            views, joints = self.views[posed.info.name], posed.joints
            if joints is None or len(views) >= self._wanted:
                continue
            if float(np.abs(joints.velocity).max()) > SLOW:
                continue
            if any(float(np.abs(v.joints - joints.position).max()) < APART for v in views):
                continue
            views.append(DepthView(joints.position.copy(), posed.depth))
        if not frames:
            return None
        counts = {name: len(views) for name, views in self.views.items()}
        return ViewCount(max(f.frame.stamp for f in frames), counts)


class MarkerlessTask:
    """Patrols between goals that lie between the cell's own, while the cameras watch.

    Args:
        goals: of the cell's patrol (n,) [rad].
        cameras: whose poses are wanted.

    Attributes:
        arm_views: what they saw.

    Raises:
        UsageError: fewer than two goals.
    """

    name = "markerless calibration"
    period = 0.02
    latency = 0.0

    def __init__(self, goals: Mapping[str, JointVector], cameras: Sequence[str]) -> None:
        # Short dwells, and stops on the way: views of a slow arm at many joint angles.
        self._patrol = PatrolTask(between(goals), 0.3, 0.6)
        self.subscriptions = self._patrol.subscriptions
        self.arm_views = ArmViews(cameras)
        self.perceivers = (self.arm_views,)

    def reset(self) -> None:
        """Begin anew."""
        self._patrol.reset()

    def update(self, observation: Observation) -> JointIntent | None:
        """The patrol's intent; rest once every camera has its views."""
        return None if self.arm_views.complete else self._patrol.update(observation)


def between(goals: Mapping[str, JointVector], stops: int = 3) -> dict[str, JointVector]:
    """Goals with stops on the straight way from each to the next, ends included."""
    names = list(goals)
    found: dict[str, JointVector] = {}
    for a, b in zip(names, [*names[1:], names[0]]):
        for k in range(stops):
            w = k / stops
            found[a if k == 0 else f"{a}-{b} {k}"] = (1 - w) * goals[a] + w * goals[b]
    return found


def find_camera(
    robot: Robot, info: RgbdCameraInfo, views: Sequence[DepthView], seed: int = 0
) -> OwnArmPose:
    """A fixed camera's pose from its views: from where it is believed, else searched for.

    Raises:
        ValueError: there is no view.
    """
    surface, bias = arm_surface(robot), DepthOptions()
    if info.depth_model is None:
        # Nobody has corrected its depth yet: as it comes out of the box.
        bias = replace(bias, bias=0.02)
    near = register_depth(surface, info.depth, info.noise, views, info.T_mount_camera, bias, seed)
    if near.believed or len(views) < LEAST_SEARCHED:
        return near
    far = search_depth(surface, info.depth, info.noise, views, bias, seed)
    return far if far.believed else near


ARM_ERROR = 0.002
"""What a typical arm is off by itself, which no pixel knows [m]."""


def own_error(robot: Robot) -> Floats:
    """(6, 6) covariance by which an arm's own error moves what is calibrated by it."""
    turn = ARM_ERROR / robot.reach
    return np.diag([ARM_ERROR**2] * 3 + [turn**2] * 3)


def entry_of(
    workcell: Workcell, info: RgbdCameraInfo, robot: Robot, answer: OwnArmPose
) -> CalibratedCamera:
    """The camera's entry in the cell's calibration file; its lenses and depth model stay."""
    section = next(c for c in workcell.camera if c.name == info.name)
    source = f"armsight calibrate --markerless, {answer.frames} views of the arm"
    return camera_entry(
        workcell,
        section,
        answer.T_base_camera,
        answer.covariance + own_error(robot),
        info.depth,
        info.color,
        info.T_depth_color,
        info.depth_model,
        source=source,
        target_error=float(np.hypot(answer.sigma, ARM_ERROR)),
    )
