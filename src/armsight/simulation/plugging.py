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
from armsight.geometry.pose import make_pose
from armsight.robots.robot import Capsules, Robot
from armsight.simulation.gl import mujoco
from armsight.simulation.lid import Lid, add_lid
from armsight.simulation.model import add_servos, set_servo_gains
from armsight.simulation.model_arm import add_arm
from armsight.simulation.model_parts import Builder, Part
from armsight.simulation.plugs import BODY, Plugged, add_plug, add_sleeve, add_socket
from armsight.simulation.spec import LidSpec, PlugSpec, SocketSpec

STEP = 0.001
"""[s]"""


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
        center: (3,) centre of mass in the plug's frame [m].
        lid: what stands there instead of the socket, or None.
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
    center: tuple[float, float, float] = (0.0, 0.0, -0.06)
    lid: LidSpec | None = None

    @property
    def plug(self) -> PlugSpec:
        """The plug as the model has it."""
        return PlugSpec(
            self.capsules, self.radius, self.stiffness, self.cable, friction=self.friction
        )

    @property
    def socket(self) -> SocketSpec:
        """The socket likewise."""
        return SocketSpec(
            "socket",
            self.T_world_port,
            self.boxes,
            self.half,
            friction=self.friction,
            mated=self.contacts,
        )


class PlugBench:
    """Steps the physics; what a controller may know is joints and wrench, the rest is scoring.

    Attributes:
        time: [s].
        lid: the truth about it, or None.
    """

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
        lid = setup.lid
        self.lid = None if lid is None else Lid(self._model, self._data, lid)
        socket = setup.socket if lid is None else None
        self._plugged = Plugged(self._model, self._data, setup.plug, socket)
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
        self._plugged.push()
        if self.lid is not None:
            self.lid.push()
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

    def force(self) -> float:
        """Of whatever touches the plug, the truth [N]."""
        return float(np.linalg.norm(self._plugged.wrench()[:3]))

    def T_world_plug(self) -> Pose:
        """The truth."""
        body = self._data.body(BODY)
        return make_pose(body.xmat.reshape(3, 3), body.xpos)

    def truth(self) -> tuple[Pose, Floats]:
        """``T_port_plug`` and the (6,) force and torque of the socket on the plug, port's axes."""
        R = self.setup.T_world_port[:3, :3]
        total = self._plugged.wrench()
        wrench = np.concatenate([R.T @ total[:3], R.T @ total[3:]])
        return self._plugged.T_socket_plug, wrench

    def penetration(self) -> float:
        """Deepest overlap of plug and socket [m]."""
        return max((-float(c.dist) for c in self._data.contact), default=0.0)

    def _sensed(self) -> Floats:
        at = self._force
        return np.asarray(-self._data.sensordata[at : at + 6])  # MuJoCo tells the reaction


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
    builder = Builder(mj)
    add_arm(builder, bare, np.eye(4), robot.T_link_joint, sensing=True)
    add_servos(mj, robot)
    plug = add_plug(
        mj.body("arm/flange"), setup.plug, setup.T_flange_plug, setup.mass, np.array(setup.center)
    )
    add_sleeve(builder, plug, setup.plug, Part("arm", "plug"))
    if setup.lid is None:
        add_socket(builder, setup.socket)
    else:
        add_lid(builder, mj.worldbody, setup.lid)
    model = mj.compile()
    set_servo_gains(model, robot)
    return model
