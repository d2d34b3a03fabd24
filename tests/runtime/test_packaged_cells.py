"""The packaged cells at work: their cameras see enough of the arm's surroundings for it to move."""

import numpy as np
import pytest

from armsight.runtime.session import Session
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged

IN_FRONT = {"ur5_calibration"}
"""Cells whose cameras stand in front of the arm and do not see behind it: T1's, for calibration."""
AT_WORK = [
    name for name in packaged() if load_workcell(packaged()[name]).goals and name not in IN_FRONT
]


@pytest.mark.parametrize("name", AT_WORK)
def test_the_arm_gets_going(gl, name):
    """Four cells of an early version never moved: the arm fled from space that nobody could see."""
    workcell = load_workcell(packaged()[name])
    with open_cell(workcell, 0) as cell:
        session = Session(cell, PatrolTask(workcell.goals, workcell.patrol.dwell_s), seed=0)
        start = cell.robot.home
        session.run(3.0)
        turned = np.abs(session.view().joints.position - start).max()
        assert turned > 0.1, session.status().reason
