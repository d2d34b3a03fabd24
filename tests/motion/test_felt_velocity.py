"""How fast a thing comes at the tip that touches it: against things that are played."""

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.geometry.pose import make_pose
from armsight.motion.felt_velocity import FeltVelocity
from armsight.motion.regions import Region
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.sprung_tip import SprungTip
from armsight.workcell import load_workcell, robot_in
from armsight.workcell.packaged import packaged

ROBOT = robot_in(load_workcell(packaged()["ur10_servoing"]))
TIP, HOLD, DT, DELAY = SprungTip(200.0, 0.03, 1.0), 2.5e3, 0.008, 0.06
OUT = np.array([0.6, 0.0, 0.8])
STILL = np.zeros(3)


def force_at(depth):
    """Of springs one behind the other [N], by halving: the same as in test_sprung_contact."""
    near, far = 0.0, TIP.travel
    for _ in range(50):
        middle = 0.5 * (near + far)
        stays = HOLD * (depth - middle) > TIP.seat + TIP.stiffness * middle
        near, far = (middle, far) if stays else (near, middle)
    return HOLD * (depth - near)


def played(felt, speed, rate, told, rates=(0.0,) * 6, ticks=20, noise=0.0):
    """A thing that comes with ``speed + rate t`` along OUT at an arm with joint speeds (6,)."""
    rng, q, rates = np.random.default_rng(3), ROBOT.home.copy(), np.array(rates)
    place = tcp_pose(ROBOT, q)[:3, 3] @ OUT + 0.003  # its surface is 3 mm in already
    for k in range(ticks):
        depth = place - tcp_pose(ROBOT, q)[:3, 3] @ OUT
        push = (force_at(depth) + rng.normal(0.0, noise)) * OUT
        felt.take(JointState(DT * k, q, rates), told, push, (HOLD, TIP), rates)
        place += (speed + rate * DT * (k + 0.5)) * DT
        q = q + DT * rates
    return speed + rate * DT * (ticks - 1)


@pytest.mark.parametrize("ticks", [6, 12, 20])
@pytest.mark.parametrize("speed", [0.05, 0.15, 0.2])
def test_of_what_comes_at_a_constant_speed_that_is_felt_whatever_was_told(speed, ticks):
    felt = FeltVelocity(ROBOT, DELAY)
    played(felt, speed, 0.0, 0.02 * OUT, ticks=ticks)
    assert felt.faster == pytest.approx((speed - 0.02) * OUT, abs=0.03)
    assert felt.closing == pytest.approx((speed, speed), abs=0.03)


def test_of_what_speeds_up_it_is_the_speed_when_a_command_acts():
    felt = FeltVelocity(ROBOT, DELAY)
    now = played(felt, 0.02, 0.8, STILL, ticks=26)
    assert felt.closing[0] == pytest.approx(now, abs=0.01)
    assert felt.closing[1] == pytest.approx(now + DELAY * 0.8, abs=0.02)
    assert felt.faster @ OUT == pytest.approx(now + DELAY * 0.8, abs=0.02)


def test_what_the_arm_does_itself_is_no_motion_of_the_thing():
    rates = np.array([0.3, -0.15, 0.24, 0.0, 0.06, 0.0])
    leaves = tcp_jacobian(ROBOT, ROBOT.home)[:3] @ rates @ OUT
    if leaves > 0.0:  # it is to come
        rates, leaves = -rates, -leaves
    felt = FeltVelocity(ROBOT, DELAY)
    played(felt, 0.0, 0.0, STILL, rates, ticks=15)
    assert np.linalg.norm(felt.faster) < 0.01
    assert felt.closing[0] == pytest.approx(-leaves, abs=0.01)
    assert -leaves > 0.04


def test_noisy_readings_say_little_beyond_what_was_told():
    felt, most = FeltVelocity(ROBOT, DELAY), 0.0
    for ticks in range(4, 40):
        felt.forget()
        played(felt, 0.1, 0.0, 0.1 * OUT, ticks=ticks, noise=0.05)
        most = max(most, float(felt.faster @ OUT))
    assert most < 0.06


def test_what_leaves_faster_than_told_may_be_pushed_away_and_counts_for_nothing():
    felt = FeltVelocity(ROBOT, DELAY)
    played(felt, 0.02, 0.0, 0.2 * OUT)
    assert not felt.faster.any()
    region = Region("sphere", (0.04, 0, 0), make_pose(), 0.0, 0.2 * OUT)
    assert (felt.of(region).velocity == region.velocity).all()


def test_without_springs_or_touch_nothing_is_felt():
    for push, gives in ((None, (HOLD, TIP)), (0.3 * OUT, (HOLD, TIP)), (5.0 * OUT, None)):
        felt = FeltVelocity(ROBOT, DELAY)
        played(felt, 0.2, 0.0, STILL)
        assert felt.faster.any()
        felt.take(JointState(1.0, ROBOT.home, np.zeros(6)), STILL, push, gives)
        assert not felt.faster.any()
        assert felt.closing == (0.0, 0.0)
