"""Bulls-eye, mouth and palm against pictures that are cast ray by ray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy, inverse, look_at, transform
from armsight.servoing.disc_fit import Circle, fit_disc
from armsight.servoing.sphere_fit import Outline
from armsight.servoing.targets.bullseye import Bullseye
from armsight.servoing.targets.mouth import KEPT, Mouth, _Down, _remembered
from armsight.servoing.targets.palm import Palm
from armsight.simulation.targets import BLUE, PALM_RADIUS

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


def test_rings_of_two_pixels_that_a_stylus_cuts_into_pieces_are_one_print():
    """An arc of the outer ring was taken for the inner one: 4 cm off, said to be known to 1 mm."""

    def cut(x, y):
        color, covered = bullseye(x, y)
        color[(abs(y - 0.4 * x) < 0.004) & (x < 0.0)] = (0.55, 0.55, 0.57)
        color[(abs(y + 0.9 * x) < 0.003) & (x > 0.0)] = (0.3, 0.3, 0.3)
        return color, covered

    rng = np.random.default_rng(2)
    eye = look_at((-1.5, 1.6, 2.5), (0.25, 0.0, 1.15))
    for turn in (0.1, 1.2, 2.6):
        T = from_rpy((0.2, -np.pi / 2 + 0.2, turn), (0.8, 0.1, 1.2))
        (seen,) = Bullseye().in_frame(frame(T, cut, eye, rng))
        assert np.linalg.norm(seen.position - T[:3, 3]) < 0.006


def test_a_face_that_the_picture_cuts_off_is_found_by_what_is_left_of_its_disc():
    """The middle of what was left was taken for the face's in both lenses, where they differ: the
    mouth was placed by its arc alone, and by which way down was remembered to be."""
    mouth, rng = Mouth(), np.random.default_rng(4)
    for beside, up in ((0.03, -0.04), (0.05, -0.04), (0.05, -0.05), (-0.06, 0.0)):
        T = from_rpy((np.pi + 0.15, 0.1, 0.1), (0.03 + beside, up, 0.36))
        (seen,) = mouth.in_pair(pair(T, smiley, np.eye(4), rng))
        assert seen.normal is not None, "its disc was found"
        assert np.linalg.norm(seen.position - T[:3, 3]) < 0.003


def test_an_end_of_the_mouths_arc_says_which_way_is_down():
    """By the lines of a face that is cut off it was 0.2 rad off, and 6 mm lasted of what was kept:
    the mouth of a moving face was 13 mm beside where it was believed."""
    rng = np.random.default_rng(5)
    for turn, beside in ((0.4, 0.0), (0.2, 0.03), (-0.2, -0.03), (-0.4, 0.0)):
        mouth = Mouth()
        T = from_rpy((np.pi + 0.1, 0.1, turn), (0.03 + beside, 0.0, 0.22))
        mouth._down = _Down(T[:3, :3] @ (np.sin(0.2), -np.cos(0.2), 0.0), 0.0, True)
        (seen,) = mouth.in_pair(pair(T, smiley, np.eye(4), rng))
        off = T[:3, :3].T @ (seen.position - T[:3, 3])
        assert np.abs(off[:2]).max() < 0.001
        assert seen.lasting == 0.0
        down = mouth._down.way
        assert abs(down @ T[:3, 0]) < np.sin(np.deg2rad(1.0))


def test_which_way_a_face_is_down_is_the_pairs_word_and_else_a_mean():
    """Half of a face behind an arm is 0.15 rad off: that moved a near mouth by a centimetre."""
    way, off = np.array([0.0, 0.0, -1.0]), np.array([0.15, 0.0, -1.0]) / np.hypot(0.15, 1.0)
    known = _Down(way, 1.0, True)
    assert _remembered(known, off, 1.5) is known
    assert _remembered(known, off, 1.0 + KEPT + 0.1).way == pytest.approx(off)
    known = _remembered(None, way, 1.0)
    for k in range(1, 9):
        known = _remembered(known, off if k % 2 else way, 1.0 + 0.067 * k)
        assert angle(known.way, way) < 5.0
    assert angle(_remembered(known, off, 9.0).way, off) < 1e-3, "what is old counts no more"


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


def test_a_face_that_is_half_hidden_does_not_say_which_way_is_down_and_is_less_sure():
    """An arm before it turned what was left of eyes and mouth: the mouth was 7 cm off, by 2 mm."""
    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = FRONT @ from_rpy((0.1, 0.2, 0.15), (0, 0, 0))[:3, :3], (0.8, 0.0, 1.2)

    def cut(mouth, way, at):
        def paint(x, y):
            color, shown = smiley(x, y)
            return color, shown & (x * np.cos(way) + y * np.sin(way) < at)

        return mouth.in_frame(frame(T, paint, EYE, rng))

    for way in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        mouth = Mouth()
        (whole,) = mouth.in_frame(frame(T, smiley, EYE, rng))
        down = mouth._down
        for at in (0.03, 0.0):
            for seen in cut(mouth, way, at):
                off = np.linalg.norm(seen.position - T[:3, 3])
                assert whole.lasting == 0.0
                assert off < 2.0 * seen.lasting
                assert mouth._down is down


def test_a_pair_that_sees_the_mouths_arc_alone_goes_on_to_say_which_way_is_down():
    mouth, rng = Mouth(), np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = FRONT, (0.8, 0.0, 1.2)
    lens = np.eye(4)
    lens[:3, :3] = T[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    lens[:3, 3] = T[:3, 3] + T[:3, :3] @ (-0.03, 0.0, 0.22)
    mouth._down = _Down(-T[:3, 1], -5.0, True)

    def arc(x, y):
        color, shown = smiley(x, y)
        return color, shown & (y < 0.02)

    view = pair(T, arc, lens, rng)
    (seen,) = mouth.in_pair(view)
    assert seen.normal is None, "the disc is not seen"
    assert mouth._down.stamp == view.frame.stamp
    assert mouth._down.near


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


def test_a_palm_whose_forearm_comes_towards_the_camera_is_where_it_is():
    """What lay 15 cm behind the sleeve's near end was no glove: the palm, in the picture, was 6 cm
    off, or only the glove's middle was left of it."""
    rng = np.random.default_rng(3)
    for turn in (0.0, 0.6, -0.6):
        T = np.eye(4)
        T[:3, 3] = (0.8, 0.1, 1.0)
        to = (EYE[:3, 3] - T[:3, 3]) / np.linalg.norm(EYE[:3, 3] - T[:3, 3])
        side = np.cross(to, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(to, [0.0, 0.0, 1.0]))
        x = -np.cos(0.5) * to + np.sin(0.5) * np.cross(side, to)  # the fingers point away from it
        z = np.cross(x, side)
        z = z if z @ to > 0.0 else -z
        T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        T = T @ from_rpy((turn, 0.0, 0.0))
        (seen,) = Palm().in_frame(frame(T, palm, EYE, rng))
        assert seen.normal is not None, "the disc was found"
        assert np.linalg.norm(seen.position - T[:3, 3]) < 0.010


@pytest.mark.parametrize("right", [False, True])
def test_a_disc_that_the_gripper_hides_from_one_lens_is_placed_by_the_other(right):
    rng = np.random.default_rng(5)
    T = from_rpy((np.pi + 0.2, 0.1, 0.0), (0.03, 0.0, 0.36))
    view = pair(T, palm, np.eye(4), rng)
    hidden, shown = ("left", "right") if not right else ("right", "left")
    lens = view.info.left if hidden == "left" else view.info.right
    eye = np.eye(4) if hidden == "left" else view.info.T_left_right
    u, v = lens.project((inverse(eye) @ T)[:3, 3][None])[0].astype(int)
    image = getattr(view.frame, hidden).copy()
    image[v - 90 : v + 90, u - 90 : u + 20] = (60, 60, 62)
    view = replace(view, frame=replace(view.frame, **{hidden: image}))
    (seen,) = Palm().in_pair(view)
    off = seen.position - T[:3, 3]
    origin = view.info.T_left_right[:3, 3] if shown == "right" else np.zeros(3)
    ray = (T[:3, 3] - origin) / np.linalg.norm(T[:3, 3] - origin)
    assert np.linalg.norm(off - ray * (off @ ray)) < 0.0015
    assert abs(off @ ray) < 0.006
    sigma = np.sqrt(ray @ seen.covariance @ ray)
    assert abs(off @ ray) < 3.0 * sigma < 0.02
    assert seen.normal is None, "which side is nearer one lens does not tell"


def test_a_blue_disc_on_no_glove_is_no_palm_to_one_lens():
    def badge(x, y):
        color = np.tile((0.5, 0.5, 0.52), (len(x), 1)).astype(float)
        color[np.hypot(x, y) < PALM_RADIUS] = BLUE
        return color, (abs(x) < 0.08) & (abs(y) < 0.08)

    rng = np.random.default_rng(6)
    T = from_rpy((np.pi + 0.2, 0.1, 0.0), (0.03, 0.0, 0.36))
    view = pair(T, badge, np.eye(4), rng)
    blank = np.full_like(view.frame.left, 90)
    alone = replace(view, frame=replace(view.frame, left=blank))
    assert Palm().in_pair(alone) == []


def test_a_glove_that_is_half_hidden_is_less_sure_or_nothing():
    """An arm before it moved the middle of what was left by 12 cm, said to be known to 15 mm."""
    finder, rng = Palm(), np.random.default_rng(0)
    T = from_rpy((0.1, -0.1, 0.3), (0.8, 0.1, 1.0))
    finder.in_frame(frame(T, palm, EYE, rng))

    def cut(at):
        def paint(x, y):
            color, shown = palm(x, y)
            color[np.hypot(x, y) < 0.03] = (0.2, 0.6, 0.2)
            return color, shown & (x > at)

        return finder.in_frame(frame(T, paint, EYE, rng))

    for at in (-0.25, -0.22, -0.20, -0.15, -0.10):
        for seen in cut(at):
            off = np.linalg.norm(seen.position - T[:3, 3])
            assert off < 2.0 * np.sqrt(seen.covariance[0, 0])
    assert cut(-0.10) == []
