"""Nodes of the 3D scene that are told new values often and send only what changed.

viser builds a node anew in about 1 ms of Python, and updates a property in a tenth of that. So
nodes keep their number of points or instances, in steps; the ones too many hide inside the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armsight.arrays import Bytes, Floats, Floats32, Points, Pose, Poses, Vector3
from armsight.geometry.pose import inverse, to_wxyz, transform
from armsight.geometry.shapes import ShapeKind, Solid
from armsight.viewer.colors import Color, for_instances
from armsight.viewer.primitives import CUBE, CYLINDER, SPHERE

WALL = 1.5
"""A thin box at least this long and high is a wall [m]."""
SHAPES = {"box": CUBE, "cylinder": CYLINDER, "sphere": SPHERE}


def _room(count: int, step: int) -> int:
    """Places for ``count`` things, in steps, so that small changes need no new node."""
    return max(1, -(-count // step)) * step


def _padded(rows: Any, room: int, dtype: Any) -> Any:
    """``rows`` and then the last of them until there are ``room``."""
    out = np.empty((room, rows.shape[1]), dtype)
    out[: len(rows)] = rows
    out[len(rows) :] = rows[-1]
    return out


class Shown:
    """What all nodes here have: a handle that may come later, and a switch; hidden when empty."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene = scene
        self._name = name
        self._visible = True
        self._filled = False
        self._handle: Any = None

    @property
    def visible(self) -> bool:
        """Whether it may be drawn; what is hidden need not be told anything."""
        return self._visible

    @visible.setter
    def visible(self, value: bool) -> None:
        self._visible = value
        self._show_or_hide()

    def _shows(self, count: int) -> bool:
        """Note that there are so many things to draw now; whether there are any."""
        if (count > 0) is not self._filled:
            self._filled = count > 0
            self._show_or_hide()
        return self._filled

    def _show_or_hide(self) -> None:
        if self._handle is not None:
            self._handle.visible = self._visible and self._filled


class Posed:
    """A node that moves; a pose that it has already is not sent again."""

    def __init__(self, handle: Any, T: Pose | None = None) -> None:
        self.handle = handle
        self._T: Pose | None = None
        if T is not None:
            self.move(T)

    def move(self, T: Pose, wxyz: Floats | None = None, tolerance: float = 1e-4) -> None:
        """Put the node at a pose in its parent; moves below 0.1 mm and 0.1 mrad are spared.

        Args:
            T: the pose.
            wxyz: its quaternion, where it is known already.
            tolerance: of each number of the pose.
        """
        change = None if self._T is None else np.abs(self._T - T)
        if change is not None and change.max() < tolerance:
            return
        if change is None or change[:3, :3].max() >= tolerance:
            self.handle.wxyz = to_wxyz(T) if wxyz is None else wxyz
        if change is None or change[:3, 3].max() >= tolerance:
            self.handle.position = T[:3, 3]
        self._T = np.array(T)


class Cloud(Shown):
    """A point cloud that is replaced as a whole."""

    STEP = 4096

    def __init__(self, scene: viser.SceneApi, name: str, size: float, shape: str) -> None:
        super().__init__(scene, name)
        self._size = size
        self._shape = shape

    def show(self, points: Floats32, colors: Bytes) -> None:
        """Replace the points: (n, 3) [m], (n, 3) colours."""
        if not self._shows(len(points)):
            return
        room = _room(len(points), self.STEP)
        placed = _padded(points, room, np.float16)
        shades = _padded(colors, room, np.uint8)
        if self._handle is not None and len(self._handle.points) == room:
            self._handle.points = placed
            self._handle.colors = shades
            return
        self._handle = self._scene.add_point_cloud(
            self._name,
            points=placed,
            colors=shades,
            point_size=self._size,
            point_shape=self._shape,  # type: ignore[arg-type]
            precision="float16",
            point_shading="flat",
            visible=self._visible,
        )


class Cubes(Shown):
    """Instanced cubes of one size."""

    STEP = 512

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        super().__init__(scene, name)
        self._edge = 0.0

    def show(self, centers: Floats32, edge: float, colors: Bytes) -> None:
        """Replace the cubes: (n, 3) centres [m], (n, 3) colours."""
        if not self._shows(len(centers)):
            return
        room = _room(len(centers), self.STEP)
        placed = _padded(centers, room, np.float32)
        shades = _padded(for_instances(colors), room, np.uint8)
        fits = self._handle is not None and len(self._handle.batched_positions) == room
        if fits and edge == self._edge:
            self._handle.batched_positions = placed
            self._handle.batched_colors = shades
            return
        self._edge = edge
        self._handle = self._scene.add_batched_meshes_simple(
            self._name,
            CUBE.vertices * np.float32(edge),
            CUBE.faces,
            batched_wxyzs=np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (room, 1)),
            batched_positions=placed,
            batched_colors=shades,
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            visible=self._visible,
        )


class Line(Shown):
    """A line through at most so many points; hidden without points."""

    def __init__(
        self, scene: viser.SceneApi, name: str, color: Color, thickness: float, most: int
    ) -> None:
        super().__init__(scene, name)
        self._color = np.array(color, np.uint8)
        self._thickness = thickness
        self._most = most

    def show(self, points: Points | None) -> None:
        """Draw through (k, 3) points [m]; ends at the last one, however many there are."""
        count = 0 if points is None or len(points) < 2 else len(points)
        if not self._shows(count) or points is None:
            return
        if len(points) > self._most:
            points = points[np.linspace(0, len(points) - 1, self._most).round().astype(int)]
        segments = np.empty((self._most - 1, 2, 3), np.float32)
        segments[:] = points[-1]
        segments[: len(points) - 1, 0] = points[:-1]
        segments[: len(points) - 1, 1] = points[1:]
        if self._handle is not None:
            self._handle.points = segments
            return
        self._handle = self._scene.add_line_segments(
            self._name,
            points=segments,
            colors=self._color,
            thickness=self._thickness,
            visible=self._visible,
        )


class SolidGroup(Shown):
    """Boxes, cylinders and spheres that move, instanced: three nodes, however many there are."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        super().__init__(scene, name)
        scene.add_frame(name, show_axes=False)
        self._handles: dict[ShapeKind, Any] = {}
        self._shapes: dict[ShapeKind, list[tuple[Any, ...]]] = {}

    def show(self, solids: Sequence[Solid], poses: Sequence[Pose]) -> None:
        """Draw the solids at (4, 4) poses; those that were there before and are not now, go."""
        kinds: tuple[ShapeKind, ...] = ("box", "cylinder", "sphere")
        for kind in kinds:
            which = [i for i, solid in enumerate(solids) if solid.kind == kind]
            if which or kind in self._handles:
                self._show_kind(kind, [solids[i] for i in which], [poses[i] for i in which])

    def _show_kind(self, kind: ShapeKind, solids: list[Solid], poses: list[Pose]) -> None:
        if not solids:
            self._handles.pop(kind).remove()
            return
        T = np.stack(poses)
        positions = T[:, :3, 3].astype(np.float32)
        turns = quaternions(T).astype(np.float32)
        handle = self._handles.get(kind)
        shapes = [(solid.size, solid.color) for solid in solids]
        if handle is not None and shapes == self._shapes[kind]:
            handle.batched_positions = positions
            handle.batched_wxyzs = turns
            return
        self._shapes[kind] = shapes
        shape = SHAPES[kind]
        self._handles[kind] = self._scene.add_batched_meshes_simple(
            f"{self._name}/{kind}",
            shape.vertices,
            shape.faces,
            batched_wxyzs=turns,
            batched_positions=positions,
            batched_scales=np.array([scale_of(solid) for solid in solids], np.float32),
            batched_colors=for_instances(np.array([to_uint8(s.color) for s in solids], np.uint8)),
            lod="off",
            flat_shading=kind == "box",
            visible=self._visible,
        )

    def _show_or_hide(self) -> None:
        for handle in self._handles.values():
            handle.visible = self._visible


def quaternions(poses: Poses) -> Floats:
    """(n, 4) quaternions w, x, y, z of (n, 4, 4) poses, much faster than one by one."""
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return np.asarray(xyzw[:, [3, 0, 1, 2]], float)


def scale_of(solid: Solid) -> tuple[float, float, float]:
    """What makes a solid of the shape with edges or diameters of 1."""
    a, b, c = solid.size
    if solid.kind == "box":
        return (a, b, c)
    return (2 * a, 2 * a, b) if solid.kind == "cylinder" else (2 * a, 2 * a, 2 * a)


def to_uint8(color: tuple[float, float, float]) -> Color:
    """RGB 0..255 of RGB 0..1."""
    red, green, blue = (round(255 * min(max(channel, 0.0), 1.0)) for channel in color)
    return red, green, blue


def add_solid(scene: viser.SceneApi, name: str, solid: Solid, T: Pose, inside: Vector3) -> None:
    """Draw a box, cylinder or sphere that stands still.

    Args:
        scene: where.
        name: of the node.
        solid: its shape.
        T: its pose in the parent.
        inside: (3,) a point in the parent. Of a wall only the face towards it is drawn, so that one
            looks into a room from outside as into a doll's house.
    """
    color = to_uint8(solid.color)
    handle: Any
    if is_wall(solid):
        vertices, faces = wall_face(solid, T, inside)
        handle = scene.add_mesh_simple(
            name, vertices, faces, color=color, side="front", cast_shadow=False
        )
    elif solid.kind == "box":
        handle = scene.add_box(name, dimensions=solid.size, color=color)
    elif solid.kind == "sphere":
        handle = scene.add_icosphere(name, radius=solid.size[0], subdivisions=3, color=color)
    else:
        radius, height, _ = solid.size
        handle = scene.add_cylinder(name, radius=radius, height=height, color=color)
    Posed(handle, T)


def is_wall(solid: Solid) -> bool:
    """Whether a box is thin and large both ways: a wall, a ceiling, a fence; not a table's top."""
    thin, middle, _ = sorted(solid.size)
    return solid.kind == "box" and middle >= WALL and thin <= 0.2 * middle


def wall_face(solid: Solid, T: Pose, inside: Vector3) -> tuple[Floats32, NDArray[np.uint32]]:
    """Two triangles: the large face of a wall that looks towards a point in the parent."""
    axis = int(np.argmin(solid.size))
    towards = float(transform(inverse(T), np.asarray(inside, float)[None])[0, axis])
    sign = 1.0 if towards > 0 else -1.0
    half = 0.5 * np.asarray(solid.size)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    vertices = np.zeros((4, 3), np.float32)
    vertices[:, axis] = sign * half[axis]
    vertices[:, u] = np.array([-1, 1, 1, -1]) * half[u]
    vertices[:, v] = np.array([-1, -1, 1, 1]) * half[v]
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    return vertices, faces if sign > 0 else np.ascontiguousarray(faces[:, ::-1])
