"""``armsight calibrate``: options that do nothing are refused, better calibrations stay."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.calibration.export import SUMMARY, file_names, write_results
from armsight.calibration.findings import Finding
from armsight.calibration.synthetic_set import ArmErrors, make_set
from armsight.commands.calibrate import Calibrate
from armsight.commands.calibrating import refuse_worse
from armsight.commands.serving import Page
from armsight.errors import CalibrationError, UsageError
from armsight.experiments.calibration_layouts import write_corners
from armsight.experiments.calibration_stranger_runs import plain
from armsight.geometry.pose import exp
from armsight.robots import load_robot
from armsight.workcell import camera_info_of
from armsight.workcell.calibration_file.schema import CalibratedCamera
from armsight.workcell.calibration_file.store import store
from armsight.workcell.calibration_file.writing import camera_entry
from armsight.workcell.packaged import find, load
from armsight.workcell.schema import Workcell

CELL = "ur5_four_cameras"
CAMERA = "front_left"
FOLDER = Path("set")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (Calibrate(), "give a workcell to calibrate live"),
        (Calibrate(CELL, markerless=True, out=Path("a")), "--out does nothing with --markerless"),
        (Calibrate(CELL, markerless=True, paper=True), "--paper does nothing with --markerless"),
        (Calibrate(CELL, sphere=True, out=Path("a")), "--out does nothing with --sphere"),
        (Calibrate(CELL, sphere=True, camera="a"), "--camera does nothing with --sphere"),
        (Calibrate(CELL, plug=True, board="tag:48:1"), "--board does nothing with --plug"),
        (Calibrate(CELL, plug=True, sphere=True), "--sphere does nothing with --plug"),
        (Calibrate(CELL, lens=Path("a")), "--lens does nothing with a live calibration"),
        (Calibrate(CELL, second_arm=Path("a")), "--second-arm does nothing with a live"),
        (Calibrate(CELL, from_=FOLDER, markerless=True), "--markerless does nothing with --from"),
        (Calibrate(from_=FOLDER, fresh=True), "--fresh does nothing with --from"),
        (Calibrate(from_=FOLDER, page=Page(port=0)), "--page does nothing with --from"),
        (Calibrate(from_=FOLDER, camera="a"), "name the workcell file, too"),
        (Calibrate(markerless=True), "give a workcell"),
        (Calibrate(CELL, views=0), "--views is 0; expected 3"),
        (Calibrate(CELL, goal_mm=float("nan")), "--goal-mm is nan"),
        (Calibrate(CELL, from_=FOLDER, camera="nobody"), 'has no camera "nobody"'),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(asked: Calibrate, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        asked.run()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("headless", [True, False])
def test_markerless_obeys_what_it_takes(headless: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = {}

    def run_session(_: object, __: object, wanted: object) -> SimpleNamespace:
        taken["wanted"] = wanted
        return SimpleNamespace(task_failure="", ended_by="interrupted")

    class Cell:
        simulated, cameras, robot = True, (), load_robot("ur5")

        def __enter__(self) -> Cell:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr("armsight.workcell.open_cell", lambda *_: Cell())
    monkeypatch.setattr("armsight.commands.running.run_session", run_session)
    asked = Calibrate(CELL, markerless=True, headless=headless, cell_is_empty=True)
    assert asked.run() == 130
    assert taken["wanted"].page == (None if headless else Page())  # type: ignore[attr-defined]
    assert taken["wanted"].cell_is_empty  # type: ignore[attr-defined]


def _cell(tmp_path: Path) -> Workcell:
    shutil.copy(find(CELL), tmp_path / "cell.toml")
    return load(str(tmp_path / "cell.toml"))


def _entry(workcell: Workcell, error: float, aside: float) -> CalibratedCamera:
    section = next(c for c in workcell.camera if c.name == CAMERA)
    info = camera_info_of(workcell, section)
    T = info.T_mount_camera @ exp(np.array([aside, 0, 0, 0, 0, 0]))
    return camera_entry(
        workcell, section, T, np.diag([1e-6] * 3 + [1e-6] * 3), info.depth, info.color,
        info.T_depth_color, None, source="test", target_error=error,
    )  # fmt: skip


def test_a_cells_better_calibration_stays_unless_the_camera_was_moved(tmp_path: Path) -> None:
    workcell = _cell(tmp_path)
    refuse_worse(workcell, [_entry(workcell, 0.004, 0.0)], force=False)  # nothing there yet
    store(workcell, [_entry(workcell, 0.001, 0.0)])
    refuse_worse(workcell, [_entry(workcell, 0.0012, 0.0)], force=False)
    refuse_worse(workcell, [_entry(workcell, 0.004, 0.05)], force=False)
    refuse_worse(workcell, [_entry(workcell, 0.004, 0.0)], force=True)
    with pytest.raises(CalibrationError, match=r"points to 1.0 mm, now 4.0 mm.*--force"):
        refuse_worse(workcell, [_entry(workcell, 0.004, 0.001)], force=False)


def test_files_of_cameras_have_names_of_their_own() -> None:
    assert file_names(["Left cam", "left-cam", "left_cam_2"]) == [
        "left_cam", "left_cam_2", "left_cam_2_2",
    ]  # fmt: skip
    assert file_names(["左", "右", "#"]) == ["左", "右", "camera"]


def _set(folder: Path, views: int = 12) -> None:
    one = make_set(load_robot("ur5"), np.random.default_rng(3), views, "flange", ArmErrors(5e-5, 0))
    write_corners(folder, plain(one))
    rows = [" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told]
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")


def test_what_is_wrong_never_replaces_what_was_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from armsight.calibration.recorded_set import load as load_set
    from armsight.calibration.recorded_solve import solve_set
    from armsight.experiments.calibration_mistakes import BOARD

    _set(tmp_path / "set")
    answer = solve_set(load_set(tmp_path / "set", BOARD)).calibration
    assert answer is not None
    out = tmp_path / "out"
    write_results(out, answer)
    before = (out / SUMMARY).read_text()
    wrong = (Finding("slip", "error", "the board has moved", "mount it"),)
    with pytest.raises(CalibrationError, match=r"is better .*now: the board has moved"):
        write_results(out, answer, (), wrong)
    monkeypatch.setattr("armsight.calibration.export.worst_target", lambda _: float("nan"))
    with pytest.raises(CalibrationError, match="is better"):
        write_results(out, answer)
    assert (out / SUMMARY).read_text() == before
    monkeypatch.undo()
    write_results(out, answer, (), wrong, force=True)
    write_results(out, answer)  # what was forced and wrong stands in nobody's way
    assert json.loads((out / SUMMARY).read_text())["findings"] == []


def test_a_lens_of_too_few_frames_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = make_set(load_robot("ur5"), np.random.default_rng(301), 8, "base", ArmErrors(5e-5, 0))
    first = [0, 0, 0]  # three pictures of one view, but for their noise
    noise = np.random.default_rng(0).normal(0, 0.1, (3, *one.pixels[0].shape))
    alike = replace(one, told=one.told[first], pixels=one.pixels[first] + noise)
    write_corners(tmp_path / "set", plain(alike))
    out, board = tmp_path / "out", "checkerboard:9x6:25:inner"
    assert Calibrate(from_=tmp_path / "set", board=board, out=out).run() == 1
    assert "tell the focal length to" in capsys.readouterr().out
    assert not out.exists()


def test_lenses_alone_do_not_replace_those_of_a_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _set(tmp_path / "set")
    (tmp_path / "set" / "poses.txt").unlink()
    out, board = tmp_path / "out", "checkerboard:9x6:25:inner"
    out.mkdir()
    (out / SUMMARY).write_text("{}")
    asked = Calibrate(from_=tmp_path / "set", board=board, out=out)
    with pytest.raises(CalibrationError, match="whose lenses would be overwritten"):
        asked.run()
    assert [f.name for f in out.iterdir()] == [SUMMARY]
    (out / SUMMARY).unlink()
    assert asked.run() == 0
    assert "(sigma " in capsys.readouterr().out
    assert (out / "camera.opencv.yaml").exists()
