from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np

from armsight.robots.catalogue import DATA


def mujoco_model(path: Path) -> mujoco.MjModel:
    """A URDF compiled by MuJoCo, shapes taken out: another reader, another kinematics."""
    root = ET.parse(path).getroot()
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
        if link.find("inertial") is None:
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "mass", value="1e-9")
            ET.SubElement(
                inertial, "inertia", ixx="1e-9", iyy="1e-9", izz="1e-9", ixy="0", ixz="0", iyz="0"
            )
    extension = ET.SubElement(root, "mujoco")
    ET.SubElement(
        extension,
        "compiler",
        fusestatic="false",
        balanceinertia="true",
        boundmass="1e-9",
        boundinertia="1e-12",
    )
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def robot_path(name: str) -> Path:
    return DATA / name / "robot.urdf"


def body_pose(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    """``T_world_body``; the identity for the root, which MuJoCo calls world."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    T = np.eye(4)
    if index > 0:
        T[:3, :3] = data.xmat[index].reshape(3, 3)
        T[:3, 3] = data.xpos[index]
    return T
