"""What the separation monitor makes of a motion, against Jacobians and the closed form."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.quick_cell import QuickCell
from armsight.motion.arm_model import ArmState
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards
from armsight.motion.separation import Separation
from armsight.motion.separation_monitor import (
    RECEDE,
    SLIDES,
    TICKS,
    SeparationMonitor,
    after_decision,
    declared_reaction,
)
from armsight.robots import load_robot
from armsight.robots.kinematics import point_jacobian

ROBOT = load_robot("ur5")
CONFIG = GuardConfig()
BRAKE = ROBOT.limits.acceleration
RADIUS, T_R = 0.0173, 0.21


def monitor():
    made = SeparationMonitor(ROBOT, CONFIG, BRAKE)
    made.set_reaction(T_R, RADIUS)
    return made


def crowd(seed, count=40, near=0.5, far=1.4):
    """Hazards around an arm in some pose, and a motion of it."""
    rng = np.random.default_rng(seed)
    q = ROBOT.home + rng.uniform(-0.7, 0.7, 6)
    made = monitor()
    middle = made.body.motion(q, np.zeros(6))[0].mean(axis=0)
    away = rng.normal(size=(count, 3))
    away *= rng.uniform(near, far, count)[:, None] / np.linalg.norm(away, axis=1)[:, None]
    return made, q, rng.normal(size=6) * 0.6, Hazards.at(middle + away, RADIUS)


def closing(made, q, motion, view, hazards):
    """(k,) which spheres are limited, and how fast each closes in on what limits it [m/s]."""
    own = np.flatnonzero((view.share < 1.0) & (view.limiting >= 0))
    center = made.body.motion(q, motion)[0]
    speeds = []
    for i in own:
        point = hazards.blocks.points[view.limiting[i]].astype(float)
        J = point_jacobian(ROBOT, q, int(made.body.link[i]), center[i])
        unit = (point - center[i]) / np.linalg.norm(point - center[i])
        speeds.append(float(unit @ J @ motion))
    return own, np.array(speeds)


def test_the_declared_reaction_is_the_slowest_cameras_and_all_that_follows():
    info = QuickCell([]).info
    cameras = [replace(info, rate=30.0, latency=0.04), replace(info, rate=15.0, latency=0.02)]
    follows = CONFIG.compute_latency + TICKS * CONFIG.period + CONFIG.start_delay
    assert declared_reaction(cameras, CONFIG) == pytest.approx(0.02 + 1.0 / 15.0 + follows)
    assert declared_reaction(cameras[:1], CONFIG) == pytest.approx(0.04 + 1.0 / 30.0 + follows)
    assert declared_reaction([], CONFIG) == pytest.approx(follows)
    assert after_decision(CONFIG) == pytest.approx(TICKS * CONFIG.period + CONFIG.start_delay)


@pytest.mark.parametrize("seed", range(6))
def test_by_how_much_a_motion_closes_in_faster_than_allowed(seed):
    made, q, motion, hazards = crowd(seed)
    view = made.judge(q, motion, hazards)
    own, speeds = closing(made, q, motion, view, hazards)
    assert len(own) > 3
    expected = np.max(speeds * (1.0 - view.share[own]), initial=0.0)
    assert made.excess(view, hazards) == pytest.approx(expected, abs=1e-9)
    still = made.judge(q, 0.0 * motion, hazards)
    assert made.excess(still, hazards) == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_a_motion_that_conforms_closes_in_on_nothing_that_limited_it_faster_than_allowed(seed):
    made, q, motion, hazards = crowd(seed, count=6)
    view = made.judge(q, motion, hazards)
    own, speeds = closing(made, q, motion, view, hazards)
    conforms = made.conform(motion, q, hazards)
    _, after = closing(made, q, conforms, view, hazards)
    few = np.argsort(view.share[own], kind="stable")[:12]
    allowed = view.share[own] * speeds
    limited = few[speeds[few] > 0.0]
    assert (after[limited] <= allowed[limited] + 2e-3).all()
    assert motion @ conforms > 0.0
    free = Hazards.at(np.array([[9.0, 9.0, 9.0]]), RADIUS)
    assert np.array_equal(made.conform(motion, q, free), motion)


@pytest.mark.parametrize("seed", range(8))
def test_sliding_leaves_as_much_of_a_wish_as_slowing_and_mostly_more(seed):
    made, q, motion, hazards = crowd(seed, count=3, near=0.55)
    view = made.judge(q, motion, hazards)
    slid, after = made.slide(motion, q, hazards, view)
    again = made.judge(q, slid, hazards)
    assert after.share == pytest.approx(again.share)
    before = min(view.allowed, 1.0) * motion @ motion
    assert min(after.allowed, 1.0) * slid @ motion >= before - 1e-12
    free = Hazards.at(np.array([[9.0, 9.0, 9.0]]), RADIUS)
    calm = made.judge(q, motion, free)
    same, seen = made.slide(motion, q, free, calm)
    assert np.array_equal(same, motion)
    assert seen is calm


def test_what_the_first_slide_meets_the_next_goes_past(monkeypatch):
    made, q, motion, hazards = crowd(0, count=3, near=0.55)
    view = made.judge(q, motion, hazards)
    kept = []
    for slides in range(SLIDES + 1):
        monkeypatch.setattr("armsight.motion.separation_monitor.SLIDES", slides)
        slid, after = made.slide(motion, q, hazards, view)
        kept.append(min(after.allowed, 1.0) * slid @ motion)
    assert all(np.diff(kept) > 0.01 * kept[0])


def test_past_a_single_hazard_it_slides_at_nearly_full_speed():
    """A motion of the tip that closes in a little: what is left of it draws away by a hair."""
    made = monitor()
    q = ROBOT.home
    motion = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    center, velocity = made.body.motion(q, motion)
    tip = int(np.argmax(np.linalg.norm(velocity, axis=1)))
    along = velocity[tip] / np.linalg.norm(velocity[tip])
    outwards = np.array([along[1], -along[0], 0.0])
    outwards *= np.sign(outwards @ center[tip])
    point = center[tip] + 0.5 * outwards + 0.1 * along
    hazards = Hazards.at(point[None], RADIUS)
    view = made.judge(q, motion, hazards)
    assert view.allowed < 0.5
    slid, after = made.slide(motion, q, hazards, view)
    kept = slid @ motion / (motion @ motion)
    assert kept * min(after.allowed, 1.0) > 1.5 * view.allowed
    nearest = int(np.argmin(view.share))
    J = point_jacobian(ROBOT, q, int(made.body.link[nearest]), center[nearest])
    unit = (point - center[nearest]) / np.linalg.norm(point - center[nearest])
    before, now = unit @ J @ motion, unit @ J @ slid
    assert now <= view.share[nearest] * before - RECEDE + 1e-4


@pytest.mark.parametrize("seed", range(4))
def test_what_a_hazard_keeps_of_the_arm_is_said_of_the_part_that_is_nearest_to_it(seed):
    made, q, motion, hazards = crowd(seed)
    view = made.judge(q, motion, hazards)
    points = hazards.blocks.points.astype(float)
    gaps = np.linalg.norm(view.center[:, None] - points[None], axis=2)
    gaps -= made.body.radius[:, None] + RADIUS
    part = int(np.argmin(gaps.min(axis=1)))
    assert view.closest == part
    assert view.least == pytest.approx(gaps[part].min(), abs=1e-5)


@pytest.mark.parametrize("speed", [0.1, 0.25])
def test_away_is_where_the_nearest_part_leaves_its_hazard(speed):
    made, q, _, hazards = crowd(2)
    still = made.at_rest(q, hazards)
    motion = made.away(still, q, hazards, speed)
    part = still.closest
    point = hazards.blocks.points[still.nearest[part]].astype(float)
    center = made.body.motion(q, motion)[0][part]
    out = (center - point) / np.linalg.norm(center - point)
    J = point_jacobian(ROBOT, q, int(made.body.link[part]), center)
    damped = J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(3), speed * out)
    assert motion == pytest.approx(damped, abs=1e-9)
    assert (J @ motion) @ out > 0.0


def test_the_distance_that_is_demanded_is_the_standards_at_the_present_speed():
    """The way until a command acts comes on top of what the arm goes on."""
    made, q, motion, hazards = crowd(4)
    state = ArmState(1.0, q, motion)
    view = made.judge(q, motion, hazards)
    part = view.closest
    center, velocity = made.body.motion(q, motion)
    point = hazards.blocks.points[view.nearest[part]].astype(float)
    towards = (point - center[part]) / np.linalg.norm(point - center[part])
    T_s = max(np.abs(motion[: made.body.link[part]]) / BRAKE[: made.body.link[part]])
    going_on = TICKS * CONFIG.period + CONFIG.start_delay
    for sign in (1.0, -1.0):
        v = sign * float(velocity[part] @ towards)
        moved = ArmState(1.0, q, sign * motion)
        a = v / T_s if v > 0.0 else 1.0
        expected = Separation().protective_distance(max(v, 0.0), T_R, a, T_s, going_on)
        got = made.protective_distance(view, moved, hazards)
        assert got == pytest.approx(expected, abs=1e-6)
    nobody = Hazards.at(np.empty((0, 3)), RADIUS)
    assert made.protective_distance(made.judge(q, motion, nobody), state, nobody) == 0.0
