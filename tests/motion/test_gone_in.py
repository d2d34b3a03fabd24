"""Who runs into the region of a permit for a hand, and out of it again."""

import numpy as np
import pytest

from armsight.experiments import approach_permit
from armsight.experiments.quick_cell import Ball, QuickCell

PLACE = np.array([0.44, -0.46, 0.37])
SIZE = 0.3
AWAY = np.array([3.0, 3.0, 3.0])
WAITS = "stands until who ran in"


@pytest.mark.parametrize("run", [43, 787])
def test_a_hand_that_runs_through_the_region_finds_an_arm_that_stands(run: int) -> None:
    # Both hands came out beside the upper arm, which had set out again at 0.07 m/s.
    assert approach_permit.episode(0, run)["contacts"] == 0


def _seen(hand: Ball, kind: str = "hand", seconds: float = 4.0) -> QuickCell:
    cell = QuickCell([Ball(lambda t: PLACE, approach_permit.RADIUS), hand],
                     robot=approach_permit.pointing_arm(), seed=3)  # fmt: skip
    while cell.now < seconds:
        cell.tick(goal=approach_permit._wish(cell, PLACE, kind, SIZE))
    return cell


def _waited(cell: QuickCell) -> float:
    stamps = [s.stamp for s in cell.log if s.reason.startswith(WAITS)]
    return stamps[-1] - stamps[0] if stamps else 0.0


def _runs(t: float) -> np.ndarray:
    """At 2.0 m/s from in front of the arm to the middle of the region, and stays there."""
    way = np.array([0.5, -0.8, 0.3]) / np.linalg.norm([0.5, -0.8, 0.3])
    return PLACE + max(1.4 - 2.0 * max(t - 1.5, 0.0), 0.0) * way


def test_the_arm_stands_for_as_long_as_running_through_takes_and_no_longer() -> None:
    cell = _seen(Ball(_runs))
    assert 2 * SIZE / 2.0 <= _waited(cell) <= 2 * SIZE / 2.0 + 0.4
    after = [s for s in cell.log if s.stamp > 3.6]
    assert not any(s.reason.startswith(WAITS) for s in after)


def test_what_vanishes_elsewhere_makes_nobody_wait() -> None:
    place = PLACE + np.array([0.25, -0.55, 0.1])
    cell = _seen(Ball(lambda t: place if 1.0 < t < 2.0 else AWAY))
    assert min(s.distance for s in cell.log) < 1.0
    assert _waited(cell) == 0.0


def test_in_the_region_of_a_thing_somebody_still_counts() -> None:
    assert _waited(_seen(Ball(_runs), "thing")) == 0.0
