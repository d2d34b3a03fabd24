"""Pictures and grids of made-up scenes against the solids themselves; the check finds contacts."""

import numpy as np
import pytest

from armsight.experiments import mbm
from armsight.experiments.depth_scene import depth_image, look_at, snapshot_of, voxels_seen
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import FREE, OCCUPIED, VoxelGrid
from armsight.motion.collision import CollisionModel
from armsight.robots import load_robot

LENS = PinholeCamera.from_fov(200, 160, 1.2, 1.0)
SCENE = (
    Solid("box", "box", (0.3, 0.2, 0.4), from_rpy((0.2, 0.1, 0.5), (0.1, 0.0, 0.2))),
    Solid("can", "cylinder", (0.08, 0.3, 0.0), from_rpy((0.3, 0.0, 0.0), (-0.3, 0.1, 0.15))),
    Solid("table", "box", (1.4, 1.4, 0.04), from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, -0.02))),
)
EYES = [(1.2, 0.3, 0.9), (-0.9, 0.9, 0.8), (0.0, -1.2, 0.6)]
POSES = [look_at(np.array(eye), np.array([0.0, 0.0, 0.1])) for eye in EYES]


@pytest.fixture(scope="module")
def seen():
    grid = VoxelGrid(np.array([-0.7, -0.7, -0.06]), 0.01, (140, 140, 70))
    images = [depth_image(SCENE, LENS, T) for T in POSES]
    return grid, images, voxels_seen(grid, LENS, POSES, images)


def test_pictures_end_on_the_solids_and_nothing_lies_before(seen):
    for T, image in zip(POSES, seen[1]):
        points = LENS.deproject(image)
        hit = np.isfinite(image)
        assert 0.3 < hit.mean() < 1.0
        for share in (1.0, 0.98, 0.7):
            at = share * points[hit].astype(float) @ T[:3, :3].T + T[:3, 3]
            gap = np.min([solid.distance(at) for solid in SCENE], axis=0)
            if share == 1.0:
                assert np.abs(gap).max() < 1e-5
            else:
                assert gap.min() > -1e-5


def test_no_voxel_that_holds_something_is_free_and_much_of_the_rest_is(seen):
    grid, _, state = seen
    index = np.argwhere(state == FREE)
    rng = np.random.default_rng(0)
    inside = grid.origin + (index + rng.random(index.shape)) * grid.voxel
    assert min(solid.distance(inside).min() for solid in SCENE) > 0.0
    far = np.min([solid.distance(grid.center(np.argwhere(state >= 0))) for solid in SCENE], axis=0)
    assert (state.reshape(-1)[far > 0.05] == FREE).mean() > 0.6
    surface = grid.center(np.argwhere(state == OCCUPIED))
    gap = np.min([solid.distance(surface) for solid in SCENE], axis=0)
    assert np.abs(gap).max() < 0.009


@pytest.mark.parametrize("unseen_is_solid", [True, False])
def test_the_field_is_a_bound(seen, unseen_is_solid):
    grid, _, state = seen
    snapshot = snapshot_of(grid, state, unseen_is_solid)
    solid = np.argwhere(state != FREE if unseen_is_solid else state == OCCUPIED)
    rng = np.random.default_rng(1)
    for index in rng.integers(0, grid.shape, (60, 3)):
        point = grid.origin + (index + rng.random(3)) * grid.voxel
        lower = grid.origin + solid * grid.voxel
        gap = np.maximum(np.maximum(lower - point, point - lower - grid.voxel), 0.0)
        true = np.linalg.norm(gap, axis=1).min()
        assert snapshot.distance[tuple(index)] <= true + 1e-6
    assert (snapshot.state == FREE).sum() >= (state == FREE).sum()


def test_a_contact_between_two_places_is_found():
    robot = load_robot("ur5")
    start = np.deg2rad([-40.0, -70.0, 85.0, -105.0, -90.0, 0.0])
    goal = start + np.deg2rad([80.0, 0, 0, 0, 0, 0])
    post = Solid("post", "cylinder", (0.01, 1.2, 0.0), from_rpy((0, 0, 0), (0.55, 0.1, 0.6)))
    problem = mbm.Problem("ur5", "post", 1, (post,), start, goal)
    ends = mbm.clearances(robot, problem, np.stack([start, goal]))
    assert (ends > 0.05).all()
    least = mbm.check(robot, problem, np.stack([start, goal]), CollisionModel(robot))
    assert least < -0.02


def test_rows_count_only_what_can_be_solved():
    policy = next(iter(mbm.POLICIES))

    def found(clearance, failure="", least=0.01):
        answer = {"failure": failure, "least": least, "seconds": 0.01, "first_s": 0.01, "grid_s": 1}
        return {"robot": "ur5", "problem": "x", "clearance": clearance, policy: answer}

    results = [found(0.01), found(0.02, "goal: no"), found(-0.01), found(0.03, least=-0.001)]
    rows = {r.key: r for r in mbm._rows(results, policy, "")}
    assert rows["mbm_solved"].value == pytest.approx(2 / 3)
    assert rows["mbm_solved"].n == 3
    assert rows["mbm_invalid"].value == 1
    assert not rows["mbm_invalid"].met


def test_every_problem_is_read(shared_data):
    problems = mbm.all_problems()
    assert len(problems) == 700
    assert {p.robot for _, p in problems} == {"ur5", "panda"}
    touching = [
        p.name
        for robot, p in problems[:140]
        if mbm.clearances(robot, p, np.stack([p.start, p.goal])).min() <= 0.0
    ]
    assert len(touching) <= 2
