"""Compiled hot loops of the simulation; each has a plain-numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import Bytes, DepthImage, Floats, Floats32, Ints


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
        position, velocity: (n,) reference, changed in place [rad], [rad/s].
        lower, upper: (n,) limits [rad].
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
        start, end: (p,) joints at the origin and on the z axis of each part.
        turn: (p,) 0: y to the person's left; 1: x upward.
        left: (3,) the person's left, unit.
        out_pos, out_quat: (p, 3) [m] and (p, 4) wxyz, written.
    """
    R = np.empty((3, 3))
    for i in range(start.shape[0]):
        a, b = joints[start[i]], joints[end[i]]
        z = b - a
        norm = np.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
        z = z / norm if norm > 1e-9 else np.array([0.0, 0.0, 1.0])
        if turn[i] == 0:
            x = np.cross(left, z)
            if x[0] * x[0] + x[1] * x[1] + x[2] * x[2] < 1e-6:  # the arm points sideways
                x = np.cross(np.array([left[1], -left[0], 0.0]), z)
        else:
            up = np.array([0.05 * left[1], -0.05 * left[0], 1.0])
            x = up - z * (up[0] * z[0] + up[1] * z[1] + up[2] * z[2])
        x = x / np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        y = np.cross(z, x)
        R[:, 0], R[:, 1], R[:, 2] = x, y, z
        out_pos[i] = a
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


@njit(cache=True, nogil=True)
def resample_depth(
    raw: Floats32,
    ids: Bytes,
    map_u: Floats32,
    map_v: Floats32,
    geom_of_id: NDArray[np.int16],
    offset: float,
    factor: float,
    exact: bool,
    depth: DepthImage,
    geom: NDArray[np.int16],
) -> None:
    """Depth and geoms through a lens from OpenGL's buffers, whose rows run bottom up.

    OpenGL's depth is linear in 1/z, and 1/z is linear on a plane's picture: inside one geom it is
    interpolated, which is exact for planes; across borders the nearest pixel is taken.

    Args:
        raw: (H, W) reversed depth buffer, ``z = factor / (raw + offset)``.
        ids: (H, W, 3) segmentation colours, little-endian, 0 = nothing.
        map_u, map_v: (h, w) where each pixel of the lens falls [px].
        geom_of_id: geom index of each id.
        exact: whether the maps are the identity.
        depth, geom: (h, w) written: [m] with NaN for nothing, index with -1 for nothing.
    """
    height = raw.shape[0]
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if exact:
                row, column = height - 1 - v, u
                value = raw[row, column]
            else:
                fu, fv = map_u[v, u], map_v[v, u]
                column, line = int(fu + np.float32(0.5)), int(fv + np.float32(0.5))
                row = height - 1 - line
                u0, v0 = int(fu), int(fv)
                r0 = height - 1 - v0
                r1 = r0 - 1
                value = raw[row, column]
                a, b = raw[r0, u0], raw[r0, u0 + 1]
                c, d = raw[r1, u0], raw[r1, u0 + 1]
                low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
                if (
                    high - low < np.float32(0.03) * high
                    and ids[r0, u0, 0] == ids[r0, u0 + 1, 0] == ids[r1, u0, 0] == ids[r1, u0 + 1, 0]
                    and ids[r0, u0, 1] == ids[r0, u0 + 1, 1] == ids[r1, u0, 1] == ids[r1, u0 + 1, 1]
                ):
                    wu, wv = fu - np.float32(u0), fv - np.float32(v0)
                    top = a + wu * (b - a)
                    value = top + wv * (c + wu * (d - c) - top)
            code = np.int64(ids[row, column, 0]) | (np.int64(ids[row, column, 1]) << 8)
            index = geom_of_id[code] if code < geom_of_id.shape[0] else np.int16(-1)
            geom[v, u] = index
            if index < 0:
                depth[v, u] = np.nan
            else:
                depth[v, u] = np.float32(factor / (np.float64(value) + offset))
