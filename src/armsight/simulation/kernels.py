"""Compiled hot loops of the simulation; each has a plain-numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import DepthImage, Floats, Floats32, Ints


@njit(cache=True, nogil=True)
def drive_step(
    target: Floats,
    braking: bool,
    position: Floats,
    velocity: Floats,
    lower: Floats,
    upper: Floats,
    acceleration: Floats,
    brake: Floats,
    dt: float,
) -> None:
    """One step of the drives' reference: ramps ``velocity`` to ``target``, in place.

    Each joint changes speed by at most its acceleration, or by its brakes' deceleration when
    stopping, and slows down early enough to come to rest at its limits of position.

    Args:
        target: (n,) wanted velocity [rad/s]; ignored while ``braking``.
        braking: whether the arm stops at the drives' full deceleration.
        position: (n,) reference, changed in place [rad].
        velocity: (n,) reference, changed in place [rad/s].
        lower: (n,) limits [rad].
        upper: (n,) limits [rad].
        acceleration: (n,) limit of the controller [rad/s^2].
        brake: (n,) full deceleration of the drives [rad/s^2].
        dt: step [s].
    """
    for i in range(position.shape[0]):
        # The fastest speed from which the brakes still stop before the limit, in whole steps.
        step = brake[i] * dt
        up = _stopping_speed(upper[i] - position[i], brake[i], step)
        down = -_stopping_speed(position[i] - lower[i], brake[i], step)
        wanted = 0.0 if braking else min(max(target[i], down), up)
        change = (brake[i] if braking else acceleration[i]) * dt
        new = velocity[i] + min(max(wanted - velocity[i], -change), change)
        if new > up:
            new = max(up, velocity[i] - step)
        elif new < down:
            new = min(down, velocity[i] + step)
        velocity[i] = new
        position[i] += new * dt
        if position[i] > upper[i]:
            position[i] = upper[i]
            velocity[i] = min(new, 0.0)
        elif position[i] < lower[i]:
            position[i] = lower[i]
            velocity[i] = max(new, 0.0)


@njit(cache=True, nogil=True, inline="always")
def _stopping_speed(room: float, brake: float, step: float) -> float:
    """Speed [rad/s] from which whole steps of braking cover at most ``room`` [rad]."""
    if room <= 0.0:
        return 0.0
    return float(np.sqrt(0.25 * step * step + 2.0 * brake * room) - 0.5 * step)


@njit(cache=True, nogil=True)
def part_poses(
    joints: Floats,
    start: Ints,
    end: Ints,
    turn: Ints,
    left: Floats,
    out_pos: Floats,
    out_quat: Floats,
) -> None:
    """Poses of a person's body parts from the joints.

    Args:
        joints: (19, 3) in world [m].
        start: (p,) joint at the origin of each part.
        end: (p,) joint on its z axis.
        turn: (p,) 0: y to the person's left; 1: x upward.
        left: (3,) the person's left, unit.
        out_pos: (p, 3) written [m].
        out_quat: (p, 4) wxyz, written.
    """
    R = np.empty((3, 3))
    lx, ly, lz = left[0], left[1], left[2]
    for i in range(start.shape[0]):
        a, b = joints[start[i]], joints[end[i]]
        zx, zy, zz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        norm = np.sqrt(zx * zx + zy * zy + zz * zz)
        if norm < 1e-9:
            zx, zy, zz, norm = 0.0, 0.0, 1.0, 1.0
        zx, zy, zz = zx / norm, zy / norm, zz / norm
        if turn[i] == 0:
            # left x z; where the part itself points to the side, forward x z instead
            xx, xy, xz = ly * zz - lz * zy, lz * zx - lx * zz, lx * zy - ly * zx
            if xx * xx + xy * xy + xz * xz < 1e-6:
                xx, xy, xz = -lx * zz, -ly * zz, ly * zy + lx * zx
        else:
            ux, uy = 0.05 * ly, -0.05 * lx  # a little forward, for hands that hang
            along = ux * zx + uy * zy + zz
            xx, xy, xz = ux - zx * along, uy - zy * along, 1.0 - zz * along
        norm = np.sqrt(xx * xx + xy * xy + xz * xz)
        xx, xy, xz = xx / norm, xy / norm, xz / norm
        R[0, 0], R[1, 0], R[2, 0] = xx, xy, xz
        R[0, 1], R[1, 1], R[2, 1] = zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx
        R[0, 2], R[1, 2], R[2, 2] = zx, zy, zz
        for k in range(3):
            out_pos[i, k] = a[k]
        quaternion(R, out_quat[i])


@njit(cache=True, nogil=True)
def quaternion(R: Floats, out: Floats) -> None:
    """Writes the unit quaternion (w, x, y, z), w >= 0, of a (3, 3) rotation."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        s = 2.0 * np.sqrt(trace + 1.0)
        out[0] = 0.25 * s
        out[1] = (R[2, 1] - R[1, 2]) / s
        out[2] = (R[0, 2] - R[2, 0]) / s
        out[3] = (R[1, 0] - R[0, 1]) / s
    elif R[0, 0] > R[1, 1] and R[0, 0] > R[2, 2]:
        s = 2.0 * np.sqrt(1.0 + R[0, 0] - R[1, 1] - R[2, 2])
        out[0] = (R[2, 1] - R[1, 2]) / s
        out[1] = 0.25 * s
        out[2] = (R[0, 1] + R[1, 0]) / s
        out[3] = (R[0, 2] + R[2, 0]) / s
    elif R[1, 1] > R[2, 2]:
        s = 2.0 * np.sqrt(1.0 + R[1, 1] - R[0, 0] - R[2, 2])
        out[0] = (R[0, 2] - R[2, 0]) / s
        out[1] = (R[0, 1] + R[1, 0]) / s
        out[2] = 0.25 * s
        out[3] = (R[1, 2] + R[2, 1]) / s
    else:
        s = 2.0 * np.sqrt(1.0 + R[2, 2] - R[0, 0] - R[1, 1])
        out[0] = (R[1, 0] - R[0, 1]) / s
        out[1] = (R[0, 2] + R[2, 0]) / s
        out[2] = (R[1, 2] + R[2, 1]) / s
        out[3] = 0.25 * s
    if out[0] < 0.0:
        for k in range(4):
            out[k] = -out[k]


@njit(cache=True, nogil=True, error_model="numpy")
def merge_buffers(
    ids: NDArray[np.uint32],
    raw: Floats32,
    new_ids: NDArray[np.uint32],
    new_raw: Floats32,
    row: int,
    column: int,
    codes: int,
) -> None:
    """Draw one part of OpenGL's buffers over another: whatever is nearer stays.

    Args:
        ids: (H, W) segmentation codes, changed in place.
        raw: (H, W) reversed depth buffer (1 near), changed in place.
        new_ids: (h, w) codes of the part, 0 = nothing.
        new_raw: (h, w) its depth.
        row: where the part's first row belongs.
        column: where its first column belongs.
        codes: added to the part's codes, so that they differ from those beneath.
    """
    low = np.uint32(0xFFFFFF)
    for v in range(new_ids.shape[0]):
        for u in range(new_ids.shape[1]):
            code = new_ids[v, u] & low
            if code != np.uint32(0) and new_raw[v, u] >= raw[row + v, column + u]:
                ids[row + v, column + u] = code + np.uint32(codes)
                raw[row + v, column + u] = new_raw[v, u]


@njit(cache=True, nogil=True, error_model="numpy")
def resample_depth(
    raw: Floats32,
    ids: NDArray[np.uint32],
    corner: NDArray[np.int32],
    weight_u: Floats32,
    weight_v: Floats32,
    geom_of_id: NDArray[np.int16],
    offset: float,
    factor: float,
    window: tuple[int, int, int, int],
    depth: DepthImage,
    geom: NDArray[np.int16],
) -> None:
    """Depth and geoms through a lens from OpenGL's buffers, whose rows run bottom up.

    OpenGL's depth is linear in 1/z, and 1/z is linear on a plane's picture: inside one geom it is
    interpolated, which is exact for planes; across borders the nearest pixel is taken.

    Args:
        raw: (H, W) reversed depth buffer, ``z = factor / (raw + offset)``.
        ids: (H, W) segmentation codes in the lower 24 bits, 0 = nothing.
        corner: (h, w) index into the flat buffers of the pixel above and left of each ray.
        weight_u: (h, w) share of the column to the right.
        weight_v: (h, w) share of the line below, which comes earlier in the buffers.
        geom_of_id: geom index of each code.
        offset: see ``raw``.
        factor: see ``raw`` [m].
        window: first line, end line, first column, end column of what is written.
        depth: (h, w) written [m], NaN for nothing.
        geom: (h, w) written, -1 for nothing.
    """
    width = raw.shape[1]
    buffer, codes = raw.ravel(), ids.ravel()
    known = geom_of_id.shape[0]
    # Inside one geom a small step is a slope; a larger one only where the four lie on a plane.
    half, steep = np.float32(0.5), np.float32(0.03)
    even, cliff = np.float32(0.1), np.float32(0.12)
    add, scale = np.float32(offset), np.float32(factor)
    for v in range(window[0], window[1]):
        for u in range(window[2], window[3]):
            i = corner[v, u]
            wu, wv = weight_u[v, u], weight_v[v, u]
            near = i + (1 if wu >= half else 0) - (width if wv >= half else 0)
            code = codes[near] & np.uint32(0xFFFFFF)
            index = geom_of_id[code] if code < known else np.int16(-1)
            geom[v, u] = index
            if index < 0:
                depth[v, u] = np.nan
                continue
            value = buffer[near]
            a, b, c, d = buffer[i], buffer[i + 1], buffer[i - width], buffer[i - width + 1]
            same = (codes[i] == codes[i + 1]) & (codes[i - width] == codes[i - width + 1])
            if same and codes[i] == codes[i - width]:
                low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
                step, twist = high - low, abs(a + d - b - c)
                if step < steep * high or (twist < even * step and step < cliff * high):
                    top = a + wu * (b - a)
                    value = top + wv * (c + wu * (d - c) - top)
            depth[v, u] = scale / (value + add)


@njit(cache=True, nogil=True)
def gap_bounds(
    centers: Floats, radii: Floats, a: Floats, b: Floats, widths: Floats, out: Floats
) -> None:
    """Lower bounds of the distances between bodies in spheres and bodies in capsules.

    Args:
        centers: (m, 3) of the spheres [m].
        radii: (m,) of the spheres [m].
        a: (k, 3) one end of each capsule's axis [m].
        b: (k, 3) the other end [m].
        widths: (k,) radii of the capsules [m].
        out: (m, k) written [m].
    """
    for j in range(a.shape[0]):
        ex, ey, ez = b[j, 0] - a[j, 0], b[j, 1] - a[j, 1], b[j, 2] - a[j, 2]
        length = max(ex * ex + ey * ey + ez * ez, 1e-12)
        for i in range(centers.shape[0]):
            px = centers[i, 0] - a[j, 0]
            py = centers[i, 1] - a[j, 1]
            pz = centers[i, 2] - a[j, 2]
            t = min(max((px * ex + py * ey + pz * ez) / length, 0.0), 1.0)
            px, py, pz = px - t * ex, py - t * ey, pz - t * ez
            out[i, j] = np.sqrt(px * px + py * py + pz * pz) - radii[i] - widths[j]


@njit(cache=True, nogil=True)
def turn(q: Floats, v: Floats) -> Floats:
    """(3,) vector turned by a wxyz quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    a = 2.0 * (y * v[2] - z * v[1])
    b = 2.0 * (z * v[0] - x * v[2])
    c = 2.0 * (x * v[1] - y * v[0])
    return np.array(
        [
            v[0] + w * a + y * c - z * b,
            v[1] + w * b + z * a - x * c,
            v[2] + w * c + x * b - y * a,
        ]
    )


@njit(cache=True, nogil=True)
def rotation_between(a: Floats, b: Floats) -> Floats:
    """(3,) rotation vector [rad], in the outer frame, that turns quaternion b into a: a b^-1."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    out = np.empty(3)
    out[0] = -a[0] * b[1] + a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    out[1] = -a[0] * b[2] + a[2] * b[0] - a[3] * b[1] + a[1] * b[3]
    out[2] = -a[0] * b[3] + a[3] * b[0] - a[1] * b[2] + a[2] * b[1]
    sine = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    if sine < 1e-12:
        out[:] = 0.0
        return out
    angle = 2.0 * np.arctan2(sine, abs(w))
    out *= (angle if w >= 0.0 else -angle) / sine
    return out


@njit(cache=True, nogil=True)
def follow_leaders(
    leaders: Floats,
    share: float,
    seconds: float,
    index: Ints,
    center: Floats,
    gains: Floats,
    qpos: Floats,
    qvel: Floats,
    force: Floats,
) -> None:
    """Write what pulls (m,) free bodies to where their leaders are on their way.

    A spring and a damper between the centres of mass, and the same for how they are turned.

    Args:
        leaders: (2, m, 7) their last two poses, position and wxyz, ``seconds`` apart.
        share: of that time that has passed, 0..1.
        seconds: [s].
        index: (m, 3) where each body's free joint begins in ``qpos`` and in ``qvel``, and its row
            of ``force``.
        center: (m, 3) centres of mass in the bodies' frames [m].
        gains: (m, 4) spring [N/m], damper [N s/m]; of turning [N m/rad], [N m s/rad].
        qpos: of all joints.
        qvel: of all joints.
        force: (bodies, 6) force [N] and torque [N m] at the centres of mass, written.
    """
    start, end = leaders[0], leaders[1]
    for k in range(index.shape[0]):
        here = end[k, :3] * share + start[k, :3] * (1.0 - share)
        same = 1.0 if (start[k, 3:] * end[k, 3:]).sum() >= 0.0 else -1.0
        lead = end[k, 3:] * share + same * start[k, 3:] * (1.0 - share)
        lead /= np.sqrt((lead * lead).sum())
        moves = share < 1.0
        v_lead = (end[k, :3] - start[k, :3]) / seconds if moves else np.zeros(3)
        w_lead = rotation_between(end[k, 3:], start[k, 3:]) / seconds if moves else np.zeros(3)
        qa, va, body = index[k, 0], index[k, 1], index[k, 2]
        own = qpos[qa + 3 : qa + 7] / np.sqrt((qpos[qa + 3 : qa + 7] ** 2).sum())
        w_own = turn(own, qvel[va + 3 : va + 6])
        arm, arm_lead = turn(own, center[k]), turn(lead, center[k])
        gap = here + arm_lead - qpos[qa : qa + 3] - arm
        rate = v_lead + np.cross(w_lead, arm_lead) - qvel[va : va + 3] - np.cross(w_own, arm)
        turned = rotation_between(lead, own)
        force[body, :3] = gains[k, 0] * gap + gains[k, 1] * rate
        force[body, 3:] = gains[k, 2] * turned + gains[k, 3] * (w_lead - w_own)
