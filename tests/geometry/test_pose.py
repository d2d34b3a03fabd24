"""Poses: group axioms, and agreement with scipy's matrix exponential."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, logm

from armsight.geometry import pose

small = st.floats(-1.0, 1.0)
twists = st.lists(small, min_size=6, max_size=6).map(np.array)


def hat(xi):
    M = np.zeros((4, 4))
    M[:3, :3] = pose.skew(xi[3:])
    M[:3, 3] = xi[:3]
    return M


@settings(max_examples=50, deadline=None)
@given(twists)
def test_exp_is_the_matrix_exponential(xi):
    np.testing.assert_allclose(pose.exp(xi), expm(hat(xi)), atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(twists)
def test_log_inverts_exp(xi):
    np.testing.assert_allclose(pose.log(pose.exp(xi)), xi, atol=1e-7)


def test_log_is_the_matrix_logarithm():
    T = pose.from_rpy([0.3, -0.7, 1.1], [0.4, -0.2, 0.9])
    M = np.real(logm(T))
    np.testing.assert_allclose(pose.log(T)[:3], M[:3, 3], atol=1e-12)
    np.testing.assert_allclose(pose.skew(pose.log(T)[3:]), M[:3, :3], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(twists, twists)
def test_inverse_and_transform(a, b):
    T_a, T_b = pose.exp(a), pose.exp(b)
    points = np.array([[0.1, 0.2, 0.3], [-1.0, 2.0, 0.5]])
    np.testing.assert_allclose(pose.inverse(T_a) @ T_a, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(
        pose.transform(T_a @ T_b, points),
        pose.transform(T_a, pose.transform(T_b, points)),
        atol=1e-12,
    )


def test_rpy_follows_urdf():
    """Yaw turns x to y, pitch turns z to x, and yaw is applied last."""
    np.testing.assert_allclose(
        pose.from_rpy([0, 0, np.pi / 2])[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12
    )
    np.testing.assert_allclose(
        pose.from_rpy([0, np.pi / 2, 0])[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-12
    )
    combined = pose.from_rpy([0, np.pi / 2, np.pi / 2])[:3, :3]
    np.testing.assert_allclose(combined @ [0, 0, 1], [0, 1, 0], atol=1e-12)


def test_quaternions_round_trip():
    T = pose.from_rpy([0.3, -0.7, 1.1], [1, 2, 3])
    again = pose.from_quaternion(pose.to_quaternion(T), T[:3, 3])
    np.testing.assert_allclose(again, T, atol=1e-12)
    np.testing.assert_allclose(pose.to_wxyz(np.eye(4)), [1, 0, 0, 0], atol=1e-12)


def test_look_at_is_an_optical_frame():
    T = pose.look_at([2, 0, 1], [0, 0, 1])
    np.testing.assert_allclose(T[:3, 2], [-1, 0, 0], atol=1e-12)  # forward
    np.testing.assert_allclose(T[:3, 1], [0, 0, -1], atol=1e-12)  # image down is world down
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("target", [[2, 0, 1], [2, 0, 5]])
def test_look_at_refuses_what_has_no_answer(target):
    with pytest.raises(ValueError, match="look_at"):
        pose.look_at([2, 0, 1], target)


def test_interpolation_ends_and_middle():
    T_a, T_b = np.eye(4), pose.from_rpy([0, 0, 1.0], [1, 0, 0])
    np.testing.assert_allclose(pose.interpolate(T_a, T_b, 0.0), T_a, atol=1e-12)
    np.testing.assert_allclose(pose.interpolate(T_a, T_b, 1.0), T_b, atol=1e-12)
    middle = pose.interpolate(T_a, T_b, 0.5)
    assert pose.angle_between(T_a, middle) == pytest.approx(0.5)


def test_a_cross_product_is_numpys_bit_for_bit():
    for a, b in np.random.default_rng(4).normal(size=(100, 2, 3)):
        assert (pose.cross(a, b) == np.cross(a, b)).all()


def test_what_turns_neither_stretches_nor_mirrors():
    R = pose.from_rpy((0.3, -1.1, 2.0))[:3, :3]
    assert pose.is_rotation(R)
    assert not pose.is_rotation(R @ np.diag([1.0, 1.0, -1.0]))
    assert not pose.is_rotation(1.001 * R)
    assert pose.is_rotation(1.00001 * R, 1e-4)
