"""An arm's surface: its triangles, and points spread over what can be seen of it from outside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from armsight.arrays import DepthImage, Floats, Ints, Ints32, JointVector, Mask, Points, Pose
from armsight.geometry.pose import inverse, look_at, transform
from armsight.recognition.own_arm.kernels import rasterise
from armsight.robots.kernels import carried_points
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import Triangles, join_triangles, read_mesh
from armsight.robots.robot import Robot

SPACING = 0.02
"""Between points of the surface [m]."""
NEAR = 0.1
"""Nothing nearer to the camera is drawn [m]."""


@dataclass(frozen=True)
class ArmSurface:
    """What of an arm, with its tool, meets the eye.

    Attributes:
        robot: whose.
        vertices: (v, 3) corners of the triangles in their links' frames [m]; link: (v,) of each.
        faces: (f, 3) triangles.
        points, normals: (m, 3) spread over the outside, in the links' frames; owner: (m,) links.
    """

    robot: Robot
    vertices: Points
    link: Ints
    faces: Ints
    points: Points
    normals: Points
    owner: Ints

    @cached_property
    def face_link(self) -> Ints:
        """(f,) link of each triangle."""
        return np.ascontiguousarray(self.link[self.faces[:, 0]])

    def posed(self, q: JointVector) -> Points:
        """(v, 3) corners in ``base`` at (n,) joint angles [rad]."""
        return carried_points(link_poses(self.robot, q), self.link, self.vertices)

    def posed_points(self, q: JointVector) -> tuple[Points, Points]:
        """(m, 3) points [m] and (m, 3) normals in ``base`` at (n,) joint angles [rad]."""
        T = link_poses(self.robot, q)
        normals = (T[self.owner, :3, :3] @ self.normals[:, :, None])[..., 0]
        return carried_points(T, self.owner, self.points), np.asarray(normals)


@dataclass(frozen=True)
class Rendered:
    """An arm as a straight lens sees it.

    Attributes:
        depth: (h, w) [m], infinite where it is not.
        link: (h, w) index of the link seen, -1 where none is.
        points: (k, 3) of the pixels that see it, in ``base``; at: (k, 2) row and column.
        owner: (k,) their links.
        triangles: (k, 3, 3) corners of what each sees, in ``base``.
    """

    depth: DepthImage
    link: Ints
    points: Points
    at: Ints
    owner: Ints
    triangles: Floats

    @cached_property
    def normals(self) -> Points:
        """(k, 3) of the surface at ``points``, in ``base``."""
        return _normals(*self.triangles.transpose(1, 0, 2))

    @property
    def mask(self) -> Mask:
        """(h, w) where the arm is."""
        return np.asarray(self.link >= 0)


def render(
    surface: ArmSurface,
    corners: Points,
    T_camera_base: Pose,
    lens: Floats,
    size: tuple[int, int],
) -> Rendered:
    """Draw the arm.

    Args:
        surface: of the arm.
        corners: (v, 3) of its triangles in ``base``, from :meth:`ArmSurface.posed`.
        T_camera_base: the camera.
        lens: its nine numbers; the distortion is left out.
        size: width, height [px].
    """
    depth, face = drawn(surface, transform(T_camera_base, corners), lens, size)
    at = np.argwhere(face >= 0)
    row, column = at[:, 0], at[:, 1]
    z = depth[row, column].astype(float)
    x, y = (column - lens[2]) / lens[0] * z, (row - lens[3]) / lens[1] * z
    points = transform(inverse(T_camera_base), np.stack([x, y, z], 1))
    seen_faces = surface.faces[face[row, column]]
    owner = surface.face_link[face[row, column]]
    link = np.full(face.shape, -1, np.int64)
    link[row, column] = owner
    return Rendered(depth, link, points, at, owner, np.asarray(corners[seen_faces], np.float64))


def drawn(
    surface: ArmSurface, seen: Points, lens: Floats, size: tuple[int, int]
) -> tuple[DepthImage, Ints32]:
    """(h, w) depth [m] of an arm, infinite where it is not, and the triangle there, -1 for none.

    Args:
        surface: of the arm.
        seen: (v, 3) corners of its triangles in the camera's frame [m].
        lens: its nine numbers; the distortion is left out.
        size: width, height [px].
    """
    depth = np.full((size[1], size[0]), np.inf, np.float32)
    face = np.full((size[1], size[0]), -1, np.int32)
    rasterise(seen, surface.faces, lens, NEAR, depth, face)
    return depth, face


def arm_surface(robot: Robot) -> ArmSurface:
    """The surface of an arm with the tool that it carries; remembered for the last few arms."""
    tool = robot.tool.name if robot.tool is not None else ""
    return _surface(_Named(robot, f"{robot.name}/{tool}/{len(robot.meshes)}"))


@dataclass(frozen=True)
class _Named:
    """A robot that can be looked up: arrays cannot."""

    robot: Robot
    key: str

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Named) and other.robot is self.robot


@lru_cache(maxsize=8)
def _surface(named: _Named) -> ArmSurface:
    robot = named.robot
    parts: list[list[Triangles]] = [[] for _ in range(robot.n + 1)]
    for mesh in robot.meshes:
        parts[mesh.link].append(read_mesh(mesh))
    if robot.tool is not None:
        for mesh in robot.tool.meshes:
            vertices, faces = read_mesh(mesh)
            parts[robot.n].append((transform(robot.T_last_flange, vertices), faces))
    links = [join_triangles(p) for p in parts]
    vertices, faces = join_triangles(links)
    link = np.concatenate([np.full(len(v), k) for k, (v, _) in enumerate(links)])
    spread = [_outside(part) for part in links]
    return ArmSurface(
        robot,
        np.ascontiguousarray(vertices),
        link.astype(np.int64),
        np.ascontiguousarray(faces),
        np.concatenate([p for p, _ in spread]),
        np.concatenate([n for _, n in spread]),
        np.concatenate([np.full(len(p), k) for k, (p, _) in enumerate(spread)]).astype(np.int64),
    )


def _outside(triangles: Triangles) -> tuple[Points, Points]:
    """Points and normals of a link, one a cell of :data:`SPACING`, as 26 distant cameras see it."""
    vertices, faces = triangles
    if len(faces) == 0:
        return np.empty((0, 3)), np.empty((0, 3))
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.linalg.norm(vertices - middle, axis=1).max()) + 1e-3
    far = 20.0 * radius
    size = int(np.clip(2.0 * radius / (0.5 * SPACING), 16, 400))
    f = 0.5 * size * far / radius
    lens = np.array([f, f, 0.5 * (size - 1), 0.5 * (size - 1), 0, 0, 0, 0, 0.0])
    found: list[Points] = []
    steps = [np.array(s, float) for s in np.ndindex(3, 3, 3)]
    for direction in (s - 1.0 for s in steps if np.any(s != 1.0)):
        eye = middle + far * direction / np.linalg.norm(direction)
        up = (0.0, 1.0, 0.0) if abs(direction[2]) > 0 else (0.0, 0.0, 1.0)
        T = look_at(eye, middle, up)
        depth = np.full((size, size), np.inf, np.float32)
        face = np.full((size, size), -1, np.int32)
        rasterise(transform(inverse(T), vertices), faces, lens, 0.0, depth, face)
        row, column = np.nonzero(face >= 0)
        z = depth[row, column].astype(float)
        p = np.stack([(column - lens[2]) / f * z, (row - lens[3]) / f * z, z], 1)
        found.append(np.hstack([transform(T, p), _normals(*vertices[faces[face[row, column]].T])]))
    every = np.concatenate(found)
    # One a cell and a rough direction, so that both sides of a thin part are kept.
    cell = np.floor(every[:, :3] / SPACING).astype(np.int64)
    side = np.round(every[:, 3:]).astype(np.int64)
    _, first = np.unique(np.hstack([cell, side]), axis=0, return_index=True)
    kept = every[np.sort(first)]
    return kept[:, :3], kept[:, 3:]


def _normals(a: Points, b: Points, c: Points) -> Points:
    n = np.cross(b - a, c - a)
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-15))
