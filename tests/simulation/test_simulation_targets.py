"""Targets of servoing: where they are, how they move, what they look like."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy
from armsight.simulation.movers import MovingObject
from armsight.simulation.targets import (
    BALL_RADIUS,
    FACE_RADIUS,
    RINGS,
    TargetSpec,
    target_object,
    wander,
)

T = from_rpy((0.3, -0.4, 1.1), (0.8, 0.1, 1.2))


def solids(kind):
    """Every solid of a target, posed in world."""
    item = target_object(TargetSpec("it", kind, T))
    yield item.solid, item.solid.T_frame_solid
    for part in item.parts:
        yield part, item.solid.T_frame_solid @ part.T_frame_solid


@pytest.mark.parametrize("kind", ["bullseye", "smiley", "hand"])
def test_the_frame_of_a_target_lies_on_its_surface_with_z_outward(kind):
    inside, outside = T[:3, 3] - 0.002 * T[:3, 2], T[:3, 3] + 0.0015 * T[:3, 2]
    near = [
        (solid.distance(np.array([inside, outside])), pose)
        for solid, pose in ((_at(s, p), p) for s, p in solids(kind))
    ]
    assert min(d[0] for d, _ in near) < 0.0
    assert min(d[1] for d, _ in near) > 0.0


def test_the_bulls_eye_s_rings_are_about_its_frame_and_the_smallest_is_in_front():
    discs = [(_at(s, p), p) for s, p in solids("bullseye") if "ring" in s.name]
    assert [s.size[0] for s, _ in discs] == list(RINGS)
    heights = [(p[:3, 3] - T[:3, 3]) @ T[:3, 2] for _, p in discs]
    assert heights == sorted(heights)
    for _, pose in discs:
        across = (pose[:3, 3] - T[:3, 3]) - ((pose[:3, 3] - T[:3, 3]) @ T[:3, 2]) * T[:3, 2]
        assert np.linalg.norm(across) < 1e-9


def test_a_held_ball_is_one_with_a_glove_behind_it_along_x():
    (ball, pose), *arm = solids("held_ball")
    assert ball.size[0] == BALL_RADIUS
    assert np.allclose(pose, T)
    behind = T[:3, 3] + np.linspace(0.0, 0.4, 81)[:, None] * T[:3, 0]
    distance = np.min([_at(s, p).distance(behind) for s, p in arm], axis=0)
    inside = np.flatnonzero(distance < 0.0)
    assert inside[0] * 0.005 == pytest.approx(BALL_RADIUS, abs=0.006)
    assert (np.diff(inside) == 1).all()
    assert inside[-1] * 0.005 > 0.35
    before = T[:3, 3] - 0.5 * BALL_RADIUS * T[:3, 0]
    assert min(_at(s, p).distance(before[None])[0] for s, p in arm) > 0.5 * BALL_RADIUS


def test_a_ball_is_a_ball_and_a_smiley_measures_twenty_centimetres():
    ((ball, pose),) = solids("ball")
    assert ball.size[0] == BALL_RADIUS
    assert np.allclose(pose, T)
    face = next(s for s, _ in solids("smiley") if s.name == "it/face")
    assert 2 * face.size[0] == pytest.approx(0.20)
    assert face.size[0] == FACE_RADIUS


@pytest.mark.parametrize("seed", range(5))
def test_who_wanders_keeps_its_room_and_speed_and_begins_at_rest(seed):
    start, room = np.array([0.8, 0.1, 1.2]), (0.1, 0.2, 0.15)
    path = wander(start, room, 0.2, np.random.default_rng(seed))
    times = np.arange(0.0, 60.0, 0.01)
    places = np.array([path(t) for t in times])
    assert np.allclose(places[0], start)
    assert (np.abs(places - start) <= np.array(room) + 1e-9).all()
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.01
    assert speed.max() <= 0.2 + 1e-6
    assert speed[:2].max() < 0.002
    assert places.std(axis=0).max() > 0.01
    again = wander(start, room, 0.2, np.random.default_rng(seed))
    assert np.array_equal(again(33.3), path(33.3))


def test_the_page_leads_who_wanders_and_lets_it_go_again():
    item = target_object(TargetSpec("ball", "ball", T, path="wander", max_speed=0.5))
    mover = MovingObject(item, (3,))
    place, turn = np.zeros((1, 3)), np.zeros((1, 4))
    for t in np.arange(0, 2, 0.01):
        mover.update(float(t), place, turn)
    away = mover.position + np.array([0.0, 0.3, 0.0])
    mover.drag(away)
    for t in np.arange(2, 3, 0.01):
        mover.update(float(t), place, turn)
    assert np.allclose(place[0], away)
    mover.drag(None)
    for t in np.arange(3, 6, 0.01):
        mover.update(float(t), place, turn)
    other = MovingObject(item, (3,))
    other.update(5.99, turn[:, :3], turn)
    assert np.allclose(mover.position, other.position, atol=0.01)


def test_a_target_follows_a_function_of_time_as_fast_as_that_goes_and_then_its_own_path():
    item = target_object(TargetSpec("ball", "ball", T, path="wander", max_speed=0.5))
    mover, other = MovingObject(item, (3,)), MovingObject(item, (3,))
    place, turn = np.zeros((1, 3)), np.zeros((1, 4))
    mover.drag(np.zeros(3))
    mover.follow(lambda t: np.array([5.0 * t, 1.0, 0.2]))
    for t in (0.1, 0.2, 0.7):
        mover.update(t, place, turn)
        np.testing.assert_array_equal(place[0], [5.0 * t, 1.0, 0.2])
    mover.follow(None)
    mover.update(1.3, place, turn)
    other.update(1.3, place, turn)
    np.testing.assert_array_equal(mover.position, other.position)
    mover.follow(lambda t: np.zeros(3))
    mover.reset()
    np.testing.assert_array_equal(mover.position, T[:3, 3])


def _at(solid, pose):
    from dataclasses import replace

    return replace(solid, T_frame_solid=pose)
