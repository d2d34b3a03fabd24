"""Arms as they are drawn: those of the catalogue, and made-up ones that are called unknown."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

import numpy as np

from armsight.arrays import Floats, Ints, JointVector, Points, Pose, Poses
from armsight.geometry.pose import make_pose
from armsight.recognition.data.things import Color, Kind, z_to
from armsight.robots.catalogue import is_path, load_robot
from armsight.robots.kernels import chain_poses
from armsight.robots.meshes import read_mesh
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class ArmPart:
    """One surface of a link, in its frame; see :class:`Thing` for kind and size."""

    link: int
    kind: Kind
    size: tuple[float, float, float]
    T_link_part: Pose
    color: Color
    mesh: str = ""


@dataclass(frozen=True)
class Arm:
    """What is needed to pose and to draw an arm of n joints.

    Attributes:
        name: robot type.
        T_link_joint: (n, 4, 4) joint i's frame at zero in link i's.
        axis: (n, 3) in the joint's frame.
        T_last_flange: the flange in the last link's frame.
        lower, upper: (n,) range of the joints [rad], at most a turn.
        parts: what is seen.
        sphere_link, sphere_center, sphere_radius: the body as spheres, in the links' frames.
        pairs: (p, 2) links that may not touch.
        reach: [m].
    """

    name: str
    T_link_joint: Poses
    axis: Points
    T_last_flange: Pose
    lower: JointVector
    upper: JointVector
    parts: tuple[ArmPart, ...]
    sphere_link: Ints
    sphere_center: Points
    sphere_radius: Floats
    pairs: Ints
    reach: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.axis)

    def link_poses(self, q: JointVector, T_link_joint: Poses | None = None) -> Poses:
        """(n + 1, 4, 4) ``T_base_link``; with another geometry if one is given."""
        geometry = self.T_link_joint if T_link_joint is None else T_link_joint
        return np.asarray(chain_poses(np.ascontiguousarray(q, np.float64), geometry, self.axis))

    def spheres(self, T_x_link: Poses) -> Points:
        """(m, 3) centres of the body's spheres in a frame x, of the links' poses in it."""
        T = T_x_link[self.sphere_link]
        moved = (T[:, :3, :3] @ self.sphere_center[:, :, None])[..., 0] + T[:, :3, 3]
        return np.asarray(moved)


@cache
def catalogue_arm(name: str) -> Arm:
    """An arm of the catalogue."""
    robot = load_robot(name)
    parts = tuple(
        ArmPart(m.link, "mesh", (1.0, 1.0, 1.0), np.eye(4), m.color, f"{name}/{k}")
        for k, m in enumerate(robot.meshes)
    )
    # A whole turn covers every picture of a joint that can turn twice.
    return Arm(
        name,
        np.ascontiguousarray(robot.T_link_joint),
        np.ascontiguousarray(robot.axis),
        robot.T_last_flange,
        np.maximum(robot.limits.lower, -np.pi),
        np.minimum(robot.limits.upper, np.pi),
        parts,
        robot.spheres.link,
        robot.spheres.center,
        robot.spheres.radius,
        robot.self_pairs,
        robot.reach,
    )


def mesh_hash(name: str) -> str:
    """SHA-256 of the surface that is drawn of a robot and of the spheres that keep it free.

    Of a user's own also of its joints, which may be mended while a set is made.
    """
    return _hash(load_robot(name), is_path(name))


def _hash(robot: Robot, joints: bool) -> str:
    digest = hashlib.sha256()
    spheres = robot.spheres
    for values in (spheres.link, spheres.center, spheres.radius):
        digest.update(np.ascontiguousarray(values, "<f8").tobytes())
    for mesh in robot.meshes:
        vertices, faces = read_mesh(mesh)
        digest.update(np.ascontiguousarray(vertices, "<f8").tobytes())
        digest.update(np.ascontiguousarray(faces, "<i8").tobytes())
        digest.update(np.array([mesh.link, *mesh.color], "<f8").tobytes())
    if joints:
        limits = robot.limits.lower, robot.limits.upper
        for values in (robot.T_link_joint, robot.axis, robot.T_last_flange, *limits):
            digest.update(np.ascontiguousarray(values, "<f8").tobytes())
    return digest.hexdigest()


def made_up_arm(rng: np.random.Generator) -> Arm:
    """An arm of 4 to 7 joints with links of random shapes, as no maker sells it.

    Axes turn up, then alternate between bending and twisting as arms' do.
    """
    n = int(rng.integers(4, 8))
    scale = float(rng.uniform(0.6, 1.5))
    radius = scale * rng.uniform(0.04, 0.075)
    palette = [_color(rng) for _ in range(3)]
    T = np.zeros((n, 4, 4))
    axis = np.zeros((n, 3))
    parts: list[ArmPart] = []
    spheres: list[tuple[int, Floats, float]] = []
    offset = np.array([0.0, 0.0, scale * rng.uniform(0.1, 0.2)])
    for i in range(n):
        T[i] = make_pose(None, offset)
        axis[i] = [0.0, 0.0, 1.0] if i == 0 or (i % 2 == 1 and i >= 3) else [0.0, 1.0, 0.0]
        _made_up_link(rng, parts, spheres, i, offset, radius, palette)
        radius *= rng.uniform(0.82, 1.0)
        long = scale * (rng.uniform(0.2, 0.42) if i in (1, 2) else rng.uniform(0.06, 0.16))
        side = scale * rng.uniform(-0.09, 0.09) if i in (1, 2) else 0.0
        offset = np.array([0.0, side, long])
    _made_up_link(rng, parts, spheres, n, offset, radius, palette)
    links = np.array([s[0] for s in spheres], np.int64)
    pairs = np.array([(a, b) for a in range(n + 1) for b in range(a + 3, n + 1)], np.int64)
    turn = np.full(n, np.pi)
    turn[1::2] = rng.uniform(1.6, 2.4)
    return Arm(
        "unknown",
        T,
        axis,
        make_pose(None, offset),
        -turn,
        turn,
        tuple(parts),
        links,
        np.array([s[1] for s in spheres]),
        np.array([s[2] for s in spheres]),
        pairs.reshape(-1, 2),
        float(sum(np.linalg.norm(T[i, :3, 3]) for i in range(1, n)) + np.linalg.norm(offset)),
    )


def _made_up_link(
    rng: np.random.Generator,
    parts: list[ArmPart],
    spheres: list[tuple[int, Floats, float]],
    link: int,
    end: Floats,
    radius: float,
    palette: list[Color],
) -> None:
    """A housing about the joint, and a limb to the next one."""
    color, dark = palette[link % 2], palette[2]
    length = float(np.linalg.norm(end))
    R = z_to(end)
    limb: Kind = "box" if rng.random() < 0.3 else ("cylinder" if rng.random() < 0.5 else "capsule")
    r = radius * rng.uniform(0.7, 0.95)
    half = (r, r * (rng.uniform(0.7, 1.0) if limb == "box" else 1.0), 0.5 * length)
    parts.append(ArmPart(link, limb, half, make_pose(R, 0.5 * end), color))
    if link > 0:
        housing: Kind = "cylinder" if rng.random() < 0.7 else "ellipsoid"
        tall = radius * rng.uniform(1.0, 1.5)
        side = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # across the limb
        parts.append(
            ArmPart(
                link,
                housing,
                (radius * 1.1, radius * 1.1, tall),
                make_pose(side if rng.random() < 0.6 else np.eye(3)),
                dark if rng.random() < 0.4 else color,
            )
        )
    else:
        parts.append(ArmPart(0, "cylinder", (radius * 1.5, radius * 1.5, 0.02), make_pose(), dark))
    for k in np.linspace(0.0, 1.0, max(2, int(length / radius) + 1)):
        spheres.append((link, end * k, radius * 1.2))


def _color(rng: np.random.Generator) -> Color:
    base = rng.uniform(0.05, 0.95)
    tint = rng.uniform(-0.3, 0.3, 3) * (rng.random() < 0.5)
    r, g, b = np.clip(base + tint, 0.02, 1.0)
    return float(r), float(g), float(b)
