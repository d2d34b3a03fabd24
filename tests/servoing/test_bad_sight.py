"""What eyes may say wrongly: swapped lenses, one camera alone, frozen pictures, clocks that lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.servoing.eyes import Eye, drawn
from armsight.servoing.sighting import Sighting, believable
from armsight.servoing.targets.ball import Ball

from .test_estimate import filter_, look
from .traced import WRIST, cast, frame, pair

BALL, COLOR = Ball(0.04), (205, 30, 25)
CENTER = np.array([0.01, 0.0, 0.27])


def test_a_pair_with_swapped_lenses_says_nothing_rather_than_something_wrong():
    view = pair([(CENTER, 0.04, COLOR)], np.eye(4))
    assert BALL.in_pair(view), "it is seen by a pair whose lenses are right"
    swapped = replace(view.frame, left=view.frame.right, right=view.frame.left)
    swapped_view = replace(view, frame=swapped)
    for seen in BALL.in_pair(swapped_view):
        assert np.linalg.norm(seen.position - CENTER) < 0.005


def test_a_ball_beside_the_arm_is_told_from_clothes_of_its_colour():
    """A red sleeve, long and large, beside the ball: one is found, and it is the ball."""
    ball = np.array([0.1, 0.0, 2.0])
    sleeve = [(np.array([-0.35 + 0.03 * k, 0.2, 2.0]), 0.06, COLOR) for k in range(8)]
    found = BALL.in_frame(
        frame([(ball, 0.04, COLOR), *sleeve], np.eye(4), np.random.default_rng(0))
    )
    assert [s for s in found if np.linalg.norm(s.position - ball) < 0.01]
    assert not [s for s in found if np.linalg.norm(s.position - ball) > 0.02]


def test_one_camera_alone_must_do_and_is_as_unsure_as_it_may_be_wrong():
    f = filter_()
    for k in range(40):
        f.add(look("a", 0.2 * k, (0.7 + 0.006, 0.1, 0.8)))  # its own error is 6 mm
    e = f.estimate
    off = e.position - (0.7, 0.1, 0.8)
    assert np.linalg.norm(off) < 0.008
    assert off @ np.linalg.solve(e.covariance[:3, :3], off) < 9.0


def test_a_picture_that_comes_again_and_again_is_seen_once():
    """A camera that freezes repeats its last exposure: the target grows old."""
    f = filter_()
    for k in range(10):
        f.add(look("a", 0.1 * k, (0.7, 0.0, 0.8)))
    seen = f.estimate.seen
    for _ in range(20):
        f.add(look("a", 0.9, (0.7, 0.0, 0.8)))
    assert f.estimate.seen == seen == pytest.approx(0.9)


def test_a_clock_that_lies_by_20_ms_costs_what_the_target_moves_meanwhile():
    """At 0.25 m/s those are 5 mm, of which the camera's bias takes its part."""
    worst = {}
    for lie in (0.0, 0.020):
        f, off = filter_(), []
        for k in range(120):
            t = 0.05 * k
            for camera, late in (("a", lie), ("b", 0.0), ("wrist", 0.0)):
                at = (0.7, 0.25 * (t - 3.0), 0.8)
                f.add(look(camera, t + late, at, 0.0005 if camera == "wrist" else 0.002))
            if t > 2.0:
                now, _ = f.estimate.at(t)
                off.append(float(np.linalg.norm(now - at)))
        worst[lie] = max(off)
    assert worst[0.0] < 0.003
    assert worst[0.020] < 0.008


def test_a_pair_of_unequal_lenses_is_as_good_as_its_declaration():
    """The right lens a fifth shorter: declared, the centre is right; undeclared, nothing is said
    that is wrong by more than it says."""
    short = replace(WRIST, fx=0.8 * WRIST.fx, fy=0.8 * WRIST.fy)
    T = make_pose(None, (0.06, 0.0, 0.0))
    view = pair([(CENTER, 0.04, COLOR)], np.eye(4))
    right, _ = cast(short, T, [(CENTER, 0.04, COLOR)])
    unequal = replace(view.frame, right=right)
    known = replace(view, frame=unequal, info=replace(view.info, right=short))
    (seen,) = BALL.in_pair(known)
    assert np.linalg.norm(seen.position - CENTER) < 0.0005
    for seen in BALL.in_pair(replace(view, frame=unequal)):
        off = seen.position - CENTER
        assert off @ np.linalg.solve(seen.covariance, off) < 16.0


def test_what_cannot_be_a_sighting_is_left_out_and_said():
    """A detector of anybody's: its sound sightings count, the others are named."""
    good = look("a", 1.0, (0.7, 0.0, 0.8)).sightings[0]
    nan = np.array([np.nan, 0.0, 0.8])
    for wrong, words in (
        (replace(good, position=nan), "position must be an array of 3 finite numbers"),
        (replace(good, position=None), "position must be"),
        (replace(good, surface=(0.7, 0.0, 0.8)), "surface must be an array"),
        (replace(good, covariance=np.diag([1e-6, 1e-6, -1e-4])), "not symmetric and positive"),
        (replace(good, covariance=np.eye(2)), "covariance must be"),
        (replace(good, normal=np.array([0.0, 0.0, 2.0])), "expected a unit vector"),
        (replace(good, tilt=float("nan")), "tilt is nan"),
        (replace(good, lasting=-0.01), "lasting is -0.01 m"),
        ((0.7, 0.0, 0.8), "found a tuple; expected a Sighting"),
    ):
        kept, said = believable([wrong, good])
        assert kept == (good,)
        assert words in said
    assert believable([good]) == ((good,), "")


class Blind:
    """A detector that has gone wrong."""

    name = "ball"

    def in_frame(self, view):
        place = np.full(3, np.nan)
        return [Sighting("ball", "cam", view.frame.stamp, place, np.eye(3), place)]

    def in_pair(self, view, surface=False):
        return self.in_frame(view)


def test_an_eye_with_a_detector_gone_wrong_sees_nothing_and_warns():
    view = frame([], np.eye(4))
    seen = Eye("cam", Blind()).update([view])
    assert seen.looks[0].sightings == ()
    assert "position" in seen.warning


def test_a_mark_of_a_place_far_outside_of_the_picture_is_not_drawn():
    """OpenCV raises for so large a pixel, and the whole look would be lost."""
    image = np.zeros((270, 480, 3), np.uint8)
    beside = np.array([[1.0, 0.0, 1e-14]])
    assert not drawn(image, frame([], np.eye(4)).color_lens, [beside]).any()


def test_pictures_that_come_too_late_are_no_other_target():
    """Three cameras late by more than what is remembered, between two looks of the pair: that the
    estimate began anew at their old stamps put a moving target back to where it was."""
    f = filter_()
    for k in range(30):
        t = 0.05 * k
        f.add(look("wrist", t, (0.7, 0.2 * t, 0.8), 0.0005))
    before = f.estimate
    for camera, late in (("a", 0.62), ("b", 0.61), ("a", 0.60)):
        assert not f.add(look(camera, t - late, (0.7, 0.2 * (t - late), 0.8)))
    assert f.restarts == 0
    assert f.estimate.seen == before.seen
    assert np.array_equal(f.estimate.position, before.position)


def test_a_run_that_begins_anew_knows_nothing_of_the_cameras():
    """The same seed runs the same again: what a carried-off ball taught of a bias is gone, too."""

    def course(f):
        for k in range(12):
            f.add(look("a", 0.1 * k, (0.72, 0.0, 0.8)))
            f.add(look("wrist", 0.1 * k + 0.01, (0.7, 0.0, 0.8), 0.0005))
        for k in range(4):  # carried off: the estimate begins anew, biases are kept
            f.add(look("a", 1.13 + 0.02 * k, (1.7, 0.5, 0.8)))
        return f.estimate.position

    f = filter_()
    first = course(f)
    assert f.restarts == 1
    f.reset()
    assert np.array_equal(course(f), first)
