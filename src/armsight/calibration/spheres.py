"""Registering depth cameras by a sphere marker shown in many places (V's first step), past V.

A cap of the sphere is fitted with its known radius: with the radius free, 0.3 mm of noise at 2.2 m
already costs 1.2 mm. V registers clouds to a reference camera by Procrustes. Here the arm carries
the sphere, so that its places are known in base but for where on the flange it hangs; all cameras
are solved at once with an offset and a scale of depth each, for V's errors of 3-5 cm were bias, not
noise (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Mask, Points, Pose, Poses, Vector3
from armsight.errors import CalibrationError
from armsight.geometry.pose import exp, skew, transform
from armsight.geometry.registration import procrustes

MIDDLE = 2.0
"""Depth at which a camera's scale leaves its readings alone [m]."""
LEAST_PLACES = 6
"""Places of the sphere that a camera must have seen."""
OFFSET_SIGMA, SCALE_SIGMA, HANGS_SIGMA = 0.02, 0.01, 0.05
"""What is known before: a camera's depth offset [m] and scale, and where the sphere hangs [m]."""


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
) -> tuple[Pose, Mask]:
    """``T_target_source`` of most pairs and (n,) which of them agree within ``tolerance`` [m].

    Raises:
        CalibrationError: fewer than three pairs, or all on a line as far as ``tolerance`` tells.
    """
    n = len(source)
    if n < 3 or _thickness(source) < 0.6 * tolerance:
        raise CalibrationError(
            "point pairs: at least three that do not lie on a line are needed; show the marker in "
            "more places"
        )
    best: tuple[int, Pose] = (-1, np.eye(4))
    for _ in range(tries):
        pick = rng.choice(n, 3, replace=False)
        if _thickness(source[pick]) < 0.4 * tolerance:
            continue
        T = procrustes(source[pick], target[pick])
        good = np.linalg.norm(transform(T, source) - target, axis=1) < tolerance
        if good.sum() > best[0]:
            best = (int(good.sum()), T)
    T = best[1]
    good = np.linalg.norm(transform(T, source) - target, axis=1) < tolerance
    for _ in range(3):
        if good.sum() < 3:
            raise CalibrationError(
                "point pairs do not agree on any motion: marker mistaken, or pairs mixed up"
            )
        T = procrustes(source[good], target[good])
        good = np.linalg.norm(transform(T, source) - target, axis=1) < tolerance
    return T, np.asarray(good, bool)


def _thickness(p: Points) -> float:
    """Second largest extent of points [m]: 0 on a line."""
    return float(np.linalg.svd(p - p.mean(0), compute_uv=False)[1] / np.sqrt(len(p)))


@dataclass(frozen=True)
class SphereRegistration:
    """Cameras in the arm's base, by the sphere that it carries.

    Attributes:
        T_base_camera: (c, 4, 4); NaN for a camera that saw too little.
        covariance: (c, 6, 6) of the poses (translation [m], rotation [rad], in each camera's axes).
        offset: (c,) depth that a camera reads too much at 2 m [m]; scale: (c,) more each metre.
        hangs: (3,) the sphere's centre in the flange's frame [m].
        used: (c,) places that counted; rms: (c,) distance of their centres from the arm's [m].
    """

    T_base_camera: Poses
    covariance: Floats
    offset: Floats
    scale: Floats
    hangs: Vector3
    used: tuple[int, ...]
    rms: Floats


def register_spheres(
    T_base_flange: Poses,
    seen: Sequence[Sequence[Vector3 | None]],
    hangs: Vector3,
    rng: np.random.Generator,
    sigma: float = 0.002,
    tolerance: float = 0.05,
) -> SphereRegistration:
    """Cameras in base from a sphere's centres in each one's frame, the arm carrying it.

    Args:
        T_base_flange: (k, 4, 4) where the arm stood at each place.
        seen: of each place, the centre in each camera's frame [m], or None where it was not seen.
        hangs: (3,) about where the sphere's centre is in the flange's frame [m].
        rng: for the start.
        sigma: of a centre, the arm's own error included [m].
        tolerance: a place further off than this at the start is a mistaken marker [m].

    Raises:
        CalibrationError: no camera saw enough places, or they all lie on a line.
    """
    T_arm = np.asarray(T_base_flange, float)
    hangs = np.asarray(hangs, float)
    places = T_arm[:, :3, :3] @ hangs + T_arm[:, :3, 3]
    count = len(seen[0]) if seen else 0
    z = np.full((count, len(seen), 3), np.nan)
    for k, row in enumerate(seen):
        for c, p in enumerate(row):
            if p is not None:
                z[c, k] = p
    there: Mask = np.isfinite(z).all(2)
    T = np.full((count, 4, 4), np.nan)
    problem: CalibrationError | None = None
    for c in range(count):
        if there[c].sum() < LEAST_PLACES:
            there[c] = False
            continue
        try:
            T[c], good = procrustes_ransac(z[c, there[c]], places[there[c]], rng, tolerance)
        except CalibrationError as error:
            problem, there[c] = error, False
            continue
        if good.sum() < LEAST_PLACES:
            there[c] = False
            problem = CalibrationError(
                f"only {good.sum()} of {len(good)} places of the sphere agree with the arm to "
                f"{1e3 * tolerance:.0f} mm, at least {LEAST_PLACES} are needed; check that it "
                "hangs firmly on the arm and that nothing else looks like it"
            )
            continue
        there[c, np.flatnonzero(there[c])[~good]] = False
    if not there.any():
        raise problem or CalibrationError(
            f"no camera saw the sphere in {LEAST_PLACES} places; check that it hangs on the arm, "
            "its diameter, and that the cameras look at it"
        )
    return _refine(T_arm, z, there, T, hangs, sigma)


def _refine(
    T_arm: Poses, z: Floats, there: Mask, start: Poses, hangs: Vector3, sigma: float
) -> SphereRegistration:
    """All cameras and the sphere's place on the flange at once: Gauss-Newton, Huber weights.

    Of each camera: twist in its own axes, offset and scale of depth; last, the sphere's place.
    """
    used = np.flatnonzero(there.any(1))
    n = 8 * len(used) + 3
    T, x = start.copy(), np.zeros(n)
    x[-3:] = hangs
    prior = np.zeros(n)
    prior[6:-3:8], prior[7:-3:8] = OFFSET_SIGMA**-2, SCALE_SIGMA**-2
    prior[-3:] = HANGS_SIGMA**-2
    mean = np.zeros(n)
    mean[-3:] = hangs
    rms = np.full(len(z), np.nan)
    H = np.eye(n)
    for _ in range(30):
        H, g = np.diag(prior), prior * (x - mean)
        for i, c in enumerate(used):
            seen = z[c, there[c]]
            offset, scale = x[8 * i + 6], x[8 * i + 7]
            away = seen[:, 2:]
            true = seen * (1.0 - (offset + scale * (away - MIDDLE)) / away)
            arm = T_arm[there[c]]
            R = T[c, :3, :3]
            r = transform(T[c], true) - arm[:, :3, :3] @ x[-3:] - arm[:, :3, 3]
            J = np.zeros((len(seen), 3, n))
            J[:, :, 8 * i : 8 * i + 3] = R
            J[:, :, 8 * i + 3 : 8 * i + 6] = np.array([-R @ skew(p) for p in true])
            ray = (seen / away) @ R.T
            J[:, :, 8 * i + 6] = -ray
            J[:, :, 8 * i + 7] = -ray * (away - MIDDLE)
            J[:, :, -3:] = -arm[:, :3, :3]
            length = np.linalg.norm(r, axis=1)
            knee = max(3.0 * sigma, 3.0 * float(np.median(length)))
            w = np.minimum(1.0, knee / np.maximum(length, 1e-12)) / sigma**2
            H = H + np.einsum("kai,k,kaj->ij", J, w, J)
            g = g + np.einsum("kai,k,ka->i", J, w, r)
            rms[c] = np.sqrt(np.mean(length**2))
        step = -np.linalg.solve(H, g)
        for i, c in enumerate(used):
            T[c] = T[c] @ exp(step[8 * i : 8 * i + 6])
            x[8 * i + 6 : 8 * i + 8] += step[8 * i + 6 : 8 * i + 8]
        x[-3:] += step[-3:]
        if np.abs(step).max() < 1e-10:
            break
    inverse = np.linalg.inv(H)
    covariance = np.full((len(z), 6, 6), np.nan)
    offset, scale = np.full(len(z), np.nan), np.full(len(z), np.nan)
    for i, c in enumerate(used):
        # Three coordinates a place: what is scattered more than sigma is as much less sure.
        worse = max(1.0, rms[c] / (np.sqrt(3.0) * sigma)) ** 2
        covariance[c] = worse * inverse[8 * i : 8 * i + 6, 8 * i : 8 * i + 6]
        offset[c], scale[c] = x[8 * i + 6 : 8 * i + 8]
    counts = tuple(int(row.sum()) for row in there)
    return SphereRegistration(T, covariance, offset, scale, x[-3:].copy(), counts, rms)
