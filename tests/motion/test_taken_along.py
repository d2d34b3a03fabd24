"""A way out of what moves: along with it sideways, not after it where it goes, and out of it."""

import numpy as np
import pytest

from armsight.motion.retreat import CARRIED
from armsight.robots.kinematics import tcp_pose

from .test_contact import ROBOT
from .test_leaving import leaving, tip_and_way

SPEED = 0.045


def tip_velocity(velocity, person, felt=(0.0, 0.0, 0.0)):
    """(3,) of the part that leaves, and (3,) the way straight out."""
    retreat, body = leaving(person, velocity)
    retreat.felt = np.array(felt)
    part, _, out = tip_and_way(body, retreat.grant.region.center(1.0))
    motion = retreat.motion(body, ROBOT.home, 1.0, SPEED)
    return body.jacobian(ROBOT.home, part)[:3] @ motion, out


@pytest.mark.parametrize("person", [False, True])
def test_it_leaves_whatever_that_does_and_rubs_along_it_no_faster_than_it_leaves(person):
    """On at 0.12 m/s beside the way out is along with it: an arm that stood would be rubbed so."""
    rng = np.random.default_rng(3)
    alone, _ = tip_velocity(np.zeros(3), person)
    away = 0
    for _ in range(60):
        velocity = rng.normal(size=3)
        velocity *= rng.uniform(0.0, CARRIED) / np.linalg.norm(velocity)
        tip, out = tip_velocity(velocity, person)
        comes = velocity @ out
        away += comes < -0.03
        assert tip @ out > max(comes, 0.0), "out, and faster than it comes"
        assert tip @ out < max(comes, 0.0) + SPEED, "what goes is not run after, nor fled from"
        beside = tip - velocity
        beside -= beside @ out * out
        assert np.linalg.norm(beside) < np.linalg.norm(alone) + 0.05 * np.linalg.norm(velocity)
    assert away > 10


def test_of_what_races_past_it_is_taken_along_no_faster_than_it_may_be():
    axis = tcp_pose(ROBOT, ROBOT.home)[:3, 0]
    tip, _ = tip_velocity(0.6 * axis, False)
    assert 0.9 * CARRIED < tip @ axis < CARRIED + SPEED


def test_what_comes_harder_than_it_is_seen_to_is_left_faster_by_that():
    _, out = tip_velocity(np.zeros(3), False)
    seen, _ = tip_velocity(0.04 * out, False)
    felt, _ = tip_velocity(0.04 * out, False, 0.05 * out)
    assert (felt - seen) @ out == pytest.approx(0.05, rel=0.05)
