"""Shapes as Blender's objects; each says which link of the arm it belongs to, plus 1."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import mathutils
import numpy as np
import trimesh

from armsight.geometry.pose import from_rpy

Material = Any


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    """Pose turned about the vertical."""
    return np.asarray(from_rpy((0.0, 0.0, yaw), (x, y, z)))


def toward(origin: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """Pose at a point whose z axis points to another."""
    z = np.asarray(target, float) - np.asarray(origin, float)
    z /= np.linalg.norm(z)
    x = np.cross((0.0, 0.0, 1.0) if abs(z[2]) < 0.95 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, origin
    return T


def add(data: Any, T: np.ndarray, material: Material | None, label: int = 0) -> Any:
    """An object of Blender's data at a pose."""
    made = bpy.data.objects.new("shape", data)
    made.matrix_world = mathutils.Matrix(np.asarray(T, float).tolist())
    made.pass_index = label
    if material is not None:
        data.materials.append(material)
    bpy.context.scene.collection.objects.link(made)
    return made


def solid(mesh: trimesh.Trimesh, T: np.ndarray, material: Material, label: int = 0) -> Any:
    """A surface whose corners of more than 35 degrees are sharp."""
    smooth = trimesh.graph.smooth_shade(mesh, angle=np.deg2rad(35))
    data = bpy.data.meshes.new("mesh")
    data.from_pydata(np.asarray(smooth.vertices).tolist(), [], np.asarray(smooth.faces).tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
    return add(data, T, material, label)


def primitive(
    kind: str, size: Sequence[float], T: np.ndarray, material: Material, label: int = 0
) -> Any:
    """Box, cylinder, capsule or ellipsoid with MuJoCo's sizes."""
    if kind == "box":
        mesh = trimesh.creation.box(2.0 * np.asarray(size, float))
    elif kind == "ellipsoid":
        mesh = trimesh.creation.icosphere(subdivisions=4)
        mesh.apply_scale(np.asarray(size, float))
    elif kind == "capsule":
        mesh = trimesh.creation.capsule(2.0 * size[2], size[0], count=(32, 32))
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    else:
        mesh = trimesh.creation.cylinder(size[0], 2.0 * size[2], sections=64)
    return solid(mesh, T, material, label)


def hose(points: np.ndarray, radius: float, material: Material) -> Any:
    """A round hose through (n, 3) points."""
    data = bpy.data.curves.new("hose", "CURVE")
    data.dimensions, data.bevel_depth, data.bevel_resolution = "3D", radius, 4
    spline = data.splines.new("NURBS")
    spline.points.add(len(points) - 1)
    for place, point in zip(spline.points, points, strict=True):
        place.co = (*map(float, point), 1.0)
    spline.use_endpoint_u, spline.order_u = True, 4
    return add(data, np.eye(4), material)


def lamp(origin: Sequence[float], target: Sequence[float], size: float, power: float) -> None:
    """A square lamp [m], [W] that shines to a point."""
    data = bpy.data.lights.new("lamp", "AREA")
    data.energy, data.size = power, size
    T = toward(origin, target)
    T[:3, 1:3] *= -1.0  # Blender's lamps shine along -z
    made = bpy.data.objects.new("lamp", data)
    made.matrix_world = mathutils.Matrix(T.tolist())
    bpy.context.scene.collection.objects.link(made)
