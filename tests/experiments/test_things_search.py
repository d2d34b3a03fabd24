"""The search that attacks the rule of things: its sight is right, and it finds a rule that errs."""

import numpy as np
import pytest

from armsight.experiments import things_search
from armsight.experiments.things_search import EYES, GRID, VOXEL, MadeUp, Somebody, episode
from armsight.experiments.things_search_kernels import look
from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.mapping.things import Things


def test_sight_is_that_of_rays_followed_in_small_steps():
    rng = np.random.default_rng(3)
    shape, origin = (12, 10, 8), np.array([-0.2, 0.1, 0.0])
    matter = (rng.random(shape) < 0.08).astype(np.uint8)
    eyes = np.array([[1.0, 0.8, 1.5], [-1.0, -0.5, 0.9]])
    state = np.empty(shape, np.uint8)
    look(matter, origin, VOXEL, eyes, state)
    for index in np.argwhere(rng.random(shape) < 0.3):
        seen = False
        for eye in eyes:
            start = np.asarray(index) + 0.5
            way = (eye - origin) / VOXEL - start
            # Steps of a hundredth of a voxel, of which every fiftieth is the kernel's.
            steps = start + np.arange(0.5, 60.0, 0.5)[:, None] * way / np.linalg.norm(way)
            cells = np.floor(steps).astype(int)
            inside = ((cells >= 0) & (cells < shape)).all(axis=1)
            cells = cells[: int(np.argmin(inside)) if not inside.all() else None]
            others = cells[(cells != index).any(axis=1)]
            seen |= not matter[tuple(others.T)].any()
        expected = UNKNOWN if not seen else OCCUPIED if matter[tuple(index)] else FREE
        assert state[tuple(index)] == expected


def test_somebody_is_no_smaller_than_the_rule_takes_people_for():
    world = MadeUp(np.random.default_rng(0))
    for low in (0.0, 0.5, 1.0):
        who = Somebody(np.array([0.3, 0.2, 0.0]), low)
        assert world._filled(who.shapes()).sum() * VOXEL**3 > 0.04


@pytest.mark.parametrize("run", range(3))
def test_nobody_is_missed(run, monkeypatch):
    monkeypatch.setattr(things_search, "SECONDS", 7.0)
    found = episode(11, run)
    assert found["missed"] == 0
    assert not found["contact"]


@pytest.mark.parametrize(("rule", "hiding", "found"), [(1, 0, False), (0, 1, False), (1, 1, True)])
def test_a_rule_that_errs_is_found(rule, hiding, found, monkeypatch):
    """All that is seen is a thing, who is unseen does not move: either alone the other mends."""
    monkeypatch.setattr(things_search, "SECONDS", 7.0)
    if rule:
        monkeypatch.setattr(Things, "_people", lambda self, c: np.zeros(len(c), bool))
    if hiding:
        monkeypatch.setattr(UnseenPeople, "_steps", lambda self, elapsed: 0)
    assert episode(11, 0)["contact"] == found


def test_eyes_are_outside_of_what_they_see():
    upper = GRID.origin + np.asarray(GRID.shape) * VOXEL
    assert ((GRID.origin > EYES) | (upper < EYES)).any(axis=1).all()
