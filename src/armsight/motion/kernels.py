"""Compiled collision queries: body against the distance field, exact near things, proven motions.

All clearances are lower bounds in metres. A motion is proven with symmetric conservative
advancement: at the middle of an interval of the motion, sphere i has clearance c_i; as it travels
at most L_i per unit of the parameter, it is free for c_i / L_i to both sides. What is left of the
interval is queued, so rough places are met early and free motions need few looks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, JointPath, JointVector, Points
from armsight.motion.body import Body

OCCUPIED = 2
QUEUE = 4096
"""Intervals that one proof may hold open; a motion that needs more is refused."""


class Obstacles(NamedTuple):
    """What the body must not touch, as kernels read it.

    Attributes:
        origin: (3,) lower corner of the grid in ``base`` [m]; voxel: edge [m].
        state: (nx, ny, nz) uint8; a voxel is solid where ``state`` is OCCUPIED, or UNKNOWN with
            ``avoid_unknown``.
        distance: (nx, ny, nz) float32 [m] proven lower bound of the distance from any point of a
            voxel to any solid cube.
        lower, upper: (3,) box that spheres must stay inside, in ``base`` [m].
        avoid_unknown: whether unknown voxels are solid.
        floor: a clearance below this is a collision [m].
    """

    origin: Floats
    voxel: float
    state: np.ndarray
    distance: np.ndarray
    lower: Floats
    upper: Floats
    avoid_unknown: bool
    floor: float


class Scratch(NamedTuple):
    """Working memory of one caller: (m, 3), (m, n), (m,), (QUEUE, 2), (n,) and a counter."""

    centers: Points
    travel: Floats
    clearance: Floats
    queue: Floats
    q: JointVector
    looks: Ints


def make_scratch(body: Body) -> Scratch:
    """Working memory for one thread."""
    m, n = body.lever.shape
    return Scratch(
        np.zeros((m, 3)),
        np.zeros((m, n)),
        np.zeros(m),
        np.zeros((QUEUE, 2)),
        np.zeros(n),
        np.zeros(1, np.int64),
    )


@njit(cache=True, nogil=True)
def body_centers(body: Body, q: JointVector, out: Points) -> None:
    """Write the (m, 3) sphere centres in ``base`` at (n,) joint positions."""
    r00, r01, r02 = 1.0, 0.0, 0.0
    r10, r11, r12 = 0.0, 1.0, 0.0
    r20, r21, r22 = 0.0, 0.0, 1.0
    x, y, z = 0.0, 0.0, 0.0
    for i in range(q.shape[0] + 1):
        if i > 0:
            o = body.offset[i - 1]
            A = body.rotation[i - 1]
            x += r00 * o[0] + r01 * o[1] + r02 * o[2]
            y += r10 * o[0] + r11 * o[1] + r12 * o[2]
            z += r20 * o[0] + r21 * o[1] + r22 * o[2]
            s, c = np.sin(q[i - 1]), np.cos(q[i - 1])
            a0 = r00 * A[0, 0] + r01 * A[1, 0] + r02 * A[2, 0]
            a1 = r00 * A[0, 1] + r01 * A[1, 1] + r02 * A[2, 1]
            a2 = r00 * A[0, 2] + r01 * A[1, 2] + r02 * A[2, 2]
            b0 = r10 * A[0, 0] + r11 * A[1, 0] + r12 * A[2, 0]
            b1 = r10 * A[0, 1] + r11 * A[1, 1] + r12 * A[2, 1]
            b2 = r10 * A[0, 2] + r11 * A[1, 2] + r12 * A[2, 2]
            d0 = r20 * A[0, 0] + r21 * A[1, 0] + r22 * A[2, 0]
            d1 = r20 * A[0, 1] + r21 * A[1, 1] + r22 * A[2, 1]
            d2 = r20 * A[0, 2] + r21 * A[1, 2] + r22 * A[2, 2]
            r00, r01, r02 = c * a0 + s * a1, c * a1 - s * a0, a2
            r10, r11, r12 = c * b0 + s * b1, c * b1 - s * b0, b2
            r20, r21, r22 = c * d0 + s * d1, c * d1 - s * d0, d2
        for k in range(body.first[i], body.first[i + 1]):
            p0, p1, p2 = body.center[k, 0], body.center[k, 1], body.center[k, 2]
            out[k, 0] = r00 * p0 + r01 * p1 + r02 * p2 + x
            out[k, 1] = r10 * p0 + r11 * p1 + r12 * p2 + y
            out[k, 2] = r20 * p0 + r21 * p1 + r22 * p2 + z


@njit(cache=True, nogil=True)
def exact_distance(
    ob: Obstacles, x: float, y: float, z: float, limit: float, enough: float
) -> float:
    """Distance [m] from a point to the nearest solid cube, or ``limit`` when none is nearer.

    Stops early, with any distance below ``enough``, once one is found.
    """
    nx, ny, nz = ob.state.shape
    h = ob.voxel
    gx, gy, gz = (x - ob.origin[0]) / h, (y - ob.origin[1]) / h, (z - ob.origin[2]) / h
    reach = limit / h
    x0, x1 = max(0, int(np.floor(gx - reach))), min(nx - 1, int(np.floor(gx + reach)))
    y0, y1 = max(0, int(np.floor(gy - reach))), min(ny - 1, int(np.floor(gy + reach)))
    best = reach * reach
    stop = (enough / h) ** 2 if enough > 0.0 else -1.0
    for ix in range(x0, x1 + 1):
        dx = max(ix - gx, gx - ix - 1.0, 0.0)
        if dx * dx >= best:
            continue
        for iy in range(y0, y1 + 1):
            dy = max(iy - gy, gy - iy - 1.0, 0.0)
            dxy = dx * dx + dy * dy
            if dxy >= best:
                continue
            span = np.sqrt(best - dxy)
            z0, z1 = max(0, int(np.floor(gz - span))), min(nz - 1, int(np.floor(gz + span)))
            for iz in range(z0, z1 + 1):
                s = ob.state[ix, iy, iz]
                if s == 2 or (s == 0 and ob.avoid_unknown):
                    dz = max(iz - gz, gz - iz - 1.0, 0.0)
                    d = dxy + dz * dz
                    if d < best:
                        best = d
                        if best < stop:
                            return np.sqrt(best) * h
    return np.sqrt(best) * h


@njit(cache=True, nogil=True)
def sphere_clearance(
    ob: Obstacles, x: float, y: float, z: float, radius: float, band: float
) -> float:
    """Clearance [m] of a sphere; exact where the field proves less than ``band``.

    Exact means the distance to the solid cubes, less the radius; at most ``band`` is said then.
    Negative values say "touches", not how deep. Leaving the box counts as touching its wall.
    """
    wall = min(
        x - ob.lower[0],
        ob.upper[0] - x,
        y - ob.lower[1],
        ob.upper[1] - y,
        z - ob.lower[2],
        ob.upper[2] - z,
    )
    wall -= radius
    if wall < ob.floor:
        return wall
    nx, ny, nz = ob.state.shape
    # Projection onto the grid's box is no farther from anything inside it: the bound still holds.
    ix = min(max(int(np.floor((x - ob.origin[0]) / ob.voxel)), 0), nx - 1)
    iy = min(max(int(np.floor((y - ob.origin[1]) / ob.voxel)), 0), ny - 1)
    iz = min(max(int(np.floor((z - ob.origin[2]) / ob.voxel)), 0), nz - 1)
    clear = ob.distance[ix, iy, iz] - radius
    if clear < band:
        clear = exact_distance(ob, x, y, z, radius + band, radius + ob.floor) - radius
    return min(clear, wall)


@njit(cache=True, nogil=True)
def sphere_clearances(
    ob: Obstacles, centers: Points, radius: Floats, band: float, out: Floats
) -> None:
    """Write the clearance of (m,) spheres."""
    for i in range(centers.shape[0]):
        out[i] = sphere_clearance(ob, centers[i, 0], centers[i, 1], centers[i, 2], radius[i], band)


@njit(cache=True, nogil=True)
def set_travel(body: Body, dq: JointVector, travel: Floats) -> None:
    """Write (m, n) ``travel[i, a]``: how far sphere i moves at most, seen from link a, for |dq|."""
    m, n = body.lever.shape
    for i in range(m):
        total = 0.0
        for j in range(n - 1, -1, -1):
            total += body.lever[i, j] * abs(dq[j])
            travel[i, j] = total


@njit(cache=True, nogil=True)
def free_span(body: Body, ob: Obstacles, q: JointVector, scratch: Scratch, enough: float) -> float:
    """How far (share of the motion in ``scratch.travel``) the body is proven free around q.

    Returns a value of at most ``enough``, or -1 when some clearance at q is below the floor.
    """
    scratch.looks[0] += 1
    centers = scratch.centers
    travel = scratch.travel
    body_centers(body, q, centers)
    span = enough
    band = ob.voxel
    for i in range(centers.shape[0]):
        clear = sphere_clearance(
            ob, centers[i, 0], centers[i, 1], centers[i, 2], body.radius[i], band
        )
        if clear < ob.floor:
            return -1.0
        if clear < span * travel[i, 0]:
            span = clear / travel[i, 0]
    for p in range(body.pairs.shape[0]):
        a, b = body.pairs[p, 0], body.pairs[p, 1]
        dx = centers[a, 0] - centers[b, 0]
        dy = centers[a, 1] - centers[b, 1]
        dz = centers[a, 2] - centers[b, 2]
        r = body.radius[a] + body.radius[b]
        t = travel[b, body.link[a]]
        need = r + max(span * t, ob.floor)
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < need * need:
            clear = np.sqrt(d2) - r
            if clear < ob.floor:
                return -1.0
            if clear < span * t:
                span = clear / t
    for p in range(body.pairs_fixed.shape[0]):
        a, b = body.pairs_fixed[p, 0], body.pairs_fixed[p, 1]
        dx = body.fixed_center[a, 0] - centers[b, 0]
        dy = body.fixed_center[a, 1] - centers[b, 1]
        dz = body.fixed_center[a, 2] - centers[b, 2]
        r = body.fixed_radius[a] + body.radius[b]
        t = travel[b, 0]
        need = r + max(span * t, ob.floor)
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < need * need:
            clear = np.sqrt(d2) - r
            if clear < ob.floor:
                return -1.0
            if clear < span * t:
                span = clear / t
    return span


@njit(cache=True, nogil=True)
def config_free(body: Body, ob: Obstacles, q: JointVector, scratch: Scratch) -> bool:
    """Whether nothing is touched at q (limits are not looked at)."""
    scratch.travel[:] = 0.0
    return free_span(body, ob, q, scratch, 1.0) >= 0.0


@njit(cache=True, nogil=True)
def edge_free(
    body: Body, ob: Obstacles, q0: JointVector, q1: JointVector, scratch: Scratch
) -> bool:
    """Whether the straight motion from q0 to q1 is proven free, ends included."""
    n = q0.shape[0]
    q = scratch.q
    for j in range(n):
        q[j] = q1[j] - q0[j]
    set_travel(body, q, scratch.travel)
    queue = scratch.queue
    queue[0, 0], queue[0, 1] = 0.0, 1.0
    head, count = 0, 1
    while count > 0:
        low, high = queue[head, 0], queue[head, 1]
        head = (head + 1) % QUEUE
        count -= 1
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        for j in range(n):
            q[j] = q0[j] + middle * (q1[j] - q0[j])
        span = free_span(body, ob, q, scratch, half)
        if span < 0.0:
            return False
        if span < half:
            if count + 2 > QUEUE:
                return False
            tail = (head + count) % QUEUE
            queue[tail, 0], queue[tail, 1] = low, middle - span
            tail = (tail + 1) % QUEUE
            queue[tail, 0], queue[tail, 1] = middle + span, high
            count += 2
    return True


@njit(cache=True, nogil=True)
def path_free(body: Body, ob: Obstacles, path: JointPath, scratch: Scratch) -> int:
    """Index of the first segment that is not proven free, or -1 when all are."""
    if path.shape[0] == 1:
        return -1 if config_free(body, ob, path[0], scratch) else 0
    for i in range(path.shape[0] - 1):
        if not edge_free(body, ob, path[i], path[i + 1], scratch):
            return i
    return -1


@njit(cache=True, nogil=True)
def self_clearance(body: Body, centers: Points) -> float:
    """Least distance [m] between spheres that may touch each other; inf where there are none."""
    best = np.inf
    for p in range(body.pairs.shape[0]):
        a, b = body.pairs[p, 0], body.pairs[p, 1]
        dx = centers[a, 0] - centers[b, 0]
        dy = centers[a, 1] - centers[b, 1]
        dz = centers[a, 2] - centers[b, 2]
        d = np.sqrt(dx * dx + dy * dy + dz * dz) - body.radius[a] - body.radius[b]
        best = min(best, d)
    for p in range(body.pairs_fixed.shape[0]):
        a, b = body.pairs_fixed[p, 0], body.pairs_fixed[p, 1]
        dx = body.fixed_center[a, 0] - centers[b, 0]
        dy = body.fixed_center[a, 1] - centers[b, 1]
        dz = body.fixed_center[a, 2] - centers[b, 2]
        d = np.sqrt(dx * dx + dy * dy + dz * dz) - body.fixed_radius[a] - body.radius[b]
        best = min(best, d)
    return best
