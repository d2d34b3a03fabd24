"""A charging lid: its latch as physics has it, and the hand that works it by feel."""

import numpy as np
import pytest

from armsight.charging.lid import R_LID_FINGER, LidHand, LidOptions
from armsight.experiments.lid_bench import draw, run_trial
from armsight.geometry.pose import make_pose


@pytest.mark.parametrize("latch", ["push", "spring"])
def test_a_lid_is_opened_and_shut_again_in_contact_physics(latch):
    """Fifty simulated seconds each; about four of the processor's."""
    found = run_trial(draw(np.random.default_rng(7), latch))
    assert found["open_said"] == ""
    assert found["open_deg"] > 85
    assert found["shut_true"]
    assert found["shut_said"] == ""
    assert found["force_n"] < 80


@pytest.mark.parametrize("latch", ["push", "spring"])
def test_which_latch_it_is_is_found_by_pressing_before_pulling(latch):
    found = run_trial(draw(np.random.default_rng(9), latch, told=False))
    assert found["open_said"] == ""
    assert found["open_deg"] > 85
    assert found["shut_true"]
    assert found["force_n"] < 80


@pytest.mark.parametrize(
    ("latch", "fault", "words"),
    [
        ("push", "stuck", "stays shut: pressed with 45 N"),
        ("spring", "half", "stuck at"),
        ("push", "missing", "no lid"),
    ],
)
def test_what_is_wrong_with_a_lid_is_said(latch, fault, words):
    found = run_trial(draw(np.random.default_rng(8), latch, fault))
    assert not found["opened"]
    assert words in found["open_said"]
    assert found["force_n"] < 80


def test_a_lid_that_neither_way_opens_is_said_so():
    trial = draw(np.random.default_rng(8), "push", "stuck", told=False)
    found = run_trial(trial)
    assert not found["opened"]
    assert "stays shut, pressed with 45 N as well" in found["open_said"]
    assert "pulled with 50 N" in found["open_said"]


def test_a_hand_that_is_held_still_waits_and_goes_on():
    hand = LidHand(LidOptions("push"))
    T = make_pose(R_LID_FINGER, (0.0, 0.0, 0.2))
    assert np.abs(hand.step(0.0, T, np.zeros(6))[:3]).max() == 0.0  # from rest, no time has passed
    moving = [hand.step(0.008 * k, T, np.zeros(6)) for k in range(1, 40)][-1]
    assert moving[2] > 0.03  # towards the car
    for k in range(40, 5000):
        assert not hand.step(0.008 * k, T, np.zeros(6), held=True).any()
    assert not hand.ended
    for k in range(5000, 9000):
        hand.step(0.008 * k, T, np.zeros(6))  # an arm that does not move
    assert hand.ended
    assert "something stands before the lid" in hand.problem or "get there" in hand.problem
