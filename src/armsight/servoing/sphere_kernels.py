"""Compiled inner loops of fitting spheres; their plain-numpy twins are in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Ints, Mask, Points, Vector3

REFINEMENTS = 5


@njit(cache=True, nogil=True)
def followed_cone(rays: Points, triples: Ints, sigma: float, axis: Vector3, keep: Mask) -> float:
    """The half angle [rad] of the cone that most rays lie on; -1 for none.

    Args:
        rays: (k, 3) unit.
        triples: (m, 3) indices of rays that are tried.
        sigma: of a ray [rad].
        axis: (3,) unit, written.
        keep: (k,) whether a ray lies on it, written.
    """
    count, most = rays.shape[0], 0
    best = np.zeros(3)
    for t in range(triples.shape[0]):
        a, b, c = rays[triples[t, 0]], rays[triples[t, 1]], rays[triples[t, 2]]
        # u . w = 1 for three rays, solved by cross products.
        bc = np.array(
            (b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0])
        )
        ca = np.array(
            (c[1] * a[2] - c[2] * a[1], c[2] * a[0] - c[0] * a[2], c[0] * a[1] - c[1] * a[0])
        )
        ab = np.array(
            (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
        )
        det = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2]
        if abs(det) <= 1e-12:
            continue
        w = (bc + ca + ab) / det
        size = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
        if not size > 1.0:
            continue
        w /= size
        low, high = _band(np.arccos(1.0 / size), 3.0 * sigma)
        followers = 0
        for i in range(count):
            chord = _chord(rays[i], w)
            if low < chord < high:
                followers += 1
        if followers > most:
            most = followers
            best[:] = w * size
    if most < 8:
        return -1.0
    size = np.sqrt(best[0] * best[0] + best[1] * best[1] + best[2] * best[2])
    axis[:] = best / size
    half = np.arccos(1.0 / size)
    low, high = _band(half, 3.0 * sigma)
    for i in range(count):
        keep[i] = low < _chord(rays[i], axis) < high
    off = np.empty(count)
    for _ in range(REFINEMENTS):
        kept = rays[keep]
        if kept.shape[0] < 8:
            return -1.0
        v = np.linalg.solve(kept.T @ kept, kept.sum(axis=0))
        size = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if not (np.isfinite(size) and size > 1.0):
            return -1.0
        axis[:] = v / size
        half = np.arccos(1.0 / size)
        for i in range(count):
            off[i] = abs(2.0 * np.arcsin(min(0.5 * np.sqrt(_chord(rays[i], axis)), 1.0)) - half)
        limit = 3.0 * max(1.48 * np.median(off[keep]), sigma)
        same = True
        for i in range(count):
            now = off[i] < limit
            same = same and now == keep[i]
            keep[i] = now
        if same:
            break
    return half


@njit(cache=True, nogil=True)
def _chord(a: Vector3, b: Vector3) -> float:
    """Square of the distance between two unit vectors: exact for small angles, too."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return float(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def _band(half: float, width: float) -> tuple[float, float]:
    """Squares of the chords of the angles between which a ray is near a half angle [rad]."""
    low, high = 0.5 * (half - width), 0.5 * min(half + width, np.pi)
    least = -1.0 if low < 0.0 else 4.0 * np.sin(low) ** 2
    return least, 4.0 * np.sin(high) ** 2


@njit(cache=True, nogil=True)
def fitted_sphere(
    radius: float,
    start: Vector3,
    origins: Points,
    rays: Points,
    sigmas: Floats,
    surface: Points,
    surface_sigma: float,
    rounds: int,
    center: Vector3,
    H: Floats,
    r: Floats,
) -> bool:
    """Gauss-Newton with Huber weights; false where it goes astray.

    Args:
        radius: of the sphere [m].
        start: (3,) about where its centre is [m].
        origins: (k, 3) each ray's lens [m].
        rays: (k, 3) unit, to outlines.
        sigmas: (k,) of each [rad].
        surface: (m, 3) points on it [m].
        surface_sigma: of one of them [m].
        rounds: at most.
        center: (3,) written [m].
        H: (3, 3) written: information [1/m^2].
        r: (k + m,) written: residuals by their standard deviations.
    """
    n, m = rays.shape[0], surface.shape[0]
    J = np.empty((n + m, 3))
    center[:] = start
    for _ in range(rounds):
        for i in range(n):
            x, y, z = (
                center[0] - origins[i, 0], center[1] - origins[i, 1], center[2] - origins[i, 2],
            )  # fmt: skip
            far = np.sqrt(x * x + y * y + z * z)
            along = rays[i, 0] * x + rays[i, 1] * y + rays[i, 2] * z
            x, y, z = x - along * rays[i, 0], y - along * rays[i, 1], z - along * rays[i, 2]
            length = np.sqrt(x * x + y * y + z * z)
            scale = 1.0 / (sigmas[i] * max(far, 1e-6))
            by = scale / max(length, 1e-9)
            J[i, 0], J[i, 1], J[i, 2] = by * x, by * y, by * z
            r[i] = scale * (length - radius)
        for j in range(m):
            x, y, z = (
                center[0] - surface[j, 0], center[1] - surface[j, 1], center[2] - surface[j, 2],
            )  # fmt: skip
            length = np.sqrt(x * x + y * y + z * z)
            by = 1.0 / (max(length, 1e-9) * surface_sigma)
            J[n + j, 0], J[n + j, 1], J[n + j, 2] = by * x, by * y, by * z
            r[n + j] = (length - radius) / surface_sigma
        # Far from the answer everything is off: what counts is what is off more than the rest.
        knee = max(2.0, 2.0 * np.median(np.abs(r)))
        H[:] = 1e-6 * np.eye(3)
        g = np.zeros(3)
        for i in range(n + m):
            weight = min(1.0, knee / max(abs(r[i]), 1e-9))
            for a in range(3):
                g[a] += weight * J[i, a] * r[i]
                for b in range(3):
                    H[a, b] += weight * J[i, a] * J[i, b]
        step = np.linalg.solve(H, g)
        center -= step
        away = center - start
        square = away[0] ** 2 + away[1] ** 2 + away[2] ** 2
        if not (np.isfinite(square) and square <= (8.0 * radius) ** 2):
            return False
        if step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < 1e-16:
            break
    return True
