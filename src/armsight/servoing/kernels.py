"""Compiled inner loops of seeing targets; their plain-numpy twins are in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Points, Vector3


@njit(cache=True, nogil=True)
def last_steps_down(
    values: Floats32,
    inside: Bytes,
    at: Floats32,
    width: int,
    height: int,
    off: int,
    clear: float,
    out: Floats,
) -> None:
    """Write where each ray crosses the half level of its last step down, in samples.

    Args:
        values: (m, r) the signal along each ray.
        inside: (m, r) not 0 in the region.
        at: (m, r, 2) the samples' pixels.
        width: of the picture [px].
        height: of the picture [px].
        off: samples from the border to both levels.
        clear: least height of a step.
        out: (m,) the crossing in samples from the first, or -1: no clear step in the picture.
    """
    rays, samples = values.shape
    for i in range(rays):
        out[i] = -1.0
        k = samples - 1
        while k >= 0 and inside[i, k] == 0:
            k -= 1
        if k - off - 1 < 0 or k + off + 3 >= samples:
            continue
        u, v = at[i, k + off + 2]
        if not (0.0 <= u <= width - 1.0 and 0.0 <= v <= height - 1.0):
            continue
        low = 0.5 * (values[i, k + off + 1] + values[i, k + off + 2])
        high = 0.5 * (values[i, k - off - 1] + values[i, k - off])
        if high - low < clear:
            continue
        level = 0.5 * (high + low)
        for j in range(k - off, k + off + 1):
            if values[i, j] >= level > values[i, j + 1]:
                out[i] = j + (values[i, j] - level) / (values[i, j] - values[i, j + 1])
                break


@njit(cache=True, nogil=True)
def disc_residuals(
    center: Vector3,
    normal: Vector3,
    origin: Points,
    rays: Points,
    radius: Floats,
    sigma: Floats,
    surface: Points,
    surface_sigma: float,
    out: Floats,
) -> None:
    """Write rays' angles from the nearest points of their circles, and heights, by their sigmas.

    Args:
        center: (3,) of the concentric circles [m].
        normal: (3,) unit, of their plane.
        origin: (n, 3) each ray's lens [m].
        rays: (n, 3) unit, to the circles' outlines.
        radius: (n,) of the circle that each ray belongs to [m].
        sigma: (n,) of each ray [rad].
        surface: (m, 3) points on the plane [m].
        surface_sigma: of one of them, along the normal [m].
        out: (n + m,).
    """
    n = rays.shape[0]
    for i in range(n):
        # Where the ray meets the plane, from the centre; then the circle's point on that side.
        to = center - origin[i]
        steep = rays[i, 0] * normal[0] + rays[i, 1] * normal[1] + rays[i, 2] * normal[2]
        along = (to[0] * normal[0] + to[1] * normal[1] + to[2] * normal[2]) / steep
        x, y, z = along * rays[i, 0] - to[0], along * rays[i, 1] - to[1], along * rays[i, 2] - to[2]
        length = max(np.sqrt(x * x + y * y + z * z), 1e-9)
        share = radius[i] / length
        rx, ry, rz = to[0] + share * x, to[1] + share * y, to[2] + share * z
        away = np.sqrt(rx * rx + ry * ry + rz * rz)
        dot = rays[i, 0] * rx + rays[i, 1] * ry + rays[i, 2] * rz
        rx, ry, rz = rx - dot * rays[i, 0], ry - dot * rays[i, 1], rz - dot * rays[i, 2]
        angle = np.sqrt(rx * rx + ry * ry + rz * rz) / away
        out[i] = np.sign(length - radius[i]) * angle / sigma[i]
    for j in range(surface.shape[0]):
        height = 0.0
        for c in range(3):
            height += (surface[j, c] - center[c]) * normal[c]
        out[n + j] = height / surface_sigma
