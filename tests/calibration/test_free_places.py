"""Where a calibration wants to stand, the planner lets the arm go."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.devices.history import JointHistory
from armsight.mapping.workspace_map import WorkspaceMap
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.runtime.configure import mapping_config
from armsight.tasks.calibration_cell import free_checks, unseen_is_empty
from armsight.workcell import open_cell
from armsight.workcell.packaged import load


@pytest.mark.parametrize("name", ["ur10_servoing"])
def test_what_is_free_is_no_goal_that_is_refused(name):
    """The planner keeps a millimetre more than motions must; one goal in forty lay in it."""
    workcell = load(name)
    with open_cell(workcell, 0) as cell:
        robot = cell.robot
        mapping = unseen_is_empty(mapping_config(workcell, cell.T_world_base, robot.reach))
        free, _ = free_checks(cell, mapping)
        static = WorkspaceMap(robot, (), cell.static, mapping)
        snapshot = static.update((), JointHistory(), 0.0)
        static.close()
    planner = RrtConnectPlanner(robot, config=PlannerConfig(improvement=0.0))
    rng = np.random.default_rng(0)
    home = np.asarray(robot.home, float)
    drawn = np.clip(
        home + rng.uniform(-1.5, 1.5, (4000, robot.n)), robot.limits.lower, robot.limits.upper
    )
    goals = [q for q in drawn if free(q)]
    assert len(goals) > 500
    for goal in goals:
        request = PlanRequest(1, home, JointIntent("view", goal))
        reason = planner.plan(request, snapshot, 1e-4, rng).failure
        assert not reason.startswith("goal"), reason
