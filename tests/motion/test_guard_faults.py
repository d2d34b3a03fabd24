"""Everything that can be wrong has a defined answer, a message, and never a motion towards it."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.errors import UsageError
from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.mapping.snapshot import OCCUPIED, CameraStatus
from armsight.motion.data import GuardMode
from armsight.motion.dead_reckoning import DeadReckoning
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import JointIntent
from armsight.motion.task import Observation
from armsight.robots.kinematics import tcp_pose
from armsight.tasks.patrol import PatrolTask

A = np.deg2rad([-55, -70, 85, -105, -90, 0])
B = np.deg2rad([55, -70, 85, -105, -90, 0])


@pytest.fixture
def moving():
    """A guard in the middle of a motion."""
    world = QuickCell(goals=[A, B])
    world.run(1.3)
    assert np.abs(world.v).max() > 0.3
    return world


def reading(world, **changes):
    state = JointState(world.now, world.q.copy(), world.v.copy())
    return replace(state, **changes)


def nan_in(values):
    out = values.copy()
    out[2] = np.nan
    return out


BAD_JOINTS = {
    "lost": (lambda w: None, "no joint state"),
    "nan": (lambda w: reading(w, position=nan_in(w.q)), "not finite"),
    "inf": (lambda w: reading(w, velocity=w.v + np.inf), "not finite"),
    "outside": (lambda w: reading(w, position=w.q + 7.0), "outside its limits"),
    "too fast": (lambda w: reading(w, velocity=w.v + 9.0), "which it cannot"),
    "old": (lambda w: reading(w, stamp=w.now - 0.2), "200 ms old"),
    "from the future": (lambda w: reading(w, stamp=w.now + 0.5), "future"),
    "jump": (lambda w: reading(w, position=w.q + 0.6), "jumped by"),
    "wrong size": (lambda w: reading(w, position=w.q[:5]), "values"),
}


@pytest.mark.parametrize("case", BAD_JOINTS)
def test_bad_joints_brake_and_say_why(moving, case):
    make, message = BAD_JOINTS[case]
    decision = moving.tick(joints=make(moving))
    assert decision.brake
    assert not decision.command.any()
    assert decision.status.mode == GuardMode.STOPPED
    assert message in decision.status.reason
    for _ in range(60):
        decision = moving.tick(joints=make(moving))
        # A reading that jumped once and stays there is believed after a while.
        if case != "jump":
            assert decision.brake
    if case != "jump":
        assert np.abs(moving.v).max() < 1e-9


def test_it_goes_on_when_the_joints_are_back(moving):
    for _ in range(50):
        moving.tick(joints=None)
    assert "no joint state" in moving.log[-1].reason
    moving.run(0.1)
    assert "recovering: no joint state" in moving.log[-1].reason
    moving.run(6)
    assert moving.visits


def test_a_stop_that_would_come_too_late_is_begun_and_said(moving, monkeypatch):
    monkeypatch.setattr(moving.guard._filter, "stops_in_time", lambda tick, leaves: False)
    decision = moving.tick()
    assert decision.brake
    assert decision.status.mode == GuardMode.SLOWED
    assert decision.status.reason == "nothing near"


def stale(world):
    s = world.snapshot
    return replace(s, oldest=s.oldest - 1, cameras=(CameraStatus("cam", s.stamp - 1, True, 1, 0),))


def dead(world):
    return replace(
        world.snapshot,
        cameras=(CameraStatus("cam", world.snapshot.stamp, False, 1, 0, "cable is out"),),
    )


def refused(world):
    why = "no frame yet; last one refused: sits 140 mm from its calibration"
    status = CameraStatus("cam", -np.inf, False, 0, 3, why)
    return replace(world.snapshot, cameras=(status,))


BAD_MAPS = {
    "stale camera": (stale, "ms old"),
    "dead camera": (dead, "cam is not trusted (cable is out)"),
    "camera missing": (lambda w: replace(w.snapshot, cameras=()), "sent nothing yet"),
    "camera refused": (refused, "nothing usable (no frame yet; last one refused: sits 140 mm"),
    "future": (lambda w: replace(w.snapshot, stamp=w.now + 1.0), "in the future"),
    "backwards": (lambda w: replace(w.snapshot, sequence=0), "refused"),
    "gone": (lambda w: None, "no map yet"),
}


@pytest.mark.parametrize("case", BAD_MAPS)
def test_bad_maps_slow_down_and_stop(moving, case):
    make, message = BAD_MAPS[case]
    before = np.inf
    most, told = 1.5 * moving.guard._filter.limits.acceleration / 125, moving.commands[-1][:-1]
    for k in range(80):
        decision = moving.tick(snapshot=make(moving))
        assert not decision.brake
        assert (np.abs(decision.command - told) <= most).all(), "smoothly, along its path"
        told = decision.command
        assert decision.status.mode == GuardMode.STOPPED
        assert message in decision.status.reason
        assert k < 2 or np.abs(decision.command).max() <= before + 1e-3
        before = np.abs(decision.command).max()
    assert np.abs(moving.v).max() < 0.02
    moving.run(6)
    assert moving.visits


def frozen(moving, q):
    return moving.tick(joints=JointState(moving.now, q, np.zeros(6)))


def until_noticed(moving, q):
    began = moving.now
    while not (decision := frozen(moving, q)).brake:
        assert moving.now < began + 0.35
    return decision


@pytest.fixture
def by_a_quarter_second(monkeypatch):
    """Only what obedience itself sees counts: dead reckoning says nothing."""
    monkeypatch.setattr(DeadReckoning, "fault", lambda self, joints: "")


@pytest.mark.usefixtures("by_a_quarter_second")
def test_readings_that_stand_still_are_noticed_by_their_way(moving):
    decision = until_noticed(moving, moving.q.copy())
    assert "does not follow: told to go" in decision.status.reason


def test_readings_that_stand_still_while_the_arm_moves_are_noticed(moving):
    """Fresh stamps, the same angles again and again."""
    q = moving.q.copy()
    decision = until_noticed(moving, q)
    assert "does not follow" in decision.status.reason
    stopped = moving.now
    while moving.now < stopped + 4.0:
        assert frozen(moving, q).brake
    assert not moving.v.any()
    moving.run(9.0)
    assert moving.visits, "it goes on when the readings tell the truth again"


def test_an_arm_that_goes_on_when_it_is_told_to_rest_is_noticed(moving):
    began, q, v = moving.now, moving.q.copy(), moving.v.copy()
    while True:
        goes_on = JointState(moving.now, q + v * (moving.now - began), v)
        decision = moving.tick(goal=None, joints=goes_on)
        if decision.brake:
            break
        assert moving.now < began + 0.8
    assert "does not follow" in decision.status.reason


def unheard(moving):
    """An arm that goes on for its watchdog's time, then brakes; until that is noticed."""
    q, v, began = moving.q.copy(), moving.v.copy(), moving.now
    brake = moving.robot.limits.acceleration
    while True:
        since = moving.now - began
        ramp = np.minimum(max(since - 0.1, 0.0), np.abs(v) / brake)
        slower = v - np.sign(v) * brake * ramp
        at = q + v * min(since, 0.1) + 0.5 * (v + slower) * ramp
        decision = moving.tick(joints=JointState(moving.now, at, slower))
        if decision.brake:
            return since, decision.status.reason
        assert since < 0.25


def test_an_arm_that_hears_nothing_any_more_is_noticed(moving):
    since, reason = unheard(moving)
    assert since <= 0.2
    assert "does not follow" in reason


@pytest.mark.usefixtures("by_a_quarter_second")
def test_an_arm_that_hears_nothing_any_more_is_noticed_by_its_speed(moving):
    """Its way tells only 0.1 s later."""
    assert "does not follow: told to go at" in unheard(moving)[1]


@pytest.mark.parametrize("late", [-0.06, -0.03, -0.015, 0.015])
def test_drives_that_answer_sooner_or_later_than_declared_are_no_fault(late):
    world = QuickCell(goals=[A, B])
    world.config = replace(world.config, start_delay=world.config.start_delay + late)
    world.run(8.0)
    assert len(world.visits) >= 2
    assert not any("does not follow" in status.reason for status in world.log)


@pytest.mark.parametrize(
    ("brakes", "noticed"), [(1.0, False), (0.9, False), (0.8, False), (0.7, True), (0.3, True)]
)
def test_brakes_that_are_far_weaker_than_declared_are_noticed_when_they_are_used(brakes, noticed):
    place = np.array([0.0, -2.0, 0.5])
    world = QuickCell([Ball(lambda t: place, 0.08)], goals=[A, B])
    world.brakes = brakes
    world.run(1.3)
    assert np.abs(world.v).max() > 0.3
    place[:] = tcp_pose(world.robot, world.q)[:3, 3] + (0.0, 0.0, 0.35)
    world.run(0.8)
    assert any(command[-1] for command in world.commands[-100:]), "it brakes"
    assert any("does not follow" in status.reason for status in world.log) == noticed


def test_a_map_that_stops_coming_is_noticed(moving):
    frozen = moving.snapshot
    reasons = {moving.tick(snapshot=frozen).status.reason for _ in range(100)}
    assert any("cam is" in r and "ms old" in r for r in reasons)
    assert np.abs(moving.v).max() < 0.02


@pytest.mark.parametrize("jump", [-1.0, 5.0])
def test_a_clock_that_jumps_brakes(moving, jump):
    now = moving.now + jump
    snapshot = replace(
        moving.snapshot, stamp=now, oldest=now, cameras=(CameraStatus("cam", now, True, 1, 0),)
    )
    decision = moving.tick(
        clock=now, joints=reading(moving, stamp=now), snapshot=snapshot, goal=None
    )
    assert decision.brake
    assert "the clock jumped" in decision.status.reason


def test_after_a_clock_was_turned_back_the_arm_goes_on(moving):
    """Stops, waits until all has been well for a while, and reaches its goals again."""
    moving.turn_back(1.0)
    first = moving.tick()
    assert first.brake
    assert "the clock jumped back" in first.status.reason
    moving.run(0.6)
    assert np.abs(moving.v).max() < 1e-3
    visits = len(moving.visits)
    moving.run(8.0)
    assert len(moving.visits) > visits
    assert moving.log[-1].mode != GuardMode.STOPPED


def test_a_clock_that_says_no_number_brakes(moving):
    decision = moving.tick(clock=float("nan"))
    assert decision.brake
    assert "no number" in decision.status.reason


@pytest.mark.parametrize("seconds", [0.08, 0.3])
def test_a_late_tick_slows(moving, seconds):
    moving.drive(moving.now + seconds)
    decision = moving.tick()
    assert decision.status.mode == GuardMode.STOPPED
    assert "late" in decision.status.reason
    moving.run(6.0)
    assert moving.visits, "it recovers"


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        (JointIntent("X", np.full(6, np.nan)), "not finite"),
        (JointIntent("X", np.full(6, 7.0)), "outside its limits"),
        (JointIntent("X", np.zeros(5)), "has 5 joints"),
        (JointIntent("X", np.zeros(6), speed=0.0), "speed"),
    ],
)
def test_bad_goals_are_refused_at_rest(moving, goal, message):
    for _ in range(100):
        decision = moving.tick(goal=goal)
        assert decision.request is None
    assert message in decision.status.reason
    assert decision.status.mode == GuardMode.STOPPED
    assert not decision.status.reached
    assert np.abs(moving.v).max() < 0.02


def plan_of(world, **changes):
    request = world.guard._goals._pending
    path = np.stack([world.q, request.goal.position])
    good = world.planner.plan(request, world.snapshot, 0.05, world.rng)
    return replace(good, **{"path": path, **changes})


def waiting():
    world = QuickCell(goals=[A])
    while world.guard._goals._pending is None:
        world.tick()
    world.plans.clear()
    return world


def test_a_plan_that_starts_elsewhere_is_refused():
    world = waiting()
    plan = plan_of(world)
    moved = replace(plan.trajectory, q=plan.trajectory.q + 0.1)
    world.plan = replace(plan, trajectory=moved)
    decision = world.tick()
    assert "starts 0.100 rad from where the arm is" in decision.status.reason
    assert not decision.command.any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory": None}, "no motion"),
        ({"failure": "goal: wrist touches something", "trajectory": None}, "wrist touches"),
    ],
)
def test_a_failed_plan_is_said_and_asked_for_again(changes, message):
    world = waiting()
    first = world.guard._goals._pending.sequence
    world.plan = plan_of(world, **changes)
    decision = world.tick()
    assert message in decision.status.reason
    assert decision.status.mode == GuardMode.STOPPED
    while world.guard._goals._pending is None:
        world.tick()
    assert world.guard._goals._pending.sequence == first + 1


def test_an_old_answer_is_ignored():
    world = waiting()
    world.plan = replace(plan_of(world), request=99)
    world.tick()
    assert world.guard._route is None


def test_an_unanswered_request_is_repeated():
    world = waiting()
    first = world.guard._goals._pending.sequence
    for _ in range(int(3.2 / 0.008)):
        world.tick()
        world.plans.clear()
    assert world.guard._goals._pending.sequence == first + 1


def test_a_goal_in_collision_is_refused_with_what_blocks_it():
    from armsight.robots.kinematics import tcp_pose

    world = QuickCell(goals=[A])
    at = tcp_pose(world.robot, A)[:3, 3]
    index = tuple(world.grid.index(at[None])[0])
    world.state = world.state.copy()
    world.field = np.zeros_like(world.field)
    world.state[index] = 2
    world.run(1.0)
    assert world.log[-1].mode == GuardMode.STOPPED
    assert "goal G0" in world.log[-1].reason
    assert "touches" in world.log[-1].reason
    assert np.abs(world.v).max() == 0.0


def test_a_start_in_collision_is_said_and_nothing_moves_in():
    world = QuickCell(goals=[A])
    here = world.guard.body.motion(world.q, np.zeros(6))[0][-1]
    world.balls = [Ball(lambda t: here, 0.03)]
    world.run(2.0)
    last = world.log[-1]
    assert last.mode == GuardMode.REFLEX
    speeds = [world.guard.body.motion(world.q, c[:6])[1] for c in world.commands]
    assert max(np.linalg.norm(s, axis=1).max() for s in speeds) <= 0.05


def test_configuration_out_of_range_is_refused():
    with pytest.raises(UsageError, match=r"guard.gain is 50"):
        GuardConfig(gain=50)


def test_patrol_visits_in_turn_and_needs_two_goals():
    with pytest.raises(UsageError, match="at least two"):
        PatrolTask({"A": A})
    world = QuickCell()
    task = PatrolTask({"A": A, "B": B}, dwell=0.3)
    for _ in range(int(9 / 0.008)):
        seen = Observation(world.now, world.robot, guard=world.log[-1] if world.log else None)
        world.tick(goal=task.update(seen))
    assert task.visits >= 2
    assert np.diff(task.times)[0] > 0.3
    task.reset()
    assert task.visits == 0
    assert task.goal.name == "A"


def speck_at(world, point):
    """The map holds one occupied voxel there, which nobody takes for a person."""
    from scipy.ndimage import distance_transform_edt

    index = tuple(world.grid.index(np.asarray(point)[None])[0])
    world.state = world.state.copy()
    world.state[index] = OCCUPIED
    away = distance_transform_edt(world.state != OCCUPIED) * world.grid.voxel
    gap = away - np.sqrt(3.0) * world.grid.voxel
    world.field = np.clip(gap, 0.0, 0.3).astype(np.float32)
    return np.asarray(world.grid.center(np.array(index)))


@pytest.mark.parametrize("depth", [-0.0004, 0.003, 0.012])
def test_an_arm_that_a_speck_touches_leaves_and_does_not_touch_it_more(depth):
    """Noise beside the arm, or what has come to it, must not hold it for ever."""
    world = QuickCell(goals=[A])
    center = world.guard.body.motion(world.q, np.zeros(6))[0]
    tip = int(np.argmax(center[:, 0]))
    edge = 0.5 * world.grid.voxel
    beside = [world.guard.body.radius[tip] + 0.5 * edge, 0.0, 0.0]
    speck = speck_at(world, center[tip] + beside)
    world.q[0] += turn_to(world, speck, edge, depth)
    begin = touch(world, speck, edge)
    assert begin == pytest.approx(-depth, abs=1e-3)
    deepest = begin
    for _ in range(int(8.0 / 0.008)):
        world.tick()
        deepest = min(deepest, touch(world, speck, edge))
    assert deepest > min(begin, 0.0) - 1e-3
    assert world.visits or world.log[-1].reached


def touch(world, speck, edge, q=None):
    """Gap between the body and a voxel's cube [m]; negative inside."""
    q = world.q if q is None else q
    center = world.guard.body.motion(q, np.zeros(6))[0]
    gap = np.linalg.norm(np.maximum(np.abs(center - speck) - edge, 0.0), axis=1)
    return float((gap - world.guard.body.radius).min())


def turn_to(world, speck, edge, depth):
    """A turn of the first joint after which the body is as deep in the voxel as asked for."""
    turns = np.linspace(-0.6, 0.6, 4801)
    q = world.q.copy()
    depths = []
    for turn in turns:
        q[0] = world.q[0] + turn
        depths.append(touch(world, speck, edge, q))
    return float(turns[int(np.argmin(np.abs(np.array(depths) + depth)))])
