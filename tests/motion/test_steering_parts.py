"""Steering alone: ramps, room to stop, ends of travel; with a filter that says as it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.motion.arm_model import ArmState
from armsight.motion.data import GuardMode
from armsight.motion.folding import Unfolded
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import VelocityIntent
from armsight.motion.steering import END_ROOM, SHRINK, USED, Steering
from armsight.motion.tick import Tick
from armsight.robots import load_robot

CONFIG = GuardConfig()
PERIOD = CONFIG.period
UR5 = load_robot("ur5")


class Filter:
    """Allows a speed of the first joint, and says whether the stop is free as it is told."""

    def __init__(self, robot):
        self.limits = robot.limits.scaled(CONFIG.speed, CONFIG.acceleration)
        self.most = 1e3
        self.free = []

    def unfold(self, tick, wanted):
        return Unfolded(wanted)

    def ease(self, tick, wanted):
        return wanted

    def judge(self, tick, motion):
        return SimpleNamespace(allowed=self.most / max(abs(motion[0]), 1e-3))

    def slide(self, tick, wanted, view):
        return wanted, view

    def excess(self, tick, motion):
        return 0.0

    def stop_is_free(self, tick, rubs=0.0):
        return self.free.pop(0) if self.free else True

    def who(self, view):
        return "somebody"


class Arm:
    """Joints that do at once what they are told, and a task that wants one velocity."""

    def __init__(self, robot=UR5, q=None):
        self.robot, self.filter = robot, Filter(robot)
        self.steering = Steering(robot, self.filter, CONFIG)
        self.q = np.array(robot.home if q is None else q, float)
        self.v = np.zeros(robot.n)
        self.now = 0.0

    def tick(self, wanted, elapsed=PERIOD, at_rest=False):
        self.now += elapsed
        state = ArmState(self.now, self.q.copy(), self.v.copy())
        tick = Tick(
            self.now, elapsed, None, None, state, state, at_rest, None, None, np.zeros(self.robot.n)
        )
        velocity = np.asarray(wanted, float)
        self.steering.intent = VelocityIntent("v", velocity, "joint", self.now, self.now + 1.0)
        self.steering.steer(tick)
        self.steering.sent(tick)
        self.v = tick.command
        self.q = self.q + elapsed * tick.command
        return tick


def one(joint, speed, n=6):
    out = np.zeros(n)
    out[joint] = speed
    return out


def moving(speed=0.5):
    arm = Arm()
    for _ in range(150):
        arm.tick(one(0, speed))
    assert arm.v[0] == pytest.approx(speed)
    return arm


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_where_the_stop_is_not_free_it_slows_down_and_asks_for_less_each_time(speed):
    arm = moving(speed)
    room, before = 1.0, arm.v.copy()
    for _ in range(12):
        arm.filter.free = [False, True]
        tick = arm.tick(one(0, speed))
        most = arm.filter.limits.acceleration * PERIOD
        slower = np.sign(before) * np.maximum(np.abs(before) - most, 0.0)
        assert tick.command == pytest.approx(slower)
        assert not tick.brake
        assert tick.reason == "keeps room to stop"
        room = SHRINK * room if room > 0.02 else 0.0
        assert arm.steering.scale == pytest.approx(room)
        before = tick.command
    assert room == 0.0


def test_where_no_slower_stop_is_free_either_it_brakes_unless_it_stands():
    arm = moving()
    arm.filter.free = [False, False]
    assert not arm.tick(one(0, 0.5), at_rest=True).brake
    arm.filter.free = [False, False]
    assert arm.tick(one(0, 0.5)).brake


def test_room_comes_back_smoothly_and_is_said_until_it_has():
    arm = moving()
    for _ in range(6):
        arm.filter.free = [False, True]
        arm.tick(one(0, 0.5))
    scales, reasons, modes = [], [], []
    for _ in range(200):
        tick = arm.tick(one(0, 0.5))
        scales.append(arm.steering.scale)
        reasons.append(tick.reason)
        modes.append(tick.mode)
    assert (np.diff(scales) >= 0.0).all()
    assert np.diff(scales).max() <= CONFIG.rise * PERIOD + 1e-9
    assert scales[-1] == pytest.approx(1.0)
    for scale, reason, mode in zip(scales, reasons, modes):
        assert (reason == "keeps room to stop") == (scale < 0.98)
        assert mode == (GuardMode.SLOWED if scale < 0.98 else GuardMode.VELOCITY)


def test_a_wish_that_is_too_fast_keeps_its_direction_and_a_slow_one_its_speed():
    arm = Arm()
    for _ in range(300):
        arm.q = UR5.home.copy()
        arm.tick(one(0, 9.0) + one(1, 3.0))
    fastest = arm.filter.limits.velocity[0] * CONFIG.task_speed
    assert arm.v == pytest.approx(one(0, fastest) + one(1, fastest / 3.0))
    for _ in range(300):
        arm.q = UR5.home.copy()
        tick = arm.tick(one(0, 0.1) + one(1, -0.2))
    assert arm.v == pytest.approx(one(0, 0.1) + one(1, -0.2))
    assert tick.scale == pytest.approx(1.0)


def test_what_separation_leaves_is_used_but_for_a_tenth():
    arm = Arm()
    arm.filter.most = 0.2
    for _ in range(200):
        tick = arm.tick(one(0, 0.4))
    assert tick.mode == GuardMode.SLOWED
    assert tick.reason == "somebody"
    assert arm.steering.scale == pytest.approx(0.5)
    assert arm.v[0] == pytest.approx(USED * 0.2)
    arm.filter.most = 0.0
    for _ in range(200):
        tick = arm.tick(one(0, 0.4))
    assert tick.mode == GuardMode.STOPPED
    assert arm.steering.scale == 0.0
    arm.filter.most = -1.0
    arm.tick(one(0, 0.4))
    assert arm.steering.scale == 0.0


def test_the_motion_under_way_is_known_by_what_was_sent():
    arm = Arm()
    most = arm.filter.limits.acceleration
    sent = [one(0, 0.004), one(0, 0.007), one(0, 0.003), one(0, 3.0), one(0, -3.0)]
    before = np.zeros(6)
    for command in sent:
        tick = SimpleNamespace(
            brake=False, command=command, elapsed=PERIOD, at_rest=False, ahead=None
        )
        arm.steering.sent(tick)
        rate = np.clip((command - before) / PERIOD, -most, most)
        assert arm.steering.acceleration == pytest.approx(rate)
        before = command
    tick.elapsed = 0.0
    tick.command = np.zeros(6)
    arm.steering.sent(tick)
    assert arm.steering.acceleration == pytest.approx(rate), "no time passed"
    tick = SimpleNamespace(
        brake=True, command=np.zeros(6), elapsed=PERIOD, at_rest=False,
        ahead=ArmState(0.0, arm.q, one(1, 0.2)),
    )  # fmt: skip
    arm.steering.sent(tick)
    assert not arm.steering.acceleration.any()


def test_it_moves_until_it_stands_and_nothing_is_sent_any_more():
    arm = Arm()
    arm.tick(one(0, 0.5))
    for at_rest, velocity, goes_on in [
        (False, one(0, 0.1), True),
        (True, one(0, 0.1), True),
        (False, np.zeros(6), True),
        (True, np.zeros(6), False),
    ]:
        told = SimpleNamespace(
            brake=False, command=velocity, elapsed=PERIOD, at_rest=at_rest, ahead=None
        )
        arm.steering.sent(told)
        assert arm.steering.moving == goes_on


@pytest.mark.parametrize("name", ["ur5", "panda"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_no_velocity_leads_to_the_very_end_of_a_joints_travel(name, side):
    robot = load_robot(name)
    limits = robot.limits
    for joint in range(robot.n):
        end = limits.upper[joint] if side > 0 else limits.lower[joint]
        q = robot.home.copy()
        q[joint] = end - side * 0.2
        arm = Arm(robot, q)
        wish = one(joint, side * 0.5, robot.n)
        for _ in range(200):
            tick = arm.tick(wish)
        room = side * (end - arm.q[joint])
        assert END_ROOM - 1e-6 <= room <= END_ROOM + 0.01
        assert tick.reason == f"{robot.joint_names[joint]} is at the end of its travel"
        assert tick.mode == GuardMode.STOPPED
        for _ in range(30):
            tick = arm.tick(-wish)
        assert tick.reason == "", "it may leave"


def test_the_end_of_travel_is_said_of_the_joint_that_cannot_go_on_and_only_there():
    q = UR5.home.copy()
    fast = 1.2
    way = fast**2 / Filter(UR5).limits.acceleration[5]
    assert way > 0.2
    for room, said in ((0.9 * way, True), (1.1 * way, False)):
        q[5] = UR5.limits.upper[5] - room
        first = Arm(UR5, q).tick(one(5, fast) + one(0, 0.2))
        assert (first.reason == "wrist_3_joint is at the end of its travel") == said
        assert Arm(UR5, q).tick(one(5, -fast)).reason == ""
        assert Arm(UR5, q).tick(one(5, 5e-4)).reason == ""
