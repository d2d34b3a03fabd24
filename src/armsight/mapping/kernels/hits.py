"""Voxels that a depth image hit, and how surely.

``depth`` is (h, w) float32 [m], ``label`` (h, w) uint8 as :mod:`.pixels` has it, ``rays`` (h, w, 2)
float32 x/z, y/z of each pixel, ``T`` (4, 4) the camera in base, ``noise`` (3,) a b c of
sigma(z) = a + b z + c z^2 [m].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Shorts
from armsight.mapping.kernels.pixels import ROBOT, trusted
from armsight.mapping.kernels.solids import explained

WITNESSES = 2
"""So many neighbours that no declared solid explains must be of a pixel's depth where something
nearer is beside it. By the three that any pixel needs of all, a ball beside a post lost a voxel."""


@njit(cache=True, nogil=True)
def _voxel_at(
    x: float, y: float, z: float, origin: Floats32, per_meter: np.float32, shape: Ints
) -> int:
    """Flat index of the voxel that holds a point, or -1."""
    a = (x - origin[0]) * per_meter
    b = (y - origin[1]) * per_meter
    c = (z - origin[2]) * per_meter
    if not (a >= 0 and b >= 0 and c >= 0 and a < shape[0] and b < shape[1] and c < shape[2]):
        return -1
    return (int(a) * shape[1] + int(b)) * shape[2] + int(c)


@njit(cache=True, nogil=True)
def _on_declared(
    z: float,
    rx: float,
    ry: float,
    T: Floats32,
    noise: Floats,
    grid: Any,
    far_grid: Any,
    solids: Any,
    tolerance: Any,
) -> bool:
    """Whether a declared solid explains the return of depth ``z`` of a ray; see collect_hits."""
    x = z * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
    y = z * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
    t = z * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
    limit = tolerance[0] + tolerance[1] * z
    limit += tolerance[2] * (noise[0] + z * (noise[1] + z * noise[2]))
    for origin, voxel, shape, nearest, bound in (grid, far_grid):
        index = _voxel_at(x, y, t, origin, np.float32(1.0 / voxel), shape)
        if index >= 0:
            half = 0.8660254 * voxel
            return bool(explained(nearest[index], bound[index], half, limit, solids, x, y, t))
    return False


@njit(cache=True, nogil=True)
def _borders_declared(
    depth: Floats32,
    label: Bytes,
    rays: Floats32,
    v: int,
    u: int,
    like: float,
    T: Floats32,
    noise: Floats,
    grid: Any,
    far_grid: Any,
    solids: Any,
    tolerance: Any,
) -> bool:
    """Whether a pixel may be the border of something nearer, with a declared solid behind in it.

    As before the arm, see :func:`trusted`: where something nearer is beside the pixel, those of
    its neighbours that a declared solid explains bear no witness for it, nor do the arm's.
    """
    h, w = depth.shape
    z = depth[v, u]
    nearer = False
    found = 0
    for y in range(max(v - 1, 0), min(v + 2, h)):
        for x in range(max(u - 1, 0), min(u + 2, w)):
            there = depth[y, x]
            nearer |= there > 0.0 and there < z - like
            found += abs(there - z) <= like and label[y, x] != ROBOT
    if not nearer:
        return False
    for y in range(max(v - 1, 0), min(v + 2, h)):
        for x in range(max(u - 1, 0), min(u + 2, w)):
            there = depth[y, x]
            if found <= WITNESSES:  # the pixel itself was counted
                return True
            if (y == v and x == u) or label[y, x] == ROBOT or not abs(there - z) <= like:
                continue
            rx, ry = rays[y, x, 0], rays[y, x, 1]
            found -= _on_declared(there, rx, ry, T, noise, grid, far_grid, solids, tolerance)
    return bool(found <= WITNESSES)


@njit(cache=True, nogil=True)
def collect_hits(
    depth: Floats32,
    label: Bytes,
    todo: Bytes,
    rays: Floats32,
    T: Floats32,
    noise: Floats,
    grid: Any,
    far_grid: Any,
    solids: Any,
    tolerance: Any,
    support: int,
    enough: float,
    count: Shorts,
    hits: Ints32,
    far_count: Shorts,
    far_hits: Ints32,
) -> tuple[int, int]:
    """Count, per voxel, the pixels that hit it and that nothing declared explains.

    Of the arguments:
        label: of pixels; todo: (h, w) uint8, 1 where one is usable and not yet explained.
        T: float32, as are all sums here: a tenth of a micrometre at arm's length.
        grid, far_grid: (origin float32 (3,), voxel, shape, nearest uint8, bound int8) of the fine
            and the coarse layer; see ``StaticGeometry``. A point counts in the fine layer if it
            lies inside, else in the coarse one.
        solids: (kinds, sizes, T_solid_base, coarse), see ``StaticGeometry.table``.
        tolerance: (m, rad, sigmas): a point is a solid within m + rad x depth + sigmas x sigma of
            its surface, and as much deeper inside as the solid is declared coarsely.
        support: how many neighbours must agree, see :func:`trusted`.
        enough: share x fx fy of :func:`grade_hits` [px^2]: once a voxel has had as many pixels as
            that function asks for, no more of it are looked at.
        count: (voxels,) uint16 scratch, zero on entry; holds the pixel counts afterwards.
        hits: (m,) out: flat indices of the voxels hit.

    Returns:
        Number of voxels hit in the fine and in the coarse layer.
    """
    h, w = depth.shape
    origin, voxel, shape, nearest, bound = grid
    far_origin, far_voxel, far_shape, far_nearest, far_bound = far_grid
    margin, angle, sigmas = tolerance
    inv = np.float32(1.0 / voxel)
    far_inv = np.float32(1.0 / far_voxel)
    slack = 0.8660254 * voxel
    far_slack = 0.8660254 * far_voxel
    area, far_area = enough * voxel * voxel, enough * far_voxel * far_voxel
    r00, r01, r02, tx = T[0, 0], T[0, 1], T[0, 2], T[0, 3]
    r10, r11, r12, ty = T[1, 0], T[1, 1], T[1, 2], T[1, 3]
    r20, r21, r22, tz = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    n = 0
    m = 0
    for v in range(h):
        for u in range(w):
            if todo[v, u] == 0:
                continue
            z = depth[v, u]
            rx = rays[v, u, 0]
            ry = rays[v, u, 1]
            x = z * (r00 * rx + r01 * ry + r02) + tx
            y = z * (r10 * rx + r11 * ry + r12) + ty
            t = z * (r20 * rx + r21 * ry + r22) + tz
            index = _voxel_at(x, y, t, origin, inv, shape)
            fine = index >= 0
            if fine:
                counted, solid, gap, half, most = count, nearest, bound, slack, area
            else:
                index = _voxel_at(x, y, t, far_origin, far_inv, far_shape)
                if index < 0:
                    continue
                counted, solid, gap = far_count, far_nearest, far_bound
                half, most = far_slack, far_area
            if counted[index] >= 2:  # the voxel's centre is no nearer than this
                least = max(z - half - 0.001, 0.05)
                if counted[index] * least * least >= most:
                    continue
            sigma = noise[0] + z * (noise[1] + z * noise[2])
            limit = margin + angle * z + sigmas * sigma
            if explained(solid[index], gap[index], half, limit, solids, x, y, t):
                continue
            like, exact = 0.01 + 0.01 * z + 4.0 * sigma, 0.003 + 5.0 * sigma
            if not trusted(depth, label, v, u, like, exact, support):
                continue
            if _borders_declared(
                depth, label, rays, v, u, like, T, noise, grid, far_grid, solids, tolerance
            ):
                continue
            if counted[index] == 0:
                if fine:
                    if n >= hits.shape[0]:
                        continue
                    hits[n] = index
                    n += 1
                else:
                    if m >= far_hits.shape[0]:
                        continue
                    far_hits[m] = index
                    m += 1
            if counted[index] < 65535:
                counted[index] += 1
    return n, m


@njit(cache=True, nogil=True)
def grade_hits(
    hits: Ints32,
    n: int,
    count: Shorts,
    T: Floats,
    origin: Floats,
    voxel: float,
    shape: Ints,
    focal2: float,
    share: float,
    strong: Bytes,
) -> None:
    """Tell strong sightings (1) from weak ones (0) by pixel count, and clear ``count`` again.

    Of the arguments:
        focal2: fx fy [px^2]: a voxel's face at depth z covers focal2 voxel^2 / z^2 pixels.
        share: strong sightings have at least this share of them, and two pixels or half of them.
        strong: (m,) uint8 out.
    """
    ny, nz = shape[1], shape[2]
    for a in range(n):
        index = hits[a]
        k = index % nz
        j = (index // nz) % ny
        i = index // (nz * ny)
        x = origin[0] + (i + 0.5) * voxel - T[0, 3]
        y = origin[1] + (j + 0.5) * voxel - T[1, 3]
        z = origin[2] + (k + 0.5) * voxel - T[2, 3]
        depth = max(T[0, 2] * x + T[1, 2] * y + T[2, 2] * z, 0.05)
        expected = focal2 * voxel * voxel / (depth * depth)
        need = max(share * expected, min(2.0, 0.5 * expected))
        strong[a] = 1 if count[index] >= need else 0
        count[index] = 0
