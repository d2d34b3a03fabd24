"""A permit that stays refused is given up after a stated time, with the reason, and asked for anew
when the target is elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.motion.intents import Rest, VelocityIntent
from armsight.motion.permits import Permit, PermitState
from armsight.servoing.patience import ELSEWHERE, STATED, Patience
from armsight.tasks.servo import ServoOptions
from armsight.workcell import open_cell
from armsight.workcell.packaged import load

from .test_laws import look as look_at_place
from .test_servo_task import observe, task_of

REFUSED = Permit("ball", "thing", PermitState.REFUSED, "somebody is beside it")
WITHDRAWN = Permit("ball", "thing", PermitState.WITHDRAWN, "it jumped by 0.30 m")
GRANTED = Permit("ball", "thing", PermitState.GRANTED)
PLACE = np.array([0.8, 0.1, 0.7])


def test_the_arm_rests_with_the_reason_and_asks_no_more_until_the_target_is_elsewhere():
    task, place, said, asked = task_of(), PLACE, {}, {}
    for k in range(round((STATED + 12.0) / 0.04)):
        now = 1.0 + 0.04 * k
        if now > STATED + 6.0:
            place = PLACE + np.array([0.0, 1.5 * ELSEWHERE, 0.0])
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
        observed = observe(now, command=np.zeros(6))
        observed.guard.permit = REFUSED if k and asked[k - 1] else None
        intent = task.update(observed)
        asked[k] = getattr(intent, "permit", None) is not None
        said[now] = task.face()
        if now < STATED + 0.9:
            assert isinstance(intent, VelocityIntent)
        elif STATED + 1.2 < now < STATED + 6.0:
            assert isinstance(intent, Rest)
            assert intent.reason == task.face().reason
            assert intent.reason.startswith("gave up after 30 s: contact with ball (thing) refused")
            assert task.face().state == "gave up"
    assert isinstance(intent, VelocityIntent)
    assert intent.permit is not None
    assert task.face().state != "gave up"


def waited(answers, seconds=1.0):
    """What is given up after 3 s of answers that are repeated, a round every 8 ms."""
    patience = Patience(seconds)
    for k in range(375):
        why = patience.update(0.008 * k, answers[k % len(answers)], PLACE)
    return why


def test_the_round_without_a_request_after_a_withdrawal_is_no_new_beginning():
    assert "jumped" in waited([WITHDRAWN, None])


@pytest.mark.parametrize(
    "answers",
    [[GRANTED], [None], [REFUSED] * 100 + [GRANTED], [REFUSED] * 60 + [None] * 100],
    ids=["granted", "not asked", "granted at times", "not asked for a while"],
)
def test_what_is_granted_or_not_asked_is_not_given_up(answers):
    assert waited(answers) == ""


def test_who_waits_for_ever_gives_up_nothing():
    assert waited([REFUSED], math.inf) == ""


def test_a_target_that_is_lost_and_found_is_asked_for_anew():
    patience = Patience(0.5)
    for k in range(100):
        why = patience.update(0.008 * k, REFUSED, PLACE)
    assert why
    assert patience.update(0.81, None, None) == ""
    assert patience.update(0.82, REFUSED, PLACE) == ""


def test_no_time_at_all_is_refused():
    with open_cell(load("ur10_servoing"), seed=0) as cell:
        for wrong in (0.0, -1.0, math.nan):
            with pytest.raises(UsageError, match="a patience of"):
                ServoOptions(patience=wrong).make(cell)
        assert ServoOptions(patience=5.0).make(cell).patience.seconds == 5.0
