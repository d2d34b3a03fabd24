"""Trajectories: limits, continuity, ends, and durations against Ruckig's time-optimal ones."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import ruckig
from hypothesis import given, settings
from hypothesis import strategies as st

import armsight
from armsight.motion.timing import distinct, rounded, time_parameterise
from armsight.motion.trajectory import (
    Trajectory,
    hold,
    join,
    stop_trajectory,
    stopping_at_corners,
    straight,
)
from armsight.robots import ROBOT_NAMES, load_robot
from armsight.robots.robot import JointLimits

EXAMPLES = settings(max_examples=60, deadline=None, derandomize=True)


def limits(n: int, v: float = 1.5, a: float = 4.0, j: float = 60.0) -> JointLimits:
    return JointLimits(*(np.full(n, x) for x in (-6.0, 6.0, v, a, j)))


def uneven(rng: np.random.Generator, n: int) -> JointLimits:
    return JointLimits(
        np.full(n, -6.0),
        np.full(n, 6.0),
        rng.uniform(0.5, 3.0, n),
        rng.uniform(1.0, 15.0, n),
        rng.uniform(20.0, 800.0, n),
    )


def assert_sound(t: Trajectory, lim: JointLimits, brakes: bool = False) -> None:
    """Limits, continuity and consistency, all from dense samples and finite differences."""
    speed, acceleration, jerk = t.peak()
    if not brakes:
        assert (speed <= lim.velocity * (1 + 1e-6)).all()
    assert (acceleration <= lim.acceleration * (1 + 1e-6)).all()
    assert (jerk <= lim.jerk * (1 + 1e-6)).all()
    h = 1e-5
    for s in np.linspace(0.0, t.duration, 97)[1:-1]:
        v = (t.position(s + h) - t.position(s - h)) / (2 * h)
        a = (t.velocity(s + h) - t.velocity(s - h)) / (2 * h)
        np.testing.assert_allclose(v, t.velocity(s), atol=1e-3 * lim.jerk.max() * h + 1e-6)
        np.testing.assert_allclose(a, t.acceleration(s), atol=lim.jerk.max() * h)
        assert (np.abs(t.velocity(s)) <= speed + 1e-9).all()
        assert (np.abs(t.acceleration(s)) <= acceleration + 1e-9).all()
    # Pieces join: the end of each by its own polynomial is the beginning of the next.
    dt = np.diff(t.times)[:, None]
    np.testing.assert_allclose(
        t.q[:-1] + dt * (t.qd[:-1] + dt * (t.qdd[:-1] / 2 + dt * t.jerk / 6)), t.q[1:], atol=1e-7
    )
    np.testing.assert_allclose(t.qd[:-1] + dt * (t.qdd[:-1] + dt * t.jerk / 2), t.qd[1:], atol=1e-7)
    np.testing.assert_allclose(t.qdd[:-1] + dt * t.jerk, t.qdd[1:], atol=1e-6)


def assert_at_rest(t: Trajectory) -> None:
    for s in (0.0, t.duration):
        np.testing.assert_allclose(t.velocity(s), 0.0, atol=1e-9)
        np.testing.assert_allclose(t.acceleration(s), 0.0, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(2, 9), st.floats(0.02, 1.0))
@EXAMPLES
def test_limits_hold_on_any_path(seed, points, scale):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    lim = uneven(rng, n)
    path = np.cumsum(rng.normal(0, scale, (points, n)), axis=0)
    t = time_parameterise(path, lim)
    assert_sound(t, lim)
    assert_at_rest(t)
    np.testing.assert_allclose(t.position(0.0), path[0], atol=1e-9)
    np.testing.assert_allclose(t.position(t.duration), path[-1], atol=1e-9)
    np.testing.assert_array_equal(t.position(-1.0), t.position(0.0))
    np.testing.assert_array_equal(t.position(t.duration + 1.0), t.end)
    assert t.duration <= stopping_at_corners(distinct(path), lim).duration + 1e-9


def test_rounding_is_worth_it():
    rng = np.random.default_rng(0)
    lim = limits(6)
    ratio = []
    for _ in range(20):
        path = np.cumsum(rng.normal(0, 0.5, (5, 6)), axis=0)
        ratio.append(
            time_parameterise(path, lim).duration / stopping_at_corners(path, lim).duration
        )
    assert np.median(ratio) < 0.8


def test_stopping_at_corners_stays_on_the_path():
    path = np.cumsum(np.random.default_rng(1).normal(0, 0.5, (5, 6)), axis=0)
    t = stopping_at_corners(path, limits(6))
    assert_sound(t, limits(6))
    for q in t.sample(np.linspace(0, t.duration, 300)):
        gap = []
        for a, b in pairwise(path):
            s = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            gap.append(np.linalg.norm(a + s * (b - a) - q))
        assert min(gap) < 1e-8


@pytest.mark.parametrize("size", [1e-4, 0.01, 0.2, 1.0, 4.0])
def test_straight_lines_take_ruckigs_time(size):
    n = 3
    lim = limits(n)
    goal = size * np.array([1.0, -0.5, 0.2])
    otg, given_, out = ruckig.Ruckig(n), ruckig.InputParameter(n), ruckig.Trajectory(n)
    given_.current_position, given_.target_position = [0.0] * n, goal.tolist()
    given_.current_velocity = given_.current_acceleration = [0.0] * n
    given_.target_velocity = given_.target_acceleration = [0.0] * n
    given_.max_velocity, given_.max_acceleration, given_.max_jerk = [1.5] * n, [4.0] * n, [60.0] * n
    assert otg.calculate(given_, out) == ruckig.Result.Working
    t = straight(np.zeros(n), goal, lim)
    assert t.duration == pytest.approx(out.duration, rel=1e-6)
    assert_sound(t, lim)


def test_tiny_and_repeated_waypoints():
    lim = limits(2)
    a, b = np.zeros(2), np.array([0.5, 0.2])
    assert time_parameterise(np.stack([a, a]), lim).duration == 0.0
    np.testing.assert_array_equal(time_parameterise(a[None], lim).position(3.0), a)
    doubled = time_parameterise(np.stack([a, a, b, b, b]), lim)
    assert doubled.duration == pytest.approx(straight(a, b, lim).duration)
    np.testing.assert_array_equal(doubled.end, b)
    back = time_parameterise(np.stack([a, b, a]), lim)  # a corner of half a turn
    assert_sound(back, lim)
    np.testing.assert_allclose(back.end, a, atol=1e-12)


def test_a_blocked_corner_is_made_tighter_and_in_the_end_rested_at():
    lim = limits(2)
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])

    def tell(room):
        def blocked(t):
            times = np.linspace(0, t.duration, 400)
            q = t.sample(times)
            gap = np.minimum(
                np.abs(q[:, 1]) + np.maximum(q[:, 0] - 1, 0),
                np.abs(q[:, 0] - 1) + np.maximum(-q[:, 1], 0),
            )
            return float(times[np.argmax(gap)]) if gap.max() > room else None

        return blocked

    free = time_parameterise(path, lim)
    tight = time_parameterise(path, lim, tell(0.02))
    rest = time_parameterise(path, lim, tell(1e-7))
    assert tell(0.02)(free) is not None
    assert tell(0.02)(tight) is None
    assert tell(1e-7)(rest) is None
    assert free.duration < tight.duration < rest.duration
    assert rest.duration == pytest.approx(stopping_at_corners(path, lim).duration)
    for t in (free, tight, rest):
        assert_sound(t, lim)


def test_only_the_corner_that_needs_it_is_rested_at():
    lim = limits(2)
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    t = rounded(path, np.array([0.0, 0.3, 0.0, 0.0]), lim)
    speed = np.linalg.norm([t.velocity(s) for s in np.linspace(0, t.duration, 2000)], axis=1)
    at = t.sample(np.linspace(0, t.duration, 2000))
    assert speed[np.argmin(np.linalg.norm(at - path[2], axis=1))] < 0.02
    assert speed[np.argmin(np.linalg.norm(at - path[1], axis=1))] > 0.3


@given(st.integers(0, 2**32 - 1), st.booleans())
@EXAMPLES
def test_stops_are_sound_and_as_short_as_ruckigs(seed, accelerating):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    lim = uneven(rng, n)
    q, qd = rng.normal(0, 1, n), rng.uniform(-1, 1, n) * lim.velocity
    qdd = rng.uniform(-1, 1, n) * lim.acceleration if accelerating else np.zeros(n)
    t = stop_trajectory(q, qd, lim, qdd)
    assert_sound(t, lim, brakes=True)
    np.testing.assert_allclose(t.position(0.0), q)
    np.testing.assert_allclose(t.velocity(0.0), qd)
    np.testing.assert_allclose(t.acceleration(0.0), qdd)
    np.testing.assert_allclose(t.velocity(t.duration), 0.0, atol=1e-9)

    given_, out = ruckig.InputParameter(n), ruckig.Trajectory(n)
    given_.control_interface = ruckig.ControlInterface.Velocity
    given_.synchronization = ruckig.Synchronization.No
    given_.current_position = q.tolist()
    given_.current_velocity, given_.current_acceleration = qd.tolist(), qdd.tolist()
    given_.target_velocity = given_.target_acceleration = [0.0] * n
    given_.max_velocity = (10 * lim.velocity).tolist()
    given_.max_acceleration, given_.max_jerk = lim.acceleration.tolist(), lim.jerk.tolist()
    assert ruckig.Ruckig(n).calculate(given_, out) == ruckig.Result.Working
    assert t.duration == pytest.approx(out.duration, rel=1e-6, abs=1e-9)
    np.testing.assert_allclose(t.end, out.at_time(out.duration)[0], atol=1e-6)


def test_a_stop_at_rest_is_no_motion():
    t = stop_trajectory(np.ones(3), np.zeros(3), limits(3))
    assert t.duration == 0.0
    np.testing.assert_array_equal(t.position(1.0), np.ones(3))
    np.testing.assert_array_equal(t.velocity(1.0), np.zeros(3))


def test_slower_is_the_same_path():
    path = np.cumsum(np.random.default_rng(2).normal(0, 0.5, (4, 6)), axis=0)
    t = time_parameterise(path, limits(6))
    slow = t.slowed(3.0)
    assert slow.duration == pytest.approx(3 * t.duration)
    for s in np.linspace(0, t.duration, 20):
        np.testing.assert_allclose(slow.position(3 * s), t.position(s), atol=1e-12)
        np.testing.assert_allclose(3 * slow.velocity(3 * s), t.velocity(s), atol=1e-12)
    assert_sound(slow, limits(6))


def test_joined_motions_and_samples():
    lim = limits(2)
    a, b, c = np.zeros(2), np.array([0.5, 0.0]), np.array([0.5, 0.5])
    t = join([straight(a, b, lim), hold(b), straight(b, c, lim)])
    assert_sound(t, lim)
    times = np.linspace(-0.5, t.duration + 0.5, 50)
    np.testing.assert_allclose(t.sample(times), [t.position(s) for s in times], atol=1e-12)
    np.testing.assert_array_equal(hold(a).sample(np.zeros(3)), np.zeros((3, 2)))


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_limits_of_every_arm(name):
    robot = load_robot(name)
    lim = robot.limits.scaled(0.5, 0.6)
    rng = np.random.default_rng(0)
    path = rng.uniform(0.5 * robot.limits.lower, 0.5 * robot.limits.upper, (5, robot.n))
    t = time_parameterise(path, lim)
    assert_sound(t, lim)
    assert_at_rest(t)


def test_ruckig_is_never_given_intermediate_waypoints():
    """Its community edition would send them to a web service."""
    for file in Path(armsight.__file__).parent.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"intermediate_positions|per_section|filter_intermediate", text), file
