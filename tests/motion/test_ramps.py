"""Ramps of commanded velocities: every limit, tick by tick, whatever is asked; and no overshoot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.motion.ramp_kernels import acceleration_towards, ramp, stop_extent
from armsight.motion.steering import END_ROOM

DT = 0.008


def twin_extent(v, a, most, jerk, dt):
    """Oracle: the stop played with plain numbers, each tick's best acceleration by bisection."""
    x = high = low = 0.0
    for _ in range(5000):
        if abs(v) < 1e-9 and abs(a) < 1e-9:
            break
        before = v
        a = twin_acceleration(v, a, 0.0, most, jerk, dt)
        v += a * dt
        high = max(high, x + max(before, v, 0.0) * dt)
        low = min(low, x + min(before, v, 0.0) * dt)
        x += v * dt
    return high, -low


def twin_acceleration(v, a, target, most, jerk, dt):
    """Oracle: the greatest acceleration that can be let go in time, found by halving."""
    way = 1.0 if target >= v else -1.0

    def passes(b):
        """Whether the velocity passes the target if b is let go of by the jerk from now on."""
        speed = v
        while b > 0.0:
            speed += way * b * dt
            b -= jerk * dt
        return way * (speed - target) > 1e-12

    low, high = 0.0, most
    if passes(high):
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if passes(middle) else (middle, high)
        high = low
    return float(np.clip(way * high, a - jerk * dt, a + jerk * dt))


@settings(max_examples=150, deadline=None)
@given(
    v=st.floats(-2, 2), a=st.floats(-1, 1), target=st.floats(-2, 2),
    most=st.floats(0.5, 8), jerk=st.floats(5, 100),
)  # fmt: skip
def test_the_best_acceleration_is_that_of_the_oracle(v, a, target, most, jerk):
    a *= most
    found = acceleration_towards(v, a, target, most, jerk, DT, DT)
    assert found == pytest.approx(twin_acceleration(v, a, target, most, jerk, DT), abs=1e-6)
    assert abs(found) <= most + 1e-9
    assert abs(found - a) <= jerk * DT + 1e-9


@settings(max_examples=60, deadline=None)
@given(v=st.floats(-2, 2), a=st.floats(-1, 1), most=st.floats(0.5, 8), jerk=st.floats(10, 100))
def test_the_extent_of_a_stop_is_that_of_the_oracle(v, a, most, jerk):
    found = stop_extent(v, a * most, most, jerk, DT)
    assert found == pytest.approx(twin_extent(v, a * most, most, jerk, DT), abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(v=st.floats(-2, 2), target=st.floats(-2, 2), most=st.floats(0.5, 8), jerk=st.floats(5, 100))
def test_a_target_is_reached_without_passing_it(v, target, most, jerk):
    a, way, last = 0.0, np.sign(target - v), v
    for _ in range(3000):
        a = acceleration_towards(v, a, target, most, jerk, DT, DT)
        v += a * DT
        assert way * (v - target) <= 1e-9
        assert way * (v - last) >= -1e-9
        last = v
    assert v == pytest.approx(target, abs=1e-6)


def drive(ticks, seed, late=0.2):
    """Random wishes, a share of odd tick lengths, an arm that follows its commands exactly."""
    rng = np.random.default_rng(seed)
    n = 6
    lower, upper = np.full(n, -0.6), np.full(n, 0.6)
    speed, most, jerk = np.full(n, 1.5), np.full(n, 3.0), np.full(n, 60.0)
    q, v, a = np.zeros(n), np.zeros(n), np.zeros(n)
    target = np.zeros(n)
    worst = np.zeros(4)
    for k in range(ticks):
        if k % 25 == 0:
            target = rng.normal(size=n) * rng.choice([0.0, 0.3, 3.0])
        dt = DT if rng.random() >= late else rng.uniform(0.0005, DT)
        command = ramp(target, q, v, a, lower, upper, speed, most, jerk, dt, DT)
        rate = (command - v) / dt
        worst = np.maximum(
            worst,
            [
                (np.abs(command) / speed).max(),
                (np.abs(rate) / most).max(),
                (np.abs(rate - a) / dt / jerk).max(),
                np.maximum(q - upper, lower - q).max(),
            ],
        )
        q = q + dt * command  # the drives are there at once: the worst case for the end of travel
        v, a = command, rate
    return worst


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_limits_hold_over_random_wishes(late):
    speed, acceleration, jerk, beyond = drive(8000, 0, late)
    assert speed <= 1.0 + 1e-9
    assert acceleration <= 1.0 + 1e-9
    assert jerk <= 1.0 + 1e-6
    # A stop is played in whole periods; where ticks are shorter it is exact to a milliradian.
    assert beyond <= (0.2 * END_ROOM if late else 1e-9)


@pytest.mark.slow
def test_limits_hold_over_a_million_ticks():
    for seed in range(5):
        speed, acceleration, jerk, beyond = drive(100_000, seed, late=0.0)
        assert speed <= 1.0 + 1e-9
        assert acceleration <= 1.0 + 1e-9
        assert jerk <= 1.0 + 1e-6
        assert beyond <= 1e-9
    for seed in range(5):
        speed, acceleration, jerk, beyond = drive(100_000, seed)
        assert speed <= 1.0 + 1e-9
        assert acceleration <= 1.0 + 1e-9
        assert jerk <= 1.0 + 1e-6
        assert beyond <= 0.4 * END_ROOM


def test_from_rest_the_direction_is_kept():
    """Joints that have less to change go slower: a straight line stays one."""
    target = np.array([1.0, -0.4, 0.1, 0.0, 0.7, -0.9])
    n, q, v, a = 6, np.zeros(6), np.zeros(6), np.zeros(6)
    for _ in range(200):
        command = ramp(
            target, q, v, a, np.full(n, -9.0), np.full(n, 9.0), np.full(n, 2.0), np.full(n, 3.0),
            np.full(n, 60.0), DT, DT,
        )  # fmt: skip
        a, v = (command - v) / DT, command
        share = command @ target / (target @ target)
        assert np.abs(command - share * target).max() <= 0.02
    assert v == pytest.approx(target, abs=1e-6)
