"""A press is foretold only where something could be pressed: elsewhere it is the arm's inertia."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState, Wrench
from armsight.geometry.pose import cross, make_pose
from armsight.motion.executed import Executed
from armsight.motion.force_watch import LEAD
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_law import within_reach
from armsight.motion.permit_office import PermitOffice
from armsight.motion.permits import PermitRequest
from armsight.motion.regions import Region
from armsight.motion.retreat import gap
from armsight.robots.kinematics import flange_pose, tcp_jacobian, tcp_pose
from armsight.workcell import load_workcell, robot_in
from armsight.workcell.packaged import packaged

from .scenes import make_snapshot

ROBOT = robot_in(load_workcell(packaged()["ur10_servoing"]))
BODY = MovingBody(ROBOT, ROBOT.limits.acceleration)
NOBODY = make_snapshot([], upper=(1.8, 1.8, 1.8), counts_unknown=False, stamp=0.0)
TICK, RADIUS, FORCE = 0.008, 0.045, 10.0
DOWN = np.array([0.0, 0.0, 1.0])


def told(q, push):
    """What a sensor at the flange reads of the tool's weight and (3,) a push on its tip [N]."""
    T, tool = flange_pose(ROBOT, q), ROBOT.tool
    weight = T[:3, :3].T @ (tool.mass * 9.81 * DOWN)
    push = T[:3, :3].T @ push
    torque = cross(tool.center_of_mass, weight) + cross(tool.T_flange_tcp[:3, 3], push)
    return weight + push, torque


class Coming:
    """An arm whose tip goes at a ball, along the tool, with a speed [m/s]."""

    def __init__(self, kind="thing"):
        self.office = PermitOffice(ROBOT, BODY, GuardConfig(up=(0, 0, -1)), Executed())
        self.now, self.q, self.kind = 0.0, ROBOT.home.copy(), kind
        self.axis = tcp_pose(ROBOT, self.q)[:3, 2]
        for _ in range(90):
            self.tick(0.0)

    def ask(self, distance):
        """For a ball so far before the tip [m]."""
        tip = tcp_pose(ROBOT, self.q)[:3, 3]
        ball = Region(
            "sphere", (RADIUS, 0, 0), make_pose(None, tip + (distance + RADIUS) * self.axis), 0.0,
            drift=0.0,
        )  # fmt: skip
        self.request = PermitRequest(
            "ball", self.kind, ball, ("tool",), reach=0.05, force=FORCE, stiffness=2500.0
        )

    def tick(self, speed, push=0.0):
        """One tick; a force [N] against the tool."""
        self.now += TICK
        twist = np.concatenate([speed * self.axis, np.zeros(3)])
        rates = np.linalg.solve(tcp_jacobian(ROBOT, self.q), twist)
        self.q = self.q + TICK * rates
        force, torque = told(self.q, -push * self.axis)
        self.office.feel([Wrench(self.now - 0.001, force, torque)])
        request = getattr(self, "request", None)
        if request is not None:
            request = replace(request, region=replace(request.region, exposure=self.now))
        joints = JointState(self.now, self.q, rates)
        self.office.consider(self.now, request, replace(NOBODY, stamp=self.now), joints, rates)
        return self.office.permit


def test_inertia_far_before_a_ball_is_no_press_to_come():
    """Until November 2026 `pressed with 0.7 N, soon 280` took the permit of an arm in flight."""
    arm = Coming()
    arm.ask(0.5)
    for _ in range(25):
        permit = arm.tick(0.8, push=0.9)
        assert permit.holds, permit.reason
    assert not arm.office.law(arm.now, arm.q, NOBODY).region.velocity.any()


def test_what_presses_harder_than_is_granted_counts_wherever_the_arm_is():
    arm = Coming()
    arm.ask(0.5)
    arm.tick(0.8)
    assert "pressed with" in arm.tick(0.8, push=FORCE + 1.0).reason


@pytest.mark.parametrize("speed", [0.3, 0.8])
def test_at_a_ball_a_press_is_foretold_from_before_it_is_touched_on(speed):
    """As far before it as the tip comes while a press is foretold: the ball may have come."""
    arm = Coming()
    arm.ask(0.9 * LEAD * speed)
    assert arm.tick(speed).holds
    assert "soon" in arm.tick(speed, push=0.9).reason


def test_a_hands_press_that_grows_is_foretold_near_it_only():
    for distance, holds in ((0.5, True), (0.01, False)):
        arm = Coming("hand")
        arm.ask(distance)
        assert arm.tick(0.1).holds
        push, held = 0.0, True
        for _ in range(40):
            push += 0.19
            held = arm.tick(0.1, push=push).holds
            if not held or push > 4.5:
                break
        assert held == holds


def test_reach_is_what_the_fastest_of_arm_and_command_come_and_the_region_too():
    arm = Coming()
    arm.ask(0.30)
    arm.tick(0.0)
    grant, q, still = arm.office.grant, arm.q, np.zeros(6)
    away = gap(BODY, grant, q, arm.now)
    assert not within_reach(BODY, grant, q, [still], arm.now)
    fast = np.linalg.solve(tcp_jacobian(ROBOT, q), [*(1.0 * arm.axis / LEAD * away), 0, 0, 0])
    assert within_reach(BODY, grant, q, [still, fast], arm.now)
    comes = replace(grant.region, velocity=-arm.axis * away / LEAD)
    assert within_reach(BODY, replace(grant, region=comes), q, [still], arm.now)
    assert within_reach(BODY, grant, q, [still], arm.now, unsure=away / LEAD)
    vague = replace(grant.region, covariance=(0.5 * away) ** 2 * np.eye(3))
    assert within_reach(BODY, replace(grant, region=vague), q, [still], arm.now)
