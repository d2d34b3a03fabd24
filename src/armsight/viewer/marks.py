"""What a task marks in the scene: points, arrows, frames, ellipsoids and regions, with names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from armsight.arrays import Floats32, Vector3
from armsight.geometry.pose import to_wxyz
from armsight.motion.face import (
    ArrowMark,
    EllipsoidMark,
    FrameMark,
    Mark,
    PointsMark,
    RegionMark,
)
from armsight.viewer.colors import for_instances
from armsight.viewer.nodes import Posed, Shown
from armsight.viewer.primitives import SPHERE

THINNEST = 5e-4
"""An ellipsoid that is thinner is drawn this thick [m]: a circle is seen, a point is not."""
CROWDED = 0.08
"""Names closer together than this lie on each other [m]."""


@dataclass
class _Node:
    """A mark as it is drawn, the label beside it, and what would need new nodes if it changed."""

    handle: Any
    posed: Posed | None
    label: Any
    look: tuple[Any, ...]


class TaskMarks(Shown):
    """All marks of a task; those that it no longer shows are taken away."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        super().__init__(scene, name)
        self._handle = scene.add_frame(name, show_axes=False)
        self._filled = True
        self._nodes: dict[tuple[type, str], _Node] = {}

    def show(self, marks: Sequence[Mark]) -> None:
        """Draw these and no others."""
        wanted = {(type(mark), mark.name): mark for mark in marks}
        for key in [key for key in self._nodes if key not in wanted]:
            self._remove(key)
        for number, (key, mark) in enumerate(wanted.items()):
            look = _look(mark)
            node = self._nodes.get(key)
            if node is not None and node.look != look:
                self._remove(key)
                node = None
            if node is None:
                node = self._nodes[key] = self._add(mark, look, number)
            _move(node, mark)
        self._thin_out()

    def _thin_out(self) -> None:
        """Of names that would lie on each other the first is shown: nobody can read a heap."""
        shown: list[Vector3] = []
        for node in self._nodes.values():
            place = np.asarray(node.label.position, float)
            free = all(np.linalg.norm(place - other) > CROWDED for other in shown)
            if free:
                shown.append(place)
            if node.label.visible != free:
                node.label.visible = free

    def _remove(self, key: tuple[type, str]) -> None:
        node = self._nodes.pop(key)
        node.handle.remove()
        node.label.remove()

    def _add(self, mark: Mark, look: tuple[Any, ...], number: int) -> _Node:
        """New nodes for a mark; names from outside never become paths of the scene's tree."""
        scene, path = self._scene, f"{self._name}/{type(mark).__name__}_{number}_{id(mark)}"
        label = scene.add_label(
            f"{path}_name", mark.name, anchor="bottom-center", font_screen_scale=0.8
        )
        posed = None
        if isinstance(mark, PointsMark):
            handle: Any = scene.add_batched_meshes_simple(
                path,
                SPHERE.vertices * np.float32(2.0 * mark.radius),
                SPHERE.faces,
                batched_wxyzs=np.tile(np.array([1, 0, 0, 0], np.float32), (len(mark.points), 1)),
                batched_positions=_points(mark),
                batched_colors=for_instances(
                    np.tile(np.array(mark.color, np.uint8), (len(mark.points), 1))
                ),
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
        elif isinstance(mark, ArrowMark):
            handle = scene.add_arrows(
                path,
                _arrow(mark),
                mark.color,
                shaft_radius=0.006,
                head_radius=0.015,
                head_length=0.035,
            )
        elif isinstance(mark, FrameMark):
            handle = scene.add_frame(
                path, axes_length=mark.length, axes_radius=0.03 * mark.length, origin_radius=0.0
            )
            posed = Posed(handle)
        elif isinstance(mark, EllipsoidMark):
            handle = scene.add_icosphere(
                path, 1.0, mark.color, opacity=0.4, cast_shadow=False, scale=_radii(mark)
            )
            posed = Posed(handle)
        else:
            handle = scene.add_box(
                path,
                mark.color,
                dimensions=np.asarray(mark.size, float),
                opacity=0.22,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            posed = Posed(handle)
        return _Node(handle, posed, label, look)


def _look(mark: Mark) -> tuple[Any, ...]:
    """What cannot be changed without a new node."""
    if isinstance(mark, PointsMark):
        return (mark.color, mark.radius, len(mark.points))
    if isinstance(mark, FrameMark):
        return (mark.length,)
    if isinstance(mark, RegionMark):
        return (mark.color, tuple(np.asarray(mark.size, float).tolist()))
    return (mark.color,)


def _move(node: _Node, mark: Mark) -> None:
    """Bring a mark to where it is now; what has not changed is not sent."""
    if isinstance(mark, PointsMark):
        points = _points(mark)
        if not np.array_equal(points, node.handle.batched_positions):
            node.handle.batched_positions = points
    elif isinstance(mark, ArrowMark):
        arrow = _arrow(mark)
        if not np.array_equal(arrow, node.handle.points):
            node.handle.points = arrow
    else:
        if isinstance(mark, EllipsoidMark) and tuple(node.handle.scale) != _radii(mark):
            node.handle.scale = _radii(mark)
        if node.posed is not None:
            node.posed.move(mark.T_base_mark, to_wxyz(mark.T_base_mark))
    place = _label_place(mark)
    if np.abs(place - np.asarray(node.label.position)).max() > 1e-3:
        node.label.position = place


def _label_place(mark: Mark) -> Vector3:
    """Above the mark's middle."""
    if isinstance(mark, PointsMark):
        middle = (
            np.asarray(mark.points, float).reshape(-1, 3).mean(axis=0) if len(mark.points) else 0
        )
        return _above(np.zeros(3) + middle, 2.0 * mark.radius)
    if isinstance(mark, ArrowMark):
        return _above(np.asarray(mark.end, float), 0.02)
    T = np.asarray(mark.T_base_mark, float)
    half = np.zeros(3)
    if isinstance(mark, EllipsoidMark):
        half = np.asarray(mark.radii, float)
    elif isinstance(mark, RegionMark):
        half = 0.5 * np.asarray(mark.size, float)
    return _above(T[:3, 3], float(np.abs(T[2, :3]) @ half) + 0.01)


def _above(place: Vector3, height: float) -> Vector3:
    return np.array([place[0], place[1], place[2] + height])


def _points(mark: PointsMark) -> Floats32:
    return np.asarray(mark.points, np.float32).reshape(-1, 3)


def _arrow(mark: ArrowMark) -> Floats32:
    return np.stack([mark.start, mark.end]).astype(np.float32)[None]


def _radii(mark: EllipsoidMark) -> tuple[float, float, float]:
    x, y, z = np.maximum(np.asarray(mark.radii, float), THINNEST).tolist()
    return (x, y, z)
