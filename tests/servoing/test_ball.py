"""The ball's centre against pictures that are cast ray by ray."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.geometry.pose import look_at, make_pose
from armsight.servoing.planes import plane_sweep
from armsight.servoing.segment import color_mask, regions
from armsight.servoing.sphere_fit import Outline, fit_ball, tangent_cone
from armsight.servoing.targets.ball import RED, Ball
from armsight.servoing.targets.held_ball import HeldBall

from .traced import frame, pair

COLOR = (205, 15, 18)
BALL = Ball(0.04)
EYE = look_at((1.75, 1.4, 2.0), (0.3, 0.0, 1.1))


@pytest.mark.parametrize("seed", range(4))
def test_a_fixed_camera_finds_the_centre_and_says_how_well(seed):
    rng = np.random.default_rng(seed)
    center = np.array([0.7, 0.0, 1.15]) + rng.uniform(-0.25, 0.25, 3)
    view = frame([(center, 0.04, COLOR)], EYE, rng, wall=3.2)
    (seen,) = BALL.in_frame(view)
    error = seen.position - center
    assert np.linalg.norm(error) < 0.004
    assert error @ np.linalg.solve(seen.covariance + 0.001**2 * np.eye(3), error) < 20.0


def test_the_mean_of_the_surface_is_two_thirds_of_the_radius_too_near():
    """V's estimate, and why ours is another: the mean of a visible cap lies 2/3 R before."""
    center = np.array([0.7, 0.1, 1.1])
    (seen,) = BALL.in_frame(frame([(center, 0.04, COLOR)], EYE))
    view = (center - EYE[:3, 3]) / np.linalg.norm(center - EYE[:3, 3])
    assert (center - seen.surface) @ view == pytest.approx(2 / 3 * 0.04, abs=0.004)


@pytest.mark.parametrize("seed", range(4))
def test_the_pair_finds_the_centre_within_four_tenths_of_a_millimetre(seed):
    rng = np.random.default_rng(seed)
    center = np.array([0.01, 0.0, 0.27]) + rng.uniform(-1, 1, 3) * (0.04, 0.02, 0.05)
    (seen,) = BALL.in_pair(pair([(center, 0.04, COLOR)], np.eye(4), rng))
    assert np.linalg.norm(seen.position - center) < 4e-4


def test_a_third_of_the_outline_hidden_moves_the_centre_little():
    center = np.array([0.0, 0.0, 0.28])
    u = int(869 * 0.02 / 0.28 + 361)
    view = pair([(center, 0.04, COLOR)], np.eye(4), hidden=(u, 0, u + 90, 480))
    found = BALL.in_pair(view)
    assert found
    assert np.linalg.norm(found[0].position - center) < 0.002


def behind_a_limb(center, over, turn, rng):
    """A ball whose outline a grey limb 30 cm before it covers, ``over`` its centre by so much."""
    far = look_at((1.9, 1.5, 2.6), (0.3, 0.0, 1.2))
    to = center - far[:3, 3]
    away = np.linalg.norm(to)
    a = np.cross(to / away, [0.0, 0.0, 1.0])
    a /= np.linalg.norm(a)
    b = np.cross(to / away, a)
    side, along = np.cos(turn) * a + np.sin(turn) * b, np.cos(turn) * b - np.sin(turn) * a
    middle = center - 0.3 * to / away + side * (0.055 - over) * (1.0 - 0.3 / away)
    limb = [(middle + s * along, 0.055, (120, 120, 125)) for s in np.arange(-0.3, 0.31, 0.015)]
    return frame([(center, 0.04, COLOR), *limb], far, rng, wall=3.5)


def test_half_a_ball_behind_an_arm_is_where_the_whole_one_is_or_is_not_seen():
    """Until November 2026 the arm's edge was taken for the ball's: up to 40 mm off, said to be 1.

    A ball at rest was taken for one at 1.2 m/s when the arm moved before it.
    """
    seen = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        center = np.array([0.52, -0.5, 1.54]) + rng.uniform(-0.1, 0.1, 3)
        over = rng.uniform(-0.03, 0.01)
        for one in BALL.in_frame(behind_a_limb(center, over, rng.uniform(0, 2 * np.pi), rng)):
            error = one.position - center
            assert np.linalg.norm(error) < 0.012
            assert error @ np.linalg.solve(one.covariance + 0.0015**2 * np.eye(3), error) < 16.3
            seen += 1
    assert seen > 12


@pytest.mark.parametrize(
    ("radius", "distance"), [(0.02, 2.1), (0.08, 2.1), (0.08, 1.2)], ids=["small", "large", "near"]
)
def test_a_red_thing_of_another_size_is_no_ball(radius, distance):
    center = EYE[:3, 3] + distance * EYE[:3, 2]
    assert BALL.in_frame(frame([(center, radius, COLOR)], EYE)) == []


def test_a_picture_of_a_ball_is_no_ball():
    """Flat depth inside a round red region: right size, no sphere."""
    center = EYE[:3, 3] + 1.9 * EYE[:3, 2]
    view = frame([(center, 0.04, COLOR)], EYE)
    flat = np.where(np.isfinite(view.frame.depth), 2.6, np.nan).astype(np.float32)
    object.__setattr__(view.frame, "depth", flat)
    assert BALL.in_frame(view) == []


def test_the_stylus_own_tip_is_the_mark_and_not_the_ball():
    ball, tip = np.array([0.0, -0.03, 0.30]), np.array([0.03, 0.045, 0.24])
    view = pair([(ball, 0.04, COLOR), (tip, 0.005, COLOR)], np.eye(4))
    (seen,) = BALL.in_pair(view)
    (mark,) = Ball(0.005, "mark").in_pair(view)
    assert np.linalg.norm(seen.position - ball) < 3e-4
    assert np.linalg.norm(mark.position - tip) < 3e-4


def test_of_two_balls_both_are_reported():
    balls = [np.array([0.75, -0.2, 1.1]), np.array([0.6, 0.3, 1.2])]
    found = BALL.in_frame(frame([(c, 0.04, COLOR) for c in balls], EYE))
    assert len(found) == 2
    for center in balls:
        assert min(np.linalg.norm(s.position - center) for s in found) < 0.004


def test_grey_pictures_and_other_colours_show_nothing():
    for color in ((40, 160, 60), (30, 60, 200), (230, 200, 60), (222, 170, 140)):
        assert BALL.in_frame(frame([(np.array([0.7, 0, 1.1]), 0.04, color)], EYE)) == []


def test_thirty_planes_give_the_surface_in_steps_of_seven_millimetres():
    center = np.array([0.0, 0.0, 0.30])
    rng = np.random.default_rng(1)
    view = pair([(center, 0.04, COLOR)], np.eye(4), rng)
    region = regions(color_mask(view.frame.left, RED), 60.0)[0]
    points = plane_sweep(view, region)
    steps = (points[:, 2] - 0.20) / (0.20 / 29)
    assert np.allclose(steps, np.rint(steps), atol=1e-3)
    assert len(np.unique(np.rint(steps))) > 3
    assert abs(points[:, 2].mean() - (0.30 - 2 / 3 * 0.04)) < 0.007


def test_the_cone_of_a_sphere_is_exact_and_outliers_leave_it_be():
    rng = np.random.default_rng(0)
    center, radius = np.array([0.1, -0.05, 0.4]), 0.04
    axis = center / np.linalg.norm(center)
    half = np.arcsin(radius / np.linalg.norm(center))
    a = np.cross(axis, [0, 0, 1.0])
    a /= np.linalg.norm(a)
    b = np.cross(axis, a)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None]
    rays = np.cos(half) * axis + np.sin(half) * (np.cos(turn) * a + np.sin(turn) * b)
    rays[:15] += rng.normal(0, 0.02, (15, 3)) - 0.03 * axis
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = tangent_cone(rays, 1e-4)
    assert found is not None
    assert np.allclose(found.axis, axis, atol=1e-6)
    assert found.half == pytest.approx(half, abs=1e-6)
    fit = fit_ball(radius, center + 0.03, [Outline(np.zeros(3), rays[15:], 1e-4)])
    assert fit is not None
    assert np.allclose(fit.center, center, atol=1e-5)


def test_covariance_of_the_fit_covers_the_scatter():
    """300 noisy outlines: the errors are as large as their covariance says."""
    rng = np.random.default_rng(5)
    T = make_pose(None, (0.06, 0.0, 0.0))
    center, radius, sigma = np.array([0.02, 0.01, 0.28]), 0.04, 2e-4
    squares = []
    for _ in range(300):
        outlines = []
        for origin in (np.zeros(3), T[:3, 3]):
            to = center - origin
            axis, half = to / np.linalg.norm(to), np.arcsin(radius / np.linalg.norm(to))
            a = np.cross(axis, [0, 1.0, 0])
            a /= np.linalg.norm(a)
            b = np.cross(axis, a)
            turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
            off = half + rng.normal(0, sigma, (40, 1))
            rays = np.cos(off) * axis + np.sin(off) * (np.cos(turn) * a + np.sin(turn) * b)
            outlines.append(Outline(origin, rays, sigma))
        fit = fit_ball(radius, center + rng.normal(0, 0.01, 3), outlines)
        assert fit is not None
        e = fit.center - center
        squares.append(e @ np.linalg.solve(fit.covariance, e))
    assert 2.0 < np.mean(squares) < 4.0


@pytest.mark.parametrize("seed", range(3))
def test_a_ball_in_a_gloved_hand_says_where_the_arm_behind_it_lies(seed):
    """As it lies in the hand, by glove and sleeve; of a bare hand nothing is known."""
    rng = np.random.default_rng(seed)
    center = np.array([0.8, 0.0, 1.2]) + rng.uniform(-0.15, 0.15, 3)
    arm = np.array([1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4)])
    arm /= np.linalg.norm(arm)
    eye = look_at((-1.3, 1.4, 2.0), (0.3, 0.0, 1.1))
    glove = [(center + s * arm, 0.04, (242, 77, 158)) for s in np.arange(0.08, 0.45, 0.02)]
    held = frame([*glove[::-1], (center, 0.04, COLOR)], eye, rng, wall=3.2)
    (seen,) = HeldBall(0.04).in_frame(held)
    assert np.linalg.norm(seen.position - center) < 0.008
    assert np.degrees(np.arccos(seen.along @ arm)) < 10.0
    (bare,) = HeldBall(0.04).in_frame(frame([(center, 0.04, COLOR)], eye, rng, wall=3.2))
    assert bare.along is None
