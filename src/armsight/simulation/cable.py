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
from armsight.simulation.gl import mujoco
from armsight.simulation.spec import CableSpec

GRAVITY = 9.81
"""[m/s^2]"""
TAUT = 1.0005
"""A cable is at least so much longer than the way: what is shorter would be torn off."""
PLUMB = 1e-3
"""A hanger that is less than this aside hangs straight above [m]."""


def cable_pull(spec: CableSpec, end: Vector3) -> Vector3:
    """(3,) force [N] in world with which a cable pulls at its end at ``end`` (3,) [m].

    The catenary through both ends: sqrt(L^2 - v^2) = 2 a sinh(h / 2 a), tension along x: w a.
    """
    weight = GRAVITY * spec.mass
    way, length, h = _span(spec, end)
    if h < PLUMB:
        return np.array([0.0, 0.0, -0.5 * weight * (length - float(way[2]))])
    a, lowest = _curve(way, length, h)
    aside, up = weight * a, weight * a * float(np.sinh(-lowest / a))
    return np.array([aside * way[0] / h, aside * way[1] / h, up])


def cable_points(spec: CableSpec, end: Vector3, count: int) -> Points:
    """(count, 3) points of the curve from the plug's end to the hanger, equally far apart [m]."""
    way, length, h = _span(spec, end)
    s = np.linspace(0.0, length, count)
    if h < PLUMB:
        down = 0.5 * (length - float(way[2]))
        return np.column_stack([np.zeros((count, 2)), np.abs(s - down) - down]) + end
    a, lowest = _curve(way, length, h)
    x = lowest + a * np.arcsinh(s / a + np.sinh(-lowest / a))
    z = a * (np.cosh((x - lowest) / a) - np.cosh(lowest / a))
    return np.column_stack([x * way[0] / h, x * way[1] / h, z]) + end


def _span(spec: CableSpec, end: Vector3) -> tuple[Vector3, float, float]:
    """Way to the hanger [m], length of the cable, and the way's horizontal part."""
    way = np.asarray(spec.hanger) - end
    length = max(spec.length, TAUT * float(np.linalg.norm(way)))
    return way, length, float(np.hypot(way[0], way[1]))


def _curve(way: Vector3, length: float, h: float) -> tuple[float, float]:
    """The catenary's a, and how far aside of its end its lowest point would be [m]."""
    v = float(way[2])
    a = _parameter(float(np.sqrt(length**2 - v**2)), h)
    return a, 0.5 * h - a * float(np.arctanh(v / length))


def _parameter(span: float, h: float) -> float:
    """The catenary's a [m] of ``span`` = 2 a sinh(h / 2 a), by Newton's method on u = h / 2 a."""
    ratio = span / h
    u = float(np.sqrt(6.0 * (ratio - 1.0))) if ratio < 3.0 else float(np.log(2.0 * ratio) + 1.0)
    for _ in range(30):
        step = (np.sinh(u) - ratio * u) / (np.cosh(u) - ratio)
        u -= float(step)
        if abs(step) < 1e-12:
            break
    return 0.5 * h / u


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
        way, length, _ = _span(spec, end)
        piece = length / links
        self._yaw = float(np.arctan2(way[1], way[0]))
        steps = np.diff(cable_points(spec, end, links + 1), axis=0)
        aside = steps @ [np.cos(self._yaw), np.sin(self._yaw), 0.0]
        lean = np.arctan2(aside, steps[:, 2])
        body = mj.worldbody.add_body(pos=end, quat=_about(2, self._yaw))
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
            self._model.qpos_spring[4 * k : 4 * k + 4] = _about(1, -turn)
        self._data: Any = mujoco.MjData(self._model)

    def settle(self, seconds: float) -> Vector3:
        """(3,) force [N] in world with which it pulls at its end once it hangs."""
        for _ in range(round(seconds / self._model.opt.timestep)):
            mujoco.mj_step(self._model, self._data)
        x, y, z = -self._data.sensordata[:3]
        c, s = np.cos(self._yaw), np.sin(self._yaw)
        return np.array([c * x - s * y, s * x + c * y, z])

    @property
    def joints(self) -> Points:
        """(links, 3) where its joints are, in world [m]."""
        return np.asarray(self._data.xpos[2:].copy())


def _about(axis: int, angle: float) -> Floats:
    """Quaternion (w, x, y, z) of a turn about an axis by an angle [rad]."""
    out = np.zeros(4)
    out[0], out[1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return out
