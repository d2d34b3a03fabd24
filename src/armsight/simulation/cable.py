"""A plug's cable between plug and hanger: what it pulls with, as a chain and as a curve.

The chain bends: links of equal length on ball joints that resist bending, in contact physics, two
dozen bodies. The curve is the catenary of the same length and weight, which needs none, for the
many trials. With 0.05 N m^2 both pull alike within 0.8 N (the test beside it measures it); a cable
that resists bending more pulls more upwards and less aside than its curve.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Floats, Points, Vector3
from armsight.robots.cable_kernels import GRAVITY, PLUMB, TAUT, catenary, hang
from armsight.simulation.gl import mujoco
from armsight.simulation.spec import CableSpec

LEADER = 1e6
"""As heavy as this the end of a chain is, that what hangs on it does not move it [kg]."""


def cable_pull(spec: CableSpec, end: Vector3) -> Vector3:
    """(3,) force [N] in world with which a cable pulls at its end at ``end`` (3,) [m].

    The catenary through both ends, see :func:`~armsight.robots.cable_kernels.catenary`; its tension
    along x is w a.
    """
    weight = GRAVITY * spec.mass
    way = np.asarray(spec.hanger) - end
    length = max(spec.length, TAUT * float(np.linalg.norm(way)))
    along, up = float(np.hypot(way[0], way[1])), float(way[2])
    if along < PLUMB:
        return np.array([0.0, 0.0, -0.5 * weight * (length - up)])
    a, lowest = catenary(along, up, length)
    aside, lifted = weight * a, weight * a * float(np.sinh(-lowest / a))
    return np.array([aside * way[0] / along, aside * way[1] / along, lifted])


def cable_points(spec: CableSpec, end: Vector3, count: int) -> Points:
    """(count, 3) points of the curve from the plug's end to the hanger, equally far apart [m]."""
    out = np.empty((count, 3))
    hang(np.asarray(end, float), np.array(spec.hanger, float), spec.length, out)
    return out


class CableChain:
    """The chain by itself, its end held still: what the curve is measured against.

    Args:
        spec: of the cable; end: (3,) where its end is held, in world [m].
        links: of the chain.
    """

    def __init__(self, spec: CableSpec, end: Vector3, links: int = 24) -> None:
        mj = mujoco.MjSpec()
        mj.compiler.degree = False
        mj.option.timestep = 0.001
        mj.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        way = np.asarray(spec.hanger) - end
        length = max(spec.length, TAUT * float(np.linalg.norm(way)))
        piece = length / links
        self._yaw = float(np.arctan2(way[1], way[0]))
        steps = np.diff(cable_points(spec, end, links + 1), axis=0)
        aside = steps @ [np.cos(self._yaw), np.sin(self._yaw), 0.0]
        lean = np.arctan2(aside, steps[:, 2])
        body = mj.worldbody.add_body(pos=end, quat=_about(2, self._yaw), mass=1e-3)
        body.explicitinertial, body.inertia = True, np.full(3, 1e-6)
        for axis in np.eye(3):  # led: what it weighs and is pulled with does not move it
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, armature=LEADER)
        site = body.add_site(name="end")
        mj.worldbody.add_site(name="hanger", pos=spec.hanger)
        turns = np.diff(lean, prepend=0.0)
        for k, turn in enumerate(turns):
            at = (0.0, 0.0, 0.0) if k == 0 else (0.0, 0.0, piece)
            body = body.add_body(name=f"link/{k}", pos=at, quat=_about(1, turn))
            joint = body.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
            joint.stiffness = [0.0 if k == 0 else spec.bending / piece, 0.0, 0.0]
            joint.damping = [0.08, 0.0, 0.0]
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[spec.radius, 0.0, 0.0],
                fromto=(0.0, 0.0, 0.0, 0.0, 0.0, piece),
                mass=spec.mass * piece,
                contype=0,
                conaffinity=0,
            )
        body.add_site(name="last", pos=(0.0, 0.0, piece))
        tie = mj.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT)
        tie.objtype = mujoco.mjtObj.mjOBJ_SITE
        tie.name1, tie.name2 = "last", "hanger"
        mj.add_sensor(
            name="pull",
            type=mujoco.mjtSensor.mjSENS_FORCE,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=site.name,
        )
        self._model: Any = mj.compile()
        for k, turn in enumerate(turns):  # it would be straight if nothing pulled
            self._model.qpos_spring[4 * k + 3 : 4 * k + 7] = _about(1, -turn)
        self._data: Any = mujoco.MjData(self._model)
        self._first = np.asarray(end, float)

    def settle(self, seconds: float) -> Vector3:
        """(3,) force [N] in world with which it pulls at its end once it hangs."""
        c, s = np.cos(self._yaw), np.sin(self._yaw)
        x, y, z = self._data.qpos[:3]
        here = self._first + np.array([c * x - s * y, s * x + c * y, z])
        self.follow(np.tile(here, (round(seconds / self._model.opt.timestep), 1)))
        x, y, z = -self._data.sensordata[:3]
        return np.array([c * x - s * y, s * x + c * y, z])

    def follow(self, ends: Points) -> None:
        """Lead its end over (k, 3) places in world [m], a millisecond each."""
        data, dt = self._data, self._model.opt.timestep
        c, s = np.cos(self._yaw), np.sin(self._yaw)
        for end in ends:
            x, y, z = end - self._first
            way = np.array([c * x + s * y, c * y - s * x, z]) - data.qpos[:3]
            # A force, not a velocity: what was set would carry all of the chain along at once.
            data.qfrc_applied[:3] = LEADER * (way / dt - data.qvel[:3]) / dt
            mujoco.mj_step(self._model, data)

    @property
    def joints(self) -> Points:
        """(links, 3) where its joints are, in world [m]."""
        return np.asarray(self._data.xpos[2:].copy())


def _about(axis: int, angle: float) -> Floats:
    """Quaternion (w, x, y, z) of a turn about an axis by an angle [rad]."""
    out = np.zeros(4)
    out[0], out[1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return out
