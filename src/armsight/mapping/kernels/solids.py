"""Declared solids: how far points are from them, and which returns they explain.

``rays`` are (h, w, 2) float32 x/z, y/z of each pixel, ``T`` (4, 4) the camera in base, ``noise``
(3,) a b c of sigma(z) = a + b z + c z^2 [m].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Pose
from armsight.mapping.kernels.pixels import VALID


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
    solids: Any,
    x: float,
    y: float,
    z: float,
) -> bool:
    """Whether a point is on the declared solid nearest to its voxel.

    That is within ``limit`` [m] of its surface outside of it, and within as much and how coarsely
    it is declared inside: nobody sees into a solid, so what is seen there is something else.

    ``bound`` is the signed distance [mm] from the voxel's centre to that solid, no less than -127,
    ``slack`` half the voxel's diagonal [m]: most points are settled by them alone.
    """
    if nearest == 0:
        return False
    kinds, sizes, T_solid_base, coarse = solids
    s = nearest - 1
    d, room, deep = 0.001 * bound, slack + 0.001, -limit - coarse[s]
    if d - room > limit or d + room < deep:
        return False
    if d + room <= limit and d - room >= deep and bound > -127:
        return True
    at = solid_distance(kinds[s], sizes[s], T_solid_base[s], x, y, z)
    return deep <= at <= limit


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
    so with the tolerance at the near end all depths in between are explained too, as far as none
    of them lies deep inside of a solid.

    Of the arguments:
        near, far: depths looked at [m]; lower, upper: (3,) corners of the mapped box [m].
        solids, tolerance: as in :func:`collect_hits`; with an infinite ``coarse`` nothing is deep.
        first, last: (h, w) float32 out [m]; first > last where every depth needs a look.
    """
    h, w = first.shape
    kinds, sizes, T_solid_base, coarse = solids
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
                enters, ends = _crossed(kinds[s], sizes[s], 0.0, eye[s], dx, dy, dz, near, z)
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
            for s in range(count):
                dx = turn[s, 0, 0] * rx + turn[s, 0, 1] * ry + turn[s, 0, 2]
                dy = turn[s, 1, 0] * rx + turn[s, 1, 1] * ry + turn[s, 1, 2]
                dz = turn[s, 2, 0] * rx + turn[s, 2, 1] * ry + turn[s, 2, 2]
                deep = limit + coarse[s]
                enters, ends = _crossed(kinds[s], sizes[s], deep, eye[s], dx, dy, dz, near, leaves)
                if enters < ends and enters < last[v, u]:
                    last[v, u] = enters


@njit(cache=True, nogil=True)
def _crossed(
    kind: int,
    size: Floats,
    deep: float,
    eye: Floats,
    dx: float,
    dy: float,
    dz: float,
    enters: float,
    ends: float,
) -> tuple[float, float]:
    """What of the depths from ``enters`` to ``ends`` lies in a solid, at least so deep [m].

    ``eye`` is the camera in the solid's frame, ``dx`` ``dy`` ``dz`` how the ray runs there.
    """
    x, y, z = eye[0], eye[1], eye[2]
    if kind == 0:
        enters, ends = _slab(x, dx, 0.5 * size[0] - deep, enters, ends)
        enters, ends = _slab(y, dy, 0.5 * size[1] - deep, enters, ends)
        return _slab(z, dz, 0.5 * size[2] - deep, enters, ends)
    radius = size[0] - deep
    if radius <= 0.0:
        return np.inf, -np.inf
    if kind == 1:
        enters, ends = _slab(z, dz, 0.5 * size[1] - deep, enters, ends)
        b, c = x * dx + y * dy, x * x + y * y - radius * radius
        return _ball(dx * dx + dy * dy, b, c, enters, ends)
    b = x * dx + y * dy + z * dz
    c = x * x + y * y + z * z - radius * radius
    return _ball(dx * dx + dy * dy + dz * dz, b, c, enters, ends)


@njit(cache=True, nogil=True)
def _slab(at: float, step: float, half: float, enters: float, ends: float) -> tuple[float, float]:
    """What of the depths from ``enters`` to ``ends`` lies between two planes at +-half."""
    if half <= 0.0:
        return np.inf, -np.inf
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
