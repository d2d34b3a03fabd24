"""When a plug that charges is led by its socket, and by how much it went along."""

import numpy as np
import pytest

from armsight.charging.going_along import CALM, FARTHEST, LED, TWISTED, GoingAlong
from armsight.geometry.pose import make_pose

REST = np.array([1.0, -2.0, -26.0, 0.1, 0.0, 0.0])


def at(x):
    return make_pose(None, np.array([0.9 + x, 0.1, 0.8]))


@pytest.mark.parametrize(
    ("more", "led"),
    [
        ((0.9 * LED, 0, 0, 0, 0, 0), False),
        ((0, -1.1 * LED, 0, 0, 0, 0), True),
        ((0, 0, 1.1 * LED, 0, 0, 0), True),
        ((0, 0, 0, 0, 0.9 * TWISTED, 0), False),
        ((0, 0, 0, 0, 0, 1.1 * TWISTED), True),
    ],
)
def test_who_presses_by_more_than_at_first_leads(more, led):
    """A plug rests with what its seat presses: that is nobody."""
    along = GoingAlong()
    assert along.step(0.0, REST, at(0.0)) is None
    assert not along.led(0.0, at(0.0))
    along.step(0.1, REST + more, at(0.0))
    assert along.led(0.1, at(0.0)) == led
    assert not along.led(0.2 + CALM, at(0.0))


def test_what_it_went_along_is_told_once_it_rests_again():
    along = GoingAlong()
    along.step(0.0, REST, at(0.0))
    assert along.step(0.1, REST + LED, at(0.0)) is None
    assert along.step(0.2, REST, at(0.012)) is None
    went = along.step(0.2 + CALM, REST, at(0.015))
    np.testing.assert_allclose(went, make_pose(None, np.array([0.015, 0, 0])), atol=1e-12)
    assert along.step(0.3 + CALM, REST, at(0.015)) is None
    assert along.step(0.4 + CALM, None, at(0.015)) is None, "nobody feels"


def test_it_goes_no_farther_than_it_may_and_says_so_once():
    along, told = GoingAlong(), []
    for k in range(400):
        x = min(0.0002 * k, FARTHEST + 0.001)
        told.append(along.step(0.008 * k, REST + (k > 5) * (LED + k), at(x)))
        assert not along.led(0.008 * k, at(FARTHEST + 0.001))
    assert sum(T is not None for T in told) == 1
