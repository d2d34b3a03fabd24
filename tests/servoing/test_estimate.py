"""One filter over all sensors: late pictures, biases, teleports, prediction."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.servoing.estimate import FilterConfig, TargetFilter
from armsight.servoing.sighting import Look, Sighting

CAMERAS = ("a", "b", "wrist")


def look(camera, stamp, place, sigma=0.002, mark=None, normal=None, lasting=0.0):
    place = np.asarray(place, float)
    wrist, R = camera == "wrist", sigma**2 * np.eye(3)
    seen = Sighting("ball", camera, stamp, place, R, place, normal, wrist, lasting=lasting)
    return Look(camera, stamp, wrist, np.eye(4), (seen,), mark, 0.0005**2 * np.eye(3))


def filter_(**settings):
    return TargetFilter(CAMERAS, "wrist", FilterConfig(**settings))


def test_measurements_that_come_late_count_as_if_they_had_come_in_order():
    rng = np.random.default_rng(0)
    stamps = np.sort(rng.uniform(0, 1.0, 30))
    looks = [
        look(CAMERAS[i % 3], t, np.array([0.3 * t, 0.1, 0.2]) + rng.normal(0, 0.002, 3))
        for i, t in enumerate(stamps)
    ]
    ordered, late = filter_(memory=2.0), filter_(memory=2.0)
    for one in looks:
        ordered.add(one)
    shuffled = [looks[0], *sorted(looks[1:], key=lambda one: one.stamp + rng.uniform(0, 0.12))]
    for one in shuffled:
        late.add(one)
    a, b = ordered.estimate, late.estimate
    assert a is not None
    assert b is not None
    assert np.allclose(a.position, b.position, atol=1e-9)
    assert np.allclose(a.covariance, b.covariance, atol=1e-12)
    assert np.allclose(ordered.bias("b"), late.bias("b"), atol=1e-9)


def test_biased_cameras_and_a_good_pair_nothing_jumps_when_the_pair_comes_in():
    """The pair is 10 mm away from what the fixed cameras say; V's choice would jump by as much."""
    rng = np.random.default_rng(1)
    bias = {"a": np.array([0.015, 0, 0.004]), "b": np.array([0.004, 0.010, -0.006])}
    filter_one, t, before = filter_(), 0.0, None
    jumps = []
    for k in range(120):
        t = 0.04 * k
        camera = ("a", "b")[k % 2] if k < 60 or k % 2 else "wrist"
        truth = np.array([0.7, 0.0, 0.8])
        noise = 0.0003 if camera == "wrist" else 0.001
        place = truth + bias.get(camera, np.zeros(3)) + rng.normal(0, noise, 3)
        filter_one.add(look(camera, t, place, noise))
        now = filter_one.estimate.position
        if before is not None and k > 70:
            jumps.append(np.linalg.norm(now - before))
        before = now
    assert np.linalg.norm(before - truth) < 0.004
    assert np.percentile(jumps, 95) < 0.002
    for name, value in bias.items():
        assert np.linalg.norm(filter_one.bias(name) - value) < 0.006


def test_the_mark_on_the_tool_tells_the_pairs_own_error():
    """Pair off by 6 mm; the mark, seen off by as much, puts the target where the joints are."""
    off, truth = np.array([0.004, -0.003, 0.0033]), np.array([0.7, 0.0, 0.8])
    with_mark, without = filter_(), filter_()
    for k in range(30):
        with_mark.add(look("wrist", 0.1 * k, truth + off, 0.0005, mark=off))
        without.add(look("wrist", 0.1 * k, truth + off, 0.0005))
    assert np.linalg.norm(with_mark.estimate.position - truth) < 0.002
    assert np.linalg.norm(without.estimate.position - truth) > 0.004


def test_a_pair_that_sees_a_part_says_how_it_moves_and_not_where_it_is():
    """Half a face is 25 mm off, in all of its pictures: as random error it made the filter slow."""
    rng = np.random.default_rng(3)
    off, mark = np.array([0.015, -0.02, 0.0]), np.array([0.003, 0.0, -0.002])

    def path(t):
        return np.array([0.7, 0.03 * np.sin(3.0 * t), 0.8 + 0.02 * np.cos(2.0 * t)])

    def fed(lasting, sigma):
        one, behind = filter_(), []
        for k in range(60):
            t, half = 0.1 * k, 20 <= k < 50
            place = path(t) + mark + half * off + rng.normal(0.0, 0.0005, 3)
            own = {"lasting": lasting, "sigma": sigma} if half else {"sigma": 0.001}
            one.add(look("wrist", t, place, mark=mark, **own))
            if k > 10:
                behind.append(np.linalg.norm(one.estimate.at(t + 0.1)[0] - path(t + 0.1)))
        return np.array(behind)

    shared, random = fed(0.02, 0.001), fed(0.0, 0.02)
    assert shared.max() < 0.015 < 0.04 < random.max()
    assert shared[41] < 0.005  # it is seen whole again: what was learned of the part is forgotten


def test_a_tracker_s_jump_is_refused_and_a_target_that_was_carried_away_is_found_again():
    f = filter_()
    for k in range(20):
        f.add(look("a", 0.1 * k, (0.7, 0, 0.8)))
    assert not f.add(look("a", 2.0, (0.7, 0.4, 0.8)))
    assert np.linalg.norm(f.estimate.position - (0.7, 0, 0.8)) < 0.005
    assert not f.add(look("b", 2.05, (0.7, 0.4, 0.8)))
    assert f.add(look("a", 2.1, (0.7, 0.4, 0.8)))
    assert np.linalg.norm(f.estimate.position - (0.7, 0.4, 0.8)) < 0.02
    assert f.restarts == 1


def test_velocity_is_found_and_its_prediction_dies_away():
    f = filter_(horizon=0.5)
    for k in range(40):
        t = 0.05 * k
        f.add(look("ab"[k % 2], t, (0.5 + 0.2 * t, 0.0, 0.8)))
    e = f.estimate
    assert e.velocity[0] == pytest.approx(0.2, abs=0.03)
    at, v = e.at(e.stamp + 0.1)
    assert at[0] - e.position[0] == pytest.approx(0.1 * 0.2, abs=0.004)
    assert v[0] == pytest.approx(e.velocity[0] * np.exp(-0.2), abs=0.02)
    step = 1e-5
    ahead, speed = e.at(e.stamp + 0.2)
    later, _ = e.at(e.stamp + 0.2 + step)
    assert np.allclose((later - ahead) / step, speed, atol=0.02)
    _, stands = e.at(e.stamp + 60.0)
    assert np.linalg.norm(stands) < 0.05


def test_of_two_that_look_alike_the_expected_one_is_taken():
    f = filter_()
    for k in range(10):
        f.add(look("a", 0.1 * k, (0.7, 0, 0.8)))
    other, right = look("a", 1.0, (0.7, 0.5, 0.8)), look("a", 1.0, (0.701, 0, 0.8))
    both = Look("a", 1.0, False, np.eye(4), (*other.sightings, *right.sightings))
    assert f.add(both)
    assert np.linalg.norm(f.estimate.position - (0.7, 0, 0.8)) < 0.005


def test_covariance_covers_the_error():
    """Normalised error squared, 3 dimensions, of 60 seeded targets that move as one mode says."""
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        f = filter_(acceleration=(0.3,), damping=(0.5,), jerk=(0.0,))
        p, v, dt = np.array([0.7, 0, 0.8]), np.zeros(3), 0.01
        bias = {c: rng.normal(0, 0.004 if c == "wrist" else 0.012, 3) for c in CAMERAS}
        for k in range(200):
            p = p + v * dt
            v = v * np.exp(-dt / 0.5) + rng.normal(0, 0.3 * np.sqrt(dt), 3)
            if k % 5 == 0:
                camera = CAMERAS[(k // 5) % 3]
                floor = f.config.floor_wrist if camera == "wrist" else f.config.floor_fixed
                sigma = np.hypot(0.001, floor)
                f.add(look(camera, k * dt, p + bias[camera] + rng.normal(0, sigma, 3), 0.001))
            if k == 195:
                e = f.estimate
                error = p - e.position
                squares.append(error @ np.linalg.solve(e.covariance[:3, :3], error))
    assert 2.0 < np.mean(squares) < 4.5


def test_modes_follow_what_the_target_does():
    """At rest the first mode is the likeliest; on a circle one of the others."""
    rng = np.random.default_rng(3)
    f = filter_()
    resting, turning = [], []
    for k in range(240):
        t = 0.05 * k
        w = max(t - 6.0, 0.0) * 2.0
        place = np.array([0.7, 0.1 * np.sin(w), 0.8 + 0.1 * (1 - np.cos(w))])
        f.add(look("ab"[k % 2], t, place + rng.normal(0, 0.001, 3), 0.001))
        if 3 < t < 6:
            resting.append(f.estimate.modes)
        if t > 8:
            turning.append(f.estimate.modes)
    assert np.mean(resting, axis=0)[0] > 0.5
    assert np.mean(turning, axis=0)[0] < 0.1
    assert np.allclose(np.sum(turning, axis=1), 1.0)


def test_hostile_stamps_and_unknown_cameras_change_nothing():
    f = filter_()
    f.add(look("a", 1.0, (0.7, 0, 0.8)))
    before = f.estimate
    assert not f.add(look("nobody", 1.1, (0, 0, 0)))
    assert not f.add(look("a", float("nan"), (0, 0, 0)))
    assert not f.add(look("a", 0.2, (0, 0, 0)))
    assert np.array_equal(f.estimate.position, before.position)
