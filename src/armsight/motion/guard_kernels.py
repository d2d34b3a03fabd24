"""Compiled search for the hazards that limit the arm's speed: exact, nothing sampled away.

Hazards are sorted into cubic blocks with tight bounds once a snapshot; a search skips the blocks
that provably hold nothing that matters. Plain-numpy twins are in the tests.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, JointVector, Points, Poses

ROUNDING = 1e-5
"""More than what distances of blocks lose by being float32 [m]."""


AMPLE = 2.0
"""A hazard that allows this many times the motion need not be found."""


class Blocks(NamedTuple):
    """Hazards sorted by block.

    Attributes:
        points: (h, 3) float32 centres in ``base`` [m], block after block.
        order: (h,) index of each in the snapshot's ``hazards``.
        first: (b + 1,) points ``first[k]:first[k + 1]`` are block k's.
        lower, upper: (3, b) float32 bounds of each block's points [m], one row an axis.
    """

    points: Floats32
    order: Ints
    first: Ints
    lower: Floats32
    upper: Floats32


class Law(NamedTuple):
    """Numbers of the separation law; see :mod:`armsight.motion.separation`.

    Attributes:
        person: v_h [m/s].
        K: C + Z_d + Z_r [m].
        T_person: T_r: time for which the person comes nearer before the arm brakes [s].
        T_arm: T_a: time for which the arm goes on, as commanded, before it brakes [s].
        hazard_radius: half diagonal of a hazard's cube [m].
        retreat: speed of the fastest point at which the arm may always move away [m/s].
    """

    person: float
    K: float
    T_person: float
    T_arm: float
    hazard_radius: float
    retreat: float


@njit(cache=True, nogil=True)
def sort_into_blocks(hazards: Floats32, size: float) -> Blocks:
    """Sort (h, 3) hazards into cubes of edge ``size`` [m]."""
    h = hazards.shape[0]
    lo0 = lo1 = lo2 = np.float32(np.inf)
    hi0 = hi1 = hi2 = np.float32(-np.inf)
    for i in range(h):
        x, y, z = hazards[i, 0], hazards[i, 1], hazards[i, 2]
        lo0, lo1, lo2 = min(lo0, x), min(lo1, y), min(lo2, z)
        hi0, hi1, hi2 = max(hi0, x), max(hi1, y), max(hi2, z)
    if h == 0:
        return Blocks(
            np.empty((0, 3), np.float32),
            np.empty(0, np.int64),
            np.zeros(1, np.int64),
            np.empty((3, 0), np.float32),
            np.empty((3, 0), np.float32),
        )
    per = 1.0 / size
    nx = int((hi0 - lo0) * per) + 1
    ny = int((hi1 - lo1) * per) + 1
    nz = int((hi2 - lo2) * per) + 1
    cell = np.empty(h, np.int32)
    count = np.zeros(nx * ny * nz + 1, np.int64)
    for i in range(h):
        cx = int((hazards[i, 0] - lo0) * per)
        cy = int((hazards[i, 1] - lo1) * per)
        cz = int((hazards[i, 2] - lo2) * per)
        cell[i] = (cx * ny + cy) * nz + cz
        count[cell[i] + 1] += 1
    blocks = 0
    for c in range(nx * ny * nz):
        if count[c + 1] > 0:
            blocks += 1
        count[c + 1] += count[c]
    first = np.empty(blocks + 1, np.int64)
    k = 0
    for c in range(nx * ny * nz):
        if count[c + 1] > count[c]:
            first[k] = count[c]
            k += 1
    first[blocks] = h
    points = np.empty((h, 3), np.float32)
    order = np.empty(h, np.int64)
    for i in range(h):
        at = count[cell[i]]
        count[cell[i]] += 1
        order[at] = i
        points[at, 0] = hazards[i, 0]
        points[at, 1] = hazards[i, 1]
        points[at, 2] = hazards[i, 2]
    lower = np.empty((3, blocks), np.float32)
    upper = np.empty((3, blocks), np.float32)
    for k in range(blocks):
        lo0, lo1, lo2 = points[first[k], 0], points[first[k], 1], points[first[k], 2]
        hi0, hi1, hi2 = lo0, lo1, lo2
        for i in range(first[k] + 1, first[k + 1]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            lo0, lo1, lo2 = min(lo0, x), min(lo1, y), min(lo2, z)
            hi0, hi1, hi2 = max(hi0, x), max(hi1, y), max(hi2, z)
        lower[0, k], lower[1, k], lower[2, k] = lo0, lo1, lo2
        upper[0, k], upper[1, k], upper[2, k] = hi0, hi1, hi2
    return Blocks(points, order, first, lower, upper)


@njit(cache=True, nogil=True)
def allowed_share(
    distance: float, closing: float, fastest: float, stopping: float, law: Law
) -> float:
    """Share of a motion that separation allows to one moving part in view of one hazard.

    The motion at share s closes in at ``s closing`` and needs ``s stopping`` to stop; the share is
    the root of ``D = v_h (T_r + s T_s) + s v_r T_a + s^2 v_r T_s / 2 + K``.

    A part that does not close in is held to the same with v_r = 0, so that it stands before
    anybody reaches it; but it may always leave at the speed at which an arm counts as standing.

    Args:
        distance: D from the part's surface to the hazard's [m].
        closing: speed towards the hazard of the whole motion [m/s]; negative when receding.
        fastest: speed of the arm's fastest point [m/s]; above 0.
        stopping: time to stop from the whole motion [s].
        law: numbers of the law.
    """
    spare = distance - law.K - law.person * law.T_person
    share = 0.0
    towards = max(closing, 0.0)
    if spare > 0.0:
        b = law.person * stopping + towards * law.T_arm
        root = b + np.sqrt(b * b + 2.0 * towards * stopping * spare)
        share = 2.0 * spare / root if root > 0.0 else np.inf
    if closing <= 0.0:
        share = max(share, law.retreat / fastest)
    return share


@njit(cache=True, nogil=True)
def protective(closing: float, stopping: float, law: Law) -> float:
    """S_p [m] of one part in view of one hazard, for the motion as it is."""
    towards = max(closing, 0.0)
    time = law.T_person + stopping
    return law.person * time + towards * (law.T_arm + 0.5 * stopping) + law.K


@njit(cache=True, nogil=True)
def _square_gaps(lower: Floats32, upper: Floats32, x: Any, out: Floats32) -> None:
    """Add the squared gap between a coordinate and each interval [m^2]."""
    zero = np.float32(0.0)
    for k in range(out.shape[0]):
        below = lower[k] - x
        above = x - upper[k]
        gap = below if below > above else above
        gap = gap if gap > zero else zero
        out[k] += gap * gap


@njit(cache=True, nogil=True)
def scan(
    blocks: Blocks,
    center: Points,
    radius: Floats,
    velocity: Points,
    stopping: Floats,
    fastest: float,
    law: Law,
    horizon: float,
    distance: Floats,
    nearest: Ints,
    share: Floats,
    limiting: Ints,
) -> None:
    """Nearest hazard and allowed share of the motion for each of (m,) spheres.

    Args:
        blocks: the hazards.
        center: (m, 3) [m].
        radius: (m,) [m].
        velocity: (m, 3) of the whole motion [m/s].
        stopping: (m,) its stopping time [s].
        fastest: speed of the arm's fastest point [m/s].
        law: numbers of the law.
        horizon: farther hazards are of no interest unless they limit the motion [m].
        distance: (m,) out: to the nearest hazard [m], inf beyond the horizon.
        nearest: (m,) out: index into ``blocks.points``, -1 for none.
        share: (m,) out: allowed share of the motion; inf, or at least ``AMPLE``, if unlimited.
        limiting: (m,) out: index of the hazard that limits it, -1 for none.
    """
    count = blocks.lower.shape[1]
    bound = np.empty(count, np.float32)
    for i in range(center.shape[0]):
        x, y, z = center[i, 0], center[i, 1], center[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        skin = radius[i] + law.hazard_radius
        speed = np.sqrt(vx * vx + vy * vy + vz * vz)
        best = horizon
        best_index = -1
        least = np.inf
        least_index = -1
        # Farther than this the whole motion is allowed, whatever its direction.
        cut = law.K + speed * (law.T_arm + 0.5 * stopping[i])
        cut += law.person * (law.T_person + stopping[i])
        if speed <= 0.0:
            cut = -np.inf
        bound[:] = np.float32(0.0)
        for axis in range(3):
            at = np.float32(center[i, axis])
            _square_gaps(blocks.lower[axis], blocks.upper[axis], at, bound)
        first = int(np.argmin(bound)) if count else -1
        # The nearest block comes first: what it holds rules out most of the others.
        for turn in range(-1, count):
            k = first if turn < 0 else turn
            if turn == first or k < 0:
                continue
            reach = max(cut, best) + skin + ROUNDING
            if bound[k] > reach * reach:
                continue
            gap = np.sqrt(bound[k])
            near = gap - skin - ROUNDING
            if near >= best:
                if near >= cut:
                    continue
                # No point of the block is closed in on faster than this.
                towards = max((blocks.lower[0, k] - x) * vx, (blocks.upper[0, k] - x) * vx)
                towards += max((blocks.lower[1, k] - y) * vy, (blocks.upper[1, k] - y) * vy)
                towards += max((blocks.lower[2, k] - z) * vz, (blocks.upper[2, k] - z) * vz)
                closing = speed
                if gap > 10.0 * ROUNDING:
                    closing = min(max(towards, 0.0) / (gap - ROUNDING), speed)
                share_k = allowed_share(near, closing, fastest, stopping[i], law)
                if share_k >= min(least, AMPLE):
                    continue
            for p in range(blocks.first[k], blocks.first[k + 1]):
                ex = blocks.points[p, 0] - x
                ey = blocks.points[p, 1] - y
                ez = blocks.points[p, 2] - z
                away = np.sqrt(ex * ex + ey * ey + ez * ez)
                d = away - skin
                if d < best:
                    best = d
                    best_index = p
                if d < cut:
                    # At the very centre every direction closes in.
                    closing = speed
                    if away > 1e-9:
                        closing = (ex * vx + ey * vy + ez * vz) / away
                    s = allowed_share(d, closing, fastest, stopping[i], law)
                    if s < least:
                        least = s
                        least_index = p
        distance[i] = best if best_index >= 0 else np.inf
        nearest[i] = best_index
        share[i] = least
        limiting[i] = least_index


@njit(cache=True, nogil=True)
def in_reach(
    blocks: Blocks,
    places: Floats,
    radius: Floats,
    times: Floats,
    until: Floats,
    law: Law,
) -> int:
    """A sphere that somebody could reach before a stop has ended; -1 if there is none.

    That is a sphere i for which, at a look k before it stands and for a hazard h, the distance
    between them is less than what the person comes nearer until then and the margin:
    ``|h - x_ik| - r_i < v_h (T_r + t_k) + K``.

    Args:
        blocks: the hazards.
        places: (k, m, 3) where the spheres are in the course of the stop [m].
        radius: (m,) [m].
        times: (k,) of the looks, from the beginning of the stop [s].
        until: (m,) when each sphere stands [s]; one that does not move is not looked at.
        law: numbers of the law.
    """
    looks, count = places.shape[0], blocks.lower.shape[1]
    gaps = np.empty(count, np.float32)
    need = np.empty(looks)
    for i in range(places.shape[1]):
        if until[i] <= 0.0:
            continue
        farthest = 0.0
        for k in range(looks):
            need[k] = radius[i] + law.hazard_radius + law.K
            need[k] += law.person * (law.T_person + min(times[k], until[i]))
            dx = places[k, i, 0] - places[0, i, 0]
            dy = places[k, i, 1] - places[0, i, 1]
            dz = places[k, i, 2] - places[0, i, 2]
            farthest = max(farthest, need[k] + np.sqrt(dx * dx + dy * dy + dz * dz))
        gaps[:] = np.float32(0.0)
        for axis in range(3):
            at = np.float32(places[0, i, axis])
            _square_gaps(blocks.lower[axis], blocks.upper[axis], at, gaps)
        reach = farthest + ROUNDING
        for b in range(count):
            if gaps[b] > reach * reach:
                continue
            for p in range(blocks.first[b], blocks.first[b + 1]):
                for k in range(looks):
                    ex = blocks.points[p, 0] - places[k, i, 0]
                    ey = blocks.points[p, 1] - places[k, i, 1]
                    ez = blocks.points[p, 2] - places[k, i, 2]
                    if ex * ex + ey * ey + ez * ez < need[k] * need[k]:
                        return i
    return -1


@njit(cache=True, nogil=True)
def fastest_point(
    poses: Poses, axis: Points, link: Ints, radius: Floats, q_dot: JointVector, velocity: Points
) -> float:
    """No point of (m,) spheres fixed to links is faster than this [m/s].

    A sphere's surface turns about its centre with the link.

    Args:
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        link: (m,) that carries each sphere.
        radius: (m,) [m].
        q_dot: (n,) [rad/s].
        velocity: (m, 3) of the centres [m/s].
    """
    n = axis.shape[0]
    spin = np.zeros(n + 1)
    wx, wy, wz = 0.0, 0.0, 0.0
    for j in range(n):
        T = poses[j + 1]
        x, y, z = q_dot[j] * axis[j, 0], q_dot[j] * axis[j, 1], q_dot[j] * axis[j, 2]
        wx += T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
        wy += T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
        wz += T[2, 0] * x + T[2, 1] * y + T[2, 2] * z
        spin[j + 1] = np.sqrt(wx * wx + wy * wy + wz * wz)
    fastest = 0.0
    for k in range(link.shape[0]):
        vx, vy, vz = velocity[k, 0], velocity[k, 1], velocity[k, 2]
        speed = np.sqrt(vx * vx + vy * vy + vz * vz) + radius[k] * spin[link[k]]
        fastest = max(fastest, speed)
    return fastest


@njit(cache=True, nogil=True)
def drive_ahead(
    q: JointVector,
    q_dot: JointVector,
    until: Floats,
    target: Points,
    braking: np.ndarray,
    acceleration: JointVector,
    brake: JointVector,
    start: float,
) -> None:
    """Move (n,) joints in place through commands that are on their way.

    Each joint ramps towards the command in force; the last command holds until its time.

    Args:
        q: (n,) positions at ``start`` [rad], overwritten by those at ``until[-1]``.
        q_dot: (n,) velocities [rad/s], likewise.
        until: (k,) end of each command's time [s].
        target: (k, n) commanded velocities [rad/s].
        braking: (k,) bool, a stop instead of a command.
        acceleration: (n,) ramp of commands [rad/s^2].
        brake: (n,) ramp of stops [rad/s^2].
        start: time of the state [s].
    """
    t = start
    for k in range(until.shape[0]):
        dt = until[k] - t
        if dt <= 0.0:
            continue
        for j in range(q.shape[0]):
            a = brake[j] if braking[k] else acceleration[j]
            wanted = 0.0 if braking[k] else target[k, j]
            change = wanted - q_dot[j]
            ramp = min(abs(change) / a, dt) if a > 0.0 else 0.0
            signed = a if change > 0.0 else -a
            q[j] += q_dot[j] * ramp + 0.5 * signed * ramp * ramp
            q_dot[j] += signed * ramp
            if ramp < dt:
                q_dot[j] = wanted
                q[j] += wanted * (dt - ramp)
        t = until[k]


@njit(cache=True, nogil=True)
def stop_path(q: JointVector, q_dot: JointVector, brake: JointVector, pieces: int) -> Points:
    """(pieces + 1, n) positions while every joint brakes as hard as it can, ends included."""
    n = q.shape[0]
    longest = 0.0
    for j in range(n):
        longest = max(longest, abs(q_dot[j]) / brake[j])
    out = np.empty((pieces + 1, n))
    for k in range(pieces + 1):
        t = longest * k / pieces
        for j in range(n):
            own = min(t, abs(q_dot[j]) / brake[j])
            slow = brake[j] if q_dot[j] > 0.0 else -brake[j]
            out[k, j] = q[j] + q_dot[j] * own - 0.5 * slow * own * own
    return out


@njit(cache=True, nogil=True)
def stopping_times(q_dot: JointVector, brake: JointVector, link: Ints, out: Floats) -> None:
    """Write (m,) seconds until everything that moves each sphere's link has stopped."""
    n = q_dot.shape[0]
    until = np.zeros(n + 1)
    for j in range(n):
        until[j + 1] = max(until[j], abs(q_dot[j]) / brake[j])
    for k in range(link.shape[0]):
        out[k] = until[link[k]]


@njit(cache=True, nogil=True)
def limiting_rows(
    poses: Poses,
    axis: Points,
    link: Ints,
    center: Points,
    velocity: Points,
    share: Floats,
    hazard: Points,
    tight: Ints,
) -> tuple[Points, Floats]:
    """Rows and bounds that hold spheres to what limits them: ``rows @ q' <= bounds``.

    A row is the closing speed of a sphere towards its most limiting hazard by each joint's speed;
    its bound is the share that is allowed of the present one. Spheres that do not close in have
    none.

    Args:
        poses: (n + 1, 4, 4) of the links.
        axis: (n, 3) of the joints.
        link: (m,) that carries each sphere.
        center: (m, 3) of the spheres [m].
        velocity: (m, 3) of the spheres [m/s].
        share: (m,) of the motion that is allowed.
        hazard: (k, 3) what limits each of the tight spheres [m].
        tight: (k,) spheres to look at.
    """
    n = axis.shape[0]
    rows, bounds = np.zeros((tight.shape[0], n)), np.empty(tight.shape[0])
    count = 0
    for k in range(tight.shape[0]):
        i = tight[k]
        ux = hazard[k, 0] - center[i, 0]
        uy = hazard[k, 1] - center[i, 1]
        uz = hazard[k, 2] - center[i, 2]
        length = max(np.sqrt(ux * ux + uy * uy + uz * uz), 1e-9)
        ux, uy, uz = ux / length, uy / length, uz / length
        closing = velocity[i, 0] * ux + velocity[i, 1] * uy + velocity[i, 2] * uz
        if closing <= 0.0:
            continue
        for j in range(link[i]):
            T = poses[j + 1]
            ax = T[0, 0] * axis[j, 0] + T[0, 1] * axis[j, 1] + T[0, 2] * axis[j, 2]
            ay = T[1, 0] * axis[j, 0] + T[1, 1] * axis[j, 1] + T[1, 2] * axis[j, 2]
            az = T[2, 0] * axis[j, 0] + T[2, 1] * axis[j, 1] + T[2, 2] * axis[j, 2]
            px, py, pz = center[i, 0] - T[0, 3], center[i, 1] - T[1, 3], center[i, 2] - T[2, 3]
            rows[count, j] = (
                ux * (ay * pz - az * py) + uy * (az * px - ax * pz) + uz * (ax * py - ay * px)
            )
        bounds[count] = share[i] * closing
        count += 1
    return rows[:count], bounds[:count]


@njit(cache=True, nogil=True)
def project(wanted: JointVector, rows: Points, bounds: Floats, sweeps: int) -> JointVector:
    """The motion nearest to a wanted one with ``rows @ motion <= bounds`` (Hildreth's method).

    Args:
        wanted: (n,) motion.
        rows: (k, n) constraints.
        bounds: (k,) of them.
        sweeps: over all rows; few suffice for few rows.
    """
    x = wanted.copy()
    k, n = rows.shape
    dual = np.zeros(k)
    for _ in range(sweeps):
        for i in range(k):
            square = 0.0
            excess = -bounds[i]
            for j in range(n):
                square += rows[i, j] * rows[i, j]
                excess += rows[i, j] * x[j]
            if square <= 1e-12:
                continue
            step = max(excess / square, -dual[i])
            dual[i] += step
            for j in range(n):
                x[j] -= step * rows[i, j]
    return x
