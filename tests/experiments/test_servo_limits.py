"""What counts as beyond a limit, and a short run of each task before a target that jumps."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.experiments import servo_limits
from armsight.experiments.servo_limits import CELLS, beyond, one, restless
from armsight.experiments.servo_world import set_up

SETUP = set_up(1.0, 1.0)
LIMITS, GUARD = SETUP.robot.limits, SETUP.guard
TICKS = 50


def counted(commands, stops=None, joints=None):
    stops = np.zeros(TICKS, bool) if stops is None else stops
    joints = np.tile(SETUP.robot.home, (TICKS, 1)) if joints is None else joints
    return beyond(LIMITS, GUARD, commands, stops, joints)


def test_each_kind_is_counted_where_it_is_and_only_there():
    calm = np.zeros((TICKS, 6))
    assert counted(calm)["violations"] == 0
    ramp = np.minimum(np.arange(TICKS)[:, None] * LIMITS.acceleration * GUARD.period, 0.5)
    assert counted(ramp)["violations"] == 0
    fast = calm + 1.001 * LIMITS.velocity
    assert counted(fast)["speed"] == TICKS
    jerked = calm.copy()
    jerked[20:, 2] = 3.0 * LIMITS.acceleration[2] * GUARD.period
    assert counted(jerked)["acceleration"] == 1
    stops = np.zeros(TICKS, bool)
    stops[20] = True
    assert counted(jerked, stops)["acceleration"] == 0
    joints = np.tile(SETUP.robot.home, (TICKS, 1))
    joints[7, 4] = LIMITS.upper[4] + 0.001
    assert counted(calm, joints=joints)["position"] == 1


def test_targets_jump_and_teleport_to_the_same_places_for_a_seed():
    (path, jumps), (again, _) = (restless(SETUP, np.random.default_rng(3)) for _ in range(2))
    times = np.arange(0.0, servo_limits.SECONDS, 0.008)
    places = np.array([path(t) for t in times])
    assert (places == np.array([again(t) for t in times])).all()
    leaps = np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.02
    assert 4 <= leaps.sum() <= jumps
    assert np.ptp(places, axis=0).max() > 0.5


@pytest.mark.parametrize("name", list(CELLS))
def test_no_task_leaves_a_limit(name, monkeypatch):
    monkeypatch.setattr(servo_limits, "SECONDS", 3.0)
    found = one(set_up(1.0, 1.0, CELLS[name]), name, (3, 1))
    assert found["ticks"] == pytest.approx(375, abs=1)
    assert found["violations"] == 0
