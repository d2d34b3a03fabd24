"""The bodies of people and of things that move."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.arrays import Ints, Points, Pose, Vector3
from armsight.errors import UsageError
from armsight.geometry.pose import to_wxyz
from armsight.simulation import looks
from armsight.simulation.giving import GIVING, Give, Giver, add_giving
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import convex_pieces
from armsight.simulation.model_parts import (
    CONTACT,
    LOOSE,
    PUSHING,
    SEEN,
    SEEN_ONLY,
    TOUCH_ONLY,
    TOUCHED,
    Builder,
    Part,
    joined,
    set_inertia,
)
from armsight.simulation.people import BodyPart, PersonBody
from armsight.simulation.spec import MovingObjectSpec

NOWHERE = np.array([0.0, 0.0, -10.0])
"""Where people are before they have been moved for the first time [m]."""
PRINT = 5e-4
"""What is not thicker than twice this on a thing is printed on it: seen, and not touched [m]. A
straw that had sunk through such a sheet was held by it from behind, and pulled the face's skin 7 cm
after it with 10 N."""


@dataclass(frozen=True)
class LedBodies:
    """Everything that moves besides the arm, in the compiled model.

    Attributes:
        leaders: mocap index of what leads a part or a thing, by name (``anna/right_hand``).
        shapes: body that has its shape, by the same names.
        givers: bodies that give way.
        loose: where the free joint of each thing that nothing leads begins in ``qpos``, ``qvel``.
    """

    leaders: dict[str, int]
    shapes: dict[str, int]
    givers: tuple[Giver, ...]
    loose: dict[str, tuple[int, int]]


NOTHING_MOVES = LedBodies({}, {}, (), {})


class Movers:
    """Adds what moves to a model, and remembers how it is led.

    Args:
        builder: of the model; pushes: whether contact pushes.
    """

    def __init__(self, builder: Builder, pushes: bool) -> None:
        self._builder, self._pushes = builder, pushes
        self._givers: list[tuple[str, Giver]] = []
        self._loose: list[str] = []
        self._leaders: dict[str, Any] = {}
        self._shapes: dict[str, Any] = {}

    def led(self, model: Any) -> LedBodies:
        """Where all of it is in the compiled model."""
        leaders = {k: int(model.body(b.name).mocapid[0]) for k, b in self._leaders.items()}
        loose = {name: model.joint(f"object/{name}").id for name in self._loose}
        return LedBodies(
            leaders,
            {k: int(model.body(b.name).id) for k, b in self._shapes.items()},
            tuple(replace(giver, leader=leaders[name]) for name, giver in self._givers),
            {k: (int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])) for k, j in loose.items()},
        )

    def add_person(self, person: PersonBody) -> str:
        """The parts of a person, led by mocap bodies; name of the first of those."""
        for part in person.parts:
            name = f"{person.name}/{part.name}"
            leader = self._leader(name, f"person/{name}", NOWHERE, np.eye(4))
            give = GIVING.get(part.name) if self._pushes else None
            body, touch = leader, TOUCHED
            if give is not None:
                _, body = self._giving(name, give, _middle(part), np.eye(4))
                touch = PUSHING
            self._shapes[name] = body
            _body_part(self._builder, body, person.name, part, touch)
        return f"person/{person.name}/{person.parts[0].name}"

    def add_object(self, item: MovingObjectSpec) -> None:
        """A thing that moves: led, held or loose."""
        name, T = item.solid.name, item.solid.T_frame_solid
        place = np.eye(4)
        touch = PUSHING if self._pushes else TOUCH_ONLY
        if item.held_by:
            if item.held_by not in self._shapes:
                known = ", ".join(self._shapes) or "nobody is there"
                raise UsageError(f"{name} is held by '{item.held_by}'; there are: {known}")
            self._shapes[name] = self._shapes[item.held_by]
            place = T
        elif item.path == "loose":
            self._shapes[name] = self._add_loose(item)
            touch = LOOSE
        else:
            body = self._leader(name, f"object/{name}", T[:3, 3], T)
            if self._pushes:
                give = Give(item.mass, item.surface, item.hold)
                led, skin = self._giving(name, give, np.zeros(3), T)
                # What is seen is the thing, not its dented skin: where the tool is what bends, its
                # bending is in the skin, too, and no camera may take that for the thing's motion.
                self._shapes[name] = led
                thick = tuple(part for part in item.parts if part.half_edges.min() > PRINT)
                touched = replace(item, parts=thick)
                self._solids(touched, skin, place, {**touch, "group": CONTACT})
                touch = SEEN_ONLY
            else:
                self._shapes[name] = body
        self._solids(item, self._shapes[name], place, touch)

    def _solids(
        self, item: MovingObjectSpec, body: Any, place: Pose, options: dict[str, Any]
    ) -> None:
        """The shapes of a thing, at a pose in a body."""
        add, name = self._builder.solid, item.solid.name
        add(body, item.solid, place, "object", **options)
        for part in item.parts:
            add(body, part, place @ part.T_frame_solid, "object", name, **options)

    def _add_loose(self, item: MovingObjectSpec) -> Any:
        """A thing with a weight of its own that lies on others."""
        T, name = item.solid.T_frame_solid, f"object/{item.solid.name}"
        world = self._builder.mj.worldbody
        body = world.add_body(name=name, pos=T[:3, 3], quat=to_wxyz(T))
        body.add_freejoint(name=name)
        gyration = 0.3 * 2.0 * float(item.solid.half_edges.max())
        set_inertia(body, item.mass, np.zeros(3), np.eye(3) * item.mass * gyration**2)
        self._loose.append(item.solid.name)
        return body

    def _leader(self, name: str, body: str, position: Points, T: Pose) -> Any:
        world = self._builder.mj.worldbody
        leader = world.add_body(name=body, mocap=True, pos=position, quat=to_wxyz(T))
        self._leaders[name] = leader
        return leader

    def _giving(self, name: str, give: Give, center: Vector3, T: Pose) -> tuple[Any, Any]:
        """The body that follows the leader, and its skin."""
        led, skin = add_giving(self._builder.mj.worldbody, name, give, center, T)
        self._givers.append((name, Giver(-1, led.name, give, center)))
        return led, skin


def _middle(part: BodyPart) -> Vector3:
    """(3,) middle of a part's surfaces in its frame [m]."""
    vertices = np.concatenate([loft.mesh()[0] for loft in part.lofts if loft.pieces > 0])
    return np.asarray(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))


def _body_part(
    builder: Builder, body: Any, person: str, part: BodyPart, touch: dict[str, Any]
) -> None:
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
                    **touch,
                )
    for look, meshes in looks_of.items():
        name = f"{person}/{part.name}/{look}"
        builder.visual_mesh(name, *joined(meshes))
        material = looks.cloth_material(builder.mj, look, person)
        builder.looks(body, what, name, np.eye(4), material, SEEN)
