"""Compiled collision queries: body against the distance field, exact near things, proven motions.

All clearances are lower bounds in metres. A motion is proven with symmetric conservative
advancement: at the middle of an interval of the motion, sphere i has clearance c_i; from there it
travels at most L_i per unit of the parameter (worst levers), and also at most V_i s + B_i s^2 / 2
after s units (its velocity there, and a bound of its acceleration along the motion). So it is
proven free some way to both sides; what is left of the interval is queued. Rough places are met
early and free motions need few looks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, JointPath, JointVector, Points
from armsight.mapping.snapshot import OCCUPIED, UNKNOWN
from armsight.motion.body import Body
from armsight.motion.cable_kernels import NO_CABLE, CableWay, cable_free

PERMITTED = 4
"""A solid voxel in a region that some parts may touch: solid for all others. No state of the map's:
it stands beside those of :mod:`armsight.mapping.snapshot` in what kernels read."""
QUEUE = 4096
"""Intervals that one proof may hold open; a motion that needs more is refused."""
CHUNK = 8
"""Pieces of a trajectory that are proven together."""


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
        points, rows: solid points besides the cubes, see :class:`~armsight.motion.detail.Detail`.
        touching: (m,) bool, moving spheres for which PERMITTED voxels are free; (0,) for none.
        cable: that the arm drags, among the same things; for the planner's edges alone.
    """

    origin: Floats
    voxel: float
    state: np.ndarray
    distance: np.ndarray
    lower: Floats
    upper: Floats
    avoid_unknown: bool
    floor: float
    points: Floats32
    rows: Ints
    touching: np.ndarray
    cable: CableWay = NO_CABLE


class Scratch(NamedTuple):
    """Working memory of one caller.

    Attributes:
        centers: (m + f, 3) sphere centres; the last f never move and are filled in here.
        velocity: (m, 3) of the centres per unit of the motion's parameter.
        twist: (n + 1, 6) of the links: turning rate, and velocity of the link's material at the
            origin of ``base``.
        travel: (m, n) how far sphere i moves at most per unit, seen from link a.
        bend: (m, n) bound of the second derivative of centre i, seen from link a.
        link_travel: (n + 1, n) greatest ``travel`` of each link.
        clearance: (m,); queue: (QUEUE, 2) open intervals; q, dq: (n,); zero: (n,) zeros.
        looks: (1,) poses evaluated.
    """

    centers: Points
    velocity: Points
    twist: Floats
    travel: Floats
    bend: Floats
    link_travel: Floats
    clearance: Floats
    queue: Floats
    q: JointVector
    dq: JointVector
    zero: JointVector
    looks: Ints


def make_scratch(body: Body) -> Scratch:
    """Working memory for one thread."""
    m, n = body.lever.shape
    return Scratch(
        np.concatenate([np.zeros((m, 3)), body.fixed_center]),
        np.zeros((m, 3)),
        np.zeros((n + 1, 6)),
        np.zeros((m, n)),
        np.zeros((m, n)),
        np.zeros((n + 1, n)),
        np.zeros(m),
        np.zeros((QUEUE, 2)),
        np.zeros(n),
        np.zeros(n),
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
def body_motion(body: Body, q: JointVector, dq: JointVector, scratch: Scratch) -> None:
    """Write the sphere centres at q, and velocities and twists when joints move at dq."""
    out, velocity, twist = scratch.centers, scratch.velocity, scratch.twist
    r00, r01, r02 = 1.0, 0.0, 0.0
    r10, r11, r12 = 0.0, 1.0, 0.0
    r20, r21, r22 = 0.0, 0.0, 1.0
    x, y, z = 0.0, 0.0, 0.0
    wx, wy, wz = 0.0, 0.0, 0.0
    vx, vy, vz = 0.0, 0.0, 0.0
    for i in range(q.shape[0] + 1):
        if i > 0:
            o = body.offset[i - 1]
            A = body.rotation[i - 1]
            ox = r00 * o[0] + r01 * o[1] + r02 * o[2]
            oy = r10 * o[0] + r11 * o[1] + r12 * o[2]
            oz = r20 * o[0] + r21 * o[1] + r22 * o[2]
            x += ox
            y += oy
            z += oz
            vx += wy * oz - wz * oy
            vy += wz * ox - wx * oz
            vz += wx * oy - wy * ox
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
            # The joint turns about the link's z axis.
            wx += dq[i - 1] * r02
            wy += dq[i - 1] * r12
            wz += dq[i - 1] * r22
        twist[i, 0] = wx
        twist[i, 1] = wy
        twist[i, 2] = wz
        twist[i, 3] = vx - wy * z + wz * y
        twist[i, 4] = vy - wz * x + wx * z
        twist[i, 5] = vz - wx * y + wy * x
        for k in range(body.first[i], body.first[i + 1]):
            p0, p1, p2 = body.center[k, 0], body.center[k, 1], body.center[k, 2]
            px = r00 * p0 + r01 * p1 + r02 * p2
            py = r10 * p0 + r11 * p1 + r12 * p2
            pz = r20 * p0 + r21 * p1 + r22 * p2
            out[k, 0] = px + x
            out[k, 1] = py + y
            out[k, 2] = pz + z
            velocity[k, 0] = vx + wy * pz - wz * py
            velocity[k, 1] = vy + wz * px - wx * pz
            velocity[k, 2] = vz + wx * py - wy * px


@njit(cache=True, nogil=True)
def is_solid(ob: Obstacles, ix: int, iy: int, iz: int, touching: bool) -> bool:
    """Whether a voxel is solid; for what is ``touching`` PERMITTED is free."""
    s = ob.state[ix, iy, iz]
    unseen = s == UNKNOWN and ob.avoid_unknown
    return s == OCCUPIED or unseen or (s == PERMITTED and not touching)


@njit(cache=True, nogil=True)
def exact_distance(
    ob: Obstacles, x: float, y: float, z: float, limit: float, enough: float, touching: bool
) -> float:
    """Distance [m] to the nearest solid cube or point, or ``limit`` when none is nearer.

    Stops early, with any distance below ``enough``, once one is found. Rows of voxels are walked
    in the strides that the distance field allows. For what is ``touching`` PERMITTED is free.
    """
    nx, ny, nz = ob.state.shape
    scale = 1.0 / ob.voxel
    gx = (x - ob.origin[0]) * scale
    gy = (y - ob.origin[1]) * scale
    gz = (z - ob.origin[2]) * scale
    reach = limit * scale
    x0, x1 = max(0, int(np.floor(gx - reach))), min(nx - 1, int(np.floor(gx + reach)))
    y0, y1 = max(0, int(np.floor(gy - reach))), min(ny - 1, int(np.floor(gy + reach)))
    best = reach * reach
    stop = (enough * scale) ** 2
    detailed = ob.rows.shape[0] > 0
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
            iz, z1 = max(0, int(np.floor(gz - span))), min(nz - 1, int(np.floor(gz + span)))
            while iz <= z1:
                if is_solid(ob, ix, iy, iz, touching):
                    dz = max(iz - gz, gz - iz - 1.0, 0.0)
                    d = dxy + dz * dz
                    if d < best:
                        best = d
                        if best < stop:
                            return np.sqrt(best) * ob.voxel
                    iz += 1
                else:
                    # Cubes whose gap to this one is less than the bound cannot be solid.
                    iz += 1 + int(ob.distance[ix, iy, iz] * scale - 1e-3)
            if detailed:
                best = _nearest_in_row(ob, ix * ny + iy, x, y, z, best)
                if best < stop:
                    return np.sqrt(best) * ob.voxel
    # To the bit: callers compare with the limit, and rounding must not bring it nearer.
    return np.sqrt(best) * ob.voxel if best < reach * reach else limit


@njit(cache=True, nogil=True)
def _nearest_in_row(ob: Obstacles, row: int, x: float, y: float, z: float, best: float) -> float:
    """Least of ``best`` and the squared distance to the points of a row, in squares of voxels."""
    low, end = ob.rows[row], ob.rows[row + 1]
    if low == end:
        return best
    scale2 = 1.0 / (ob.voxel * ob.voxel)
    bottom = z - np.sqrt(best) * ob.voxel
    high = end
    while low < high:
        middle = (low + high) // 2
        if ob.points[middle, 2] < bottom:
            low = middle + 1
        else:
            high = middle
    for k in range(low, end):
        dz = ob.points[k, 2] - z
        if dz > 0.0 and dz * dz * scale2 >= best:
            break
        dx, dy = ob.points[k, 0] - x, ob.points[k, 1] - y
        best = min(best, (dx * dx + dy * dy + dz * dz) * scale2)
    return best


@njit(cache=True, nogil=True)
def wall_clearance(ob: Obstacles, x: float, y: float, z: float, radius: float) -> float:
    """Room [m] between a sphere and the walls of the box that it must stay inside."""
    wall = min(x - ob.lower[0], ob.upper[0] - x)
    wall = min(wall, min(y - ob.lower[1], ob.upper[1] - y))
    return min(wall, min(z - ob.lower[2], ob.upper[2] - z)) - radius


@njit(cache=True, nogil=True)
def field_at(ob: Obstacles, x: float, y: float, z: float) -> float:
    """The distance field at a point [m].

    A point outside the grid takes the value of its projection onto the grid's box, which is no
    farther from anything inside: the bound still holds.
    """
    nx, ny, nz = ob.distance.shape
    scale = 1.0 / ob.voxel
    ix = int(min(max((x - ob.origin[0]) * scale, 0.0), nx - 1.0))
    iy = int(min(max((y - ob.origin[1]) * scale, 0.0), ny - 1.0))
    iz = int(min(max((z - ob.origin[2]) * scale, 0.0), nz - 1.0))
    return ob.distance[ix, iy, iz]


@njit(cache=True, nogil=True)
def may_touch(ob: Obstacles, sphere: int) -> bool:
    """Whether PERMITTED voxels are free for a moving sphere."""
    return sphere < ob.touching.shape[0] and ob.touching[sphere]


@njit(cache=True, nogil=True)
def sphere_clearances(ob: Obstacles, centers: Points, radius: Floats, out: Floats) -> None:
    """Write the clearance [m] of (m,) spheres.

    Exact within a voxel of contact (the distance to the solid cubes, less the radius; negative
    says "touches", not how deep); a lower bound of at least one voxel farther away. Leaving the
    box counts as touching its wall.
    """
    for i in range(out.shape[0]):
        x, y, z, r = centers[i, 0], centers[i, 1], centers[i, 2], radius[i]
        clear = field_at(ob, x, y, z) - r
        if clear < ob.voxel:
            clear = exact_distance(ob, x, y, z, r + ob.voxel, 0.0, may_touch(ob, i)) - r
        out[i] = min(clear, wall_clearance(ob, x, y, z, r))


@njit(cache=True, nogil=True)
def set_bounds(body: Body, speed: Floats, acceleration: Floats, scratch: Scratch) -> None:
    """Bound how spheres move while joints move at no more than (n,) speeds and accelerations.

    ``bend`` bounds |c''|, c'' = sum_j q''_j a_j x (c - p_j) + sum_jk q'_j q'_k a_j x (a_k x
    (c - p_k)) with k the outer joint of the two and a the axes, by levers.
    """
    m, n = body.lever.shape
    scratch.link_travel[:] = 0.0
    for i in range(m):
        link = body.link[i]
        total = 0.0
        for j in range(n - 1, -1, -1):
            total += body.lever[i, j] * speed[j]
            scratch.travel[i, j] = total
            if total > scratch.link_travel[link, j]:
                scratch.link_travel[link, j] = total
        for a in range(n):
            inner = 0.0
            bend = 0.0
            for k in range(a, min(link, n)):
                bend += body.lever[i, k] * (acceleration[k] + speed[k] * (speed[k] + 2.0 * inner))
                inner += speed[k]
            scratch.bend[i, a] = bend


@njit(cache=True, nogil=True)
def surroundings_span(
    body: Body, ob: Obstacles, q: JointVector, scratch: Scratch, enough: float
) -> float:
    """How far the body is proven free of the surroundings, to both sides of q on a motion.

    Needs :func:`set_bounds`. Returns a share of the motion of at most ``enough``, or -1 when some
    clearance at q is below the floor.
    """
    scratch.looks[0] += 1
    centers, clearance, travel, bend = (
        scratch.centers,
        scratch.clearance,
        scratch.travel,
        scratch.bend,
    )
    velocity, radius, field = scratch.velocity, body.radius, ob.distance
    body_motion(body, q, scratch.dq, scratch)
    nx, ny, nz = field.shape
    scale = 1.0 / ob.voxel
    voxel, floor = ob.voxel, ob.floor
    ox, oy, oz = ob.origin[0], ob.origin[1], ob.origin[2]
    lx, ly, lz = ob.lower[0], ob.lower[1], ob.lower[2]
    ux, uy, uz = ob.upper[0], ob.upper[1], ob.upper[2]
    span = enough
    # The field first: it is cheap, and shortens the span that exact looks must prove.
    for i in range(radius.shape[0]):
        x, y, z, r = centers[i, 0], centers[i, 1], centers[i, 2], radius[i]
        ix = int(min(max((x - ox) * scale, 0.0), nx - 1.0))
        iy = int(min(max((y - oy) * scale, 0.0), ny - 1.0))
        iz = int(min(max((z - oz) * scale, 0.0), nz - 1.0))
        clear = field[ix, iy, iz] - r
        clearance[i] = clear
        if clear < voxel:
            clear = voxel
        wall = min(min(min(x - lx, ux - x), min(y - ly, uy - y)), min(z - lz, uz - z)) - r
        if wall < clear:
            if wall < floor:
                return -1.0
            clear = wall
        if clear < span * travel[i, 0]:
            span = shorter(span, clear, travel[i, 0], velocity[i], bend[i, 0])
    for i in range(radius.shape[0]):
        if clearance[i] >= voxel:
            continue
        v = velocity[i]
        speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        need = min(travel[i, 0] * span, (speed + 0.5 * bend[i, 0] * span) * span)
        need = min(max(need, floor), voxel)
        if clearance[i] < need:
            r = radius[i]
            distance = exact_distance(
                ob, centers[i, 0], centers[i, 1], centers[i, 2], r + need, r + floor,
                may_touch(ob, i),
            )  # fmt: skip
            # Not "distance - r < floor": the difference may round below a floor that is kept.
            if distance < r + floor:
                return -1.0
            if distance < r + need:
                span = shorter(span, distance - r, travel[i, 0], v, bend[i, 0])
    return span


@njit(cache=True, nogil=True)
def shorter(span: float, clear: float, travel: float, velocity: Floats, bend: float) -> float:
    """The part of a span in which a sphere cannot move farther than its clearance."""
    speed2 = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    # Solves clear = speed s + bend s^2 / 2, in the form that is stable for small bend.
    down = np.sqrt(speed2) + np.sqrt(speed2 + 2.0 * bend * clear)
    best = clear / travel
    if down > 0.0:
        best = max(best, 2.0 * clear / down)
    return min(span, best)


@njit(cache=True, nogil=True)
def own_span(body: Body, floor: float, q: JointVector, scratch: Scratch, enough: float) -> float:
    """How far the body is proven not to touch itself; as :func:`surroundings_span`.

    Only motion along the line between two centres brings them nearer, up to the bend.
    """
    scratch.looks[0] += 1
    centers, twist = scratch.centers, scratch.twist
    body_motion(body, q, scratch.dq, scratch)
    span = enough
    for g in range(body.groups.shape[0]):
        link_a, link_b = body.groups[g, 0], body.groups[g, 1]
        a, b = body.groups[g, 2], body.groups[g, 3]
        dx = centers[b, 0] - centers[a, 0]
        dy = centers[b, 1] - centers[a, 1]
        dz = centers[b, 2] - centers[a, 2]
        need = body.group_reach[g] + max(span * scratch.link_travel[link_b, link_a], floor)
        if dx * dx + dy * dy + dz * dz >= need * need:
            continue
        # The motion of link b seen from link a.
        wx = twist[link_b, 0] - twist[link_a, 0]
        wy = twist[link_b, 1] - twist[link_a, 1]
        wz = twist[link_b, 2] - twist[link_a, 2]
        vx = twist[link_b, 3] - twist[link_a, 3]
        vy = twist[link_b, 4] - twist[link_a, 4]
        vz = twist[link_b, 5] - twist[link_a, 5]
        for p in range(body.groups[g, 4], body.groups[g, 5]):
            a, b = body.pairs[p, 0], body.pairs[p, 1]
            x, y, z = centers[b, 0], centers[b, 1], centers[b, 2]
            dx = x - centers[a, 0]
            dy = y - centers[a, 1]
            dz = z - centers[a, 2]
            r = body.pair_radius[p]
            travel = scratch.travel[b, link_a]
            need = r + max(span * travel, floor)
            d2 = dx * dx + dy * dy + dz * dz
            if d2 >= need * need:
                continue
            d = np.sqrt(d2)
            clear = d - r
            if clear < floor:
                return -1.0
            closing = (
                abs(
                    (vx + wy * z - wz * y) * dx
                    + (vy + wz * x - wx * z) * dy
                    + (vz + wx * y - wy * x) * dz
                )
                / d
            )
            bend = scratch.bend[b, link_a]
            if clear < (closing + 0.5 * bend * span) * span:
                down = closing + np.sqrt(closing * closing + 2.0 * bend * clear)
                span = min(span, max(clear / travel, 2.0 * clear / down))
    return span


@njit(cache=True, nogil=True)
def config_free(body: Body, ob: Obstacles, q: JointVector, scratch: Scratch) -> bool:
    """Whether nothing is touched at q (limits are not looked at)."""
    scratch.dq[:] = 0.0
    scratch.travel[:] = 0.0
    scratch.bend[:] = 0.0
    scratch.link_travel[:] = 0.0
    return (
        surroundings_span(body, ob, q, scratch, 1.0) >= 0.0
        and own_span(body, ob.floor, q, scratch, 1.0) >= 0.0
    )


@njit(cache=True, nogil=True)
def edge_free(
    body: Body, ob: Obstacles, q0: JointVector, q1: JointVector, scratch: Scratch
) -> bool:
    """Whether the straight motion from q0 to q1 is proven free, ends included.

    A cable is looked at in steps (:mod:`armsight.motion.cable_kernels`).
    """
    _set_edge_bounds(body, q0, q1, scratch)
    # Two proofs: the body seldom comes near itself, so that one needs a few looks only.
    return (
        _edge_proven(body, ob, q0, q1, scratch, False)
        and _edge_proven(body, ob, q0, q1, scratch, True)
        and cable_free(ob.cable, q0, q1, scratch.looks)
    )


@njit(cache=True, nogil=True)
def _set_edge_bounds(body: Body, q0: JointVector, q1: JointVector, scratch: Scratch) -> None:
    speed, zero = scratch.q, scratch.zero
    for j in range(q0.shape[0]):
        scratch.dq[j] = q1[j] - q0[j]
        speed[j] = abs(scratch.dq[j])
    set_bounds(body, speed, zero, scratch)


@njit(cache=True, nogil=True)
def _edge_proven(
    body: Body, ob: Obstacles, q0: JointVector, q1: JointVector, scratch: Scratch, own: bool
) -> bool:
    q, queue = scratch.q, scratch.queue
    queue[0, 0], queue[0, 1] = 0.0, 1.0
    head, count = 0, 1
    while count > 0:
        low, high = queue[head, 0], queue[head, 1]
        head = (head + 1) % QUEUE
        count -= 1
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        for j in range(q.shape[0]):
            q[j] = q0[j] + middle * (q1[j] - q0[j])
        if own:
            span = own_span(body, ob.floor, q, scratch, half)
        else:
            span = surroundings_span(body, ob, q, scratch, half)
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
def trajectory_blocked(
    body: Body,
    ob: Obstacles,
    times: Floats,
    q: JointPath,
    qd: JointPath,
    qdd: JointPath,
    jerk: JointPath,
    begin: float,
    until: float,
    scratch: Scratch,
) -> float:
    """First time found [s] from which a trajectory is not proven free, or -1 when all of it is.

    The arrays are those of :class:`~armsight.motion.trajectory.Trajectory`. Some pieces at a time
    are proven together, with the greatest speeds and accelerations met in them.
    """
    n = q.shape[1]
    speed, acceleration = np.empty(n), np.empty(n)
    k, pieces = 0, jerk.shape[0]
    if pieces == 0:
        return -1.0 if config_free(body, ob, q[0], scratch) else 0.0
    while k < pieces and times[k] < until:
        if times[k + 1] <= begin:
            k += 1
            continue
        first = k
        speed[:] = 0.0
        acceleration[:] = 0.0
        while k < pieces and times[k] < until and (k == first or k - first < CHUNK):
            dt = times[k + 1] - times[k]
            for j in range(n):
                # Bezier points of the piece's quadratic velocity: the curve stays between them.
                middle = qd[k, j] + 0.5 * dt * qdd[k, j]
                v = max(abs(qd[k, j]), max(abs(middle), abs(qd[k + 1, j])))
                speed[j] = max(speed[j], v)
                acceleration[j] = max(acceleration[j], max(abs(qdd[k, j]), abs(qdd[k + 1, j])))
            k += 1
        low, high = max(begin, times[first]), min(until, times[k])
        set_bounds(body, speed, acceleration, scratch)
        for own in (False, True):
            t = _pieces_blocked(
                body, ob, times, q, qd, qdd, jerk, first, k, low, high, own, scratch
            )
            if t >= 0.0:
                return t
    return -1.0


@njit(cache=True, nogil=True)
def _pieces_blocked(
    body: Body,
    ob: Obstacles,
    times: Floats,
    q: JointPath,
    qd: JointPath,
    qdd: JointPath,
    jerk: JointPath,
    first: int,
    last: int,
    begin: float,
    until: float,
    own: bool,
    scratch: Scratch,
) -> float:
    queue, now, rate = scratch.queue, scratch.q, scratch.dq
    queue[0, 0], queue[0, 1] = begin, until
    head, count = 0, 1
    while count > 0:
        low, high = queue[head, 0], queue[head, 1]
        head = (head + 1) % QUEUE
        count -= 1
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        k = first
        while k + 1 < last and times[k + 1] <= middle:
            k += 1
        dt = middle - times[k]
        for j in range(now.shape[0]):
            now[j] = q[k, j] + dt * (qd[k, j] + dt * (0.5 * qdd[k, j] + dt * jerk[k, j] / 6.0))
            rate[j] = qd[k, j] + dt * (qdd[k, j] + 0.5 * dt * jerk[k, j])
        if own:
            span = own_span(body, ob.floor, now, scratch, half)
        else:
            span = surroundings_span(body, ob, now, scratch, half)
        if span < 0.0:
            return middle
        if span < half:
            if count + 2 > QUEUE:
                return middle
            tail = (head + count) % QUEUE
            queue[tail, 0], queue[tail, 1] = low, middle - span
            tail = (tail + 1) % QUEUE
            queue[tail, 0], queue[tail, 1] = middle + span, high
            count += 2
    return -1.0


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
def path_clear(body: Body, ob: Obstacles, path: JointPath, scratch: Scratch) -> int:
    """As :func:`path_free`, against the surroundings alone; for a path of two places or more."""
    for i in range(path.shape[0] - 1):
        _set_edge_bounds(body, path[i], path[i + 1], scratch)
        if not _edge_proven(body, ob, path[i], path[i + 1], scratch, False):
            return i
    return -1


@njit(cache=True, nogil=True)
def self_clearance(body: Body, centers: Points) -> float:
    """Least distance [m] between spheres that may touch each other; inf where there are none."""
    pair = nearest_pair(body, centers)
    return pair_gap(body, centers, pair) if pair >= 0 else np.inf


@njit(cache=True, nogil=True)
def nearest_pair(body: Body, centers: Points) -> int:
    """Which pair of spheres that may touch each other is nearest to it; -1 where there are none."""
    best, nearest = np.inf, -1
    for p in range(body.pairs.shape[0]):
        gap = pair_gap(body, centers, p)
        if gap < best:
            best, nearest = gap, p
    return nearest


@njit(cache=True, nogil=True)
def pair_gap(body: Body, centers: Points, pair: int) -> float:
    """Distance [m] of the spheres of one pair that may touch each other."""
    a, b = body.pairs[pair, 0], body.pairs[pair, 1]
    dx = centers[a, 0] - centers[b, 0]
    dy = centers[a, 1] - centers[b, 1]
    dz = centers[a, 2] - centers[b, 2]
    return float(np.sqrt(dx * dx + dy * dy + dz * dz) - body.pair_radius[pair])
