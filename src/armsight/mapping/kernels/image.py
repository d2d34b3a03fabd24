"""Compiled inner loops from a depth image to evidence about voxels.

Each has a plain-numpy twin in ``tests/mapping/twins.py``. All release the interpreter's lock, so
cameras can be worked on in parallel; none keeps state.

Shared arguments: ``depth`` (h, w) float32 [m]; ``rays`` (h, w, 2) float32 x/z, y/z of each pixel;
``T`` (4, 4) camera in base; ``lens`` (11,) fx fy cx cy k1 k2 p1 p2 k3 and
the greatest |x/z|, |y/z| that the image holds; ``origin`` (3,) lower corner
of the grid [m]; ``voxel`` edge [m]; ``noise`` (3,) a b c of sigma(z) = a + b z + c z^2 [m].
"""

from __future__ import annotations

import numpy as np
from numba import njit

NOTHING, VALID, ROBOT = 0, 1, 2
"""Labels of pixels: no usable return, something, the arm itself."""

LEVELS = 5
"""Min-pooling windows of 1, 2, 4, 8, 16 pixels."""

TILE = 8
"""Edge of the tiles of the maximum image [px]."""


@njit(cache=True, nogil=True)
def label_valid(depth, near, far, label):
    """Mark the pixels with a usable return; returns how many there are."""
    h, w = depth.shape
    count = 0
    for v in range(h):
        for u in range(w):
            z = depth[v, u]
            ok = z >= near and z <= far  # false for NaN and infinities
            label[v, u] = VALID if ok else NOTHING
            count += ok
    return count


@njit(cache=True, nogil=True)
def supported(depth, v, u, tolerance, need):
    """Whether ``need`` of the 8 neighbours lie within ``tolerance`` [m] of a pixel's depth."""
    h, w = depth.shape
    z = depth[v, u]
    found = 0
    for dv in range(-1, 2):
        y = v + dv
        if y < 0 or y >= h:
            continue
        for du in range(-1, 2):
            x = u + du
            if (dv == 0 and du == 0) or x < 0 or x >= w:
                continue
            if abs(depth[y, x] - z) <= tolerance:
                found += 1
                if found >= need:
                    return True
    return need <= 0


@njit(cache=True, nogil=True)
def solid_distance(kind, size, T_solid_base, x, y, z):
    """Signed distance [m] of a point in base to a solid (0 box, 1 cylinder, 2 sphere)."""
    px = T_solid_base[0, 0] * x + T_solid_base[0, 1] * y + T_solid_base[0, 2] * z
    py = T_solid_base[1, 0] * x + T_solid_base[1, 1] * y + T_solid_base[1, 2] * z
    pz = T_solid_base[2, 0] * x + T_solid_base[2, 1] * y + T_solid_base[2, 2] * z
    px += T_solid_base[0, 3]
    py += T_solid_base[1, 3]
    pz += T_solid_base[2, 3]
    if kind == 2:
        return np.sqrt(px * px + py * py + pz * pz) - size[0]
    if kind == 0:
        a = abs(px) - 0.5 * size[0]
        b = abs(py) - 0.5 * size[1]
        c = abs(pz) - 0.5 * size[2]
    else:
        a = np.sqrt(px * px + py * py) - size[0]
        b = abs(pz) - 0.5 * size[1]
        c = -1e9
    outside = np.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
    return outside + min(max(a, max(b, c)), 0.0)


@njit(cache=True, nogil=True)
def collect_hits(
    depth,
    label,
    rays,
    T,
    origin,
    voxel,
    shape,
    noise,
    near_solid,
    kinds,
    sizes,
    T_solid_base,
    margin,
    angle,
    sigmas,
    support,
    count,
    hits,
):
    """Count, per voxel, the pixels that hit it and that nothing declared explains.

    Of the arguments:
        label: which pixels are usable (``VALID``).
        shape: (3,) voxels along each axis.
        near_solid: (nx ny nz) uint8, 0 where no declared solid is close, else 1 + the index of the
            closest one.
        kinds, sizes, T_solid_base: the solids.
        margin, angle, sigmas: a point is the solid within margin [m] + angle [rad] x depth +
            sigmas x sigma(depth).
        support: see :func:`supported`.
        count: (nx ny nz) uint16 scratch, zero on entry and on exit.
        hits: (m,) int32 out: flat indices of the voxels hit.

    Returns:
        Number of voxels hit. Their pixel counts are left in ``count`` at these indices.
    """
    h, w = depth.shape
    ny, nz = shape[1], shape[2]
    inv = 1.0 / voxel
    n = 0
    for v in range(h):
        for u in range(w):
            if label[v, u] != VALID:
                continue
            z = depth[v, u]
            rx = rays[v, u, 0]
            ry = rays[v, u, 1]
            x = z * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]
            y = z * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]
            t = z * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
            i = int(np.floor((x - origin[0]) * inv))
            j = int(np.floor((y - origin[1]) * inv))
            k = int(np.floor((t - origin[2]) * inv))
            if i < 0 or j < 0 or k < 0 or i >= shape[0] or j >= ny or k >= nz:
                continue
            index = (i * ny + j) * nz + k
            s = near_solid[index]
            sigma = noise[0] + noise[1] * z + noise[2] * z * z
            if s != 0:
                m = margin + angle * z + sigmas * sigma
                d = solid_distance(kinds[s - 1], sizes[s - 1], T_solid_base[s - 1], x, y, t)
                if d <= m:
                    continue
            if not supported(depth, v, u, 0.01 + 0.01 * z + 4.0 * sigma, support):
                continue
            if count[index] == 0:
                if n >= hits.shape[0]:
                    continue
                hits[n] = index
                n += 1
            if count[index] < 65535:
                count[index] += 1
    return n


@njit(cache=True, nogil=True)
def grade_hits(hits, n, count, T, origin, voxel, shape, focal2, share, strong):
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
def build_pyramid(depth, label, least, greatest):
    """Min-pooled depth over windows of 1, 2, 4, 8, 16 px and tile maxima; no return counts as 0.

    Of the arguments:
        least: (5, h, w) float32 out: least[k, v, u] is the minimum over the 2^k x 2^k window whose
            upper left pixel is (v, u), cut at the image's edge.
        greatest: (ceil(h / 8), ceil(w / 8)) float32 out: maximum over each tile.
    """
    h, w = depth.shape
    base = least[0]
    for v in range(h):
        for u in range(w):
            base[v, u] = depth[v, u] if label[v, u] != NOTHING else np.float32(0.0)
    for k in range(1, LEVELS):
        s = 1 << (k - 1)
        below = least[k - 1]
        here = least[k]
        for v in range(h):
            v2 = min(v + s, h - 1)
            for u in range(w - s):
                a = min(below[v, u], below[v, u + s])
                b = min(below[v2, u], below[v2, u + s])
                here[v, u] = min(a, b)
            for u in range(max(w - s, 0), w):
                here[v, u] = min(below[v, u], below[v2, u])
    for a in range(greatest.shape[0]):
        for b in range(greatest.shape[1]):
            m = np.float32(0.0)
            for v in range(a * TILE, min((a + 1) * TILE, h)):
                for u in range(b * TILE, min((b + 1) * TILE, w)):
                    m = max(m, base[v, u])
            greatest[a, b] = m


@njit(cache=True, nogil=True)
def is_ideal(lens):
    """Whether a lens has no distortion."""
    none = lens[4] == 0.0 and lens[5] == 0.0 and lens[6] == 0.0
    return none and lens[7] == 0.0 and lens[8] == 0.0


@njit(cache=True, nogil=True)
def distort(lens, x, y):
    """Pixel coordinates of normalised ones, with Brown-Conrady distortion."""
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    if is_ideal(lens):
        return lens[0] * x + lens[2], lens[1] * y + lens[3]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return lens[0] * xd + lens[2], lens[1] * yd + lens[3]


@njit(cache=True, nogil=True)
def footprint(lens, x, y, z, ex, ey, ez):
    """Pixels that can see any part of a box about (x, y, z) with half extents ex, ey, ez.

    Conservative: the box is aligned with the camera and encloses the voxel. The box must lie
    wholly in front of the camera.

    Returns:
        First and last column, first and last row (inclusive, may lie outside the image).
    """
    near = 1.0 / (z - ez)
    far = 1.0 / (z + ez)
    x0 = x - ex
    x1 = x + ex
    y0 = y - ey
    y1 = y + ey
    x0 = x0 * (near if x0 < 0 else far)
    x1 = x1 * (far if x1 < 0 else near)
    y0 = y0 * (near if y0 < 0 else far)
    y1 = y1 * (far if y1 < 0 else near)
    if is_ideal(lens):
        u0 = lens[0] * x0 + lens[2]
        u1 = lens[0] * x1 + lens[2]
        v0 = lens[1] * y0 + lens[3]
        v1 = lens[1] * y1 + lens[3]
    else:
        # Outside the lens's own field the polynomial means nothing (it folds back): not seen.
        if x1 > lens[9] or x0 < -lens[9] or y1 > lens[10] or y0 < -lens[10]:
            return -1, -1, -1, -1
        u0, v0 = distort(lens, x0, y0)
        u1, v1 = u0, v0
        for c in range(1, 9):  # the other corners and the middles of the sides
            a, b = distort(lens, x0 + 0.5 * (c % 3) * (x1 - x0), y0 + 0.5 * (c // 3) * (y1 - y0))
            u0 = min(u0, a)
            u1 = max(u1, a)
            v0 = min(v0, b)
            v1 = max(v1, b)
        pad_u = 0.02 * (u1 - u0)  # the sides bow a little between the tested points
        pad_v = 0.02 * (v1 - v0)
        u0 -= pad_u
        u1 += pad_u
        v0 -= pad_v
        v1 += pad_v
    return (
        int(np.floor(u0 + 0.5)),
        int(np.floor(u1 + 0.5)),
        int(np.floor(v0 + 0.5)),
        int(np.floor(v1 + 0.5)),
    )


@njit(cache=True, nogil=True)
def window_min(least, u0, u1, v0, v1):
    """Minimum depth over an inclusive pixel rectangle that lies inside the image."""
    w = u1 - u0 + 1
    h = v1 - v0 + 1
    short = min(w, h)
    k = 0
    while k < LEVELS - 1 and (2 << k) <= short:
        k += 1
    s = 1 << k
    table = least[k]
    best = table[v0, u0]
    v = v0
    while True:
        u = u0
        while True:
            d = table[v, u]
            best = min(best, d)
            if u + s > u1:
                break
            u = min(u + s, u1 - s + 1)
        if v + s > v1:
            break
        v = min(v + s, v1 - s + 1)
    return best


@njit(cache=True, nogil=True)
def window_max(greatest, u0, u1, v0, v1):
    """An upper bound of the depth over an inclusive pixel rectangle inside the image."""
    best = np.float32(0.0)
    for a in range(v0 // TILE, v1 // TILE + 1):
        for b in range(u0 // TILE, u1 // TILE + 1):
            best = max(best, greatest[a, b])
    return best


@njit(cache=True, nogil=True)
def carve(least, greatest, lens, T, origin, voxel, shape, near, noise, margin, sigmas, free):
    """Mark every voxel that the image saw through wholly; an octree descent of projections.

    A voxel is free only if the least depth over all pixels that can see any part of it lies
    behind its far side, by ``margin`` [m] and ``sigmas`` of noise. Pixels without a return have
    depth 0 and so free nothing.

    Of the arguments:
        near: the lens's least distance [m]: nothing nearer is judged.
        free: (nx, ny, nz) uint8, zero on entry; set to 1.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    _, h, w = least.shape
    # rows: base axes in the camera frame, scaled to half a voxel's edge
    half = 0.5 * voxel
    ax = half * (abs(T[0, 0]) + abs(T[1, 0]) + abs(T[2, 0]))
    ay = half * (abs(T[0, 1]) + abs(T[1, 1]) + abs(T[2, 1]))
    az = half * (abs(T[0, 2]) + abs(T[1, 2]) + abs(T[2, 2]))
    top = 8
    stack = np.empty((64, 4), np.int64)
    for bi in range(0, nx, top):
        for bj in range(0, ny, top):
            for bk in range(0, nz, top):
                stack[0, 0] = bi
                stack[0, 1] = bj
                stack[0, 2] = bk
                stack[0, 3] = top
                n = 1
                while n > 0:
                    n -= 1
                    i = stack[n, 0]
                    j = stack[n, 1]
                    k = stack[n, 2]
                    s = stack[n, 3]
                    dx = origin[0] + (i + 0.5 * s) * voxel - T[0, 3]
                    dy = origin[1] + (j + 0.5 * s) * voxel - T[1, 3]
                    dz = origin[2] + (k + 0.5 * s) * voxel - T[2, 3]
                    z = T[0, 2] * dx + T[1, 2] * dy + T[2, 2] * dz
                    ez = az * s
                    if z + ez <= near:
                        continue
                    inside = False
                    if z - ez > near:
                        x = T[0, 0] * dx + T[1, 0] * dy + T[2, 0] * dz
                        y = T[0, 1] * dx + T[1, 1] * dy + T[2, 1] * dz
                        u0, u1, v0, v1 = footprint(lens, x, y, z, ax * s, ay * s, ez)
                        if u1 < 0 or v1 < 0 or u0 >= w or v0 >= h:
                            continue
                        inside = u0 >= 0 and v0 >= 0 and u1 < w and v1 < h
                        far = z + ez
                        if inside:
                            need = far + margin
                            need += sigmas * (noise[0] + noise[1] * far + noise[2] * far * far)
                            if window_min(least, u0, u1, v0, v1) > need:
                                for a in range(i, min(i + s, nx)):
                                    for b in range(j, min(j + s, ny)):
                                        for c in range(k, min(k + s, nz)):
                                            free[a, b, c] = 1
                                continue
                        if s > 2:
                            c0 = max(u0, 0)
                            c1 = min(u1, w - 1)
                            r0 = max(v0, 0)
                            r1 = min(v1, h - 1)
                            if window_max(greatest, c0, c1, r0, r1) < z - ez:
                                continue
                    if s == 1:
                        continue
                    s //= 2
                    for a in range(2):
                        if i + a * s >= nx:
                            break
                        for b in range(2):
                            if j + b * s >= ny:
                                break
                            for c in range(2):
                                if k + c * s >= nz:
                                    break
                                stack[n, 0] = i + a * s
                                stack[n, 1] = j + b * s
                                stack[n, 2] = k + c * s
                                stack[n, 3] = s
                                n += 1
