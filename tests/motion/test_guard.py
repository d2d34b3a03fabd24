"""The guard at work on a kinematic cell: goes where it is told, and never into anyone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.motion.arm_model import ArmState
from armsight.motion.data import GuardMode
from armsight.motion.guard import Guard
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards
from armsight.motion.route import Route
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import ROBOT_NAMES, load_robot

A = np.deg2rad([-55, -70, 85, -105, -90, 0])
B = np.deg2rad([55, -70, 85, -105, -90, 0])


def reaching(speed=1.5, inside=0.55, begin=2.0, stay=2.5, period=100.0):
    """A hand that comes from x = 1.5 m to ``inside`` in front of the arm, stays, and leaves."""
    way = 1.5 - inside

    def center(t):
        phase = t % period - begin
        x = np.clip(phase * speed, 0, way) - np.clip((phase - stay) * speed, 0, way)
        return np.array([1.5 - x, 0.0, 0.35])

    return center


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_every_arm_goes_where_it_is_told(name):
    robot = load_robot(name)
    goal = robot.home + np.array([0.8, 0.2, -0.3, 0.2, 0.3, 0.4, 0.2])[: robot.n]
    world = QuickCell(goals=[goal, robot.home], robot=name).run(6)
    assert world.log[-1].reached or len(world.visits) >= 1
    at = next(s for s in world.log if s.reached)
    assert at.goal == "G0"


def test_nobody_near_nothing_slows_it_and_it_stays_on_its_path():
    world = QuickCell(goals=[A, B])
    world.run(9)
    driving = [s for s in world.log if s.mode == GuardMode.PREDICTIVE]
    assert len(world.visits) >= 2
    assert all(s.speed_scale == 1.0 for s in driving)
    assert {s.mode for s in world.log[100:]} <= {
        GuardMode.PREDICTIVE,
        GuardMode.PLANNING,
        GuardMode.IDLE,
    }


def test_commands_respect_speed_and_acceleration():
    world = QuickCell(goals=[A, B])
    world.run(9)
    v = np.array(world.commands)[:, :6]
    limits = world.robot.limits.scaled(0.5, 0.6)
    assert (np.abs(v) <= limits.velocity + 1e-6).all()
    assert (np.abs(np.diff(v, axis=0)) / 0.008 <= limits.acceleration * 1.1).all()


def test_it_slows_stops_and_goes_on_for_a_hand():
    world = QuickCell([Ball(reaching(speed=0.3, inside=0.6, begin=1.0, stay=5.0))], [A, B])
    world.run(20)
    modes = [s.mode for s in world.log]
    assert GuardMode.SLOWED in modes
    assert not world.moving_touches
    assert len(world.visits) >= 2
    assert any("something" in s.reason for s in world.log)
    assert all(s.reason for s in world.log if s.mode in (GuardMode.SLOWED, GuardMode.STOPPED))


def test_a_fast_hand_meets_a_standing_arm():
    for speed in (1.0, 1.6, 2.0):
        world = QuickCell([Ball(reaching(speed=speed, inside=0.45))], [A, B])
        world.run(7)
        assert world.moving_touches == []


def test_the_same_seed_gives_the_same_commands_bit_for_bit():
    runs = [
        QuickCell([Ball(reaching(period=5.0))], [A, B], seed=3).run(8).commands for _ in range(2)
    ]
    assert np.array(runs[0]).tobytes() == np.array(runs[1]).tobytes()


def law_holds(gate, q, motion, hazards):
    """Every part against every hazard, by the written law, with a = v / T_s of the part."""
    body, law = gate.body, gate.law
    separation = gate._config.separation
    center, velocity = body.motion(q, motion)
    fastest = body.fastest(q, motion, velocity)
    for i in range(len(center)):
        if np.linalg.norm(velocity[i]) == 0.0:
            continue
        joints = np.abs(motion[: body.link[i]]) / body.brake[: body.link[i]]
        T_s = joints.max()
        for h in hazards.blocks.points.astype(float):
            away = h - center[i]
            length = np.linalg.norm(away)
            closing = velocity[i] @ away / length
            distance = length - body.radius[i] - hazards.radius
            if closing > 1e-9:
                allowed = separation.allowed_speed(distance, law.T_person, closing / T_s, law.T_arm)
                assert closing <= allowed * (1 + 1e-6) + 1e-9
            else:
                v_h = separation.person_speed
                standing = fastest <= law.retreat + 1e-9
                assert standing or distance >= separation.K + v_h * (law.T_person + T_s) - 1e-6


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(ROBOT_NAMES),
    count=st.integers(1, 40),
    T_r=st.floats(0.05, 0.3),
)
def test_commanded_closing_speed_never_exceeds_v_max(seed, name, count, T_r):
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
    motion = rng.normal(size=robot.n) * rng.choice([0.05, 0.5, 2.0])
    points = rng.normal(size=(count, 3)) * rng.choice([0.3, 0.8, 1.5])
    hazards = Hazards.at(points, 0.0173)
    gate.set_reaction(T_r, 0.0173)
    share = min(gate.judge(q, motion, hazards).allowed, 1.0)
    law_holds(gate, q, share * motion, hazards)
    conformed = gate.conform(motion, q, hazards)
    share = min(gate.judge(q, conformed, hazards).allowed, 1.0)
    law_holds(gate, q, share * conformed, hazards)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(ROBOT_NAMES),
    age=st.floats(0.05, 0.3),
)
def test_no_chaser_reaches_an_arm_that_may_still_brake(seed, name, age):
    """A point goes for the sphere it can reach first; the arm brakes: played in small steps."""
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    gate.set_reaction(0.2, 0.0)
    q = rng.uniform(np.maximum(robot.limits.lower, -3), np.minimum(robot.limits.upper, 3))
    v = rng.uniform(-0.5, 0.5, robot.n) * robot.limits.velocity
    hazard = rng.normal(size=3)
    hazard *= rng.uniform(0.3, 2.0) / np.linalg.norm(hazard)
    safe = gate.stops_in_time(ArmState(0.0, q, v), age, Hazards.at(hazard[None], 0.0))
    brake, until = gate.body.brake, gate.body.stopping(v)
    room = np.inf
    for t in np.linspace(0.0, until.max(), 200):
        own = np.minimum(t, np.abs(v) / brake)
        center, _ = gate.body.motion(q + v * own - 0.5 * np.sign(v) * brake * own**2, v)
        moving = until >= t
        gaps = np.linalg.norm(center - hazard, axis=1) - gate.body.radius - 2.0 * (age + t)
        room = min(room, gaps[moving].min())
    K = GuardConfig().separation.K
    if safe:
        assert room >= K - 0.005
    else:
        assert room <= K + 0.005


def test_arms_that_count_as_standing_are_in_time():
    robot = load_robot("ur5")
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    gate.set_reaction(0.2, 0.0)
    center, _ = gate.body.motion(robot.home, np.zeros(6))
    touching = Hazards.at(center[-1:], 0.0)
    slow, fast = np.array([0.04, 0, 0, 0, 0, 0]), np.array([0.2, 0, 0, 0, 0, 0])
    assert gate.stops_in_time(ArmState(0.0, robot.home, slow), 0.2, touching)
    assert not gate.stops_in_time(ArmState(0.0, robot.home, fast), 0.2, touching)
    assert not gate.stops_in_time(ArmState(0.0, robot.home, fast), np.inf, touching)
    nobody = Hazards.at(np.empty((0, 3)), 0.0)
    assert gate.stops_in_time(ArmState(0.0, robot.home, fast), np.inf, nobody)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_moving_away_is_always_allowed(seed):
    rng = np.random.default_rng(seed)
    robot = load_robot("ur5")
    gate = SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)
    gate.set_reaction(0.15, 0.0173)
    q = rng.uniform(-3, 3, 6)
    center, _ = gate.body.motion(q, np.zeros(6))
    k = int(rng.integers(len(center)))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    hazard = center[k] + direction * (gate.body.radius[k] + rng.uniform(0.0, 0.2))
    hazards = Hazards.at(hazard[None], 0.0173)
    here = gate.at_rest(q, hazards)
    leaving = gate.away(here, q, hazards, 0.25)
    leaving = gate.conform(leaving, q, hazards)
    view = gate.judge(q, leaving, hazards)
    share = min(view.allowed, 1.0)
    _, velocity = gate.body.motion(q, share * leaving)
    fastest = gate.body.fastest(q, share * leaving, velocity)
    if np.linalg.norm(leaving) > 1e-3 and (view.share > 0).all():
        assert fastest >= min(0.9 * 0.045, 0.9 * np.linalg.norm(velocity, axis=1).max())
        after = gate.at_rest(q + 0.05 * leaving * view.allowed, hazards)
        assert after.least >= here.least - 1e-3


def test_the_stop_in_hand_is_proven_free():
    """With a wall right behind the arm, it never drives so that it could not stop before it."""
    world = QuickCell(goals=[A, B])
    world.run(0.9)
    seen = []
    check = world.guard._model.path_valid

    def spy(path, snapshot, at=None):
        result = check(path, snapshot, at)
        seen.append(result)
        return result

    world.guard._model.path_valid = spy
    world.run(0.3)
    assert seen
    assert all(seen)
    world.guard._model.path_valid = lambda path, snapshot, at=None: False
    before = max(np.abs(c[:6]).max() for c in world.commands[-5:])
    world.run(1.0)
    assert before > 0.1
    assert np.abs(world.v).max() < 0.02
    assert any(s.reason == "keeps room to stop" for s in world.log)


def test_a_robot_without_shapes_is_refused():
    from dataclasses import replace

    robot = load_robot("ur5")
    empty = replace(
        robot,
        spheres=type(robot.spheres)(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0)),
    )
    with pytest.raises(ValueError, match="no link spheres"):
        Guard(empty, [])


def test_a_permits_law_is_that_of_when_the_command_acts(monkeypatch):
    """Its region moves: where it is now is not where the arm meets it."""
    world, asked = QuickCell(goals=[A, B]), []
    law = world.guard._permits.law

    def spied(when, *rest):
        asked.append(when)
        return law(when, *rest)

    monkeypatch.setattr(world.guard._permits, "law", spied)
    world.run(0.2)
    ticks = np.array([s.stamp for s in world.log[-len(asked) :]])
    np.testing.assert_allclose(asked, ticks + world.config.start_delay, atol=1e-9)
    assert world.config.start_delay > 0.0


def test_every_new_map_is_held_against_the_way_that_is_driven(monkeypatch):
    world, proven = QuickCell(goals=[A, B]), []
    world.run(1.5)
    prove = Route.prove

    def spied(route, model, snapshot, at):
        proven.append(snapshot.stamp)
        prove(route, model, snapshot, at)

    monkeypatch.setattr(Route, "prove", spied)
    old, seen = world.snapshot.stamp, set()
    for _ in range(40):
        world.tick()
        seen.add(world.snapshot.stamp)
        assert world.guard._route is not None
    assert len(seen) > 3
    assert set(proven) == seen - {old}
