"""How well a velocity is known that is told look by look."""

import numpy as np
import pytest

from armsight.geometry.pose import make_pose
from armsight.motion.regions import Region
from armsight.motion.told_velocity import ToldVelocity


def told(*looks):
    found = ToldVelocity()
    for exposure, *velocity in looks:
        found.take(Region("sphere", (0.03, 0, 0), make_pose(), exposure, np.array(velocity)))
    return found


def test_what_is_told_once_or_never_changes_is_known():
    assert ToldVelocity().unsure(1.0) == 0.0
    assert told((1.0, 0.3, 0, 0)).unsure(2.0) == 0.0
    assert told((1.0, 0.3, 0, 0), (1.1, 0.3, 0, 0)).unsure(2.0) == 0.0


@pytest.mark.parametrize("age", [0.0, 0.03, 0.1])
def test_of_what_brakes_at_a_constant_rate_it_is_the_rate_times_the_age(age):
    """Against v = v0 - a t, which is wrong by a t at an age of t."""
    looks = [(0.1 * k, 0.5 - 1.2 * 0.1 * k, 0.0, 0.0) for k in range(4)]
    assert told(*looks).unsure(0.3 + age) == pytest.approx(1.2 * age)


def test_it_is_never_more_than_the_velocity_has_changed():
    """Two looks close together, with noise, are no rate to count on."""
    assert told((1.0, 0.10, 0, 0), (1.001, 0.12, 0, 0)).unsure(1.2) == pytest.approx(0.02)


def test_the_same_look_says_nothing_and_a_turn_counts_without_a_change_of_speed():
    found = told((1.0, 0.3, 0, 0), (1.1, 0.0, 0.3, 0), (1.1, 9.0, 0, 0))
    assert found.unsure(1.2) == pytest.approx(0.3 * np.sqrt(2.0))
    found.forget()
    assert found.unsure(1.2) == 0.0
