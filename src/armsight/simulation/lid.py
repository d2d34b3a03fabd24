"""A charging lid on its hinge, with a latch that is pushed or a catch that is pulled open.

Frame ``lid``: middle of its outer surface when it is shut, x right and y up for who looks at the
car, z towards who looks. The hinge is at its left edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.geometry.pose import make_pose, to_wxyz
from armsight.geometry.shapes import Solid
from armsight.simulation.gl import mujoco
from armsight.simulation.model_parts import Builder, Part
from armsight.simulation.plugs import PLUG, SOCKET, SOFT
from armsight.simulation.spec import LidSpec

HALF, THICK = 0.075, 0.008
"""Half the edge of the lid, and its thickness [m]."""
SCOOP, DEEP = 0.045, 0.045
"""The recess beside its free edge, into which a finger fits: width, depth [m]."""
LEAF, HINGE = "lid", "lid/hinge"
IN = float(np.deg2rad(-1.4))
"""A push latch lets go, or catches, when it is pushed in so far [rad]."""
SHUT = float(np.deg2rad(1.5))
POPS = float(np.deg2rad(12.0))
"""It springs open so far [rad]."""
CATCH = float(np.deg2rad(4.0))
"""A spring's catch holds within this of shut [rad]."""
TURN = float(np.deg2rad(40.0))
"""Over this it opens by itself, under it it closes [rad]."""


def add_lid(builder: Builder, body: Any, spec: LidSpec, port: bool = False) -> None:
    """The lid, and the flank about it.

    Args:
        builder: of the model.
        body: that both belong to.
        spec: of the lid.
        port: there is a port behind it; else there is a wall.
    """
    T = spec.T_frame_lid
    car = body.add_body(name="flank", pos=T[:3, 3], quat=to_wxyz(T))
    right = HALF + SCOOP
    for low, high in (
        ((HALF if port else -0.30, -0.20, -0.10), (right, 0.20, -DEEP)),  # behind lid and recess
        ((right, -0.20, -0.10), (0.40, 0.20, 0.0)),
        ((-0.40, -0.20, -0.10), (-HALF - 0.003, 0.20, -0.002)),
    ):
        _box(builder, car, spec, np.array(low), np.array(high), "car")
    if port:
        size = (SCOOP, 2.0 * HALF, 0.01)
        T_floor = make_pose(None, (HALF + 0.5 * SCOOP, 0.0, -DEEP - 0.005))
        floor = Solid("car/recess", "box", size, T_floor, (0.05, 0.05, 0.05), "black_plastic")
        builder.solid(car, floor, T_floor, "undeclared")
    if not spec.there:
        return
    leaf = car.add_body(name=LEAF, pos=(-HALF, 0.0, -0.5 * THICK))
    most = 1.85 if spec.stuck is None else max(spec.stuck, 1e-3)
    leaf.add_joint(
        name=HINGE,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, -1.0, 0.0),  # opens towards who looks
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=(2.0 * IN, most),
        damping=[0.04, 0.0, 0.0],
        frictionloss=0.05,
        solref_limit=[0.004, 1.0],
    )
    half = 0.5 * THICK
    ends = np.array([(0.002, -HALF, -half), (2 * HALF, HALF, half)])
    _box(builder, leaf, spec, ends[0], ends[1], LEAF, spec.mass)
    if port:
        size = (2.0 * HALF - 0.002, 2.0 * HALF, THICK)
        T_seen = make_pose(None, ends.mean(axis=0))
        seen = Solid("car/lid", "box", size, T_seen, spec.color)
        builder.solid(leaf, seen, T_seen, "undeclared")


def _box(
    builder: Builder, body: Any, spec: LidSpec, low: Any, high: Any, name: str, mass: float = 0.0
) -> None:
    builder.geom(
        body,
        Part("static", name),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=0.5 * (low + high),
        size=0.5 * (high - low),
        mass=mass,
        contype=SOCKET,
        conaffinity=PLUG,
        friction=[spec.friction, 0.002, 0.0001],
        **SOFT,
    )


class Lid:
    """What holds and moves the lid besides contact: its latch and the spring of its hinge.

    Args:
        model, data: MuJoCo's; spec: of the lid.
    """

    def __init__(self, model: Any, data: Any, spec: LidSpec) -> None:
        self._data, self._spec = data, spec
        joint = model.joint(HINGE) if spec.there else None
        self._q = -1 if joint is None else int(joint.qposadr[0])
        self._v = -1 if joint is None else int(joint.dofadr[0])
        self.reset()

    @property
    def angle(self) -> float:
        """How far it is open [rad]; NaN where there is none."""
        return float(self._data.qpos[self._q]) if self._q >= 0 else float("nan")

    @property
    def shut(self) -> bool:
        """Whether it is shut and held so."""
        held = self._latched or self._spec.latch == "spring"
        return self._q >= 0 and self.angle < SHUT and held

    @property
    def latch(self) -> tuple[bool, bool]:
        """Whether a push latch holds, and whether the next push toggles it."""
        return self._latched, self._armed

    @latch.setter
    def latch(self, state: tuple[bool, bool]) -> None:
        self._latched, self._armed = state

    def reset(self) -> None:
        """Shut, and held."""
        self.latch = (True, True)

    def push(self) -> None:
        """Write the torque for the next step."""
        if self._q >= 0:
            work = self._pushed if self._spec.latch == "push" else self._caught
            self._data.qfrc_applied[self._v] = work(self.angle)

    def _pushed(self, a: float) -> float:
        """Held by a hook that each push toggles; a spring lifts it when the hook is off."""
        stiff = self._spec.holds * 2.0 * HALF / -IN
        if a < IN and self._armed:
            self._latched, self._armed = not self._latched, False
        self._armed = self._armed or a > 0.5 * IN
        if a < 0.0:
            return -stiff * a
        if self._latched and a < 3.0 * SHUT:
            return -3.0 * stiff * a
        self._latched = False
        lift = 0.6 if a < POPS else 0.0
        return lift + _over(a)

    def _caught(self, a: float) -> float:
        """A catch at the edge; the hinge's spring holds it shut or open."""
        most = self._spec.holds * 2.0 * HALF
        if a < 0.0:
            return -200.0 * a
        catch = -most * np.sin(np.pi * a / CATCH) if a < CATCH else 0.0
        return float(catch) + _over(a)


def _over(a: float) -> float:
    """The hinge's spring: shut below, open above [N m]."""
    return float(0.25 * np.tanh((a - TURN) / 0.15)) if a > CATCH else 0.0
