"""How sure a pose is: errors that no pixel knows of, and their effect worked out another way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.recognition.data.test_own_robot import own_arm
from tests.recognition.own_arm.synthetic import T_BASE_CAMERA, robot

from armsight.geometry.pose import exp, inverse, transform
from armsight.recognition.own_arm.arm_errors import ArmErrors, in_camera, link_errors, link_places
from armsight.recognition.own_arm.covariance import clustered_covariance, considered
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses

NOTHING = ArmErrors(0.0, 0.0, 0.0, 0.0)


def test_clusters_that_err_alike_promise_less() -> None:
    """A mean of 20 groups of 50 equal errors is as sure as one of 20 numbers."""
    rng = np.random.default_rng(3)
    means = []
    for _ in range(400):
        values = np.repeat(rng.standard_normal(20), 50)
        estimate = values.mean()
        H = np.array([[1000.0]])
        g = -(values - estimate).reshape(20, 50).sum(1)[:, None]
        means.append((estimate, clustered_covariance(H, g)[0, 0]))
    truth = np.var([m for m, _ in means])
    assert np.isclose(np.mean([v for _, v in means]), truth, rtol=0.2)


def test_what_all_residuals_share_is_no_less_with_more_of_them() -> None:
    """A thousand readings of a scale that is one too heavy: wrong by one, and it says so."""
    rng = np.random.default_rng(4)
    J = rng.normal(size=(1000, 2))
    shared = J @ [1.0, 0.0] + J @ [0.0, 2.0]  # what moves the estimate by 1 and by 2
    off = np.linalg.lstsq(J, shared, rcond=None)[0]
    found = considered(J.T @ J, (J.T @ shared)[:, None])
    assert np.allclose(found, np.outer(off, off))
    assert np.allclose(off, [1.0, 2.0])


def test_links_move_as_an_arm_with_other_zeros_and_lengths() -> None:
    """Each column is what one error does to points of the links, by moving the arm's own model."""
    arm, rng = robot(), np.random.default_rng(5)
    joints = [arm.home + rng.uniform(-0.6, 0.6, arm.n) for _ in range(2)]
    small = 1e-5
    points = rng.uniform(-0.2, 0.2, (arm.n + 1, 3))

    def placed(model, k: int, turn: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
        T = inverse(T_BASE_CAMERA) @ link_poses(model, joints[k] + turn)
        return np.stack([transform(T[i], points[i : i + 1])[0] for i in range(arm.n + 1)])

    def moved(twists: np.ndarray, k: int, column: int) -> np.ndarray:
        twist, p = twists[k, :, :, column], placed(arm, k, np.zeros(arm.n))
        return twist[:, :3] + np.cross(twist[:, 3:], p)

    zeros = in_camera(
        link_errors(arm, joints, replace(NOTHING, zero=small)), inverse(T_BASE_CAMERA)
    )
    column = 0
    for joint in range(1, arm.n - 1):
        for k in range(2):
            away = placed(arm, k, small * np.eye(arm.n)[joint]) - placed(arm, k, np.zeros(arm.n))
            assert np.allclose(moved(zeros, k, column), away, atol=1e-9)
        column += 1
    lengths = in_camera(
        link_errors(arm, joints, replace(NOTHING, length=small)), inverse(T_BASE_CAMERA)
    )
    seen = 0
    for joint in range(1, arm.n):
        for axis in range(3):
            if abs(arm.T_link_joint[joint, axis, 3]) < 1e-3:
                continue
            T = arm.T_link_joint.copy()
            T[joint, axis, 3] += small
            longer = replace(arm, T_link_joint=T)
            for k in range(2):
                away = placed(longer, k, np.zeros(arm.n)) - placed(arm, k, np.zeros(arm.n))
                assert np.allclose(moved(lengths, k, column), away, atol=1e-9)
            column += 1
            seen += 1
    assert seen >= 4
    exposure = in_camera(
        link_errors(arm, joints, replace(NOTHING, exposure=small)), inverse(T_BASE_CAMERA)
    )
    last = exposure.shape[-1] - 2 * arm.n
    for k in range(2):
        for joint in range(arm.n):
            away = placed(arm, k, small * np.eye(arm.n)[joint]) - placed(arm, k, np.zeros(arm.n))
            at = last + k * arm.n + joint
            assert np.allclose(moved(exposure, k, at), away, atol=1e-9)
            assert not exposure[1 - k, :, :, at].any()


def test_the_ellipsoid_holds_arms_that_differ_from_their_drawing() -> None:
    """Arms drawn with errors of the stated sizes, registered by points: nine in ten are inside.

    Points of the links stand for what a camera sees, without noise: all that is wrong is the arm.
    """
    arm, rng = robot(), np.random.default_rng(6)
    joints = [arm.home + rng.uniform(-0.8, 0.8, arm.n) for _ in range(4)]
    T = inverse(T_BASE_CAMERA)
    errors = ArmErrors()
    twists = in_camera(link_errors(arm, joints, errors), T)
    local = rng.uniform(-0.1, 0.1, (arm.n + 1, 6, 3))
    H = np.zeros((4, arm.n + 1, 6, 6))
    J = np.zeros((4, arm.n + 1, 6, 3, 6))
    for k, q in enumerate(joints):
        for i, pose in enumerate(T @ link_poses(arm, q)):
            for m, p in enumerate(transform(pose, local[i])):
                cross = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
                J[k, i, m] = np.hstack([np.eye(3), -cross])
            H[k, i] = np.einsum("mab,mac->bc", J[k, i], J[k, i])
    whole = H.sum(axis=(0, 1))
    covariance = considered(whole, np.einsum("vlab,vlbm->am", H, twists))
    inside = 0
    for _ in range(200):
        off = twists @ rng.standard_normal(twists.shape[-1])  # (v, links, 6)
        shift = np.einsum("vlmab,vlb->vlma", J, off)
        found = np.linalg.solve(whole, np.einsum("vlmab,vlma->b", J, shift))
        inside += found @ np.linalg.solve(covariance, found) < 10.645
    assert 165 <= inside <= 195


def test_places_of_links_are_those_of_their_frames() -> None:
    arm = robot()
    found = link_places(arm, [arm.home], exp([0.1, 0.2, 1.5, 0.3, 0.0, 0.1]))
    T = exp([0.1, 0.2, 1.5, 0.3, 0.0, 0.1]) @ link_poses(arm, arm.home)
    assert np.allclose(found[0], T[:, :3, 3])


def test_an_arm_of_three_joints_has_errors_too(tmp_path: Path) -> None:
    """The sag of its second joint bends both links beyond, stretched out and not upright."""
    arm = load_robot(str(own_arm(tmp_path)))
    joints = [np.array([0.3, np.pi / 2, 0.0]), np.zeros(3)]
    out, up = link_errors(arm, joints, replace(NOTHING, sag=0.01))
    assert np.isfinite(out).all()
    turned = np.linalg.norm(out[:, 3:], axis=1)
    share = 0.3 / arm.reach  # of the third joint's distance
    assert np.allclose(turned.max(axis=1), [0.0, 0.0, 0.01 * share, 0.01 * share])
    assert np.allclose(up[:, 3:], 0.0, atol=1e-9)
    every = link_errors(arm, joints, ArmErrors())
    assert every.shape[:3] == (2, 4, 6)
    assert np.isfinite(every).all()
