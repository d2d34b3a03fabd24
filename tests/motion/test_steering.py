"""Velocity intents through the guard: limits, people, staleness, faults, and to planned motion."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.data import GuardMode
from armsight.motion.intents import JointIntent, PoseIntent, Rest, VelocityIntent
from armsight.motion.trajectory import coasting
from armsight.robots import load_robot
from armsight.robots.kinematics import tcp_jacobian, tcp_pose

A = np.deg2rad([-55, -70, 85, -105, -90, 0])
B = np.deg2rad([55, -70, 85, -105, -90, 0])


def wish(world, velocity, frame="base", age=0.1, lasts=0.2):
    return VelocityIntent(
        "v", np.asarray(velocity, float), frame, world.now - age, world.now + lasts
    )


def ready(robot="ur5", q=None, **kwargs):
    world = QuickCell(robot=robot, **kwargs)
    world.q = world.q if q is None else np.array(q, float)
    for _ in range(50):
        world.tick(goal=None)
    return world


def limits_hold(world, jerk=True):
    """Every command keeps speed, acceleration and jerk, tick by tick."""
    limits = world.guard._filter.limits
    sent = np.array(world.commands)
    v, braked = sent[:, :-1], sent[:, -1] > 0
    assert not braked.any()
    dt = world.config.period
    rate = np.diff(v, axis=0) / dt
    assert (np.abs(v) <= limits.velocity * (1 + 1e-9)).all()
    assert (np.abs(rate) <= limits.acceleration * (1 + 1e-6)).all()
    if jerk:
        assert (np.abs(np.diff(rate, axis=0)) / dt <= limits.jerk * (1 + 1e-6)).all()


@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_random_velocities_keep_every_limit(robot):
    world = ready(robot)
    rng = np.random.default_rng(4)
    for _ in range(60):
        joints = rng.random() < 0.5
        size = world.robot.n if joints else 6
        velocity = rng.normal(size=size) * rng.choice([0.1, 0.5, 3.0])
        frame = "joint" if joints else rng.choice(["base", "tcp"])
        for _ in range(20):
            decision = world.tick(goal=wish(world, velocity, str(frame)))
            limits = world.robot.limits
            assert (world.q >= limits.lower).all()
            assert (world.q <= limits.upper).all()
            assert decision.status.wanted is not None
    limits_hold(world)


def test_a_twist_moves_the_tcp_along_a_straight_line_with_its_speed():
    world = ready()
    start = tcp_pose(world.robot, world.q)
    for _ in range(200):
        decision = world.tick(goal=wish(world, [0.0, 0.12, 0.05, 0, 0, 0]))
    now = tcp_pose(world.robot, world.q)
    way = now[:3, 3] - start[:3, 3]
    along = np.array([0.0, 0.12, 0.05]) / 0.13
    assert way @ along > 0.15
    assert np.linalg.norm(way - (way @ along) * along) < 0.004
    assert np.allclose(now[:3, :3], start[:3, :3], atol=0.01)
    speed = tcp_jacobian(world.robot, world.q)[:3] @ world.v
    assert speed == pytest.approx([0.0, 0.12, 0.05], abs=0.005)
    assert decision.status.mode == GuardMode.VELOCITY
    assert decision.status.command == pytest.approx(decision.status.wanted, abs=1e-3)
    assert decision.status.evidence_age == pytest.approx(0.1)


def test_the_tcp_frame_turns_with_the_tcp():
    worlds = [ready(), ready()]
    R = tcp_pose(worlds[0].robot, worlds[0].q)[:3, :3]
    twist = np.array([0.05, -0.02, 0.03, 0.1, 0.0, 0.0])
    in_base = np.concatenate([R @ twist[:3], R @ twist[3:]])
    for _ in range(3):
        worlds[0].tick(goal=wish(worlds[0], twist, "tcp"))
        worlds[1].tick(goal=wish(worlds[1], in_base, "base"))
    assert worlds[0].commands[-1] == pytest.approx(worlds[1].commands[-1], abs=1e-5)


def test_near_a_singularity_the_arm_lags_and_does_not_race():
    """A UR's wrist in line: a turn about the lost axis would need endless joint speed."""
    world = ready(q=np.deg2rad([0, -90, 90, -90, 0, 0]))
    for _ in range(150):
        world.tick(goal=wish(world, [0, 0, 0, 0.3, 0.3, 0.3]))
    limits_hold(world)
    assert np.abs(world.v).max() < 1.2


def test_a_stale_velocity_comes_to_rest_smoothly_and_says_so():
    world = ready()
    stamp = world.now
    for _ in range(120):
        intent = VelocityIntent("old", np.array([0.5, 0, 0, 0, 0, 0]), "joint", stamp, stamp + 0.4)
        decision = world.tick(goal=intent)
    assert np.abs(world.v).max() < 1e-3
    assert decision.status.mode == GuardMode.STOPPED
    assert "velocity old is stale: it ended 0.5" in decision.status.reason
    assert max(np.abs(c[:6]).max() for c in world.commands) > 0.4
    limits_hold(world)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocity": np.full(6, np.nan)}, "velocity v is not finite"),
        ({"velocity": np.zeros(5)}, r"velocity v has shape \(5,\); expected a twist of 6"),
        ({"velocity": "fast"}, "could not convert"),
        ({"frame": "world"}, 'frame is "world"; expected joint, base or tcp'),
        ({"valid_until": np.inf}, "must be times in seconds"),
        ({"valid_until": 1e3}, "s after its evidence; at most 1 s"),
        ({"exposure": 1e3, "valid_until": 1000.5}, "s in the future"),
        ({"valid_until": -1.0}, "before it begins"),
    ],
)
def test_bad_velocities_are_refused_in_words_and_the_arm_comes_to_rest(change, message):
    world = ready()
    good = [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    for _ in range(60):
        world.tick(goal=wish(world, good))
    assert np.abs(world.v).max() > 0.1
    for _ in range(60):
        decision = world.tick(goal=replace(wish(world, good), **change))
    assert decision.status.mode == GuardMode.STOPPED
    assert re.search(message, decision.status.reason)
    assert np.abs(world.v).max() < 1e-3
    limits_hold(world)
    for _ in range(30):  # the next good one is taken
        decision = world.tick(goal=wish(world, good))
    assert decision.status.mode == GuardMode.VELOCITY


@pytest.mark.parametrize(
    "thing",
    [
        42,
        "go",
        np.zeros(6),
        JointIntent("x", None),
        JointIntent("x", ["0.1"] * 6),
        PoseIntent("p", np.eye(3)),
        PoseIntent("p", np.eye(4).astype(str)),
    ],
)
def test_what_is_no_intent_is_refused_in_words(thing):
    world = ready()
    for _ in range(5):
        decision = world.tick(goal=thing)
    assert decision.status.mode == GuardMode.STOPPED
    assert decision.status.reason
    assert not decision.command.any()


def test_rest_says_its_reason():
    world = ready()
    decision = world.tick(goal=Rest("waiting for the ball"))
    assert decision.status.mode == GuardMode.IDLE
    assert decision.status.reason == "waiting for the ball"
    decision = world.tick(goal=Rest("task x failed: no", fault=True))
    assert decision.status.mode == GuardMode.STOPPED


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.0])
def test_no_hand_meets_a_moving_arm_that_a_task_drives_at_it(speed):
    """The task wants to go straight at the hand, as fast as it can, all the time."""

    def hand(t):
        return np.array([1.5 - np.clip((t - 1.0) * speed, 0.0, 0.95), 0.0, 0.35])

    world = ready(balls=[Ball(hand)])
    for _ in range(500):
        at = tcp_pose(world.robot, world.q)[:3, 3]
        away = hand(world.now) - at
        twist = np.concatenate([0.8 * away / np.linalg.norm(away), np.zeros(3)])
        world.tick(goal=wish(world, twist))
    assert world.moving_touches == []
    modes = {s.mode for s in world.log}
    assert GuardMode.SLOWED in modes
    assert any("something" in s.reason for s in world.log)


def test_a_bound_tool_is_slowed_and_never_turned_aside():
    """A plug in its socket, with somebody beside the arm: along its axis or not at all."""
    aside = []
    for bound in (False, True):
        world = ready(q=A)
        tip = tcp_pose(world.robot, world.q)[:3, 3].copy()
        world.balls = [Ball(lambda t, tip=tip: tip + np.array([0.4, 0.8, 0.0]))]
        for _ in range(500):
            goal = replace(wish(world, [0.0, 0.3, 0.0, 0.0, 0.0, 0.0]), bound=bound)
            decision = world.tick(goal=goal)
        moved = tcp_pose(world.robot, world.q)[:3, 3] - tip
        assert moved[1] > 0.05
        assert decision.status.mode in (GuardMode.SLOWED, GuardMode.STOPPED)
        assert world.moving_touches == []
        aside.append(float(np.hypot(moved[0], moved[2])))
    assert aside[0] > 0.01
    assert aside[1] < 0.003


def test_it_slides_along_what_it_may_not_approach():
    """Straight at a ball that is off to one side: the arm goes on, beside it."""
    world = ready(q=A)
    tip = tcp_pose(world.robot, world.q)[:3, 3]
    world.balls = [Ball(lambda t: tip + np.array([0.4, 0.8, 0.0]))]
    for _ in range(550):
        world.tick(goal=wish(world, [0.0, 0.3, 0.0, 0.0, 0.0, 0.0]))
    way = tcp_pose(world.robot, world.q)[:3, 3] - tip
    assert way[1] > 0.3
    assert way[0] < -0.01
    assert world.moving_touches == []
    assert sum(c[-1] for c in world.commands) == 0  # without braking once


def test_it_stops_before_a_wall_and_leaves_it_again():
    world = ready()
    tip = tcp_pose(world.robot, world.q)[:3, 3]
    world.state = world.state.copy()
    first = int(world.grid.index(tip[None])[0][1]) + 12
    world.state[:, first:, :] = OCCUPIED
    away = distance_transform_edt(world.state != OCCUPIED) * world.grid.voxel
    world.field = np.clip(away - np.sqrt(3.0) * world.grid.voxel, 0.0, 0.3).astype(np.float32)
    for _ in range(300):
        decision = world.tick(goal=wish(world, [0.0, 0.3, 0.0, 0.0, 0.0, 0.0]))
    body = world.guard.body
    edge = world.grid.origin[1] + first * world.grid.voxel
    reach = (body.motion(world.q, world.v)[0][:, 1] + body.radius).max()
    assert edge - 0.04 < reach < edge
    assert np.abs(world.v).max() < 0.05
    assert decision.status.reason == "keeps room to stop"
    stood = tcp_pose(world.robot, world.q)[1, 3]
    for _ in range(150):
        world.tick(goal=wish(world, [0.0, -0.1, 0.0, 0.0, 0.0, 0.0]))
    assert tcp_pose(world.robot, world.q)[1, 3] < stood - 0.05


def test_faults_stop_a_velocity_as_they_stop_a_path():
    world = ready()
    for _ in range(80):
        world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    frozen = world.snapshot
    for _ in range(60):
        decision = world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]), snapshot=frozen)
    assert "ms old" in decision.status.reason
    assert np.abs(world.v).max() < 0.01
    decision = world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]), joints=None)
    assert decision.brake


def test_the_reflex_answers_during_a_velocity_and_the_velocity_goes_on():
    world = ready()
    gone = [False]
    for _ in range(60):
        world.tick(goal=wish(world, [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
    tip = tcp_pose(world.robot, world.q)[:3, 3]
    world.balls = [Ball(lambda t: tip + np.array([0.14 + 5.0 * gone[0], 0.0, 0.0]), 0.03)]
    for _ in range(80):
        decision = world.tick(goal=wish(world, [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
    assert decision.status.mode == GuardMode.REFLEX
    gone[0] = True
    for _ in range(200):
        decision = world.tick(goal=wish(world, [0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
    assert decision.status.mode == GuardMode.VELOCITY
    assert world.moving_touches == []


def speeds(world, since):
    return np.array([np.linalg.norm(c[:-1]) for c in world.commands[since:]])


@pytest.mark.parametrize("kind", ["joints", "pose"])
def test_velocity_hands_over_to_a_planned_motion_without_standing_still(kind):
    world = ready()
    for _ in range(100):
        world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    since = len(world.commands)
    before = speeds(world, since - 1)[0]
    goal = JointIntent("B", B) if kind == "joints" else PoseIntent("B", tcp_pose(world.robot, B))
    while not (world.log[-1].reached and world.log[-1].goal == "B"):
        world.tick(goal=goal)
        assert len(world.commands) < 2000
    driven = speeds(world, since)
    fast = np.flatnonzero(driven > 0.9 * driven.max())[0]
    assert driven[:fast].min() > 0.3 * before
    assert tcp_pose(world.robot, world.q) == pytest.approx(tcp_pose(world.robot, B), abs=6e-3)
    assert not world.moving_touches
    sent = np.array(world.commands)[since - 2 :, :-1]
    limits = world.guard._filter.limits
    assert (np.abs(np.diff(sent, axis=0)) / 0.008 <= limits.acceleration * 1.1).all()


def test_planned_motion_hands_over_to_a_velocity_without_standing_still():
    world = QuickCell(goals=[A, B])
    world.run(1.6)
    assert np.abs(world.v).max() > 0.3
    since = len(world.commands)
    way = world.v / np.abs(world.v).max()
    for _ in range(60):
        world.tick(goal=wish(world, 0.3 * way, "joint"))
    assert speeds(world, since).min() > 0.2
    assert world.v == pytest.approx(0.3 * way, abs=0.01)
    limits = world.guard._filter.limits
    rate = np.diff(np.array(world.commands)[since - 1 :, :-1], axis=0) / 0.008
    assert (np.abs(rate) <= limits.acceleration * (1 + 1e-6)).all()


def test_a_goal_that_changes_while_coasting_is_reached():
    world = ready()
    for _ in range(80):
        world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    for _ in range(5):
        world.tick(goal=JointIntent("B", B))
    while not (world.log[-1].reached and world.log[-1].goal == "A"):
        world.tick(goal=JointIntent("A", A))
        assert len(world.commands) < 2000
    assert world.q == pytest.approx(A, abs=0.02)


def test_a_pose_out_of_reach_is_said():
    world = ready()
    T = tcp_pose(world.robot, A).copy()
    T[0, 3] += 2.0
    for _ in range(60):
        decision = world.tick(goal=PoseIntent("far", T))
    assert decision.status.mode == GuardMode.STOPPED
    assert "goal far: out of reach: no joints bring the TCP to (2." in decision.status.reason
    assert not decision.command.any()


def test_of_all_solutions_the_one_that_is_there_soonest_is_taken():
    """From A the same pose is near; a far solution of the same pose would take longer."""
    world = ready(q=A)
    T = tcp_pose(world.robot, A).copy()
    T[2, 3] += 0.05
    begin = world.now
    while not world.log[-1].reached:
        world.tick(goal=PoseIntent("up", T))
        assert world.now < begin + 5.0
    assert np.abs(world.q - A).max() < 0.5
    assert tcp_pose(world.robot, world.q) == pytest.approx(T, abs=6e-3)


def test_coasting_keeps_acceleration_and_jerk_and_ends_at_rest():
    limits = load_robot("ur5").limits.scaled(0.5, 0.6)
    rng = np.random.default_rng(1)
    for _ in range(20):
        v = rng.uniform(-1, 1, 6) * limits.velocity
        a = rng.uniform(-1, 1, 6) * limits.acceleration
        motion = coasting(A, v, a, 0.1, limits)
        _, acceleration, jerk = motion.peak()
        assert (acceleration <= limits.acceleration * (1 + 1e-9)).all()
        assert (jerk <= limits.jerk * (1 + 1e-9)).all()
        assert motion.velocity(0.0) == pytest.approx(v)
        assert motion.acceleration(0.0) == pytest.approx(a)
        eased = v + 0.5 * a * np.abs(a) / limits.jerk
        assert motion.velocity(0.1) == pytest.approx(eased, abs=0.35)
        before_end = motion.velocity(motion.duration - 1e-9)
        assert before_end == pytest.approx(np.zeros(6), abs=1e-6)


def test_rows_that_limit_a_motion_are_the_closing_speeds():
    """The compiled rows against plain numpy: the speed towards the hazard of each sphere."""
    from armsight.motion.slide_kernels import limiting_rows
    from armsight.robots.kernels import chain_poses

    world = ready()
    body, robot, rng = world.guard.body, world.robot, np.random.default_rng(5)
    q, v = world.q + rng.normal(size=6) * 0.3, rng.normal(size=6)
    center, velocity = body.motion(q, v)
    tight = rng.permutation(len(center))[:12]
    hazard = center[tight] + rng.normal(size=(12, 3))
    share = rng.uniform(size=len(center))
    poses = chain_poses(q, robot.T_link_joint, robot.axis)
    rows, bounds = limiting_rows(
        poses, robot.axis, body.link, center, velocity, share, hazard, tight
    )
    unit = (hazard - center[tight]) / np.linalg.norm(hazard - center[tight], axis=1)[:, None]
    closing = (velocity[tight] * unit).sum(axis=1)
    closes = closing > 0.0
    assert len(rows) == closes.sum()
    assert rows @ v == pytest.approx(closing[closes])
    assert bounds == pytest.approx((share[tight] * closing)[closes])
