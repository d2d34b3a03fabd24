"""The cable that the arm drags: where its spheres are, and how fast they may come to somebody."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.motion.arm_model import ArmState
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hung_cable import HARMLESS, SWAYS, DraggedCable
from armsight.motion.nearest import Hazards
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import load_robot
from armsight.robots.cable import PIECES, HungCable
from armsight.robots.held import holding
from armsight.robots.kinematics import flange_pose
from armsight.robots.soft_mount import SoftMount

CABLE = HungCable((0.1, -0.7, 1.7), 2.1, root=(0.0, 0.0, 0.0))
LONG = replace(CABLE, hanger=(0.1, -2.2, 1.7), length=3.0)
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


def test_its_spheres_hold_it_where_it_swings_and_where_its_tool_hangs():
    """As in a bow, by SWAYS in its middle; at the tool by what the mount gives way, too."""
    mount = SoftMount((1000.0, 50.0), (100.0, 10.0), (20.0, 1.0))
    cable = replace(CABLE, root=(0.0, 0.3, 0.4))
    sag = 20.0 / 1000.0 + 0.5 * 1.0 / 50.0
    for tool, beside in ((replace(TOOL, cable=cable), 0.0),
                         (replace(TOOL, cable=cable, mount=mount), sag)):  # fmt: skip
        radius = DraggedCable.of(BARE.with_tool(tool)).radius
        s = (np.arange(PIECES)[:, None] + np.linspace(0.0, 1.0, 50)) / PIECES
        aside = CABLE.radius + SWAYS * np.sin(np.pi * s) + beside * (1.0 - s)
        ahead = CABLE.length * (s - s.mean(axis=1, keepdims=True))
        needed = np.hypot(aside, ahead).max(axis=1)
        assert radius == pytest.approx(needed, abs=0.007)  # its bow is no sine, in pieces


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
    assert gate.judge(Q, view.cable * MOTION, person).cable_excess < 1e-3
    far = Hazards.at(center[at][None] + np.array([[0.0, 0.0, 6.0]]), 0.0)
    free = gate.judge(Q, MOTION, far)
    assert (free.cable, free.cable_hazard, free.cable_excess) == (np.inf, -1, 0.0)
    both = Hazards.at(np.concatenate([far.blocks.points, person.blocks.points]), 0.0)
    limits = gate.judge(Q, MOTION, both).cable_hazard
    assert both.blocks.points[limits] == pytest.approx(person.blocks.points[0])
    assert gate.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, far)


def test_somebody_whom_only_the_cable_comes_to_is_counted():
    """The arm itself may go on, and stop later."""
    robot = BARE.with_tool(replace(TOOL, cable=LONG))
    center, _ = DraggedCable.of(robot).motion(Q, MOTION)
    person = Hazards.at(center[8][None] + np.array([[0.0, -0.3, 0.0]]), 0.0)
    gate, bare = monitor(robot), monitor(BARE)
    assert bare.judge(Q, MOTION, person).allowed >= 1.0
    assert bare.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, person)
    allowed = gate.judge(Q, MOTION, person).allowed
    assert 0.0 < allowed < 0.5
    assert not gate.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, person)
    assert gate.stops_in_time(ArmState(0.0, Q, allowed * MOTION), 0.2, person)


def test_the_cable_need_only_be_slow_before_somebody_is_there():
    """Between where a play of the stop is reached by somebody at v_h, and where the guard says so.

    The cable counts until it is slow: asked to stand, it would be 15 cm more.
    """
    robot = BARE.with_tool(replace(TOOL, cable=LONG))
    cable, gate = DraggedCable.of(robot), monitor(robot)
    center, velocity = cable.motion(Q, MOTION)
    speed, law = np.linalg.norm(velocity, axis=1), gate.law
    ends = MOTION[0] / robot.limits.acceleration[0]

    def touched(at):
        for t in np.linspace(0.0, ends, 60):
            turned = MOTION * (t - 0.5 * t**2 / ends)
            fast = speed * (1.0 - t / ends) > HARMLESS
            reach = cable.radius + law.K + law.person * (0.2 + t)
            away = np.linalg.norm(cable.motion(Q + turned, MOTION)[0] - at, axis=1)
            if (away < reach)[fast].any():
                return True
        return False

    def stopped(at):
        return not gate.stops_in_time(ArmState(0.0, Q, MOTION), 0.2, Hazards.at(at[None], 0.0))

    def border(test):
        near, far = 0.3, 3.0
        assert test(at(near)) > test(at(far))
        while far - near > 1e-3:
            middle = 0.5 * (near + far)
            near, far = (middle, far) if test(at(middle)) else (near, middle)
        return far

    def at(away):
        return center[8] + np.array([0.0, -away, 0.0])

    needed, asked = border(touched), border(stopped)
    assert needed <= asked + 0.01  # it looks at five places of the stop
    assert asked <= needed + 0.05


def test_somebody_at_the_hanger_does_not_hold_the_arm():
    near = Hazards.at(np.array([[0.1, -0.8, 1.75]]), 0.0)
    assert monitor(ROBOT).judge(Q, MOTION, near).cable >= 1.0
