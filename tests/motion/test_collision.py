"""Collision checks and proofs against brute force in plain numpy."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN
from armsight.motion.body import make_body
from armsight.motion.collision import CollisionModel
from armsight.motion.detail import DetailedSnapshot, make_detail
from armsight.motion.kernels import (
    body_centers,
    body_motion,
    config_free,
    make_scratch,
    self_clearance,
    set_bounds,
    sphere_clearances,
)
from armsight.motion.obstacles import CollisionConfig, obstacles_of
from armsight.motion.timing import time_parameterise
from armsight.motion.trajectory import hold
from armsight.robots import ROBOT_NAMES, load_robot
from armsight.robots.kinematics import sphere_centers

from .scenes import (
    CubeOracle,
    arm6,
    ball,
    bounded_field,
    box,
    make_snapshot,
    oracle_centers,
    oracle_clearance,
)

SLOW = settings(
    max_examples=30, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
)
ARM = arm6()
MODEL = CollisionModel(ARM)
WALL = make_snapshot(
    [box((0.5, 0.0, 0.35), (0.03, 0.3, 0.5)), ball((-0.4, 0.4, 0.6), 0.08)],
    was_there=[(ball((0.0, 0.5, 0.5), 0.1), 3.0)],
)
ORACLE = CubeOracle(WALL)


def clearances(snapshot, centers, radius):
    ob = obstacles_of(snapshot, MODEL.body, CollisionConfig())
    out = np.empty(len(radius))
    sphere_clearances(ob, centers, radius, out)
    return out


def random_spheres(rng, count, snapshot):
    grid = snapshot.grid
    top = grid.origin + np.array(grid.shape) * grid.voxel
    return rng.uniform(grid.origin, top, (count, 3)), rng.uniform(0.01, 0.1, count)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_body_centers_match_the_robots_kinematics(name):
    robot = load_robot(name)
    body = make_body(robot)
    rng = np.random.default_rng(0)
    out = np.empty_like(body.center)
    for q in rng.uniform(robot.limits.lower, robot.limits.upper, (20, robot.n)):
        body_centers(body, q, out)
        expected = oracle_centers(robot, q)
        np.testing.assert_allclose(out, expected[body.original], atol=1e-12)
        np.testing.assert_allclose(sphere_centers(robot, q), expected, atol=1e-12)


def test_spheres_that_cannot_move_are_left_out():
    body = make_body(ARM)
    assert len(body.fixed_radius) == 1  # the base
    assert len(body.radius) == len(ARM.spheres.radius) - 1


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_what_turns_a_little_stays_within_what_stands_for_it(name):
    robot = load_robot(name)
    body = make_body(robot)
    fixed = np.setdiff1d(np.arange(len(robot.spheres.radius)), body.original)
    rng = np.random.default_rng(0)
    for q in rng.uniform(robot.limits.lower, robot.limits.upper, (20, robot.n)):
        true = oracle_centers(robot, q)[fixed]
        gap = np.linalg.norm(true[:, None] - body.fixed_center, axis=2) - body.fixed_radius
        gap += robot.spheres.radius[fixed][:, None]
        assert gap.min(axis=1).max() < 1e-9


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_levers_velocities_and_bends_bound_the_motion(name):
    robot = load_robot(name)
    body = make_body(robot)
    scratch = make_scratch(body)
    rng = np.random.default_rng(1)
    out = np.empty_like(body.center)
    h = 1e-4
    for _ in range(200):
        q = rng.uniform(robot.limits.lower, robot.limits.upper)
        qd, qdd = rng.normal(0, 1, (2, robot.n))
        set_bounds(body, np.abs(qd), np.abs(qdd), scratch)
        body_motion(body, q, qd, scratch)
        c = []
        for t in (-h, 0.0, h):
            body_centers(body, q + t * qd + 0.5 * t * t * qdd, out)
            c.append(out.copy())
        velocity = (c[2] - c[0]) / (2 * h)
        second = (c[2] - 2 * c[1] + c[0]) / h**2
        m = len(body.radius)
        np.testing.assert_allclose(scratch.centers[:m], c[1], atol=1e-12)
        np.testing.assert_allclose(scratch.velocity, velocity, atol=1e-6)
        assert (np.linalg.norm(velocity, axis=1) <= scratch.travel[:, 0] + 1e-6).all()
        assert (np.linalg.norm(second, axis=1) <= scratch.bend[:, 0] + 1e-5).all()


def test_exact_near_and_bounded_far_on_1e5_spheres():
    rng = np.random.default_rng(2)
    centers, radius = random_spheres(rng, 100_000, WALL)
    found = clearances(WALL, centers, radius)
    truth = ORACLE.distance(centers) - radius
    truth = np.minimum(truth, ORACLE.walls(centers) - radius)
    near = truth < 0.02 - 1e-9
    positive = truth > 0
    assert near.sum() > 1000
    np.testing.assert_allclose(found[near & positive], truth[near & positive], atol=1e-9)
    assert (found[~near] <= truth[~near] + 1e-6).all()  # never more than there is
    assert (found[~near] >= 0.02 - 1e-9).all()  # and never less than a voxel
    assert ((found < 0) == (truth < 0)).all()  # nothing missed, nothing refused too many


def test_whatever_is_a_millimetre_away_is_free_whatever_the_radii():
    """Each sphere as large as its place allows less 1 to 5 mm, where the field alone says less.

    For some radii the floor was lost to rounding, and an arm in free space stood still.
    """
    rng = np.random.default_rng(4)
    ob = obstacles_of(WALL, MODEL.body, CollisionConfig())
    alone = MODEL.body._replace(groups=MODEL.body.groups[:0])  # its own links do not count here
    scratch = make_scratch(alone)
    centers = np.empty_like(alone.center)
    looked = 0
    for q in rng.uniform(ARM.limits.lower, ARM.limits.upper, (400, ARM.n)):
        body_centers(alone, q, centers)
        room = np.minimum(ORACLE.distance(centers), ORACLE.walls(centers))
        if room.min() < 0.01:
            continue
        body = alone._replace(radius=room - rng.uniform(0.001, 0.005, len(room)))
        assert config_free(body, ob, q, scratch)
        assert not config_free(body._replace(radius=room + 1e-6), ob, q, scratch)
        looked += len(room)
    assert looked > 1000


def test_the_oracle_notices_a_map_that_lost_one_percent():
    rng = np.random.default_rng(3)
    state = WALL.state.copy()
    solid = np.argwhere(state == OCCUPIED)
    lost = solid[rng.random(len(solid)) < 0.01]
    state[tuple(lost.T)] = FREE
    mutant = replace(WALL, state=state, distance=np.full_like(WALL.distance, 0.0))
    low, high = solid.min(axis=0), solid.max(axis=0) + 1
    centers = WALL.grid.origin + WALL.grid.voxel * rng.uniform(low, high, (20_000, 3))
    radius = np.full(len(centers), 0.001)
    found = clearances(mutant, centers, radius)
    truth = ORACLE.distance(centers) - radius
    assert ((truth < 0) & (found > 0)).any()


def detailed(seed):
    """The wall's cubes, and points beside them; the field counts the points' voxels as solid."""
    rng = np.random.default_rng(seed)
    center = rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.8), (12, 1, 3))
    points = (center + rng.normal(0.0, 0.03, (12, 200, 3))).reshape(-1, 3)
    detail = make_detail(WALL.grid, points)
    solid = WALL.state != FREE
    solid[tuple(WALL.grid.index(detail.points).T)] = True
    known = {f.name: getattr(WALL, f.name) for f in fields(WALL)}
    known["distance"] = bounded_field(solid, WALL.grid.voxel, WALL.distance_cap)
    return DetailedSnapshot(**known, detail=detail)


@pytest.mark.parametrize("seed", range(3))
def test_points_beside_cubes_against_brute_force(seed):
    snapshot = detailed(seed)
    rng = np.random.default_rng(seed + 10)
    center, radius = random_spheres(rng, 4_000, snapshot)
    found = clearances(snapshot, center, radius)
    points = snapshot.detail.points.astype(float)
    to_points = np.concatenate(
        [
            np.linalg.norm(part[:, None] - points[None], axis=2).min(axis=1)
            for part in np.array_split(center, 40)
        ]
    )
    true = np.minimum(np.minimum(ORACLE.distance(center), to_points), ORACLE.walls(center)) - radius
    assert ((true < 0.0) & (found >= 0.0)).sum() == 0
    assert ((true >= 0.0) & (found < 0.0)).sum() == 0
    near = (true > 0.0) & (true < 0.9 * snapshot.grid.voxel)
    assert near.sum() > 50
    np.testing.assert_allclose(found[near], true[near], atol=1e-6)
    # With the points left out, some that touch would be called free: the test can fail.
    bare = clearances(WALL, center, radius)
    assert ((true < 0.0) & (bare >= 0.0)).sum() > 20


def test_points_count_where_unseen_space_is_made_solid_afterwards():
    """The field that is then worked out anew knew the voxels alone."""
    snapshot = replace(detailed(0), distance_counts_unknown=False)
    ob = CollisionModel(ARM).obstacles(snapshot)
    assert (ob.distance <= snapshot.distance).all()


def test_points_outside_the_grid_are_left_out():
    detail = make_detail(WALL.grid, np.array([[0.0, 0.0, 0.5], [9.0, 0.0, 0.5], [0.0, 0.0, -9.0]]))
    np.testing.assert_allclose(detail.points, [[0.0, 0.0, 0.5]])
    assert detail.rows[-1] == 1


def test_a_field_that_promises_too_much_is_noticed():
    boasting = replace(WALL, distance=WALL.distance + np.float32(0.03))
    rng = np.random.default_rng(4)
    centers, radius = random_spheres(rng, 20_000, WALL)
    found = clearances(boasting, centers, radius)
    truth = ORACLE.distance(centers) - radius
    assert ((truth < 0) & (found > 0)).any()


def test_poses_against_brute_force():
    rng = np.random.default_rng(5)
    wrong = refused = free = 0
    for q in rng.uniform(-np.pi, np.pi, (1500, 6)):
        truth = oracle_clearance(ARM, q, ORACLE)
        said = MODEL.valid(q, WALL)
        wrong += said and truth < 0
        free += truth >= 0
        refused += truth >= 0 and not said
    assert wrong == 0
    assert free > 200
    assert refused <= 0.02 * free


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.5))
@SLOW
def test_no_proven_edge_touches_anything(seed, length):
    rng = np.random.default_rng(seed)
    q0 = rng.uniform(-np.pi, np.pi, 6)
    way = rng.normal(0, 1, 6)
    q1 = np.clip(q0 + length * way / np.linalg.norm(way), -np.pi, np.pi)
    if not MODEL.edge_valid(q0, q1, WALL, at=ARM.home):
        return
    # 1 mm steps of the fastest sphere: it moves at most 1.3 m a radian.
    steps = int(np.ceil(1.3 * np.abs(q1 - q0).sum() / 0.001)) + 1
    for s in np.linspace(0, 1, min(steps, 400)):
        assert oracle_clearance(ARM, q0 + s * (q1 - q0), ORACLE) > 0


def test_free_edges_are_mostly_proven():
    rng = np.random.default_rng(6)
    proven = free = 0
    for _ in range(120):
        q0 = rng.uniform(-np.pi, np.pi, 6)
        q1 = q0 + rng.normal(0, 0.15, 6)
        if np.abs(q1).max() > np.pi:
            continue
        dense = [oracle_clearance(ARM, q0 + s * (q1 - q0), ORACLE) for s in np.linspace(0, 1, 40)]
        if min(dense) > 0.001:
            free += 1
            proven += MODEL.edge_valid(q0, q1, WALL, at=ARM.home)
    assert free > 20
    assert proven == free


@given(st.integers(0, 2**32 - 1))
@SLOW
def test_no_proven_trajectory_touches_anything(seed):
    rng = np.random.default_rng(seed)
    path = ARM.home + np.cumsum(rng.normal(0, 0.4, (4, 6)), axis=0)
    path = np.clip(path, -np.pi, np.pi)
    motion = time_parameterise(path, ARM.limits)
    when = MODEL.first_blocked_time(motion, WALL, at=ARM.home)
    truth = [
        oracle_clearance(ARM, q, ORACLE)
        for q in motion.sample(np.linspace(0, motion.duration, 150))
    ]
    if when is None:
        assert min(truth) > 0
    else:
        # Refused only where something is within the floor.
        assert oracle_clearance(ARM, motion.position(when), ORACLE) < 0.002


def test_part_of_a_trajectory_can_be_proven():
    a = np.array([1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    b = np.array([-1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    motion = time_parameterise(np.stack([a, b]), ARM.limits)
    when = MODEL.first_blocked_time(motion, WALL)
    assert when is not None
    assert MODEL.trajectory_valid(motion, WALL, until=0.1 * motion.duration)
    assert MODEL.trajectory_valid(motion, WALL, begin=0.9 * motion.duration)
    assert MODEL.trajectory_valid(motion, WALL, begin=motion.duration)
    assert not MODEL.trajectory_valid(motion, WALL, begin=when - 0.05, until=when + 0.05)


def test_edge_through_a_wall_is_refused():
    snapshot = make_snapshot([box((0.5, 0.0, 0.5), (0.5, 0.04, 1.0))])
    a = np.array([1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    b = np.array([-1.2, 1.0, 0.6, 0.0, 0.0, 0.0])
    assert MODEL.valid(a, snapshot)
    assert MODEL.valid(b, snapshot)
    assert not MODEL.edge_valid(a, b, snapshot)
    assert MODEL.edge_valid(a, a + 0.05, snapshot)
    path = np.stack([a + 0.05, a, b])
    assert MODEL.first_blocked(path, snapshot) == 1
    assert not MODEL.path_valid(path, snapshot)


def test_unknown_space_is_solid_but_not_the_arms_own_shadow():
    tip = oracle_centers(ARM, ARM.home)[-1]
    shadow = ball(tip, 0.09)
    for counts in (True, False):
        snapshot = make_snapshot(unknown=[shadow], counts_unknown=counts)
        assert (snapshot.state == UNKNOWN).any()
        assert not MODEL.valid(ARM.home, snapshot)
        assert MODEL.valid(ARM.home, snapshot, at=ARM.home)
        assert MODEL.edge_valid(ARM.home, ARM.home + 0.1, snapshot)
        far = ARM.home + np.array([1.0, 0, 0, 0, 0, 0])
        assert not MODEL.edge_valid(far, ARM.home, snapshot)  # into unseen space: no
        assert MODEL.edge_valid(far, ARM.home, snapshot, at=ARM.home)
        assert CollisionModel(ARM, CollisionConfig(avoid_unknown=False)).valid(ARM.home, snapshot)


def test_occupied_space_is_never_excused():
    tip = oracle_centers(ARM, ARM.home)[-1]
    snapshot = make_snapshot([ball(tip, 0.03)], unknown=[ball(tip, 0.12)])
    assert not MODEL.valid(ARM.home, snapshot, at=ARM.home)
    assert "link_6 touches" in MODEL.contact(ARM.home, snapshot, at=ARM.home)


def test_outside_the_mapped_box_is_forbidden_unless_the_arm_is_there_already():
    small = make_snapshot(upper=(0.3, 1.2, 1.3))
    reach_out = np.array([0.0, 1.2, 0.3, 0.0, 0.0, 0.0])
    assert oracle_centers(ARM, reach_out)[:, 0].max() > 0.5
    assert not MODEL.valid(reach_out, small)
    assert MODEL.valid(reach_out, small, at=reach_out)
    inside = np.array([np.pi / 2, 0.3, 0.5, 0.0, 0.0, 0.0])
    assert MODEL.valid(inside, small)
    assert not MODEL.edge_valid(inside, reach_out, small)
    assert MODEL.edge_valid(reach_out, inside, small)  # coming back is allowed


def test_a_declared_table_under_the_base_is_no_collision_an_unknown_thing_is():
    robot = arm6(0.07)
    model = CollisionModel(robot)
    table = box((0.0, 0.0, 0.0), (0.5, 0.5, 0.09))
    declared = make_snapshot([table])
    assert model.valid(robot.home, declared)
    seen = replace(
        declared,
        last_occupied=np.where(declared.state == OCCUPIED, 99.0, -np.inf).astype(np.float32),
    )
    assert not model.valid(robot.home, seen)


def test_self_collision_and_limits():
    empty = make_snapshot()
    folded = np.array([0.0, 0.0, 3.1, 0.0, 0.0, 0.0])
    assert not MODEL.valid(folded, empty)
    assert MODEL.contact(folded, empty).startswith("the arm touches itself: ")
    assert not MODEL.valid(np.full(6, 3.5), empty)
    assert "outside its limits" in MODEL.contact(np.full(6, 3.5), empty)
    assert "not numbers" in MODEL.contact(np.full(6, np.nan), empty)
    assert not MODEL.edge_valid(ARM.home, np.full(6, 3.5), empty)
    assert MODEL.first_blocked(np.stack([ARM.home, np.full(6, 3.5)]), empty) == 0


@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_the_parts_of_the_arm_that_are_nearest_each_other_are_named(name):
    """Against brute force; the base, whose spheres cannot move, is among them."""
    robot, rng, named = load_robot(name), np.random.default_rng(5), set()
    model, spheres = CollisionModel(robot), robot.spheres
    for _ in range(200):
        q = rng.uniform(robot.limits.lower, robot.limits.upper)
        at, gaps = sphere_centers(robot, q), {}
        for a, b in np.sort(np.asarray(robot.self_pairs), axis=1):
            of_a, of_b = np.flatnonzero(spheres.link == a), np.flatnonzero(spheres.link == b)
            apart = np.linalg.norm(at[of_a, None] - at[None, of_b], axis=2)
            gap = (apart - spheres.radius[of_a, None] - spheres.radius[None, of_b]).min()
            gaps[f"{robot.link_names[a]} its {robot.link_names[b]}"] = gap
        gap, parts = model.own_gap(q)
        assert gap == pytest.approx(min(gaps.values()), abs=0.005)  # what turns a little is larger
        assert gaps[parts] < min(gaps.values()) + 0.005
        named.add(parts)
    assert any(parts.startswith(robot.link_names[0]) for parts in named)


def test_a_robot_without_link_shapes_is_refused():
    none = replace(
        ARM,
        spheres=replace(
            ARM.spheres, link=np.zeros(0, int), center=np.zeros((0, 3)), radius=np.zeros(0)
        ),
    )
    with pytest.raises(ValueError, match="no link spheres"):
        CollisionModel(none)


def test_a_margin_keeps_farther_away():
    x, y, z = oracle_centers(ARM, ARM.home)[-1]
    snapshot = make_snapshot([box((x, y + 0.12, z), (0.04, 0.02, 0.04))])
    assert MODEL.valid(ARM.home, snapshot)
    assert not CollisionModel(ARM, CollisionConfig(margin=0.05)).valid(ARM.home, snapshot)


def test_a_path_proven_not_to_touch_itself_is_only_asked_about_the_rest():
    """Left out is exactly the body against itself: what lies around is found all the same."""
    rng = np.random.default_rng(8)
    model = CollisionModel(load_robot("ur5"))
    low, high = np.maximum(model.body.lower, -np.pi), np.minimum(model.body.upper, np.pi)
    touching_itself = touching_wall = 0
    for _ in range(200):
        path = rng.uniform(low, high, (2, 6))
        path[1] = path[0] + 0.1 * (path[1] - path[0])
        whole = model.first_blocked(path, WALL)
        rest = model.first_blocked(path, WALL, own=False)
        assert rest is None or whole is not None
        touching_wall += rest is not None
        if rest is None and whole is not None:
            touching_itself += 1
            gaps = []
            for q in np.linspace(*path, 30):
                centers = np.empty_like(model.body.center)
                body_centers(model.body, q, centers)
                gaps.append(self_clearance(model.body, centers))
            assert min(gaps) < 0.01  # the body is as close to itself as the whole check says
    assert touching_itself > 5
    assert touching_wall > 5


@pytest.mark.parametrize("q", [np.zeros(1), np.zeros(5), np.zeros(7), np.full(6, np.nan)])
def test_what_is_no_position_of_the_arm_is_never_free(q):
    """One number was taken for all joints, and what its kernels read behind it for the rest."""
    model, nothing = CollisionModel(arm6()), make_snapshot()
    assert not model.within_limits(q)
    assert not model.valid(q, nothing)
    assert not model.edge_valid(q, q, nothing)
    assert model.contact(q, nothing) == "joint positions that are not numbers"
    with pytest.raises(ValueError, match="expected 6 numbers"):
        model.clearance(q, nothing)
    if len(q) != 6:
        with pytest.raises(ValueError, match=r"expected \(k, 6\)"):
            model.path_valid(np.stack([q] * 6), nothing)
        with pytest.raises(ValueError, match="joints"):
            model.trajectory_valid(hold(q), nothing)
