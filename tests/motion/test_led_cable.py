"""A planned motion leads the arm's cable round what is there, by the curve in which it hangs."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.cable_kernels import cable_centers, coarsened, room_about
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hung_cable import DraggedCable
from armsight.motion.intents import JointIntent
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.led_cable import LedCable
from armsight.motion.nearest import Hazards
from armsight.motion.planner import RrtConnectPlanner
from armsight.motion.trajectory import straight
from armsight.robots import load_robot
from armsight.robots.cable import HungCable
from armsight.robots.held import holding
from armsight.robots.kinematics import tcp_pose

from .scenes import ball, make_snapshot

CABLE = HungCable((0.1, -0.7, 1.7), 2.1, root=(0.0, 0.0, 0.0))
TOOL = replace(holding(None, []), T_flange_tcp=make_pose(None, (0.0, 0.0, 0.05)), cable=CABLE)
BARE = load_robot("ur10")
ROBOT = BARE.with_tool(TOOL)
Q = np.deg2rad([0.0, -98.0, 140.0, -42.0, 90.0, 0.0])
A, B = Q - 0.6 * np.eye(6)[0], Q + 0.6 * np.eye(6)[0]
IN_THE_WAY = ((0.29, -0.26, 0.22), 0.06)
"""Where the cable passes halfway, and nothing of the arm does."""


def curve(q, count=200):
    """Where the cable hangs at (n,) [rad]."""
    return CABLE.still(tcp_pose(ROBOT, q)[:3, 3], count)


def gap(q, center, radius):
    """Between the cable's surface and a ball's [m]."""
    return np.linalg.norm(curve(q) - center, axis=1).min() - radius - CABLE.radius


def plan(robot, snapshot, start=A, goal=B):
    planner = RrtConnectPlanner(robot)
    request = PlanRequest(1, start, JointIntent("B", goal))
    return planner.plan(request, snapshot, 1.0, np.random.default_rng(0))


def on_the_way(answer):
    """Configurations along the path and along its motion."""
    found = [a + s * (b - a) for a, b in pairwise(answer.path) for s in np.linspace(0, 1, 60)]
    times = np.linspace(0.0, answer.trajectory.duration, 200)
    return [*found, *(answer.trajectory.position(t) for t in times)]


def test_a_cable_is_led_round_what_stands_in_its_way():
    snapshot = make_snapshot([ball(*IN_THE_WAY)])
    unknowing = plan(BARE.with_tool(replace(TOOL, cable=None)), snapshot)
    assert min(gap(q, *IN_THE_WAY) for q in on_the_way(unknowing)) < 0.0
    answer = plan(ROBOT, snapshot)
    assert answer.good
    assert min(gap(q, *IN_THE_WAY) for q in on_the_way(answer)) > 0.03


def test_a_cable_that_is_near_something_at_an_end_may_leave_and_reach_it_but_comes_no_nearer():
    for q, other in ((A, B), (B, A)):
        thing = (curve(q)[60] + np.array([0.0, 0.0, -0.11]), 0.05)
        snapshot = make_snapshot([ball(*thing)])
        for start, goal in ((q, other), (other, q)):
            answer = plan(ROBOT, snapshot, start, goal)
            assert answer.good
            least = min(gap(place, *thing) for place in on_the_way(answer))
            assert least > min(gap(q, *thing), gap(other, *thing)) - 0.08  # pieces, coarse cubes


def test_the_time_of_a_motion_counts_how_slowly_its_cable_may_come_to_somebody():
    robot = BARE.with_tool(replace(TOOL, cable=None))
    motion = straight(A, B, BARE.limits.scaled(0.5, 0.6))
    somebody = Hazards.at(curve(Q)[60:90] + np.array([0.3, -0.35, 0.0]), 0.02)
    times = [
        SeparationPlanner(RrtConnectPlanner(r), r, [], GuardConfig()).predicted_time(
            motion, somebody
        )
        for r in (robot, ROBOT)
    ]
    assert times[1] > 1.3 * times[0]


@pytest.fixture
def way():
    snapshot = make_snapshot([ball(*IN_THE_WAY)])
    ob = CollisionModel(ROBOT).obstacles(snapshot, A)
    return LedCable.of(ROBOT).among(ob).cable


def test_the_cable_is_where_the_guard_has_it(way):
    out = np.empty((len(way.radius), 3))
    for q in (A, Q, B):
        cable_centers(way, q, out)
        np.testing.assert_allclose(out, DraggedCable.of(ROBOT).motion(q, np.zeros(6))[0], atol=1e-9)


def test_its_end_moves_no_farther_than_the_levers_say(way):
    rng = np.random.default_rng(3)
    for _ in range(200):
        q, step = rng.uniform(-3, 3, 6), rng.normal(0, 0.05, 6)
        moved = np.linalg.norm((tcp_pose(ROBOT, q + step) - tcp_pose(ROBOT, q))[:3, 3])
        assert moved <= way.lever @ np.abs(step) + 1e-12


def test_room_is_the_distance_to_the_nearest_coarse_cube(way):
    rng = np.random.default_rng(4)
    low = way.origin + np.argwhere(way.solid) * way.edge
    assert len(low)
    for p in rng.uniform(-0.3, 0.6, (200, 3)):
        away = np.maximum(np.maximum(low - p, p - low - way.edge), 0.0)
        exact = np.linalg.norm(away, axis=1).min()
        assert room_about(way, *p, limit=0.3) == pytest.approx(min(exact, 0.3), abs=1e-9)


def test_a_coarse_cube_holds_what_any_of_its_voxels_does():
    state = np.ones((7, 6, 5), np.uint8)
    for place in ((0, 0, 0), (6, 5, 4), (3, 2, 2)):
        state[place] = OCCUPIED
    solid = coarsened(state, 3)
    assert solid.shape == (3, 2, 2)
    assert set(map(tuple, np.argwhere(solid).tolist())) == {(0, 0, 0), (2, 1, 1), (1, 0, 0)}


def test_an_arm_without_a_cable_plans_as_before():
    assert LedCable.of(BARE) is None
