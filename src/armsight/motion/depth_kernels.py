"""How deep spheres are in what is solid, for those whose centres are in it."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Points
from armsight.motion.kernels import Obstacles, is_solid, may_touch


@njit(cache=True, nogil=True)
def sink(ob: Obstacles, centers: Points, limit: float, out: Floats) -> None:
    """Take from (m,) clearances [m] how deep the centres (m, 3) lie in solid cubes, to a limit [m].

    A clearance ends at a centre: all that is deeper touches as much, and a way through to the other
    side would be no worse than the way back.
    """
    shape = ob.state.shape
    cell, low, high = np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64)
    for i in range(out.shape[0]):
        touching = may_touch(ob, i)
        inside = True
        for a in range(3):
            cell[a] = (centers[i, a] - ob.origin[a]) / ob.voxel
            inside = inside and 0.0 <= cell[a] < shape[a]
            low[a] = max(int(np.floor(cell[a] - limit / ob.voxel)), 0)
            high[a] = min(int(np.floor(cell[a] + limit / ob.voxel)) + 1, shape[a])
        if not inside or not is_solid(ob, int(cell[0]), int(cell[1]), int(cell[2]), touching):
            continue
        best = (limit / ob.voxel) ** 2
        for x in range(low[0], high[0]):
            dx = max(x - cell[0], cell[0] - x - 1.0, 0.0)
            for y in range(low[1], high[1]):
                dy = max(y - cell[1], cell[1] - y - 1.0, 0.0)
                for z in range(low[2], high[2]):
                    dz = max(z - cell[2], cell[2] - z - 1.0, 0.0)
                    away = dx * dx + dy * dy + dz * dz
                    if away < best and not is_solid(ob, x, y, z, touching):
                        best = away
        out[i] -= np.sqrt(best) * ob.voxel
