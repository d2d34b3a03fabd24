"""Bulls-eye, mouth and palm against pictures that are cast ray by ray."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy, look_at, transform
from armsight.servoing.disc_fit import Circle, fit_disc
from armsight.servoing.sphere_fit import Outline
from armsight.servoing.targets.bullseye import Bullseye
from armsight.servoing.targets.mouth import Mouth
from armsight.servoing.targets.palm import Palm

from .flat import bullseye, frame, pair, palm, smiley

EYE = look_at((-1.3, 1.4, 2.0), (0.25, 0.0, 1.15))
FRONT = np.array([[0, 0, -1], [-1, 0, 0], [0, 1, 0]], float)
"""A face that looks along -x, upright."""


def angle(a, b):
    return np.rad2deg(np.arccos(np.clip(a @ b, -1, 1)))


@pytest.mark.parametrize("tilt", [0.0, 0.4, 0.8])
def test_the_centre_of_an_ellipse_is_not_taken_for_the_circles(tilt):
    """Exact rays of two lenses: the fit is exact where the ellipse's centre is off."""
    T = from_rpy((np.pi + tilt, 0.3 * tilt, 0.0), (0.01, -0.02, 0.25))
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rim = transform(T, np.stack([0.06 * np.cos(turn), 0.06 * np.sin(turn), 0 * turn], 1))
    circles = []
    for x in (0.0, 0.06):
        rays = rim - (x, 0, 0)
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        circles.append(Circle(Outline(np.array([x, 0, 0]), rays, 3e-4), 0.06))
    fit = fit_disc(T[:3, 3] + (0.004, -0.003, 0.01), T[:3, 2] + (0.3, -0.2, 0.0), circles)
    assert np.linalg.norm(fit.center - T[:3, 3]) < 2e-5
    assert angle(fit.normal, T[:3, 2]) < 0.02


def test_the_bullseye_from_afar_with_its_normal():
    T = from_rpy((0.2, -np.pi / 2 + 0.2, 0.1), (0.8, 0.1, 1.2))
    (seen,) = Bullseye().in_frame(frame(T, bullseye, EYE, np.random.default_rng(0)))
    assert np.linalg.norm(seen.position - T[:3, 3]) < 0.0015
    assert angle(seen.normal, T[:3, 2]) < 2.0


def test_the_bullseye_in_the_pair_with_the_stylus_before_it():
    T = from_rpy((np.pi + 0.3, -0.2, 0.4), (0.03, 0.0, 0.26))
    stylus = [(345, 250, 380, 480, (140, 142, 147))]
    view = pair(T, bullseye, np.eye(4), np.random.default_rng(1), hidden=stylus)
    (seen,) = Bullseye().in_pair(view)
    assert np.linalg.norm(seen.position - T[:3, 3]) < 2e-4
    assert angle(seen.normal, T[:3, 2]) < 0.3


def test_a_red_disc_is_no_bullseye():
    def disc(x, y):
        color, covered = bullseye(x, y)
        color[np.hypot(x, y) < 0.06] = (0.80, 0.06, 0.07)
        return color, covered

    T = from_rpy((np.pi, 0.0, 0.0), (0.03, 0.0, 0.26))
    assert Bullseye().in_pair(pair(T, disc, np.eye(4), np.random.default_rng(0))) == []


def test_the_mouth_from_afar_and_near():
    """From near the face is larger than the picture: its arc is seen, and which way was down."""
    mouth, rng = Mouth(), np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = FRONT @ from_rpy((0.1, 0.2, 0.15), (0, 0, 0))[:3, :3], (0.8, 0.0, 1.2)
    (seen,) = mouth.in_frame(frame(T, smiley, EYE, rng))
    assert np.linalg.norm(seen.position - T[:3, 3]) < 0.0025
    assert angle(seen.normal, T[:3, 2]) < 1.5
    lens = np.eye(4)
    lens[:3, :3] = T[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    lens[:3, 3] = T[:3, 3] + T[:3, :3] @ (-0.03, 0.0, 0.25)
    (seen,) = mouth.in_pair(pair(T, smiley, lens, rng))
    assert np.linalg.norm(seen.position - T[:3, 3]) < 0.006


def test_the_palm_from_afar_and_near():
    rng = np.random.default_rng(0)
    T = from_rpy((0.1, -0.1, 0.3), (0.8, 0.1, 1.0))
    (seen,) = Palm().in_frame(frame(T, palm, EYE, rng))
    assert np.linalg.norm(seen.position - T[:3, 3]) < 0.006
    assert angle(seen.normal, T[:3, 2]) < 6.0
    assert angle(seen.along, -T[:3, 0]) < 6.0
    T = from_rpy((np.pi + 0.2, 0.1, 0.0), (0.03, 0.0, 0.28))
    (seen,) = Palm().in_pair(pair(T, palm, np.eye(4), rng))
    assert np.linalg.norm(seen.position - T[:3, 3]) < 3e-4


def test_where_the_disc_is_hidden_the_glove_stands_in():
    def covered(x, y):
        color, shown = palm(x, y)
        color[np.hypot(x, y) < 0.03] = (0.2, 0.6, 0.2)
        return color, shown

    finder, rng = Palm(), np.random.default_rng(0)
    T = from_rpy((0.1, -0.1, 0.3), (0.8, 0.1, 1.0))
    assert finder.in_frame(frame(T, covered, EYE, rng)) == []
    finder.in_frame(frame(T, palm, EYE, rng))
    moved = from_rpy((0.1, -0.1, 0.3), (0.85, 0.05, 1.02))
    (seen,) = finder.in_frame(frame(moved, covered, EYE, rng))
    assert np.linalg.norm(seen.position - moved[:3, 3]) < 0.015
    assert seen.covariance[0, 0] > 0.01**2
