"""The top of the mapped box: paths keep under it, and an arm that is there comes away."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.experiments.servo_world import mapped_box, set_up
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent, PoseIntent, VelocityIntent, refusal
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.lid import Lid, with_lid
from armsight.motion.plan import Plan
from armsight.motion.pose_planner import PosePlanner
from armsight.motion.trajectory import straight
from armsight.robots.kinematics import tcp_pose

UP = np.array([0.0, 0.0, 1.0])


def hanging_cell():
    setup = set_up(cell="ur10_straw")
    mapping = setup.workcell.mapping
    low = mapping.model_copy(update={"upper": (*mapping.upper[:2], 1.95)})  # 5 cm above the base
    setup = replace(setup, workcell=setup.workcell.model_copy(update={"mapping": low}))
    return QuickCell([], robot=setup.robot, config=setup.guard, box=mapped_box(setup))


def test_a_hanging_arm_has_its_lid_above_it_with_room_for_its_shoulder():
    """It was at the bench: z of an arm that hangs points down. The shoulder is always in it."""
    cell = hanging_cell()
    lid, snapshot = Lid(cell.guard.body, cell.config.up, 0.2), cell.snapshot_at(0.0)
    home = cell.robot.home
    raised = home.copy()
    raised[1] = 0.17  # as the ball in the browser had led it
    assert lid.below_the_top(home, cell.grid) > 0.08
    assert lid.below_the_top(raised, cell.grid) < 0.02
    closed = lid.over(snapshot, (home, home))
    taken = cell.grid.center(np.argwhere(closed.state == OCCUPIED))
    assert len(taken) > 0.9 * cell.grid.shape[0] * cell.grid.shape[1]
    assert taken[:, 2].max() < cell.grid.origin[2] + 0.1
    model = CollisionModel(cell.robot)
    assert model.valid(home, closed)
    assert not model.valid(raised, closed)
    assert lid.over(snapshot, (home, raised)) is snapshot
    rng = np.random.default_rng(1)
    index = rng.integers(0, (*cell.grid.shape[:2], 12), (300, 3))
    points = cell.grid.origin + (index + rng.random((300, 3))) * cell.grid.voxel
    gaps = np.maximum(np.abs(points[:, None] - taken[None]) - 0.5 * cell.grid.voxel, 0.0)
    nearest = np.linalg.norm(gaps, axis=2).min(axis=1)
    assert (closed.distance[tuple(index.T)] <= nearest + 1e-6).all()


class Ways:
    """Straight ways to what is asked for, or none; and whatever is told of the top."""

    def __init__(self, robot, good=True, top=None):
        self.robot, self.good, self.asked, self._top = robot, good, [], top
        self.lid = self

    def below_the_top(self, q, grid):
        return 0.0 if self._top is not None and np.abs(q - self._top).max() < 0.1 else 0.2

    def plan(self, request, snapshot, time_limit, rng):
        self.asked.append(np.array(request.target))
        path = np.stack([request.start, request.target])
        motion = straight(*path, self.robot.limits) if self.good else None
        return Plan(0, path, motion, 1.0, 0, 0.0, 0.0, "" if motion else "none")

    def expected_time(self, motion, request, snapshot):
        return motion.duration


def led(cell, ways, pose):
    planner = PosePlanner(ways, cell.robot, cell.robot.limits)
    request = PlanRequest(0, cell.robot.home, pose)
    return planner.plan(request, cell.snapshot_at(0.0), 0.05, np.random.default_rng(0))


def test_of_the_ways_to_a_pose_one_that_ends_under_the_very_top_is_the_last_choice():
    """Though it is the nearest: the arm would stand there for good."""
    cell = hanging_cell()
    goal = cell.robot.home + np.deg2rad([10.0, 5.0, 5.0, 0.0, 0.0, 0.0])
    for good in (True, False):
        ways = Ways(cell.robot, good, goal)
        plan = led(cell, ways, PoseIntent("G", tcp_pose(cell.robot, goal)))
        near = [np.abs(q - goal).max() < 0.1 for q in ways.asked]
        assert not near[0]
        assert near[-1] != good
        assert (plan.trajectory is not None) == good


def test_who_goes_on_from_a_pose_is_led_to_where_its_joints_have_room():
    """A wrist that was led to a degree before the end of its travel could not turn to its target:
    the tip stood 3 cm before a bulls-eye for good."""
    cell = hanging_cell()
    robot = cell.robot
    goal = robot.home.copy()
    goal[3] = robot.limits.upper[3] - 0.02
    pose = PoseIntent("G", tcp_pose(robot, goal))

    def room(q):
        return float(np.minimum(q - robot.limits.lower, robot.limits.upper - q).min())

    for good in (True, False):
        anyhow, wide = Ways(robot, good), Ways(robot, good)
        led(cell, anyhow, pose)
        led(cell, wide, replace(pose, room=0.3))
        assert room(wide.asked[0]) > 0.3
        tight = [room(q) < 0.3 for q in wide.asked]
        assert tight == sorted(tight), "what has no room is the last resort"
        assert any(tight) != good
    assert any(room(q) < 0.3 for q in anyhow.asked)
    assert "room is -0.1" in refusal(replace(pose, room=-0.1), robot)


def test_between_places_that_could_hide_somebody_the_arm_leaves_by_itself():
    """Every turn of the upper arm brings its other end nearer to something by a millimetre: it
    stood there for good. The places are those that it hid from the cameras in the browser."""
    cell = hanging_cell()
    start = np.array([-0.41, 0.17, -2.14, 1.33, 1.27, 0.16])
    cell.q = start.copy()
    axes = (np.arange(0.39, 0.52, 0.02), np.arange(-0.40, -0.25, 0.02), [-0.04])
    hidden = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    other = np.stack(np.meshgrid([0.31, 0.33], [0.22, 0.24], [-0.04]), -1).reshape(-1, 3)
    empty = cell.snapshot_at

    def seen(stamp):
        both = np.concatenate([hidden, other]).astype(np.float32)
        return replace(empty(stamp), hazards=both, hazard_unknown=np.ones(len(both), bool))

    cell.snapshot_at = seen
    for _ in range(500):
        wish = VelocityIntent("ball", np.zeros(6), "joint", cell.now, cell.now + 0.5)
        cell.tick(goal=wish)
    assert cell.guard.body.motion(cell.q, np.zeros(6))[0][:, 2].min() > 0.03
    assert cell.q[1] < start[1] - 0.1
    assert max(s.distance for s in cell.log) > 0.12
    fastest = max(
        cell.guard.body.fastest(cell.q, c[:-1], cell.guard.body.motion(cell.q, c[:-1])[1])
        for c in cell.commands
    )
    assert fastest < 0.05


def test_a_lid_bounds_what_it_says():
    snapshot = QuickCell([Ball(lambda t: np.array([0.5, 0.1, 0.3]), 0.05)]).snapshot_at(0.0)
    closed = with_lid(snapshot, 0.2, UP)
    grid = snapshot.grid
    top = grid.origin[2] + grid.shape[2] * grid.voxel
    heights = grid.center(np.argwhere(closed.state == OCCUPIED))[:, 2]
    assert heights.min() - 0.5 * grid.voxel == pytest.approx(top - 0.2)
    assert (closed.state[:, :, : -round(0.2 / grid.voxel)] == snapshot.state[:, :, :-10]).all()
    rng = np.random.default_rng(0)
    index = rng.integers(0, np.array(grid.shape), (400, 3))
    points = grid.origin + (index + rng.random((400, 3))) * grid.voxel
    gap = np.maximum(top - 0.2 - points[:, 2], 0.0)
    assert (closed.distance[tuple(index.T)] <= gap + 1e-6).all()
    assert with_lid(snapshot, 0.01, UP) is snapshot
    assert with_lid(snapshot, -0.3, UP) is snapshot


def test_paths_keep_below_the_lid_unless_a_goal_does_not():
    """Over a wall, or round it a longer way; the space above is free, but nobody looks there."""
    cell = QuickCell()
    start, goal = np.deg2rad([[0, -70, 85, -105, -90, 0], [0, -90, 0, -90, 0, 0]])
    asked = []

    class Asked:
        def plan(self, request, snapshot, time_limit, rng):
            asked.append(snapshot)
            return Plan(0, np.zeros((0, 6)), None, np.inf, 0, 0.0, 0.0, "none")

    planner = SeparationPlanner(Asked(), cell.robot, [cell.info], cell.config)
    snapshot = cell.snapshot_at(0.0)
    for end in (start, goal):  # the second is upright: its wrist is 0.14 m below the box's top
        request = PlanRequest(0, start, JointIntent("G", end))
        planner.plan(request, snapshot, 0.05, np.random.default_rng(0))
    low, high = ((s.state == OCCUPIED).sum(axis=2).max() * cell.grid.voxel for s in asked)
    assert low == pytest.approx(0.2)
    center = cell.guard.body.motion(goal, np.zeros(6))[0]
    room = 1.2 - (center[:, 2] + cell.guard.body.radius).max()
    assert room - 0.05 - 1e-6 <= high <= room
