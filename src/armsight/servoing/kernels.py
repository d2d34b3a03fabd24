"""Compiled inner loops of seeing targets; their plain-numpy twins are in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Points, Vector3


@njit(cache=True, nogil=True)
def _sampled(signal: Floats32, u: float, v: float) -> float:
    """A picture between its pixels; beyond its border it goes on as it is there."""
    rows, columns = signal.shape
    u, v = min(max(u, 0.0), columns - 1.0), min(max(v, 0.0), rows - 1.0)
    left, top = int(u), int(v)
    right, bottom = min(left + 1, columns - 1), min(top + 1, rows - 1)
    a, b = u - left, v - top
    above = (1.0 - a) * signal[top, left] + a * signal[top, right]
    below = (1.0 - a) * signal[bottom, left] + a * signal[bottom, right]
    return (1.0 - b) * above + b * below


@njit(cache=True, nogil=True)
def last_steps_down(
    signal: Floats32,
    mask: Bytes,
    corner: Floats,
    center: Floats,
    ways: Floats,
    step: float,
    samples: int,
    off: int,
    clear: float,
    out: Floats,
) -> None:
    """Write where along each ray the signal crosses the half level of its last step down.

    Sample ``k`` of a ray lies ``step * (k + 1)`` from the centre.

    Args:
        signal: (h, w).
        mask: (a, b) not 0 in the region.
        corner: (2,) of the mask in the picture [px].
        center: (2,) where rays begin [px].
        ways: (m, 2) unit vectors along them.
        step: between samples [px].
        samples: of a ray.
        off: samples from the border to both levels.
        clear: least height of a step.
        out: (m,) the crossing in samples from the first, or -1: no clear step in the picture.
    """
    height, width = signal.shape
    rows, columns = mask.shape
    values = np.empty(2 * off + 4)
    for i in range(ways.shape[0]):
        out[i] = -1.0
        du, dv = ways[i, 0] * step, ways[i, 1] * step
        k = samples - 1
        while k >= 0:
            u = int(np.floor(center[0] + du * (k + 1) - corner[0] + 0.5))
            v = int(np.floor(center[1] + dv * (k + 1) - corner[1] + 0.5))
            if 0 <= u < columns and 0 <= v < rows and mask[v, u] != 0:
                break
            k -= 1
        first = k - off - 1
        if first < 0 or k + off + 3 >= samples:
            continue
        u, v = center[0] + du * (k + off + 3), center[1] + dv * (k + off + 3)
        if not (0.0 <= u <= width - 1.0 and 0.0 <= v <= height - 1.0):
            continue
        for j in range(2 * off + 4):
            along = first + j + 1
            values[j] = _sampled(signal, center[0] + du * along, center[1] + dv * along)
        high = 0.5 * (values[0] + values[1])
        low = 0.5 * (values[2 * off + 2] + values[2 * off + 3])
        if high - low < clear:
            continue
        level = 0.5 * (high + low)
        for j in range(1, 2 * off + 2):
            if values[j] >= level > values[j + 1]:
                out[i] = first + j + (values[j] - level) / (values[j] - values[j + 1])
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
