"""The bodies of people and of things that move."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Ints, Points
from armsight.geometry.pose import to_wxyz
from armsight.simulation import looks
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import convex_pieces
from armsight.simulation.model_parts import (
    CONTACT,
    SEEN,
    TOUCH_ONLY,
    TOUCHED,
    Builder,
    Part,
    joined,
)
from armsight.simulation.people import BodyPart, PersonBody
from armsight.simulation.spec import MovingObjectSpec


def add_person(builder: Builder, person: PersonBody) -> str:
    """The parts of a person, led by mocap bodies; name of the first of those."""
    first = ""
    for part in person.parts:
        name = f"person/{person.name}/{part.name}"
        first = first or name
        body = builder.mj.worldbody.add_body(name=name, mocap=True, pos=[0, 0, -10])
        _body_part(builder, body, person.name, part)
    return first


def _body_part(builder: Builder, body: Any, person: str, part: BodyPart) -> None:
    """One mesh to see for each look, and convex pieces to touch, of the same surfaces."""
    what = Part("person", person, part.name)
    looks_of: dict[str, list[tuple[Points, Ints]]] = {}
    for piece in part.lofts:
        vertices, faces = piece.mesh()
        looks_of.setdefault(piece.look, []).append((vertices, faces))
        for i, hull in enumerate(convex_pieces(vertices, faces, piece.pieces)):
            if piece.pieces > 0:
                name = f"{person}/{part.name}/{piece.name}/{i}"
                builder.mj.add_mesh(name=name, uservert=hull.ravel())
                builder.geom(
                    body,
                    what,
                    type=mujoco.mjtGeom.mjGEOM_MESH,
                    meshname=name,
                    group=CONTACT,
                    **TOUCHED,
                )
    for look, meshes in looks_of.items():
        name = f"{person}/{part.name}/{look}"
        builder.visual_mesh(name, *joined(meshes))
        material = looks.cloth_material(builder.mj, look, person)
        builder.looks(body, what, name, np.eye(4), material, SEEN)


def add_object(builder: Builder, item: MovingObjectSpec) -> str:
    """A thing that moves, led by a mocap body; its name."""
    name = f"object/{item.solid.name}"
    T = item.solid.T_frame_solid
    body = builder.mj.worldbody.add_body(name=name, mocap=True, pos=T[:3, 3], quat=to_wxyz(T))
    builder.solid(
        body,
        item.solid,
        np.eye(4),
        "object",
        **TOUCH_ONLY,
    )
    for part in item.parts:
        builder.solid(body, part, part.T_frame_solid, "object", item.solid.name, **TOUCH_ONLY)
    return name
