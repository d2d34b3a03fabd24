"""The cable that the arm drags: where its spheres are, and how fast they may come to somebody."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.motion.arm_model import ArmState
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hung_cable import HARMLESS, DraggedCable
from armsight.motion.nearest import Hazards
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import load_robot
from armsight.robots.cable import HungCable
from armsight.robots.held import holding
from armsight.robots.kinematics import flange_pose

CABLE = HungCable((0.1, -0.7, 1.7), 2.1, root=(0.0, 0.0, 0.0))
TOOL = replace(holding(None, []), T_flange_tcp=make_pose(None, (0.0, 0.0, 0.05)), cable=CABLE)
BARE = load_robot("ur10")
ROBOT = BARE.with_tool(TOOL)
Q = BARE.home
MOTION = np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0])


def monitor(robot):
    made = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    made.set_reaction(0.2, 0.0)
    return made


def test_its_spheres_hold_the_curve_and_move_as_it_does():
    cable = DraggedCable.of(ROBOT)
    center, velocity = cable.motion(Q, MOTION)
    end = (flange_pose(ROBOT, Q) @ TOOL.T_flange_tcp)[:3, 3]
    curve = CABLE.still(end, 400)
    across = np.cross(np.gradient(curve, axis=0), [0.0, 0.0, 1.0])
    across *= CABLE.radius / np.linalg.norm(across, axis=1, keepdims=True)
    points = np.concatenate([curve + across, curve - across])
    gaps = np.linalg.norm(points[:, None] - center, axis=2) - cable.radius
    assert gaps.min(axis=1).max() < 1e-3
    after = cable.motion(Q + 1e-4 * MOTION, MOTION)[0]
    before = cable.motion(Q - 1e-4 * MOTION, MOTION)[0]
    np.testing.assert_allclose(velocity, (after - before) / 2e-4, atol=5e-3)
    speed = np.linalg.norm(velocity, axis=1)
    assert speed[0] > 3.0 * HARMLESS
    assert speed[-1] < HARMLESS  # beside its hanger
    assert DraggedCable.of(BARE) is None


@pytest.mark.parametrize("at", [2, 6, 8])
def test_near_somebody_the_cable_is_no_faster_than_harms_nobody(at):
    center, velocity = DraggedCable.of(ROBOT).motion(Q, MOTION)
    speed = np.linalg.norm(velocity, axis=1)
    assert speed[at] > HARMLESS
    person = Hazards.at(center[at] + 0.35 * velocity[at][None] / speed[at], 0.0)
    gate = monitor(ROBOT)
    view = gate.judge(Q, MOTION, person)
    assert view.allowed <= view.cable < 1.0
    slowed = np.linalg.norm(DraggedCable.of(ROBOT).motion(Q, view.cable * MOTION)[1], axis=1)
    assert slowed[at] < 1.01 * HARMLESS
    assert gate.excess(view, person) > 0.1
    assert gate.judge(Q, 0.99 * view.cable * MOTION, person).cable >= 1.0
    far = Hazards.at(center[at][None] + np.array([[0.0, 0.0, 6.0]]), 0.0)
    assert gate.judge(Q, MOTION, far).cable > 1.0
    assert gate.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, far)


def test_somebody_whom_only_the_cable_comes_to_is_counted():
    """The arm itself may go on, and stop later."""
    long = replace(CABLE, hanger=(0.1, -2.2, 1.7), length=3.0)
    robot = BARE.with_tool(replace(TOOL, cable=long))
    center, _ = DraggedCable.of(robot).motion(Q, MOTION)
    person = Hazards.at(center[8][None] + np.array([[0.0, -0.3, 0.0]]), 0.0)
    gate, bare = monitor(robot), monitor(BARE)
    assert bare.judge(Q, MOTION, person).allowed >= 1.0
    assert bare.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, person)
    allowed = gate.judge(Q, MOTION, person).allowed
    assert 0.0 < allowed < 0.5
    assert not gate.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, person)
    assert gate.stops_in_time(ArmState(0.0, Q, allowed * MOTION), 0.2, person)


def test_somebody_at_the_hanger_does_not_hold_the_arm():
    near = Hazards.at(np.array([[0.1, -0.8, 1.75]]), 0.0)
    assert monitor(ROBOT).judge(Q, MOTION, near).cable >= 1.0
