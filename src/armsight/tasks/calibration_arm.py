"""The arm's errors that stand in a cell's calibration file, beside what is calibrated after them.

Cameras are written beside an ``[arm]`` that an earlier run has found, and are used with it: so they
are solved with it, or say how far it may put them off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.arm import flange_poses
from armsight.calibration.calibrate import Calibration
from armsight.robots.robot import Robot
from armsight.tasks.calibration_entries import arm_of
from armsight.workcell.beliefs import robot_in
from armsight.workcell.calibration_file.reading import calibrated_robot, read_calibration
from armsight.workcell.calibration_file.schema import (
    CalibratedArm,
    CalibratedCamera,
    CellCalibration,
)
from armsight.workcell.calibration_file.writing import arm_entry
from armsight.workcell.schema import Workcell

POSES = 500
"""Of the arm, over which its correction is judged."""


def arm_in_file(workcell: Workcell) -> CalibratedArm | None:
    """What the cell's calibration file says of the arm, and keeps when cameras are written to it.

    Raises:
        WorkcellError: the file is broken.
    """
    file = workcell.calibration_file
    if file is None or not file.is_file():
        return None
    found = read_calibration(file)
    same = (found.cell.name, found.cell.robot) == (workcell.name, workcell.robot.model)
    return found.arm if same else None


def corrected(robot: Robot, workcell: Workcell) -> Robot:
    """An arm with the errors that the cell's calibration file knows; its tool stays as it is.

    Raises:
        WorkcellError: the file is broken, or of an arm with another number of joints.
    """
    arm = arm_in_file(workcell)
    if arm is None:
        return robot
    cell = {"name": workcell.name, "robot": workcell.robot.model}
    return calibrated_robot(robot, CellCalibration.model_validate({"cell": cell, "arm": arm}))


def arm_found(workcell: Workcell, answer: Calibration, source: str) -> CalibratedArm | None:
    """The arm's errors as a solve with its joints has found them, on top of those in the file.

    None where it has found none: what stands in the file stays.
    """
    new, old = arm_of(answer, source), arm_in_file(workcell)
    if new is None or old is None:
        return new
    offset = np.deg2rad(np.add(new.joint_offset_deg, old.joint_offset_deg))
    return arm_entry(offset, np.add(new.origin_shift, old.origin_shift), source=source)


def with_doubt_of_arm(
    entries: Sequence[CalibratedCamera], workcell: Workcell
) -> tuple[tuple[CalibratedCamera, ...], float]:
    """Cameras that were found by poses alone, beside an arm that the file corrects.

    Nobody says whether the controller's poses know of the correction; if not, the cameras are off
    by as much.

    Returns:
        The entries, less sure by what the correction moves the flange, and that displacement [m].
    """
    if arm_in_file(workcell) is None:
        return tuple(entries), 0.0
    nominal = robot_in(workcell)
    lower, upper = nominal.limits.lower, nominal.limits.upper
    joints = np.random.default_rng(0).uniform(
        np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (POSES, nominal.n)
    )
    step = se3.logs(
        se3.inverses(flange_poses(nominal, joints))
        @ flange_poses(corrected(nominal, workcell), joints)
    )
    variance = np.mean(step**2, axis=0)
    more = np.diag(np.repeat([variance[:3].mean(), variance[3:].mean()], 3))
    off = float(np.sqrt(variance[:3].sum()))
    return tuple(_less_sure(e, more, off) for e in entries), off


def _less_sure(entry: CalibratedCamera, more: Floats, off: float) -> CalibratedCamera:
    covariance = tuple(tuple(float(v) for v in row) for row in entry.C + more)
    target = None if entry.target_error is None else float(np.hypot(entry.target_error, off))
    return entry.model_copy(update={"covariance": covariance, "target_error": target})
