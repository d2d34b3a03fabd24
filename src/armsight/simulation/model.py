"""Builds the MuJoCo model of a cell from its :class:`WorldSpec`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Poses
from armsight.robots.robot import Robot
from armsight.simulation import looks
from armsight.simulation.board import BoardUnit
from armsight.simulation.finger import add_actuator
from armsight.simulation.gl import mujoco
from armsight.simulation.lid import add_lid
from armsight.simulation.model_arm import add_arm, add_standing_arm
from armsight.simulation.model_fingers import add_finger_servos, finger_places
from armsight.simulation.model_movers import LedBodies, Movers
from armsight.simulation.model_parts import MATERIALS, Builder, Part
from armsight.simulation.people import PersonBody
from armsight.simulation.plugs import SOCKET_BODY, add_cable, add_socket
from armsight.simulation.spec import WorldSpec

SERVO_BANDWIDTH = 120.0
"""[rad/s] of the position loop; the arm then follows its reference within a milliradian."""
ROTOR = (0.1, 0.3)
"""Inertia of a motor seen through its gear: a constant [kg m^2] and a share of the joint's
(assumption; a hundredfold gear makes rotors weigh about as much as the links)."""


@dataclass(frozen=True)
class CellModel:
    """The compiled model and where things are in it.

    Attributes:
        model: MuJoCo's model.
        parts: one a geom.
        link_bodies: (n + 1,) body of each link.
        person_bodies: mocap index of the first part of each person.
        movers: everything that moves besides the arm.
        materials: code of each geom's material, its place in :data:`MATERIALS`.
        greatest_load: torque that the arm's weight asks of a joint [N m].
        wrench: places in ``sensordata`` of the flange's force and torque, or None.
        fingers: joints of the gripper's fingers in ``qpos`` and inputs in ``ctrl``, or None.
        socket: mocap index of a car with its socket, -1 without one.
    """

    model: Any
    parts: tuple[Part, ...]
    link_bodies: Ints
    person_bodies: tuple[int, ...]
    movers: LedBodies
    materials: Bytes
    greatest_load: float
    wrench: tuple[int, int] | None = None
    fingers: tuple[int, int] | None = None
    socket: int = -1


def build_model(
    spec: WorldSpec,
    people: Sequence[PersonBody],
    T_link_joint_true: Poses,
    board: BoardUnit | None = None,
) -> CellModel:
    """Compile the cell.

    Args:
        spec: of the cell.
        people: bodies of ``spec.people``, in order.
        T_link_joint_true: (n, 4, 4) the arm's true geometry.
        board: a calibration board as it truly hangs.
    """
    mj = mujoco.MjSpec()
    mj.modelname = "cell"
    mj.compiler.degree = False
    mj.compiler.autolimits = True
    mj.option.timestep = spec.time_step
    mj.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    mj.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    mj.option.impratio = 10.0
    looks.set_up(mj)
    builder = Builder(mj)
    if spec.floor:
        builder.floor()
    for solid in spec.static:
        builder.solid(mj.worldbody, solid, solid.T_frame_solid, "static")
    for solid in spec.undeclared:
        builder.solid(mj.worldbody, solid, solid.T_frame_solid, "undeclared")
    for standing in spec.arms:
        add_standing_arm(builder, standing)
    fingers = spec.pushes and spec.gripper is not None and spec.plug is None
    lid_finger = None if spec.plug is None else spec.plug.finger
    link_names = add_arm(
        builder,
        spec.arm.robot,
        spec.arm.T_world_base,
        T_link_joint_true,
        spec.wrench is not None or fingers or spec.plug is not None,
        board,
        spec.gripper if fingers else None,
        spec.plug,
        spec.pushes,
    )
    if spec.plug is not None and spec.plug.hung is not None:
        add_cable(builder, spec.plug.hung)
    if spec.socket is not None:
        body = add_socket(builder, spec.socket)
        if spec.socket.lid is not None:
            add_lid(builder, body, spec.socket.lid, port=True)
    movers = Movers(builder, spec.pushes)
    people_first = tuple(movers.add_person(person) for person in people)
    for item in spec.objects:
        movers.add_object(item)
    add_servos(mj, spec.arm.robot)
    if fingers and spec.gripper is not None:
        add_finger_servos(mj, spec.gripper)
    if lid_finger is not None:
        add_actuator(mj, lid_finger)
    if spec.floor:
        builder.far_floor()
    model = mj.compile()
    load = set_servo_gains(model, spec.arm.robot)
    parts = tuple(builder.parts[model.geom(i).name] for i in range(model.ngeom))
    materials = np.array([MATERIALS.index(part.material) for part in parts], np.uint8)
    return CellModel(
        model,
        parts,
        np.array([model.body(name).id for name in link_names]),
        tuple(int(model.body(name).mocapid[0]) for name in people_first),
        movers.led(model),
        materials,
        load,
        None
        if spec.wrench is None
        else (int(model.sensor("flange/force").adr[0]), int(model.sensor("flange/torque").adr[0])),
        finger_places(model) if fingers else None,
        -1 if spec.socket is None else int(model.body(SOCKET_BODY).mocapid[0]),
    )


def add_servos(mj: Any, robot: Robot) -> None:
    """A position servo a joint, then a velocity servo a joint; gains follow the inertia."""
    for kind in ("position", "velocity"):
        for name in robot.joint_names:
            servo = mj.add_actuator(
                name=f"{kind}/{name}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"arm/{name}"
            )
            servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE


def set_servo_gains(model: Any, robot: Robot) -> float:
    """Gains and greatest torques of an arm's servos; returns the greatest load of its weight [N m].

    The arm's joints are the model's first.
    """
    n = robot.n
    inertia, load = _greatest_inertia(model, robot)
    model.dof_armature[:n] = ROTOR[0] + ROTOR[1] * inertia
    mujoco.mj_setConst(model, mujoco.MjData(model))
    inertia = inertia + model.dof_armature[:n]
    kp = inertia * SERVO_BANDWIDTH**2
    # what the URDF says of the drives, but no less than their accelerations ask for
    limits = robot.limits
    torque = 3.0 * inertia * limits.acceleration + 5.0
    if limits.effort is not None:
        torque = np.fmax(torque, limits.effort)
    model.actuator_gainprm[:n, 0] = kp
    model.actuator_biasprm[:n, 1] = -kp
    kv = 2.0 * kp / SERVO_BANDWIDTH
    model.actuator_gainprm[n : 2 * n, 0] = kv
    model.actuator_biasprm[n : 2 * n, 2] = -kv
    model.jnt_actfrcrange[:n] = np.stack([-torque, torque], axis=1)
    model.jnt_actfrclimited[:n] = True
    return load


def _greatest_inertia(model: Any, robot: Robot) -> tuple[Floats, float]:
    """Greatest inertia of each joint [kg m^2] and greatest load [N m] over random poses."""
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    n = robot.n
    inertia, load = np.zeros(n), 0.0
    full = np.zeros((model.nv, model.nv))
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    for _ in range(64):
        data.qpos[:n] = rng.uniform(lower, upper)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        inertia = np.maximum(inertia, np.diag(full)[:n])
        load = max(load, float(np.abs(data.qfrc_gravcomp[:n]).max()))
    return inertia, load
