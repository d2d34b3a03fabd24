"""What a path costs: its length over the whole body, dearer through dangerous space (T2).

C_traj = integral of (1 + C) along the motion of every sphere of the body, divided by the number of
spheres, in metres: free space costs the mean length that the body travels. T2 sums D + D * C over
voxels and leaves open how the parts of the body are combined; the mean makes the figure independent
of how finely a robot is covered with spheres. Spheres that cannot move count nothing.
"""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointPath
from armsight.mapping.danger import ALPHA, danger_table
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.body import Body
from armsight.motion.cost_kernels import Danger, path_cost_kernel
from armsight.motion.kernels import make_scratch
from armsight.motion.obstacles import frozen


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
