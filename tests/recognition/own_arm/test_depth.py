"""A depth camera finds itself by the arm, from an old pose or none, and knows if it failed."""

from dataclasses import replace

import numpy as np
import pytest
from tests.recognition.own_arm.synthetic import LENS, T_BASE_CAMERA, corners, robot, splatted_depth

from armsight.devices.data import DepthNoise
from armsight.geometry.pose import exp, inverse, log
from armsight.recognition.own_arm.answer import DepthView
from armsight.recognition.own_arm.depth import (
    DepthOptions,
    register_depth,
    without_edges,
)
from armsight.recognition.own_arm.depth_search import search_depth
from armsight.recognition.own_arm.surface import arm_surface

NOISE = DepthNoise(0.0015, 0.0, 0.001)
CHI2_90 = 10.645
"""What a chi-square of six degrees of freedom exceeds once in ten."""
TURNS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.9, 0.3, -0.4, 0.3, 0.5, 0.0],
        [-0.8, -0.3, 0.6, -0.5, 0.2, 0.4],
        [1.6, 0.2, 0.3, 0.6, -0.6, 0.1],
    ]
)


@pytest.fixture(scope="module")
def views() -> list[DepthView]:
    arm = robot()
    found = []
    for k, turn in enumerate(TURNS):
        q = arm.home + turn
        depth = splatted_depth(corners(arm, q), T_BASE_CAMERA, LENS, k)
        rng = np.random.default_rng(k)
        noise = rng.normal(0.0, NOISE.sigma(depth.astype(float)))
        found.append(DepthView(q, (depth + noise).astype(np.float32)))
    return found


def off(T_base_camera: np.ndarray) -> float:
    """Greatest error of where corners of the arm's reach are placed [m]."""
    corners_ = np.array(
        [[x, y, z, 1.0] for x in (-0.4, 0.4) for y in (-0.4, 0.4) for z in (0, 0.8)]
    )
    T = T_base_camera @ inverse(T_BASE_CAMERA)
    return float(np.linalg.norm((corners_ @ T.T - corners_)[:, :3], axis=1).max())


def test_an_old_pose_is_mended(views: list[DepthView]) -> None:
    surface = arm_surface(robot())
    start = T_BASE_CAMERA @ exp([0.03, -0.03, 0.025, 0.05, -0.05, 0.05])
    assert off(start) > 0.1
    for count, bound in ((1, 0.015), (4, 0.008)):
        answer = register_depth(surface, LENS, NOISE, views[:count], start)
        assert answer.believed
        assert answer.frames == count
        assert off(answer.T_base_camera) < bound
        assert answer.sigma < 0.012


def test_no_start_is_needed(views: list[DepthView]) -> None:
    answer = search_depth(arm_surface(robot()), LENS, NOISE, views)
    assert answer.believed
    assert off(answer.T_base_camera) < 0.008


def test_a_room_without_the_arm_is_not_believed(views: list[DepthView]) -> None:
    """The arm's joints are told, but the camera looks at something else."""
    empty = [DepthView(v.joints, np.full_like(v.depth, 2.6)) for v in views]
    empty[0].depth[60:120, 80:140] = 1.2
    surface = arm_surface(robot())
    assert not register_depth(surface, LENS, NOISE, empty, T_BASE_CAMERA).believed
    nothing = [DepthView(v.joints, np.full_like(v.depth, 2.6)) for v in views]
    answer = search_depth(surface, LENS, NOISE, nothing)
    assert "nothing moves" in answer.problem
    wrong = [DepthView(views[(k + 1) % 4].joints, v.depth) for k, v in enumerate(views)]
    assert not register_depth(surface, LENS, NOISE, wrong, T_BASE_CAMERA).believed


def test_what_the_camera_reads_too_much_is_found(views: list[DepthView]) -> None:
    """An arm that is near in one view and far in another tells a bias from a distance."""
    surface = arm_surface(robot())
    longer = [DepthView(v.joints, (v.depth + 0.015).astype(np.float32)) for v in views]
    rough = DepthOptions(bias=0.02, starts=300)
    answer = register_depth(surface, LENS, NOISE, longer, T_BASE_CAMERA, rough)
    exact = register_depth(surface, LENS, NOISE, views, T_BASE_CAMERA, rough)
    assert np.isclose(answer.bias - exact.bias, 0.015, atol=0.002)
    assert off(answer.T_base_camera) < 0.008


def test_the_truth_lies_in_the_ellipsoid_though_neither_arm_nor_sensor_is_as_it_says() -> None:
    """Nine in ten 90 % ellipsoids hold it: arms off by their usual sizes, depth tilted and scaled.

    Were a picture's thousands of readings all that is counted, hardly one of these would.
    """
    arm, start = robot(), T_BASE_CAMERA @ exp([0.004, -0.003, 0.002, 0.004, -0.004, 0.003])
    surface, inside = arm_surface(arm), 0
    options = DepthOptions(shift=0.01, turn=0.01, starts=60, followed=1)
    for trial in range(8):
        rng = np.random.default_rng(trial)
        T = arm.T_link_joint.copy()
        T[1:, :3, 3] += rng.normal(0.0, 0.0005, (arm.n - 1, 3))
        other = replace(arm, T_link_joint=T)
        zeros = np.deg2rad(0.05) * rng.standard_normal(arm.n) * [0, 1, 1, 1, 1, 0]
        bias, *tilt = rng.normal(0.0, [0.004, 0.001, 0.001, 0.001])
        shown = []
        for k, turn in enumerate(TURNS[:3]):
            q = arm.home + turn
            true = q + zeros + rng.normal(0.0, 0.002, arm.n)
            depth = splatted_depth(corners(other, true), T_BASE_CAMERA, LENS, 10 * trial + k)
            y, x = (
                np.mgrid[: LENS.height, : LENS.width] - np.array([LENS.cy, LENS.cx])[:, None, None]
            )
            wrong = bias + tilt[0] * x / LENS.fx + tilt[1] * y / LENS.fy + tilt[2] * (depth - 1.5)
            noise = rng.normal(0.0, NOISE.sigma(depth.astype(float)))
            shown.append(DepthView(q, (depth + wrong + noise).astype(np.float32)))
        answer = register_depth(surface, LENS, NOISE, shown, start, options)
        away = log(inverse(answer.T_base_camera) @ T_BASE_CAMERA)
        inside += float(away @ np.linalg.solve(answer.covariance, away)) < CHI2_90
    assert inside >= 6


def test_views_are_asked_for() -> None:
    with pytest.raises(ValueError, match="at least one"):
        register_depth(arm_surface(robot()), LENS, NOISE, [], T_BASE_CAMERA)
    with pytest.raises(ValueError, match="at least 3"):
        search_depth(arm_surface(robot()), LENS, NOISE, [])


def test_edges_are_left_out() -> None:
    depth = np.full((6, 6), 1.0, np.float32)
    depth[:, 3:] = 2.0
    clean = without_edges(depth)
    assert np.isnan(clean[:, 2:4]).all()
    assert np.isfinite(clean[:, [0, 1, 4, 5]]).all()
