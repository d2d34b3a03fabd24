"""A rod beside the plug, with a pin across its tip, that a linear actuator puts out: for lids."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.geometry.pose import make_pose, to_wxyz
from armsight.simulation import looks
from armsight.simulation.gl import mujoco
from armsight.simulation.model_parts import SEEN, Builder, Part, set_inertia
from armsight.simulation.plugs import BODY, PLUG, SOCKET, SOFT
from armsight.simulation.spec import FingerSpec

NAME = "lid finger"
STIFFNESS, DAMPING = 6e4, 300.0
"""Of the actuator [N/m], [N s/m]: it gives way by less than a millimetre to what works a latch."""


def add_finger(builder: Builder, part: Part, spec: FingerSpec, friction: float) -> None:
    """The rod in the plug's body; its joint is 0 where it is drawn back, and grows as it comes out.

    Args:
        builder: of a model that has a plug.
        part: what it belongs to.
        spec: of the finger.
        friction: of its surface.
    """
    mj = builder.mj
    T = spec.T_plug_tip @ make_pose(None, (0.0, 0.0, -spec.stroke))
    rod = mj.body(BODY).add_body(name=NAME, pos=T[:3, 3], quat=to_wxyz(T), gravcomp=1.0)
    set_inertia(rod, spec.mass, np.array([0, 0, -0.5 * spec.length]), np.eye(3) * 1e-4)
    rod.add_joint(
        name=NAME,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0.0, 0.0, 1.0],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[0.0, spec.stroke],
    )
    steel = looks.arm_material(mj, (0.55, 0.56, 0.58))
    for ends in ((0, 0, -spec.length, 0, 0, 0), (0, 0, 0, spec.pin, 0, 0)):
        shape: dict[str, Any] = {
            "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
            "size": [spec.radius, 0, 0],
            "fromto": np.array(ends, float),
        }
        touching = {"contype": PLUG, "conaffinity": SOCKET, "friction": [friction, 0.002, 0.0001]}
        builder.geom(rod, part, **shape, **touching, **SOFT)
        builder.geom(rod, part, **shape, material=steel, contype=0, conaffinity=0, group=SEEN)


def add_actuator(mj: Any, spec: FingerSpec) -> None:
    """What puts it out; to be added after the arm's servos."""
    servo = mj.add_actuator(
        name=NAME,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=NAME,
        forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        forcerange=[-spec.force, spec.force],
    )
    servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.gainprm[0] = STIFFNESS
    servo.biasprm[1], servo.biasprm[2] = -STIFFNESS, -DAMPING


class Finger:
    """Moves the rod as the cell's gripper says: what that has open, the rod is drawn back.

    Args:
        model, data: MuJoCo's; spec: of the finger.
    """

    def __init__(self, model: Any, data: Any, spec: FingerSpec) -> None:
        self._data, self._spec = data, spec
        joint = model.joint(NAME)
        self._q, self._v = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._input = int(model.actuator(NAME).id)

    def push(self, drawn_back: float) -> None:
        """Write what the actuator wants for the next step: how far it shall be drawn back [m]."""
        self._data.ctrl[self._input] = self._spec.stroke - drawn_back

    @property
    def out(self) -> tuple[float, float]:
        """How far it is out [m], and its speed [m/s]."""
        return float(self._data.qpos[self._q]), float(self._data.qvel[self._v])
