"""An arm that moves as it likes feels what touches it, and not what it carries."""

import numpy as np
import pytest

from armsight.devices.data import JointState, Wrench
from armsight.motion.force_watch import ForceWatch
from armsight.motion.tool_motion import ToolMotion
from armsight.robots import load_robot
from armsight.robots.kinematics import flange_pose
from armsight.robots.tools import load_tool

ROBOT = load_robot("ur10").with_tool(load_tool("gripper"))
GRAVITY = np.array([0.0, 0.0, -9.81])
RNG = np.random.default_rng(3)
TURNS, PHASES = RNG.uniform(3.0, 9.0, 6), RNG.uniform(0.0, 6.0, 6)


def joints(t: float) -> np.ndarray:
    return ROBOT.home + 0.03 * np.sin(TURNS * t + PHASES)


def center(t: float) -> np.ndarray:
    """The tool's centre of mass."""
    T = flange_pose(ROBOT, joints(t))
    return T[:3, :3] @ ROBOT.tool.center_of_mass + T[:3, 3]


def reading(t: float, push: np.ndarray) -> Wrench:
    """Newton's law for the tool: what holds it up, and speeds it up; by differences of places."""
    h = 1e-4
    pull = (center(t + h) - 2.0 * center(t) + center(t - h)) / h**2
    R = flange_pose(ROBOT, joints(t))[:3, :3]
    carried = R.T @ (ROBOT.tool.mass * (GRAVITY - pull))
    push = R.T @ push
    torque = np.cross(ROBOT.tool.center_of_mass, carried)
    return Wrench(t, carried + push, torque + np.cross(ROBOT.tool.T_flange_tcp[:3, 3], push))


def state(t: float) -> JointState:
    h = 1e-5
    return JointState(t, joints(t), (joints(t + h) - joints(t - h)) / (2.0 * h))


def course(push: np.ndarray, moved: bool) -> tuple[float, np.ndarray]:
    """Greatest force and last push felt in 2 s, after 0.6 s of standing still."""
    watch, tool, most = ForceWatch(ROBOT, tuple(GRAVITY)), ToolMotion(ROBOT), 0.0
    R = flange_pose(ROBOT, ROBOT.home)[:3, :3]
    weight = R.T @ (ROBOT.tool.mass * GRAVITY)
    still = np.cross(ROBOT.tool.center_of_mass, weight)
    for k in range(75):
        watch.take([Wrench(0.008 * k - 0.7, weight, still)], ROBOT.home, False)
    for k in range(250):
        now = 0.008 * k
        pull = tool.take(state(now))
        told = [reading(now - 0.006 + 0.002 * i, push) for i in range(4)]
        watch.take(told, joints(now), True, pull if moved else None)
        if k > 1:
            most = max(most, watch.pressed)
    assert watch.push is not None
    return most, watch.push


def test_the_tools_inertia_is_no_contact() -> None:
    assert course(np.zeros(3), False)[0] > 1.5, "else there is nothing to be told apart"
    assert course(np.zeros(3), True)[0] < 0.4


def test_a_push_on_a_moving_arm_is_felt_as_it_is() -> None:
    push = np.array([3.0, -4.0, 6.0])
    most, felt = course(push, True)
    assert np.linalg.norm(felt - push) < 0.4
    assert most == pytest.approx(np.linalg.norm(push), abs=0.5)


def test_readings_that_are_late_or_cannot_be_say_nothing_of_inertia() -> None:
    tool = ToolMotion(ROBOT)
    assert not tool.take(state(0.0)).any()
    assert tool.take(state(0.008)).any()
    assert tool.take(state(0.008)).any(), "the same reading says the same"
    assert not tool.take(state(0.1)).any(), "what was between is not known"
    wild = JointState(0.108, joints(0.108), np.full(6, 2.0))
    assert not tool.take(wild).any()
