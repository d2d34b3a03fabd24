"""Terms of the map that no test of a whole cell notices, each against a reckoning of its own."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.pose import transform
from armsight.mapping import plausibility
from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.occupancy import Occupancy
from armsight.mapping.plausibility import ARM_BEHIND, ARM_DEEP, _deep_points
from armsight.mapping.self_filter import body_fields
from armsight.mapping.snapshot import VoxelGrid
from armsight.mapping.static_geometry import rasterise
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes
from .test_map_oracle import CONFIG, JOINTS, TABLE
from .test_plausibility import Cell


def test_a_weak_sighting_of_a_clock_that_was_turned_back_confirms_none():
    grid = VoxelGrid(np.zeros(3), 0.02, (3, 3, 3))
    hit, weak, nothing = np.array([13], np.int32), np.zeros(1, np.uint8), np.zeros(27, np.uint8)
    for turned in (0.0, 0.5):
        seen = Occupancy(rasterise([], grid, 0.1), 1, 0.06, 0.15)
        seen.take(0, 1.0, hit, weak, nothing)
        if turned:
            seen.turn_back(turned)
        seen.take(0, 1.05 - turned, hit, weak, nothing)
        assert seen.dynamic.tolist() == ([] if turned else [13])
        seen.take(0, 1.10 - turned, hit, weak, nothing)
        assert seen.dynamic.tolist() == [13], "and those after it count"


def test_in_a_plate_nothing_is_deep():
    """A rod thinner than half of what is deep has no points; the rest of the arm has."""
    arm = scenes.two_link_arm()
    thin = arm.capsules.radius.copy()
    thin[2] = 0.4 * ARM_DEEP
    fields = body_fields(replace(arm, capsules=replace(arm.capsules, radius=thin)))
    parts, _ = _deep_points(fields)
    assert set(fields.link[parts]) == {0, 1}
    assert set(body_fields(arm).link[_deep_points(body_fields(arm))[0]]) == {0, 1, 2}


@pytest.mark.parametrize("stamp_error", [0.0, 0.01])
def test_the_arm_is_looked_for_as_far_aside_as_it_may_be(monkeypatch, stamp_error):
    """Pixels about each point, and behind which depth nobody may see."""
    cell, told = Cell(), {}
    stage = cell.map._stages[0]
    look, T = stage._plausibility, cell.info.T_mount_camera

    def count(depth, label, pixel, limit, room):
        told.update(pixel=pixel, limit=limit, room=room)
        return 0, 0

    monkeypatch.setattr(plausibility, "count_through", count)
    body = stage._filter.pose(np.array([-0.7, 0.3]), np.array([1.0, 1.0]))
    shape = (cell.info.depth.height, cell.info.depth.width)
    depth, label = np.ones(shape, np.float32), np.ones(shape, np.uint8)
    look._through_arm(depth, label, T, body, (0.02, 0.01), stamp_error)
    slip = body.speed[look._part] * stamp_error
    there = []
    for part, point in zip(look._part, look._inside):
        there.append(transform(np.linalg.inv(body.T_cells_base[part]), point[None])[0])
    z = transform(np.linalg.inv(T), np.array(there))[:, 2]
    np.testing.assert_allclose(told["limit"], z + ARM_BEHIND + slip)
    aside = np.ceil(cell.info.depth.fx * ((0.02 + slip) / z + 0.01))
    assert (z > 0.3).all()
    np.testing.assert_array_equal(told["room"], np.minimum(aside, 12))
    assert (aside < 12).any()


def test_a_map_that_no_camera_looks_at_is_of_no_time():
    """Nobody may take it for a picture of now."""
    world = WorkspaceMap(scenes.two_link_arm(), [], [TABLE], CONFIG)
    snapshot = world.update([], JOINTS, 0.5)
    assert (snapshot.stamp, snapshot.oldest) == (-np.inf, -np.inf)
    world.close()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_people_come_into_a_grid_only_from_one_that_encloses_it(axis, side):
    around = UnseenPeople(
        VoxelGrid(np.full(3, -1.0), 0.1, (20, 20, 20)), np.zeros((20, 20, 20), np.uint8), 2.0, 0.1
    )
    for beyond, fits in ((0.0, True), (0.4, False)):
        lower = np.full(3, -0.3)
        lower[axis] = (0.4 if side > 0 else -1.0) + side * beyond
        inner = VoxelGrid(lower, 0.05, (12, 12, 12))
        with nullcontext() if fits else pytest.raises(AssertionError):
            UnseenPeople(inner, np.zeros((12, 12, 12), np.uint8), 2.0, 0.1, around)


def test_what_a_task_tracks_is_where_it_is_in_the_newest_picture(monkeypatch):
    """Of two cameras' one, whichever is told first."""
    cameras = [
        scenes.camera_info("a", (1.3, 0.5, 1.1), (0.0, 0.0, 0.2)),
        scenes.camera_info("b", (-1.1, 0.6, 1.1), (0.0, 0.0, 0.2)),
    ]
    config = replace(CONFIG, lower=(-1.0, -1.0, -0.2), upper=(1.0, 1.0, 1.0))
    solids = [TABLE, *scenes.arm_solids(scenes.two_link_arm(), np.zeros(2))]
    world, told = WorkspaceMap(scenes.two_link_arm(), cameras, [TABLE], config), []
    finds = world._people.update

    def update(state, body, alive, times, region):
        told.append(times)
        return finds(state, body, alive, times, region)

    monkeypatch.setattr(world._people, "update", update)
    for stamps in ((0.10, 0.12), (0.16, 0.14)):
        frames = [
            scenes.frame(c, stamp, scenes.ray_cast(c.depth, c.T_mount_camera, solids))
            for c, stamp in zip(cameras, stamps)
        ]
        frames = [replace(f, sequence=len(told)) for f in frames]
        snapshot = world.update(frames, JOINTS, 0.17)
        assert all(camera.alive for camera in snapshot.cameras), snapshot.cameras
        assert told[-1][2] == max(stamps)
    world.close()
