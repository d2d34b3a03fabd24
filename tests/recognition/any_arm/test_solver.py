"""The fit of an arm to its landmarks, on arms whose pose and joints are known."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import inverse, look_at, make_pose
from armsight.recognition.any_arm import kernels
from armsight.recognition.any_arm.landmarks import find_landmarks
from armsight.recognition.any_arm.solver import (
    ALIKE,
    Observations,
    far_starts,
    solve,
    unlike,
)
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses


def _scene(name: str, seed: int, sigma: float):
    """A robot before a camera, and its landmarks as they are seen with an error of sigma."""
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    marks = find_landmarks(robot)
    lower, upper = (np.clip(v, -2.0, 2.0) for v in (robot.limits.lower, robot.limits.upper))
    q = rng.uniform(lower, upper)
    eye = 1.8 * np.array([np.cos(seed), np.sin(seed), rng.uniform(0.1, 0.6)])
    T = inverse(look_at(eye, (0.0, 0.0, 0.3)))
    points = marks.placed(T @ link_poses(robot, q))
    at = points[:, :2] / points[:, 2:] + rng.normal(0.0, sigma, (len(points), 2))
    covariance = np.tile(np.eye(2) * max(sigma, 2e-4) ** 2, (len(at), 1, 1))
    seen = Observations(marks.link, marks.point, at, covariance, np.ones(len(at)))
    return robot, marks, seen, T, q


@pytest.mark.parametrize("name", ["ur5", "iiwa", "panda"])
def test_an_arm_is_found_without_a_start(name: str) -> None:
    errors = []
    for seed in range(8):
        robot, marks, seen, T, q = _scene(name, seed, 0.0)
        fit = solve(robot, marks, seen)[0]
        true = (T @ link_poses(robot, q))[1:, :3, 3]
        errors.append(float(np.linalg.norm(fit.joints() - true, axis=1).mean()))
        assert (fit.q > robot.limits.lower - 0.1).all()
        assert (fit.q < robot.limits.upper + 0.1).all()
    assert np.median(errors) < 0.005
    assert (np.array(errors) < 0.05).sum() >= 7


def test_answers_differ_and_the_best_comes_first() -> None:
    robot, marks, seen, _, _ = _scene("ur5", 3, 0.004)
    fits = solve(robot, marks, seen)
    assert [fit.cost for fit in fits] == sorted(fit.cost for fit in fits)
    for k, fit in enumerate(fits):
        for other in fits[:k]:
            assert np.linalg.norm(fit.joints() - other.joints(), axis=1).max() > ALIKE
    assert len(unlike([fits[0], fits[0]])) == 1


def test_an_arm_that_is_called_as_another_is_searched_for_in_its_own_shapes() -> None:
    """What was remembered of a robot went by its name."""
    robot, marks, seen, T, q = _scene("ur3", 1, 0.0)
    solve(*_scene("ur10", 1, 0.0)[:3])
    alias = replace(robot, name="ur10")
    fit = solve(alias, marks, seen)[0]
    true = (T @ link_poses(robot, q))[1:, :3, 3]
    assert float(np.linalg.norm(fit.joints() - true, axis=1).mean()) < 0.02
    other = far_starts(robot, marks, seen)
    for a, b in zip(far_starts(alias, marks, seen), other, strict=True):
        np.testing.assert_array_equal(a[2], b[2])


def test_the_covariance_is_of_the_size_of_the_error() -> None:
    squares = []
    for seed in range(14):
        robot, marks, seen, T, q = _scene("ur5", seed, 2e-3)
        fit = solve(robot, marks, seen)[0]
        true = (T @ link_poses(robot, q))[1:, :3, 3]
        away = fit.joints() - true
        if np.linalg.norm(away, axis=1).mean() > 0.1:
            continue  # another configuration that looks the same: no matter of a covariance
        C = fit.joint_covariances()[1:5]
        squares += list(np.einsum("ni,nij,nj->n", away[1:5], np.linalg.inv(C), away[1:5]))
    assert len(squares) >= 36
    # Of chi squared with three degrees of freedom the median is 2.4, and 90 % are below 6.3.
    assert 0.8 < np.median(squares) < 5.0
    assert np.mean(np.array(squares) < 6.25) > 0.7


def test_one_landmark_far_off_does_little() -> None:
    robot, marks, seen, T, q = _scene("panda", 3, 0.0)
    at = seen.at.copy()
    at[5] += 0.2
    fit = solve(robot, marks, Observations(seen.link, seen.point, at, seen.covariance, seen.far))[0]
    true = (T @ link_poses(robot, q))[1:, :3, 3]
    assert np.linalg.norm(fit.joints() - true, axis=1).mean() < 0.01


def test_too_little_is_no_answer() -> None:
    robot, marks, seen, _, _ = _scene("ur5", 0, 0.0)
    few = np.zeros(len(seen.at))
    few[:4] = 1.0
    given = Observations(seen.link, seen.point, seen.at, seen.covariance, few)
    assert solve(robot, marks, given) == []


def test_the_search_from_far_is_least_squares() -> None:
    rng = np.random.default_rng(5)
    shapes = rng.normal(size=(3, 9, 3)).astype(np.float32)
    frames = np.linalg.qr(rng.normal(size=(4, 3, 3)))[0].astype(np.float32)
    at = rng.normal(size=(9, 2)).astype(np.float32)
    weight = rng.uniform(0.5, 2.0, 9).astype(np.float32)
    cost, found = np.empty(3, np.float32), np.empty((3, 5), np.float32)
    kernels.weak_perspective(shapes, frames, at, weight, cost, found)
    for i in range(3):
        costs = []
        for f in frames.astype(float):
            a = shapes[i] @ f[:2].T
            # x = re a0 - im a1 + c, y = im a0 + re a1 + d
            zero, one = np.zeros(9), np.ones(9)
            A = np.concatenate(
                [
                    np.stack([a[:, 0], -a[:, 1], one, zero], 1),
                    np.stack([a[:, 1], a[:, 0], zero, one], 1),
                ]
            )
            b = np.concatenate([at[:, 0], at[:, 1]])
            w = np.sqrt(np.concatenate([weight, weight]))
            x, *_ = np.linalg.lstsq(A * w[:, None], b * w, rcond=None)
            up = -(x[1] * f[0, 2] + x[0] * f[1, 2]) / np.hypot(x[0], x[1])
            usual = kernels.upright_cost(up, np.hypot(f[0, 2], f[1, 2]))
            costs.append((float(((A @ x - b) * w) @ ((A @ x - b) * w)) + usual, x))
        best = min(range(4), key=lambda d: costs[d][0])
        assert int(found[i, 0]) == best
        np.testing.assert_allclose(cost[i], costs[best][0], rtol=1e-4)
        np.testing.assert_allclose(found[i, 1:], costs[best][1], atol=1e-4)


def test_the_gradient_is_that_of_the_cost() -> None:
    robot, _, seen, T, q = _scene("ur5", 2, 5e-3)
    limits = np.stack([robot.limits.lower, robot.limits.upper], 1)
    whiten = np.tile(np.eye(2) / 5e-3, (len(seen.at), 1, 1))
    size = 6 + robot.n
    H, g = np.zeros((size, size)), np.zeros(size)

    def cost(step: np.ndarray) -> float:
        R = kernels.turn(step[:3]) @ T[:3, :3]
        return float(
            kernels.equations(
                R, T[:3, 3] + step[3:6], q + 0.01 + step[6:], robot.T_link_joint, robot.axis,
                seen.link, seen.point, seen.at, whiten, limits, H, g,
            )
        )  # fmt: skip

    wanted = np.array([(cost(e) - cost(-e)) / 2e-6 for e in 1e-6 * np.eye(size)])
    cost(np.zeros(size))
    np.testing.assert_allclose(2.0 * g, wanted, rtol=1e-3, atol=1e-2)
    assert np.linalg.eigvalsh(H).min() > -1e-6 * np.linalg.eigvalsh(H).max()


def test_starts_look_at_the_arm() -> None:
    robot, marks, seen, T, _ = _scene("iiwa", 1, 1e-3)
    R, t, _ = far_starts(robot, marks, seen)[0]
    assert np.linalg.det(make_pose(R, t)[:3, :3]) == pytest.approx(1.0, abs=1e-5)
    assert np.linalg.norm(t - T[:3, 3]) < 0.6
