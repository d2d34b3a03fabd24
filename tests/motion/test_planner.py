"""Planned paths against an oracle of their own, at 1 mm; failures in words; determinism; cost."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import exp1

from armsight.mapping.danger import danger_table
from armsight.motion.collision import CollisionModel
from armsight.motion.cost import path_cost
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner, joined_to
from armsight.robots import ROBOT_NAMES, load_robot
from baselines.ompl_planner import OmplPlanner

from .scenes import CubeOracle, arm6, ball, box, make_snapshot, oracle_centers, oracle_clearance

ARM = arm6()
A = np.array([1.0, 0.9, 0.8, 0.0, 0.0, 0.0])
B = np.array([-1.0, 0.9, 0.8, 0.0, 0.0, 0.0])
WALL = make_snapshot([box((0.5, 0.0, 0.2), (0.5, 0.06, 0.7))])
EMPTY = make_snapshot()


def ask(start=A, goal=B, warm=None, number=7):
    return PlanRequest(number, start, JointIntent("B", goal), warm)


def plan(snapshot, request=None, seed=0, planner=None, limit=1.0):
    planner = planner or RrtConnectPlanner(ARM)
    return planner.plan(request or ask(), snapshot, limit, np.random.default_rng(seed))


def dense(robot, plan_, step=0.001):
    """Configurations along path and motion, the fastest sphere at most about ``step`` apart."""
    out = [plan_.path[:1]]
    for a, b in pairwise(plan_.path):
        count = int(np.ceil(1.3 * np.abs(b - a).sum() / step))
        out.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
    return np.concatenate(out)


@pytest.mark.parametrize("seed", range(3))
def test_paths_around_a_wall_are_free_at_a_millimetre(seed):
    answer = plan(WALL, seed=seed)
    assert answer.good
    assert answer.request == 7
    assert answer.snapshot_sequence == WALL.sequence
    np.testing.assert_array_equal(answer.path[0], A)
    np.testing.assert_array_equal(answer.path[-1], B)
    oracle = CubeOracle(WALL)
    for q in dense(ARM, answer)[::15]:
        assert oracle_clearance(ARM, q, oracle) > 0
    motion = answer.trajectory
    np.testing.assert_allclose(motion.start, A, atol=1e-9)
    np.testing.assert_allclose(motion.end, B, atol=1e-9)
    for q in motion.sample(np.linspace(0, motion.duration, 200)):
        assert oracle_clearance(ARM, q, oracle) > 0
    speed, acceleration, jerk = motion.peak()
    limits = ARM.limits.scaled(0.5, 0.6)
    assert (speed <= limits.velocity * 1.000001).all()
    assert (acceleration <= limits.acceleration * 1.000001).all()
    assert (jerk <= limits.jerk * 1.000001).all()


@pytest.mark.parametrize("at", [(-0.05, 0.0, -0.02), (0.0, 0.0, 0.0)])
def test_a_speck_under_the_arm_keeps_it_from_no_plan(at):
    """Seen once, where two surfaces mix, and hidden from then on: no plan could ever leave it.

    The spheres of a shoulder that lie on its axis reach under the base, and cannot move.
    """
    robot = load_robot("ur10")
    speck = ball(at, 0.002)
    snapshot = make_snapshot(
        [speck], was_there=[(speck, 60.0)], lower=(-1.5, -1.5, -0.41), upper=(1.5, 1.5, 1.7)
    )
    planner, goal = RrtConnectPlanner(robot), robot.home + 0.2
    answer = planner.plan(ask(robot.home, goal), snapshot, 1.0, np.random.default_rng(0))
    assert answer.good, answer.failure
    np.testing.assert_array_equal(answer.path[-1], goal)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_every_arm_plans_around_a_pillar(name):
    robot = load_robot(name)
    x, y, z = oracle_centers(robot, robot.home)[-1]
    snapshot = make_snapshot(
        [box((x, y, z), (0.03, 0.03, 0.2))],
        lower=(-1.5, -1.5, -0.4),
        upper=(1.5, 1.5, 1.7),
    )
    model = CollisionModel(robot)
    for swing in (1.2, 1.6, 2.0, 2.4):
        turn = swing * np.eye(robot.n)[0]
        start, goal = robot.home - turn, robot.home + turn
        if model.valid(start, snapshot) and model.valid(goal, snapshot):
            break
    answer = plan(snapshot, ask(start, goal), planner=RrtConnectPlanner(robot))
    assert answer.failure == ""
    assert answer.escape_s == 0.0
    assert model.path_valid(answer.path, snapshot)
    assert model.trajectory_valid(answer.trajectory, snapshot)
    oracle = CubeOracle(snapshot)
    for q in answer.trajectory.sample(np.linspace(0, answer.trajectory.duration, 150)):
        assert oracle_clearance(robot, q, oracle) > 0


def test_the_same_seed_gives_the_same_plan_bit_for_bit():
    first, second = plan(WALL, seed=5), plan(WALL, seed=5)
    np.testing.assert_array_equal(first.path, second.path)
    np.testing.assert_array_equal(first.trajectory.q, second.trajectory.q)
    assert first.cost == second.cost
    assert not np.array_equal(first.path, plan(WALL, seed=6).path)


def test_a_free_way_is_a_straight_one_or_a_cheaper_one():
    answer = plan(EMPTY)
    straight = path_cost(CollisionModel(ARM).body, np.stack([A, B]), EMPTY)
    assert answer.cost <= straight + 1e-9


def test_danger_is_avoided_where_there_is_another_way():
    tips = [oracle_centers(ARM, A + s * (B - A))[-1] for s in np.linspace(0.3, 0.7, 5)]
    risky = make_snapshot(was_there=[(ball(p, 0.15), 2.0) for p in tips])
    body = CollisionModel(ARM).body
    answer = plan(risky)
    assert answer.good
    assert answer.cost < 0.95 * path_cost(body, np.stack([A, B]), risky)
    assert answer.cost == pytest.approx(path_cost(body, answer.path, risky), rel=1e-9)


def test_cost_against_plain_integration():
    rng = np.random.default_rng(0)
    scene = make_snapshot(
        was_there=[(ball((0.4, 0.1, 0.5), 0.2), 5.0), (ball((0, 0.4, 0.4), 0.2), 22)]
    )
    body = CollisionModel(ARM).body
    table, step = danger_table()
    path = ARM.home + np.cumsum(rng.normal(0, 0.5, (4, 6)), axis=0)
    total = 0.0
    for a, b in pairwise(path):
        q = a + np.linspace(0, 1, 1500)[:, None] * (b - a)
        c = np.array([oracle_centers(ARM, x)[body.original] for x in q])
        length = np.linalg.norm(np.diff(c, axis=0), axis=2)
        middle = (0.5 * (c[1:] + c[:-1])).reshape(-1, 3)
        index = scene.grid.index(middle)
        inside = ((index >= 0) & (index < scene.grid.shape)).all(axis=1)
        age = np.full(len(middle), np.inf)
        age[inside] = scene.stamp - scene.last_occupied[tuple(index[inside].T)]
        danger = np.interp(age, np.arange(len(table)) * step, table, right=0.0)
        total += (length.ravel() * (1 + danger)).sum()
    assert path_cost(body, path, scene) == pytest.approx(total / len(body.radius), rel=0.01)
    calm = path_cost(body, path, EMPTY)
    assert calm < path_cost(body, path, scene)
    split = np.stack([path[0], 0.5 * (path[0] + path[1]), *path[1:]])
    assert path_cost(body, split, EMPTY) == pytest.approx(calm, rel=1e-3)


def test_danger_follows_the_closed_form():
    table, step = danger_table(0.2586)
    assert step * (len(table) - 1) == pytest.approx(24.48, abs=0.01)
    assert table[0] == pytest.approx(0.999, abs=1e-6)
    assert table[-1] == 0.0
    assert (np.diff(table) <= 0).all()
    age = 20.0
    c = np.interp(age, np.arange(len(table)) * step, table)
    u0 = -np.log(0.999)
    assert exp1(-np.log(c)) == pytest.approx(exp1(u0) - 0.2586 * age, rel=1e-3)


def test_goal_in_collision_says_which_link():
    tip = oracle_centers(ARM, B)[-1]
    answer = plan(make_snapshot([ball(tip, 0.03)]))
    assert not answer.good
    assert answer.failure.startswith("goal: link_")
    assert answer.path.shape == (0, 6)
    assert answer.trajectory is None
    assert answer.cost == np.inf


@pytest.mark.parametrize(
    ("start", "goal", "words"),
    [
        (A, np.full(6, 4.0), "goal: joint_0 at 4.000 rad is outside its limits"),
        (np.full(6, -4.0), B, "start: joint_0 at -4.000 rad is outside its limits"),
        (np.full(6, np.nan), B, "start: joint positions that are not numbers"),
        (A, np.full(6, np.inf), "goal: joint positions that are not numbers"),
        (A, np.zeros(7), "goal: has 7 joint positions"),
        (np.zeros(3), B, "start: has 3 joint positions"),
    ],
)
def test_impossible_questions_are_answered_in_words(start, goal, words):
    answer = plan(EMPTY, ask(start, goal))
    assert words in answer.failure


@pytest.mark.parametrize("seed", range(6))
def test_a_goal_in_a_tight_place_is_reached(seed):
    """Long edges alone do not get out of there: the trees must take short ones as well."""
    tip = oracle_centers(ARM, B)[-1]
    walls = [box((tip[0], tip[1], tip[2] + side * 0.13), (0.4, 0.4, 0.04)) for side in (-1.0, 1.0)]
    answer = plan(make_snapshot(walls), seed=seed, limit=0.5)
    assert answer.good, answer.failure


def test_no_way_is_said_after_the_time_limit():
    answer = plan(WALL, limit=1e-5)
    assert "no path found within 1e-05 s" in answer.failure


@pytest.mark.parametrize(("below", "deepest"), [(0.08, -0.02), (0.055, -0.05)])
def test_a_slight_contact_at_the_start_is_left(below, deepest):
    tip = oracle_centers(ARM, A)[-1]
    touching = make_snapshot([box((tip[0] + 0.02, tip[1], tip[2] - below), (0.3, 0.3, 0.02))])
    model = CollisionModel(ARM)
    depth = model.clearance(A, touching)
    assert deepest < depth < min(0.0, deepest + 0.03)
    answer = plan(touching)
    assert answer.good
    assert answer.escape_s > 0
    np.testing.assert_array_equal(answer.path[0], A)
    assert model.trajectory_valid(answer.trajectory, touching, begin=answer.escape_s, at=A)
    oracle = CubeOracle(touching)
    for t in np.linspace(0, answer.escape_s, 50):
        assert oracle_clearance(ARM, answer.trajectory.position(t), oracle) > depth - 0.002


def test_a_deep_contact_at_the_start_is_refused():
    tip = oracle_centers(ARM, A)[-1]
    answer = plan(make_snapshot([ball(tip, 0.05)]))
    assert answer.failure.startswith("start: link_")


def test_a_start_just_beyond_a_limit_is_put_on_it():
    start = A.copy()
    start[5] = ARM.limits.upper[5] + 0.005
    answer = plan(EMPTY, ask(start))
    assert answer.good
    assert answer.path[0, 5] == ARM.limits.upper[5]


def test_a_warm_path_is_used_from_where_the_arm_is():
    cold = plan(WALL)
    here = cold.trajectory.position(0.4 * cold.trajectory.duration)
    answer = plan(
        WALL,
        ask(start=here, warm=cold.path),
        planner=RrtConnectPlanner(ARM, config=PlannerConfig(solutions=1, improvement=0.001)),
    )
    assert answer.good
    assert answer.cost < cold.cost
    joined = joined_to(cold.path, A, B)
    np.testing.assert_array_equal(joined, cold.path)


def test_a_warm_path_that_is_blocked_now_does_no_harm():
    blocked = np.stack([A, 0.5 * (A + B), B])
    assert not CollisionModel(ARM).path_valid(blocked, WALL)
    answer = plan(WALL, ask(warm=blocked))
    assert answer.good
    assert CollisionModel(ARM).path_valid(answer.path, WALL)


def test_the_wall_clock_can_end_a_search():
    planner = RrtConnectPlanner(ARM, config=PlannerConfig(wall_limit=0.0))
    assert "no path found" in plan(WALL, planner=planner, limit=1000.0).failure


def test_more_time_never_makes_it_dearer():
    costs = [
        plan(WALL, planner=RrtConnectPlanner(ARM, config=PlannerConfig(improvement=s))).cost
        for s in (0.002, 0.02, 0.2)
    ]
    assert costs[1] < costs[0] * 1.05
    assert costs[2] < costs[1] * 1.02


@pytest.mark.parametrize("algorithm", ["RRTConnect", "BITstar"])
def test_ompl_answers_the_same_question(algorithm):
    answer = plan(WALL, planner=OmplPlanner(ARM, algorithm), limit=1.0)
    assert answer.good, answer.failure
    oracle = CubeOracle(WALL)
    for q in answer.trajectory.sample(np.linspace(0, answer.trajectory.duration, 200)):
        assert oracle_clearance(ARM, q, oracle) > 0
    assert answer.cost == pytest.approx(path_cost(CollisionModel(ARM).body, answer.path, WALL))
    assert plan(WALL).cost < 1.15 * answer.cost


def test_ompl_refuses_in_the_same_words():
    request = ask(goal=np.full(6, 4.0))
    ours, theirs = plan(EMPTY, request), plan(EMPTY, request, planner=OmplPlanner(ARM))
    assert ours.failure == theirs.failure


def test_a_stale_snapshot_of_nothing_known_forbids_everything_but_the_start():
    unseen = replace(
        EMPTY, state=np.zeros_like(EMPTY.state), distance=np.zeros_like(EMPTY.distance)
    )
    assert plan(unseen).failure.startswith("goal: link_")


@pytest.mark.parametrize("odd", [9.0, np.nan])
def test_a_known_path_beyond_the_limits_is_not_followed(odd):
    """It may be an older arm's, or somebody's own: nothing else looks at its middle."""
    middle = 0.5 * (A + B)
    middle[4] = odd
    planner = RrtConnectPlanner(ARM, config=PlannerConfig(improvement=0.0))
    answer = plan(EMPTY, ask(warm=np.stack([A, middle, B])), planner=planner)
    assert answer.good
    np.testing.assert_array_equal(answer.path, [A, B])
    assert plan(EMPTY, ask(warm=np.zeros((2, 5))), planner=planner).good
