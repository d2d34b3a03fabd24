"""A plug in a mount that gives way, the socket that it enters, and what rubs and hangs there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.devices.world import MovingSolid
from armsight.geometry.pose import inverse, make_pose, to_wxyz
from armsight.geometry.shapes import Solid
from armsight.robots.cable import PIECES, HungCable, SwingingCable
from armsight.simulation.cable import cable_pull
from armsight.simulation.gl import mujoco
from armsight.simulation.model_parts import COLOR_ONLY, CONTACT, SEEN, Builder, Part, set_inertia
from armsight.simulation.spec import CableSpec, Look, PlugSpec, SocketSpec

SOCKET, PLUG = 8, 16
"""Contact bits of the two; they touch each other alone."""
SOFT: dict[str, Any] = {
    "solref": [0.003, 1.0],
    "solimp": [0.95, 0.99, 0.0005, 0.5, 2.0],
    "condim": 4,
    "margin": 0.0,
    "group": CONTACT,
}
"""For steps of 1 ms: at 2 ms the plug sinks into the wall by 0.1 mm, a quarter of the clearance.
They strike like a contact of 2 ms in fine steps; one of 2 ms, MuJoCo's fastest, struck 1.7 times as
hard, and a plug that slid from wall to wall rattled itself up to 97 N, where fine steps have 20."""
INERTIA = (0.00375, 0.00375, 0.00125)
"""Of a plug about its axes, a kilogram of it [m^2]."""
DAMPING = 0.4
"""Damping ratio of the mount."""
RUBS = 0.002
"""Mated contacts rub with all their force from this speed on [m/s]."""
MOVED = 0.001
"""A cable's pull is worked out anew when its end has moved so far [m]."""
BODY, SOCKET_BODY = "plug", "socket"
CABLE = "cable/{}"
"""Pieces of a cable, led by what they are drawn from."""
BLACK = (0.05, 0.05, 0.055)


def add_plug(parent: Any, spec: PlugSpec, T: Pose, mass: float, center: Floats) -> Any:
    """The plug's body on six springs: a rigid mount would never seat.

    Args:
        parent: body that the mount is bolted to.
        spec: of the plug.
        T: where the plug is in it when nothing presses.
        mass: [kg].
        center: (3,) centre of mass in the plug's frame [m].
    """
    plug = parent.add_body(name=BODY, pos=T[:3, 3], quat=to_wxyz(T))
    along, about = spec.stiffness
    inertia = np.array(INERTIA) * mass
    for kind, k, m in (
        (mujoco.mjtJoint.mjJNT_SLIDE, along, np.repeat(mass, 3)),
        (mujoco.mjtJoint.mjJNT_HINGE, about, inertia + 0.01),
    ):
        for i in range(3):
            joint = plug.add_joint(
                name=f"mount/{int(kind)}/{i}",
                type=kind,
                axis=np.eye(3)[i],
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
            # MuJoCo's springs and dampers are polynomials
            joint.stiffness = [k, 0.0, 0.0]
            joint.damping = [2.0 * DAMPING * float(np.sqrt(k * m[i])), 0.0, 0.0]
    set_inertia(plug, mass, center, np.diag(inertia))
    return plug


def add_sleeve(builder: Builder, plug: Any, spec: PlugSpec, part: Part) -> None:
    """What of the plug enters a socket."""
    for ends in spec.capsules:
        builder.geom(
            plug,
            part,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[spec.radius, 0, 0],
            fromto=ends,
            contype=PLUG,
            conaffinity=SOCKET,
            friction=[spec.friction, 0.002, 0.0001],
            **SOFT,
        )


def add_cable(builder: Builder, cable: CableSpec) -> None:
    """What is seen of a cable that is hung up; it touches nothing."""
    piece = cable.length / PIECES
    for k in range(PIECES):
        body = builder.mj.worldbody.add_body(name=CABLE.format(k), mocap=True)
        builder.geom(
            body,
            Part("undeclared", "cable"),
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[cable.radius, 0.0, 0.0],
            fromto=(0.0, 0.0, -0.5 * piece, 0.0, 0.0, 0.5 * piece),
            rgba=[*BLACK, 1.0],
            contype=0,
            conaffinity=0,
            group=SEEN,
        )


def add_socket(builder: Builder, spec: SocketSpec) -> Any:
    """Walls to touch, surfaces to see, and the car about them: one body that can be led."""
    T = spec.T_world_socket
    body = builder.mj.worldbody.add_body(
        name=SOCKET_BODY, mocap=True, pos=T[:3, 3], quat=to_wxyz(T)
    )
    for solid in spec.solids:
        builder.solid(body, solid, solid.T_frame_solid, "undeclared")
    for pose, half in zip(spec.boxes, spec.half):
        builder.geom(
            body,
            Part("static", spec.name),
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=pose[:3, 3],
            quat=to_wxyz(pose),
            contype=SOCKET,
            conaffinity=PLUG,
            friction=[spec.friction, 0.002, 0.0001],
            **SOFT,
        )
    add_looks(builder, body, spec.looks, spec.name, Part("static", spec.name))
    return body


def add_looks(builder: Builder, body: Any, looks: Sequence[Look], prefix: str, part: Part) -> None:
    """Surfaces that are seen and touch nothing, in a body's frame."""
    for i, look in enumerate(looks):
        if not len(look.faces):
            continue
        name = f"{prefix}/{i}"
        builder.mj.add_material(
            name=name, rgba=[*look.color, 1.0], specular=look.gloss, shininess=0.4
        )
        faces = look.faces.astype(np.int32).ravel()
        builder.mj.add_mesh(
            name=name,
            uservert=look.vertices.astype(np.float32).ravel(),
            usernormal=look.normals.astype(np.float32).ravel(),
            userface=faces,
            userfacenormal=faces,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        group = SEEN if look.material else COLOR_ONLY
        seen = replace(part, material=look.material or "plain")
        builder.looks(body, seen, name, np.eye(4), name, group)


@dataclass(frozen=True)
class Caught:
    """A cable that something holds, so that what is left of it stretches like a spring.

    Attributes:
        place: (3,) where it is held, in world [m]; slack: how much of it is left [m].
        stiffness: of what is left once it is taut [N/m].
    """

    place: Vector3
    slack: float
    stiffness: float = 5000.0

    def pull(self, end: Vector3) -> Vector3:
        """(3,) force [N] in world on its end at (3,) [m]."""
        way = np.asarray(self.place) - end
        length = max(float(np.linalg.norm(way)), 1e-9)
        return np.asarray(way * (self.stiffness * max(length - self.slack, 0.0) / length))


class Plugged:
    """What acts on the plug besides contact: its cable, and the contacts that are mated.

    Args:
        model, data: MuJoCo's.
        plug: spec of the plug; socket: of what it enters, or None.

    Attributes:
        caught: where its cable has been caught; None while it runs free.
    """

    def __init__(self, model: Any, data: Any, plug: PlugSpec, socket: SocketSpec | None) -> None:
        self._data, self._model = data, model
        self._plug, self._socket = plug, socket
        self._body = int(model.body(BODY).id)
        self._at = -1 if socket is None else int(model.body(SOCKET_BODY).id)
        self._weight, self._rear = np.array([0.0, 0.0, -plug.cable]), np.asarray(plug.rear)
        if plug.hung is not None:
            self._pieces = [int(model.body(CABLE.format(k)).mocapid[0]) for k in range(PIECES)]
        self.caught: Caught | None = None
        self._velocity = np.zeros(6)
        self._contact = np.zeros(6)
        self._rubs = np.zeros(3)
        self.reset()

    def reset(self) -> None:
        """Its cable hangs as if it had never been led; where it has been caught it stays."""
        self._hung_at = np.full(3, np.inf)
        self._swinging: SwingingCable | None = None
        c = self._plug.hung
        if c is not None:
            hung = HungCable(c.hanger, c.length, c.radius, self._plug.rear, c.mass, c.bending)
            self._swinging = SwingingCable(hung)

    def push(self) -> None:
        """Write the forces for the next step."""
        data, body = self._data, self._body
        R = data.xmat[body].reshape(3, 3)
        at = R @ self._rear
        if self._plug.hung is not None:
            self._hang(self._plug.hung, data.xpos[body] + at)
        force = self._weight
        if self.caught is not None:
            force = force + self.caught.pull(data.xpos[body] + at)
        torque = _cross(at, force)
        socket = self._socket
        self._rubs[:] = 0.0
        if socket is not None and self.depth > socket.mates:
            axis = self.T_world_socket[:3, 2]
            kind = mujoco.mjtObj.mjOBJ_BODY
            mujoco.mj_objectVelocity(self._model, data, kind, body, self._velocity, 0)
            speed = float(axis @ self._velocity[3:])
            self._rubs[:] = -axis * socket.mated * np.tanh(speed / RUBS)
            force = force + self._rubs
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = torque

    def _hang(self, cable: CableSpec, end: Vector3) -> None:
        """The pull of a cable whose end has moved; it is a curve, not worth it every step."""
        if float(np.abs(end - self._hung_at).max()) > MOVED:
            self._hung_at, self._weight = end.copy(), cable_pull(cable, end)

    def swing(self, now: float) -> None:
        """The cable that is seen moves on to a time [s]; nothing where there is none."""
        swinging = self._swinging
        if swinging is None:
            return
        swinging.follow(self.cable_end, now)
        place, rows = swinging.place, self._pieces
        way = np.diff(place, axis=0)
        # The quaternion that turns z there by the shortest way.
        turn = np.column_stack(
            [np.linalg.norm(way, axis=1) + way[:, 2], -way[:, 1], way[:, 0], np.zeros(PIECES)]
        )
        turn[turn[:, 0] < 1e-9, 1] = 1.0
        self._data.mocap_pos[rows] = 0.5 * (place[1:] + place[:-1])
        self._data.mocap_quat[rows] = turn / np.linalg.norm(turn, axis=1, keepdims=True)

    def drawn(self) -> tuple[MovingSolid, ...]:
        """The pieces of its cable, for drawing; none where there is none."""
        cable = self._plug.hung
        if cable is None:
            return ()
        size = (cable.radius, cable.length / PIECES, 0.0)
        rotation, drawn = np.empty(9), []
        for k, row in enumerate(self._pieces):
            mujoco.mju_quat2Mat(rotation, self._data.mocap_quat[row])
            T = make_pose(rotation.reshape(3, 3), self._data.mocap_pos[row])
            solid = Solid(f"cable/{k}", "cylinder", size, np.eye(4), color=BLACK)
            drawn.append(MovingSolid(solid.name, solid, T))
        return tuple(drawn)

    @property
    def cable_points(self) -> Points | None:
        """(k, 3) points of the cable that is seen, in world [m]; None where there is none."""
        return None if self._swinging is None else self._swinging.place.copy()

    @property
    def cable_end(self) -> Vector3:
        """(3,) where the cable leaves the plug, in world [m]."""
        R = self._data.xmat[self._body].reshape(3, 3)
        return np.asarray(self._data.xpos[self._body] + R @ self._rear)

    @property
    def T_world_socket(self) -> Pose:
        """Where the socket truly is."""
        assert self._at >= 0
        return make_pose(self._data.xmat[self._at].reshape(3, 3), self._data.xpos[self._at])

    @property
    def T_socket_plug(self) -> Pose:
        """Where the plug truly is in the socket's frame."""
        T = make_pose(self._data.xmat[self._body].reshape(3, 3), self._data.xpos[self._body])
        return np.asarray(inverse(self.T_world_socket) @ T)

    @property
    def depth(self) -> float:
        """Of the plug's front below the socket's face [m]; far away it says little."""
        T = self.T_world_socket
        away = T[:3, :2].T @ (self._data.xpos[self._body] - T[:3, 3])
        if float(np.hypot(*away)) > 0.05:
            return -np.inf
        return float(-T[:3, 2] @ (self._data.xpos[self._body] - T[:3, 3]))

    def wrench(self) -> Floats:
        """(6,) of the socket on the plug [N], [N m], about the plug's origin, in world's axes.

        What the mated contacts rub with is in it.
        """
        data, total = self._data, np.concatenate([self._rubs, np.zeros(3)])
        origin = data.xpos[self._body]
        bodies = self._model.geom_bodyid[data.contact.geom]
        for i in np.flatnonzero((bodies == self._body).any(axis=1)):
            contact = data.contact[i]
            mujoco.mj_contactForce(self._model, data, i, self._contact)
            sign = 1.0 if bodies[i, 1] == self._body else -1.0
            force = sign * contact.frame.reshape(3, 3).T @ self._contact[:3]
            total[:3] += force
            total[3:] += _cross(contact.pos - origin, force)
        return total


def _cross(a: Vector3, b: Vector3) -> Vector3:
    """Numpy's takes twenty times as long."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
