"""Compiled search for the voxels that a depth image saw through, by an octree of projections.

A voxel is free only if the least depth over all pixels that can see any part of it lies behind its
far side by the noise. Pixels without a return have depth 0: they free nothing. A cube of half edges
e_i about p projects within X +- sum_i |e_i,x - X e_i,z| / (p_z - sum_i |e_i,z|) of its centre's
X = p_x / p_z (exact for the cube's corners).

Arguments that recur: ``least`` (5, h, w) uint16 pooled tables of an image through an ideal lens,
``units`` a metre; ``nearness`` the same of the nearness of squares of CELL of its pixels, by which
cubes are left out that lie behind all; ``lens`` (4,) fx fy cx cy; ``T`` (4, 4) camera in base;
``origin`` (3,) lower corner of the grid [m]; ``voxel`` its edge [m]; ``shape`` (3,) voxels along
each axis; ``near`` the camera's least distance [m]: nothing nearer is judged; ``noise`` (3,) a b c
of sigma(z) = a + b z + c z^2 [m]; ``eye`` what :func:`eye_of` makes of these.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Shorts
from armsight.mapping.kernels.pooling import CELL, FARTHEST, level_of, window_least

TOP = 8
"""Edge of the largest cubes judged, in voxels."""
BLOCK = 4
"""Edge of the blocks whose voxels are judged all together, in voxels."""
NOT_SEEN, TOO_NEAR, SEEN = 0, 1, 2
"""Of a cube: nothing of it can be free; it reaches nearer than is judged; it can be judged."""


@njit(inline="always")
def eye_of(
    lens: Floats,
    T: Floats,
    voxel: float,
    near: float,
    noise: Floats,
    sigmas: float,
    units: float,
    h: int,
    w: int,
) -> Any:
    """All that the projection of a voxel needs: half edges along camera x, y, z, and the rest."""
    half = 0.5 * voxel
    a = (half * T[0, 0], half * T[1, 0], half * T[2, 0])
    b = (half * T[0, 1], half * T[1, 1], half * T[2, 1])
    c = (half * T[0, 2], half * T[1, 2], half * T[2, 2])
    reach = abs(c[0]) + abs(c[1]) + abs(c[2])
    behind = (sigmas * noise[0], sigmas * noise[1], sigmas * noise[2])
    return a, b, c, reach, (lens[0], lens[1], lens[2], lens[3]), behind, (units, near, h, w)


@njit(inline="always")
def view_of_cube(eye: Any, x: float, y: float, z: float, s: int) -> Any:
    """How a cube of s voxels about (x, y, z) in the camera frame [m] looks.

    Returns:
        (what, whole, first and last column, first and last row, the depth behind which the least
        depth must lie, the depth up to which the greatest must not lie if anything inside is to be
        free [units], columns and rows by which it reaches from its centre, scale, tilt); all but
        ``what`` only when that is SEEN.
    """
    a, b, c, reach, lens, behind, limits = eye
    units, near, h, w = limits
    ez = reach * s
    if z + ez <= near:
        return NOT_SEEN, False, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
    if not z - ez > near:
        return TOO_NEAR, False, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
    X = x / z
    Y = y / z
    q = s / (z - ez)
    tilt_u = abs(a[0] - X * c[0]) + abs(a[1] - X * c[1]) + abs(a[2] - X * c[2])
    tilt_v = abs(b[0] - Y * c[0]) + abs(b[1] - Y * c[1]) + abs(b[2] - Y * c[2])
    eu = lens[0] * q * tilt_u
    ev = lens[1] * q * tilt_v
    pu = lens[0] * X + lens[2] + 0.5
    pv = lens[1] * Y + lens[3] + 0.5
    if pu + eu < 0 or pv + ev < 0 or pu - eu >= w or pv - ev >= h:
        return NOT_SEEN, False, 0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0
    u0 = int(max(pu - eu, 0.0))
    u1 = min(int(pu + eu), w - 1)
    v0 = int(max(pv - ev, 0.0))
    v1 = min(int(pv + ev), h - 1)
    whole = pu - eu >= 0 and pv - ev >= 0 and pu + eu < w and pv + ev < h
    far = z + ez
    need = int((far + behind[0] + far * (behind[1] + far * behind[2])) * units)
    # the nearest voxel inside must lie wholly in front of the farthest pixel
    first = int((z - ez + 2.0 * reach) * units)
    return SEEN, whole, u0, u1, v0, v1, need, first, eu, ev, q, tilt_u, tilt_v


@njit(inline="always")
def block_window(eye: Any, seen: Any, s: int) -> Any:
    """Half a window [px] that is large enough for every voxel of a block: (eu, ev, its level).

    None is nearer or more aslant than the block's nearest, most aslant place. The level is that of
    the pooled table four of whose windows make it up, -1 where none does.
    """
    reach, lens = eye[3], eye[4]
    eu, ev, q, tilt_u, tilt_v = seen[8], seen[9], seen[10], seen[11], seen[12]
    q /= s
    eu = lens[0] * q * (tilt_u + eu / lens[0] * reach) + 0.01
    ev = lens[1] * q * (tilt_v + ev / lens[1] * reach) + 0.01
    level = level_of(int(2 * eu) + 1, int(2 * ev) + 1)
    if 2 * max(eu, ev) + 1 < 2 * (1 << level):
        return eu, ev, level
    return eu, ev, -1


@njit(inline="always")
def block_of_voxels(eye: Any, ny: int, nz: int) -> tuple[Floats32, Ints]:
    """Where the voxels of a block lie.

    Returns:
        (3, m) float32 of each voxel's centre from the block's in the camera frame [m], and (m,)
        flat index of each voxel, less the first one's.
    """
    offset, place = np.empty((3, BLOCK**3), np.float32), np.empty(BLOCK**3, np.int64)
    a, b, c = eye[0], eye[1], eye[2]
    for m in range(BLOCK**3):
        i, j, k = m // BLOCK**2, m // BLOCK % BLOCK, m % BLOCK
        fa, fb, fc = 2 * i + 1 - BLOCK, 2 * j + 1 - BLOCK, 2 * k + 1 - BLOCK
        offset[0, m] = fa * a[0] + fb * a[1] + fc * a[2]
        offset[1, m] = fa * b[0] + fb * b[1] + fc * b[2]
        offset[2, m] = fa * c[0] + fb * c[1] + fc * c[2]
        place[m] = (i * ny + j) * nz + k
    return offset, place


@njit(inline="always")
def narrow_eye(eye: Any) -> Any:
    """The lens (shifted by half a pixel), the noise, units and reach in float32 for blocks."""
    lens, behind = eye[4], eye[5]
    lens32 = np.array([lens[0], lens[1], lens[2] + 0.5, lens[3] + 0.5], np.float32)
    noise32 = np.array([behind[0], behind[1], behind[2]], np.float32)
    return lens32, noise32, np.float32(eye[6][0]), np.float32(eye[3])


@njit(cache=True, nogil=True, error_model="numpy")  # a check of divisors would stop the vectoriser
def block_windows(
    side: int,
    units: Any,
    lens: Floats32,
    noise: Floats32,
    offset: Floats32,
    behind: Any,
    center: Floats32,
    reach: Floats32,
    window: Ints32,
) -> None:
    """Windows of the voxels of a block, all of one size.

    Of the arguments:
        side: of the pooled windows, four of which cover a voxel's [px].
        lens: (4,) fx fy cx + 1/2 cy + 1/2; noise: (3,) a b c of the margin behind a voxel.
        offset: see :func:`block_of_voxels`.
        behind: from a voxel's centre to its far side along camera z [m].
        center: (3,) of the block in the camera frame [m]; reach: (2,) half the window [px].
        window: (5, m) out: columns of the left and right, rows of the upper and lower pooled
            windows, and the depth behind which they must lie [units].
    """
    x, y, z = center[0], center[1], center[2]
    eu, ev = reach[0], reach[1]
    # read once: the compiler cannot know that the loop's writes leave these alone
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    n0, n1, n2 = noise[0], noise[1], noise[2]
    ox, oy, oz = offset[0], offset[1], offset[2]
    left, right, top, bottom, need = window[0], window[1], window[2], window[3], window[4]
    last = np.int32(side - 1)
    for m in range(ox.shape[0]):
        deep = z + oz[m]
        inv = np.float32(1.0) / deep
        pu = cx + fx * inv * (x + ox[m])
        pv = cy + fy * inv * (y + oy[m])
        far = deep + behind
        # sums of float32 may lose one depth unit
        need[m] = np.int32((far + n0 + far * (n1 + n2 * far)) * units) + 1
        left[m] = np.int32(pu - eu)
        right[m] = np.int32(pu + eu) - last
        top[m] = np.int32(pv - ev)
        bottom[m] = np.int32(pv + ev) - last


@njit(inline="always")
def first_cube(
    T: Floats, origin: Floats, voxel: float, i: int, j: int, k: int, node: Ints, place: Floats
) -> None:
    """Put a cube of TOP voxels, its first one (i, j, k), on an empty stack."""
    dx = origin[0] + (i + 0.5 * TOP) * voxel - T[0, 3]
    dy = origin[1] + (j + 0.5 * TOP) * voxel - T[1, 3]
    dz = origin[2] + (k + 0.5 * TOP) * voxel - T[2, 3]
    node[0, 0] = i
    node[0, 1] = j
    node[0, 2] = k
    node[0, 3] = TOP
    for d in range(3):
        place[0, d] = T[0, d] * dx + T[1, d] * dy + T[2, d] * dz


@njit(inline="always")
def divide(
    eye: Any, node: Ints, place: Floats, n: int,
    i: int, j: int, k: int, s: int, x: float, y: float, z: float, nx: int, ny: int, nz: int,
) -> int:  # fmt: skip
    """Put the eight halves of a cube on a stack of n, those inside the grid; returns its length."""
    a, b, c = eye[0], eye[1], eye[2]
    s //= 2
    for p in range(2):
        if i + p * s >= nx:
            break
        fa = (2 * p - 1) * s
        for q in range(2):
            if j + q * s >= ny:
                break
            fb = (2 * q - 1) * s
            for r in range(2):
                if k + r * s >= nz:
                    break
                fc = (2 * r - 1) * s
                node[n, 0] = i + p * s
                node[n, 1] = j + q * s
                node[n, 2] = k + r * s
                node[n, 3] = s
                place[n, 0] = x + fa * a[0] + fb * a[1] + fc * a[2]
                place[n, 1] = y + fa * b[0] + fb * b[1] + fc * b[2]
                place[n, 2] = z + fa * c[0] + fb * c[1] + fc * c[2]
                n += 1
    return n


@njit(inline="always")
def _judge_block(pooled: Shorts, window: Ints32, place: Ints, first: int, free: Bytes) -> None:
    """Free the voxels of a block that were seen through; ``first`` is its first flat index."""
    left, right, top, bottom, need = window[0], window[1], window[2], window[3], window[4]
    for m in range(place.shape[0]):
        # unsigned, so that no index needs a look whether it counts from the end
        u0: Any = np.uint32(left[m])
        u1: Any = np.uint32(right[m])
        v0: Any = np.uint32(top[m])
        v1: Any = np.uint32(bottom[m])
        seen = min(min(pooled[v0, u0], pooled[v0, u1]), min(pooled[v1, u0], pooled[v1, u1]))
        if seen > need[m]:
            free[first + place[m]] = 1


@njit(cache=True, nogil=True, error_model="numpy")
def carve(
    least: Shorts,
    nearness: Shorts,
    units: float,
    lens: Floats,
    T: Floats,
    origin: Floats,
    voxel: float,
    shape: Ints,
    near: float,
    noise: Floats,
    sigmas: float,
    free: Bytes,
) -> None:
    """Mark every voxel that the image saw through wholly, ``sigmas`` of noise in front of it.

    Small blocks are not divided: their voxels share a window's size, the largest that any could
    have.

    Of the arguments:
        free: (nx, ny, nz) uint8, zero on entry; set to 1.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    eye = eye_of(lens, T, voxel, near, noise, sigmas, units, least.shape[1], least.shape[2])
    lens32, noise32, units32, behind = narrow_eye(eye)
    offset, place_in = block_of_voxels(eye, ny, nz)
    window = np.empty((5, BLOCK**3), np.int32)
    center, reach = np.empty(3, np.float32), np.empty(2, np.float32)
    flat = free.reshape(-1)
    node = np.empty((64, 4), np.int64)
    place = np.empty((64, 3), np.float64)
    for bi in range(0, nx, TOP):
        for bj in range(0, ny, TOP):
            for bk in range(0, nz, TOP):
                first_cube(T, origin, voxel, bi, bj, bk, node, place)
                n = 1
                while n > 0:
                    n -= 1
                    i, j, k, s = node[n, 0], node[n, 1], node[n, 2], node[n, 3]
                    x, y, z = place[n, 0], place[n, 1], place[n, 2]
                    seen = view_of_cube(eye, x, y, z, s)
                    if seen[0] == NOT_SEEN:
                        continue
                    if seen[0] == SEEN:
                        whole, u0, u1, v0, v1 = seen[1], seen[2], seen[3], seen[4], seen[5]
                        if whole and window_least(least, u0, u1, v0, v1) > seen[6]:
                            for p in range(i, min(i + s, nx)):
                                for q in range(j, min(j + s, ny)):
                                    for r in range(k, min(k + s, nz)):
                                        free[p, q, r] = 1
                            continue
                        if s == 1:
                            continue
                        near_of = window_least(
                            nearness, u0 // CELL, u1 // CELL, v0 // CELL, v1 // CELL
                        )
                        if near_of >= FARTHEST - seen[7]:
                            continue
                        if s == BLOCK and whole and i + s <= nx and j + s <= ny and k + s <= nz:
                            eu, ev, level = block_window(eye, seen, s)
                            if level >= 0:
                                center[0], center[1], center[2] = x, y, z
                                reach[0], reach[1] = eu, ev
                                block_windows(
                                    1 << level, units32, lens32, noise32, offset, behind, center,
                                    reach, window,
                                )  # fmt: skip
                                first = (i * ny + j) * nz + k
                                _judge_block(least[level], window, place_in, first, flat)
                                continue
                    elif s == 1:
                        continue
                    n = divide(eye, node, place, n, i, j, k, s, x, y, z, nx, ny, nz)
