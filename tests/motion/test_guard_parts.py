"""The parts of the guard one by one: routes, speed scale, executed path, keep-out, reflex."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.blending import widest_reach
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.executed import Executed, thinned
from armsight.motion.goals import Goals
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import JointIntent
from armsight.motion.keep_out import (
    KeepOutConfig,
    SeparationPlanner,
    enlarged,
    with_remembered,
)
from armsight.motion.nearest import Hazards
from armsight.motion.permitted import Grant
from armsight.motion.plan import Plan
from armsight.motion.planner import RrtConnectPlanner
from armsight.motion.reflex import Approach, Reflex, ReflexStage
from armsight.motion.regions import Region
from armsight.motion.route import Route, SpeedScale, rate_bounds
from armsight.motion.timing import rounded
from armsight.motion.trajectory import join, straight
from armsight.robots import load_robot

from .scenes import arm6, ball, make_snapshot, oracle_centers

LIMITS = load_robot("ur5").limits.scaled(0.5, 0.6)


def test_a_route_begins_moving_and_ends_at_its_end():
    motion = straight(np.zeros(6), np.full(6, 0.5), LIMITS)
    route = Route(motion)
    assert np.abs(route.wanted(np.zeros(6)).velocity).max() > 0.0
    assert not route.done
    route.advance(1e9)
    assert route.done
    assert route.remaining[0] == pytest.approx(np.full(6, 0.5))


def off_the_line(points, line):
    """(n,) distance of points from a (k, m) path, by plain numpy."""
    a, step = line[:-1], np.diff(line, axis=0)
    size = np.maximum((step * step).sum(axis=1), 1e-18)
    share = np.clip(((points[:, None] - a) * step).sum(axis=2) / size, 0.0, 1.0)
    return np.linalg.norm(a + share[..., None] * step - points[:, None], axis=2).min(axis=1)


@pytest.mark.parametrize("reach", [0.0, 0.01, 0.03, 0.1])
def test_what_is_proven_of_a_route_is_near_the_motion_at_corners_too(reach):
    """Samples went over a corner, and their lines are proven: 0.025 rad away from the motion."""
    off = []
    for length in np.linspace(0.4, 0.48, 9):
        for turn in (1.0, -0.9):
            way = np.zeros((3, 6))
            way[1:, 0] = length
            way[2, :2] += 0.43 * (1.0 - abs(turn)), 0.43 * turn
            motion = rounded(way, np.array([0.0, reach, 0.0]), LIMITS)
            dense = motion.sample(np.linspace(0.0, motion.duration, 2000))
            off.append(off_the_line(dense, Route(motion).remaining).max())
    assert max(off) < 0.004


def test_a_straight_route_is_looked_at_no_more_often_for_it():
    motion = straight(np.zeros(6), np.full(6, 1.0), LIMITS)
    assert len(Route(motion).remaining) < 1.0 / 0.04 + 20


def test_a_route_is_picked_up_where_the_arm_was_thrown():
    motion = straight(np.zeros(6), np.full(6, 1.0), LIMITS)
    route = Route(motion)
    route.advance(0.5)
    route.rejoin(motion.position(0.62))
    assert route.phase == pytest.approx(0.62, abs=0.011)


def test_speed_scale_falls_at_once_and_rises_smoothly():
    scale = SpeedScale(rise=1.5, jerk=10.0)
    scale.reset(1.0)
    assert scale.towards(0.2, 0.008, np.inf) == 0.2
    values = [scale.towards(1.0, 0.008, np.inf) for _ in range(300)]
    rates = np.diff(values) / 0.008
    assert values[-1] == pytest.approx(1.0, abs=1e-3)
    assert max(values) <= 1.0
    assert rates.max() <= 1.5 + 1e-9
    assert np.abs(np.diff(rates)).max() / 0.008 <= 10.0 * 2.5


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_rate_bounds_keep_the_acceleration_limits(seed):
    rng = np.random.default_rng(seed)
    limit = np.full(6, 3.0)
    v, a, s = rng.normal(size=6), rng.uniform(-2.9, 2.9, 6), rng.uniform(0, 1)
    low, high = rate_bounds(s, v, a, limit)
    assert low <= 0.0 <= high
    for rate in (low, high):
        assert (np.abs(a * s * s + v * rate) <= limit + 1e-9).all()
    assert (np.abs(a * s * s + v * (high + 0.01)) > limit - 1e-9).any()


def test_nothing_moving_has_no_rate_bounds():
    assert rate_bounds(0.5, np.zeros(6), np.zeros(6), np.ones(6)) == (-np.inf, np.inf)


def test_retrace_goes_back_over_the_last_tenth():
    executed = Executed()
    for x in np.linspace(0.0, 2.0, 401):
        executed.add(np.array([x, 0.0]))
    back = executed.retrace(np.array([2.0, 0.0]), 0.1)
    assert back[0] == pytest.approx([2.0, 0.0])
    assert back[-1] == pytest.approx([1.8, 0.0], abs=0.03)
    assert (np.diff(back[:, 0]) < 0).all()
    executed.clear()
    assert len(executed.retrace(np.zeros(2), 0.1)) == 1
    assert executed.path is None


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 80))
def test_thinning_leaves_nothing_out_that_matters(seed, count):
    rng = np.random.default_rng(seed)
    path = np.cumsum(rng.normal(size=(count, 3)) * 0.05, axis=0)
    thin = thinned(path, 0.01)
    assert np.array_equal(thin[[0, -1]], path[[0, -1]])
    for p in path:
        a, b = thin[:-1], thin[1:]
        if len(thin) == 1:
            continue
        d = b - a
        share = np.clip(((p - a) * d).sum(1) / np.maximum((d * d).sum(1), 1e-18), 0, 1)
        assert np.linalg.norm(a + share[:, None] * d - p, axis=1).min() <= 0.01 + 1e-9


def test_approach_is_the_slope_and_noise_does_not_fire_it():
    approach = Approach()
    for t in np.arange(0.0, 0.4, 0.033):
        approach.add(t, 1.0 - 0.8 * t)
    assert approach.speed == pytest.approx(0.8)
    flicker = Approach()
    for k, t in enumerate(np.arange(0.0, 0.4, 0.033)):
        flicker.add(t, 0.6 + 0.02 * (k % 2))
    assert abs(flicker.speed) < 0.1
    flicker.add(1.0, np.inf)
    assert flicker.speed == 0.0


def test_reflex_is_due_close_by_and_for_what_comes_fast():
    reflex = Reflex(GuardConfig(), LIMITS)
    assert reflex.due(0.1)
    assert not reflex.due(0.3)
    for t in np.arange(0.0, 0.4, 0.033):
        reflex.approach.add(t, 0.9 - 1.5 * t)
    assert reflex.due(0.4)
    leaving = Reflex(GuardConfig(), LIMITS)
    for t in np.arange(0.0, 0.4, 0.033):
        leaving.approach.add(t, 0.3 + 1.5 * t)
    assert not leaving.due(0.4)


def test_reflex_retraces_its_way_from_a_slow_hand():
    """A hand follows the arm's tip from ahead: the way back is free and leads away."""
    a, b = np.deg2rad([-55, -70, 85, -105, -90, 0]), np.deg2rad([55, -70, 85, -105, -90, 0])
    stages = set()
    cell = QuickCell(goals=[b], config=GuardConfig(reflex_distance=0.4))
    cell.q = a.copy()
    cell.run(1.8)
    tip = cell.guard.body.motion(cell.q, cell.v)
    ahead = tip[0][-1] + 0.35 * tip[1][-1] / np.linalg.norm(tip[1][-1])
    cell.balls = [Ball(lambda t: ahead, 0.05)]
    for _ in range(250):
        cell.tick()
        stages.add(cell.guard._reflex.stage)
    assert ReflexStage.RETRACE in stages
    assert not cell.moving_touches


def test_a_way_back_that_is_not_allowed_does_not_hold_the_arm_for_ever():
    """A hand ahead, and when the arm goes back, another behind: neither leaves."""
    a, b = np.deg2rad([-55, -70, 85, -105, -90, 0]), np.deg2rad([55, -70, 85, -105, -90, 0])
    cell = QuickCell(goals=[b], config=GuardConfig(reflex_distance=0.4))
    cell.q = a.copy()
    cell.run(1.8)
    center, velocity = (x[-1] for x in cell.guard.body.motion(cell.q, cell.v))
    way = velocity / np.linalg.norm(velocity)
    cell.balls = [Ball(lambda t: center + 0.35 * way, 0.05)]
    while cell.guard._reflex.stage != ReflexStage.RETRACE:
        cell.tick()
    here = cell.guard.body.motion(cell.q, cell.v)[0][-1]
    cell.balls.append(Ball(lambda t: here - 0.3 * way, 0.05))
    cell.run(cell.now + 2.0)
    assert cell.guard._reflex.stage != ReflexStage.RETRACE
    assert not cell.moving_touches


def test_a_way_back_is_proven_as_it_is_driven(monkeypatch):
    """Round its corners: what stands inside of one was not in the way that was looked at."""
    robot = arm6()
    limits = robot.limits.scaled(0.5, 0.6)
    way = np.tile([0.0, -0.8, 0.6, 0.0, 0.0, 0.0], (3, 1))
    way[1:, 0], way[2, 1] = 0.8, -1.6
    motion = rounded(way, widest_reach(way), limits)
    inside = motion.sample(np.linspace(0.0, motion.duration, 200))
    inside = inside[int(np.argmax(off_the_line(inside, way)))]
    model = CollisionModel(robot)
    tip = oracle_centers(robot, inside)[-1]
    snapshot = make_snapshot([ball(tip, 0.01)])
    assert model.path_valid(way, snapshot, way[0])
    executed = Executed()
    for a, b in ((way[2], way[1]), (way[1], way[0])):
        for share in np.linspace(0.0, 1.0, 27):  # each is remembered, the corner too
            executed.add(a + share * (b - a))
    reflex = Reflex(GuardConfig(retrace_share=1.0), limits)
    monkeypatch.setattr(reflex, "_leads_away", lambda *_: True)
    reflex.choose(way[0], executed, None, None, model, snapshot)
    assert reflex.stage == ReflexStage.RETRACE
    assert model.first_blocked_time(reflex.route.trajectory, snapshot, at=way[0]) is None
    assert reflex.route.trajectory.end == pytest.approx(way[2], abs=0.05)


def test_the_same_goal_may_be_asked_for_more_slowly_or_more_closely():
    """The first word on both was the last: a task that wanted to go slower was not heard."""
    robot = arm6()
    goals, goal = Goals(robot, GuardConfig()), JointIntent("A", robot.home)
    assert goals.set(goal)
    goals.reached = True
    assert not goals.set(replace(goal))
    assert not goals.set(replace(goal, speed=0.2))
    assert (goals.goal.speed, goals.reached) == (0.2, True)
    assert not goals.set(replace(goal, speed=7.0))
    assert "asks for speed 7.0" in goals.refusal
    assert not goals.set(goal)
    assert goals.active is False
    assert goals.refusal == ""
    assert goals.set(replace(goal, tolerance=0.001))
    assert not goals.reached
    odd = replace(goal, tolerance=0.001, speed=np.ones(2))  # never raises, however often it is said
    for _ in range(2):
        assert not goals.set(odd)
        assert goals.refusal


def test_a_reflex_that_gives_up_starts_again_only_for_what_comes_nearer():
    reflex = Reflex(GuardConfig(), LIMITS)
    reflex.begin(0.1)
    reflex.stage = ReflexStage.FLEE
    assert not reflex.stuck(0.0, at_rest=True)
    assert not reflex.stuck(0.5, at_rest=False)
    assert not reflex.stuck(1.0, at_rest=True)
    assert reflex.stuck(2.0, at_rest=True)
    reflex.try_other(0.1)
    assert not reflex.active
    assert not reflex.due(0.1)
    assert reflex.due(0.07)  # nearer than what it gave up at
    assert not reflex.due(0.3)  # far again: what was given up is forgotten
    assert reflex.due(0.1)


def test_enlarged_hazards_bound_what_they_say():
    cell = QuickCell([Ball(lambda t: np.array([0.5, 0.1, 0.3]), 0.05)])
    snapshot = cell.snapshot_at(0.0)
    large = enlarged(snapshot, 0.3)
    solid = cell.grid.center(np.argwhere(large.state == OCCUPIED))
    reach = np.linalg.norm(solid - [0.5, 0.1, 0.3], axis=1)
    assert 0.25 < reach.max() < 0.3 + 0.05 + 0.12
    assert (snapshot.state != OCCUPIED).all()
    rng = np.random.default_rng(0)
    index = rng.integers(0, np.array(cell.grid.shape), (400, 3))
    corners = cell.grid.origin + (index[:, None] + rng.random((400, 1, 3))) * cell.grid.voxel
    for ix, point in zip(index, corners[:, 0]):
        gap = np.maximum(np.abs(solid - point) - 0.5 * cell.grid.voxel, 0.0)
        true = np.linalg.norm(gap, axis=1).min()
        assert large.distance[tuple(ix)] <= true + 1e-6


def test_without_hazards_nothing_is_enlarged():
    cell = QuickCell()
    snapshot = cell.snapshot_at(0.0)
    assert enlarged(snapshot, 0.3) is snapshot


def was_occupied(snapshot, lower, upper, age):
    last = snapshot.last_occupied.copy()
    index = np.argwhere(snapshot.state >= 0)
    places = snapshot.grid.center(index)
    inside = ((places > lower) & (places < upper)).all(axis=1)
    last[tuple(index[inside].T)] = snapshot.stamp - age
    return replace(snapshot, last_occupied=last), places[inside]


def test_remembered_places_are_hazards_until_they_are_forgotten():
    snapshot = QuickCell([Ball(lambda t: np.array([0.5, 0.1, 0.3]), 0.05)]).snapshot_at(100.0)
    before, places = was_occupied(snapshot, (0.6, -0.2, 0.1), (0.7, 0.2, 0.3), age=5.0)
    remembered = with_remembered(before, 20.0)
    np.testing.assert_allclose(remembered.hazards[: len(snapshot.hazards)], snapshot.hazards)
    found = remembered.hazards[len(snapshot.hazards) :]
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(places, axis=0), atol=1e-5)
    assert len(remembered.hazard_unknown) == len(remembered.hazards)
    assert with_remembered(before, 4.0) is before
    assert with_remembered(snapshot, 20.0) is snapshot


def test_a_way_around_a_remembered_place_is_taken_if_it_costs_little():
    cell = QuickCell()
    start, goal = np.deg2rad([[-60, -70, 85, -105, -90, 0], [60, -70, 85, -105, -90, 0]])
    request = PlanRequest(0, start, JointIntent("B", goal))
    snapshot = cell.snapshot_at(100.0)
    before, places = was_occupied(snapshot, (0.85, -0.1, 0.2), (1.05, 0.1, 0.4), age=5.0)
    hazards = Hazards.at(places, snapshot.hazard_radius)

    def time_there(snapshot, returns):
        planner = SeparationPlanner(
            RrtConnectPlanner(cell.robot),
            cell.robot,
            [cell.info],
            cell.config,
            KeepOutConfig(returns=returns),
        )
        plan = planner.plan(request, snapshot, 0.05, np.random.default_rng(3))
        assert plan.good
        return planner.predicted_time(plan.trajectory, hazards)

    assert time_there(before, 0.5) < 0.8 * time_there(before, 0.0)


def test_a_short_wait_beats_a_long_way_round_until_it_has_lasted():
    """Two answers: 2 s through where somebody stands, 6 s around."""
    cell = QuickCell()
    start = np.deg2rad([-60, -70, 85, -105, -90, 0])
    goal, aside = start.copy(), start.copy()
    goal[0], aside[0] = -start[0], -np.pi
    through = straight(start, goal, cell.robot.limits.scaled(0.5, 0.6))
    slow = cell.robot.limits.scaled(0.25, 0.6)
    around = join([straight(start, aside, slow), straight(aside, start, slow)])
    cell.balls = [Ball(lambda t: np.array([0.87, 0.15, 0.33]), 0.05)]
    snapshot = cell.snapshot_at(0.0)

    class Two:
        def __init__(self):
            self.calls = 0

        def plan(self, request, snapshot, time_limit, rng):
            self.calls += 1
            motion = through if self.calls == 1 else around
            return Plan(
                0, motion.sample(np.array([0.0, motion.duration])), motion, 1.0, 0, 0.0, 0.0
            )

    def chosen(held, grant=None):
        planner = SeparationPlanner(Two(), cell.robot, [cell.info], cell.config)
        request = PlanRequest(0, start, JointIntent("G", goal), None, held, grant)
        return planner.plan(request, snapshot, 0.05, np.random.default_rng(0)).trajectory

    assert around.duration > through.duration + 3.0
    assert chosen(0.0) is through
    assert chosen(30.0) is around
    # Who holds something out to be touched stays beside it.
    region = Region("sphere", (0.1, 0.0, 0.0), np.eye(4), 0.0)
    touching = np.zeros(len(cell.robot.spheres.radius), bool)
    assert chosen(0.0, Grant(region, touching, person=True)) is around
    assert chosen(0.0, Grant(region, touching)) is through
