"""Hot loops of finding and fitting: directions of edges, votes, sparse templates, edge search."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, Shorts

BINS = 16
"""Directions that are told apart, over half a turn: an edge has no sign (light may come from any
side)."""


@njit(cache=True, nogil=True)
def direction_bits(size: Floats32, angle: Floats32, least: float) -> Shorts:
    """(h, w) one bit a direction: that of each pixel's gradient and its two neighbours'.

    Args:
        size: (h, w) of the gradient; pixels below ``least`` have no direction.
        angle: (h, w) of the gradient, 0 to 2 pi.
        least: see above.
    """
    h, w = size.shape
    out = np.zeros((h, w), np.uint16)
    table = np.empty(2 * BINS + 1, np.uint16)
    for i in range(2 * BINS + 1):
        k = i % BINS
        table[i] = (1 << k) | (1 << ((k + 1) % BINS)) | (1 << ((k + BINS - 1) % BINS))
    scale = np.float32(BINS / np.pi)
    floor = np.float32(least)
    for y in range(h):
        for x in range(w):
            if size[y, x] >= floor:
                out[y, x] = table[int(angle[y, x] * scale + np.float32(0.5))]
    return out


@njit(cache=True, nogil=True)
def vote_centers(
    size: Floats32, angle: Floats32, least: float, shift: Floats32, radii: Ints
) -> Shorts:
    """Votes of edges for the middle of the rings that they may belong to.

    Args:
        size: (h, w) of the gradient.
        angle: (h, w) of it, 0 to 2 pi.
        least: gradients below this do not vote; nor do those that are no crest of an edge.
        shift: (classes, directions, 2) step towards the middle for a ring of radius 1 seen at a
            class's tilt, for each direction of the gradient over a whole turn.
        radii: of rings [px].

    Returns:
        (classes, h, w) votes.
    """
    h, w = size.shape
    classes, directions = shift.shape[:2]
    votes = np.zeros((classes, h, w), np.uint16)
    floor = np.float32(least)
    scale = np.float32(directions / (2 * np.pi))
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            m = size[y, x]
            if m < floor:
                continue
            k = int(angle[y, x] * scale + np.float32(0.5)) % directions
            eighth = (8 * k + directions // 2) // directions % 4
            if eighth == 0:  # a crest along the gradient
                p, q = size[y, x - 1], size[y, x + 1]
            elif eighth == 1:
                p, q = size[y - 1, x - 1], size[y + 1, x + 1]
            elif eighth == 2:
                p, q = size[y - 1, x], size[y + 1, x]
            else:
                p, q = size[y - 1, x + 1], size[y + 1, x - 1]
            if m < p or m <= q:
                continue
            for c in range(classes):
                sx, sy = shift[c, k, 0], shift[c, k, 1]
                for r in radii:
                    for sign in (-1, 1):
                        u = int(x + sign * r * sx + np.float32(0.5))
                        v = int(y + sign * r * sy + np.float32(0.5))
                        if 0 <= u < w and 0 <= v < h:
                            votes[c, v, u] += 1
    return votes


@njit(cache=True, nogil=True)
def flat_affine(guess: Floats) -> tuple[float, float, float, float]:
    """Template (y up) to picture (y down) of a guess, a squeeze after a turn after a flip.

    Args:
        guess: u, v [px], scale [px/m], tilt along x and y of the picture, roll [rad].
    """
    scale, lean_x, lean_y, roll = guess[2], guess[3], guess[4], guess[5]
    tilt = np.sqrt(lean_x * lean_x + lean_y * lean_y)
    ax, ay = (lean_x / tilt, lean_y / tilt) if tilt > 1e-9 else (1.0, 0.0)
    k = np.cos(tilt)
    s00, s01, s11 = ax * ax + k * ay * ay, (1 - k) * ax * ay, ay * ay + k * ax * ax
    cr, sr = np.cos(roll), np.sin(roll)
    return (
        scale * (s00 * cr + s01 * sr),
        scale * (s00 * sr - s01 * cr),
        scale * (s01 * cr + s11 * sr),
        scale * (s01 * sr - s11 * cr),
    )


@njit(cache=True, nogil=True)
def flat_rise(guess: Floats) -> tuple[float, float]:
    """Where a point above the template's plane is seen, per metre of height [px/m]."""
    tilt = np.sqrt(guess[3] * guess[3] + guess[4] * guess[4])
    if tilt < 1e-9:
        return 0.0, 0.0
    k = guess[2] * np.sin(tilt) / tilt
    return -k * guess[4], k * guess[3]


@njit(cache=True, nogil=True)
def rough_score(bits: Shorts, points: Floats32, normals: Floats32, guess: Floats) -> float:
    """Share of a flat template's points that lie near an edge of their direction.

    Args:
        bits: (h, w) directions, spread.
        points: (n, 3) template [m], y up, z towards who looks.
        normals: (n, 2) across its edges.
        guess: see :func:`flat_affine`.
    """
    h, w = bits.shape
    a, b, c, d = flat_affine(guess)
    e, f = flat_rise(guess)
    scale = BINS / np.pi
    hits = 0
    n = len(points)
    for i in range(n):
        x = int(guess[0] + a * points[i, 0] + b * points[i, 1] + e * points[i, 2] + 0.5)
        y = int(guess[1] + c * points[i, 0] + d * points[i, 1] + f * points[i, 2] + 0.5)
        if 0 <= x < w and 0 <= y < h:
            nx, ny = c * normals[i, 1] - d * normals[i, 0], b * normals[i, 0] - a * normals[i, 1]
            k = int(np.arctan2(ny, nx) * scale + BINS + 0.5) % BINS
            hits += (bits[y, x] >> k) & 1
    return hits / n


@njit(cache=True, nogil=True)
def fine_score(
    gx: Floats32,
    gy: Floats32,
    soft: float,
    points: Floats32,
    normals: Floats32,
    guess: Floats,
) -> float:
    """How well the edges of a flat template agree with a picture's gradients, 0..1.

    The mean of |n g| / (|g| + soft) over the points: Steger's similarity measure (C. Steger,
    "Occlusion, clutter, and illumination invariant object recognition", 2002) without the sign,
    and with weak gradients counting less.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        soft: size of a gradient that counts half.
        points: (n, 3) template [m], y up, z towards who looks.
        normals: (n, 2) across its edges.
        guess: see :func:`flat_affine`.
    """
    h, w = gx.shape
    a, b, c, d = flat_affine(guess)
    e, f = flat_rise(guess)
    total = 0.0
    n = len(points)
    for i in range(n):
        x = int(guess[0] + a * points[i, 0] + b * points[i, 1] + e * points[i, 2] + 0.5)
        y = int(guess[1] + c * points[i, 0] + d * points[i, 1] + f * points[i, 2] + 0.5)
        if 0 <= x < w and 0 <= y < h:
            nx, ny = c * normals[i, 1] - d * normals[i, 0], b * normals[i, 0] - a * normals[i, 1]
            p, q = gx[y, x], gy[y, x]
            g = np.sqrt(p * p + q * q)
            total += abs(nx * p + ny * q) / ((g + soft) * np.sqrt(nx * nx + ny * ny) + 1e-12)
    return total / n


@njit(cache=True, nogil=True)
def best_roll(
    bits: Shorts, points: Floats32, normals: Floats32, guess: Floats, rolls: int
) -> tuple[float, Floats]:
    """The best of all rolls, then steps uphill; see :func:`rough_score`."""
    trial, out = guess.copy(), guess.copy()
    best = -1.0
    for k in range(rolls):
        trial[5] = 2.0 * np.pi * k / rolls
        score = rough_score(bits, points, normals, trial)
        if score > best:
            best = score
            out[:] = trial
    steps = np.array([1.5, 1.5, 0.06 * out[2], 0.2, 0.2, 0.07])
    for _ in range(4):
        moved = False
        for axis in range(6):
            for sign in (-1.0, 1.0):
                trial[:] = out
                trial[axis] += sign * steps[axis]
                if trial[3] ** 2 + trial[4] ** 2 > 1.0:
                    continue
                score = rough_score(bits, points, normals, trial)
                if score > best:
                    best, moved = score, True
                    out[:] = trial
        if not moved:
            break
    return best, out


@njit(cache=True, nogil=True)
def climb(
    gx: Floats32,
    gy: Floats32,
    soft: float,
    points: Floats32,
    normals: Floats32,
    guess: Floats,
    reach: float,
) -> tuple[float, Floats]:
    """Steps in place, size, tilt and roll as long as they help; see :func:`fine_score`.

    ``reach`` is the first step in place [px].
    """
    out = guess.copy()
    best = fine_score(gx, gy, soft, points, normals, out)
    extent = 0.0
    for i in range(len(points)):
        extent = max(extent, abs(points[i, 0]), abs(points[i, 1]))
    turn = reach / (extent * guess[2])
    steps = np.array([reach, reach, turn * guess[2], 2.0 * turn, 2.0 * turn, turn])
    trial = out.copy()
    for _ in range(14):
        moved = False
        for axis in range(6):
            for sign in (-1.0, 1.0):
                trial[:] = out
                trial[axis] += sign * steps[axis]
                if trial[3] ** 2 + trial[4] ** 2 > 1.0:
                    continue
                score = fine_score(gx, gy, soft, points, normals, trial)
                if score > best:
                    best, moved = score, True
                    out[:] = trial
        if not moved:
            if steps[0] < 0.4:
                break
            steps *= 0.5
    return best, out


@njit(cache=True, nogil=True)
def best_rings(
    bits: Shorts,
    seeds: Floats32,
    tilts: Floats32,
    radii: Floats32,
    ring: Floats32,
    offsets: Floats32,
) -> Floats32:
    """Best double ring of each size about each seed.

    Args:
        bits: spread directions.
        seeds: (s, 2) [px].
        tilts: (t, 2, 2) shapes of a tilted circle of radius 1.
        radii: (r,) of the outer ring [px].
        ring: (p, 3) points of a double ring of outer radius 1, and the angle of their normal.
        offsets: (o, 2) tried about the seed [px].

    Returns:
        (s, r, 4) score, u, v, index of tilt.
    """
    h, w = bits.shape
    s_count, t_count, p_count = len(seeds), len(tilts), len(ring)
    out = np.zeros((s_count, len(radii), 4), np.float32)
    # direction bin of each point at each tilt: it does not depend on the radius
    bins = np.empty((t_count, p_count), np.int64)
    unit = np.empty((t_count, p_count, 2), np.float32)
    scale = BINS / np.pi
    for t in range(t_count):
        a, b, c, d = tilts[t, 0, 0], tilts[t, 0, 1], tilts[t, 1, 0], tilts[t, 1, 1]
        for p in range(p_count):
            x, y, angle = ring[p, 0], ring[p, 1], ring[p, 2]
            unit[t, p, 0], unit[t, p, 1] = a * x + b * y, c * x + d * y
            nx, ny = np.cos(angle), np.sin(angle)
            bins[t, p] = (
                int(np.floor(np.arctan2(a * ny - b * nx, d * nx - c * ny) * scale + BINS + 0.5))
                % BINS
            )
    for s in range(s_count):
        for i in range(len(radii)):
            r = radii[i]
            best = 0
            for t in range(t_count):
                for o in range(len(offsets)):
                    u, v = seeds[s, 0] + offsets[o, 0], seeds[s, 1] + offsets[o, 1]
                    hits = 0
                    for p in range(p_count):
                        x = int(u + r * unit[t, p, 0] + np.float32(0.5))
                        y = int(v + r * unit[t, p, 1] + np.float32(0.5))
                        if 0 <= x < w and 0 <= y < h:
                            hits += (bits[y, x] >> bins[t, p]) & 1
                        # too few already: the rest cannot make up for it
                        if hits + p_count - p <= best or (p == 15 and hits < 8):
                            break
                    if hits > best:
                        best = hits
                        out[s, i, 1], out[s, i, 2], out[s, i, 3] = u, v, t
            out[s, i, 0] = np.float32(best) / np.float32(p_count)
    return out


@njit(cache=True, nogil=True)
def edge_search(
    gx: Floats32,
    gy: Floats32,
    pixels: Floats,
    normals: Floats,
    reach: float,
    width: float,
    least: float,
    cos_least: float,
) -> tuple[Floats, Floats]:
    """Edges along the normals of projected curves.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        pixels: (n, 2) where the curve is expected.
        normals: (n, 2) unit normals in the picture.
        reach: how far to search to both sides [px].
        width: nearer crests are preferred on this scale [px].
        least: crests below this are none [levels/px].
        cos_least: cosine of the greatest angle between gradient and normal.

    Returns:
        (n,) signed distance of the edge along the normal [px], NaN for none; (n,) its strength.
    """
    h, w = gx.shape
    n = len(pixels)
    offset = np.full(n, np.nan)
    strength = np.zeros(n)
    step = 0.5
    half = int(np.ceil(reach / step))
    count = 2 * half + 1
    along = np.zeros(count + 4)
    size = np.zeros(count + 4)
    for i in range(n):
        nx, ny = normals[i, 0], normals[i, 1]
        far = reach + 2.5
        u, v = pixels[i, 0], pixels[i, 1]
        if not (far < u < w - 1 - far and far < v < h - 1 - far):
            continue
        for k in range(count + 4):
            d = (k - half - 2) * step
            x, y = u + d * nx, v + d * ny
            x0, y0 = int(x), int(y)
            fx, fy = x - x0, y - y0
            w00, w01, w10, w11 = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
            a = w00 * gx[y0, x0] + w01 * gx[y0, x0 + 1]
            a += w10 * gx[y0 + 1, x0] + w11 * gx[y0 + 1, x0 + 1]
            b = w00 * gy[y0, x0] + w01 * gy[y0, x0 + 1]
            b += w10 * gy[y0 + 1, x0] + w11 * gy[y0 + 1, x0 + 1]
            along[k] = abs(a * nx + b * ny)
            size[k] = np.sqrt(a * a + b * b)
        best = 0.0
        for k in range(2, count + 2):
            p, q, r = along[k - 1], along[k], along[k + 1]
            if q < least or q < p or q <= r or q < cos_least * size[k]:
                continue
            d = (k - half - 2) * step
            value = q * np.exp(-0.5 * (d / width) ** 2)
            if value > best:
                best = value
                # Samples a whole pixel apart are interpolated alike; half a pixel apart they are
                # not, and the crest would be drawn to the middle of a pixel.
                p, r = along[k - 2], along[k + 2]
                bend = p - 2 * q + r
                offset[i] = d + (0.5 * (p - r) / bend if bend < -1e-12 else 0.0)
                strength[i] = q
    return offset, strength


@njit(cache=True, nogil=True)
def project_lens(lens: Floats, x: float, y: float, z: float) -> tuple[float, float]:
    """Pixel of a point in front of a lens: fx, fy, cx, cy, k1, k2, p1, p2, k3 (OpenCV's)."""
    a, b = x / z, y / z
    r2 = a * a + b * b
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    u = a * radial + 2 * lens[6] * a * b + lens[7] * (r2 + 2 * a * a)
    v = b * radial + lens[6] * (r2 + 2 * b * b) + 2 * lens[7] * a * b
    return lens[0] * u + lens[2], lens[1] * v + lens[3]


@njit(cache=True, nogil=True)
def fit_rigid(
    gx: Floats32,
    gy: Floats32,
    lens: Floats,
    points: Floats,
    normals: Floats,
    pose: Floats,
    reaches: Floats,
    least: float,
) -> tuple[float, Floats]:
    """A quick fit of a rigid model's edges to one picture, to compare many guesses.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        lens: see :func:`project_lens`.
        points: (n, 3) of the edges [m].
        normals: (n, 3) across them, in the plane z = const.
        pose: (4, 4) start.
        reaches: of the search, one an iteration [px].
        least: crests below this are none [levels/px].

    Returns:
        Share of points with an edge within 1.5 px at the end, and the (4, 4) pose.
    """
    n = len(points)
    T = pose.copy()
    pixels, across = np.empty((n, 2)), np.empty((n, 2))
    rows = np.empty((n, 6))
    for i in range(len(reaches) + 1):
        R = np.ascontiguousarray(T[:3, :3])
        for k in range(n):
            p, m = points[k], normals[k]
            q = R @ p + T[:3, 3]
            if q[2] < 0.02:
                pixels[k, 0], pixels[k, 1] = -1e6, -1e6
                continue
            e = R @ np.array([-m[1], m[0], 0.0])
            h = 1e-4
            u, v = project_lens(lens, q[0], q[1], q[2])
            u2, v2 = project_lens(lens, q[0] + h * e[0], q[1] + h * e[1], q[2] + h * e[2])
            du, dv = u2 - u, v2 - v
            norm = np.sqrt(du * du + dv * dv) + 1e-12
            nx, ny = dv / norm, -du / norm
            pixels[k, 0], pixels[k, 1] = u, v
            across[k, 0], across[k, 1] = nx, ny
            a, b = nx * lens[0] / q[2], ny * lens[1] / q[2]
            in_lens = np.array([a, b, -(a * q[0] + b * q[1]) / q[2]])
            g = in_lens @ R
            rows[k, 0], rows[k, 1], rows[k, 2] = g[0], g[1], g[2]
            rows[k, 3] = p[1] * g[2] - p[2] * g[1]
            rows[k, 4] = p[2] * g[0] - p[0] * g[2]
            rows[k, 5] = p[0] * g[1] - p[1] * g[0]
        final = i == len(reaches)
        reach = 2.5 if final else reaches[i]
        d, _ = edge_search(gx, gy, pixels, across, reach, max(0.6 * reach, 1.0), least, 0.92)
        size = np.abs(d)
        if final:
            found = 0
            for k in range(n):
                if size[k] <= 1.5:
                    found += 1
            return found / n, T
        seen = size[np.isfinite(size)]
        if len(seen) < 12:
            return 0.0, T
        spread = max(1.4826 * np.median(seen), 0.4)
        H, g6 = np.zeros((6, 6)), np.zeros(6)
        for k in range(n):
            if np.isfinite(d[k]):
                w = 1.0 / max(size[k] / (1.5 * spread), 1.0)
                if size[k] > 4.0 * spread:
                    w *= 0.1
                for a6 in range(6):
                    g6[a6] += w * rows[k, a6] * d[k]
                    for b6 in range(a6 + 1):
                        H[a6, b6] += w * rows[k, a6] * rows[k, b6]
        for a6 in range(6):
            H[a6, a6] *= 1.0 + 1e-6
            for b6 in range(a6):
                H[b6, a6] = H[a6, b6]
        x = np.linalg.solve(H + 1e-9 * np.eye(6), g6)
        far = max(np.sqrt((x[:3] ** 2).sum()) / 0.05, np.sqrt((x[3:] ** 2).sum()) / 0.25)
        if far > 1.0:
            x /= far
        angle = np.sqrt((x[3:] ** 2).sum())
        K = np.array([[0.0, -x[5], x[4]], [x[5], 0.0, -x[3]], [-x[4], x[3], 0.0]])
        s, c = (
            (1.0, 0.5)
            if angle < 1e-6
            else (
                np.sin(angle) / angle,
                (1.0 - np.cos(angle)) / angle**2,
            )
        )
        T[:3, 3] += np.ascontiguousarray(T[:3, :3]) @ x[:3]
        T[:3, :3] = np.ascontiguousarray(T[:3, :3]) @ (np.eye(3) + s * K + c * (K @ K))
    return 0.0, T
