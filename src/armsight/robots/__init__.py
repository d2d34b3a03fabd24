"""Robots from their URDF: kinematics, limits, link shapes, the catalogue."""

from armsight.robots.catalogue import ROBOT_NAMES, RobotSheet, load_robot, robot_sheet
from armsight.robots.folder import load_arm
from armsight.robots.loading import load_urdf
from armsight.robots.robot import Capsules, JointLimits, LinkMesh, Robot, Spheres, Tool
from armsight.robots.tools import TOOL_NAMES, load_tool

__all__ = [
    "ROBOT_NAMES",
    "TOOL_NAMES",
    "Capsules",
    "JointLimits",
    "LinkMesh",
    "Robot",
    "RobotSheet",
    "Spheres",
    "Tool",
    "load_arm",
    "load_robot",
    "load_tool",
    "load_urdf",
    "robot_sheet",
]
