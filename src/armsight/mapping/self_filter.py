"""The arm in its own images: link distance fields tell which pixels and voxels are the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from armsight.arrays import (
    Bytes,
    DepthImage,
    Floats,
    Floats32,
    Ints,
    Ints32,
    Mask,
    Points,
    Pose,
    Poses,
)
from armsight.errors import ArmsightError
from armsight.geometry.pose import inverse, inverses, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.kernels.body import (
    capsule_distance,
    label_body,
    mark_body,
    mesh_distance,
    spread_distance,
    winding,
)
from armsight.mapping.lens import DepthLens
from armsight.mapping.snapshot import VoxelGrid
from armsight.robots.cable import PIECES, HungCable, SwingingCable
from armsight.robots.kernels import carried_motion_into
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import join_triangles, read_mesh
from armsight.robots.robot import LinkMesh, Robot

CELL = 0.01
"""Spacing of a link field's nodes [m]."""
BAND = 0.06
"""How far beyond a link's surface its field reaches [m]: the greatest useful tolerance."""
ASTRAY = 0.04
"""A cable is no farther than this from where its chain swings [m]: who knows how it bends?"""


@dataclass(frozen=True)
class BodyFields:
    """Signed distance to each moving part of the body, on small grids in the parts' frames.

    Attributes:
        link: (m,) which link carries each part.
        T_link_grid: (m, 4, 4) the grid's corner node in the link's frame [m].
        values: flat float32 distances [m], one part after the other, C order.
        offset: (m,) where each part begins in ``values``.
        shape: (m, 3) nodes of each.
        gives: (m,) which hang in the tool's soft mount.
    """

    link: Ints
    T_link_grid: Poses
    values: Floats32
    offset: Ints
    shape: Ints
    gives: Mask


def body_fields(robot: Robot, from_meshes: bool = True) -> BodyFields:
    """Distance fields of an arm, of its tool and of what it holds.

    Links are taken from their meshes; a link without one, or all with ``from_meshes`` false, from
    the capsules. A tool in a soft mount is a part of its own.

    Args:
        robot: the arm, with its tool and what that holds.
        from_meshes: meshes are tighter than capsules.

    Raises:
        ArmsightError: the arm has no shapes at all.
    """
    tool = robot.tool
    soft = tool is not None and tool.mount is not None
    parts: list[tuple[int, Floats32, Floats]] = []
    gives: list[bool] = []
    for link in range(robot.n + 1):
        own, of_tool = _shapes(robot, link, from_meshes)
        if not soft:
            own, of_tool = (own[0] + of_tool[0], own[1] + of_tool[1]), ([], [])
        for shapes, moves in ((own, False), (of_tool, True)):
            if any(shapes):
                parts.append((link, *_field(*shapes)))
                gives.append(moves)
    for solid in () if tool is None else tool.held:
        parts.append((robot.n, *_solid_field(solid, robot.T_last_flange)))
        gives.append(soft)
    if not parts:
        raise ArmsightError(
            f"robot {robot.name} has neither link meshes nor capsules, so it cannot be told from "
            "obstacles: give its URDF visual meshes, or fit its capsules"
        )
    return _pack(parts, gives)


_Shapes = tuple[list[tuple[Floats, Ints]], list[tuple[Floats, Floats, float]]]
"""Meshes, and capsules where there is none."""


def _shapes(robot: Robot, link: int, from_meshes: bool) -> tuple[_Shapes, _Shapes]:
    """A link's own shapes, and those of the tool that it carries, in the link's frame."""
    tool, c = robot.tool, robot.capsules
    meshes = [_load(m, np.eye(4)) for m in robot.meshes if from_meshes and m.link == link]
    of_tool = []
    # Of a link that has no mesh the tool's capsules are taken, too.
    if tool is not None and link == robot.n and meshes:
        of_tool = [_load(m, robot.T_last_flange) for m in tool.meshes]
    rows = np.flatnonzero(np.asarray(c.link) == link)
    bare = len(c.link) - (0 if tool is None else len(tool.capsules.link))

    def rods(listed: Ints) -> list[tuple[Floats, Floats, float]]:
        return [(c.start[r], c.end[r], float(c.radius[r])) for r in listed]

    own = (meshes, [] if meshes else rods(rows[rows < bare]))
    return own, (of_tool, [] if of_tool else rods(rows[rows >= bare]))


def _load(mesh: LinkMesh, T_link_mesh: Pose) -> tuple[Floats, Ints]:
    vertices, faces = read_mesh(mesh)
    placed = transform(T_link_mesh, vertices)
    return np.ascontiguousarray(placed), np.ascontiguousarray(faces, np.int64)


def _field(
    meshes: list[tuple[Floats, Ints]], capsules: list[tuple[Floats, Floats, float]]
) -> tuple[Floats32, Floats]:
    """Field and corner of one part, in the link's frame."""
    vertices, faces = join_triangles(list(meshes))
    rods = np.array([[*a, *b, r] for a, b, r in capsules], float)
    return _field_of(vertices.tobytes(), faces.tobytes(), rods.tobytes())


@lru_cache(maxsize=64)
def _field_of(vertices: bytes, faces: bytes, capsules: bytes) -> tuple[Floats32, Floats]:
    """The same from (n, 3) float64, (m, 3) int64 and (k, 7) float64: every map of an arm asks."""
    points = np.frombuffer(vertices).reshape(-1, 3).copy()
    triangles = np.frombuffer(faces, np.int64).reshape(-1, 3).copy()
    rods = np.frombuffer(capsules).reshape(-1, 7).copy()
    ends, radius = rods[:, :6].reshape(-1, 3), np.repeat(rods[:, 6:], 2, axis=0)
    low = np.concatenate([points, ends - radius]).min(axis=0)
    high = np.concatenate([points, ends + radius]).max(axis=0)
    field, corner = _empty(low, high)
    if len(points):
        _mesh_field(points, triangles, corner, field)
    for rod in rods:
        capsule_distance(rod[:3], rod[3:6], rod[6], corner, CELL, field)
    field.flags.writeable = corner.flags.writeable = False
    return field, corner


def _mesh_field(vertices: Floats, faces: Ints, corner: Floats, field: Floats32) -> None:
    """Signed distance to a mesh, which may have gaps and inner faces."""
    nearest = np.full(field.shape, -1, np.int32)
    mesh_distance(vertices, faces, corner, CELL, 1.8 * CELL, field, nearest)
    _, seed = distance_transform_edt(nearest < 0, return_indices=True)
    spread_distance(vertices, faces, corner, CELL, seed.astype(np.int32), nearest, field)
    # Nodes close to a wall are told apart by their winding number, the rest by which open space
    # they belong to: what touches the grid's corner is outside.
    wall = field <= 0.87 * CELL
    space, _ = label(~wall)
    inside = (~wall) & (space != space[0, 0, 0])
    nodes = np.argwhere(wall)
    enclosed = np.zeros(len(nodes), np.uint8)
    winding(vertices, faces, nodes * CELL + corner, enclosed)
    inside[tuple(nodes[enclosed != 0].T)] = True
    field[inside] *= -1.0


def _empty(low: Floats, high: Floats) -> tuple[Floats32, Floats]:
    corner = low - BAND
    shape = tuple(int(n) for n in np.ceil((high - low + 2 * BAND) / CELL) + 1)
    return np.full(shape, np.inf, np.float32), corner


def _solid_field(solid: Solid, T_last_flange: Pose) -> tuple[Floats32, Floats]:
    placed = replace(solid, T_frame_solid=T_last_flange @ solid.T_frame_solid)
    middle, extent = placed.T_frame_solid[:3, 3], placed.half_extent
    field, corner = _empty(middle - extent, middle + extent)
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in field.shape), indexing="ij"), -1)
    in_link = nodes.reshape(-1, 3) * CELL + corner
    return placed.distance(in_link).reshape(field.shape).astype(np.float32), corner


def _pack(parts: list[tuple[int, Floats32, Floats]], gives: list[bool]) -> BodyFields:
    T_link_grid = np.tile(np.eye(4), (len(parts), 1, 1))
    T_link_grid[:, :3, 3] = [corner for _, _, corner in parts]
    shape = np.array([field.shape for _, field, _ in parts], np.int64)
    sizes = np.prod(shape, axis=1)
    return BodyFields(
        np.array([link for link, _, _ in parts], np.int64),
        T_link_grid,
        np.concatenate([np.ascontiguousarray(field).ravel() for _, field, _ in parts]),
        np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        shape,
        np.array(gives, bool),
    )


@dataclass(frozen=True)
class BodyPose:
    """Where the body's parts were at one instant.

    Attributes:
        T_cells_base: (m, 4, 4) base in each part's grid, lengths there in cells; after the parts
            of the body those of its cable, if it has one.
        corners: (m, 8, 3) corners of each part's grid in ``base`` [m].
        speed: (m,) an upper bound of the speed of any point of each part [m/s].
    """

    T_cells_base: Poses
    corners: Floats
    speed: Floats


class SelfFilter:
    """Tells which pixels of a depth image, and which voxels, are the arm itself.

    Attributes:
        fields: of the arm, its tool and what it holds.
        reach: of the arm [m].
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.reach = robot.reach
        self.fields = fields = body_fields(robot)
        unit = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
        corners = unit * (fields.shape[:, None, :] - 1) * CELL  # (m, 8, 3)
        self._corners = np.concatenate(
            [transform(T, c) for T, c in zip(fields.T_link_grid, corners)]
        )
        self._link = np.repeat(fields.link, 8)
        to_cells = np.diag([1 / CELL, 1 / CELL, 1 / CELL, 1.0])
        self._T_cells_link = to_cells @ inverses(fields.T_link_grid)
        self._gives = np.repeat(fields.gives, 8)
        cable = None if robot.tool is None else robot.tool.cable
        self._cable = None if cable is None else _CableParts(cable)
        # The cable is seen farther from where it should hang than it fills.
        self._labelled = self._marked = fields.values, fields.offset, fields.shape
        if self._cable is not None:
            self._labelled = self._cable.joined(fields, ASTRAY)
            self._marked = self._cable.joined(fields, 0.0)

    def pose(
        self,
        position: Floats,
        velocity: Floats,
        wrench: Floats | None = None,
        stamp: float = 0.0,
    ) -> BodyPose:
        """The body at (n,) joint positions [rad] and velocities [rad/s].

        Args:
            position: of the joints.
            velocity: likewise.
            wrench: (6,) what the sensor at the flange felt, not tared [N], [N m]: so a tool in a
                soft mount hangs. None where nobody knows; then it is where it was mounted.
            stamp: when [s]: a cable swings.
        """
        poses = link_poses(self._robot, position)
        rates = np.ascontiguousarray(velocity, float)
        in_link, T_cells_link = self._corners, self._T_cells_link
        tool = self._robot.tool
        moved_tip = np.eye(4) if tool is None else tool.T_flange_tcp
        if wrench is not None and tool is not None and tool.mount is not None:
            T_last_flange = self._robot.T_last_flange
            moved = tool.mount.moved(tool.T_flange_tcp, wrench)
            moved_tip = moved @ tool.T_flange_tcp
            moved = T_last_flange @ moved @ inverse(T_last_flange)
            in_link = np.where(self._gives[:, None], transform(moved, in_link), in_link)
            gives = self.fields.gives[:, None, None]
            T_cells_link = np.where(gives, T_cells_link @ inverse(moved), T_cells_link)
        corners, motion = np.empty_like(in_link), np.empty_like(in_link)
        carried_motion_into(poses, self._robot.axis, self._link, in_link, rates, corners, motion)
        # No point of a rigid part is faster than the fastest corner of a box around it.
        speed = np.sqrt((motion**2).sum(axis=1)).reshape(-1, 8).max(axis=1)
        T_cells_base = T_cells_link @ inverses(poses)[self.fields.link]
        body = BodyPose(T_cells_base, corners.reshape(-1, 8, 3), speed)
        if self._cable is None or tool is None:
            return body
        T_base_tip = poses[-1] @ self._robot.T_last_flange @ moved_tip
        return self._cable.beside(body, T_base_tip, stamp)

    def label(
        self,
        depth: DepthImage,
        label: Bytes,
        lens: DepthLens,
        T_base_camera: Pose,
        body: BodyPose,
        tolerance: tuple[float, float],
        stamp_error: float,
        noise: Floats,
        sigmas: float,
    ) -> int:
        """Mark the arm's pixels in ``label`` (valid pixels only); returns how many.

        A pixel is the arm if its point lies within tolerance[0] [m] + tolerance[1] [rad] x depth
        + sigmas x noise + speed of the link x ``stamp_error`` of the link's surface, or inside.
        """
        corners = transform(inverse(T_base_camera), body.corners.reshape(-1, 3))
        rect = lens.rectangles(np.reshape(corners, body.corners.shape))
        limits = np.empty((len(rect), 2))
        limits[:, 0] = np.minimum(tolerance[0] + body.speed * stamp_error, BAND - 0.01)
        limits[:, 1] = tolerance[1]
        return int(
            label_body(
                depth,
                label,
                lens.rays,
                rect,
                body.T_cells_base @ T_base_camera,
                *self._labelled,
                CELL,
                limits,
                noise,
                sigmas,
            )
        )

    def mark(
        self,
        grid: VoxelGrid,
        body: BodyPose,
        limits: tuple[float, float, float],
        near: Bytes,
        filled: Bytes,
        listed: Ints32,
    ) -> int:
        """Mark the voxels that are close to the body, and those that it fills.

        Args:
            grid: the grid.
            body: where the body is.
            limits: how far from the surface the centre of a voxel is at most that is near, whose
                middle the body fills, and all of which it fills [m]; negative inside the body.
            near: (nx, ny, nz) uint8, set to 1 where a voxel is near.
            filled: the same, set to :data:`MIDDLE` or :data:`WHOLE`.
            listed: (nx ny nz,) int32 out: flat indices of the voxels newly near.

        Returns:
            How many are listed.
        """
        low = np.floor((body.corners.min(axis=1) - grid.origin) / grid.voxel).astype(np.int64)
        high = np.floor((body.corners.max(axis=1) - grid.origin) / grid.voxel).astype(np.int64)
        top = np.asarray(grid.shape) - 1
        box = np.stack([np.maximum(low, 0), np.minimum(high, top)], axis=2).reshape(-1, 6)
        return int(
            mark_body(
                body.T_cells_base,
                box,
                *self._marked,
                np.asarray(grid.origin, float),
                grid.voxel,
                limits,
                near,
                filled,
                listed,
            )
        )


class _CableParts:
    """A swinging cable as parts of the body: one field of a straight piece, as often as needed."""

    def __init__(self, cable: HungCable) -> None:
        self._swinging, self._cable = SwingingCable(cable), cable
        self._piece = cable.length / PIECES

    def joined(self, fields: BodyFields, wider: float) -> tuple[Floats32, Ints, Ints]:
        """Values, offsets and shapes of the arm's fields, then a cable's thicker by so much [m]."""
        thickest = self._cable.radius + ASTRAY
        field, corner = _empty(np.full(3, -thickest), np.array([0, 0, self._piece]) + thickest)
        along = np.array([0.0, 0.0, self._piece])
        capsule_distance(np.zeros(3), along, self._cable.radius + wider, corner, CELL, field)
        self._corner = corner
        self._box = np.stack([corner, corner + (np.array(field.shape) - 1) * CELL])
        return (
            np.concatenate([fields.values, field.ravel()]),
            np.concatenate([fields.offset, np.full(PIECES, len(fields.values))]),
            np.concatenate([fields.shape, np.tile(field.shape, (PIECES, 1))]),
        )

    def beside(self, body: BodyPose, T_base_tip: Pose, stamp: float) -> BodyPose:
        """The body with its cable, whose tool's tip is at a pose in ``base`` at a time [s]."""
        cable, swinging = self._cable, self._swinging
        swinging.follow(transform(T_base_tip, np.array([cable.root]))[0], stamp)
        first, last = swinging.place[:-1], swinging.place[1:]
        T = _along_z(first, last, self._piece)
        inside = np.linalg.inv(T)
        T_cells = np.diag([1 / CELL, 1 / CELL, 1 / CELL, 1.0]) @ inside
        T_cells[:, :3, 3] -= self._corner / CELL
        low, high = self._box
        box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        corners = (low + box * (high - low)) @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
        fast = np.linalg.norm(swinging.velocity, axis=1)
        return BodyPose(
            np.concatenate([body.T_cells_base, T_cells]),
            np.concatenate([body.corners, corners]),
            np.concatenate([body.speed, np.maximum(fast[:-1], fast[1:])]),
        )


def _along_z(first: Points, last: Points, length: float) -> Poses:
    """(k, 4, 4) frames whose z goes from (k, 3) points to others, ``length`` [m] of it between."""
    way = last - first
    z = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(z[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    T = np.tile(np.eye(4), (len(z), 1, 1))
    T[:, :3, 0], T[:, :3, 1], T[:, :3, 2] = x, np.cross(z, x), z
    T[:, :3, 3] = 0.5 * (first + last) - 0.5 * length * z
    return T
