"""An arm before decimation, and readers of the formats that its sources come in."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

Color = tuple[float, float, float]


@dataclass
class Part:
    """One colour of a link: (n, 3) vertices [m] in the link's frame, (m, 3) triangles."""

    color: Color
    vertices: np.ndarray
    faces: np.ndarray


@dataclass
class Link:
    """A link with its looks and its mass properties as URDF's attribute texts."""

    name: str
    parts: list[Part] = field(default_factory=list)
    mass: float = 0.0
    center: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0,) * 6  # xx xy xz yy yz zz about the centre, link axes


@dataclass
class Joint:
    """A joint as it will stand in the URDF."""

    name: str
    kind: str
    parent: str
    child: str
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    lower: float = 0.0
    upper: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0


@dataclass
class Source:
    """A robot before decimation."""

    name: str
    links: list[Link]
    joints: list[Joint]
    license: str


def extract(wheel: Path, folder: Path, wanted: tuple[str, ...]) -> None:
    """Unpack the members of a wheel whose path contains one of the texts."""
    with zipfile.ZipFile(wheel) as archive:
        names = [n for n in archive.namelist() if any(w in n for w in wanted)]
        archive.extractall(folder, names)


def find(folder: Path, pattern: str) -> Path:
    """The one file below a folder that matches."""
    found = sorted(folder.rglob(pattern))
    if len(found) != 1:
        raise SystemExit(f"{pattern}: expected one file, found {len(found)}")
    return found[0]


def read_joint(element: ET.Element) -> Joint:
    """A joint of a URDF, quarter turns made exact."""
    origin, axis, limit = (element.find(tag) for tag in ("origin", "axis", "limit"))
    joint = Joint(
        element.get("name", ""),
        element.get("type", ""),
        element.find("parent").get("link"),
        element.find("child").get("link"),
        numbers(origin.get("xyz")),
        tuple(snap(a) for a in numbers(origin.get("rpy"))),
    )
    if axis is not None:
        joint.axis = numbers(axis.get("xyz"))
    if limit is not None:
        joint.lower, joint.upper, joint.velocity, joint.effort = (
            float(limit.get(k)) for k in ("lower", "upper", "velocity", "effort")
        )
        joint.lower, joint.upper = snap(joint.lower), snap(joint.upper)
    return joint


def read_link(element: ET.Element) -> Link:
    """Name and inertia of a URDF's link; its origins there are unturned."""
    link = Link(element.get("name", ""))
    inertial = element.find("inertial")
    if inertial is not None:
        link.mass = float(inertial.find("mass").get("value"))
        link.center = numbers(inertial.find("origin").get("xyz"))
        tensor = inertial.find("inertia")
        link.inertia = tuple(
            float(tensor.get(k)) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
    return link


def read_collada(path: Path, brighten: float) -> list[Part]:
    """The parts of a DAE file, one a colour."""
    return _by_color(trimesh.load(path, force="scene"), brighten)


def _by_color(scene: trimesh.Scene, brighten: float) -> list[Part]:
    by_color: dict[Color, list[trimesh.Trimesh]] = {}
    for mesh in scene.dump():
        rgb = np.asarray(mesh.visual.material.main_color[:3]) / 255.0
        color = tuple(round(min(1.0, c * brighten), 3) for c in rgb)
        by_color.setdefault(color, []).append(mesh)
    parts = []
    for color, meshes in by_color.items():
        merged = trimesh.util.concatenate(meshes)
        parts.append(Part(color, np.asarray(merged.vertices), np.asarray(merged.faces)))
    return parts


def moved(
    parts: list[Part], xyz: tuple[float, ...], rpy: tuple[float, ...] = (0, 0, 0)
) -> list[Part]:
    """The parts after a turn about fixed axes and a shift: a URDF's <origin>."""
    R = Rotation.from_euler("xyz", rpy).as_matrix()
    return [Part(p.color, p.vertices @ R.T + np.asarray(xyz), p.faces) for p in parts]


def read_obj(path: Path, brighten: float = 1.0) -> list[Part]:
    """The parts of an OBJ file with its materials, one a colour."""
    return _by_color(trimesh.load(path, force="scene"), brighten)


def numbers(text: str | None) -> tuple[float, ...]:
    """The numbers of an attribute; zeros where there is none."""
    return tuple(float(v) for v in text.split()) if text else (0.0, 0.0, 0.0)


def quaternion(wxyz: str | None) -> Rotation:
    """MuJoCo's quaternion (w, x, y, z); entries of 0.707107 made exact by normalising."""
    w, x, y, z = numbers(wxyz) if wxyz else (1.0, 0.0, 0.0, 0.0)
    return Rotation.from_quat([x, y, z, w])


def snap(angle: float) -> float:
    """Quarter turns that were written with few digits, made exact."""
    quarter = round(angle / (math.pi / 2)) * (math.pi / 2)
    return quarter if abs(angle - quarter) < 1e-5 else angle
