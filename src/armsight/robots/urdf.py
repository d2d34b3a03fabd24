"""Reading URDF files: XML to checked plain data, with errors that name file and element.

Only what an arm needs is read: links with visuals, collisions and inertia; joints. No external
entity is ever fetched: a document type declaration is refused.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.errors import RobotError
from armsight.geometry.pose import from_rpy

GeometryKind = Literal["mesh", "box", "cylinder", "sphere"]
_JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating")
_DEFAULT_COLOR = (0.7, 0.7, 0.7)
EXPAND = "a xacro has to be expanded first: xacro IN > OUT.urdf"


@dataclass(frozen=True)
class Geometry:
    """One shape of a link.

    Attributes:
        kind: mesh, box, cylinder (along z) or sphere.
        size: box: full edges; cylinder: (radius, length, 0); sphere: (radius, 0, 0);
            mesh: scale along x, y, z.
        T_link_geometry: its pose in the link's frame.
        color: RGB 0..1; only visuals carry one.
        path: of a mesh, resolved; whether it exists is checked where it is read.
    """

    kind: GeometryKind
    size: tuple[float, float, float]
    T_link_geometry: Pose
    color: tuple[float, float, float] = _DEFAULT_COLOR
    path: Path | None = None


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass (3,) and inertia (3, 3) about it, in the link's axes."""

    mass: float
    center: Floats
    inertia: Floats


@dataclass(frozen=True)
class UrdfLink:
    """A link as the file says; ``inertial`` is None where the file is silent."""

    name: str
    visuals: tuple[Geometry, ...]
    collisions: tuple[Geometry, ...]
    inertial: Inertial | None


@dataclass(frozen=True)
class UrdfJoint:
    """A joint as the file says.

    Attributes:
        name, kind, parent, child: kind is revolute, continuous, prismatic, fixed, planar or
            floating.
        T_parent_joint: its frame in the parent link's.
        axis: (3,) unit axis in the joint's frame.
        lower, upper: [rad]; velocity: [rad/s]; effort: [N m]; NaN where the file is silent.
        mimic: the joint that moves it, and by what its value is multiplied and added to.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Pose
    axis: Floats
    lower: float
    upper: float
    velocity: float
    effort: float
    mimic: tuple[str, float, float] | None = None


@dataclass(frozen=True)
class Urdf:
    """A whole file: a tree of links and joints with one root."""

    name: str
    path: Path
    links: dict[str, UrdfLink]
    joints: dict[str, UrdfJoint]
    root: str

    def children(self, link: str) -> list[UrdfJoint]:
        """The joints that hang on a link, in the file's order."""
        return [j for j in self.joints.values() if j.parent == link]


def read_urdf(path: Path, packages: dict[str, Path] | None = None) -> Urdf:
    """Parse and check a URDF file.

    Args:
        path: of the file.
        packages: folders that ``package://NAME/`` stands for; otherwise NAME is looked for in
            the file's folder and upwards, as a folder of that name or as the folder itself.

    Raises:
        RobotError: the file cannot be read, is not a URDF, or its tree is broken.
    """
    return _Reader(Path(path), packages or {}).read()


class _NoDoctype(ET.TreeBuilder):
    """Refuses a document type declaration, the door to entity tricks."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise RobotError("a document type declaration is not allowed in a URDF; remove it")


class _Reader:
    def __init__(self, path: Path, packages: dict[str, Path]) -> None:
        self.path = path
        self.packages = packages
        self.colors: dict[str, tuple[float, float, float]] = {}

    def fail(self, where: str, what: str) -> RobotError:
        return RobotError(f"{self.path}: {where}: {what}" if where else f"{self.path}: {what}")

    def read(self) -> Urdf:
        root = self.parse()
        if root.tag != "robot":
            raise self.fail("", f"the outermost element is <{root.tag}>, expected <robot>")
        self.check_expanded(root)
        for material in root.findall("material"):
            self.material(material, "material")
        links: dict[str, UrdfLink] = {}
        for element in root.findall("link"):
            link = self.link(element)
            if link.name in links:
                raise self.fail(f'link "{link.name}"', "appears twice; names must be unique")
            links[link.name] = link
        joints: dict[str, UrdfJoint] = {}
        for element in root.findall("joint"):
            joint = self.joint(element)
            if joint.name in joints:
                raise self.fail(f'joint "{joint.name}"', "appears twice; names must be unique")
            joints[joint.name] = joint
        return Urdf(
            root.get("name") or self.path.stem, self.path, links, joints, self.tree(links, joints)
        )

    def parse(self) -> ET.Element:
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise self.fail("", f"cannot be read ({error.strerror}); check the path") from None
        parser = ET.XMLParser(target=_NoDoctype())  # noqa: S314  (doctype refused above)
        try:
            parser.feed(data)
            root: ET.Element = parser.close()
        except ET.ParseError as error:
            hint = EXPAND if b"<xacro:" in data else "mend that line"
            raise self.fail("", f"is not well-formed XML ({error}); {hint}") from None
        except RobotError as error:
            raise self.fail("", str(error)) from None
        return root

    def check_expanded(self, root: ET.Element) -> None:
        """Refuses what would have been links and joints; values and definitions do no harm."""
        for element in root:
            space, _, tag = element.tag.rpartition("}")
            if "xacro" in space and tag not in ("property", "arg", "macro"):
                raise self.fail("", f"<xacro:{tag}> was not expanded; {EXPAND}")

    def tree(self, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> str:
        """Name of the one root; refuses unknown links, second parents, loops and islands."""
        if not links:
            raise self.fail("", "has no <link>")
        parent: dict[str, UrdfJoint] = {}
        for joint in joints.values():
            for role, name in (("parent", joint.parent), ("child", joint.child)):
                if name not in links:
                    known = ", ".join(list(links)[:8])
                    raise self.fail(
                        f'joint "{joint.name}"', f'{role} link "{name}" is unknown; known: {known}'
                    )
            if joint.child in parent:
                raise self.fail(
                    f'link "{joint.child}"',
                    f'has two parent joints, "{parent[joint.child].name}" and "{joint.name}"; '
                    "a URDF is a tree",
                )
            parent[joint.child] = joint
        for name in links:
            seen = {name}
            while name in parent:
                name = parent[name].parent
                if name in seen:
                    raise self.fail(
                        f'link "{name}"', "is its own ancestor: the joints form a loop; cut it"
                    )
                seen.add(name)
        roots = [name for name in links if name not in parent]
        if len(roots) > 1:
            raise self.fail(
                "", f"has {len(roots)} roots ({', '.join(roots[:4])}); join them with fixed joints"
            )
        return roots[0]

    def link(self, element: ET.Element) -> UrdfLink:
        name = self.name(element)
        where = f'link "{name}"'
        visuals = [self.geometry(v, f"{where} <visual>") for v in element.findall("visual")]
        solids = [self.geometry(c, f"{where} <collision>") for c in element.findall("collision")]
        return UrdfLink(name, tuple(visuals), tuple(solids), self.inertial(element, where))

    def joint(self, element: ET.Element) -> UrdfJoint:
        name = self.name(element)
        where = f'joint "{name}"'
        kind = element.get("type", "")
        if kind not in _JOINT_TYPES:
            raise self.fail(
                where, f'type "{kind}" is not supported; expected {", ".join(_JOINT_TYPES)}'
            )
        parent, child = (self.link_of(element, role, where) for role in ("parent", "child"))
        axis = np.array([1.0, 0.0, 0.0])
        axis_element = element.find("axis")
        if axis_element is not None and kind != "fixed":
            axis = np.array(self.numbers(axis_element, "xyz", 3, f"{where} <axis>", axis))
            length = float(np.linalg.norm(axis))
            if length < 1e-6:
                raise self.fail(f"{where} <axis>", "has no length; give a direction")
            axis = axis / length
        bounds = [math.nan] * 4
        limit = element.find("limit")
        if limit is not None:
            bounds = [
                self.number(limit, key, f"{where} <limit>", default)
                for key, default in (
                    ("lower", 0.0),
                    ("upper", 0.0),
                    ("velocity", math.nan),
                    ("effort", math.nan),
                )
            ]
        if kind == "continuous":
            bounds[:2] = [math.nan] * 2
        lower, upper, velocity, effort = bounds
        origin, mimic = self.origin(element, where), self.mimic(element, where)
        return UrdfJoint(
            name, kind, parent, child, origin, axis, lower, upper, velocity, effort, mimic
        )

    def mimic(self, element: ET.Element, where: str) -> tuple[str, float, float] | None:
        found = element.find("mimic")
        if found is None:
            return None
        where = f"{where} <mimic>"
        leader = found.get("joint")
        if not leader:
            raise self.fail(where, 'has no joint="..."')
        factor, offset = (
            self.number(found, key, where, default)
            for key, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        return leader, factor, offset

    def link_of(self, element: ET.Element, role: str, where: str) -> str:
        found = element.find(role)
        link = found.get("link") if found is not None else None
        if not link:
            raise self.fail(where, f'has no <{role} link="..."/>')
        return link

    def geometry(self, element: ET.Element, where: str) -> Geometry:
        T = self.origin(element, where)
        holder = element.find("geometry")
        shape = next(iter(holder), None) if holder is not None else None
        if shape is None:
            raise self.fail(where, "has no <geometry> with a shape in it")
        color = _DEFAULT_COLOR
        material = element.find("material")
        if material is not None:
            color = self.material(material, where)
        if shape.tag == "box":
            x, y, z = self.positive(self.numbers(shape, "size", 3, where), where, "box size")
            return Geometry("box", (x, y, z), T, color)
        if shape.tag == "cylinder":
            sizes = [self.number(shape, key, where) for key in ("radius", "length")]
            radius, length = self.positive(sizes, where, "cylinder size")
            return Geometry("cylinder", (radius, length, 0.0), T, color)
        if shape.tag == "sphere":
            (radius,) = self.positive([self.number(shape, "radius", where)], where, "radius")
            return Geometry("sphere", (radius, 0.0, 0.0), T, color)
        if shape.tag == "mesh":
            name = shape.get("filename")
            if not name:
                raise self.fail(where, "<mesh> has no filename")
            x, y, z = self.numbers(shape, "scale", 3, where, np.ones(3))
            return Geometry("mesh", (x, y, z), T, color, self.resolve(name, where))
        raise self.fail(
            where, f"shape <{shape.tag}> is not known; expected mesh, box, cylinder or sphere"
        )

    def material(self, element: ET.Element, where: str) -> tuple[float, float, float]:
        """RGB of a material, remembered by name; a bare name refers to an earlier one."""
        name = element.get("name", "")
        color = element.find("color")
        if color is not None:
            r, g, b, _ = self.numbers(color, "rgba", 4, f"{where} <color>")
            if not all(0.0 <= c <= 1.0 for c in (r, g, b)):
                raise self.fail(f"{where} <color>", f"rgba {r:g} {g:g} {b:g} is not within 0..1")
            self.colors.setdefault(name, (r, g, b))
            return (r, g, b)
        return self.colors.get(name, _DEFAULT_COLOR)

    def inertial(self, element: ET.Element, where: str) -> Inertial | None:
        found = element.find("inertial")
        if found is None:
            return None
        where = f"{where} <inertial>"
        mass_element, inertia_element = found.find("mass"), found.find("inertia")
        if mass_element is None:
            raise self.fail(where, 'has no <mass value="..."/>')
        mass = self.number(mass_element, "value", where)
        if mass < 0.0:
            raise self.fail(where, f"mass {mass:g} kg is negative")
        T = self.origin(found, where)
        inertia = np.zeros((3, 3))
        if inertia_element is not None:
            xx, xy, xz, yy, yz, zz = (
                self.number(inertia_element, key, where, 0.0)
                for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            )
            local = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            inertia = T[:3, :3] @ local @ T[:3, :3].T
        return Inertial(mass, T[:3, 3].copy(), inertia)

    def origin(self, element: ET.Element, where: str) -> Pose:
        found = element.find("origin")
        if found is None:
            return np.eye(4)
        where = f"{where} <origin>"
        rpy = self.numbers(found, "rpy", 3, where, np.zeros(3))
        return from_rpy(
            [_exact_angle(a) for a in rpy], self.numbers(found, "xyz", 3, where, np.zeros(3))
        )

    def name(self, element: ET.Element) -> str:
        name = element.get("name")
        if not name:
            raise self.fail(f"<{element.tag}>", "has no name")
        return name

    def number(
        self, element: ET.Element, key: str, where: str, default: float | None = None
    ) -> float:
        fallback = None if default is None else np.array([default])
        return self.numbers(element, key, 1, where, fallback)[0]

    def numbers(
        self,
        element: ET.Element,
        key: str,
        count: int,
        where: str,
        default: Floats | None = None,
    ) -> list[float]:
        text = element.get(key)
        if text is None:
            if default is None:
                raise self.fail(where, f'<{element.tag}> has no {key}="..."')
            return [float(v) for v in default]
        try:
            values = [float(v) for v in text.split()]
        except ValueError:
            raise self.fail(where, f'{key}="{text}" is not {count} number(s)') from None
        if len(values) != count or not all(math.isfinite(v) for v in values):
            raise self.fail(where, f'{key}="{text}" is not {count} finite number(s)')
        return values

    def positive(self, values: list[float], where: str, what: str) -> list[float]:
        if not all(v > 0.0 for v in values):
            raise self.fail(where, f"{what} {values} must be above 0 m")
        return values

    def resolve(self, name: str, where: str) -> Path:
        """Where a mesh lies; a name that leads nowhere is kept, reading it will say so."""
        folder = self.path.parent
        if name.startswith("file://"):
            return Path(name[7:])
        if not name.startswith("package://"):
            if "://" in name:
                raise self.fail(where, f'mesh "{name}" is not a file, package:// or relative path')
            return folder / name
        package, _, rest = name[10:].partition("/")
        if package in self.packages:
            return self.packages[package] / rest
        for up in (folder, *folder.resolve().parents):
            if up.name == package and (up / rest).is_file():
                return up / rest
            if (up / package / rest).is_file():
                return up / package / rest
        return folder / package / rest


def _exact_angle(angle: float) -> float:
    """Quarter turns that were written with few digits, made exact."""
    quarter = round(angle / (0.5 * math.pi)) * (0.5 * math.pi)
    return quarter if abs(angle - quarter) < 1e-9 else angle
