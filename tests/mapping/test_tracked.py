"""What a task tracks is no source of possible places; whoever is beside or behind it still is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.mapping.hazards import Tracked, UnseenPeople
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.mapping.tracked import KEPT, SHELL, TOUCHES, TrackedThing, growth
from armsight.motion.regions import Region

GRID = VoxelGrid(np.zeros(3), 0.02, (60, 60, 50))
STEP = 1.0 / 15
RADIUS = 0.06
RADIUS_OF_VOXEL = 0.5 * np.sqrt(3.0) * GRID.voxel
CENTERS = GRID.center(np.stack(np.unravel_index(np.arange(np.prod(GRID.shape)), GRID.shape), -1))
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Lower and upper corner [m]."""
ARM_SHADOW: Box = ((0.50, 0.40, 0.10), (0.90, 0.80, 0.60))
"""96 litres under the robot's arm that no camera sees: room for a person."""


def within(box: Box) -> np.ndarray:
    low, high = np.asarray(box)
    return ((low <= CENTERS) & (high >= CENTERS)).all(axis=1)


class Scene:
    """Perfect sight of a ball with a shadow of its own behind it, and of people."""

    def __init__(self, tracks: bool = True) -> None:
        table = np.zeros(GRID.shape, np.uint8)
        self.people = UnseenPeople(GRID, table, 2.0, 0.08)
        self.thing = TrackedThing(GRID)
        self.now = 0.0
        self.tracks = tracks

    def look(self, ball, *bodies: Box, hidden: tuple[Box, ...] = (), velocity=(0.0, 0.0, 0.0)):
        """One picture; returns where somebody unseen could be, (voxels,) bool."""
        self.now += STEP
        ball = np.asarray(ball, float)
        state = np.full(len(CENTERS), FREE, np.uint8)
        away = np.linalg.norm(CENTERS - ball, axis=1)
        beam = np.linalg.norm((CENTERS - ball)[:, 1:], axis=1)
        behind = (CENTERS[:, 0] > ball[0]) & (CENTERS[:, 0] < ball[0] + 0.20)
        state[(away < RADIUS) | ((beam < RADIUS) & behind)] = UNKNOWN
        for box in hidden:
            state[within(box)] = UNKNOWN
        seen = (np.abs(away - RADIUS) < 0.012) & (CENTERS[:, 0] < ball[0] + 0.01)
        for box in bodies:
            seen |= within(box)
        seen &= ~np.any([within(box) for box in hidden] or [np.zeros_like(seen)], axis=0)
        state[seen] = OCCUPIED
        listed = np.flatnonzero(seen).astype(np.int32)
        region = Region(
            "sphere", (RADIUS, 0, 0), make_pose(None, ball), self.now, np.asarray(velocity)
        )
        follows = self.thing.follow(region if self.tracks else None, self.now, self.now)
        tracked = Tracked(self.thing, seen.astype(np.uint8)) if follows else None
        self.people.update(state.reshape(GRID.shape), listed, None, STEP, tracked)
        self.away = away
        return self.people.mask().reshape(-1) != 0

    def beside(self, possible) -> int:
        """Voxels around the region in which somebody could be."""
        grown = growth(replace(REGION, exposure=self.now), self.now, RADIUS_OF_VOXEL)
        shell = (self.away > RADIUS + grown) & (self.away <= RADIUS + grown + SHELL * GRID.voxel)
        return int((possible & shell).sum())


REGION = Region("sphere", (RADIUS, 0.0, 0.0), np.eye(4), 0.0)
BALL = np.array([0.22, 0.60, 0.60])
BODY: Box = ((0.70, 0.30, 0.02), (1.00, 0.90, 0.90))


def started(tracks: bool = True, ball=BALL, hidden: tuple[Box, ...] = ()) -> Scene:
    """After the cell has been looked at, with nobody in it."""
    scene = Scene(tracks)
    for _ in range(3):
        scene.look(ball, hidden=hidden)
    return scene


def test_a_ball_alone_hides_nobody_in_its_shadow_and_without_a_task_it_might():
    assert started(False).look(BALL).any()
    assert not started(True).look(BALL).any()


@pytest.mark.parametrize("speed", [0.0, 0.3, 0.9])
def test_a_ball_that_comes_to_the_arms_shadow_does_not_fill_it_with_people(speed):
    """Tracked from the open: the shadow stays what it was, enclosed and empty."""
    for tracks in (True, False):
        scene = started(tracks, hidden=(ARM_SHADOW,))
        at = BALL.copy()
        velocity = np.array([1.0, 0.0, -0.3]) * speed
        for _ in range(12):
            if at[0] < 0.50:
                at = at + velocity * STEP
            possible = scene.look(at, hidden=(ARM_SHADOW,), velocity=velocity)
        joined = speed > 0.0
        assert possible[within(ARM_SHADOW)].any() == (joined and not tracks)
        assert (scene.beside(possible) > 0) == (not tracks)


def test_a_ball_that_begins_at_a_shadow_with_room_for_somebody_is_a_source_until_it_leaves_it():
    at = np.array([0.46, 0.60, 0.40])
    scene = started(True, at, (ARM_SHADOW,))
    possible = scene.look(at, hidden=(ARM_SHADOW,))
    assert possible[within(ARM_SHADOW)].any(), "who holds it may stand in there"
    assert scene.beside(possible) > 0
    possible = scene.look(BALL, hidden=(ARM_SHADOW,))
    assert not possible.any(), "apart from all else it is too small for anybody"


def test_a_hand_beside_the_ball_makes_it_a_source_again_at_once():
    scene = started()
    arm: Box = ((0.22, 0.57, 0.60 + 0.10), (0.28, 0.63, 0.98))
    head: Box = ((0.10, 0.30, 0.86), (0.60, 0.90, 0.98))
    assert not scene.look(BALL).any()
    possible = scene.look(BALL, arm, head)
    seen = scene.thing.holds(np.flatnonzero(possible).astype(np.int32))
    assert seen.any(), "the ball and what is hidden behind it"


def reach(t: float) -> Box:
    """A forearm that comes from a body beyond the ball, in its very shadow, at 2.0 m/s."""
    tip = max(0.70 - 2.0 * t, BALL[0] + RADIUS + 0.02)
    return ((tip, BALL[1] - 0.035, BALL[2] - 0.035), (0.72, BALL[1] + 0.035, BALL[2] + 0.035))


def test_a_hand_that_reaches_out_from_behind_the_ball_is_noticed_before_it_passes_it():
    """Of a hand in the ball's shadow nothing is seen; whose it is, is, and so was the way in."""
    scene = started()
    noticed = None
    for k in range(8):
        t = k * STEP
        low, high = reach(t)
        shadow: Box = ((BALL[0], *np.subtract(BALL[1:], RADIUS)), (0.50, *np.add(BALL[1:], RADIUS)))
        possible = scene.look(BALL, BODY, (low, high), hidden=(shadow,))
        if noticed is None and scene.beside(possible) >= 3:
            noticed = low[0]
            break
    assert noticed is not None
    grown = growth(replace(REGION, exposure=scene.now), scene.now, RADIUS_OF_VOXEL)
    assert noticed > BALL[0] + RADIUS
    assert noticed - 2.0 * STEP < BALL[0] + RADIUS + grown + SHELL * GRID.voxel


def test_who_stood_behind_the_ball_from_the_start_is_believed_to():
    scene = Scene()
    behind: Box = ((0.34, 0.40, 0.02), (0.62, 0.80, 0.80))
    for _ in range(20):
        possible = scene.look(BALL, hidden=(behind,))
    assert scene.beside(possible) > 0


def test_a_region_that_nobody_speaks_of_any_more_is_followed_for_a_moment_only():
    scene = started()
    scene.tracks = False
    still = [scene.look(BALL).any() for _ in range(int(KEPT / STEP) + 3)]
    assert not any(still[: int(KEPT / STEP) - 1])
    assert still[-1]


@pytest.mark.parametrize("at", [(0.03, 0.6, 0.6), (0.3, 1.17, 0.6), (np.nan, 0.6, 0.6)])
def test_at_the_border_of_the_map_nothing_is_followed(at):
    region = Region("sphere", (RADIUS, 0.0, 0.0), make_pose(None, np.array(at)), 0.0)
    assert not TrackedThing(GRID).follow(region, 0.0, 0.0)


def test_a_region_that_is_huge_or_unsure_is_not_followed():
    at = make_pose(None, BALL)
    huge = Region("box", (0.6, 0.6, 0.6), at, 0.0)
    unsure = Region("sphere", (RADIUS, 0.0, 0.0), at, 0.0, covariance=0.05 * np.eye(3))
    assert not TrackedThing(GRID).follow(huge, 0.0, 0.0)
    assert not TrackedThing(GRID).follow(unsure, 0.0, 0.0)
    assert not TrackedThing(GRID).follow(REGION, -np.inf, 0.0)


def test_rounds_are_counted_for_months():
    scene = Scene()
    scene.thing._round = 2**31 - 4
    for _ in range(5):
        possible = scene.look(BALL)
    assert not possible.any()
    assert scene.thing._round < 2**30


def test_what_is_in_a_region_may_be_this_far_from_it_in_the_map():
    """Half a voxel's diagonal, 2 cm, two deviations, and what it moves on while it lingers."""
    covariance = np.diag([0.01, 0.004, 0.002]) ** 2
    region = replace(REGION, exposure=1.0, covariance=covariance, drift=0.1)
    assert growth(region, 1.0, 0.0173) == pytest.approx(0.0173 + 0.02 + 2.0 * 0.01)
    assert growth(region, 1.2, 0.0173) == pytest.approx(0.0173 + 0.02 + 2.0 * (0.01 + 0.02))
    moving = replace(region, velocity=np.array([0.0, 0.3, 0.4]))
    assert growth(moving, 1.0, 0.0) == pytest.approx(0.02 + 2.0 * 0.01 + 0.1 * 0.5)


@pytest.mark.parametrize("now", [0.9, 1.0, 0.9 + KEPT, 1.1 + KEPT])
def test_a_region_is_kept_for_a_moment_and_never_from_a_time_to_come(now):
    """Nor where nobody knows of what time the map is."""
    thing = TrackedThing(GRID)
    region = Region("sphere", (RADIUS, 0.0, 0.0), make_pose(None, BALL), 1.0)
    assert thing.follow(region, 1.0, 1.0)
    assert thing.follow(None, 1.0, now) == (1.0 <= now <= 1.0 + KEPT)
    assert not TrackedThing(GRID).follow(region, -np.inf, 1.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_every_border_of_the_map_is_one(axis, side):
    """A region is followed where it and its shell lie within the map, a voxel from its end."""
    thing = TrackedThing(GRID)
    size = np.asarray(GRID.shape) * GRID.voxel
    still = Region("sphere", (RADIUS, 0.0, 0.0), np.eye(4), 1.0)
    reach = RADIUS + growth(still, 1.0, RADIUS_OF_VOXEL) + SHELL * GRID.voxel + GRID.voxel
    end = size[axis] if side > 0 else 0.0
    for room, follows in ((0.002, True), (-0.002, False)):
        at = 0.5 * size
        at[axis] = end - side * (reach + room)
        region = Region("sphere", (RADIUS, 0.0, 0.0), make_pose(None, at), 1.0)
        assert thing.follow(region, 1.0, 1.0) == follows
    away = np.linalg.norm(CENTERS - 0.5 * size, axis=1) - RADIUS
    assert thing.follow(replace(still, T_base_region=make_pose(None, 0.5 * size)), 1.0, 1.0)
    grown = growth(still, 1.0, RADIUS_OF_VOXEL)
    assert set(thing.inside) == set(np.flatnonzero(away <= grown))
    shell = (away > grown) & (away <= grown + SHELL * GRID.voxel)
    assert set(thing.around) == set(np.flatnonzero(shell))


@pytest.mark.parametrize(("count", "somebody"), [(TOUCHES - 1, False), (TOUCHES, True)])
def test_so_many_voxels_seen_beside_what_is_tracked_are_somebody_and_fewer_are_noise(
    count, somebody
):
    scene = started()
    scene.look(BALL)
    front = scene.thing.around[CENTERS[scene.thing.around, 0] < BALL[0]]
    beside = [tuple(map(tuple, (CENTERS[v] - 1e-6, CENTERS[v] + 1e-6))) for v in front[:count]]
    possible = scene.look(BALL, *beside)
    own = np.intersect1d(scene.thing.inside, np.flatnonzero(scene.away < RADIUS + 0.01))
    assert possible[own].any() == somebody
