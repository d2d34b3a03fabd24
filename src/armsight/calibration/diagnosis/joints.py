"""Joint angles beside poses: whether the arm's model gives the one from the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Poses
from armsight.calibration import arm, se3
from armsight.calibration.findings import Finding
from armsight.calibration.recorded_set import RecordedSet
from armsight.robots.robot import Robot

APART = 0.010
"""Scatter of a tool on its flange that no arm's errors explain [m]."""
TURNED = float(np.deg2rad(1.5))
"""Likewise of its turn [rad]."""


def with_agreeing_joints(
    recorded: RecordedSet, robot: Robot | None
) -> tuple[RecordedSet, list[Finding]]:
    """The set, without joint angles that contradict its poses, and what is to be said of them.

    A solve with joint angles puts the arm's model in place of the poses, so both must mean the same
    base; another tool than the flange does no harm.
    """
    if robot is None or recorded.poses is None:
        return recorded, []
    if recorded.joints is None or recorded.joints.shape[1] != robot.n:
        found = "none" if recorded.joints is None else f"{recorded.joints.shape[1]} a pose"
        return replace(recorded, joints=None), [
            Finding(
                "no_joints",
                "warning",
                f"--robot {robot.name}: the set needs {robot.n} joint angles beside each pose, and "
                f"has {found}: the arm's own errors are not solved",
                "write the joint angles into the table of poses (q1 ... q6), or leave --robot out",
            )
        ]
    T_flange_tool = se3.inverses(arm.flange_poses(robot, recorded.joints)) @ recorded.poses
    place, apart, turned = _constant(T_flange_tool)
    if apart > APART or turned > TURNED:
        return replace(recorded, joints=None), [
            Finding(
                "joints_disagree",
                "warning",
                f"the model of {robot.name} does not give the poses from the joint angles (off by "
                f"{1e3 * apart:.0f} mm and {np.rad2deg(turned):.1f} deg): the poses are taken as "
                "they are, and the arm's own errors are not solved",
                "check --robot, and give poses in the base of its model (the bases of UR's "
                "controllers are turned by 180 deg)",
            )
        ]
    if place < APART:
        return recorded, []
    return recorded, [
        Finding(
            "tool_poses",
            "warning",
            f"the poses are those of a tool {1e3 * place:.0f} mm off the flange, by the joint "
            "angles: the flange's are taken",
            "set the controller's tool to none, or leave the poses out",
        )
    ]


def _constant(T: Poses) -> tuple[float, float, float]:
    """How far off a usual pose is [m], and how far poses usually are from it [m] and [rad]."""
    middle = np.median(T[:, :3, 3], axis=0)
    turns = Rotation.from_matrix(T[:, :3, :3])
    apart = np.median(np.linalg.norm(T[:, :3, 3] - middle, axis=1))
    turned = np.median((turns.mean().inv() * turns).magnitude())
    return float(np.linalg.norm(middle)), float(apart), float(turned)
