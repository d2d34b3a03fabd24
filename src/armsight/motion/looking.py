"""What a tick begins with: where the arm is and will be, and how far away everybody is."""

from __future__ import annotations

import numpy as np

from armsight.devices.data import JointState
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.faults import Verdict
from armsight.motion.reflex import Approach
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter

STANDING = 0.01
"""Joint speed below which the arm is at rest [rad/s]."""


def look(
    filter_: VelocityFilter,
    now: float,
    elapsed: float,
    verdict: Verdict,
    joints: JointState,
    snapshot: WorkspaceSnapshot | None,
) -> Tick:
    """Where the arm is, where it will be, and how far hazards are from it at rest.

    Args:
        filter_: with the arm's drives and the newest hazards.
        now: time [s]; elapsed: since the last tick [s].
        elapsed: since the last tick [s].
        verdict: on the input.
        joints: that may be used.
        snapshot: as the arm may count with it.
    """
    here = filter_.arm.ahead(joints, now)
    ahead = filter_.arm.ahead(joints, now + filter_.config.start_delay)
    speed = max(np.abs(here.velocity).max(), np.abs(ahead.velocity).max())
    near = filter_.monitor.at_rest(here.position, filter_.hazards)
    still = np.zeros(filter_.robot.n)
    at_rest = bool(speed < STANDING)
    return Tick(now, elapsed, verdict, snapshot, here, ahead, at_rest, near, near, still)


def note_approach(tick: Tick, filter_: VelocityFilter, approach: Approach) -> None:
    """Remember how far the nearest hazard is, if it was seen.

    T2's risk asks for an obstacle's velocity. The border of unseen space has none: it jumps
    when the arm's shadow falls on another place.
    """
    nearest = int(tick.near.nearest[tick.near.closest])
    if nearest < 0 or filter_.unseen(nearest):
        approach.clear()
    else:
        approach.add(tick.now, tick.near.least)
