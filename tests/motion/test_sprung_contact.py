"""The guard's speed for a thing that a tip on springs touches: arms played until they stand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import Wrench
from armsight.motion.force_watch import STALE, ForceWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_law import floating, pressing_speed, stopping_way
from armsight.motion.permits import LIMITS, Permit, PermitRequest, PermitState
from armsight.motion.regions import Region
from armsight.robots.kinematics import flange_pose
from armsight.robots.sprung_tip import SprungTip
from armsight.workcell import load_workcell, robot_in
from armsight.workcell.beliefs import tip_of
from armsight.workcell.packaged import packaged

CONFIG = GuardConfig()
LATE = STALE + 2.0 * CONFIG.period + CONFIG.start_delay
BRAKES = 2.0
"""A tip slows by this much at least [m/s^2]: the slowest arm's, at full reach."""
TIP = SprungTip(300.0, 0.025, 1.0)
OTHERS = (SprungTip(200.0, 0.03, 1.0), SprungTip(500.0, 0.01, 0.5), SprungTip(100.0, 0.05, 0.0))
THINGS = (1e3, 2.5e3, 5e3, 50e3)


def granted(pressed: float, force: float = 10.0) -> Permit:
    return Permit("t", "thing", PermitState.GRANTED, force=force, pressed=pressed)


def force_at(press: float, hold: float, tip: SprungTip | None) -> float:
    """Of a thing that is pressed [N]: the tip moves until what pushes it is what holds it."""
    if tip is None:
        return hold * press
    near, far = 0.0, tip.travel
    for _ in range(60):
        middle = 0.5 * (near + far)
        pushed, holds = hold * (press - middle), tip.seat + tip.stiffness * middle
        near, far = (middle, far) if pushed > holds else (near, middle)
    return hold * (press - near)


def press_at(force: float, hold: float, tip: SprungTip | None) -> float:
    near, far = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        near, far = (middle, far) if force_at(middle, hold, tip) < force else (near, middle)
    return near


def hardest(speed: float, pressed: float, hold: float, tip: SprungTip | None) -> float:
    """Force [N] once an arm stands that went on for as long as nobody knew, and then braked."""
    press, v, t, dt = press_at(pressed, hold, tip), speed, 0.0, 1e-4
    while v > 0.0:
        press += v * dt
        t += dt
        v -= BRAKES * dt if t > LATE else 0.0
    return force_at(press, hold, tip)


@pytest.mark.parametrize("tip", [None, TIP, *OTHERS])
@pytest.mark.parametrize("hold", THINGS)
def test_no_arm_presses_harder_than_it_may(tip: SprungTip | None, hold: float) -> None:
    for pressed in np.linspace(0.0, 9.5, 20):
        speed = min(pressing_speed(CONFIG, granted(pressed), hold, tip), LIMITS["thing"].speed)
        if speed > 0.002:  # always allowed: it takes the arm back
            assert hardest(speed, pressed, hold, tip) <= 10.02


def test_beyond_its_travel_the_tip_counts_for_nothing() -> None:
    on_the_stop = TIP.seat + TIP.stiffness * TIP.travel + 0.1
    with_tip = pressing_speed(CONFIG, granted(on_the_stop, 40.0), 2.5e3, TIP)
    assert with_tip == pytest.approx(pressing_speed(CONFIG, granted(on_the_stop, 40.0), 2.5e3))
    # A law that took the spring for endless would go on here until the arm presses with 100 N.
    soft = SprungTip(TIP.stiffness, math.inf, TIP.seat)
    bold = pressing_speed(CONFIG, granted(on_the_stop, 40.0), 2.5e3, soft)
    assert hardest(min(bold, 0.25), on_the_stop, 2.5e3, TIP) > 40.0


@pytest.mark.parametrize("tip", [TIP, *OTHERS])
@pytest.mark.parametrize("closing", [0.05, 0.1, 0.15])
def test_a_tip_that_is_pushed_in_counts_by_its_depth(tip: SprungTip, closing: float) -> None:
    """A ball that comes steadily: the permit ends while there is way left to come to rest in."""
    robot = robot_in(load_workcell(packaged()["ur10_servoing"]))
    q, hold, dt, far = robot.home, 2.5e3, 0.008, press_at(10.0, 2.5e3, tip)
    mass = robot.tool.mass if robot.tool is not None else 0.0
    carried = mass * flange_pose(robot, q)[:3, :3].T @ [0.0, 0.0, -9.81]
    turned = np.cross(robot.tool.center_of_mass, carried) if robot.tool is not None else carried
    watch, rng = ForceWatch(robot, (0.0, 0.0, -9.81)), np.random.default_rng(1)

    def felt(k: int, depth: float) -> str:
        force = force_at(depth, hold, tip) if depth > 0.0 else 0.0
        push = np.array([0.0, 0.0, -force]) + rng.normal(0.0, 0.05, 3)
        wrench = Wrench(dt * k, carried + push, turned)
        watch.take([wrench], q, depth > 0.0)
        deeper = stopping_way(CONFIG, closing, closing) if depth > 0.0 else 0.0
        return watch.excess(replace(granted(math.nan), torque=100.0), deeper, (hold, tip))

    for k in range(60):
        assert felt(k, -1.0) == ""
    depth, k = 0.0, 60
    while felt(k, depth) == "":
        depth, k = depth + closing * dt, k + 1
        assert depth < far
    way = closing * (CONFIG.start_delay + CONFIG.period) + closing**2 / (2.0 * BRAKES)
    if far < 1.5 * way:
        return  # so short a tip is not met so fast: see the law above
    assert far - depth > way - closing * dt - 5e-4
    assert far - depth < way + 2e-3


def test_a_jammed_tip_presses_as_a_stiff_one() -> None:
    """What the law takes for granted, and what happens without: docs/guard.md has the figure."""
    speed = min(pressing_speed(CONFIG, granted(math.nan), 2.5e3, TIP), 0.15)
    assert hardest(speed, 0.0, 2.5e3, TIP) < 10.0
    assert hardest(speed, 0.0, 2.5e3, None) == pytest.approx(51.0, abs=2.0)


def test_a_tip_of_the_servoing_cell_lets_the_arm_come_faster() -> None:
    tip = tip_of(load_workcell(packaged()["ur10_servoing"]))
    stiff, soft = (pressing_speed(CONFIG, granted(math.nan), 2.5e3, t) for t in (None, tip))
    assert stiff == pytest.approx(0.6 * 10.0 / (2.5e3 * LATE))
    way = soft * LATE + soft**2 / (2.0 * BRAKES)
    assert way == pytest.approx(10.0 / 2.5e3 + 0.03)


def test_the_spring_counts_for_what_floats_alone() -> None:
    robot = robot_in(load_workcell(packaged()["ur10_servoing"]))
    region = Region("sphere", (0.04, 0.0, 0.0), np.eye(4), 0.0, np.zeros(3), np.eye(3) * 1e-6)
    for parts, reach, floats in (
        (("tool",), 0.06, True),
        (("tool",), 0.12, False),
        (("tool",), math.inf, False),
        (("tool", "wrist_3_link"), 0.06, False),
        (("forearm_link",), 0.06, False),
    ):
        request = PermitRequest("ball", "thing", region, parts, reach)
        assert (floating(robot, request) is not None) == floats
    assert floating(robot, None) is None
    assert floating(robot.without_tool(), request) is None


def test_separation_counts_with_a_tip_that_is_pressed_aside() -> None:
    robot = robot_in(load_workcell(packaged()["ur10_servoing"]))
    tool = robot.tool
    assert tool is not None
    assert tool.tip is not None
    body = MovingBody(robot, robot.limits.acceleration)
    wider = body.shell - body.radius
    k = len(tool.spheres.radius)
    assert wider[-k:] == pytest.approx(tool.tip.travel)
    assert not wider[:-k].any()
