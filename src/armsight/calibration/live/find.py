"""First stage: the board in front of the arm, facing out, and the base turned (T1)."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration import arm
from armsight.calibration.live.log import Log, go, look, report, rig_counts
from armsight.calibration.live.seen import Request
from armsight.calibration.live.setup import Setup, board_middle
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse, make_pose


def find_boards(log: Log) -> Generator[Request, object, None]:
    """Turn the base; all cameras watch (T1's first stage)."""
    setup = log.setup
    q0 = _facing_out(setup)
    low = max(setup.robot.limits.lower[0], -np.pi)
    high = min(setup.robot.limits.upper[0], np.pi)
    angles = np.arange(low + 0.05, high, log.options.sweep_step)
    # From the end that is nearer.
    start = log.at if log.at is not None else setup.robot.home
    if abs(angles[-1] - start[0]) < abs(angles[0] - start[0]):
        angles = angles[::-1]
    # First into the L before the arm, then round: so that the way is a plain turn of the base.
    yield from go(log, q0, "find")
    behind = 0
    for a in angles:
        q = q0.copy()
        q[0] = a
        if all(c >= 2 for c in rig_counts(log)) and behind >= 2:
            break  # every camera has seen it, and the board has turned away from all of them
        before = len(log.views)
        if (yield from go(log, q, "find")):
            yield from look(log, "find", rest=0.1, frames=1)
            behind = 0 if len(log.views) > before else behind + 1
            report(log, f"looking for the board, base at {np.rad2deg(a):.0f} deg")
    if not any(v.found for v in log.views):
        reasons = sorted(log.reasons)
        raise CalibrationError(
            "no camera saw the board while the base turned: check the board's kind and size"
            + (f" ({', '.join(reasons[:3])})" if reasons else "")
            + ", the light, and that cameras look at the arm"
        )


def _facing_out(setup: Setup) -> JointVector:
    """The upside-down L: the board in front of the arm at half reach, facing away from it."""
    robot = setup.robot
    rng = np.random.default_rng(0)
    best: tuple[float, JointVector] | None = None
    places = [(h, o) for h in (0.55, 0.45, 0.65, 0.35) for o in (0.5, 0.6, 0.4)]
    for height, out in places:
        T = np.eye(4)
        # Board: z away from the viewer, that is towards the base; y down.
        T[:3, :3] = np.column_stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
        T[:3, 3] = [out * robot.reach + 0.1, 0.0, height * robot.reach]
        flange = T @ inverse(setup.T_flange_board @ make_pose(None, board_middle(setup)))
        q, ok = arm.reach_some(robot, np.repeat(flange[None], 6, axis=0), rng, 3)
        for x in q[ok]:
            if setup.free is not None and not setup.free(x):
                continue
            far = float(np.abs(x - robot.home).sum())
            if setup.path is not None and not setup.path(robot.home, x):
                far += 100.0  # only if nothing can be reached straight
            if best is None or far < best[0]:
                best = (far, x)
        if best is not None and best[0] < 100.0:
            return best[1]
    if best is not None:
        return best[1]
    raise CalibrationError(
        "calibration: the arm cannot hold the board in front of itself; check the tool, the "
        "board's place on the flange and the solids about the arm"
    )
