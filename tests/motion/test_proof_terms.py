"""Each term of the proof that nobody is touched: the guard's last look against a plain play of it.

The play knows nothing of the guard's kernels: the arm goes on as it was told until the drives have
answered and for two ticks more, then every joint brakes; meanwhile a hand comes straight at it at
2.0 m/s from the exposure of the oldest picture on, in steps of a millisecond. Where the guard lets
a command pass at a distance at which the play has a touch, a term is missing; where it refuses one
far beyond that, a term is there twice.
"""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.mapping.snapshot import CameraStatus
from armsight.motion.collision import CollisionModel
from armsight.motion.faults import FaultWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.looking import look
from armsight.motion.velocity_filter import VelocityFilter
from armsight.robots import load_robot

from .scenes import make_snapshot

ROBOT = load_robot("ur5")
CONFIG = GuardConfig()
INFO = QuickCell([]).info
CAMERAS = [replace(INFO, name=name) for name in ("young", "old")]
NOW = 10.0
SPEED = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
MODEL = CollisionModel(ROBOT)
NOTHING = make_snapshot([], stamp=NOW - 0.03)
RADIUS = 0.5 * np.sqrt(3.0) * NOTHING.grid.voxel
SLACK = 0.02
"""How much more than the play the guard may ask for: it looks at the stop in five places [m]."""


def filter_and_watch(config=CONFIG):
    return (
        VelocityFilter(ROBOT, CAMERAS, config, MODEL),
        FaultWatch(ROBOT, CAMERAS, config),
    )


def passes(point, ages, config=CONFIG, speed=SPEED):
    """Whether the guard lets the arm go on at a speed while a hazard was seen at a point."""
    filter_, watch = filter_and_watch(config)
    statuses = tuple(CameraStatus(c.name, NOW - age, True, 10, 0) for c, age in zip(CAMERAS, ages))
    snapshot = replace(
        NOTHING,
        hazards=np.asarray(point, np.float32)[None],
        hazard_unknown=np.zeros(1, bool),
        cameras=statuses,
        stamp=NOW - min(ages),
        oldest=NOW - max(ages),
    )
    for k in range(20):
        filter_.arm.sent(NOW - 0.16 + 0.008 * k, speed, False)
    joints = JointState(NOW, ROBOT.home.copy(), speed.copy())
    filter_.see(snapshot)
    verdict = watch.check(NOW, joints, snapshot)
    filter_.measure(NOW, verdict.age, well=True)
    tick = look(filter_, NOW, config.period, verdict, joints, snapshot)
    tick.command = speed.copy()
    return filter_.stops_in_time(tick)


def touched(point, ages, config=CONFIG, speed=SPEED):
    """Whether the hand of the play is within K of a part before that part stands."""
    body = filter_and_watch(config)[0].monitor.body
    brake = ROBOT.limits.acceleration * max(config.brake, config.acceleration)
    law = config.separation
    q, v, t = ROBOT.home.copy(), speed.copy(), 0.0
    begins = config.start_delay + 2.0 * config.period
    while np.abs(v).max() > 1e-9 or t < begins:
        center, _ = body.motion(q, v)
        reach = law.person_speed * (t + max(ages)) + law.K + RADIUS
        if (np.linalg.norm(center - point, axis=1) - body.radius <= reach).any():
            return True
        q = q + 1e-3 * v
        if t >= begins:
            v = np.sign(v) * np.maximum(np.abs(v) - 1e-3 * brake, 0.0)
        t += 1e-3
    return False


def border(test):
    """Distance [m] before the tip, along its way, at which the answer changes."""
    body = filter_and_watch()[0].monitor.body
    center, velocity = body.motion(ROBOT.home, SPEED)
    tip = int(np.argmax(np.linalg.norm(velocity, axis=1)))
    way = velocity[tip] / np.linalg.norm(velocity[tip])
    near, far = 0.05, 3.0
    assert test(center[tip] + near * way) != test(center[tip] + far * way)
    while far - near > 1e-3:
        middle = 0.5 * (near + far)
        if test(center[tip] + middle * way) == test(center[tip] + far * way):
            far = middle
        else:
            near = middle
    return far


@pytest.mark.parametrize("ages", [(0.03, 0.09), (0.09, 0.03)])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"start_delay": 0.12},
        {"start_delay": 0.0},
        {"period": 0.016},
        {"brake": 0.7},
    ],
)
def test_a_command_passes_only_where_a_stop_after_it_is_in_time(ages, change):
    config = replace(CONFIG, **change)
    asked = border(lambda p: passes(p, ages, config))
    needed = border(lambda p: touched(p, ages, config))
    assert needed <= asked + 1e-3, "a term is missing"
    assert asked <= needed + SLACK, "more is asked for than the proof needs"


def test_the_oldest_living_camera_counts_and_a_dead_one_does_not():
    _, watch = filter_and_watch()
    joints = JointState(NOW, ROBOT.home.copy(), SPEED.copy())
    for alive, age in ((True, 0.09), (False, 0.03)):
        statuses = (
            CameraStatus("young", NOW - 0.03, True, 10, 0),
            CameraStatus("old", NOW - 0.09, alive, 10, 0),
        )
        snapshot = replace(NOTHING, cameras=statuses)
        assert watch.check(NOW, joints, snapshot).age == pytest.approx(age)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("room", "speed"), [(0.0, 0), (0.002, 0), (0.05, 0), (0.4, 0), (0.2, 0.6)])
def test_a_joint_at_its_limit_may_leave_it_and_come_no_faster_than_it_stops(side, room, speed):
    """From the speed that is left, braking as planned, the joint stands before its limit: counted
    from where it will be when the command has acted for a tick."""
    filter_, watch = filter_and_watch()
    limits = ROBOT.limits
    q = ROBOT.home.copy()
    q[0] = limits.upper[0] - room if side > 0 else limits.lower[0] + room
    joints = JointState(NOW, q, np.array([side * speed, 0.0, 0.0, 0.0, 0.0, 0.0]))
    snapshot = replace(
        NOTHING,
        cameras=tuple(CameraStatus(c.name, NOW - 0.03, True, 10, 0) for c in CAMERAS),
    )
    tick = look(filter_, NOW, 0.008, watch.check(NOW, joints, snapshot), joints, snapshot)
    fast = 0.99 * filter_.limits.velocity[0]
    tick.command = np.array([side * fast, 0.0, 0.0, 0.0, 0.0, 0.0])
    towards = abs(filter_.within_limits(tick)[0])
    room -= abs(tick.ahead.position[0] - q[0]) + abs(tick.ahead.velocity[0]) * 0.008
    most = np.sqrt(2.0 * filter_.arm.acceleration[0] * room)
    stop = towards**2 / (2.0 * filter_.arm.acceleration[0])
    assert stop <= room + 1e-9 or towards < 1e-5
    assert towards == pytest.approx(min(fast, most), abs=1e-5)
    tick.command = -tick.command
    assert filter_.within_limits(tick)[0] == pytest.approx(-side * fast), "it may always leave"


def test_where_the_drives_ramp_lags_behind_what_is_allowed_the_brakes_are_used(monkeypatch):
    """With the last look switched off, somebody who is suddenly near makes the follower brake."""
    place = np.array([9.0, 0.0, 0.0])
    goals = [ROBOT.home + np.array([1.2, 0, 0, 0, 0, 0]), ROBOT.home]
    cell = QuickCell([Ball(lambda t: place)], goals)
    monkeypatch.setattr(cell.guard._filter, "stops_in_time", lambda tick, leaves: True)
    monkeypatch.setattr(cell.guard._reflex, "due", lambda least: False)
    while np.abs(cell.v).max() < 0.8 * cell.guard._filter.limits.velocity[0]:
        cell.tick()
        assert cell.now < 5.0
    before = len(cell.commands)
    tip, velocity = (x[-1] for x in cell.guard.body.motion(cell.q, cell.v))
    place[:] = tip + 0.4 * velocity / np.linalg.norm(velocity)
    cell.run(0.4)
    assert any(command[-1] for command in cell.commands[before:]), "brakes, not only a ramp"


def test_what_was_measured_of_reaction_has_the_drives_answer_in_it():
    """Older pictures than declared: the person comes until the next decision has the arm brake."""
    filter_, _ = filter_and_watch()
    for k in range(200):
        filter_.measure(NOW + 0.008 * k, 0.6, well=True)
    answers = CONFIG.start_delay + 2 * CONFIG.period  # the next tick, which may be one late
    assert filter_.reaction.value >= 0.6 + answers - 1e-9
    assert filter_.reaction.value < 0.6 + answers + 0.05


def test_an_age_for_which_the_arm_stands_counts_now_and_not_afterwards():
    """Maps are silent now and then: the arm stood for ten seconds after each of them."""
    filter_, _ = filter_and_watch()
    least = filter_.reaction.declared
    filter_.measure(NOW, 0.02, well=True)
    assert filter_.monitor.law.T_person == filter_.reaction.value == least
    filter_.measure(NOW + 0.008, 0.6, well=False)
    assert filter_.monitor.law.T_person == pytest.approx(
        0.6 + CONFIG.start_delay + 2 * CONFIG.period
    )
    filter_.measure(NOW + 0.016, 0.02, well=False)
    assert filter_.monitor.law.T_person == filter_.reaction.value == least
