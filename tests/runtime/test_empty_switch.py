"""Only a switch that is turned on says that the cell is empty; one that is on says nothing."""

import pytest

from armsight.devices.data import SwitchState
from armsight.runtime.empty_switch import EmptySwitch


def words(states, period=0.05):
    """Times at which something is said, of (until, on) spans read every ``period`` seconds."""
    said, now = [], 0.0
    switch = EmptySwitch(lambda: said.append(round(now, 3)))
    for until, on in states:
        while now < until:
            if on is not None:
                switch.on_reading(SwitchState(now, on), now)
            now += period
    return said


def test_it_is_said_once_when_it_has_been_on_for_a_moment():
    assert words([(1.0, False), (9.0, True)]) == [pytest.approx(1.2, abs=0.06)]


def test_each_turn_says_it_again():
    assert len(words([(1.0, False), (2.0, True), (3.0, False), (4.0, True)])) == 2


@pytest.mark.parametrize(
    ("why", "states"),
    [
        ("it was on when the program began", [(9.0, True)]),
        (
            "it was off for a moment only, as a loose wire is",
            [(1.0, True), (1.15, False), (9.0, True)],
        ),
        ("it was on for a moment only", [(1.0, False), (1.15, True), (9.0, False)]),
        ("nothing was heard while it was turned", [(1.0, False), (1.8, None), (9.0, True)]),
        ("it is off", [(9.0, False)]),
    ],
)
def test_it_says_nothing(why, states):
    assert words(states) == [], why


def test_a_clock_that_jumps_back_begins_anew():
    said = []
    switch = EmptySwitch(lambda: said.append(1))
    for stamp, on in ((5.0, False), (5.4, False), (1.0, True), (1.3, True), (1.6, True)):
        switch.on_reading(SwitchState(stamp, on), stamp)
    assert said == []


def test_other_readings_pass():
    EmptySwitch(lambda: pytest.fail("said")).on_reading(object(), 0.0)
