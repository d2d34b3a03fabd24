"""What is seen inside of a declared solid is not that solid: nobody sees into one."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, look_at, transform
from armsight.mapping.backdrop import Backdrop
from armsight.mapping.declared import LOOKS
from armsight.mapping.intrusion import LASTS
from armsight.mapping.kernels.pixels import VALID
from armsight.mapping.kernels.solids import explained
from armsight.mapping.layers import fine_grid
from armsight.mapping.lens import DepthLens
from armsight.mapping.occupancy import DEEP, FORGET
from armsight.mapping.plausibility import Plausibility
from armsight.mapping.self_filter import SelfFilter
from armsight.mapping.snapshot import VoxelGrid
from armsight.mapping.static_geometry import rasterise
from armsight.mapping.workspace_map import WorkspaceMap

from . import scenes
from .test_backdrop import NOISE, RANGE, TOLERANCE, solids
from .test_declared import CAR, CONFIG, PERIOD, ROOM, close_to
from .test_declared import Cell as Declaring

LOW = scenes.box("car", (-0.8, 0.0, 0.13), (0.4, 0.8, 0.18))
"""What stands there: the car is declared 22 cm too high."""
ARM = scenes.box("arm", (-0.8, 0.1, 0.27), (0.1, 0.3, 0.1))
"""Lies on it."""
TUB = [
    scenes.box("floor", (-0.8, 0.0, 0.13), (0.4, 0.8, 0.18)),
    *(scenes.box("rim", (x, 0.0, 0.33), (0.03, 0.8, 0.22)) for x in (-0.985, -0.615)),
    *(scenes.box("rim", (-0.8, y, 0.33), (0.4, 0.03, 0.22)) for y in (-0.385, 0.385)),
]
"""Or this, into which somebody may reach."""
CAMERAS = [
    scenes.camera_info(name, at, (-0.8, 0.0, 0.2), (256, 212))
    for name, at in (("left", (0.5, -1.2, 1.0)), ("right", (0.4, 1.1, 1.1)))
]
"""Fine enough that a level surface shows as one."""
SECOND = round(1.0 / PERIOD)
ROBOT = scenes.two_link_arm()


class Cell(Declaring):
    def __init__(self):
        super().__init__(CAMERAS)


def declared(*solids, **more):
    """A cell whose file has these solids, more of them said of each."""
    cell = Cell()
    known = [replace(s, **more) for s in solids]
    cell.world = WorkspaceMap(ROBOT, CAMERAS, known, CONFIG)
    return cell


def test_an_arm_under_an_outline_that_is_too_high_is_a_hazard():
    """Until November 2026 nothing in it was: the arm came as near to it as to the car itself."""
    snapshot = declared(CAR).look(LOW, ARM, times=3)
    assert close_to(snapshot, ARM, within=0.03) > 15
    assert all(camera.alive for camera in snapshot.cameras)


def test_what_is_declared_coarsely_may_be_smaller_by_that_and_no_more():
    assert close_to(declared(CAR, coarse=0.26).look(LOW, times=3), LOW, within=0.03) == 0
    assert close_to(declared(CAR, coarse=0.08).look(LOW, times=3), LOW, within=0.03) > 15
    assert close_to(declared(CAR, coarse=0.05).look(LOW, ARM, times=3), ARM, within=0.03) > 15


@pytest.mark.parametrize("off", [0.0, 0.01])
def test_a_solid_that_is_declared_as_it_is_hides_nobody_and_nothing_is_told(off):
    """A centimetre too thick is within what a camera errs by."""
    smaller = replace(CAR, size=tuple(s - 2 * off for s in CAR.size))
    snapshot = declared(CAR).look(smaller, times=SECOND + 5)
    assert close_to(snapshot, CAR) == 0
    assert snapshot.inside == ()


def test_it_is_told_which_solid_is_declared_too_large_and_what_would_mend_it():
    cell = declared(CAR)
    assert cell.look(LOW, times=round(0.9 * LASTS / PERIOD)).inside == ()
    (told,) = cell.look(LOW, times=round(0.3 * LASTS / PERIOD)).inside
    assert told.solid.name == "car"
    assert told.depth == pytest.approx(0.18, abs=0.03), "from the nearest of its faces"
    assert CAR.distance(told.place[None])[0] == pytest.approx(-told.depth)
    assert "inside of 'car'" in str(told)
    coarse = float(str(told).rsplit("coarse to ")[-1].split()[0])
    assert close_to(declared(CAR, coarse=coarse).look(LOW, times=3), LOW, within=0.03) == 0


def test_a_stray_sighting_inside_is_withdrawn_once_the_surface_was_seen_again():
    """No look reaches what is inside of a solid: it would have stayed for ever."""
    cell = declared(CAR)
    assert close_to(cell.look(LOW, ARM, times=2), ARM, within=0.03) > 15
    snapshot = cell.look(CAR, times=round(FORGET / PERIOD) + 2)
    assert close_to(snapshot, CAR, within=-0.03) == 0


def test_who_is_hidden_from_all_looks_stays():
    """Somebody leans over what was seen inside: no look ends on the solid's surface there."""
    cell = declared(CAR)
    before = close_to(cell.look(LOW, ARM, times=2), ARM, within=0.03)
    over = scenes.box("over", (-0.8, 0.0, 0.6), (0.9, 1.4, 0.1))
    after = close_to(cell.look(LOW, ARM, over, times=round(FORGET / PERIOD) + 5), ARM, within=0.03)
    assert after >= 0.6 * before > 10


def test_what_was_seen_deep_inside_is_not_forgotten_by_the_word_that_a_car_stands_there():
    """Nobody sees it any more when the word is taken."""
    cell, over = Cell(), scenes.box("over", (-0.8, 0.0, 0.7), (1.2, 1.6, 0.1))
    arm = scenes.box("arm", (-0.8, 0.0, 0.29), (0.1, 0.4, 0.14))
    before = close_to(cell.look(*TUB, arm, times=2), arm, within=0.03)
    assert before > 10
    cell.world.declare("car", [CAR])
    snapshot = cell.look(*TUB, arm, over, times=LOOKS + 1)
    assert snapshot.declared[0].taken
    seen = cell.world._people.fine.occupancy
    assert (seen.inside_of(seen.dynamic)[1] > DEEP).sum() > 5


def test_however_coarsely_it_is_declared_what_is_not_there_is_seen_through():
    """Neither a word nor a picture is believed the more for it."""
    cell = Cell()
    cell.look(times=3)
    cell.world.declare("car", [replace(CAR, coarse=0.5)])
    assert cell.look(times=LOOKS + 1).declared[0].reason.startswith("refused: camera ")
    info = scenes.camera_info("big", (0.5, -1.2, 1.0), (-0.8, 0.0, 0.2), (512, 424))
    depth = scenes.ray_cast(info.depth, info.T_mount_camera, ROOM)
    wall, fields = scenes.box("wall", (-0.8, 0.0, 0.4), (0.4, 1.6, 0.8)), SelfFilter(ROBOT).fields
    said = []
    for coarse in (0.0, 0.5):
        static = rasterise([replace(wall, coarse=coarse)], fine_grid(CONFIG), 0.1)
        look = Plausibility(info, static, fields, np.zeros(3, np.float32))
        sample = look._sample(depth, np.full(depth.shape, VALID, np.uint8))
        said.append(look._through_solids(sample, info.T_mount_camera))
    assert "it sees through declared solids, 'wall' first" in said[0]
    assert said[0] == said[1]


def test_how_coarse_a_solid_is_must_be_a_length():
    for coarse in (-0.1, np.nan, np.inf):
        with pytest.raises(Exception, match="coarse is"):
            Cell().world.declare("car", [replace(CAR, coarse=coarse)])


@pytest.mark.parametrize("seed", range(4))
def test_points_are_explained_within_the_limit_of_the_surface_and_so_coarsely_inside(seed):
    """Against the definition, and the backdrop settles nothing else."""
    rng = np.random.default_rng(seed)
    things = [replace(s, coarse=float(rng.choice([0.0, 0.03]))) for s in solids(rng)]
    static = rasterise(things, VoxelGrid(np.array([-1.2, -1.2, -0.3]), 0.06, (40, 40, 25)), 0.1)
    points = rng.uniform([-1.15, -1.15, -0.25], [1.15, 1.15, 1.15], (4000, 3))
    near = things[1].T_frame_solid[:3, 3] + rng.normal(0.0, 0.12, (4000, 3))
    points = np.concatenate([points, near])
    index = static.grid.index(points)
    inside = ((index >= 0) & (index < static.grid.shape)).all(axis=1)
    points, index = points[inside], index[inside]
    said = static.nearest[tuple(index.T)]
    limits = rng.uniform(0.005, 0.05, len(points))
    slack = 0.5 * np.sqrt(3.0) * static.grid.voxel
    counts = {True: 0, False: 0}
    for p, cell, s, limit in zip(points, index, said, limits):
        found = explained(s, static.bound[tuple(cell)], slack, limit, static.table, *p)
        if s == 0:
            assert not found
            continue
        d = things[s - 1].distance(p[None])[0]
        assert found == (-limit - things[s - 1].coarse <= d <= limit)
        counts[bool(found)] += 1
    assert min(counts.values()) > 100


@pytest.mark.parametrize("seed", range(4))
def test_the_backdrop_settles_nothing_that_is_deep_inside(seed):
    rng = np.random.default_rng(seed)
    things = [replace(s, coarse=float(rng.choice([0.0, 0.03]))) for s in solids(rng)]
    camera = PinholeCamera(96, 80, 70.0, 70.0, 47.5, 39.5)
    lens = DepthLens(camera, 4.4)
    grid = VoxelGrid(np.array([-1.2, -1.2, -0.3]), 0.06, (40, 40, 25))
    backdrop = Backdrop(lens, RANGE, NOISE, rasterise(things, grid, 0.05))
    T = np.ascontiguousarray(look_at(rng.uniform([-1.5, -1.5, 0.8], [1.5, 1.5, 1.6]), np.zeros(3)))
    label = np.full((80, 96), VALID, np.uint8)
    backdrop.unexplained(np.ones((80, 96), np.float32), label, T, TOLERANCE)
    deep_seen = 0
    for _ in range(12):
        depth = rng.uniform(*RANGE, (80, 96)).astype(np.float32)
        done = backdrop.unexplained(depth, label, T, TOLERANCE) == 0
        z = depth.astype(float)[..., None]
        points = transform(T, np.concatenate([lens.rays * z, z], -1).reshape(-1, 3))
        limit = TOLERANCE[0] + TOLERANCE[1] * z + TOLERANCE[2] * (NOISE[0] + NOISE[2] * z**2)
        cell = (points - grid.origin) / grid.voxel
        outside = ((cell < 1e-4) | (cell > np.array(grid.shape) - 1e-4)).any(axis=1)
        deep = np.any(
            [-s.distance(points) > limit.reshape(-1) + s.coarse + 1e-5 for s in things], axis=0
        )
        assert not (done.reshape(-1) & deep & ~outside).any()
        deep_seen += int((deep & ~outside).sum())
    assert deep_seen > 100


def test_a_camera_in_a_solid_settles_nothing_there():
    room = replace(
        scenes.box("room", (0.0, 0.0, 0.4), (2.0, 2.0, 1.2)), T_frame_solid=from_rpy((0, 0, 0.3))
    )
    lens = DepthLens(PinholeCamera(32, 24, 30.0, 30.0, 15.5, 11.5), 4.4)
    grid = VoxelGrid(np.array([-1.2, -1.2, -0.3]), 0.06, (40, 40, 25))
    backdrop = Backdrop(lens, RANGE, NOISE, rasterise([room], grid, 0.05))
    T = np.ascontiguousarray(look_at(np.array([0.0, 0.0, 0.3]), np.array([0.1, 0.0, 0.0])))
    label, depth = np.full((24, 32), VALID, np.uint8), np.full((24, 32), 0.45, np.float32)
    backdrop.unexplained(depth, label, T, TOLERANCE)
    assert backdrop.unexplained(depth, label, T, TOLERANCE).all()


def test_the_clock_turned_back_tells_no_sooner_and_no_later():
    cell = declared(CAR)
    cell.count = 40
    cell.look(LOW, times=round(0.8 * LASTS / PERIOD))
    cell.count = 0
    assert cell.look(LOW, times=2).inside == ()
    assert cell.look(LOW, times=round(0.4 * LASTS / PERIOD)).inside != ()
