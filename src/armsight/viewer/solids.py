"""Solids and people on the page: what stands still, what moves, walls that one looks through."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from armsight.arrays import Floats32, Pose, Vector3
from armsight.devices.world import MovingSurfaces
from armsight.geometry.pose import inverse, transform
from armsight.geometry.shapes import ShapeKind, Solid, Surface
from armsight.viewer.colors import Color, for_instances
from armsight.viewer.nodes import Posed, Shown, quaternions
from armsight.viewer.primitives import CUBE, CYLINDER, SPHERE

WALL = 1.5
"""A thin box at least this long and high is a wall [m]."""
SHAPES = {"box": CUBE, "cylinder": CYLINDER, "sphere": SPHERE}


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


class Bodies(Shown):
    """People, part by part: meshes that hang on frames, and frames that move."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        super().__init__(scene, name)
        self._handle = scene.add_frame(name, show_axes=False)
        self._filled = True
        self._parts: dict[str, tuple[tuple[Surface, ...], Posed]] = {}

    def show(self, bodies: Sequence[MovingSurfaces]) -> None:
        """Draw these; those that were there before and are not now, go."""
        names = {body.name for body in bodies}
        for gone in self._parts.keys() - names:
            self._parts.pop(gone)[1].handle.remove()
        if not bodies:
            return
        turns = quaternions(np.stack([body.T_world_body for body in bodies]))
        for body, wxyz in zip(bodies, turns):
            known = self._parts.get(body.name)
            if known is None or known[0] is not body.surfaces:
                known = (body.surfaces, self._add(body))
                self._parts[body.name] = known
            known[1].move(body.T_world_body, wxyz)

    def _add(self, body: MovingSurfaces) -> Posed:
        node = f"{self._name}/{body.name}"
        frame = self._scene.add_frame(node, show_axes=False)
        for surface in body.surfaces:
            self._scene.add_mesh_simple(
                f"{node}/{surface.name}",
                np.asarray(surface.vertices, np.float32),
                np.asarray(surface.faces, np.uint32),
                color=surface.color,
                receive_shadow=False,
            )
        return Posed(frame)


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
