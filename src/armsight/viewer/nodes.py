"""Nodes of the 3D scene that are told new values often and send only what changed."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from armsight.arrays import Bytes, Floats32, Points, Pose
from armsight.geometry.pose import to_wxyz
from armsight.geometry.shapes import Solid
from armsight.viewer.colors import Color

CUBE_VERTICES = 0.5 * np.array(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32
)
CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    np.uint32,
)  # fmt: skip
"""A cube about the origin with edges of 1, faces outward."""


class Posed:
    """A node that moves; a pose that it has already is not sent again."""

    def __init__(self, handle: Any, T: Pose | None = None) -> None:
        self.handle = handle
        self._T: Pose | None = None
        if T is not None:
            self.move(T)

    def move(self, T: Pose, tolerance: float = 1e-4) -> None:
        """Put the node at a pose in its parent; moves below 0.1 mm and 0.1 mrad are spared."""
        if self._T is not None and np.abs(self._T - T).max() < tolerance:
            return
        if self._T is None or np.abs(self._T[:3, :3] - T[:3, :3]).max() >= tolerance:
            self.handle.wxyz = to_wxyz(T)
        self.handle.position = T[:3, 3]
        self._T = np.array(T)


class Cloud:
    """A point cloud that is replaced as a whole."""

    def __init__(self, scene: viser.SceneApi, name: str, size: float, shape: str) -> None:
        self._scene = scene
        self._name = name
        self._size = size
        self._shape = shape
        self._visible = True
        self._handle: Any = None

    def show(self, points: Floats32, colors: Bytes | Color) -> None:
        """Replace the points [m]."""
        if not len(points):
            points, colors = np.zeros((1, 3), np.float32) - 1e3, (0, 0, 0)
        self._handle = self._scene.add_point_cloud(
            self._name,
            points=points,
            colors=np.asarray(colors, np.uint8),
            point_size=self._size,
            point_shape=self._shape,  # type: ignore[arg-type]
            precision="float16",
            point_shading="flat",
            visible=self._visible,
        )

    @property
    def visible(self) -> bool:
        """Whether it is drawn; hidden clouds need not be told anything."""
        return self._visible

    @visible.setter
    def visible(self, value: bool) -> None:
        self._visible = value
        if self._handle is not None:
            self._handle.visible = value


class Cubes:
    """Instanced cubes of one size; at most ``most`` of them."""

    def __init__(self, scene: viser.SceneApi, name: str, most: int) -> None:
        self._scene = scene
        self._name = name
        self._upright = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (most, 1))
        self._visible = True
        self._handle: Any = None
        self.most = most

    def show(self, centers: Floats32, edge: float, colors: Bytes) -> None:
        """Replace the cubes: (n, 3) centres [m], (n, 3) colours."""
        if not len(centers):
            centers = np.full((1, 3), -1e3, np.float32)
            colors = np.zeros((1, 3), np.uint8)
        count = len(centers)
        self._handle = self._scene.add_batched_meshes_simple(
            self._name,
            CUBE_VERTICES * np.float32(edge),
            CUBE_FACES,
            batched_wxyzs=self._upright[:count],
            batched_positions=centers,
            batched_colors=colors,
            lod="off",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            visible=self._visible,
        )

    @property
    def visible(self) -> bool:
        """Whether they are drawn."""
        return self._visible

    @visible.setter
    def visible(self, value: bool) -> None:
        self._visible = value
        if self._handle is not None:
            self._handle.visible = value


class Line:
    """A line through points, replaced when it changes; hidden without points."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Color, thickness: float) -> None:
        self._scene = scene
        self._name = name
        self._color = np.array(color, np.uint8)
        self._thickness = thickness
        self._visible = True
        self._points: Points | None = None
        self._handle: Any = None

    def show(self, points: Points | None) -> None:
        """Draw through (k, 3) points [m]."""
        if points is not None and len(points) < 2:
            points = None
        same = points is self._points or (
            points is not None
            and self._points is not None
            and points.shape == self._points.shape
            and bool(np.abs(points - self._points).max() < 1e-4)
        )
        if same:
            return
        self._points = points
        if points is None:
            if self._handle is not None:
                self._handle.visible = False
            return
        segments = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
        self._handle = self._scene.add_line_segments(
            self._name,
            points=segments,
            colors=self._color,
            thickness=self._thickness,
            visible=self._visible,
        )

    @property
    def visible(self) -> bool:
        """Whether it is drawn."""
        return self._visible

    @visible.setter
    def visible(self, value: bool) -> None:
        self._visible = value
        if self._handle is not None:
            self._handle.visible = value and self._points is not None


def add_solid(
    scene: viser.SceneApi, name: str, solid: Solid, T: Pose, opacity: float | None = None
) -> Posed:
    """Draw a box, cylinder or sphere."""
    color = tuple(round(255 * channel) for channel in solid.color)
    look: dict[str, Any] = {"color": color, "opacity": opacity}
    handle: Any
    if solid.kind == "box":
        handle = scene.add_box(name, dimensions=solid.size, **look)
    elif solid.kind == "sphere":
        handle = scene.add_icosphere(name, radius=solid.size[0], subdivisions=3, **look)
    else:
        radius, height, _ = solid.size
        handle = scene.add_cylinder(name, radius=radius, height=height, **look)
    return Posed(handle, T)
