"""What the cameras of V's cell would say, drawn from the errors that rendered pictures showed.

The pair sees sharply and near, the fixed cameras coarsely and far, and each stands elsewhere than
the cell believes (docs/servoing.md).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from armsight.arrays import Floats, JointVector, Points, Pose, Vector3
from armsight.geometry.pose import inverse
from armsight.motion.task import Perceived
from armsight.robots.kinematics import flange_pose, sphere_centers, tcp_pose
from armsight.robots.robot import Robot
from armsight.servoing.eyes import Eye, WristEye
from armsight.servoing.sighting import Look, Looks, Sighting

RADIUS = 0.04
ASLANT = 0.25
"""A print is not found by who sees it more aslant: cosine with its normal [1]."""
ON_ITS_WAY = 0.002
"""A picture that has arrived waits so long for an eye [s]."""
Path = Callable[[float], Vector3]
"""(3,) place in ``base`` [m] at a time [s]."""


@dataclass(frozen=True)
class Errors:
    """How wrong the cell is about itself; standard deviations an axis.

    Attributes:
        fixed_mm, fixed_deg: of a fixed camera's pose; depth_mm: its systematic error of depth.
        wrist_mm, wrist_deg: of the pair on the flange.
        arm: scale of the arm's absolute errors.
        fixed_noise_mm, wrist_noise_mm: of one sighting; a pair's is twice that along its axis.
        drop: share of pictures in which the target is not found.
        jitter: of the stamps, uniform [s].
        hidden_near: share of the pair's pictures in which what the tool holds hides the target,
            nearer than 0.35 m.
    """

    fixed_mm: float = 3.0
    fixed_deg: float = 0.2
    depth_mm: float = 3.0
    wrist_mm: float = 3.0
    wrist_deg: float = 0.2
    arm: float = 1.0
    fixed_noise_mm: float = 1.2
    wrist_noise_mm: float = 0.15
    drop: float = 0.02
    jitter: float = 0.002
    hidden_near: float = 0.0


PAPERS = Errors(fixed_mm=14.0, fixed_deg=0.5, depth_mm=8.0, wrist_mm=5.0, wrist_deg=0.4)
"""V's: 3 cm on average between the fixed cameras, 1 cm of the pair."""


@dataclass
class ModelCamera:
    """One fixed camera: where it is believed and where it is, and when it looks.

    Attributes:
        name: of the camera; believed, true: ``T_base_camera``.
        depth: systematic error along the ray [m].
        phase, rate, latency: of its pictures, and exposure to look [s].
    """

    name: str
    believed: Pose
    true: Pose
    depth: float
    phase: float
    rate: float = 5.0
    latency: float = 0.040 + ON_ITS_WAY + Eye.latency


@dataclass
class ModelPair:
    """The pair on the flange."""

    believed: Pose
    true: Pose
    rate: float = 10.0
    latency: float = 0.050 + ON_ITS_WAY + WristEye.latency
    half: tuple[float, float] = (math.tan(math.radians(22.5)), math.tan(math.radians(15.45)))


@dataclass
class Eyes:
    """Draws the looks of a cell's cameras at a moving ball.

    Attributes:
        hidden: camera or ``all``, and from when to when it sees nothing [s].
        normal: (3,) of a flat target, which is seen from before it only; None for a ball.
        along: (3,) where the target goes on, which fixed cameras see; None for one that ends.
        screens: (k, 3) middles and (k,) radii of balls that hide the target from fixed cameras [m].
        marked: the tool has a mark that the pair sees.
        lies: by how much the stamps of a camera are later than its exposures [s]; the pair is then
            taken to be where the joints were at the stamp.
        aside: (3,) how far a tip on springs is out of its seat now, in ``base`` [m].
    """

    fixed: list[ModelCamera]
    pair: ModelPair | None
    robot: Robot
    true_robot: Robot
    errors: Errors
    rng: np.random.Generator
    hidden: list[tuple[str, float, float]] = field(default_factory=list)
    glossy: bool = False
    normal: Vector3 | None = None
    along: Vector3 | None = None
    screens: tuple[Points, Floats] | None = None
    marked: bool = True
    lies: dict[str, float] = field(default_factory=dict)
    aside: Vector3 = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        self._due: dict[str, float] = {c.name: c.phase for c in self.fixed}
        self._due["wrist"] = 0.005
        self._waiting: list[tuple[float, Look]] = []
        self._lying: list[tuple[float, Look]] = []
        self._joints: deque[tuple[float, JointVector]] = deque(maxlen=32)

    def expose(self, now: float, q: JointVector, ball: Path) -> None:
        """Take what is due at ``now`` [s] with the joints (n,) as they are."""
        if self.lies:
            self._joints.append((now, q.copy()))
            self._waiting += [(at, self._moved_along(k)) for at, k in self._lying if k.stamp <= now]
            self._lying = [one for one in self._lying if one[1].stamp > now]
        for camera in self.fixed:
            if now >= self._due[camera.name] - 1e-9:
                self._due[camera.name] += 1.0 / camera.rate
                self._send(now, camera.latency, self._fixed(camera, now, q, ball(now)))
        if self.pair is not None and now >= self._due["wrist"] - 1e-9:
            self._due["wrist"] += 1.0 / self.pair.rate
            self._send(now, self.pair.latency, self._wrist(self.pair, now, q, ball(now)))

    def arrived(self, now: float) -> tuple[Perceived, ...]:
        """What perceivers have published by ``now`` [s]: the newest of each."""
        newest: dict[str, Look] = {}
        for at, look in self._waiting:
            if at <= now + 1e-9:
                newest[look.camera] = look
        self._waiting = [w for w in self._waiting if w[0] > now + 1e-9 or w[1] in newest.values()]
        return tuple(
            Perceived(f"eye/{name}", Looks(look.stamp, (look,))) for name, look in newest.items()
        )

    def _send(self, now: float, latency: float, look: Look) -> None:
        lie = self.lies.get(look.camera, 0.0)
        stamp = look.stamp + self.rng.uniform(-1, 1) * self.errors.jitter + lie
        seen = tuple(replace(s, stamp=stamp) for s in look.sightings)
        told = (now + latency, replace(look, stamp=stamp, sightings=seen))
        (self._lying if lie and look.wrist else self._waiting).append(told)

    def _moved_along(self, look: Look) -> Look:
        """What the pair saw, if it is taken to have been where the joints were at the stamp."""
        assert self.pair is not None
        _, q = min(self._joints, key=lambda one: abs(one[0] - look.stamp))
        T = flange_pose(self.robot, q) @ self.pair.believed
        A = T @ inverse(look.T_base_camera)
        seen = tuple(
            replace(
                s,
                position=(A @ [*s.position, 1.0])[:3],
                surface=(A @ [*s.surface, 1.0])[:3],
                normal=None if s.normal is None else A[:3, :3] @ s.normal,
            )
            for s in look.sightings
        )
        mark = None if look.mark is None else A[:3, :3] @ look.mark
        return replace(look, T_base_camera=T, sightings=seen, mark=mark)

    def _sees(self, name: str, now: float) -> bool:
        if any(who in (name, "all") and a <= now < b for who, a, b in self.hidden):
            return False
        return bool(self.rng.random() >= self.errors.drop)

    def _fixed(self, camera: ModelCamera, now: float, q: JointVector, ball: Vector3) -> Look:
        eye = camera.true[:3, 3]
        ray = (ball - eye) / np.linalg.norm(ball - eye)
        look = Look(camera.name, now, False, camera.believed)
        if not self._sees(camera.name, now) or self._covered(q, eye, ball):
            return look
        if self.normal is not None and float(self.normal @ ray) > -ASLANT:
            return look
        noise = 1e-3 * self.errors.fixed_noise_mm
        seen = ball + self.rng.normal(0, noise, 3) + camera.depth * ray
        place = _moved(camera, seen)
        cap = 0.0 if self.normal is not None else 2.0 / 3.0 * RADIUS
        near = seen - cap * ray + self.rng.normal(0, 0.003, 3)
        sigma = noise**2 * np.eye(3)
        found = _sighting(camera.name, now, place, sigma, _moved(camera, near))
        if self.along is not None:
            along = self.along + self.rng.normal(0, 0.1, 3)
            found = replace(found, along=along / np.linalg.norm(along))
        return replace(look, sightings=(self._facing(found, 0.015),))

    def _facing(self, sighting: Sighting, tilt: float) -> Sighting:
        """With the normal of a flat target, as well as it is seen [rad]."""
        if self.normal is None:
            return sighting
        normal = self.normal + self.rng.normal(0, tilt, 3)
        return replace(sighting, normal=normal / np.linalg.norm(normal), tilt=tilt)

    def _wrist(self, pair: ModelPair, now: float, q: JointVector, ball: Vector3) -> Look:
        T_true = flange_pose(self.true_robot, q) @ pair.true
        T_believed = flange_pose(self.robot, q) @ pair.believed
        p = T_true[:3, :3].T @ (ball - T_true[:3, 3])
        noise = 1e-3 * self.errors.wrist_noise_mm * np.array([1.0, 1.0, 2.0])
        mark = self._mark(q, T_true, T_believed, noise) if self.marked else None
        sigma = T_believed[:3, :3] @ np.diag(noise**2) @ T_believed[:3, :3].T
        look = Look("wrist", now, True, T_believed, mark=mark, mark_covariance=sigma)
        margin = 0.3 * RADIUS / max(p[2], 0.05)
        left = abs(p[0]) < (pair.half[0] - margin) * p[2]
        right = abs(p[0] - 0.06) < (pair.half[0] - margin) * p[2]
        inside = left and right and abs(p[1]) < (pair.half[1] - margin) * p[2]
        if self.normal is not None:
            inside = inside and float(self.normal @ (ball - T_true[:3, 3])) < 0.0
        if not (inside and 0.12 < p[2] < 0.8) or not self._sees("wrist", now):
            return look
        if p[2] < 0.35 and self.rng.random() < self.errors.hidden_near:
            return look
        p = p + self.rng.normal(0, 1, 3) * noise * max(p[2] / 0.27, 1.0) ** 2
        place = T_believed[:3, :3] @ p + T_believed[:3, 3]
        surface = _planes(p, self.rng, self.glossy, 0.0 if self.normal is not None else RADIUS)
        near = T_believed[:3, :3] @ surface + T_believed[:3, 3]
        found = _sighting("wrist", now, place, sigma, near, True)
        return replace(look, sightings=(self._facing(found, 0.003),))

    def _mark(self, q: JointVector, T_true: Pose, T_believed: Pose, noise: Floats) -> Vector3:
        """The stylus' tip as the pair sees it, less where the joints say that it is."""
        at = np.array([0.0, 0.0, -0.005, 1.0])
        tip = (tcp_pose(self.true_robot, q) @ at)[:3] + self.aside
        p = T_true[:3, :3].T @ (tip - T_true[:3, 3]) + self.rng.normal(0, 1, 3) * noise
        seen = T_believed[:3, :3] @ p + T_believed[:3, 3]
        return np.asarray(seen - (tcp_pose(self.robot, q) @ at)[:3])

    def _covered(self, q: JointVector, eye: Vector3, ball: Vector3) -> bool:
        """Whether the arm, or a screen, stands before more than about half of the ball."""
        centers, widths = sphere_centers(self.true_robot, q), 0.8 * self.robot.spheres.radius
        if self.screens is not None:
            centers = np.concatenate([centers, self.screens[0]])
            widths = np.concatenate([widths, self.screens[1]])
        way = ball - eye
        length = float(np.linalg.norm(way))
        along = (centers - eye) @ way / length
        across = np.linalg.norm(np.cross(centers - eye, way / length), axis=1)
        before = (along > 0.1) & (along < length - RADIUS)
        return bool((before & (across < widths)).any())


def _sighting(
    camera: str, now: float, place: Vector3, sigma: Floats, near: Vector3, wrist: bool = False
) -> Sighting:
    return Sighting("ball", camera, now, place, sigma, near, None, wrist)


def _moved(camera: ModelCamera, point: Vector3) -> Vector3:
    """A point as the cell believes it: through the true pose, back through the believed one."""
    T = camera.believed @ inverse(camera.true)
    return np.asarray(T[:3, :3] @ point + T[:3, 3])


def _planes(p: Vector3, rng: np.random.Generator, glossy: bool, radius: float) -> Vector3:
    """Mean of the visible surface by V's planes, in the pair's frame; gloss puts it deeper."""
    away = float(np.linalg.norm(p))
    near = p * (1.0 - 2.0 / 3.0 * radius / away)
    step = 0.20 / 29
    depth = round((near[2] + rng.normal(0, 0.002)) / step) * step
    if glossy and rng.random() < 0.1:
        depth += rng.uniform(0.01, 0.03)
    depth = min(max(depth, 0.20), 0.40)
    return np.asarray(near * depth / near[2])
