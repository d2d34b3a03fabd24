"""The gripper's fingers: they slide, push with a limited force, and hold by friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.robots.robot import Robot
from armsight.simulation import looks
from armsight.simulation.gl import mujoco
from armsight.simulation.hulls import load_mesh
from armsight.simulation.model_parts import ARM, LIES, OTHER, SEEN, Builder, Part, set_inertia
from armsight.simulation.spec import GripperSpec

FINGERTIPS = {"gripper": "gripper_2"}
"""By tool: the mesh of its fingertips, one on either side of the tool's x-z plane."""
PAD = (0.006, 0.006, 0.02)
"""Half edges of the pads of a tool whose fingertips are not known [m]."""
MASS = 0.06
"""Of a finger [kg]."""
STIFFNESS, DAMPING = 8000.0, 250.0
"""Of a finger's drive [N/m], [N s/m]."""
FRICTION = [1.1, 0.02, 0.0002]
"""Rubber."""
SIDES = (("left", 1.0), ("right", -1.0))


def add_fingers(builder: Builder, body: Any, robot: Robot, gripper: GripperSpec) -> tuple[str, ...]:
    """Two fingers that slide along the tool's y; stems of the meshes that they are made of.

    Their joints are 0 where the gripper is open and grow as it closes, each by half of it.
    """
    tool = robot.tool
    assert tool is not None
    part = Part("arm", robot.name, robot.link_names[robot.n], robot.n)
    tip = tool.T_flange_tcp[:3, 3]
    stem = FINGERTIPS.get(tool.name, "")
    mesh = next((m for m in tool.meshes if m.path.stem == stem), None)
    for side, sign in SIDES:
        finger = body.add_body(name=f"finger/{side}", gravcomp=1.0)
        set_inertia(finger, MASS, tip, np.eye(3) * MASS * 0.02**2)
        finger.add_joint(
            name=f"finger/{side}",
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0.0, -sign, 0.0],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=[0.0, 0.5 * gripper.opening],
        )
        touching: dict[str, Any] = {
            "contype": ARM,
            "conaffinity": OTHER | LIES,
            "friction": FRICTION,
            "condim": 4,
            "priority": 2,
            "solref": [0.004, 1.0],
            "solimp": [0.98, 0.98, 0.001, 0.5, 2.0],
        }
        if mesh is None:
            center = tip + np.array([0.0, sign * (0.5 * gripper.opening + PAD[1]), -PAD[2]])
            builder.geom(
                finger,
                part,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=PAD,
                pos=center,
                material=looks.arm_material(builder.mj, (0.1, 0.1, 0.1)),
                group=SEEN,
                **touching,
            )
            continue
        vertices: Floats = load_mesh(mesh.path).vertices
        half = vertices[sign * vertices[:, 1] > 0.0]
        name = f"finger/{side}"
        builder.mj.add_mesh(name=name, uservert=half.ravel())
        builder.geom(
            finger,
            part,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=looks.arm_material(builder.mj, mesh.color),
            group=SEEN,
            **touching,
        )
    return (stem,) if mesh is not None else ()


def add_finger_servos(mj: Any, gripper: GripperSpec) -> None:
    """A drive a finger, and what makes them move alike."""
    for side, _ in SIDES:
        servo = mj.add_actuator(
            name=f"finger/{side}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=f"finger/{side}",
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            forcerange=[-gripper.force, gripper.force],
        )
        servo.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        servo.gainprm[0] = STIFFNESS
        servo.biasprm[1], servo.biasprm[2] = -STIFFNESS, -DAMPING
    alike = mj.add_equality(name="fingers", type=mujoco.mjtEq.mjEQ_JOINT)
    alike.objtype = mujoco.mjtObj.mjOBJ_JOINT
    alike.name1, alike.name2 = "finger/left", "finger/right"
    alike.data[1] = 1.0


def finger_places(model: Any) -> tuple[int, int]:
    """Where the left finger's joint lies in ``qpos``, and its input in ``ctrl``."""
    joint = model.joint("finger/left").id
    return int(model.jnt_qposadr[joint]), int(model.actuator("finger/left").id)
