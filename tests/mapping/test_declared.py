"""Solids that come and go while the cell runs: what they explain, and what they do not."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import LOOKS
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes

CONFIG = MappingConfig(
    lower=(-1.2, -0.8, 0.0),
    upper=(-0.2, 0.8, 0.8),
    voxel=0.04,
    distance_cap=0.2,
    far_lower=(0, 0, 0),
    far_upper=(0, 0, 0),
    align=False,
    threads=1,
)
JOINTS = scenes.resting([0.0, 0.0], until=3.0)
ROOM = [
    scenes.box("wall", (-2.6, 0.0, 0.5), (0.1, 6.0, 4.0)),
    scenes.box("floor", (-0.6, 0.0, -0.1), (6.0, 6.0, 0.1)),
    *scenes.arm_solids(scenes.two_link_arm(), np.zeros(2)),
]
CAR = scenes.box("car", (-0.8, 0.0, 0.24), (0.4, 0.8, 0.4))
CAMERAS = [
    scenes.camera_info(name, at, (-0.8, 0.0, 0.2), (128, 106))
    for name, at in (("left", (0.5, -1.2, 1.0)), ("right", (0.4, 1.1, 1.1)))
]
PERIOD = 1 / 30


class Cell:
    """A map whose cameras see what is put there."""

    def __init__(self, cameras=CAMERAS):
        self.cameras = cameras
        self.world = WorkspaceMap(scenes.two_link_arm(), cameras, [], CONFIG)
        self.count = 0

    def look(self, *things, times=1, black=None):
        """Some pictures of each camera; ``black`` gives no return. The newest snapshot."""
        for _ in range(times):
            for n, info in enumerate(self.cameras):
                now = 0.1 + (self.count + n / len(self.cameras)) * PERIOD
                T = info.T_mount_camera
                depth = scenes.ray_cast(info.depth, T, [*ROOM, *things])
                if black is not None:
                    dark = scenes.ray_cast(info.depth, T, [black])
                    depth = np.where(dark <= depth, np.nan, depth)
                frame = scenes.frame(info, now, depth.astype(np.float32), self.count)
                snapshot = self.world.update([frame], JOINTS, now + 0.001)
            self.count += 1
        return snapshot


def close_to(snapshot, solid, within=0.05, seen=True):
    """How many hazards are in a solid or beside it."""
    chosen = snapshot.hazards[snapshot.hazard_unknown != seen]
    return int((solid.distance(chosen) <= within).sum()) if len(chosen) else 0


def parked():
    """A cell in which a car has been declared, and taken."""
    cell = Cell()
    assert close_to(cell.look(CAR, times=2), CAR) > 50
    cell.world.declare("car", [CAR])
    assert cell.look(CAR, times=LOOKS - 1).declared[0].waiting
    snapshot = cell.look(CAR, times=2)
    assert snapshot.declared[0].taken
    return cell, snapshot


def test_a_parked_car_is_solid_and_nobody_once_it_was_declared():
    """What was seen beside its surface is withdrawn like every stray sighting, in half a second."""
    cell, snapshot = parked()
    assert close_to(snapshot, CAR, within=-0.02) == 0
    snapshot = cell.look(CAR, times=18)
    assert close_to(snapshot, CAR) == 0
    assert close_to(snapshot, CAR, within=-0.02, seen=False) == 0
    inside = snapshot.grid.index(CAR.T_frame_solid[:3, 3][None])[0]
    assert snapshot.state[tuple(inside)] == OCCUPIED
    assert snapshot.distance[tuple(inside)] == 0.0
    assert all(camera.alive for camera in snapshot.cameras)


@pytest.mark.parametrize("y", [-0.3, 0.0, 0.3])
def test_somebody_who_stands_against_it_is_seen_as_without_it(y):
    person = scenes.sphere("person", (-0.5, y, 0.3), 0.1)
    cell, _ = parked()
    beside = cell.look(CAR, person, times=3)
    alone = Cell().look(person, times=3)
    assert beside.declared[0].taken
    outside = alone.hazards[~alone.hazard_unknown]
    outside = outside[CAR.distance(outside) > 0.06]
    known = {tuple(p) for p in beside.hazards}
    assert len(outside) > 8
    assert np.mean([tuple(p) in known for p in outside]) > 0.9


def test_somebody_within_what_was_declared_is_a_hazard_and_ends_it():
    """The car's front is not where it was: what is seen inside is a person."""
    cell, _ = parked()
    person = scenes.box("person", (-0.90, 0.0, 0.22), (0.3, 0.5, 0.4))
    snapshot = cell.look(person, times=2)
    assert "withdrawn: camera" in snapshot.declared[0].reason
    assert close_to(snapshot, person) > 20


def test_withdrawn_it_may_be_a_person_again_and_so_may_what_is_inside():
    cell, _ = parked()
    cell.world.withdraw("car")
    snapshot = cell.look(CAR)
    assert snapshot.declared == ()
    possible = cell.world._people.fine.unseen.mask()
    assert possible[tuple(snapshot.grid.index(CAR.T_frame_solid[:3, 3][None])[0])]
    assert close_to(cell.look(CAR, times=2), CAR) > 50


def test_when_it_has_driven_off_its_place_is_free():
    cell, _ = parked()
    snapshot = cell.look(times=4)
    assert not snapshot.declared[0].taken
    assert "sees through it" in snapshot.declared[0].reason
    middle = snapshot.state[tuple(snapshot.grid.index(np.array([[-0.8, 0.0, 0.3]]))[0])]
    assert middle != OCCUPIED
    assert close_to(snapshot, CAR) == 0
    assert all(camera.alive for camera in snapshot.cameras)


def test_what_is_not_there_is_refused_and_changes_nothing():
    cell = Cell()
    before = cell.look(times=3)
    cell.world.declare("car", [CAR])
    snapshot = cell.look(times=LOOKS + 1)
    assert snapshot.declared[0].reason.startswith("refused: camera ")
    np.testing.assert_array_equal(snapshot.state, before.state)


def test_black_plastic_that_gives_no_return_is_taken_by_the_word():
    cell = Cell()
    cell.look(black=CAR, times=2)
    cell.world.declare("car", [replace(CAR, material="black_plastic")])
    snapshot = cell.look(black=CAR, times=LOOKS + 1)
    assert snapshot.declared[0].taken
    inside = snapshot.grid.index(CAR.T_frame_solid[:3, 3][None])[0]
    assert snapshot.state[tuple(inside)] == OCCUPIED


def test_it_is_not_taken_while_a_camera_is_silent():
    cell = Cell()
    cell.look(CAR, times=2)
    cell.world.declare("car", [CAR])
    cell.cameras = CAMERAS[:1]
    snapshot = cell.look(CAR, times=2)
    assert snapshot.declared[0].waiting
    cell.cameras = CAMERAS
    assert cell.look(CAR, times=LOOKS + 1).declared[0].taken


def test_it_is_not_taken_while_no_camera_lives():
    """Whoever stands there would be nobody to the map, without a single look."""
    cell = Cell()
    cell.look(CAR, times=2)
    cell.world.declare("car", [CAR])
    for now in (0.5, 0.56, 0.62):
        snapshot = cell.world.update([], JOINTS, now)
        assert snapshot.declared[0].waiting
        assert close_to(snapshot, CAR) > 50
    snapshot = cell.world.update([], JOINTS, 2.6)
    assert snapshot.declared[0].reason == "refused: not all cameras gave pictures"
    assert close_to(snapshot, CAR) > 50


def test_a_clock_that_is_turned_back_has_nobody_wait_longer_for_silent_cameras():
    cell = Cell()
    cell.count = 75
    cell.look(CAR, times=2)
    cell.world.declare("car", [CAR])
    assert cell.world.update([], JOINTS, 2.75).declared[0].waiting
    assert cell.world.update([], JOINTS, 0.3).declared[0].waiting
    assert not cell.world.update([], JOINTS, 2.5).declared[0].held


BASE = np.eye(4)


@pytest.mark.parametrize(
    ("solid", "says"),
    [
        (Solid("x", "cone", (1, 1, 1), BASE), "cone"),
        (Solid("x", "box", (0.2, -1.0, 0.2), CAR.T_frame_solid), "above 0"),
        (Solid("x", "box", (0.2, 300.0, 0.2), CAR.T_frame_solid), "at most 20"),
        (Solid("x", "box", (0.2, np.nan, 0.2), CAR.T_frame_solid), "above 0"),
        (Solid("x", "box", (0.2, 0.2, 0.2), 2.0 * BASE), "rotation"),
        (Solid("x", "box", (0.2, 0.2, 0.2), make_pose(None, [9.0, 0, 0])), "outside"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(solid, says):
    world = WorkspaceMap(scenes.two_link_arm(), CAMERAS, [], CONFIG)
    with pytest.raises(UsageError, match=says):
        world.declare("thing", [solid])


def test_a_name_stands_for_one_thing():
    cell, _ = parked()
    with pytest.raises(UsageError, match="declared already"):
        cell.world.declare("car", [CAR])
    with pytest.raises(UsageError, match="declared are car"):
        cell.world.withdraw("cart")
    cell.world.withdraw("car")
    cell.world.declare("car", [CAR])
    assert cell.look(CAR, times=LOOKS + 2).declared[0].taken


def test_the_arm_itself_cannot_be_declared_away():
    config = replace(CONFIG, lower=(-0.2, -0.8, 0.0), upper=(1.2, 0.8, 0.8))
    world = WorkspaceMap(scenes.two_link_arm(), CAMERAS, [], config)
    depth = scenes.ray_cast(CAMERAS[0].depth, CAMERAS[0].T_mount_camera, ROOM)
    world.update([scenes.frame(CAMERAS[0], 0.1, depth, 0)], JOINTS, 0.101)
    world.declare("box", [scenes.box("box", (0.4, 0.0, 0.3), (0.2, 0.2, 0.2))])
    snapshot = world.update([], JOINTS, 0.16)
    assert "the arm itself" in snapshot.declared[0].reason
