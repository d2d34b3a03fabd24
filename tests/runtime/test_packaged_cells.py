"""The packaged cells at work: their cameras see enough of the arm's surroundings for it to move."""

import numpy as np
import pytest

from armsight.geometry.pose import inverse, make_pose
from armsight.runtime.session import Session
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.board import board_of
from armsight.workcell.calibration_file.writing import board_entry, camera_entry, updated
from armsight.workcell.packaged import packaged

COLD = "ur5_calibration"
"""Its cameras stand centimetres from where its file says: it is calibrated before it works."""
AT_WORK = [name for name in packaged() if load_workcell(packaged()[name]).goals and name != COLD]


def turned(workcell, seconds, enough=np.inf):
    """How far a patrol turns any joint in a time [rad], and the guard's last reason.

    It ends as soon as that is enough.
    """
    with open_cell(workcell, 0) as cell:
        session = Session(cell, PatrolTask(workcell.goals, workcell.patrol.dwell_s), seed=0)
        start = cell.robot.home
        far = 0.0
        while session.now() < seconds and far <= enough:
            session.run(0.25)
            far = np.abs(session.view().joints.position - start).max()
        return far, session.status().reason


@pytest.mark.parametrize("name", AT_WORK)
def test_the_arm_gets_going(gl, name):
    """Four cells of an early version never moved: the arm fled from space that nobody could see."""
    far, reason = turned(load_workcell(packaged()[name]), 3.0, 0.1)
    assert far > 0.1, reason


def test_the_cold_cell_works_once_it_is_calibrated(gl, tmp_path):
    """Held with a reason that says what to do; then, with a calibration that is right, at work.

    The calibration is the truth here: that `calibrate` finds it is tested elsewhere, slowly.
    """
    text = packaged()[COLD].read_text().replace("arm_kinematic_error = 1.0", "")
    text = text.replace("\ndepth_error = 1.0", "\ndepth_error = 0.15")
    (tmp_path / "cell.toml").write_text(text)
    workcell = load_workcell(tmp_path / "cell.toml")
    far, reason = turned(workcell, 1.0)
    assert far < 0.01
    assert "where it is declared; calibrate it" in reason
    with open_cell(workcell, 0) as cell:
        C, entries = np.diag([1e-6] * 3 + [1e-7] * 3), []
        for camera, section in zip(cell.world.cameras, workcell.camera):
            unit = camera.unit
            T = inverse(cell.T_world_base) @ unit.T_mount_camera
            found = (T, C, unit.depth, unit.color, unit.T_depth_color, None)
            entries.append(camera_entry(workcell, section, *found, source="truth"))
        points = board_of(workcell).points
        middle = make_pose(None, 0.5 * (points.max(0) + points.min(0)))
        board = board_entry(workcell.board, cell.world.board.T_mount_board @ middle, source="truth")
    workcell.calibration_file.write_text(updated("", workcell, entries, board=board))
    far, reason = turned(load_workcell(tmp_path / "cell.toml"), 3.0, 0.5)
    assert far > 0.5, reason
