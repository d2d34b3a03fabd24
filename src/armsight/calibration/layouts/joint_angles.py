"""Joint angles instead of poses: with the arm's model they are poses like any others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import arm
from armsight.calibration.layouts.table import PoseTable
from armsight.robots.robot import Robot

LARGEST = 2.2 * np.pi
"""No joint turns farther from its zero [rad]."""


def joint_tables(tables: Sequence[PoseTable], robot: Robot) -> list[PoseTable]:
    """Tables whose numbers may be a robot's joint angles, as poses of its flange.

    Args:
        tables: as the files give them.
        robot: the arm.
    """
    out = []
    for table in map(in_radians, tables):
        for joints, unit in _angles(table, robot.n):
            T = arm.flange_poses(robot, joints)
            source = f"{table.source} (joint angles of {robot.name}, {unit})"
            out.append(
                replace(
                    table,
                    source=source,
                    values=T.reshape(len(T), 16),
                    names=None,
                    length=1.0,
                    angle=None,
                    rotation=None,
                    joints=joints,
                    decimals=99,
                )
            )
    return out


def in_radians(table: PoseTable) -> PoseTable:
    """The same with joint angles that can only be degrees as radians: few files name the unit."""
    if table.joints is None or np.abs(table.joints).max(initial=0.0) <= LARGEST:
        return table
    return replace(table, joints=np.deg2rad(table.joints))


def _angles(table: PoseTable, dof: int) -> list[tuple[Floats, str]]:
    """What of a table may be joint angles [rad], and the unit in which they are written."""
    if table.joints is not None:
        return [(table.joints, "as named")] if table.joints.shape[1] == dof else []
    if table.names is not None or table.values.shape[1] < dof:
        return []
    value = table.values[:, -dof:]
    out = []
    if np.abs(value).max(initial=0.0) <= LARGEST:
        out.append((value, "radians"))
    elif np.abs(value).max(initial=0.0) <= np.rad2deg(LARGEST):
        out.append((np.deg2rad(value), "degrees"))
    return out


def may_be_joints(table: PoseTable) -> bool:
    """Whether a table looks like joint angles: six or seven numbers, none of them a length."""
    if table.joints is not None and not table.values.shape[1]:
        return True
    if table.names is not None or table.values.shape[1] not in (6, 7):
        return False
    spread = np.ptp(table.values, axis=0)
    return bool(np.abs(table.values).max(initial=0.0) <= LARGEST and spread.max(initial=0.0) > 0.2)
