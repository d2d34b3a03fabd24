"""Writing an arm's folder: decimated meshes, URDF, fitted shapes, licence."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import meshoptimizer
import numpy as np
import trimesh
from robot_sources.parts import Color, Joint, Link, Part, Source

from armsight.robots.chain import fold_chain
from armsight.robots.fitting import fit_chain
from armsight.robots.folder import QUICK
from armsight.robots.link_body import FitOptions
from armsight.robots.meshes import join_triangles, read_mesh_file
from armsight.robots.shapes import BodyShapes, shapes_json
from armsight.robots.urdf import read_urdf

TRIANGLES = 30_000  # of a robot after decimation, at most
COARSE = 0.0015  # [m] by which a depth camera's mesh of an arm may be off
SPHERE_PRICE = {"iiwa": 4.5e-9, "panda": 3.5e-9}  # [m^5] where the default spends too many spheres
LONG_FIT = ("ur3", "ur5", "ur10", "iiwa", "panda")
TOLERANCES = (0.0001, 0.00015, 0.0002, 0.0003, 0.0004, 0.0006)  # [m] tried until that is kept


def write_robot(source: Source, folder: Path) -> None:
    """Decimate, fit, and write all files of one robot."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    for old in (folder / "meshes").glob("*.obj"):
        old.unlink()
    total = sum(len(p.faces) for link in source.links for p in link.parts)
    for tolerance in TOLERANCES:
        small = {link.name: [decimate(p, tolerance) for p in link.parts] for link in source.links}
        if sum(len(part.faces) for parts in small.values() for part in parts) <= TRIANGLES:
            break
    root = ET.Element("robot", name=source.name)
    count = 0
    for link in source.links:
        element = ET.SubElement(root, "link", name=link.name)
        for i, part in enumerate(small[link.name]):
            count += len(part.faces)
            name = f"meshes/{link.name}_{i}.obj"
            (folder / name).write_text(obj_text(part, source.name, link.name))
            visual = ET.SubElement(element, "visual")
            geometry = ET.SubElement(visual, "geometry")
            ET.SubElement(geometry, "mesh", filename=name)
            material = ET.SubElement(visual, "material", name=color_name(part.color))
            ET.SubElement(material, "color", rgba=" ".join(f"{c:g}" for c in part.color) + " 1")
        if link.mass > 0.0:
            write_inertial(element, link)
    for joint in source.joints:
        write_joint(root, joint)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    (folder / "robot.urdf").write_text(f'<?xml version="1.0"?>\n{text}\n')
    (folder / "LICENSE").write_text(source.license)
    print(f"{source.name}: {total} -> {count} triangles within {tolerance} m", flush=True)


def fit_robot(source: Source, folder: Path) -> None:
    """Fit spheres and capsules; write them.

    The first five arms to full and decimated meshes, the others as a user's: to what is shipped.
    """
    sheet = tomllib.loads((folder / "robot.toml").read_text())
    chain = fold_chain(read_urdf(folder / "robot.urdf"), flange=sheet["flange"])
    long = source.name in LONG_FIT
    parts = {
        link.name: [(p.vertices, p.faces) for p in link.parts] if long else []
        for link in source.links
    }
    for path in sorted((folder / "meshes").glob("*.obj")):
        parts[path.stem.rpartition("_")[0]].append(read_mesh_file(path))
    joints = [link.joint for link in chain.links if link.joint]
    options = FitOptions() if long else QUICK
    shapes = fit_chain(
        chain,
        np.array([joint.lower for joint in joints]),
        np.array([joint.upper for joint in joints]),
        replace(options, sphere_price=SPHERE_PRICE.get(source.name, options.sphere_price)),
        [join_triangles(parts[link.name]) for link in chain.links],
        say=lambda line: print(f"  {line}", flush=True),
    )
    (folder / "shapes.json").write_text(shapes_json(shapes, tuple(x.name for x in chain.links)))
    add_collisions(folder / "robot.urdf", shapes, [link.name for link in chain.links])
    for what, fit in (("spheres", shapes.sphere_fit), ("capsules", shapes.capsule_fit)):
        print(f"  {what}: {fit}", flush=True)


def add_collisions(path: Path, shapes: BodyShapes, names: list[str]) -> None:
    """The spheres as the URDF's collision geometry, for other readers."""
    tree = ET.parse(path)
    for element in tree.getroot().findall("link"):
        for old in element.findall("collision"):
            element.remove(old)
        if element.get("name") not in names:
            continue
        for k in np.flatnonzero(shapes.spheres.link == names.index(element.get("name", ""))):
            collision = ET.SubElement(element, "collision")
            center = " ".join(f"{v:.5f}" for v in shapes.spheres.center[k])
            ET.SubElement(collision, "origin", xyz=center, rpy="0 0 0")
            geometry = ET.SubElement(collision, "geometry")
            ET.SubElement(geometry, "sphere", radius=f"{shapes.spheres.radius[k]:.5f}")
    ET.indent(tree)
    text = ET.tostring(tree.getroot(), encoding="unicode")
    path.write_text(f'<?xml version="1.0"?>\n{text}\n')


def decimate(part: Part, tolerance: float) -> Part:
    """Fewer triangles, the surface moved by about a tolerance [m] at most."""
    vertices, faces = merge_vertices(part.vertices, part.faces)
    indices = np.ascontiguousarray(faces.ravel(), np.uint32)
    kept = np.zeros_like(indices)
    count = meshoptimizer.simplify(
        kept,
        indices,
        np.ascontiguousarray(vertices, np.float32),
        target_index_count=3,
        target_error=tolerance,
        options=meshoptimizer.SIMPLIFY_ERROR_ABSOLUTE,
    )
    used, faces = np.unique(kept[:count], return_inverse=True)
    return Part(part.color, vertices[used], faces.reshape(-1, 3))


def write_coarse(folder: Path) -> None:
    """What depth cameras see of an arm: each mesh again, with a fraction of its triangles."""
    for path in sorted((folder / "meshes").glob("*.obj")):
        whole = Part((0.0, 0.0, 0.0), *read_mesh_file(path))
        part = whole
        for tolerance in (1.0, 0.7, 0.5, 0.3, 0.2, 0.1):  # thin shells fall apart sooner than told
            tried = decimate(whole, tolerance * COARSE)
            if len(tried.vertices) >= 4 and deviation(whole, tried) < 2.0 * COARSE:
                part = tried
                break
        text = obj_text(part, folder.name, f"{path.stem}, coarse")
        (path.parent / "coarse").mkdir(exist_ok=True)
        (path.parent / "coarse" / path.name).write_text(text)


def deviation(one: Part, other: Part) -> float:
    """How far points of one surface are from the other at most, either way [m], sampled."""
    a, b = (trimesh.Trimesh(p.vertices, p.faces, process=False) for p in (one, other))
    return max(reach(a, b), reach(b, a))


def reach(surface: trimesh.Trimesh, other: trimesh.Trimesh) -> float:
    """How far sampled points and all vertices of a surface are from another one [m]."""
    points, _ = trimesh.sample.sample_surface(surface, 3000, seed=0)
    _, distance, _ = trimesh.proximity.closest_point_naive(
        other, np.concatenate([points, surface.vertices])
    )
    return float(distance.max())


def merge_vertices(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices closer than 0.01 mm are one; triangles without area go."""
    key, inverse = np.unique(np.round(vertices * 1e5).astype(np.int64), axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    good = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    return key * 1e-5, faces[good]


def obj_text(part: Part, robot: str, link: str) -> str:
    """Wavefront OBJ, millimetre/100 precision."""
    lines = [f"# {robot} {link}, see LICENSE and robot.toml"]
    lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in part.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in part.faces]
    return "\n".join(lines) + "\n"


def color_name(color: Color) -> str:
    """Unique name of a colour."""
    return "rgb_" + "_".join(f"{round(c * 255):d}" for c in color)


def write_inertial(element: ET.Element, link: Link) -> None:
    """The mass properties of a link."""
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=text(link.center), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=f"{link.mass:.9g}")
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    ET.SubElement(
        inertial, "inertia", {k: f"{v:.9g}" for k, v in zip(keys, link.inertia, strict=True)}
    )


def write_joint(root: ET.Element, joint: Joint) -> None:
    """One joint with the limits that it has."""
    element = ET.SubElement(root, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "origin", xyz=text(joint.xyz), rpy=text(joint.rpy))
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.kind == "revolute":
        ET.SubElement(element, "axis", xyz=text(joint.axis))
        ET.SubElement(
            element,
            "limit",
            lower=repr(joint.lower),
            upper=repr(joint.upper),
            velocity=repr(joint.velocity),
            effort=f"{joint.effort:g}",
        )


def text(values: tuple[float, ...]) -> str:
    """Numbers in full precision."""
    return " ".join(repr(float(v)) if v else "0" for v in values)
