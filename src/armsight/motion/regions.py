"""A tracked region of space: where something is that the arm may touch, how sure, and how old."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from typing import Literal, TypeAlias

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.geometry.pose import cross

RegionShape: TypeAlias = Literal["sphere", "box", "capsule"]


@dataclass(frozen=True)
class Region:
    """A sphere, box or capsule that follows what was seen.

    Attributes:
        shape: sphere, box or capsule.
        size: sphere: (radius, 0, 0); box: full edges (x, y, z); capsule: (radius, distance between
            the ends' centres, 0), along its z [m].
        T_base_region: its centre's pose in ``base`` at the exposure.
        exposure: when it was seen [s].
        velocity: (3,) of the centre in ``base`` [m/s].
        covariance: (3, 3) of the centre at the exposure [m^2].
        drift: how fast its place becomes unsure while nobody sees it [m/s], one standard
            deviation: about 0 for what is bolted to the floor, 0.3 for a hand.
    """

    shape: RegionShape
    size: tuple[float, float, float]
    T_base_region: Pose
    exposure: float
    velocity: Vector3 = field(default_factory=lambda: np.zeros(3))
    covariance: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    drift: float = 0.1

    @property
    def speed(self) -> float:
        """Of its centre [m/s]."""
        return float(np.linalg.norm(self.velocity))

    @property
    def extent(self) -> float:
        """Greatest distance between two of its points [m]."""
        a, b, c = self.size
        if self.shape == "sphere":
            return 2.0 * a
        return math.hypot(a, b, c) if self.shape == "box" else b + 2.0 * a

    def earlier(self, back: float) -> Region:
        """The same by a clock that was turned back by so much [s]."""
        return replace(self, exposure=self.exposure - back)

    def half_box(self) -> Vector3:
        """(3,) half edges of the upright box of ``base`` around it [m]."""
        a, b, c = self.size
        R = np.abs(np.asarray(self.T_base_region, float)[:3, :3])
        if self.shape == "box":
            return np.asarray(R @ (0.5 * np.array([a, b, c])))
        return a + (0.5 * b * R[:, 2] if self.shape == "capsule" else np.zeros(3))

    def center(self, when: float) -> Vector3:
        """(3,) where its centre is expected at a time [s]."""
        return np.asarray(self.T_base_region[:3, 3] + (when - self.exposure) * self.velocity)

    def lattice(self, when: float, spacing: float) -> Points:
        """(n, 3) points in ``base`` in it at a time [s], at a distance [m]; its centre always."""
        half = 0.5 * self.extent
        steps = np.arange(-half, half + spacing, spacing)
        points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(-1, 3)
        points = np.concatenate([points, np.zeros((1, 3))]) + self.center(when)
        return np.asarray(points[self.distance(points, when) <= 1e-9])

    def deviation(self, when: float) -> float:
        """Standard deviation [m] of the centre at a time [s], along its worst direction."""
        return self._deviation_seen + self.drift * max(when - self.exposure, 0.0)

    @cached_property
    def _deviation_seen(self) -> float:
        """The same at the exposure [m]; asked for several times in every tick."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance)[-1]), 0.0))

    def distance(self, points: Points, when: float) -> Floats:
        """(n,) signed distance [m] of (n, 3) points in ``base`` at a time [s]; negative inside."""
        p = self._local(points, when)
        if self.shape == "box":
            q = np.abs(p) - 0.5 * np.asarray(self.size)
            outside = _lengths(np.maximum(q, 0.0))
            return np.asarray(outside + np.minimum(q.max(axis=1), 0.0))
        return np.asarray(_lengths(p - self._core(p)) - self.size[0])

    def towards(self, points: Points, when: float) -> Points:
        """(n, 3) unit vectors in ``base`` from outside points to the region's nearest point.

        Zero where a point is inside, or on the very core of a round shape.
        """
        p = self._local(points, when)
        if self.shape == "box":
            half = 0.5 * np.asarray(self.size)
            way = np.clip(p, -half, half) - p
        else:
            way = self._core(p) - p
            way[_lengths(way) <= self.size[0]] = 0.0
        length = _lengths(way)[:, None]
        unit = np.divide(way, length, out=np.zeros_like(way), where=length > 1e-9)
        return np.asarray(unit @ self.T_base_region[:3, :3].T)

    def outward(self, points: Points, when: float) -> Points:
        """(n, 3) unit vectors in ``base`` along which points get away soonest, from inside as well.

        Zero on the very core of a round shape.
        """
        p = self._local(points, when)
        if self.shape == "box":
            half = 0.5 * np.asarray(self.size)
            way = p - np.clip(p, -half, half)
            inside = np.flatnonzero(~way.any(axis=1))
            face = np.argmin(half - np.abs(p[inside]), axis=1)
            way[inside, face] = np.where(p[inside, face] < 0.0, -1.0, 1.0)
        else:
            way = p - self._core(p)
        length = _lengths(way)[:, None]
        unit = np.divide(way, length, out=np.zeros_like(way), where=length > 1e-9)
        return np.asarray(unit @ self.T_base_region[:3, :3].T)

    def _local(self, points: Points, when: float) -> Points:
        away = np.asarray(points, float).reshape(-1, 3) - self.center(when)
        return np.asarray(away @ self.T_base_region[:3, :3])

    def _core(self, p: Points) -> Points:
        """(n, 3) the nearest points of a round shape's centre or axis, in its own frame."""
        core = np.zeros_like(p)
        if self.shape == "capsule":
            half = 0.5 * self.size[1]
            core[:, 2] = np.clip(p[:, 2], -half, half)
        return core


def _lengths(ways: Points) -> Floats:
    """(n,) of (n, 3) vectors; numpy's norm takes twice as long for the few that a tick has."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", ways, ways)))


def region_fault(region: Region, now: float, future: float = 0.01) -> str:
    """What is wrong with a region, in words; empty when nothing is. Never raises.

    Args:
        region: whatever somebody claims to have seen.
        now: time [s].
        future: how far its exposure may lie ahead of the clock [s].
    """
    try:
        if region.shape not in ("sphere", "box", "capsule"):
            return f'its shape is "{region.shape}"; expected sphere, box or capsule'
        size = np.asarray(region.size, float)
        numbers = size.shape == (3,) and all(isinstance(edge, Real) for edge in region.size)
        if not numbers or not np.isfinite(size).all():
            return "its size must be three numbers in metres"
        needed = {"sphere": size[:1], "capsule": size[:1], "box": size}[region.shape]
        if (needed <= 0.0).any() or (size < 0.0).any():
            return f"its size is {tuple(float(s) for s in size)} m; expected above 0"
        T, velocity = region.T_base_region, region.velocity
        covariance = region.covariance
        for what, value in (("pose", T), ("velocity", velocity), ("covariance", covariance)):
            if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
                return f"its {what} is a {type(value).__name__}; expected an array of numbers"
        if T.shape != (4, 4) or not np.isfinite(T).all():
            return "its pose is no finite 4 x 4 matrix"
        R = T[:3, :3]
        turns = _near(R @ R.T, np.eye(3), 1e-6) and cross(R[0], R[1]) @ R[2] > 0.0
        if not (turns and _near(T[3], np.array([0.0, 0.0, 0.0, 1.0]), 1e-6)):
            return "its pose is not a rotation and a translation"
        if velocity.shape != (3,) or not np.isfinite(velocity).all():
            return "its velocity must be three numbers in m/s"
        if covariance.shape != (3, 3) or not np.isfinite(covariance).all():
            return "its covariance must be 3 x 3 numbers in m^2"
        symmetric = _near(covariance, covariance.T, 1e-8)
        if not symmetric or np.linalg.eigvalsh(covariance)[0] < -1e-12:
            return "its covariance is not symmetric and positive"
        if not (math.isfinite(region.drift) and region.drift >= 0.0):
            return f"its drift is {region.drift} m/s; expected 0 or more"
        if not math.isfinite(region.exposure):
            return "its exposure must be a time in seconds"
        if region.exposure > now + future:
            return f"it was seen {region.exposure - now:.3f} s in the future; check the clocks"
    except (TypeError, ValueError, AttributeError, np.linalg.LinAlgError) as error:
        return f"it cannot be read: {error}"
    return ""


def _near(a: Floats, b: Floats, tolerance: float) -> bool:
    """Whether finite numbers are the same by numpy's ``allclose``, in a fifth of its time."""
    return bool((np.abs(a - b) <= tolerance + 1e-5 * np.abs(b)).all())
