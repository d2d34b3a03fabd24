"""Fine and coarse layer together: who counts as a person in each, by made-up sightings."""

import re

import numpy as np
import pytest

from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import DeclaredSolids
from armsight.mapping.layers import far_grid, fine_grid
from armsight.mapping.people import People
from armsight.mapping.things import PATIENCE

CONFIG = MappingConfig(
    lower=(-0.6, -0.6, 0.0),
    upper=(0.6, 0.6, 0.6),
    far_lower=(0.9, 0.9, 0.0),
    far_upper=(0.9, 0.9, 0.6),
)
STEP = 1 / 15
ALIVE = np.ones(2, np.uint8)
Block = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
BOX: Block = ((10, 14), (20, 24), (3, 7))
FINE, FAR = 0, 1


class Cell:
    """Two cameras that see everything in both layers, but for what is in a solid block."""

    def __init__(self) -> None:
        grid = fine_grid(CONFIG)
        layers = DeclaredSolids([], (grid, far_grid(CONFIG, grid))).layers
        self.people = People(layers, 2, CONFIG)
        self.alive = ALIVE
        self.layers = (self.people.fine, self.people.far)
        self.now = 0.0

    def look(self, *blocks: tuple[int, Block], seconds: float = STEP) -> np.ndarray:
        """(m, 3) where somebody is seen, after the scene has stood for a while."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for number, layer in enumerate(self.layers):
                seen = np.zeros(layer.grid.shape, np.uint8)
                for (a, b), (c, d), (e, f) in (b for n, b in blocks if n == number):
                    seen[a:b, c:d, e:f] = 1
                layer.occupancy.free[:] = 1 - seen.reshape(-1)
                hits = np.flatnonzero(seen).astype(np.int32)
                nothing = np.zeros(seen.size, np.uint8)
                layer.occupancy.take(0, self.now, hits, np.ones(len(hits), np.uint8), nothing)
            state = self.people.state(self.people.fine, self.alive)
            times = (self.now, STEP, self.now)
            points, unseen = self.people.update(
                state, np.zeros_like(state), self.alive, times, None
            )
        return points[~unseen]

    def at(self, points: np.ndarray, number: int, block: Block) -> int:
        """How many points lie in a block of a layer."""
        grid = self.layers[number].grid
        low, high = (np.array(edge) for edge in zip(*block))
        inside = (points >= grid.origin + low * grid.voxel - 1e-4) & (
            points <= grid.origin + high * grid.voxel + 1e-4
        )
        return int(inside.all(axis=1).sum())


def test_a_crowd_around_the_fine_layer_is_listed_whole():
    """Of each of its cells all the small cubes on faces; no matter how many there are."""
    crowd: Block = ((0, 14), (0, 50), (0, 20))
    assert len(Cell().look((FAR, crowd))) == 14 * 50 * 20 * (3**3 - 1)


def reaching(gap: int) -> Block:
    """A tip of one voxel before a rod of four, the tip so many free voxels from the box."""
    end = BOX[0][0] - gap
    return (end - 1, end), (21, 22), (4, 5)


@pytest.mark.parametrize(("number", "ends"), [(FINE, False), (FAR, True)])
def test_one_voxel_of_somebody_ends_a_thing_where_voxels_are_coarse(number, ends):
    """In the fine layer one voxel is noise; a coarse one is six centimetres of somebody."""
    cell = Cell()
    cell.look((number, BOX), seconds=2.0)
    assert cell.people.emptiness.said is False
    cell.people.declare_empty()
    assert cell.at(cell.look((number, BOX), seconds=2.0), number, BOX) == 0
    assert cell.people.emptiness.said
    tip = reaching(1)
    rod = (tip[0][0] - 6, tip[0][0]), (21, 23), (4, 6)
    seen = cell.look((number, BOX), (number, tip), (number, rod))
    assert cell.at(seen, number, rod) > 0, "the rod is somebody"
    assert (cell.at(seen, number, BOX) > 0) == ends
    # Three of them are somebody in the fine layer, too.
    wide = tip[0], (21, 23), (4, 6)
    seen = cell.look((number, BOX), (number, wide), (number, rod))
    assert cell.at(seen, number, BOX) > 0


@pytest.mark.parametrize("alive", [[1, 0], [0, 1], [0, 0]])
def test_an_empty_cell_is_believed_only_while_all_cameras_look(alive):
    cell = Cell()
    cell.look(seconds=2.0)
    cell.alive = np.array(alive, np.uint8)
    cell.people.declare_empty()
    cell.look(seconds=0.8 * PATIENCE)
    assert cell.people.emptiness.waiting
    assert not cell.people.emptiness.said
    assert cell.people.emptiness.reason == "not all cameras give pictures"
    cell.look(seconds=0.4 * PATIENCE)
    assert not cell.people.emptiness.waiting, "nobody waits for ever"
    refused = "the cell is not taken for empty: not all cameras give pictures"
    assert cell.people.emptiness.reason == refused
    cell.alive = ALIVE
    cell.look(seconds=1.0)
    assert not cell.people.emptiness.said, "it has to be said anew"
    cell.people.declare_empty()
    cell.look()
    assert cell.people.emptiness.said


@pytest.mark.parametrize("number", [FINE, FAR])
def test_where_something_moves_is_said_while_the_cell_is_not_believed_to_be_empty(number):
    cell = Cell()
    cell.look((number, BOX), seconds=2.0)
    block = ((12, 30) if number == FINE else (12, 15)), (4, 10), (2, 9)
    cell.look((number, BOX), (number, block))
    cell.people.declare_empty()
    cell.look((number, BOX), (number, block))
    assert cell.people.emptiness.waiting
    place = re.fullmatch(
        r"something moves near \((.*), (.*), (.*)\) m", cell.people.emptiness.reason
    )
    assert cell.at(np.array([place.groups()], float), number, block) == 1
    cell.look((number, BOX), (number, block), seconds=1.5)
    assert cell.people.emptiness.said, "it has come to rest"


SOMEBODY: tuple[Block, Block] = (((30, 52), (8, 30), (3, 27)), ((40, 46), (20, 26), (2, 8)))
"""As large as a person: in the fine layer, and in the far one beside it."""


def came_in(number: int) -> Cell:
    """Somebody came into a cell, has stood still for ten seconds, and it is said to be empty."""
    cell = Cell()
    cell.look(seconds=2.0)
    cell.look((number, SOMEBODY[number]), seconds=10.0)
    cell.people.declare_empty()
    cell.look((number, SOMEBODY[number]))
    return cell


@pytest.mark.parametrize("number", [FINE, FAR])
def test_whoever_came_in_is_no_thing_by_a_word(number):
    """Their place is said; whoever looks there, and says so again, is believed."""
    cell = came_in(number)
    body = number, SOMEBODY[number]
    assert not cell.people.emptiness.said
    assert not cell.people.emptiness.waiting
    reason = cell.people.emptiness.reason
    place = re.search(r"keep still near \((.*), (.*), (.*)\) m; look there", reason)
    assert place, reason
    assert cell.at(np.array([place.groups()], float), *body) == 1
    assert cell.at(cell.look(body, seconds=0.5), *body) > 0
    cell.people.declare_empty()
    cell.look(body, seconds=0.5)
    assert not cell.people.emptiness.said, "a button pressed twice is not a second look"
    cell.look(body, seconds=3.0)
    cell.people.declare_empty()
    assert cell.at(cell.look(body, seconds=0.5), *body) == 0
    assert cell.people.emptiness.said


@pytest.mark.parametrize("wait", [40.0, 3.0])
def test_a_second_look_counts_where_the_first_was_doubted_and_soon(wait):
    cell = came_in(FINE)
    cell.look((FINE, SOMEBODY[FINE]), seconds=wait)
    elsewhere: Block = ((4, 26), (30, 52), (3, 27))
    who = (FINE, SOMEBODY[FINE]) if wait > 10 else (FINE, elsewhere)
    cell.look(who, seconds=3.0)
    cell.people.declare_empty()
    cell.look(who, seconds=0.5)
    assert not cell.people.emptiness.said


@pytest.mark.parametrize("number", [FINE, FAR])
@pytest.mark.parametrize("before", [0.0, 2.0])
def test_what_comes_into_view_with_the_word_that_nobody_is_there_is_looked_at_for_a_second(
    number, before
):
    """Whatever the clock says: a session's does not begin at 0."""
    cell = Cell()
    cell.now = 1000.0
    if before:
        cell.look(seconds=before)
    cell.people.declare_empty()
    cell.look((number, BOX))
    assert cell.people.emptiness.waiting
    assert "something moves near" in cell.people.emptiness.reason
    cell.look((number, BOX), seconds=1.2)
    assert cell.people.emptiness.said


@pytest.mark.parametrize("waiting", [True, False])
def test_the_word_that_nobody_is_there_does_not_outlive_its_clock(waiting):
    """One that still waited would be taken when the clock is there again, however late."""
    cell = Cell()
    cell.now = 1000.0
    cell.look((FINE, BOX), seconds=2.0)
    cell.people.declare_empty()
    cell.alive = np.array([1, 0], np.uint8) if waiting else ALIVE
    cell.look((FINE, BOX))
    assert cell.people.emptiness.waiting == waiting
    cell.people.turn_back(900.0)
    cell.now, cell.alive = cell.now - 900.0, ALIVE
    cell.look((FINE, BOX), seconds=2.0)
    assert not cell.people.emptiness.said
    assert cell.people.emptiness.reason == "the clock was turned back; say it again"
