"""What every body of the simulated model is made of: geoms, groups, contact bits, what they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.arrays import Floats, Ints, Points, Pose
from armsight.geometry.pose import to_wxyz
from armsight.geometry.shapes import Solid
from armsight.simulation import looks
from armsight.simulation.gl import mujoco

Kind = Literal["arm", "static", "undeclared", "person", "object", "floor"]

SEEN, COARSE, COLOR_ONLY, CONTACT, FINE, DEPTH_ONLY = range(6)
"""Geom groups: seen in all pictures; meshes for cameras at work; what is for colour alone; what
only touches; meshes for stills; what is for depth alone."""
ARM, OTHER, LIES = 1, 2, 4
"""Contact bits: the arm touches others, others never each other; but a thing that lies somewhere
touches whatever does not move by itself, and its like."""
TOUCH_ONLY: dict[str, Any] = {"priority": 1, "margin": -10.0, "gap": 10.0}
"""People and movers are noticed when touched but do not push the arm, since they follow their own
motion whatever the arm does and would push with unlimited force: a contact within the gap is none
for the solver. (Until November 2026 they had next to no stiffness instead. A hand deep in the
shoulder of an arm that stood was fifteen contacts, which turned it at 1.5 m/s.)"""

TOUCHING: dict[str, Any] = {
    "contype": ARM,
    "conaffinity": OTHER,
    "group": CONTACT,
    "friction": [0.4, 0.005, 0.0001],
}
TOUCHED: dict[str, Any] = {"contype": OTHER, "conaffinity": ARM, **TOUCH_ONLY}
_FIRM: dict[str, Any] = {
    "priority": 2,
    "solref": [0.004, 1.0],
    "solimp": [0.98, 0.98, 0.001, 0.5, 2.0],
    "condim": 4,
    "friction": [0.8, 0.01, 0.0001],
}
PUSHING: dict[str, Any] = {"contype": OTHER, "conaffinity": ARM, **_FIRM}
"""Shapes of bodies that give way: firm themselves, their springs are what gives."""
SEEN_ONLY: dict[str, Any] = {"contype": 0, "conaffinity": 0}
"""What is seen of a body whose skin is what touches."""
LOOSE: dict[str, Any] = {"contype": OTHER | LIES, "conaffinity": ARM | LIES, **_FIRM}
"""Things that lie somewhere, and are pushed and gripped."""
MATERIALS = ("plain", "black_plastic", "shiny")
"""Materials that the sensors tell apart, in the order of their codes."""


@dataclass(frozen=True)
class Part:
    """What a geom belongs to.

    Attributes:
        kind: arm, static, undeclared, person, object or floor.
        owner: name of the arm, solid, person or object.
        part: name of the link or body part, or empty.
        link: index of the arm's link, -1 for all else.
        material: the solid's material.
    """

    kind: Kind
    owner: str
    part: str = ""
    link: int = -1
    material: str = "plain"


class Builder:
    """Adds things to a model's specification and remembers what each geom is."""

    def __init__(self, mj: Any) -> None:
        self.mj = mj
        self.parts: dict[str, Part] = {}

    def floor(self) -> None:
        """A plane to stand on.

        MuJoCo draws planes in pieces, for the lights' sake: an endless one in thousands, which
        takes half of a picture's time. So depth sees a slab, colour :meth:`far_floor`.
        """
        what = Part("floor", "floor")
        self.geom(
            self.mj.worldbody,
            what,
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.0, 0.0, 0.1],  # without end
            conaffinity=ARM | LIES,
            contype=OTHER,
            group=CONTACT,
        )
        self.geom(
            self.mj.worldbody,
            what,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[40.0, 40.0, 0.05],
            pos=[0.0, 0.0, -0.05],
            contype=0,
            conaffinity=0,
            group=DEPTH_ONLY,
        )

    def far_floor(self) -> None:
        """The floor in colour, as far as the haze lets anybody see it.

        To be added after everything else: geoms are drawn in their order, and what of the floor is
        hidden by then is not lit and textured for nothing.
        """
        self.geom(
            self.mj.worldbody.add_body(name="floor"),
            Part("floor", "floor"),
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[20.0, 20.0, 1.0],  # the last is the edge of a piece
            material="floor",
            contype=0,
            conaffinity=0,
            group=COLOR_ONLY,
        )

    def solid(
        self, body: Any, solid: Solid, T: Pose, what: Kind | Part, owner: str = "", **options: Any
    ) -> None:
        """A box, cylinder or sphere at a pose in a body, that the arm may touch."""
        kinds = {
            "box": (mujoco.mjtGeom.mjGEOM_BOX, 0.5 * np.asarray(solid.size)),
            "cylinder": (
                mujoco.mjtGeom.mjGEOM_CYLINDER,
                np.array([solid.size[0], 0.5 * solid.size[1], 0.0]),
            ),
            "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, np.array([solid.size[0], 0.0, 0.0])),
        }
        geom_type, size = kinds[solid.kind]
        self.geom(
            body,
            what
            if isinstance(what, Part)
            else Part(what, owner or solid.name, material=solid.material),
            type=geom_type,
            size=size,
            pos=T[:3, 3],
            quat=to_wxyz(T),
            material=looks.solid_material(self.mj, solid),
            **({"contype": OTHER, "conaffinity": ARM | LIES} | options),
        )

    def looks(self, body: Any, part: Part, mesh: str, T: Pose, material: str, group: int) -> None:
        """A mesh that is seen and touches nothing."""
        self.geom(
            body,
            part,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh,
            pos=T[:3, 3],
            quat=to_wxyz(T),
            material=material,
            contype=0,
            conaffinity=0,
            group=group,
        )

    def visual_mesh(self, name: str, vertices: Points, faces: Ints) -> None:
        """A mesh to draw, open ones as well."""
        self.mj.add_mesh(
            name=name,
            uservert=np.asarray(vertices).ravel(),
            userface=np.asarray(faces).ravel().astype(np.int32),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )

    def geom(self, body: Any, part: Part, **options: Any) -> None:
        """A geom of a body, and what it is."""
        name = f"{len(self.parts)}"
        self.parts[name] = part
        body.add_geom(name=name, **options)


def joined(meshes: Sequence[tuple[Points, Ints]]) -> tuple[Points, Ints]:
    """Several meshes as one."""
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [f + count for (_, f), count in zip(meshes, counts)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def set_inertia(body: Any, mass: float, center: Floats, inertia: Floats) -> None:
    """Mass [kg], centre of mass [m] and (3, 3) inertia about it [kg m^2] of a body."""
    i = inertia
    body.explicitinertial = True
    body.mass = mass
    body.ipos = center
    body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
