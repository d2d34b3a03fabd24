"""Compiled loops of the depth sensors' errors; their plain-numpy twins are in the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import Bytes, DepthImage, Floats, Floats32, Mask

BLACK_PLASTIC, SHINY = 1, 2
"""Codes of materials, see :data:`model.MATERIALS`."""


@njit(cache=True, nogil=True)
def disturb_depth(
    true: DepthImage,
    geom: NDArray[np.int16],
    materials: Bytes,
    rays: Floats32,
    interference: Mask,
    settings: Floats32,
    shift: Floats32,
    sigma: Floats32,
    growth: Floats32,
    normals: Floats32,
    incidence: Floats32,
    seed: np.uint64,
    out: DepthImage,
) -> None:
    """What a sensor makes of an ideal depth picture; see :class:`sensor_errors.DepthErrors`.

    Args:
        true: (h, w) [m], NaN for nothing.
        geom: (h, w) index of the geom, -1 for nothing.
        materials: code of each geom's material.
        rays: (2, h, w) normalised coordinates of each pixel.
        interference: (h, w), or (1, 1) for none.
        settings: as packed by :meth:`sensor_errors.DepthSensor.measure`.
        shift: systematic error by depth [m].
        sigma: random error by depth [m].
        growth: its growth with incidence, by depth [m].
        normals: (65536,) normal deviates.
        incidence: (2, 1024) g and th / (pi/2 - th) by cosine.
        seed: of the frame.
        out: (h, w), written.
    """
    h, w = true.shape
    near, far = settings[0], settings[1]
    grazing, lateral, lateral_grazing = settings[2], settings[3], settings[4]
    quantum, baseline = settings[5], settings[6]
    fly, fly_lost = settings[7], settings[8]
    cos_from, cos_at = settings[9], settings[10]
    infrared = settings[11] > 0.5
    shiny_lost, radial = settings[12], settings[13]
    interference_lost, step = settings[14], settings[15]
    per_step = np.float32(1.0) / step
    last = shift.shape[0] - 1
    one, half, to_unit = np.float32(1.0), np.float32(0.5), np.float32(1.0 / 65536.0)
    nothing = np.float32(np.nan)
    edges = fly + fly_lost > np.float32(0.0)
    angles = grazing > np.float32(0.0) or lateral_grazing > np.float32(0.0)
    lit = np.ones(w, np.bool_)
    cosines = np.empty(w, np.float32)
    rough = np.zeros(w, np.uint8)
    disturbed = interference.shape[0] == h
    for v in range(h):
        state = _mix(seed + np.uint64(v) * np.uint64(0x9E3779B97F4A7C15))
        if baseline > np.float32(0.0):
            _lit_by_projector(true[v], rays[0, v], baseline, lit)
        _row_shape(true, rays, v, cosines, rough)
        for u in range(w):
            state ^= state << np.uint64(13)
            state ^= state >> np.uint64(7)
            state ^= state << np.uint64(17)
            drawn = (state * np.uint64(0x2545F4914F6CDD1D)) & np.uint64(0xFFFFFFFFFFFFFFFF)
            chance = np.float32(drawn & np.uint64(0xFFFF)) * to_unit
            deviate = normals[np.int64((drawn >> np.uint64(16)) & np.uint64(0xFFFF))]
            out[v, u] = nothing
            vv, uu = v, u
            z = true[v, u]
            cosine = one
            if lateral > np.float32(0.0):
                if not np.isnan(z):
                    cosine = cosines[u]
                spread = lateral
                if lateral_grazing > np.float32(0.0):
                    spread += lateral_grazing * incidence[1, _bin(cosine)]
                    spread = min(spread, np.float32(3.0))
                du = spread * normals[np.int64((drawn >> np.uint64(32)) & np.uint64(0xFFFF))]
                dv = spread * normals[np.int64((drawn >> np.uint64(48)) & np.uint64(0xFFFF))]
                uu = min(max(int(np.float32(u) + du + half), 0), w - 1)
                vv = min(max(int(np.float32(v) + dv + half), 0), h - 1)
                other = true[vv, uu]
                # Borders are ragged; inside a surface the plane is seen where it is.
                if np.isnan(z) or np.isnan(other) or abs(other - z) > np.float32(0.03) * z:
                    z = other
                else:
                    vv, uu = v, u
            if np.isnan(z):
                continue
            material = materials[geom[vv, uu]]
            if material == BLACK_PLASTIC and infrared:
                continue
            if not lit[uu] and vv == v:
                continue
            if edges and rough[u]:
                beyond = _across_edge(true, v, u, z)
                if beyond != np.float32(0.0):
                    if chance < fly_lost:
                        continue
                    if chance < fly_lost + fly:
                        part = (chance - fly_lost) / fly
                        if np.isnan(beyond):
                            continue
                        z = z + part * (beyond - z)
                    chance = np.float32((drawn >> np.uint64(40)) & np.uint64(0xFFFF)) * to_unit
            if lateral <= np.float32(0.0):
                cosine = cosines[u]
            if cosine < cos_from and chance * (cos_from - cos_at) < cos_from - cosine:
                continue
            if material == SHINY and chance < shiny_lost:
                continue
            if disturbed and interference[v, u] and chance < interference_lost:
                continue
            place = min(max(int(z * per_step + half), 0), last)
            error = sigma[place]
            if angles:
                error += growth[place] * incidence[0, _bin(cosine)]
            x, y = rays[0, v, u], rays[1, v, u]
            value = z + shift[place] + radial * (x * x + y * y) + error * deviate
            if value < near or value > far:
                continue
            if quantum > np.float32(0.0):
                value = one / (np.float32(np.rint(one / value / quantum)) * quantum)
            out[v, u] = value


@njit(cache=True, nogil=True, inline="always")
def _bin(cosine: Any) -> Any:
    return min(max(int(cosine * np.float32(1024.0)), 0), 1023)


@njit(cache=True, nogil=True)
def _mix(x: np.uint64) -> np.uint64:
    """SplitMix64's finaliser: neighbouring seeds give unlike streams; never 0."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (x ^ (x >> np.uint64(31))) | np.uint64(1)


@njit(cache=True, nogil=True, error_model="numpy")
def _row_shape(true: DepthImage, rays: Floats32, v: int, cosines: Floats32, rough: Bytes) -> None:
    """Cosine of incidence along a row, and where depth may have an edge; see :func:`_cosine`.

    Written without branches so that the compiler vectorises it; the few pixels that lack a
    neighbour are done again one by one.
    """
    h, w = true.shape
    one = np.float32(1.0)
    if v == 0 or v == h - 1:
        for u in range(w):
            cosines[u] = _cosine(true, rays, v, u)
            rough[u] = 1
        return
    # Slices instead of u - 1 and u + 1: an index that may be negative stops the vectoriser.
    zm, zl, zr = true[v, 1 : w - 1], true[v, : w - 2], true[v, 2:]
    zu, zd = true[v - 1, 1 : w - 1], true[v + 1, 1 : w - 1]
    xm, xl, xr = rays[0, v, 1 : w - 1], rays[0, v, : w - 2], rays[0, v, 2:]
    ym, yl, yr = rays[1, v, 1 : w - 1], rays[1, v, : w - 2], rays[1, v, 2:]
    xu, xd = rays[0, v - 1, 1 : w - 1], rays[0, v + 1, 1 : w - 1]
    yu, yd = rays[1, v - 1, 1 : w - 1], rays[1, v + 1, 1 : w - 1]
    cosine, flag = cosines[1 : w - 1], rough[1 : w - 1]
    for u in range(w - 2):
        z, z_left, z_right, z_up, z_down = zm[u], zl[u], zr[u], zu[u], zd[u]
        gap_left, gap_right = abs(z_left - z), abs(z_right - z)
        gap_up, gap_down = abs(z_up - z), abs(z_down - z)
        limit = np.float32(0.03) * z
        limit = limit if limit > np.float32(0.04) else np.float32(0.04)
        smooth = (
            (gap_left <= limit) & (gap_right <= limit) & (gap_up <= limit) & (gap_down <= limit)
        )
        flag[u] = np.uint8(1) - np.uint8(smooth)
        x, y, x_left, x_right, y_left, y_right = xm[u], ym[u], xl[u], xr[u], yl[u], yr[u]
        x_up, x_down, y_up, y_down = xu[u], xd[u], yu[u], yd[u]
        left, up = gap_left <= gap_right, gap_up <= gap_down
        za, zb = z_left if left else z_right, z_up if up else z_down
        xa, ya = x_left if left else x_right, y_left if left else y_right
        xb, yb = x_up if up else x_down, y_up if up else y_down
        ax, ay, az = xa * za - x * z, ya * za - y * z, za - z
        bx, by, bz = xb * zb - x * z, yb * zb - y * z, zb - z
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        norm = (nx * nx + ny * ny + nz * nz) * (x * x + y * y + one)
        cosine[u] = abs(nx * x + ny * y + nz) / np.sqrt(norm)
    rough[0] = rough[w - 1] = 1
    for u in range(w):
        if rough[u] or np.isnan(cosines[u]):
            cosines[u] = _cosine(true, rays, v, u)


@njit(cache=True, nogil=True)
def _cosine(true: DepthImage, rays: Floats32, v: int, u: int) -> Any:
    """Cosine of the angle of incidence, from the nearer neighbour in each direction."""
    h, w = true.shape
    z = true[v, u]
    big = np.float32(1e9)
    du, dv = 0, 0
    gap_left, gap_right, gap_up, gap_down = big, big, big, big
    if u > 0 and not np.isnan(true[v, u - 1]):
        gap_left = abs(true[v, u - 1] - z)
    if u < w - 1 and not np.isnan(true[v, u + 1]):
        gap_right = abs(true[v, u + 1] - z)
    if v > 0 and not np.isnan(true[v - 1, u]):
        gap_up = abs(true[v - 1, u] - z)
    if v < h - 1 and not np.isnan(true[v + 1, u]):
        gap_down = abs(true[v + 1, u] - z)
    if min(gap_left, gap_right) >= big or min(gap_up, gap_down) >= big:
        return np.float32(1.0)
    du = -1 if gap_left <= gap_right else 1
    dv = -1 if gap_up <= gap_down else 1
    zu, zv = true[v, u + du], true[v + dv, u]
    x, y = rays[0, v, u], rays[1, v, u]
    ax, ay, az = rays[0, v, u + du] * zu - x * z, rays[1, v, u + du] * zu - y * z, zu - z
    bx, by, bz = rays[0, v + dv, u] * zv - x * z, rays[1, v + dv, u] * zv - y * z, zv - z
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    norm = (nx * nx + ny * ny + nz * nz) * (x * x + y * y + np.float32(1.0))
    if norm <= np.float32(0.0):
        return np.float32(1.0)
    return abs(nx * x + ny * y + nz) / np.sqrt(norm)


@njit(cache=True, nogil=True)
def _across_edge(true: DepthImage, v: int, u: int, z: Any) -> Any:
    """Depth beyond a depth edge next to a pixel, NaN where there is nothing, 0 for no edge."""
    h, w = true.shape
    limit = max(np.float32(0.04), np.float32(0.03) * z)
    for k in range(4):
        vv = v + (k == 0) - (k == 1)
        uu = u + (k == 2) - (k == 3)
        if vv < 0 or vv >= h or uu < 0 or uu >= w:
            continue
        other = true[vv, uu]
        if np.isnan(other):
            return np.float32(np.nan)
        if abs(other - z) > limit and not _sloped(true, v, u, vv - v, uu - u):
            return other
    return np.float32(0.0)


@njit(cache=True, nogil=True, inline="always")
def _sloped(true: DepthImage, v: int, u: int, dv: int, du: int) -> bool:
    """Whether depth changes as much on the other side: a steep surface, not an edge."""
    h, w = true.shape
    vv, uu = v - dv, u - du
    if vv < 0 or vv >= h or uu < 0 or uu >= w:
        return False
    step = true[v + dv, u + du] - true[v, u]
    back = true[v, u] - true[vv, uu]
    return bool(back * step > 0.0 and abs(back) > 0.5 * abs(step))


@njit(cache=True, nogil=True)
def _lit_by_projector(depth: Floats32, rays: Floats32, baseline: float, lit: Mask) -> None:
    """Which pixels of a row the projector, ``baseline`` to the right of the lens, lights.

    Seen from the projector a point lies ``baseline / z`` further left. Going left through the
    row, what falls back to the right of a point already seen is behind it.
    """
    leftmost = np.float32(1e9)
    for u in range(depth.shape[0] - 1, -1, -1):
        z = depth[u]
        lit[u] = True
        if np.isnan(z):
            continue
        place = rays[u] - baseline / z
        if place > leftmost:
            lit[u] = False
        else:
            leftmost = place


@njit(cache=True, nogil=True)
def interfered(
    depth: DepthImage,
    rays: Floats32,
    T_other_camera: Floats,
    other_depth: DepthImage,
    other_lens: Floats,
    mask: Mask,
) -> None:
    """Marks pixels whose surface another camera sees, and so lights, too.

    Args:
        depth: (h, w) what this one sees [m].
        rays: (2, h, w) normalised coordinates of its pixels.
        T_other_camera: (4, 4) camera to the other camera.
        other_depth: (H, W) what the other sees [m].
        other_lens: fx, fy, cx, cy of the other, its distortion neglected.
        mask: (h, w), set to true where so.
    """
    R, t = T_other_camera[:3, :3], T_other_camera[:3, 3]
    fx, fy, cx, cy = other_lens[0], other_lens[1], other_lens[2], other_lens[3]
    height, width = other_depth.shape
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = np.float64(depth[v, u])
            if np.isnan(z):
                continue
            x, y = rays[0, v, u] * z, rays[1, v, u] * z
            Z = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2]
            if Z <= 0.05:
                continue
            X = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0]
            Y = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1]
            column = int(np.floor(fx * X / Z + cx + 0.5))
            row = int(np.floor(fy * Y / Z + cy + 0.5))
            if 0 <= column < width and 0 <= row < height:
                seen = other_depth[row, column]
                if not np.isnan(seen) and seen + 0.02 + 0.02 * Z > Z:
                    mask[v, u] = True
