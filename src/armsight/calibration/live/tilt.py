"""Second stage: the board tilted before a camera, which tells where it hangs (T1)."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from armsight.arrays import JointVector
from armsight.calibration import arm, se3
from armsight.calibration.live.log import Log, best_views, go, look, report, rig_counts
from armsight.calibration.live.seen import Request, SeenView
from armsight.calibration.live.setup import board_middle, lens_list
from armsight.geometry.pose import inverse, make_pose


def tilt(log: Log) -> Generator[Request, object, None]:
    """Tilt before a camera: roll, pitch, yaw, which tell where the board hangs.

    All cameras watch; before those that have seen enough by then no tilting of their own is needed.
    """
    lenses = lens_list(log.setup.cameras)
    best = best_views(log)
    # First where most lenses see the board at once.
    for rig, view in sorted(best.items(), key=lambda item: (-len(item[1].found), item[0])):
        if log.views[-1].stage == "tilt" and rig_counts(log)[rig] >= 4:
            continue
        name = log.setup.cameras[rig].name
        for axis, steps in ((0, (0.4, -0.4)), (1, (0.4, -0.4)), (2, (0.5,))):
            for angle in steps:
                for share in (1.0, 0.5):
                    q = tilted(log, view, axis, angle * share)
                    if q is None or not (yield from go(log, q, "tilt")):
                        continue
                    seen = yield from look(log, "tilt")
                    report(log, f"tilting before camera {name}")
                    if any(lenses[k].rig == rig for k, _, _ in seen.found):
                        break


def tilted(log: Log, view: SeenView, axis: int, angle: float) -> JointVector | None:
    """Joint angles that turn the board about one of its axes through its middle."""
    setup = log.setup
    T = arm.flange_poses(setup.robot, view.joints[None])[0]
    middle = setup.T_flange_board @ make_pose(None, board_middle(setup))
    twist = np.zeros((1, 6))
    twist[0, 3 + axis] = angle
    target = T @ middle @ se3.exps(twist)[0] @ inverse(middle)
    q, ok = arm.reach(setup.robot, target[None], view.joints[None])
    return q[0] if ok[0] and np.abs(q[0] - view.joints).max() < 1.5 else None
