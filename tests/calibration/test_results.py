"""Depth models, spheres, drift, files: each against truth or another reader."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from armsight.calibration import report
from armsight.calibration.boards import Checkerboard, Detection
from armsight.calibration.calibrate import CalibrationOptions, calibrate
from armsight.calibration.depth import DepthSamples, fit_depth
from armsight.calibration.drift import DriftWatch, known_from
from armsight.calibration.export import (
    camera_info_yaml,
    opencv_yaml,
    write_results,
)
from armsight.calibration.findings import Finding
from armsight.calibration.layouts.lens_files import LensFile
from armsight.calibration.live.seen import SeenView
from armsight.calibration.pictures import Seen
from armsight.calibration.recorded_set import RecordedCamera, RecordedSet
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic import (
    ErrorLevels,
    make_cell,
    observe,
    random_views,
    target_error,
)
from armsight.calibration.views_file import append, begin, read
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp

LENS = PinholeCamera(512, 424, 366.1, 367.2, 255.5, 204.0, (0.1, -0.28, 1e-3, -2e-3, 0.09))


@pytest.fixture(scope="module")
def solved(arm5):
    rng = np.random.default_rng(6)
    cell = make_cell(arm5, rng)
    problem = observe(cell, random_views(cell, 24, rng), rng)
    return cell, calibrate(problem, rng, CalibrationOptions())


def test_a_whole_calibration_is_within_its_stated_error(solved):
    cell, answer = solved
    for lens in range(6):
        assert target_error(cell, answer.solution.state, lens) < 3 * answer.target_sigma(lens)
    assert answer.left_out is not None
    assert answer.left_out.mm < 2.0
    assert "A point 1.0-1.5 m from a camera" in report.verdict(answer)
    assert any(line.startswith("camera left in base") for line in report.lines(answer))


def test_report_page_holds_its_pictures(solved):
    page = report.page(solved[1], (), (), "Test <cell>")
    assert page.count("data:image/png;base64,") == 3
    assert "Test &lt;cell&gt;" in page


def true_depth_error(z, pixel):
    r2 = ((pixel - [255.5, 211.5]) ** 2).sum(1) / (255.5**2 + 211.5**2)
    return 0.021 + 0.004 * (z - 1.2) + 0.003 * np.sin(2 * np.pi * z / 0.9 + 1) + 0.004 * r2


def test_depth_model_predicts_unseen_distances(rng):
    samples = []
    for _ in range(40):
        z0 = rng.uniform(0.7, 1.6)
        pixel = rng.uniform([40, 40], [470, 380]) + rng.uniform(-30, 30, (7, 2))
        z = z0 + rng.normal(0, 0.02, 7)
        noise = rng.normal(0, 0.0006, 7) + rng.normal(0, 0.0005)
        samples.append(
            DepthSamples(pixel, z + true_depth_error(z, pixel) + noise, z, np.full(7, 1e-3))
        )
    model = fit_depth(samples, LENS)
    assert model is not None
    pixel = rng.uniform([30, 30], [480, 390], (300, 2))
    z = rng.uniform(0.8, 1.5, 300)
    left = true_depth_error(z, pixel) - model.error(z, pixel, LENS)
    assert np.median(np.abs(left)) < 0.0012
    assert model.scale_known
    image = np.full((424, 512), np.nan, np.float32)
    image[200, 250] = 1.2 + true_depth_error(np.array([1.2]), np.array([[250.0, 200.0]]))[0]
    fixed = model.corrected(image, LENS)
    assert abs(fixed[200, 250] - 1.2) < 0.002
    assert np.isnan(fixed).sum() == fixed.size - 1


def test_depth_of_one_distance_refuses_a_scale(rng):
    z = np.full(7, 1.0)
    pixel = rng.uniform(100, 300, (7, 2))
    samples = [DepthSamples(pixel, z + 0.02, z, np.full(7, 1e-3)) for _ in range(5)]
    model = fit_depth(samples, LENS)
    assert model is not None
    assert not model.scale_known
    assert model.scale == pytest.approx(0.0, abs=1e-6)
    assert fit_depth([], LENS) is None


def watch(cell, answer, moved, seed, count=12):
    """Feed later sightings with a moved cell; the alarm and after how many."""
    rng = np.random.default_rng(seed)
    joints = random_views(cell, count, rng)
    later = observe(moved, joints, rng)
    guard = DriftWatch(known_from(answer))
    for v in range(count):
        seen = [s for s in later.sightings if s.view == v]
        alarm = guard.add(later.views[v], seen)
        if alarm is not None:
            return alarm, v + 1
    return None, count


def test_drift_watch_names_the_camera_and_keeps_still_otherwise(solved):
    cell, answer = solved
    quiet = replace(cell, levels=replace(cell.levels, wrong_boards=0.0))
    assert watch(quiet, answer, quiet, 1)[0] is None
    poses = cell.state.T_mount_rig.copy()
    poses[1] = poses[1] @ exp([0.005, 0, 0, 0, 0.009, 0])
    moved = replace(quiet, state=replace(cell.state, T_mount_rig=poses))
    alarm, _ = watch(quiet, answer, moved, 2)
    assert alarm is not None
    assert alarm.cameras == ("right",)
    assert "calibrate again" in alarm.message


def test_a_slipped_board_is_no_moved_camera(solved):
    cell, answer = solved
    quiet = replace(cell, levels=replace(cell.levels, wrong_boards=0.0))
    boards = cell.state.T_mount_board @ exp([0.006, 0.003, 0, 0, 0, 0.01])
    slipped = replace(quiet, state=replace(cell.state, T_mount_board=boards))
    alarm, _ = watch(quiet, answer, slipped, 3)
    assert alarm is not None
    assert alarm.cause == "board, base or robot"
    assert "tighten" in alarm.message


def test_one_board_seen_wrongly_blames_nobody(solved):
    cell, answer = solved
    quiet = replace(cell, levels=replace(cell.levels, wrong_boards=0.0))
    rng = np.random.default_rng(7)
    later = observe(quiet, random_views(quiet, 9, rng), rng)
    guard = DriftWatch(known_from(answer))
    for v in range(9):
        seen = [s for s in later.sightings if s.view == v]
        if v in (3, 7):  # slipped by one column, in every lens of one camera
            seen = [
                replace(s, pixel=s.pixel + s.pixel[1] - s.pixel[0]) if s.lens < 2 else s
                for s in seen
            ]
        assert guard.add(later.views[v], seen) is None


def test_files_are_read_by_others(tmp_path):
    ros = yaml.safe_load(camera_info_yaml("left", LENS))
    assert ros["distortion_model"] == "plumb_bob"
    assert ros["camera_matrix"]["data"][0] == pytest.approx(366.1)
    assert ros["projection_matrix"]["cols"] == 4
    file = tmp_path / "lens.yaml"
    file.write_text(opencv_yaml(LENS))
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(storage.getNode("cameraMatrix").mat(), LENS.K)
    np.testing.assert_allclose(
        storage.getNode("distortionCoefficients").mat().ravel(), LENS.distortion
    )


def test_results_do_not_replace_better_ones(solved, tmp_path):
    answer = solved[1]
    files = write_results(tmp_path, answer)
    assert {f.name for f in files} >= {"tf.yaml", "calibration.json", "left_color.opencv.yaml"}
    summary = json.loads((tmp_path / "calibration.json").read_text())
    assert len(summary["cameras"]) == 3
    summary["target_sigma_m"] = 1e-5
    (tmp_path / "calibration.json").write_text(json.dumps(summary))
    with pytest.raises(CalibrationError, match="better"):
        write_results(tmp_path, answer)
    write_results(tmp_path, answer, force=True)


def test_views_survive_a_stop(tmp_path):
    file = tmp_path / "views.jsonl"
    view = SeenView(
        np.arange(6.0),
        "tilt",
        1.5,
        ((1, np.array([0, 2]), np.array([[1.0, 2.0], [3.0, 4.0]])),),
        ((0, "no board found"),),
        ((0, np.array([[5.0, 6.0]]), np.array([1.2])),),
    )
    append(file, view)
    append(file, view)
    with file.open("a") as stream:
        stream.write('{"joints": [1, 2')  # cut short by a stop
    found = read(file)
    assert len(found) == 2
    np.testing.assert_array_equal(found[1].found[0][2], view.found[0][2])
    begin(file, {"cell": "here"})  # as a run does that goes on
    append(file, view)
    assert len(read(file)) == 3
    file.write_text("nonsense\n" + file.read_text())
    with pytest.raises(CalibrationError, match="line 1"):
        read(file)


def test_a_lens_that_is_to_be_kept_is_kept_or_missed_by_name(arm5):
    rng = np.random.default_rng(3)
    cell = make_cell(arm5, rng, ErrorLevels.ideal(0.1))
    seen = observe(cell, random_views(cell, 9, rng, cameras=(0,)), rng).only_lenses([1])
    board = Checkerboard()
    views = sorted(seen.used_views)
    given = seen.lenses[1].camera
    names = tuple(f"{v}.png" for v in views)
    size = (given.width, given.height)
    detections = tuple(Detection(s.corner, s.pixel, 0.1) for s in seen.sightings)
    looked = Seen(names, detections, ("",) * len(views), size, np.ones(len(views)), names)
    lens = LensFile(given, True, True, Path("lens.yaml"))
    camera = RecordedCamera("camera", "base", looked, np.arange(len(views)), lens)
    poses = np.array([seen.views[v].T_base_flange for v in views])
    recorded = RecordedSet(Path("monday"), board, (camera,), poses, None, names)
    answer = solve_set(recorded, keep_lens=True).calibration
    assert answer is not None
    assert answer.lens(0) == given
    with pytest.raises(CalibrationError, match="no lens there to be kept; give --lens"):
        solve_set(replace(recorded, cameras=(replace(camera, lens=None),)), keep_lens=True)


def test_no_sighting_at_all_is_named(arm5):
    rng = np.random.default_rng(0)
    cell = make_cell(arm5, rng, ErrorLevels.ideal())
    with pytest.raises(CalibrationError, match="no board was seen"):
        calibrate(cell.sheet, rng)


def test_what_is_to_be_done_is_said_as_it_is_written(solved):
    """Names lost their capitals: "write t_base_flange"."""
    wrong = Finding("pose_inverted", "error", "poses are inverted", "write T_base_flange")
    words = report.verdict(solved, (wrong,))
    assert words == "Do not use this calibration: poses are inverted. Write T_base_flange."
