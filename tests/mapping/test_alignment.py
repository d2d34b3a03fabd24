"""Fine alignment of one camera against the arm and declared solids, on synthetic truth."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armsight.devices.data import JointState
from armsight.devices.history import JointHistory
from armsight.experiments.episodes import packaged_cell, with_simulation
from armsight.geometry.pose import exp, inverse, make_pose, transform
from armsight.mapping import alignment as a
from armsight.mapping.config import MappingConfig
from armsight.mapping.layers import fine_grid
from armsight.mapping.lens import DepthLens
from armsight.mapping.mounting import CHECKS, MOVED, Mounting
from armsight.mapping.self_filter import SelfFilter
from armsight.mapping.static_geometry import rasterise
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.runtime.config import SessionConfig
from armsight.runtime.parts import make_parts
from armsight.workcell import open_cell

from . import scenes

THINGS = [
    scenes.box("table", (0.3, 0, -0.05), (2.0, 2.0, 0.1)),
    scenes.box("post", (0.0, 0.6, 0.3), (0.2, 0.2, 0.6)),
]
Q = np.array([0.5, -0.3])
INFO = scenes.camera_info("cam", (1.2, -0.6, 1.3), noise=scenes.DepthNoise(0.001, 0.0, 0.001))
CONFIG = MappingConfig(lower=(-0.8, -0.8, -0.1), upper=(0.9, 0.8, 0.9))


@pytest.fixture(scope="module")
def cell():
    robot = scenes.two_link_arm()
    solids = [*THINGS, *scenes.arm_solids(robot, Q)]
    depth = scenes.ray_cast(INFO.depth, INFO.T_mount_camera, solids)
    depth = scenes.add_noise(depth, INFO.noise, np.random.default_rng(0))
    return robot, depth


@pytest.mark.parametrize("seed", range(4))
def test_a_displaced_camera_is_found_within_the_error_it_states(cell, seed):
    robot, depth = cell
    body = SelfFilter(robot)
    pose = body.pose(Q, np.zeros(2))
    rng = np.random.default_rng(seed)
    twist = np.concatenate([rng.uniform(-0.02, 0.02, 3), rng.uniform(-0.012, 0.012, 3)])
    believed = INFO.T_mount_camera @ exp(twist)
    points = INFO.depth.deproject(depth).reshape(-1, 3)[::3].astype(float)
    view = a.AlignmentView(points[np.isfinite(points).all(axis=1)], pose.T_cells_base)
    solids = rasterise(THINGS, fine_grid(CONFIG), 0.1)
    found = a.align_camera([view], [believed], body.fields, solids)
    assert found.good
    at = np.array([[0.0, 0, 0.3], [0.5, 0.3, 0.1], [-0.4, -0.4, 0.5]])
    true = transform(inverse(INFO.T_mount_camera), at)
    seen = transform(inverse(believed @ found.T_old_new), at) / found.gain
    stated = 3.0 * found.error_at(true)
    assert (np.linalg.norm(seen - true, axis=1) <= stated).all()
    wrong = np.linalg.norm(transform(inverse(believed), at) - true, axis=1)
    assert (np.linalg.norm(seen - true, axis=1) < 0.5 * wrong).all()


def test_error_at_a_point_is_the_spread_of_where_it_is_seen():
    """Against sampled poses and scales."""
    rng = np.random.default_rng(0)
    root = rng.standard_normal((7, 7)) * 1e-3
    covariance = root @ root.T
    found = a.Alignment(np.eye(4), 1.0, 0, 0.0, 0.0, covariance, True)
    points = rng.uniform([-1, -1, 1], [1, 1, 3], (3, 3))
    drawn = rng.multivariate_normal(np.zeros(7), covariance, 20_000)
    for point, sigma in zip(points, found.error_at(points)):
        moved = drawn[:, :3] + np.cross(drawn[:, 3:6], point) + drawn[:, 6:] * point
        greatest = np.sqrt(np.linalg.eigvalsh(np.cov(moved.T))[-1])
        assert sigma == pytest.approx(greatest, rel=0.03)


def test_the_map_uses_the_camera_where_it_is(cell):
    """A camera 3 cm off makes obstacles of the arm; aligned it does not."""
    robot, depth = cell
    moved = INFO.T_mount_camera @ exp(np.array([0.02, -0.015, 0.015, 0.005, -0.005, 0.0]))
    wrong = scenes.camera_info("cam", T_mount_camera=moved, noise=INFO.noise)
    found = {}
    for align in (False, True):
        config = MappingConfig(lower=CONFIG.lower, upper=CONFIG.upper, align=align)
        world = WorkspaceMap(robot, [wrong], THINGS, config)
        joints = scenes.resting(Q, until=1.0)
        for k in range(3):
            now = 0.1 + 0.03 * k
            snapshot = world.update([scenes.frame(wrong, now, depth, k)], joints, now + 0.001)
        found[align] = int((~snapshot.hazard_unknown).sum())
        world.close()
    assert found[True] < 0.2 * max(found[False], 5)


@pytest.mark.parametrize("run", [11, 19])
def test_a_wrong_start_does_not_win(run):
    """Cameras 5 mm and 0.5 deg (1 sigma) off; in these cells a start 8 cm along the view explains
    more points than the believed pose does, and leads 14 cm along the table. Nor
    does a neighbour's picture, of which another pose explains two thirds."""
    errors = {"calibration_error_mm": 5.0, "calibration_error_deg": 0.5, "stamp_jitter_ms": 20.0}
    workcell = with_simulation(packaged_cell(), person=(), object=(), **errors)
    seed = int(np.random.default_rng((0, run)).integers(2**31))
    with open_cell(workcell, seed=seed) as opened:
        mapping = make_parts(opened, SessionConfig()).workspace
        home, history = np.asarray(opened.robot.home, float), JointHistory()
        newest, told = {}, []
        for now in np.arange(0.004, 0.6, 0.004):
            opened.world.advance(float(now))
            history.add(JointState(float(now), home, np.zeros(6)))
            frames = [f for f in (camera.read() for camera in opened.cameras) if f is not None]
            newest |= {f.camera: f.depth for f in frames}
            if now >= 0.3:
                others = list(newest.values())
                frames = [
                    replace(f, depth=others[list(newest).index(f.camera) - 3]) for f in frames
                ]
            snapshot = mapping.update(frames, history, float(now))
            told.append(snapshot)
        mapping.close()
    before, after = told[73], told[-1]
    assert len(before.cameras) == 4
    assert [c.reason for c in before.cameras if not c.alive] == []
    assert [c.name for c in after.cameras if not c.reason] == []
    for was, is_ in zip(before.corrections, after.corrections):
        moved = inverse(was.T_believed_corrected) @ is_.T_believed_corrected
        assert np.linalg.norm(moved[:3, 3]) < 0.02


def test_a_bumped_camera_is_noticed_whichever_way(cell):
    """By 10 to 30 mm and 1 to 3 deg, in 36 directions; a camera that nobody touched is not blamed.

    One step of Gauss and Newton from the believed pose finds small bumps. Of large ones it missed
    three in four here, for their points are drawn to other surfaces: in ``faults`` one of 49. And
    it is aligned to where it is, or not used: a quarter of bumps was aligned up to 21 cm off.
    """
    robot, depth = cell
    filter_ = SelfFilter(robot)
    body = filter_.pose(Q, np.zeros(2))
    lens = DepthLens(INFO.depth, 1.1 * INFO.range[1])
    known = rasterise(THINGS, fine_grid(CONFIG), 0.1)
    things = [*THINGS, *scenes.arm_solids(robot, Q)]
    rng = np.random.default_rng(7)

    settled = Mounting(INFO, lens, filter_, known, CONFIG)
    settled.look(depth, INFO.T_mount_camera, body, 0.0)
    assert settled.settled

    def told(pictures):
        mounting = copy(settled)
        for k in range(CHECKS):
            picture = scenes.add_noise(pictures, INFO.noise, rng)
            mounting.look(picture, INFO.T_mount_camera, body, 0.1 * (k + 1))
        return mounting, mounting.warning(0.4) or mounting.problem or mounting.lost

    assert not told(scenes.ray_cast(INFO.depth, INFO.T_mount_camera, things))[1]
    missed, astray, found = [], [], 0
    at = np.array([[x, y, 1.5] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    for share in (0.33, 0.66, 1.0):
        for k in range(12):
            shift, turn = rng.normal(size=(2, 3))
            shift *= share * 0.03 / np.linalg.norm(shift)
            turn *= share * np.deg2rad(3.0) / np.linalg.norm(turn)
            T = make_pose(Rotation.from_rotvec(turn).as_matrix(), shift)
            ahead = np.array([[0.0, 0.0, 1.5]])
            if np.linalg.norm(transform(T, ahead) - ahead) < 1.2 * MOVED and share < 1.0:
                continue  # what is ahead stays where it was
            picture = scenes.ray_cast(INFO.depth, INFO.T_mount_camera @ T, things)
            mounting, said = told(picture)
            if not said:
                missed.append((share, k))
            off = np.abs(transform(mounting.T_old_new, at) - transform(T, at)).max()
            found += said and not mounting.lost
            if off > 0.03 and not (mounting.lost or mounting.problem):
                astray.append((share, k, off))
    assert missed == []
    assert astray == []
    assert found >= 30


@pytest.mark.parametrize("align", [False, True])
def test_a_clock_that_is_turned_back_aligns_nobody_who_was_not_aligned(cell, align):
    """Whoever says that cameras are not to be aligned has them where they are declared."""
    robot, depth = cell
    filter_ = SelfFilter(robot)
    body = filter_.pose(Q, np.zeros(2))
    known = rasterise(THINGS, fine_grid(CONFIG), 0.1)
    lens = DepthLens(INFO.depth, 1.1 * INFO.range[1])
    mounting = Mounting(INFO, lens, filter_, known, replace(CONFIG, align=align))
    if align:
        mounting.look(depth, INFO.T_mount_camera, body, 50.0)
        mounting._told, mounting._told_until = "was moved", 53.0
    before = mounting.T_old_new.copy()
    mounting.restart()
    assert mounting.due(0.1) == align
    assert mounting.warning(0.1) == ""
    bumped = INFO.T_mount_camera @ make_pose(translation=[0.03, 0.0, 0.0])
    for k in range(CHECKS + 1):
        if mounting.due(0.1 * k):
            mounting.look(depth, bumped, body, 0.1 * k)
    assert np.array_equal(mounting.T_old_new, before) != align
