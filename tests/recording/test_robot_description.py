"""The URDF in a recording says what our own robot says: kinematics by another engine."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy
from armsight.recording.no_robot import no_robot
from armsight.recording.robot_description import robot_description
from armsight.robots import ROBOT_NAMES, TOOL_NAMES, load_robot, load_tool
from armsight.robots.kinematics import flange_pose, tcp_pose


def chain(urdf: str, q: dict[str, float], leaf: str) -> np.ndarray:
    """``T_root_leaf`` by walking the XML: the oracle."""
    joints = {j.find("child").get("link"): j for j in ET.fromstring(urdf).findall("joint")}
    T = np.eye(4)
    while leaf in joints:
        joint = joints[leaf]
        origin, axis = joint.find("origin"), joint.find("axis")
        xyz = [float(v) for v in origin.get("xyz").split()]
        step = from_rpy([float(v) for v in origin.get("rpy").split()], xyz)
        if axis is not None:
            from scipy.spatial.transform import Rotation

            direction = np.array([float(v) for v in axis.get("xyz").split()])
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_rotvec(direction * q[joint.get("name")]).as_matrix()
            step = step @ turn
        T = step @ T
        leaf = joint.find("parent").get("link")
    return T


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_kinematics_survive(name: str) -> None:
    tool = TOOL_NAMES[0]
    robot = load_robot(name).with_tool(load_tool(tool))
    urdf = robot_description(robot)
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = rng.uniform(robot.limits.lower, robot.limits.upper)
        angles = dict(zip(robot.joint_names, q))
        np.testing.assert_allclose(chain(urdf, angles, "flange"), flange_pose(robot, q), atol=1e-9)
        np.testing.assert_allclose(chain(urdf, angles, "tcp"), tcp_pose(robot, q), atol=1e-9)


def test_every_link_has_a_body_and_limits_are_told() -> None:
    robot = load_robot("ur5")
    root = ET.fromstring(robot_description(robot))
    assert {link.get("name") for link in root.findall("link")} >= set(robot.link_names)
    for i, name in enumerate(robot.joint_names):
        limit = root.find(f"joint[@name='{name}']/limit")
        assert float(limit.get("upper")) == robot.limits.upper[i]
    shown = [link for link in root.findall("link") if link.find("visual") is not None]
    assert len(shown) >= robot.n
    masses = [float(m.get("value")) for m in root.iter("mass")]
    assert sum(masses) == pytest.approx(float(np.sum(robot.link_mass)))


def test_a_cell_without_an_arm_has_a_description() -> None:
    root = ET.fromstring(robot_description(no_robot()))
    assert [link.get("name") for link in root.findall("link")] == ["base", "flange"]
