"""A serial robot arm as data: chain, limits, link shapes. Kinematics live beside it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, Ints, JointVector, Points, Pose, Poses
from armsight.geometry.shapes import Solid
from armsight.robots.cable import HungCable
from armsight.robots.soft_mount import SoftMount
from armsight.robots.sprung_tip import SprungTip


@dataclass(frozen=True)
class JointLimits:
    """(n,) limits of the joints: [rad], [rad], [rad/s], [rad/s^2], [rad/s^3].

    ``effort`` is the greatest torque [N m], NaN or None where nobody says.
    """

    lower: JointVector
    upper: JointVector
    velocity: JointVector
    acceleration: JointVector
    jerk: JointVector
    effort: JointVector | None = None

    def scaled(self, velocity: float, acceleration: float) -> JointLimits:
        """The same ranges at a share of speed, and of acceleration and jerk."""
        return replace(
            self,
            velocity=self.velocity * velocity,
            acceleration=self.acceleration * acceleration,
            jerk=self.jerk * acceleration,
        )


@dataclass(frozen=True)
class Spheres:
    """The body as spheres.

    Attributes:
        link: (m,) index of the link that carries each.
        center: (m, 3) in the link's frame [m].
        radius: (m,) [m].
    """

    link: Ints
    center: Points
    radius: Floats


@dataclass(frozen=True)
class Capsules:
    """The body as cylinders with round ends (T2's link cylinders lie inside them).

    Attributes:
        link: (m,) index of the link that carries each.
        start, end: (m, 3) axis ends in the link's frame [m].
        radius: (m,) [m].
    """

    link: Ints
    start: Points
    end: Points
    radius: Floats


@dataclass(frozen=True)
class LinkMesh:
    """One coloured surface of a link: a mesh file, RGB 0..1.

    The catalogue's meshes are OBJ files in the link's frame [m]; only arms loaded with
    ``load_urdf`` may have a pose or scale other than the defaults. ``read_mesh`` heeds both.
    """

    link: int
    path: Path
    color: tuple[float, float, float]
    T_link_mesh: Pose = field(default_factory=lambda: np.eye(4))
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Tool:
    """What the flange carries.

    Attributes:
        name: key of the catalogue.
        T_flange_tcp: the tool's working point.
        spheres: link indices are ignored; centres in the flange's frame.
        capsules: likewise.
        meshes: likewise.
        mass: [kg]; center_of_mass: (3,) in the flange's frame [m].
        held: solids that it holds, in the flange's frame; spheres and mass count them already.
        mount: that lets it and what it holds give way; None where it is bolted to the flange.
        tip: how what of it may touch gives way by itself; None where that is stiff.
        cable: from it to a hanger in the cell; None where there is none, or nobody says where.
    """

    name: str
    T_flange_tcp: Pose
    spheres: Spheres
    capsules: Capsules
    meshes: tuple[LinkMesh, ...]
    mass: float
    center_of_mass: Floats
    held: tuple[Solid, ...] = ()
    mount: SoftMount | None = None
    tip: SprungTip | None = None
    cable: HungCable | None = None

    def moved(self, T_flange_moved: Pose) -> Tool:
        """The same tool, mounted elsewhere than it was designed to be.

        Args:
            T_flange_moved: where the frame of the flange, as the tool was designed, truly is.
        """
        R, t = T_flange_moved[:3, :3], T_flange_moved[:3, 3]

        def of(points: Points) -> Points:
            return np.asarray(points @ R.T + t, np.float64)

        s, c = self.spheres, self.capsules
        return replace(
            self,
            T_flange_tcp=T_flange_moved @ self.T_flange_tcp,
            spheres=Spheres(s.link, of(s.center), s.radius),
            capsules=Capsules(c.link, of(c.start), of(c.end), c.radius),
            meshes=tuple(
                replace(mesh, T_link_mesh=T_flange_moved @ mesh.T_link_mesh) for mesh in self.meshes
            ),
            center_of_mass=np.asarray(of(self.center_of_mass), np.float64),
            held=tuple(
                replace(solid, T_frame_solid=T_flange_moved @ solid.T_frame_solid)
                for solid in self.held
            ),
        )


@dataclass(frozen=True)
class Robot:
    """An arm of n revolute joints. Link 0 is the base; link i moves with joint i - 1.

    Fixed joints of the URDF are folded away. The base frame follows REP-103.

    Attributes:
        name: key of the catalogue (``ur3 ur5 ur10 iiwa panda``).
        joint_names, link_names: n and n + 1 names from the URDF.
        T_link_joint: (n, 4, 4) joint i's frame at zero in link i's frame.
        axis: (n, 3) joint i's axis in its own frame.
        T_last_flange: the flange in the last link's frame.
        limits: of the joints.
        spheres, capsules: the body, each covering the meshes.
        self_pairs: (p, 2) pairs of links that can touch each other and are worth checking.
        meshes: what the arm looks like.
        link_mass: (n + 1,) [kg]; link_com: (n + 1, 3) in the link's frame [m];
        link_inertia: (n + 1, 3, 3) about the centre of mass, link axes [kg m^2].
        home: (n,) an upright, free configuration [rad].
        reach: the maker's figure [m].
        tool: what the flange carries, or None.
        tool_pairs: (p, 2) pairs that join ``self_pairs`` once the last link carries a tool.
    """

    name: str
    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    T_link_joint: Poses
    axis: Points
    T_last_flange: Pose
    limits: JointLimits
    spheres: Spheres
    capsules: Capsules
    self_pairs: Ints
    meshes: tuple[LinkMesh, ...]
    link_mass: Floats
    link_com: Points
    link_inertia: Floats
    home: JointVector
    reach: float
    tool: Tool | None = None
    tool_pairs: Ints = field(default_factory=lambda: np.empty((0, 2), np.int64))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def stretched(self) -> float:
        """Sum of the lengths behind the second joint [m]: no flange is farther from that.

        A maker's ``reach`` often ends at the wrist.
        """
        lengths = np.linalg.norm(self.T_link_joint[2:, :3, 3], axis=1)
        return float(lengths.sum() + np.linalg.norm(self.T_last_flange[:3, 3]))

    def without_tool(self) -> Robot:
        """The bare arm."""
        if self.tool is None:
            return self
        s, c = self.spheres, self.capsules
        n, m = len(s.radius) - len(self.tool.spheres.radius), len(c.radius)
        m -= len(self.tool.capsules.radius)
        return replace(
            self,
            spheres=Spheres(s.link[:n], s.center[:n], s.radius[:n]),
            capsules=Capsules(c.link[:m], c.start[:m], c.end[:m], c.radius[:m]),
            self_pairs=self.self_pairs[: len(self.self_pairs) - len(self.tool_pairs)],
            tool=None,
        )

    def with_tool(self, tool: Tool) -> Robot:
        """The same arm carrying a tool: its shapes join the last link's.

        Its meshes and mass do not: they stay with ``tool``, in the flange's frame.

        Raises:
            ValueError: the arm carries a tool already.
        """
        if self.tool is not None:
            raise ValueError(f"{self.name} already carries {self.tool.name}")
        R, t = self.T_last_flange[:3, :3], self.T_last_flange[:3, 3]

        def on_last(points: Points) -> Points:
            return np.asarray(points @ R.T + t)

        last = self.n
        spheres = Spheres(
            np.concatenate([self.spheres.link, np.full(len(tool.spheres.radius), last)]),
            np.concatenate([self.spheres.center, on_last(tool.spheres.center)]),
            np.concatenate([self.spheres.radius, tool.spheres.radius]),
        )
        capsules = Capsules(
            np.concatenate([self.capsules.link, np.full(len(tool.capsules.radius), last)]),
            np.concatenate([self.capsules.start, on_last(tool.capsules.start)]),
            np.concatenate([self.capsules.end, on_last(tool.capsules.end)]),
            np.concatenate([self.capsules.radius, tool.capsules.radius]),
        )
        pairs = np.concatenate([self.self_pairs, self.tool_pairs])
        return replace(self, spheres=spheres, capsules=capsules, self_pairs=pairs, tool=tool)
