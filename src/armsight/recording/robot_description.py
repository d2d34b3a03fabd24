"""A robot as URDF text, for other tools that read a recording's ``/robot_description``.

Links are drawn as the cylinders and balls that cover them: every viewer shows these without
looking for mesh files. Limits, masses and inertias are those of the catalogue.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import make_pose
from armsight.robots.robot import Robot


def robot_description(robot: Robot) -> str:
    """URDF of a robot with its tool."""
    root = ET.Element("robot", name=robot.name)
    color = ET.SubElement(root, "material", name="body")
    ET.SubElement(color, "color", rgba="0.62 0.66 0.72 1")
    for i, name in enumerate(robot.link_names):
        link = ET.SubElement(root, "link", name=name)
        _inertial(link, robot, i)
        for part in np.flatnonzero(robot.capsules.link == i):
            _capsule(
                link,
                robot.capsules.start[part],
                robot.capsules.end[part],
                float(robot.capsules.radius[part]),
            )
    for i, name in enumerate(robot.joint_names):
        joint = ET.SubElement(root, "joint", name=name, type="revolute")
        _origin(joint, robot.T_link_joint[i])
        ET.SubElement(joint, "parent", link=robot.link_names[i])
        ET.SubElement(joint, "child", link=robot.link_names[i + 1])
        ET.SubElement(joint, "axis", xyz=_text(robot.axis[i]))
        ET.SubElement(
            joint,
            "limit",
            lower=repr(float(robot.limits.lower[i])),
            upper=repr(float(robot.limits.upper[i])),
            velocity=repr(float(robot.limits.velocity[i])),
            effort="0",
        )
    _fixed(root, robot, robot.link_names[-1], "flange", robot.T_last_flange)
    if robot.tool is not None:
        _fixed(root, robot, "flange", "tcp", robot.tool.T_flange_tcp)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _fixed(root: ET.Element, robot: Robot, parent: str, child: str, T: Pose) -> None:
    """A link at a fixed place, unless the robot has one of that name already."""
    if child in robot.link_names:
        return
    ET.SubElement(root, "link", name=child)
    joint = ET.SubElement(root, "joint", name=f"{parent}-{child}", type="fixed")
    _origin(joint, T)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)


def _inertial(link: ET.Element, robot: Robot, i: int) -> None:
    if not robot.link_mass[i] > 0.0:
        return
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=repr(float(robot.link_mass[i])))
    _origin(inertial, make_pose(None, robot.link_com[i]))
    moments = robot.link_inertia[i]
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2)}
    names["izz"] = (2, 2)
    ET.SubElement(
        inertial, "inertia", {name: repr(float(moments[at])) for name, at in names.items()}
    )


def _capsule(link: ET.Element, start: Vector3, end: Vector3, radius: float) -> None:
    """A cylinder along start-end with a ball at each end."""
    along = np.asarray(end, float) - start
    length = float(np.linalg.norm(along))
    for ball in (start, end) if length > 1e-9 else (start,):
        ET.SubElement(_visual(link, make_pose(None, ball)), "sphere", radius=repr(radius))
    if length > 1e-9:
        turn, _ = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])
        pose = make_pose(turn.as_matrix(), 0.5 * (np.asarray(start, float) + end))
        ET.SubElement(_visual(link, pose), "cylinder", radius=repr(radius), length=repr(length))


def _visual(link: ET.Element, T: Pose) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    _origin(visual, T)
    ET.SubElement(visual, "material", name="body")
    return ET.SubElement(visual, "geometry")


def _origin(parent: ET.Element, T: Pose) -> None:
    with warnings.catch_warnings():
        # At gimbal lock one of the angles is free and scipy says so; any choice is right here.
        warnings.simplefilter("ignore", UserWarning)
        rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    ET.SubElement(parent, "origin", xyz=_text(T[:3, 3]), rpy=_text(rpy))


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
