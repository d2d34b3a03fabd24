"""Fitting cones and spheres: compiled loops against plain ones."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.servoing.sphere_fit import Outline, fit_ball, tangent_cone

SIGMA = 4e-4


def seen_from(eye, center, radius, rng, count=72, wrong=0):
    """(k, 3) unit rays that touch a sphere, the last of them beside it."""
    to = center - eye
    far = np.linalg.norm(to)
    axis, half = to / far, np.arcsin(radius / far)
    x = np.cross(axis, [0.3, 1.0, 0.2])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[:, None]
    off = half + rng.normal(0.0, SIGMA, (count, 1))
    if wrong:
        off[-wrong:] *= rng.uniform(0.3, 0.8, (wrong, 1))
    return np.cos(off) * axis + np.sin(off) * (np.cos(turn) * x + np.sin(turn) * y)


def plain_ball(radius, start, outlines, surface, surface_sigma):
    """The twin: Gauss-Newton with Huber weights in plain numpy."""
    center = np.array(start)
    for _ in range(12):
        rows, residuals = [], []
        for seen in outlines:
            to = center - seen.origin
            across = to - (seen.rays @ to)[:, None] * seen.rays
            length = np.linalg.norm(across, axis=1)
            scale = 1.0 / (seen.sigma * np.linalg.norm(to))
            rows.append(scale * across / length[:, None])
            residuals.append(scale * (length - radius))
        to = center - surface
        length = np.linalg.norm(to, axis=1)
        rows.append(to / length[:, None] / surface_sigma)
        residuals.append((length - radius) / surface_sigma)
        J, r = np.concatenate(rows), np.concatenate(residuals)
        knee = max(2.0, 2.0 * float(np.median(np.abs(r))))
        w = np.minimum(1.0, knee / np.maximum(np.abs(r), 1e-9))[:, None]
        H = (J * w).T @ J + 1e-6 * np.eye(3)
        step = np.linalg.solve(H, (J * w).T @ r)
        center = center - step
        if np.linalg.norm(step) < 1e-8:
            break
    misfit = np.sqrt(np.mean(r[np.abs(r) < 3.0] ** 2))
    return center, np.linalg.inv(H) * max(1.0, misfit) ** 2, (np.abs(r) < 3.0).mean()


@pytest.mark.parametrize("lenses", [1, 2])
@pytest.mark.parametrize("points", [0, 40])
def test_a_ball_is_fitted_as_by_plain_numpy(lenses, points):
    rng = np.random.default_rng(10 * lenses + points)
    center, radius = np.array([0.1, -0.05, 0.9]), 0.04
    eyes = [np.zeros(3), np.array([0.12, 0.0, 0.0])][:lenses]
    outlines = [Outline(e, seen_from(e, center, radius, rng, wrong=5), SIGMA) for e in eyes]
    way = rng.normal(0.0, 1.0, (points, 3)) - [0.0, 0.0, 2.0]
    surface = center + radius * way / np.linalg.norm(way, axis=1, keepdims=True)
    surface = surface + rng.normal(0.0, 0.003, surface.shape)
    start = center + np.array([0.02, 0.01, -0.03])
    fit = fit_ball(radius, start, outlines, surface, 0.003)
    expected, covariance, share = plain_ball(radius, start, outlines, surface, 0.003)
    assert fit is not None
    np.testing.assert_allclose(fit.center, expected, atol=1e-8)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-4, atol=1e-12)
    assert fit.share == share
    assert np.linalg.norm(fit.center - center) < 5.0 * np.sqrt(np.trace(fit.covariance)) + 1e-4


def test_nothing_is_no_ball_and_a_start_far_away_leads_nowhere():
    rng = np.random.default_rng(1)
    assert fit_ball(0.04, np.array([0.0, 0.0, 1.0])) is None
    seen = Outline(np.zeros(3), seen_from(np.zeros(3), np.array([0, 0, 3.0]), 0.04, rng), SIGMA)
    assert fit_ball(0.04, np.array([0.0, 0.0, 1.0]), [seen]) is None


@pytest.mark.parametrize("wrong", [0, 20])
@pytest.mark.parametrize("far", [0.2, 2.0])
def test_a_cone_is_that_of_its_rays_and_no_others(far, wrong):
    rng = np.random.default_rng(wrong)
    center = far * np.array([0.3, -0.2, 0.93])
    rays = seen_from(np.zeros(3), center, 0.04, rng, wrong=wrong)
    cone = tangent_cone(rays, SIGMA)
    assert cone is not None
    good = rays[: len(rays) - wrong]
    assert abs(len(cone.rays) - len(good)) <= 3
    w = np.linalg.lstsq(cone.rays, np.ones(len(cone.rays)), rcond=None)[0]
    assert np.arccos(cone.axis @ w / np.linalg.norm(w)) < 1e-7
    assert abs(cone.half - np.arccos(1.0 / np.linalg.norm(w))) < 1e-7
    assert np.arccos(cone.axis @ center / np.linalg.norm(center)) < SIGMA
    assert abs(cone.half - np.arcsin(0.04 / np.linalg.norm(center))) < SIGMA


def test_too_few_rays_are_no_cone():
    rng = np.random.default_rng(3)
    rays = seen_from(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.04, rng, count=7)
    assert tangent_cone(rays, SIGMA) is None
