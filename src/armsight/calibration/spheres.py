"""Registering depth cameras by a sphere marker shown in many places (V's first step), past V.

A cap of the sphere is fitted with its known radius: with the radius free, 0.3 mm of noise at 2.2 m
already costs 1.2 mm. Procrustes with random sampling gives the start; then all cameras are solved
at once, the spheres' centres eliminated, with an offset of depth for each camera, for V's errors of
3-5 cm were bias, not noise (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.calibration import se3
from armsight.errors import CalibrationError
from armsight.geometry.pose import exp, skew
from armsight.geometry.registration import procrustes


@dataclass(frozen=True)
class SphereFit:
    """A sphere in a cloud: centre [m], rms distance of its points from the surface [m]."""

    center: Vector3
    rms: float
    points: int


def fit_sphere(points: Points, radius: float, rounds: int = 20) -> SphereFit | None:
    """Centre of a sphere of known radius from points on the cap that a camera at 0 sees.

    Gauss-Newton with Huber weights; None with fewer than twelve points or no convergence.
    """
    p = np.asarray(points, float)
    p = p[np.isfinite(p).all(1)]
    if len(p) < 12:
        return None
    middle = np.median(p, axis=0)
    center = middle + radius * 0.7 * middle / np.linalg.norm(middle)
    for _ in range(rounds):
        d = center - p
        length = np.linalg.norm(d, axis=1)
        r = length - radius
        scale = max(1.48 * float(np.median(np.abs(r))), 1e-6)
        w = np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(r), 1e-12))
        J = d / np.maximum(length, 1e-9)[:, None]
        step = np.linalg.solve((J * w[:, None]).T @ J + 1e-9 * np.eye(3), -(J * w[:, None]).T @ r)
        center = center + step
        if np.linalg.norm(step) < 1e-9:
            break
    r = np.linalg.norm(center - p, axis=1) - radius
    good = np.abs(r) < 3 * max(1.48 * float(np.median(np.abs(r))), 1e-6)
    if not np.isfinite(center).all() or np.abs(r).mean() > radius:
        return None
    return SphereFit(center, float(np.sqrt(np.mean(r[good] ** 2))), len(p))


def procrustes_ransac(
    source: Points,
    target: Points,
    rng: np.random.Generator,
    tolerance: float = 0.02,
    tries: int = 200,
) -> tuple[Pose, Floats]:
    """``T_target_source`` of most pairs and (n,) which of them agree within ``tolerance`` [m].

    Raises:
        CalibrationError: fewer than three pairs, or all on a line.
    """
    n = len(source)
    if n < 3 or _thickness(source) < 0.03:
        raise CalibrationError(
            "point pairs: at least three that do not lie on a line are needed; show the marker in "
            "more places"
        )
    best: tuple[int, Pose] = (-1, np.eye(4))
    for _ in range(tries):
        pick = rng.choice(n, 3, replace=False)
        if _thickness(source[pick]) < 0.02:
            continue
        T = procrustes(source[pick], target[pick])
        good = np.linalg.norm(source @ T[:3, :3].T + T[:3, 3] - target, axis=1) < tolerance
        if good.sum() > best[0]:
            best = (int(good.sum()), T)
    T = best[1]
    good = np.linalg.norm(source @ T[:3, :3].T + T[:3, 3] - target, axis=1) < tolerance
    for _ in range(3):
        if good.sum() < 3:
            raise CalibrationError(
                "point pairs do not agree on any motion: marker mistaken, or pairs mixed up"
            )
        T = procrustes(source[good], target[good])
        good = np.linalg.norm(source @ T[:3, :3].T + T[:3, 3] - target, axis=1) < tolerance
    return T, good


def _thickness(p: Points) -> float:
    """Second largest extent of points [m]: 0 on a line."""
    return float(np.linalg.svd(p - p.mean(0), compute_uv=False)[1] / np.sqrt(len(p)))


@dataclass(frozen=True)
class SphereRegistration:
    """Cameras registered to the first.

    Attributes:
        T_reference_camera: (c, 4, 4), identity for the reference.
        depth_offset: (c,) depth that each camera reads too much [m].
        centers: (p, 3) the sphere's places in the reference [m].
        covariance: (6 c, 6 c) of the poses (twists in each camera), zero for the reference.
        rms: of all residuals [m]; used: sightings kept of all.
    """

    T_reference_camera: Floats
    depth_offset: Floats
    centers: Points
    covariance: Floats
    rms: float
    used: int


def register_spheres(
    seen: Sequence[Sequence[Vector3 | None]],
    rng: np.random.Generator,
    sigma: float = 0.002,
    offset_sigma: float = 0.02,
) -> SphereRegistration:
    """Register cameras from a sphere's centres in each one's frame.

    Args:
        seen: of each place, the centre in each camera's frame [m], or None where it was not seen.
        rng: for the start.
        sigma: of a centre [m].
        offset_sigma: of a camera's depth offset [m].

    Raises:
        CalibrationError: a camera shares fewer than three places with those registered before.
    """
    cameras = len(seen[0]) if seen else 0
    z = np.full((len(seen), cameras, 3), np.nan)
    for k, row in enumerate(seen):
        for c, p in enumerate(row):
            if p is not None:
                z[k, c] = p
    there = np.isfinite(z).all(2)
    T: list[Pose | None] = [None] * cameras
    if cameras:
        T[0] = np.eye(4)
    places = np.full((len(seen), 3), np.nan)
    for _ in range(cameras):
        for k in range(len(seen)):
            known = [c for c in range(cameras) if T[c] is not None and there[k, c]]
            if known:
                points = [t[:3, :3] @ z[k, c] + t[:3, 3] for c in known if (t := T[c]) is not None]
                places[k] = np.median(points, axis=0)
        waiting = [c for c in range(cameras) if T[c] is None]
        if not waiting:
            break
        shared = {c: there[:, c] & np.isfinite(places).all(1) for c in waiting}
        c = max(waiting, key=lambda k: int(shared[k].sum()))
        if shared[c].sum() < 3:
            raise CalibrationError(
                f"camera {c}: only {int(shared[c].sum())} places of the sphere are shared with the "
                "other cameras; show it in at least three, better twenty, all over the volume"
            )
        T[c], good = procrustes_ransac(z[shared[c], c], places[shared[c]], rng, 0.06)
        there[np.flatnonzero(shared[c])[~good.astype(bool)], c] = False
    return _refine([t for t in T if t is not None], z, there, sigma, offset_sigma)


def _refine(
    start: list[Pose], z: Floats, there: Floats, sigma: float, offset_sigma: float
) -> SphereRegistration:
    """All cameras at once: centres eliminated, depth offsets with a prior."""
    C = len(start)
    T = np.array(start)
    offset = np.zeros(C)
    n = 7 * C
    centers = np.zeros((len(z), 3))
    H = np.eye(n)
    for _ in range(15):
        H = np.zeros((n, n))
        g = np.zeros(n)
        H[6::7, 6::7][np.diag_indices(C)] += 1 / offset_sigma**2
        g[6::7] += offset / offset_sigma**2
        total, count = 0.0, 0
        for k in range(len(z)):
            cams = np.flatnonzero(there[k])
            if len(cams) < 2:
                continue
            rows, p = [], []
            for c in cams:
                true = z[k, c] * (1 - offset[c] / np.linalg.norm(z[k, c]))
                R = T[c][:3, :3]
                p.append(R @ true + T[c][:3, 3])
                J = np.zeros((3, n))
                J[:, 7 * c : 7 * c + 3] = R
                J[:, 7 * c + 3 : 7 * c + 6] = -R @ skew(true)
                J[:, 7 * c + 6] = -R @ (z[k, c] / np.linalg.norm(z[k, c]))
                rows.append(J)
            P = np.array(p)
            # Eliminating the centre leaves the differences from the (robust) mean.
            w = np.ones(len(cams))
            for _ in range(3):
                mean = (w[:, None] * P).sum(0) / w.sum()
                d = np.linalg.norm(P - mean, axis=1) / sigma
                w = np.minimum(1.0, 4.0 / np.maximum(d, 1e-9))
            centers[k] = mean
            Jm = sum(wi * J for wi, J in zip(w, rows)) / w.sum()
            for wi, J, q in zip(w, rows, P):
                D = J - Jm
                H += wi * D.T @ D / sigma**2
                g += wi * D.T @ (q - mean) / sigma**2
                total += float(np.sum((q - mean) ** 2))
                count += 3
        free = np.ones(n, bool)
        free[:6] = False  # the reference camera's pose is the frame
        step = np.zeros(n)
        Hf = H[np.ix_(free, free)]
        step[free] = -np.linalg.solve(Hf + 1e-9 * np.diag(np.diag(Hf)), g[free])
        for camera in range(C):
            T[camera] = T[camera] @ exp(step[7 * camera : 7 * camera + 6])
            offset[camera] += step[7 * camera + 6]
        if np.abs(step).max() < 1e-10:
            break
    inverse = np.zeros((n, n))
    inverse[np.ix_(free, free)] = np.linalg.pinv(H[np.ix_(free, free)], hermitian=True)
    keep = np.concatenate([np.arange(7 * c, 7 * c + 6) for c in range(C)])
    rms = float(np.sqrt(total / max(count, 1)))
    return SphereRegistration(
        T,
        offset,
        centers,
        inverse[np.ix_(keep, keep)] * max(1.0, (rms / sigma) ** 2),
        rms,
        int(there.sum()),
    )


__all__ = [
    "SphereFit",
    "SphereRegistration",
    "fit_sphere",
    "procrustes",
    "procrustes_ransac",
    "register_spheres",
    "se3",
]
