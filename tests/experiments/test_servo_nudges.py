"""What a tip may do to a ball on a stand."""

from __future__ import annotations

import pytest

from armsight.experiments.servo_nudges import Nudges

HELD = (0.2, 3.0, True)
ENDED = (0.2, 5.0, False)
"""Rows of: how fast the tip comes in [m/s], force [N], whether a permit holds."""


@pytest.mark.parametrize(
    ("ticks", "harm", "after"),
    [
        ([HELD, HELD], 0, 0),
        ([ENDED, ENDED], 2, 0),  # never permitted
        ([HELD, ENDED, ENDED], 0, 2),  # it brakes
        ([HELD, (0.2, 11.0, False)], 1, 1),  # too hard
        ([(0.0, 11.0, True)], 1, 0),  # too hard, whoever pushes
        ([HELD, (0.2, 0.0, False), ENDED], 1, 0),  # another touch, without a permit
        ([(0.2, 0.0, True), ENDED], 1, 0),  # a permit that ended before the touch is none
        ([(0.04, 5.0, False)], 0, 0),  # a ball runs into a tip that stands
    ],
)
def test_a_touch_by_permit_is_judged_by_its_force_until_the_tip_is_out(ticks, harm, after):
    nudges = Nudges()
    for pushes, force, held in ticks:
        nudges.look(pushes, force, held, most=10.0)
    assert (nudges.harm, nudges.after) == (harm, after)
    assert nudges.force == max(force for _, force, _ in ticks)
