"""Nodes of the 3D scene that are told new values often and send only what changed.

viser builds a node anew in about 1 ms of Python, and updates a property in a tenth of that. So
nodes keep their number of points or instances, in steps; the ones too many hide inside the last.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from armsight.arrays import Bytes, Floats, Floats32, Points, Pose, Poses
from armsight.geometry.pose import to_wxyz
from armsight.viewer.colors import Color, for_instances
from armsight.viewer.primitives import CUBE


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


def quaternions(poses: Poses) -> Floats:
    """(n, 4) quaternions w, x, y, z of (n, 4, 4) poses, much faster than one by one."""
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return np.asarray(xyzw[:, [3, 0, 1, 2]], float)
