"""Pictures and grids of made-up scenes against the solids themselves; the check finds contacts."""

import numpy as np
import pytest

from armsight.experiments import mbm
from armsight.experiments.depth_scene import depth_image, look_at
from armsight.experiments.seen_space import snapshot_of, space_seen
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import FREE, OCCUPIED, VoxelGrid
from armsight.motion.collision import CollisionModel
from armsight.motion.kernels import sphere_clearances
from armsight.motion.obstacles import CollisionConfig, obstacles_of
from armsight.robots import load_robot

LENS = PinholeCamera.from_fov(200, 160, 1.2, 1.0)
SCENE = (
    Solid("box", "box", (0.3, 0.2, 0.4), from_rpy((0.2, 0.1, 0.5), (0.1, 0.0, 0.2))),
    Solid("can", "cylinder", (0.08, 0.3, 0.0), from_rpy((0.3, 0.0, 0.0), (-0.3, 0.1, 0.15))),
    Solid("table", "box", (1.4, 1.4, 0.04), from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, -0.02))),
)
EYES = [(1.2, 0.3, 0.9), (-0.9, 0.9, 0.8), (0.0, -1.2, 0.6)]
POSES = [look_at(np.array(eye), np.array([0.0, 0.0, 0.1])) for eye in EYES]


def looked_at(divided, lens=LENS):
    grid = VoxelGrid(np.array([-0.7, -0.7, -0.06]), 0.01, (140, 140, 70))
    images = [depth_image(SCENE, lens, T) for T in POSES]
    return images, space_seen(grid, lens, POSES, images, np.full(grid.shape, divided))


@pytest.fixture(scope="module")
def seen():
    return looked_at(False)


@pytest.fixture(scope="module")
def closely():
    # Pixels as close together as those of the experiment: corners between them are within the
    # margin.
    return looked_at(True, PinholeCamera.from_fov(750, 600, 1.2, 1.0))


def to_scene(points):
    return np.min([solid.distance(np.asarray(points, float)) for solid in SCENE], axis=0)


def test_pictures_end_on_the_solids_and_nothing_lies_before(seen):
    for T, image in zip(POSES, seen[0]):
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
    grid, state = seen[1].grid, seen[1].state
    index = np.argwhere(state == FREE)
    rng = np.random.default_rng(0)
    inside = grid.origin + (index + rng.random(index.shape)) * grid.voxel
    assert to_scene(inside).min() > 0.0
    far = to_scene(grid.center(np.argwhere(state >= 0)))
    assert (state.reshape(-1)[far > 0.05] == FREE).mean() > 0.6
    surface = grid.center(np.argwhere(state == OCCUPIED))
    assert np.abs(to_scene(surface)).max() < 0.009


def test_looked_at_closely_surfaces_are_points_and_hidden_places_too(closely):
    found = closely[1]
    assert not (found.state == OCCUPIED).any()
    assert np.abs(to_scene(found.surface)).max() < 1e-5
    # A hidden place lies behind something, or beside the shadow of something.
    assert (to_scene(found.hidden) > 0.003).mean() < 0.9


def random_balls(rng, grid, count):
    top = grid.origin + np.array(grid.shape) * grid.voxel
    radius = rng.uniform(0.012, 0.08, count)
    return rng.uniform(grid.origin + 0.08, top - 0.08, (count, 3)), radius


@pytest.mark.parametrize("detail", [False, True])
def test_no_ball_that_touches_the_scene_is_free(seen, closely, detail):
    """The whole chain against exact geometry: pictures, grid, points, field, kernels."""
    model = CollisionModel(load_robot("ur5"))
    snapshot = snapshot_of((closely if detail else seen)[1], True)
    ob = obstacles_of(snapshot, model.body, CollisionConfig())
    rng = np.random.default_rng(3)
    centers, radius = random_balls(rng, snapshot.grid, 20_000)
    out = np.empty(len(radius))
    sphere_clearances(ob, centers, radius + mbm.MARGIN, out)
    true = to_scene(centers) - radius
    assert ((true < 0.0) & (out >= 0.0)).sum() == 0
    assert (out >= 0.0).sum() > 500
    if detail:
        # What is seen from the front can be approached to a few millimetres.
        near = (true > 0.005) & (true < 0.01)
        assert (out[near] >= 0.0).mean() > 0.15


@pytest.mark.parametrize("unseen_is_solid", [True, False])
def test_the_field_is_a_bound(closely, unseen_is_solid):
    snapshot = snapshot_of(closely[1], unseen_is_solid)
    grid = snapshot.grid
    solid = np.argwhere(snapshot.state != FREE)
    rng = np.random.default_rng(1)
    lower = grid.origin + solid * grid.voxel
    for index in rng.integers(0, grid.shape, (60, 3)):
        point = grid.origin + (index + rng.random(3)) * grid.voxel
        gap = np.maximum(np.maximum(lower - point, point - lower - grid.voxel), 0.0)
        true = np.linalg.norm(gap, axis=1).min(initial=np.inf)
        true = min(true, np.linalg.norm(snapshot.detail.points - point, axis=1).min())
        assert snapshot.distance[tuple(index)] <= true + 1e-6


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
        answer = {"failure": failure, "least": least, "first_s": 0.01, "grid_s": 1}
        answer |= {"motion_s": 0.01, "improved_s": 0.03}
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
