"""A tool's tip that floats in its holder on springs: a body of its own on three slides.

The same law as :mod:`armsight.robots.sprung_tip`, the same to every side, with what a step of time
asks for: the seat gives way by a little, the stop is not endlessly stiff, and the slides damp.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.robots.robot import LinkMesh, Tool
from armsight.robots.sprung_tip import SprungTip
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import load_mesh
from armsight.simulation.model_parts import set_inertia

SHARE, LIGHT, AT = 0.2, 0.05, 2.0 / 3.0
"""What floats weighs this share of the tool, and no more than so much [kg]; its middle lies this
far from the flange to the tip."""
HOLDER = 0.005
"""A mesh that begins nearer to the flange than this is the holder, which stays [m]."""
SEATED = 5e-5
"""What the seat's whole force moves the tip by [m]."""
STOP = 3e4
"""Stiffness of the stop [N/m]: with 50 g before it what steps of 2 ms resolve."""
DAMPING = 1.5
"""Of each slide [N s/m]: a fifth of what would keep a tip of 50 g on 0.3 N/mm from ringing."""
BODY, SLIDES = "arm/tip", tuple(f"arm/tip/{axis}" for axis in "xyz")


def add_floating(flange: Any, tool: Tool) -> tuple[Any, float, np.ndarray]:
    """The body that floats, in the flange's frame; mass [kg] and centre (3,) [m] of what does not.

    Args:
        flange: body of what hangs on the force sensor.
        tool: with a tip that gives way.
    """
    body = flange.add_body(name=BODY, gravcomp=1.0)
    for name, axis in zip(SLIDES, np.eye(3)):
        slide = body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
        )
        slide.damping = [DAMPING, 0.0, 0.0]
    mass = max(tool.mass, 1e-3)
    light = min(SHARE * mass, LIGHT)
    middle = AT * tool.T_flange_tcp[:3, 3]
    set_inertia(body, light, middle, np.eye(3) * light * 1e-3)
    rest = mass - light
    return body, rest, (mass * tool.center_of_mass - light * middle) / rest


def floats(mesh: LinkMesh) -> bool:
    """Whether a tool's mesh is of what gives way."""
    return float(load_mesh(mesh.path).vertices[:, 2].min()) > HOLDER


def floating(model: Any, data: Any, tool: Tool | None) -> FloatingTip | None:
    """What pushes a tool's tip back in a model that has it as a body of its own, or None."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, SLIDES[0])
    return (
        None
        if tool is None or tool.tip is None or joint < 0
        else FloatingTip(model, data, tool.tip)
    )


class FloatingTip:
    """Pushes the tip back to its seat, step by step.

    Args:
        model, data: MuJoCo's; tip: the spring.
    """

    def __init__(self, model: Any, data: Any, tip: SprungTip) -> None:
        self.tip, self._data = tip, data
        joints = [model.joint(name) for name in SLIDES]
        self._q = np.array([int(joint.qposadr[0]) for joint in joints])
        self._v = np.array([int(joint.dofadr[0]) for joint in joints])

    @property
    def place(self) -> np.ndarray:
        """(3,) how far it is out of its seat, in the flange's frame [m]."""
        return np.array(self._data.qpos[self._q])

    def push(self) -> None:
        """Once a step."""
        place, tip = self.place, self.tip
        away = float(np.linalg.norm(place))
        force = tip.seat * min(away / SEATED, 1.0)
        force += tip.stiffness * away + STOP * max(away - tip.travel, 0.0)
        self._data.qfrc_applied[self._v] = -force * place / max(away, 1e-12)
