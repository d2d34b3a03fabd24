"""Compiled inner loops from a depth image to evidence about voxels.

All release the interpreter's lock, so cameras can be worked on in parallel; none keeps state.

Arguments that recur: ``depth`` (h, w) float32 [m]; ``label`` (h, w) uint8, see below; ``rays``
(h, w, 2) float32 x/z, y/z of each pixel; ``T`` (4, 4) camera in base; ``origin`` (3,) lower corner
of a grid [m]; ``voxel`` its edge [m]; ``shape`` (3,) voxels along each axis; ``noise`` (3,) a b c
of sigma(z) = a + b z + c z^2 [m]; ``units`` depth units a metre of the uint16 tables.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Pose, Poses, Shorts

NOTHING, VALID, ROBOT = 0, 1, 2
"""Labels of pixels: no usable return, something, the arm itself."""

LEVELS = 5
"""Pooling windows of 1, 2, 4, 8, 16 pixels."""


@njit(cache=True, nogil=True)
def label_valid(depth: Floats32, near: float, far: float, label: Bytes) -> int:
    """Mark the pixels with a usable return; returns how many there are."""
    d = depth.reshape(-1)
    out = label.reshape(-1)
    lo, hi = np.float32(near), np.float32(far)
    count = 0
    for p in range(d.shape[0]):
        ok = (d[p] >= lo) & (d[p] <= hi)  # false for NaN and infinities
        out[p] = np.uint8(ok)
        count += ok
    return count


@njit(cache=True, nogil=True)
def trusted(
    depth: Floats32, label: Bytes, v: int, u: int, like: float, exact: float, need: int
) -> bool:
    """Whether a pixel shows a surface and not the mixture of two.

    At the border of something near, a pixel may see both it and what is behind, and report a depth
    in between where nothing is ("flying" pixels). A pixel is not trusted if

    * fewer than ``need`` of its 8 neighbours lie within ``like`` [m] of its depth, or
    * one neighbour is nearer and another farther than that, or
    * the arm is seen beside it, nearer than it, unless the two pixels on the other side continue to
      its depth within ``exact`` [m]: then it is the same surface, or a mixture that is wrong by no
      more than that, or
    * the arm is seen two pixels away, nearer than it, and the pixel between is not of a like depth.
    """
    h, w = depth.shape
    z = depth[v, u]
    found = 0
    nearer = False
    farther = False
    for y in range(max(v - 1, 0), min(v + 2, h)):
        for x in range(max(u - 1, 0), min(u + 2, w)):
            d = depth[y, x] - z
            if abs(d) <= like:  # false for NaN
                found += 1
            elif d > like:
                farther = True
            elif d < -like:
                nearer = True
    if found <= need or (nearer and farther):  # the pixel itself was counted
        return False
    for y in range(max(v - 2, 0), min(v + 3, h)):
        for x in range(max(u - 2, 0), min(u + 3, w)):
            if label[y, x] != ROBOT or depth[y, x] >= z:
                continue
            dy, dx = min(max(y - v, -1), 1), min(max(x - u, -1), 1)
            if abs(y - v) == 2 or abs(x - u) == 2:
                between, d = label[v + dy, u + dx], depth[v + dy, u + dx]
                if between == ROBOT and d < z:
                    continue  # that one is judged itself
                if between != VALID or not abs(d - z) <= like:
                    return False
                continue
            b, a = v - 2 * dy, u - 2 * dx
            if not (0 <= b < h and 0 <= a < w):
                return False
            if label[b, a] != VALID or label[v - dy, u - dx] != VALID:
                return False
            if not abs(2.0 * depth[v - dy, u - dx] - depth[b, a] - z) <= exact:
                return False
    return True


@njit(cache=True, nogil=True)
def solid_distance(
    kind: int, size: Floats, T_solid_base: Pose, x: float, y: float, z: float
) -> float:
    """Signed distance [m] of a point in base to a solid (0 box, 1 cylinder, 2 sphere)."""
    px = T_solid_base[0, 0] * x + T_solid_base[0, 1] * y + T_solid_base[0, 2] * z
    py = T_solid_base[1, 0] * x + T_solid_base[1, 1] * y + T_solid_base[1, 2] * z
    pz = T_solid_base[2, 0] * x + T_solid_base[2, 1] * y + T_solid_base[2, 2] * z
    px += T_solid_base[0, 3]
    py += T_solid_base[1, 3]
    pz += T_solid_base[2, 3]
    return _outside(kind, size[0], size[1], size[2], px, py, pz)


@njit(cache=True, nogil=True)
def _outside(
    kind: int, a_size: float, b_size: float, c_size: float, x: float, y: float, z: float
) -> float:
    """Signed distance [m] of a point to a solid in the solid's frame."""
    if kind == 2:
        return np.sqrt(x * x + y * y + z * z) - a_size
    if kind == 0:
        a = abs(x) - 0.5 * a_size
        b = abs(y) - 0.5 * b_size
        c = abs(z) - 0.5 * c_size
    else:
        a = np.sqrt(x * x + y * y) - a_size
        b = abs(z) - 0.5 * b_size
        c = -1e9
    oa, ob, oc = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return np.sqrt(oa * oa + ob * ob + oc * oc) + min(max(a, max(b, c)), 0.0)


@njit(cache=True, nogil=True)
def explained(
    nearest: int,
    bound: int,
    slack: float,
    limit: float,
    kinds: Ints,
    sizes: Floats,
    T_solid_base: Poses,
    x: float,
    y: float,
    z: float,
) -> bool:
    """Whether a point lies within ``limit`` [m] of the declared solid nearest to its voxel.

    ``bound`` is the signed distance [mm] from the voxel's centre to that solid, ``slack`` half the
    voxel's diagonal [m]: most points are settled by them alone.
    """
    if nearest == 0:
        return False
    d = 0.001 * bound
    if d + slack + 0.001 <= limit:
        return True
    if d - slack - 0.001 > limit:
        return False
    return (
        solid_distance(kinds[nearest - 1], sizes[nearest - 1], T_solid_base[nearest - 1], x, y, z)
        <= limit
    )


@njit(cache=True, nogil=True)
def trace_solids(
    rays: Floats32,
    T: Floats,
    noise: Floats,
    near: float,
    far: float,
    lower: Floats,
    upper: Floats,
    solids: Any,
    tolerance: Any,
    first: Floats32,
    last: Floats32,
) -> None:
    """For each pixel the depths at which its return needs no further look.

    That is, where the first declared solid behind it explains the return, and behind the mapped
    box. A solid's distance along a ray is convex in depth and the tolerance only grows with depth,
    so with the tolerance at the near end all depths in between are explained too.

    Of the arguments:
        near, far: depths looked at [m]; lower, upper: (3,) corners of the mapped box [m].
        solids, tolerance: as in :func:`collect_hits`.
        first, last: (h, w) float32 out [m]; first > last where every depth needs a look.
    """
    h, w = first.shape
    kinds, sizes, T_solid_base = solids
    count = kinds.shape[0]
    margin, angle, sigmas = tolerance
    eye = np.empty((count, 3))  # the camera in each solid's frame [m]
    turn = np.empty((count, 3, 3))  # and how rays of the camera run there
    for s in range(count):
        for a in range(3):
            eye[s, a] = T_solid_base[s, a, 3]
            for b in range(3):
                eye[s, a] += T_solid_base[s, a, b] * T[b, 3]
                turn[s, a, b] = 0.0
                for c in range(3):
                    turn[s, a, b] += T_solid_base[s, a, c] * T[c, b]
    for v in range(h):
        for u in range(w):
            leaves = far  # depth behind which the ray is outside the box for good
            rx, ry = rays[v, u, 0], rays[v, u, 1]
            for d in range(3):
                step = T[d, 0] * rx + T[d, 1] * ry + T[d, 2]
                if step > 1e-9:
                    leaves = min(leaves, (upper[d] - T[d, 3]) / step)
                elif step < -1e-9:
                    leaves = min(leaves, (lower[d] - T[d, 3]) / step)
                elif not lower[d] <= T[d, 3] <= upper[d]:
                    leaves = near
            first[v, u], last[v, u] = leaves, np.inf
            z, hit = leaves, -1
            hx, hy, hz = 0.0, 0.0, 0.0
            for s in range(count):
                dx = turn[s, 0, 0] * rx + turn[s, 0, 1] * ry + turn[s, 0, 2]
                dy = turn[s, 1, 0] * rx + turn[s, 1, 1] * ry + turn[s, 1, 2]
                dz = turn[s, 2, 0] * rx + turn[s, 2, 1] * ry + turn[s, 2, 2]
                x, y, height = eye[s, 0], eye[s, 1], eye[s, 2]
                enters, ends = near, z
                if kinds[s] == 0:
                    enters, ends = _slab(x, dx, 0.5 * sizes[s, 0], enters, ends)
                    enters, ends = _slab(y, dy, 0.5 * sizes[s, 1], enters, ends)
                    enters, ends = _slab(height, dz, 0.5 * sizes[s, 2], enters, ends)
                elif kinds[s] == 1:
                    enters, ends = _slab(height, dz, 0.5 * sizes[s, 1], enters, ends)
                    b, c = x * dx + y * dy, x * x + y * y - sizes[s, 0] * sizes[s, 0]
                    enters, ends = _ball(dx * dx + dy * dy, b, c, enters, ends)
                else:
                    b = x * dx + y * dy + height * dz
                    c = x * x + y * y + height * height - sizes[s, 0] * sizes[s, 0]
                    enters, ends = _ball(dx * dx + dy * dy + dz * dz, b, c, enters, ends)
                if enters < ends:
                    z, hit = enters, s
                    hx, hy, hz = dx, dy, dz
            if hit < 0:
                continue
            low = max(near, z - 0.5)
            limit = margin + angle * low + sigmas * (noise[0] + low * (noise[1] + low * noise[2]))
            if limit < 0.002:
                continue
            x, y, height = eye[hit, 0], eye[hit, 1], eye[hit, 2]
            inside, outside = z, low
            for end in range(2):  # the depth farthest from the hit where the limit still holds
                for _ in range(10):
                    m = 0.5 * (inside + outside)
                    px, py, pz = x + m * hx, y + m * hy, height + m * hz
                    at = _outside(
                        kinds[hit], sizes[hit, 0], sizes[hit, 1], sizes[hit, 2], px, py, pz
                    )
                    if at <= limit:
                        inside = m
                    else:
                        outside = m
                if end == 0:
                    first[v, u] = inside
                    inside, outside = z, z + 0.5
            if inside < leaves:
                last[v, u] = inside


@njit(cache=True, nogil=True)
def _slab(at: float, step: float, half: float, enters: float, ends: float) -> tuple[float, float]:
    """What of the depths from ``enters`` to ``ends`` lies between two planes at +-half."""
    if abs(step) < 1e-12:
        return (enters, ends) if abs(at) <= half else (np.inf, -np.inf)
    a, b = (-half - at) / step, (half - at) / step
    return max(enters, min(a, b)), min(ends, max(a, b))


@njit(cache=True, nogil=True)
def _ball(a: float, b: float, c: float, enters: float, ends: float) -> tuple[float, float]:
    """What of the depths from ``enters`` to ``ends`` has ``a z^2 + 2 b z + c <= 0``."""
    if a < 1e-12:
        return (enters, ends) if c <= 0.0 else (np.inf, -np.inf)
    root = b * b - a * c
    if root < 0.0:
        return np.inf, -np.inf
    root = np.sqrt(root)
    return max(enters, (-b - root) / a), min(ends, (-b + root) / a)


@njit(cache=True, nogil=True)
def unexplained(
    depth: Floats32, label: Bytes, first: Floats32, last: Floats32, todo: Bytes
) -> None:
    """Mark the usable pixels whose depth is not between first and last of :func:`trace_solids`."""
    d, seen, out = depth.reshape(-1), label.reshape(-1), todo.reshape(-1)
    a, b = first.reshape(-1), last.reshape(-1)
    for p in range(d.shape[0]):
        out[p] = np.uint8((seen[p] == VALID) & ~((d[p] >= a[p]) & (d[p] <= b[p])))


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
        solids: (kinds, sizes, T_solid_base).
        tolerance: (m, rad, sigmas): a point is a solid within m + rad x depth + sigmas x sigma.
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
    kinds, sizes, T_solid_base = solids
    margin, angle, sigmas = tolerance
    inv = np.float32(1.0 / voxel)
    far_inv = np.float32(1.0 / far_voxel)
    slack = 0.8660254 * voxel
    far_slack = 0.8660254 * far_voxel
    area, far_area = enough * voxel * voxel, enough * far_voxel * far_voxel
    nx, ny, nz = shape[0], shape[1], shape[2]
    mx, my, mz = far_shape[0], far_shape[1], far_shape[2]
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
            a = (x - origin[0]) * inv
            b = (y - origin[1]) * inv
            c = (t - origin[2]) * inv
            sigma = noise[0] + z * (noise[1] + z * noise[2])
            limit = margin + angle * z + sigmas * sigma
            if a >= 0 and b >= 0 and c >= 0 and a < nx and b < ny and c < nz:
                index = (int(a) * ny + int(b)) * nz + int(c)
                if count[index] >= 2:  # the voxel's centre is no nearer than this
                    least = max(z - slack - 0.001, 0.05)
                    if count[index] * least * least >= area:
                        continue
                if explained(
                    nearest[index],
                    bound[index],
                    slack,
                    limit,
                    kinds,
                    sizes,
                    T_solid_base,
                    x,
                    y,
                    t,
                ):
                    continue
                like, exact = 0.01 + 0.01 * z + 4.0 * sigma, 0.003 + 5.0 * sigma
                if not trusted(depth, label, v, u, like, exact, support):
                    continue
                if count[index] == 0:
                    if n >= hits.shape[0]:
                        continue
                    hits[n] = index
                    n += 1
                if count[index] < 65535:
                    count[index] += 1
            else:
                a = (x - far_origin[0]) * far_inv
                b = (y - far_origin[1]) * far_inv
                c = (t - far_origin[2]) * far_inv
                if not (a >= 0 and b >= 0 and c >= 0 and a < mx and b < my and c < mz):
                    continue
                index = (int(a) * my + int(b)) * mz + int(c)
                if far_count[index] >= 2:  # the voxel's centre is no nearer than this
                    least = max(z - far_slack - 0.001, 0.05)
                    if far_count[index] * least * least >= far_area:
                        continue
                if explained(
                    far_nearest[index],
                    far_bound[index],
                    far_slack,
                    limit,
                    kinds,
                    sizes,
                    T_solid_base,
                    x,
                    y,
                    t,
                ):
                    continue
                like, exact = 0.01 + 0.01 * z + 4.0 * sigma, 0.003 + 5.0 * sigma
                if not trusted(depth, label, v, u, like, exact, support):
                    continue
                if far_count[index] == 0:
                    if m >= far_hits.shape[0]:
                        continue
                    far_hits[m] = index
                    m += 1
                if far_count[index] < 65535:
                    far_count[index] += 1
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


@njit(cache=True, nogil=True)
def to_units(depth: Floats32, label: Bytes, units: float, out: Shorts) -> None:
    """Depth as uint16, rounded down; 0 where there is no usable return."""
    d = depth.reshape(-1)
    seen = label.reshape(-1)
    o = out.reshape(-1)
    scale = np.float32(units)
    for p in range(d.shape[0]):
        z = d[p] if seen[p] != 0 else np.float32(0.0)
        o[p] = np.uint16(np.int32(z * scale))


@njit(cache=True, nogil=True)
def _least(a: Shorts, b: Shorts, out: Shorts) -> None:
    for u in range(out.shape[0]):
        out[u] = np.uint16(min(a[u], b[u]))


@njit(cache=True, nogil=True)
def _most(a: Shorts, b: Shorts, out: Shorts) -> None:
    for u in range(out.shape[0]):
        out[u] = np.uint16(max(a[u], b[u]))


@njit(cache=True, nogil=True)
def pool(below: Shorts, step: int, least: bool, row: Shorts, out: Shorts) -> None:
    """Minimum (or maximum) of the windows at (v, u), (v + step, u), (v, u + step) and both.

    Windows are cut at the image's edges. ``row`` (w,) is scratch.
    """
    h, w = below.shape
    for v in range(h):
        other = below[min(v + step, h - 1)]
        if least:
            _least(below[v], other, row)
            _least(row[: w - step], row[step:], out[v, : w - step])
        else:
            _most(below[v], other, row)
            _most(row[: w - step], row[step:], out[v, : w - step])
        out[v, w - step :] = row[w - step :]


@njit(cache=True, nogil=True)
def gather(windows: Shorts, index: Ints32, out: Shorts) -> None:
    """Out = windows[index], 0 where the index is negative: an image seen through an ideal lens."""
    src = windows.reshape(-1)
    at = index.reshape(-1)
    o = out.reshape(-1)
    for p in range(at.shape[0]):
        i = at[p]
        o[p] = src[i] if i >= 0 else np.uint16(0)


@njit(cache=True, nogil=True)
def build_tables(least: Shorts, most: Shorts, row: Shorts) -> None:
    """Fill levels 1.. of (5, h, w) pooled tables from level 0; windows as in :func:`pool`."""
    for k in range(1, LEVELS):
        pool(least[k - 1], 1 << (k - 1), True, row, least[k])
        pool(most[k - 1], 1 << (k - 1), False, row, most[k])


@njit(inline="always")
def level_of(width: int, height: int) -> int:
    """The pooled table whose windows are the largest that fit into a rectangle of pixels."""
    short = min(width, height)
    k = 0
    if short >= 16:
        k = 4
    elif short >= 8:
        k = 3
    elif short >= 4:
        k = 2
    elif short >= 2:
        k = 1
    return k


@njit(inline="always")
def window_least(table: Shorts, u0: int, u1: int, v0: int, v1: int) -> int:
    """Minimum over an inclusive pixel rectangle inside the image, from pooled tables."""
    k = level_of(u1 - u0 + 1, v1 - v0 + 1)
    s = 1 << k
    pooled = table[k]
    best = pooled[v0, u0]
    v = v0
    while True:
        u = u0
        while True:
            d = pooled[v, u]
            if d < best:  # not min(): it would widen the type
                best = d
            if u + s > u1:
                break
            u = min(u + s, u1 - s + 1)
        if v + s > v1:
            break
        v = min(v + s, v1 - s + 1)
    return int(best)


@njit(inline="always")
def window_most(table: Shorts, u0: int, u1: int, v0: int, v1: int) -> int:
    """Maximum over an inclusive pixel rectangle inside the image, from pooled tables."""
    k = level_of(u1 - u0 + 1, v1 - v0 + 1)
    s = 1 << k
    pooled = table[k]
    best = pooled[v0, u0]
    v = v0
    while True:
        u = u0
        while True:
            d = pooled[v, u]
            if d > best:
                best = d
            if u + s > u1:
                break
            u = min(u + s, u1 - s + 1)
        if v + s > v1:
            break
        v = min(v + s, v1 - s + 1)
    return int(best)
