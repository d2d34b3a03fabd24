"""What perfect cameras see of a made-up world of voxels: free, occupied, or nothing."""

from __future__ import annotations

import math

from numba import njit

from armsight.arrays import Bytes, Floats, Points
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN


@njit(cache=True, nogil=True)
def look(matter: Bytes, origin: Floats, voxel: float, eyes: Points, state: Bytes) -> None:
    """Write into ``state`` (nx, ny, nz) what is seen of ``matter``, 1 where something is.

    A voxel is seen by an eye where nothing stands in the voxels between: it is marched from its
    middle to the eye in steps of half a voxel, as far as the grid goes.

    Args:
        matter: (nx, ny, nz) uint8.
        origin: (3,) lower corner [m].
        voxel: edge [m].
        eyes: (k, 3) places of the cameras, outside the grid [m].
        state: FREE, OCCUPIED or UNKNOWN, written.
    """
    nx, ny, nz = matter.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                seen = False
                for e in range(eyes.shape[0]):
                    x = (eyes[e, 0] - origin[0]) / voxel - (i + 0.5)
                    y = (eyes[e, 1] - origin[1]) / voxel - (j + 0.5)
                    z = (eyes[e, 2] - origin[2]) / voxel - (k + 0.5)
                    far = math.sqrt(x * x + y * y + z * z)
                    dx, dy, dz = 0.5 * x / far, 0.5 * y / far, 0.5 * z / far
                    u, v, w = i + 0.5, j + 0.5, k + 0.5
                    free = True
                    while True:
                        u, v, w = u + dx, v + dy, w + dz
                        a, b, c = math.floor(u), math.floor(v), math.floor(w)
                        if a < 0 or b < 0 or c < 0 or a >= nx or b >= ny or c >= nz:
                            break
                        if (a != i or b != j or c != k) and matter[a, b, c] != 0:
                            free = False
                            break
                    if free:
                        seen = True
                        break
                if not seen:
                    state[i, j, k] = UNKNOWN
                elif matter[i, j, k] != 0:
                    state[i, j, k] = OCCUPIED
                else:
                    state[i, j, k] = FREE
