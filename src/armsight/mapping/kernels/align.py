"""Compiled sums of fine alignment: a depth camera's points against the surfaces that are known."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Floats, Points, Pose
from armsight.mapping.kernels.body import interpolate
from armsight.mapping.kernels.solids import solid_distance


@njit(cache=True, nogil=True)
def _body_distance(
    fields: Any, T_field_base: Any, cell: float, x: float, y: float, z: float, most: float
) -> tuple[float, float, float, float]:
    """Distance [m] of a point in base to the nearest of a body's parts, and its gradient."""
    values, offset, shape = fields
    best = most
    gx, gy, gz = 0.0, 0.0, 0.0
    for f in range(offset.shape[0]):
        T = T_field_base[f]
        nx, ny, nz = shape[f, 0], shape[f, 1], shape[f, 2]
        a = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        b = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        c = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        if not (a >= 0.5 and b >= 0.5 and c >= 0.5):
            continue
        if not (a <= nx - 1.5 and b <= ny - 1.5 and c <= nz - 1.5):
            continue
        d = interpolate(values, offset[f], nx, ny, nz, a, b, c)
        if abs(d) < abs(best):
            best = d
            o = offset[f]
            da = interpolate(values, o, nx, ny, nz, a + 0.5, b, c)
            da -= interpolate(values, o, nx, ny, nz, a - 0.5, b, c)
            db = interpolate(values, o, nx, ny, nz, a, b + 0.5, c)
            db -= interpolate(values, o, nx, ny, nz, a, b - 0.5, c)
            dc = interpolate(values, o, nx, ny, nz, a, b, c + 0.5)
            dc -= interpolate(values, o, nx, ny, nz, a, b, c - 0.5)
            # T's rotation is scaled by 1 / cell: cells to metres cancels against the step
            gx = T[0, 0] * da + T[1, 0] * db + T[2, 0] * dc
            gy = T[0, 1] * da + T[1, 1] * db + T[2, 1] * dc
            gz = T[0, 2] * da + T[1, 2] * db + T[2, 2] * dc
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    if norm > 0.0:
        gx, gy, gz = gx / norm, gy / norm, gz / norm
    return best, gx, gy, gz


@njit(cache=True, nogil=True)
def _solids_distance(
    solids: Any, x: float, y: float, z: float, most: float
) -> tuple[float, float, float, float]:
    """The same for declared solids."""
    kinds, sizes, T_solid_base = solids
    best = most
    nearest = -1
    for s in range(kinds.shape[0]):
        d = solid_distance(kinds[s], sizes[s], T_solid_base[s], x, y, z)
        if abs(d) < abs(best):
            best = d
            nearest = s
    if nearest < 0:
        return best, 0.0, 0.0, 0.0
    k, size, T = kinds[nearest], sizes[nearest], T_solid_base[nearest]
    e = 1e-5
    gx = solid_distance(k, size, T, x + e, y, z) - solid_distance(k, size, T, x - e, y, z)
    gy = solid_distance(k, size, T, x, y + e, z) - solid_distance(k, size, T, x, y - e, z)
    gz = solid_distance(k, size, T, x, y, z + e) - solid_distance(k, size, T, x, y, z - e)
    norm = np.sqrt(gx * gx + gy * gy + gz * gz)
    if norm > 0.0:
        gx, gy, gz = gx / norm, gy / norm, gz / norm
    return best, gx, gy, gz


@njit(cache=True, nogil=True)
def normal_equations(
    points: Points,
    gain: float,
    T: Pose,
    fields: Any,
    T_field_base: Any,
    cell: float,
    solids: Any,
    gate: float,
    body_gate: float,
    A: Floats,
    b: Floats,
    residuals: Floats,
) -> int:
    """Gauss-Newton sums of point-to-surface distances over a camera's points.

    The unknowns are a twist in the camera's frame (translation, rotation) and a relative change of
    depth: p_base = T exp(xi) (gain + s) p. Weights are Tukey's: nothing beyond ``gate`` counts.

    Of the arguments:
        points: (n, 3) in the camera frame [m].
        T: camera in base.
        fields: (values, offset, shape) of the body; T_field_base: base in each field's cells.
        solids: (kinds, sizes, T_solid_base).
        gate, body_gate: how far a point may be from a solid and from the body [m].
        A, b: (7, 7) and (7,) sums, added to.
        residuals: (n,) out: signed distance [m], NaN where no known surface that faces the camera
            is within the gate.

    Returns:
        Number of points within the gate.
    """
    count = 0
    J = np.empty(7)
    for n in range(points.shape[0]):
        px, py, pz = gain * points[n, 0], gain * points[n, 1], gain * points[n, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        d, gx, gy, gz = _solids_distance(solids, x, y, z, gate)
        e, hx, hy, hz = _body_distance(fields, T_field_base, cell, x, y, z, body_gate)
        if abs(e) < abs(d):
            d, gx, gy, gz = e, hx, hy, hz
        if abs(d) >= gate or (gx == 0.0 and gy == 0.0 and gz == 0.0):
            residuals[n] = np.nan
            continue
        # a surface that faces away cannot be what the camera saw
        away = gx * (x - T[0, 3]) + gy * (y - T[1, 3]) + gz * (z - T[2, 3])
        if away > 0.0:
            residuals[n] = np.nan
            continue
        residuals[n] = d
        count += 1
        cx = T[0, 0] * gx + T[1, 0] * gy + T[2, 0] * gz  # gradient in the camera frame
        cy = T[0, 1] * gx + T[1, 1] * gy + T[2, 1] * gz
        cz = T[0, 2] * gx + T[1, 2] * gy + T[2, 2] * gz
        J[0], J[1], J[2] = cx, cy, cz
        J[3] = py * cz - pz * cy  # (p x g)
        J[4] = pz * cx - px * cz
        J[5] = px * cy - py * cx
        J[6] = cx * points[n, 0] + cy * points[n, 1] + cz * points[n, 2]
        u = d / gate
        weight = (1.0 - u * u) ** 2
        for i in range(7):
            b[i] -= weight * J[i] * d
            for j in range(7):
                A[i, j] += weight * J[i] * J[j]
    return count
