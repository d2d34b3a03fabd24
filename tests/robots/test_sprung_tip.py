"""A tip on springs: its formula against springs that come to rest, and against its inverse."""

import numpy as np
import pytest

from armsight.robots.sprung_tip import SprungTip, press_depth, pressing_force
from armsight.workcell import load_workcell
from armsight.workcell.beliefs import tip_of
from armsight.workcell.packaged import packaged

HOLD = 2000.0
TIPS = [
    SprungTip(300.0, 0.025, 1.0),
    SprungTip(300.0, 0.025, 0.0),
    SprungTip(5000.0, 0.004, 6.0),
]


def at_rest(press: float, tip: SprungTip) -> float:
    """The force where a tip between a seat, a spring and a stop comes to rest [N], by searching."""
    out = np.linspace(0.0, tip.travel, 200_001)  # places of the tip
    pushes = HOLD * np.maximum(press - out, 0.0)  # what is pressed, on it
    holds = tip.seat + tip.stiffness * out  # spring and seat, at most
    if pushes[0] <= tip.seat:
        return float(pushes[0])  # the seat holds
    if pushes[-1] >= holds[-1]:
        return float(pushes[-1])  # on the stop
    return float(pushes[np.argmin(np.abs(pushes - holds))])


@pytest.mark.parametrize("tip", TIPS)
def test_force_is_that_at_which_seat_spring_and_stop_come_to_rest(tip: SprungTip) -> None:
    for press in np.linspace(0.0, 3.0 * tip.travel, 61):
        assert pressing_force(press, HOLD, tip) == pytest.approx(at_rest(press, tip), abs=2e-3)


@pytest.mark.parametrize("tip", [None, *TIPS])
def test_depth_is_the_inverse_of_force(tip: SprungTip | None) -> None:
    for press in np.linspace(0.0, 0.05, 41):
        force = pressing_force(press, HOLD, tip)
        assert press_depth(force, HOLD, tip) == pytest.approx(press, abs=1e-9)


def test_a_stiff_tip_presses_like_the_stand_alone() -> None:
    assert pressing_force(0.005, HOLD) == pytest.approx(10.0)
    assert pressing_force(-0.005, HOLD) == 0.0
    assert pressing_force(-0.005, HOLD, TIPS[0]) == 0.0


def test_the_tip_of_the_servoing_cell_keeps_the_permits_force_to_35_mm() -> None:
    tip = tip_of(load_workcell(packaged()["ur10_servoing"]))
    assert tip is not None
    assert pressing_force(0.034, HOLD, tip) < 10.0
    assert press_depth(10.0, HOLD, tip) == pytest.approx(0.035)
    assert tip.moved(100.0) == tip.travel  # not more than the stop allows
