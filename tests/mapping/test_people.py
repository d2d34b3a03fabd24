"""Fine and coarse layer together: who counts as a person in each, by made-up sightings."""

import numpy as np
import pytest

from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import DeclaredSolids
from armsight.mapping.layers import far_grid, fine_grid
from armsight.mapping.people import People

CONFIG = MappingConfig(
    lower=(-0.6, -0.6, 0.0),
    upper=(0.6, 0.6, 0.6),
    far_lower=(0.9, 0.9, 0.0),
    far_upper=(0.9, 0.9, 0.6),
)
STEP = 1 / 15
ALIVE = np.ones(1, np.uint8)
Block = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
BOX: Block = ((10, 14), (20, 24), (3, 7))
FINE, FAR = 0, 1


class Cell:
    """One camera that sees everything in both layers, but for what is in a solid block."""

    def __init__(self) -> None:
        grid = fine_grid(CONFIG)
        self.people = People(DeclaredSolids([], (grid, far_grid(CONFIG, grid))).layers, 1, CONFIG)
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
                layer.occupancy.free[0] = 1 - seen.reshape(-1)
                hits = np.flatnonzero(seen).astype(np.int32)
                nothing = np.zeros(seen.size, np.uint8)
                layer.occupancy.take(0, self.now, hits, np.ones(len(hits), np.uint8), nothing)
            state = self.people.state(self.people.fine, ALIVE)
            times = (self.now, STEP, self.now)
            points, unseen = self.people.update(state, np.zeros_like(state), ALIVE, times, None)
        return points[~unseen]

    def at(self, points: np.ndarray, number: int, block: Block) -> int:
        """How many points lie in a block of a layer."""
        grid = self.layers[number].grid
        low, high = (np.array(edge) for edge in zip(*block))
        inside = (points >= grid.origin + low * grid.voxel - 1e-4) & (
            points <= grid.origin + high * grid.voxel + 1e-4
        )
        return int(inside.all(axis=1).sum())


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
