"""Triangles of meshes and primitives, in the link's frame."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from armsight.arrays import Ints, Points
from armsight.errors import RobotError
from armsight.geometry.pose import transform
from armsight.robots.robot import LinkMesh
from armsight.robots.urdf import Geometry

Triangles = tuple[Points, Ints]
"""(n, 3) vertices [m] and (m, 3) indices of triangles, counter-clockwise seen from outside."""

MESH_FORMATS = (".obj", ".stl", ".ply", ".off", ".dae")
"""What a mesh file may end in."""
LARGEST = 200_000_000
"""A mesh file is never larger [bytes]."""


def read_mesh(mesh: LinkMesh) -> Triangles:
    """Vertices in the link's frame [m] and triangles of a robot's or tool's mesh.

    Raises:
        RobotError: the file is missing, empty, or of a kind that cannot be read.
    """
    vertices, faces = read_mesh_file(mesh.path)
    return transform(mesh.T_link_mesh, vertices * np.asarray(mesh.scale)), faces


def read_mesh_file(path: Path) -> Triangles:
    """Vertices and triangles of an OBJ, STL, PLY, OFF or (with pycollada) DAE file; read-only.

    Raises:
        RobotError: the file is missing, empty, or of a kind that cannot be read.
    """
    if not path.is_file():
        raise RobotError(f"mesh {path} is missing; put it there or correct its name in the URDF")
    if path.suffix.lower() not in MESH_FORMATS:
        raise RobotError(
            f"mesh {path}: {path.suffix or 'no'} files are not read; expected one of "
            f"{', '.join(MESH_FORMATS)}"
        )
    stat = path.stat()
    size = stat.st_size
    if size > LARGEST:
        raise RobotError(f"mesh {path}: {size / 1e6:.0f} MB, at most {LARGEST / 1e6:.0f} are read")
    if path.suffix.lower() == ".dae" and _has_doctype(path):
        raise RobotError(f"mesh {path}: a document type declaration is not allowed; remove it")
    return _parsed(path, stat.st_mtime_ns, size)


@lru_cache(maxsize=128)
def _parsed(path: Path, _changed: int, _size: int) -> Triangles:
    """What a file holds, read once as long as it does not change."""
    try:
        loaded = trimesh.load(path, process=False, force="mesh", skip_materials=True)
    except Exception as error:  # trimesh raises whatever its readers do
        hint = "; pip install 'armsight[collada]'" if path.suffix.lower() == ".dae" else ""
        raise RobotError(f"mesh {path} cannot be read ({error}){hint}") from None
    vertices = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), np.float64)
    faces = np.asarray(getattr(loaded, "faces", np.empty((0, 3))), np.int64)
    if len(faces) == 0 or not np.isfinite(vertices).all():
        raise RobotError(f"mesh {path} holds no triangles, or numbers that are not finite")
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces


def _has_doctype(path: Path) -> bool:
    """Whether an XML file declares a document type, the door to entity tricks."""
    data = path.read_bytes()
    return b"<!DOCTYPE" in data or b"<!ENTITY" in data or data[:2] in (b"\xff\xfe", b"\xfe\xff")


def geometry_triangles(shape: Geometry) -> Triangles:
    """Triangles of a URDF shape, in the link's frame.

    Raises:
        RobotError: its mesh cannot be read.
    """
    if shape.kind == "mesh":
        if shape.path is None:
            raise ValueError("a mesh geometry without a path")
        vertices, faces = read_mesh_file(shape.path)
        vertices = vertices * np.asarray(shape.size)
    else:
        if shape.kind == "box":
            solid = trimesh.creation.box(extents=shape.size)
        elif shape.kind == "cylinder":
            solid = trimesh.creation.cylinder(shape.size[0], shape.size[1], sections=32)
        else:
            solid = trimesh.creation.icosphere(subdivisions=3, radius=shape.size[0])
        vertices = np.asarray(solid.vertices, np.float64)
        faces = np.asarray(solid.faces, np.int64)
    return transform(shape.T_link_geometry, vertices), faces


def join_triangles(parts: list[Triangles]) -> Triangles:
    """Many lists of triangles as one."""
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in parts[:-1]])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + o for (_, faces), o in zip(parts, offsets)]),
    )
