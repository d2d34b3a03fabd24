"""Calibration with the plug as the marker, on looks whose truth is known."""

import numpy as np
import pytest

from armsight.calibration.arm import flange_poses
from armsight.calibration.robot_errors import RobotErrors
from armsight.charging.calibrate import (
    PlugLook,
    calibrate_by_plug,
    choose_looks,
    closed_form,
)
from armsight.errors import CalibrationError
from armsight.geometry.pose import angle_between, exp, from_rpy, inverse, look_at, make_pose
from armsight.robots.catalogue import load_robot

ROBOT = load_robot("ur10")
X = look_at([1.5, 0.1, 0.8], [0.6, 0.0, 0.5])
Z = make_pose(from_rpy((0.05, -0.03, 0.1))[:3, :3], (0.01, -0.02, 0.2))
SIGMA = np.array([1e-4, 1e-4, 2e-4, 4e-3, 4e-3, 2e-3])


def _looks(n, rng, noise=1.0, theta=None, spread=0.5):
    errors = RobotErrors(ROBOT)
    theta = np.zeros(errors.size) if theta is None else theta
    joints = ROBOT.home + rng.uniform(-spread, spread, (n, 6))
    T = inverse(X) @ errors.flange_poses(joints, theta)[0] @ Z
    return [
        PlugLook(q, t @ exp(noise * SIGMA * rng.standard_normal(6)), np.diag(SIGMA**2))
        for q, t in zip(joints, T)
    ]


def test_without_noise_both_ways_are_exact() -> None:
    rng = np.random.default_rng(0)
    looks = _looks(10, rng, noise=0.0)
    for camera, plug in (
        closed_form(ROBOT, looks),
        (lambda a: (a.T_base_camera, a.T_flange_plug))(calibrate_by_plug(ROBOT, looks, rng)),
    ):
        assert np.allclose(camera, X, atol=1e-6)
        assert np.allclose(plug, Z, atol=1e-6)


def test_the_bundle_beats_the_closed_form_and_states_its_error() -> None:
    """Over seeds: smaller error with unequal looks, and within the stated spread."""
    ratio, better = [], 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        theta = RobotErrors(ROBOT).sigma * rng.standard_normal(RobotErrors(ROBOT).size)
        looks = _looks(20, rng, theta=theta)
        answer = calibrate_by_plug(ROBOT, looks, rng)
        X_closed, Z_closed = closed_form(ROBOT, looks)
        q = ROBOT.home + rng.uniform(-0.4, 0.4, (12, 6))
        truth = RobotErrors(ROBOT).flange_poses(q, theta)[0] @ Z
        C = inverse(X) @ truth
        ours = np.array([answer.base_tip(j)[:3, 3] for j in q])
        ours -= (answer.T_base_camera @ C)[:, :3, 3]
        theirs = (flange_poses(ROBOT, q) @ Z_closed)[:, :3, 3] - (X_closed @ C)[:, :3, 3]
        a, b = np.sqrt(np.mean(np.sum(ours**2, 1))), np.sqrt(np.mean(np.sum(theirs**2, 1)))
        better += a < b
        ratio.append(a / np.sqrt(np.mean([answer.tip_sigma(j) ** 2 for j in q])))
    assert better >= 11
    assert 0.6 < np.sqrt(np.mean(np.square(ratio))) < 1.6


def test_wrong_rolls_are_left_out() -> None:
    rng = np.random.default_rng(3)
    looks = _looks(15, rng)
    for i in (2, 9, 11):
        turned = looks[i].T_camera_plug @ exp(np.array([0, 0, 0, 0, 0, np.pi / 3]))
        looks[i] = PlugLook(looks[i].joints, turned, looks[i].covariance)
    answer = calibrate_by_plug(ROBOT, looks, rng)
    assert np.flatnonzero(~answer.used).tolist() == [2, 9, 11]
    assert np.linalg.norm(answer.T_base_camera[:3, 3] - X[:3, 3]) < 0.02
    assert angle_between(answer.T_flange_plug, Z) < np.deg2rad(1)


def test_degenerate_sets_are_refused() -> None:
    rng = np.random.default_rng(4)
    with pytest.raises(CalibrationError, match="3 looks; at least 6"):
        calibrate_by_plug(ROBOT, _looks(3, rng), rng)
    one_axis = [
        PlugLook(ROBOT.home + np.array([0, 0, 0, 0, 0, a]), np.eye(4), np.diag(SIGMA**2))
        for a in np.linspace(-1, 1, 9)
    ]
    with pytest.raises(CalibrationError, match="about one axis only"):
        closed_form(ROBOT, one_axis)
    with pytest.raises(CalibrationError, match="0 looks"):
        calibrate_by_plug(ROBOT, [], rng)


def test_looks_that_contradict_each_other_are_refused() -> None:
    rng = np.random.default_rng(5)
    looks = [
        PlugLook(look.joints, exp(rng.normal(0, 0.7, 6)), look.covariance)
        for look in _looks(12, rng)
    ]
    with pytest.raises(CalibrationError, match="looks agree"):
        calibrate_by_plug(ROBOT, looks, rng)


def test_chosen_looks_tell_more_than_random_ones() -> None:
    rng = np.random.default_rng(6)
    answer = calibrate_by_plug(ROBOT, _looks(8, rng), rng)
    pool = _looks(60, rng, noise=0.0, spread=0.6)
    joints = np.array([p.joints for p in pool])
    C = np.array([p.T_camera_plug for p in pool])
    noise = np.tile(np.diag(SIGMA**2), (60, 1, 1))
    goals = ROBOT.home + rng.uniform(-0.4, 0.4, (8, 6))
    chosen = choose_looks(answer, joints, C, noise, goals, 10)
    assert len(set(chosen)) == 10

    def sigma(indices):
        looks = [PlugLook(joints[i], C[i], noise[i]) for i in indices]
        got = calibrate_by_plug(ROBOT, looks, np.random.default_rng(0))
        return np.mean([got.tip_sigma(q) for q in goals])

    random = np.mean([sigma(rng.choice(60, 10, replace=False)) for _ in range(6)])
    assert sigma(chosen) < 0.95 * random


def test_the_next_look_tells_most_per_second() -> None:
    """Equal times: the one that a choice of one would be. Else one after another, by their worth:
    half of the time for what tells a third of it more."""
    rng = np.random.default_rng(6)
    taken = _looks(8, rng)
    answer = calibrate_by_plug(ROBOT, taken, rng)
    pool = _looks(12, rng, noise=0.0, spread=0.6)
    joints = np.array([p.joints for p in pool])
    C = np.array([p.T_camera_plug for p in pool])
    noise = np.tile(np.diag(SIGMA**2), (12, 1, 1))
    goals = ROBOT.home + rng.uniform(-0.4, 0.4, (8, 6))
    equal = np.full(12, 3.0)

    def next_look(seconds: np.ndarray) -> int:
        return choose_looks(answer, joints, C, noise, goals, 1, taken, seconds)[0]

    best = next_look(equal)
    assert [best] == choose_looks(answer, joints, C, noise, goals, 1, taken)

    def variance(looks: list[PlugLook]) -> float:
        """By the bundle itself: the mean of the tip's variance at the goals."""
        got = calibrate_by_plug(ROBOT, looks, np.random.default_rng(0))
        return float(np.mean([got.tip_sigma(q) ** 2 for q in goals]))

    before = variance(taken)
    told = [np.log(before / variance([*taken, PlugLook(joints[i], C[i], noise[i])]))
            for i in range(12)]  # fmt: skip
    assert told[best] > 0.9 * max(told)
    worst = int(np.argmin(told))
    seconds = equal.copy()
    seconds[worst] = 0.5 * equal[0] * told[worst] / told[best]
    assert next_look(seconds) == worst
    seconds[worst] = 2.0 * equal[0] * told[worst] / told[best]
    assert next_look(seconds) != worst
