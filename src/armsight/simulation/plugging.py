"""An arm with a plug in a compliant mount before a socket: contact physics alone, no pictures.

Sleeve and cavity are capsules and boxes (their makers say where), the mount is six springs, the
wrench is sensed between flange and mount, and the drives follow what was commanded a delay ago.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.geometry.pose import inverse, to_wxyz
from armsight.robots.robot import Capsules, Robot
from armsight.simulation.gl import mujoco
from armsight.simulation.model import add_servos, set_servo_gains
from armsight.simulation.model_arm import add_arm
from armsight.simulation.model_parts import Builder

STEP = 0.001
"""[s] At 2 ms the plug sinks into the wall by 0.1 mm, a quarter of the clearance."""
SOFT: dict[str, Any] = {
    "solref": [0.002, 1.0],
    "solimp": [0.95, 0.99, 0.0005, 0.5, 2.0],
    "condim": 4,
    "margin": 0.0,
}
SOCKET, PLUG = 4, 8  # contact bits


@dataclass(frozen=True)
class PlugSetup:
    """What is built; poses in the arm's base, which is the world.

    Attributes:
        T_world_port: the socket, its mouth at z = 0, z towards who looks.
        T_flange_plug: where the mount holds the plug when nothing presses; the plug's z looks out
            of its mouth.
        boxes, half: of the socket; capsules, radius: of the plug; each in its own frame.
        stiffness: of the mount along and about the plug's axes [N/m], [N m/rad].
        mass: of the plug [kg]; cable: what hangs on it [N].
        friction: between sleeve and wall; contacts: friction of the seated contacts [N].
        delay: from a command to the drives [s].
        noise: of force and torque [N], [N m]; bias: (6,) that the sensor adds.
    """

    T_world_port: Pose
    T_flange_plug: Pose
    boxes: Floats
    half: Floats
    capsules: Floats
    radius: float
    stiffness: tuple[float, float] = (5000.0, 30.0)
    mass: float = 1.6
    cable: float = 15.0
    friction: float = 0.25
    contacts: float = 25.0
    delay: float = 0.06
    noise: tuple[float, float] = (0.5, 0.02)
    bias: tuple[float, ...] = (0.0,) * 6


class PlugBench:
    """Steps the physics; what a controller may know is joints and wrench, the rest is scoring."""

    def __init__(self, robot: Robot, setup: PlugSetup, q: JointVector, seed: int = 0) -> None:
        self.setup = setup
        self.n = robot.n
        self._model = _build(robot, setup)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[: self.n] = q
        self._data.ctrl[: self.n] = q
        self._rng = np.random.default_rng(seed)
        self._waiting: deque[JointVector] = deque([q.copy()] * max(1, round(setup.delay / STEP)))
        self._reference = q.copy()
        self._rate = np.zeros(self.n)
        self._plug = self._model.body("plug").id
        self._force = int(self._model.sensor("flange/force").adr[0])
        self._low_pass = 1.0 - np.exp(-2.0 * np.pi * 100.0 * STEP)
        mujoco.mj_forward(self._model, self._data)
        self._filtered = self._sensed()
        self.time = 0.0

    def place(self, q: JointVector) -> None:
        """Put the arm elsewhere, at rest."""
        self._data.qpos[: self.n] = q
        self._data.qvel[:] = 0.0
        self._data.ctrl[: self.n] = q
        self._reference = q.copy()
        self._waiting = deque([q.copy()] * len(self._waiting))
        mujoco.mj_forward(self._model, self._data)
        self._filtered = self._sensed()

    def command(self, rate: JointVector) -> None:
        """Joint velocities [rad/s] from now on, to the drives after the delay."""
        self._rate = np.asarray(rate, float).copy()

    def step(self) -> None:
        """One millisecond."""
        self._reference = self._reference + STEP * self._rate
        self._waiting.append(self._reference.copy())
        old = self._data.ctrl[: self.n].copy()
        new = self._waiting.popleft()
        self._data.ctrl[: self.n] = new
        self._data.ctrl[self.n : 2 * self.n] = (new - old) / STEP
        self._hang()
        mujoco.mj_step(self._model, self._data)
        self._filtered = self._filtered + self._low_pass * (self._sensed() - self._filtered)
        self.time += STEP

    @property
    def q(self) -> JointVector:
        """(n,) joints as measured [rad]."""
        return np.asarray(self._data.qpos[: self.n].copy())

    def wrench(self) -> Floats:
        """(6,) force [N] and torque [N m] of what the flange carries on it, about its origin.

        In the flange's frame; filtered, biased and noisy.
        """
        noise = self._rng.standard_normal(6) * np.repeat(self.setup.noise, 3)
        return np.asarray(self._filtered + np.asarray(self.setup.bias) + noise)

    def truth(self) -> tuple[Pose, Floats]:
        """``T_port_plug`` and the (6,) force and torque of the socket on the plug, port's axes."""
        T = np.eye(4)
        T[:3, :3] = self._data.xmat[self._plug].reshape(3, 3)
        T[:3, 3] = self._data.xpos[self._plug]
        inside = inverse(self.setup.T_world_port) @ T
        total = np.zeros(6)
        one = np.zeros(6)
        for i in range(self._data.ncon):
            contact = self._data.contact[i]
            mujoco.mj_contactForce(self._model, self._data, i, one)
            R = contact.frame.reshape(3, 3).T
            sign = 1.0 if self._model.geom_bodyid[contact.geom2] == self._plug else -1.0
            force = sign * R @ one[:3]
            total[:3] += force
            total[3:] += np.cross(contact.pos - T[:3, 3], force)
        R_port = self.setup.T_world_port[:3, :3]
        return inside, np.concatenate([R_port.T @ total[:3], R_port.T @ total[3:]])

    def penetration(self) -> float:
        """Deepest overlap of plug and socket [m]."""
        return max((-float(c.dist) for c in self._data.contact), default=0.0)

    def _sensed(self) -> Floats:
        at = self._force
        return np.asarray(-self._data.sensordata[at : at + 6])  # MuJoCo tells the reaction

    def _hang(self) -> None:
        """The cable's weight at the plug's rear, and the friction of contacts that are mated."""
        data, body = self._data, self._plug
        R = data.xmat[body].reshape(3, 3)
        weight = np.array([0.0, 0.0, -self.setup.cable])
        rear = R @ np.array([0.0, -0.02, -0.12])
        force, torque = weight.copy(), np.cross(rear, weight)
        inside = inverse(self.setup.T_world_port)
        tip = inside[:3, :3] @ data.xpos[body] + inside[:3, 3]
        if -tip[2] > 0.012:
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            axis = self.setup.T_world_port[:3, 2]
            force -= axis * self.setup.contacts * np.tanh(float(axis @ velocity[3:]) / 0.002)
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = torque


def _build(robot: Robot, setup: PlugSetup) -> Any:
    mj = mujoco.MjSpec()
    mj.compiler.degree = False
    mj.compiler.autolimits = True
    mj.option.timestep = STEP
    mj.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    mj.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    mj.option.impratio = 10.0
    none = Capsules(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    bare = replace(robot, meshes=(), capsules=none, tool=None)
    add_arm(Builder(mj), bare, np.eye(4), robot.T_link_joint, sensing=True)
    add_servos(mj, robot)
    _add_plug(mj.body("arm/flange"), setup)
    T = setup.T_world_port
    socket = mj.worldbody.add_body(name="socket", pos=T[:3, 3], quat=to_wxyz(T))
    for pose, half in zip(setup.boxes, setup.half):
        socket.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=half,
            pos=pose[:3, 3],
            quat=to_wxyz(pose),
            contype=SOCKET,
            conaffinity=PLUG,
            friction=[setup.friction, 0.002, 0.0001],
            **SOFT,
        )
    model = mj.compile()
    set_servo_gains(model, robot)
    return model


def _add_plug(flange: Any, setup: PlugSetup) -> None:
    """The plug on six springs: the mount is compliant, or nothing would ever seat."""
    T = setup.T_flange_plug
    plug = flange.add_body(name="plug", pos=T[:3, 3], quat=to_wxyz(T))
    along, about = setup.stiffness
    inertia = np.array([0.006, 0.006, 0.002]) * setup.mass / 1.6
    for kind, k, m in (
        (mujoco.mjtJoint.mjJNT_SLIDE, along, np.repeat(setup.mass, 3)),
        (mujoco.mjtJoint.mjJNT_HINGE, about, inertia + 0.01),
    ):
        for i in range(3):
            axis = np.eye(3)[i]
            joint = plug.add_joint(name=f"mount/{kind}/{i}", type=kind, axis=axis, limited=False)
            # MuJoCo's springs and dampers are polynomials
            joint.stiffness = [k, 0.0, 0.0]
            joint.damping = [2.0 * 0.4 * float(np.sqrt(k * m[i])), 0.0, 0.0]
    plug.mass = setup.mass
    plug.ipos = [0.0, 0.0, -0.06]
    plug.inertia = inertia
    plug.explicitinertial = True
    for ends in setup.capsules:
        plug.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[setup.radius, 0, 0],
            fromto=ends,
            contype=PLUG,
            conaffinity=SOCKET,
            friction=[setup.friction, 0.002, 0.0001],
            density=0.0,
            **SOFT,
        )
