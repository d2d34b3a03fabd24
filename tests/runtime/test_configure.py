"""What a workcell's settings become: the mapped box, and where people are looked for around it."""

import numpy as np
import pytest

from armsight.experiments.episodes import with_simulation
from armsight.geometry.pose import from_rpy, inverse, transform
from armsight.mapping.layers import far_grid, fine_grid
from armsight.runtime.configure import LOWEST, SIDEWAYS, mapping_config
from armsight.runtime.session import Session
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged
from armsight.workcell.schema_things import ObjectSection

CELL = load_workcell(packaged()["ur5_four_cameras"])
POSES = {
    "on a table": from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.87)),
    "turned": from_rpy((0.0, 0.0, np.pi / 2), (0.1, 0.2, 0.87)),
    "hanging": from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 1.9)),
    "on a wall": from_rpy((0.0, np.pi / 2, 0.0), (0.0, 0.0, 1.2)),
}


def corners(grid):
    """The grid's two corners in its own frame."""
    return np.stack([grid.origin, grid.origin + np.array(grid.shape) * grid.voxel])


@pytest.mark.parametrize("name", POSES)
def test_people_are_looked_for_around_the_box_and_down_to_the_floor(name):
    """In the world, however the arm is mounted."""
    T_world_base = POSES[name]
    config = mapping_config(CELL, T_world_base, 1.0)
    fine = fine_grid(config)
    far = far_grid(config, fine)
    box, around = (np.sort(transform(T_world_base, corners(g)), axis=0) for g in (fine, far))
    coarse = far.voxel
    section = CELL.mapping
    np.testing.assert_allclose(box[0], section.lower, atol=config.voxel)
    np.testing.assert_allclose(box[1], section.upper, atol=config.voxel)
    beyond_low, beyond_high = box[0] - around[0], around[1] - box[1]
    assert (beyond_low[:2] >= np.array(SIDEWAYS) - 1e-6).all()
    assert (beyond_high[:2] >= np.array(SIDEWAYS) - 1e-6).all()
    assert LOWEST - 2 * coarse < around[0, 2] <= LOWEST + 1e-6
    assert beyond_high[2] < 2 * coarse


def test_a_box_that_reaches_the_floor_has_nothing_below():
    low = CELL.mapping.model_copy(update={"lower": (-1.2, -1.2, 0.0)})
    config = mapping_config(CELL.model_copy(update={"mapping": low}), POSES["on a table"], 1.0)
    assert config.far_lower == (1.2, 1.2, 0.0)


def test_who_kneels_before_the_table_is_a_hazard_before_the_hand_comes_up(gl):
    """Below the table's top, 20 cm before its edge: under the box, where nobody used to look."""
    place = (1.25, 0.0, 0.45)
    kneeling = ObjectSection(name="head", kind="box", size=(0.2, 0.2, 0.3), position=place)
    with open_cell(with_simulation(CELL, person=(), object=(kneeling,)), 0) as cell:
        session = Session(cell, PatrolTask(CELL.goals, 0.5), seed=0)
        session.run(0.6)
        snapshot = session.view().snapshot
        at = transform(inverse(cell.T_world_base), np.array([place]))[0]
    seen = snapshot.hazards[~snapshot.hazard_unknown]
    assert (seen[:, 2] < snapshot.grid.origin[2]).all()
    off = np.abs(seen - at)
    assert (off < [0.2, 0.2, 0.25]).all(axis=1).sum() > 20
