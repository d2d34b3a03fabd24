"""Above the mapped box somebody is only within an arm's length of where they reach out of it."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.mapping.config import MappingConfig
from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.layers import far_grid, fine_grid
from armsight.mapping.overhead import Overhead
from armsight.mapping.snapshot import FREE, UNKNOWN

REACH = 0.6
UP = (0.0, 0.0, 1.0)
LOWER, UPPER = (-0.6, -0.6, 0.0), (0.6, 0.6, 0.6)
CELL = 0.06


class Cell:
    """Perfect sight of seen boxes and of hidden ones; all else is seen free."""

    def __init__(self, up=UP, reach: float = REACH) -> None:
        down = up[2] < 0.0
        lower = (*LOWER[:2], -UPPER[2]) if down else LOWER
        upper = (*UPPER[:2], -LOWER[2]) if down else UPPER
        config = MappingConfig(
            lower=lower, upper=upper, far_lower=(0.9, 0.9, 0.0), far_upper=(0.9, 0.9, 0.0),
            reach=reach, up=up,
        )  # fmt: skip
        self.sign = -1.0 if down else 1.0
        self.far = far_grid(config, fine_grid(config))
        self.overhead = Overhead(fine_grid(config), config)
        every = np.indices(self.far.shape).reshape(3, -1).T
        self.centers = self.far.center(every)
        nothing = np.zeros(self.far.shape, np.uint8)
        self.people = UnseenPeople(self.far, nothing, 2.0, 0.08)

    def within(self, box) -> np.ndarray:
        low, high = np.asarray(box)
        at = self.centers * [1.0, 1.0, self.sign]
        return ((low <= at) & (high >= at)).all(axis=1)

    def points(self, seen=(), hidden=()) -> np.ndarray:
        """The lid's points after one picture, with height counted from the floor."""
        state = np.full(len(self.centers), FREE, np.uint8)
        for box in (*seen, *hidden):
            state[self.within(box)] = UNKNOWN
        there = np.any([self.within(b) for b in seen] or [np.zeros(len(state), bool)], axis=0)
        there &= ~np.any([self.within(b) for b in hidden] or [np.zeros_like(there)], axis=0)
        dynamic = np.flatnonzero(there).astype(np.int32)
        self.people.update(state.reshape(self.far.shape), dynamic, None, 0.0)
        lid = self.overhead.lid(self.people)
        return self.overhead.points(self.people.reaching(dynamic, lid)) * [1.0, 1.0, self.sign]


HEAD = ((0.0, 0.0, 0.0), (0.2, 0.2, 0.45))
ARM = ((0.0, 0.0, 0.0), (0.08, 0.08, 0.6))


@pytest.mark.parametrize("up", [UP, (0.0, 0.0, -1.0)])
def test_who_ends_below_the_top_has_nothing_above_it(up):
    points = Cell(up=up).points(seen=[HEAD])
    assert len(points) == 0


@pytest.mark.parametrize("up", [UP, (0.0, 0.0, -1.0)])
def test_an_arm_through_the_top_reaches_as_far_as_it_is_long(up):
    cell = Cell(up=up)
    points = cell.points(seen=[HEAD, ARM])
    arm = cell.centers[cell.within(ARM), :2]
    body = cell.centers[cell.within(HEAD) | cell.within(ARM), :2]
    away = np.linalg.norm(points[:, None, :2] - body, axis=2).min(axis=1)
    assert away.max() <= REACH + 2.0 * CELL
    np.testing.assert_allclose(points[:, 2], 0.6 - 0.02, atol=1e-6)
    every = np.linalg.norm(cell.centers[:, None, :2] - arm, axis=2).min(axis=1) <= REACH
    reached = {tuple(p) for p in np.round(points[:, :2], 3)}
    assert {tuple(p) for p in np.round(cell.centers[every, :2], 3)} <= reached


def test_nobody_is_above_a_map_that_ends_higher_than_anybody_reaches():
    assert len(Cell(reach=0.0).points(seen=[HEAD, ARM])) == 0


def near(points: np.ndarray, x: float, y: float) -> bool:
    return bool((np.linalg.norm(points[:, :2] - [x, y], axis=1) < CELL).any())


def test_an_arm_that_nobody_sees_belongs_to_whom_it_hangs_together_with():
    """In the shadow of the one who stretches it, say."""
    shadow = ((0.1, 0.1, 0.3), (0.25, 0.25, 0.6))
    assert near(Cell().points(seen=[HEAD], hidden=[shadow]), 0.5, 0.2)
    elsewhere = ((-0.5, -0.5, 0.3), (-0.35, -0.35, 0.6))
    assert len(Cell().points(seen=[HEAD], hidden=[elsewhere])) == 0


def test_the_points_stand_for_all_of_their_cells():
    """No part of somebody above the lid is nearer to the arm than a hazard of their cell."""
    rng = np.random.default_rng(3)
    cell = Cell()
    points = cell.points(seen=[HEAD, ARM])
    inner = np.abs(points[:, :2]).max(axis=1) < 0.3  # cells all around them are reached as well
    there = points[inner][rng.integers(inner.sum(), size=4000)]
    part = there + np.c_[rng.uniform(-0.5, 0.5, (4000, 2)) * CELL, np.zeros(4000)]
    part[:, 2] = 0.6 + rng.exponential(0.1, 4000)
    arm = np.c_[rng.uniform(-0.6, 0.6, (4000, 2)), rng.uniform(0.0, 0.57, 4000)]
    truth = np.linalg.norm(part - arm, axis=1)
    radius = 0.5 * np.sqrt(3.0) * 0.02
    counted = np.array([np.linalg.norm(points - a, axis=1).min() for a in arm]) - radius
    assert (counted <= truth + 1e-9).all()
