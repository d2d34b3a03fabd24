"""The patrol by itself: which goal it wants next, and what it shows."""

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.tasks.patrol import PatrolTask

GOALS = {"A": np.zeros(6), "B": np.full(6, 0.5)}


def round_of(task, now, goal="", reached=False):
    guard = SimpleNamespace(goal=goal, reached=reached)
    return task.update(SimpleNamespace(now=now, guard=guard))


def test_goals_come_in_turn_after_a_rest_and_the_face_counts_them():
    task = PatrolTask(GOALS, dwell=0.5)
    assert round_of(task, 0.0).name == "A"
    assert round_of(task, 1.0, "B", True).name == "A"  # of an earlier run: not this goal
    shown = task.face()
    assert (shown.state, shown.reason) == ("on its way to A", "round 1 of A → B")
    assert shown.figures[0].value == 0.0
    assert round_of(task, 10.0, "A", True).name == "A"
    assert task.face().state == "rests at A"
    assert round_of(task, 10.5, "A", True).name == "B"
    round_of(task, 20.0, "B", True)
    assert round_of(task, 20.5, "B", True).name == "A"
    shown = task.face()
    assert shown.reason == "round 2 of A → B"
    assert [f.value for f in shown.figures] == [2.0, pytest.approx(6.0)]  # one more in 10 s
    task.reset()
    assert task.face().figures[0].value == 0.0


def test_one_goal_is_no_patrol():
    with pytest.raises(UsageError, match="at least two goals, found 1"):
        PatrolTask({"A": np.zeros(6)})
