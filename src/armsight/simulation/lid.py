"""A charging lid on its hinge, with a latch that is pushed or a catch that is pulled open.

Frame ``lid``: middle of its outer surface when it is shut, x right and y up for who looks at the
car, z towards who looks. The hinge is at its left edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from armsight.arrays import Pose
from armsight.geometry.pose import to_wxyz
from armsight.simulation.gl import mujoco
from armsight.simulation.model_parts import Builder, Part
from armsight.simulation.plugs import PLUG, SOCKET, SOFT

Latch = Literal["push", "spring"]
HALF, THICK = 0.075, 0.008
"""Half the edge of the lid, and its thickness [m]."""
SCOOP, DEEP = 0.045, 0.045
"""The recess beside its free edge, into which a finger fits: width, depth [m]."""
LEAF = "lid"
IN = float(np.deg2rad(-1.4))
"""A push latch lets go, or catches, when it is pushed in so far [rad]."""
SHUT = float(np.deg2rad(1.5))
POPS = float(np.deg2rad(12.0))
"""It springs open so far [rad]."""
CATCH = float(np.deg2rad(4.0))
"""A spring's catch holds within this of shut [rad]."""
TURN = float(np.deg2rad(40.0))
"""Over this it opens by itself, under it it closes [rad]."""


@dataclass(frozen=True)
class LidSpec:
    """A lid.

    Attributes:
        T_world_lid: where it is when it is shut.
        latch: how it is held: ``push`` opens and catches when it is pushed in; ``spring`` is
            pulled over its catch.
        holds: force at its free edge that works the latch [N].
        friction: of its surface.
        mass: [kg].
        stuck: it does not open farther than this [rad], or at all at 0; None for one that does.
        there: whether there is one.
    """

    T_world_lid: Pose
    latch: Latch
    holds: float = 25.0
    friction: float = 0.25
    mass: float = 0.25
    stuck: float | None = None
    there: bool = True


def add_lid(builder: Builder, spec: LidSpec) -> None:
    """The lid, and the body of the car about it."""
    T = spec.T_world_lid
    car = builder.mj.worldbody.add_body(name="car", pos=T[:3, 3], quat=to_wxyz(T))
    right = HALF + SCOOP
    for low, high in (
        ((-0.30, -0.20, -0.10), (right, 0.20, -DEEP)),  # behind lid and recess
        ((right, -0.20, -0.10), (0.40, 0.20, 0.0)),
        ((-0.40, -0.20, -0.10), (-HALF - 0.003, 0.20, -0.002)),
    ):
        _box(builder, car, spec, np.array(low), np.array(high), "car")
    if not spec.there:
        return
    leaf = car.add_body(name=LEAF, pos=(-HALF, 0.0, -0.5 * THICK))
    most = 1.85 if spec.stuck is None else max(spec.stuck, 1e-3)
    leaf.add_joint(
        name="lid/hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, -1.0, 0.0),  # opens towards who looks
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=(2.0 * IN, most),
        damping=[0.04, 0.0, 0.0],
        frictionloss=0.05,
        solref_limit=[0.004, 1.0],
    )
    half = 0.5 * THICK
    _box(
        builder, leaf, spec, np.array((0.002, -HALF, -half)), np.array((2 * HALF, HALF, half)),
        "lid", spec.mass,
    )  # fmt: skip


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
        joint = model.joint("lid/hinge") if spec.there else None
        self._q = -1 if joint is None else int(joint.qposadr[0])
        self._v = -1 if joint is None else int(joint.dofadr[0])
        self._latched, self._armed = True, True

    @property
    def angle(self) -> float:
        """How far it is open [rad]; NaN where there is none."""
        return float(self._data.qpos[self._q]) if self._q >= 0 else float("nan")

    @property
    def shut(self) -> bool:
        """Whether it is shut and held so."""
        held = self._latched or self._spec.latch == "spring"
        return self._q >= 0 and self.angle < SHUT and held

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
