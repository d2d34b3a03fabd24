"""The live procedure on an arm that jumps and cameras without pictures: goals, stops, bad input."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import FakeCell, upside_down

from armsight.calibration import report, views_file
from armsight.calibration.calibrate import Calibration
from armsight.calibration.live.drive import drive
from armsight.calibration.live.log import ProcedureOptions
from armsight.calibration.live.procedure import procedure
from armsight.calibration.live.watcher import Silent
from armsight.calibration.synthetic import ErrorLevels, t1_cameras, target_error
from armsight.errors import CalibrationError
from armsight.motion.face import face_fault
from armsight.tasks.calibration_entries import arm_of, camera_entries
from armsight.tasks.calibration_face import CalibrationFace
from armsight.workcell import load_workcell
from armsight.workcell.calibration_file.reading import parse_calibration
from armsight.workcell.calibration_file.writing import updated
from armsight.workcell.packaged import packaged

LEVELS = replace(ErrorLevels(), wrong_boards=0.0, kinematics=0.5)
SHORT = ProcedureOptions(goal=0.004, least_views=12, most_views=18, candidates=24)


def calibrated(cell, options=SHORT, done=(), watcher=None):
    steps = procedure(cell.setup, options, np.random.default_rng(1), watcher, cell.now, done)
    return drive(steps, cell, cell)


class Log:
    """Keeps what it is told; stops after so many views."""

    def __init__(self, most=10**6):
        self.views, self.stages, self.most = [], [], most

    def view(self, view):
        self.views.append(view)
        if len(self.views) >= self.most:
            raise KeyboardInterrupt

    def stage(self, progress):
        self.stages.append(progress)


@pytest.fixture(scope="module")
def whole(arm5):
    cell, log = FakeCell(arm5, 3, LEVELS), Log()
    return cell, calibrated(cell, watcher=log), log


def test_from_cold_to_an_answer_within_its_stated_error(whole):
    cell, result, _ = whole
    answer = result.calibration
    for lens in range(6):
        assert target_error(cell.truth, answer.solution.state, lens) < 3 * answer.target_sigma(lens)
    assert result.findings == ()
    assert 12 <= len(result.views) <= 18
    assert "mm" in result.stopped or "enough" in result.stopped


def test_the_watcher_sees_doubt_shrink(whole):
    _, result, log = whole
    assert [v.joints.tolist() for v in log.views] == [v.joints.tolist() for v in result.views]
    worst = [max(p.expected) for p in log.stages if np.isfinite(p.expected).all()]
    assert worst[-1] < 0.7 * worst[0]
    assert isinstance(log.stages[-1].answer, Calibration)
    assert {v.stage for v in log.views} == {"find", "tilt", "learn"}


def test_the_answer_becomes_entries_of_the_cells_file(whole):
    """What is found goes through the file and comes back as the cell's belief."""
    _, result, _ = whole
    workcell = load_workcell(packaged()["ur5_calibration"])
    answer = result.calibration
    entries = camera_entries(workcell, answer, result.depth, "a test")
    text = updated("", workcell, entries, arm_of(answer, "a test"))
    kept = parse_calibration(text)
    assert [c.name for c in kept.camera] == ["left", "right", "front"]
    for rig, camera in enumerate(kept.camera):
        np.testing.assert_allclose(camera.pose, answer.camera_pose(rig), atol=1e-9)
        np.testing.assert_allclose(camera.C, answer.covariance.camera_pose(rig), rtol=1e-6)
        infrared = answer.lens(2 * rig)
        assert camera.depth_lens.fx / camera.depth_lens.width == pytest.approx(
            infrared.fx / infrared.width
        )
    assert kept.arm is not None
    smaller = workcell.model_copy(update={"camera": workcell.camera[1:]})
    with pytest.raises(CalibrationError, match='has no camera "left"'):
        camera_entries(smaller, answer, (), "a test")


def test_the_face_follows(whole):
    """Views, coverage, doubt and cameras are on the page."""
    cell, result, log = whole
    shown = CalibrationFace(cell.setup, Silent())
    empty = [p.image.copy() for p in shown.face().pictures]
    assert face_fault(shown.face()) == ""
    doubt = []
    for view in result.views:
        shown.view(view)
    for progress in log.stages:
        shown.stage(progress)
        doubt.append(shown.face().curves[0].value)
    face = shown.face()
    assert face_fault(face) == ""
    for before, picture in zip(empty, face.pictures):
        assert np.count_nonzero(before != picture.image) > 1000
    known = [d for d in doubt if np.isfinite(d)]
    assert known[-1] < known[0]
    assert face.state == "learning"
    names = [mark.name for mark in face.marks]
    assert {"camera left", "camera right", "camera front", "doubt about front"} <= set(names)


@pytest.mark.parametrize("after", [3, 9, 14])
def test_a_stopped_run_goes_on(arm5, tmp_path, after):
    """In the middle of finding, of tilting, of learning; through the file, as the command does."""
    file = tmp_path / "views.jsonl"
    cell, log = FakeCell(arm5, 3, LEVELS), Log(after)
    with pytest.raises(KeyboardInterrupt):
        calibrated(cell, watcher=log)
    for view in log.views:
        views_file.append(file, view)
    again = FakeCell(arm5, 3, LEVELS)
    result = calibrated(again, done=views_file.read(file))
    first = [v.joints.tolist() for v in result.views[:after]]
    assert first == [v.joints.tolist() for v in log.views]
    assert result.calibration.target_sigma(0) < 0.01


def test_no_board_in_any_camera(arm5):
    cell = FakeCell(arm5, 0, LEVELS, blind={"left": "over-exposed", "right": "black", "front": ""})
    with pytest.raises(CalibrationError, match=r"no camera saw the board.*black.*over-exposed"):
        calibrated(cell)


def test_board_in_one_camera_only(arm5):
    cell = FakeCell(arm5, 3, LEVELS, blind={"right": "over-exposed", "front": "blurred"})
    result = calibrated(cell)
    messages = [f.message for f in result.findings if f.code == "camera_unseen"]
    assert len(messages) == 2
    assert "camera right never saw the board (mostly: over-exposed)" in messages[0]
    assert "camera front never saw the board (mostly: blurred)" in messages[1]
    answer = result.calibration
    assert target_error(cell.truth, answer.solution.state, 0) < 3 * answer.target_sigma(0)
    assert "warning: camera right" in "\n".join(report.lines(answer, (), result.findings))


def test_a_camera_upside_down_is_calibrated_and_named(arm5):
    cell = FakeCell(arm5, 3, LEVELS, upside_down(t1_cameras(), "front"))
    result = calibrated(cell)
    assert [(f.code, f.severity) for f in result.findings] == [("upside_down", "note")]
    assert "front" in result.findings[0].message
    answer = result.calibration
    assert target_error(cell.truth, answer.solution.state, 4) < 3 * answer.target_sigma(4)


def test_an_arm_that_may_stand_nowhere(arm5):
    cell = FakeCell(arm5, 0, LEVELS, free=lambda q: False)
    with pytest.raises(CalibrationError, match="cannot hold the board in front of itself"):
        calibrated(cell)


def test_views_that_cannot_be_reached_end_the_run(arm5):
    """The arm refuses everything from a moment on: what was seen is solved, the end is named."""
    cell = FakeCell(arm5, 3, LEVELS)
    log = Log()
    cell._refuses = lambda q: any(v.stage == "tilt" for v in log.views) and len(log.views) > 11
    result = calibrated(cell, watcher=log)
    assert result.stopped == "no further view can be reached"
    assert len(result.views) == 12


def test_places_that_are_not_free_are_never_asked_for(arm5):
    asked = []
    cell = FakeCell(arm5, 3, LEVELS, free=lambda q: bool(q[0] < 1.2), move=asked.append)
    calibrated(cell)
    assert len(asked) > 12
    assert all(q[0] < 1.2 for q in asked)


def test_views_of_another_cell_are_refused(tmp_path):
    file = tmp_path / "views.jsonl"
    views_file.begin(file, {"cell": "a", "board": "checkerboard:7x5:30"})
    assert views_file.read(file, {"cell": "a"}) == []
    with pytest.raises(CalibrationError, match="views are of cell a, not b; use --fresh"):
        views_file.read(file, {"cell": "b"})
