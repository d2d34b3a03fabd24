"""What a path costs: its length over the whole body, dearer through dangerous space (T2).

C_traj = integral of (1 + C) along the motion of every sphere of the body, divided by the number of
spheres, in metres: free space costs the mean length that the body travels. T2 sums D + D * C over
voxels and leaves open how the parts of the body are combined; the mean makes the figure independent
of how finely a robot is covered with spheres. Spheres that cannot move count nothing.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import exp1

from armsight.arrays import Floats, JointPath
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.body import Body
from armsight.motion.cost_kernels import Danger, path_cost_kernel
from armsight.motion.kernels import make_scratch
from armsight.motion.obstacles import frozen

ALPHA = 0.2586
"""[1/s] decays an occupied voxel's danger to 0 in 24.48 s at any frame rate (design 5.5)."""
OCCUPIED_DANGER = 0.999
"""Danger of a voxel that is occupied now."""


@lru_cache(maxsize=8)
def danger_table(alpha: float = ALPHA, entries: int = 2048) -> tuple[Floats, float]:
    """Danger at ages 0, step, 2 step ... and the step [s].

    dC/dt = alpha ln C from 0.999: with u = -ln C, E1(u(age)) = E1(u0) - alpha age.
    """
    u0 = -np.log(OCCUPIED_DANGER)
    total = float(exp1(u0))
    # Fine where u is small (the curve is flat there) and where it is large (it falls there).
    u = np.concatenate([np.geomspace(u0, 1.0, 4000), np.linspace(1.0, 40.0, 8000)[1:]])
    age = (total - exp1(u)) / alpha
    step = total / alpha / (entries - 1)
    table = np.interp(np.arange(entries) * step, age, np.exp(-u))
    table[-1] = 0.0
    return table, step


def danger_of(
    snapshot: WorkspaceSnapshot, alpha: float = ALPHA, now: float | None = None
) -> Danger:
    """The danger of a snapshot's voxels at a time [s] (its own stamp unless given)."""
    table, step = danger_table(alpha)
    when = float(snapshot.stamp if now is None else now)
    latest = float(snapshot.last_occupied.max(initial=-np.inf))
    return Danger(
        np.asarray(snapshot.grid.origin, float),
        float(snapshot.grid.voxel),
        frozen(snapshot.last_occupied),
        when,
        table,
        step,
        not latest > when - step * (len(table) - 1),
    )


def path_cost(
    body: Body, path: JointPath, snapshot: WorkspaceSnapshot, alpha: float = ALPHA
) -> float:
    """C_traj of a (k, n) path [m]."""
    path = np.ascontiguousarray(path, np.float64)
    return float(path_cost_kernel(body, danger_of(snapshot, alpha), path, make_scratch(body)))
