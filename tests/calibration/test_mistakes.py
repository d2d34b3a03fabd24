"""Every mistake that people make with a recorded set is named, and nothing else is."""

import numpy as np
import pytest
from arms import ur5

from armsight.calibration import se3
from armsight.calibration.layouts.two_recordings import two_findings
from armsight.calibration.recorded_set import load
from armsight.calibration.synthetic_set import ArmErrors, make_set
from armsight.experiments.calibration_layouts import PlainSet, picture_names, write_corners
from armsight.experiments.calibration_mistakes import (
    MISTAKES,
    Folder,
    clean_set,
    findings_of,
    judge,
    write_mistake,
)
from armsight.experiments.calibration_stranger_runs import clean_run


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_and_no_other(name, tmp_path):
    rng = np.random.default_rng([77, list(MISTAKES).index(name)])
    folder = write_mistake(tmp_path, name, clean_set(ur5(), rng), rng)
    named, wrong = judge(name, findings_of(tmp_path, folder))
    assert named
    assert wrong == set()


@pytest.mark.parametrize("seed", range(2))
def test_a_clean_set_is_not_blamed(seed, tmp_path):
    rng = np.random.default_rng([78, seed])
    folder = write_mistake(tmp_path, "", clean_set(ur5(), rng, 3e-3), rng)
    told = findings_of(tmp_path, folder)
    assert [code for code, severity in told if severity == "error" or code == "slip"] == []


@pytest.mark.parametrize("number", [9, 36])
def test_views_of_an_arm_that_errs_by_two_millimetres_stay(number):
    """Views went one by one, each making the rest look better, until half of the set was gone."""
    run = clean_run(11, number, ur5())
    assert run["size"] > 1.9e-3
    assert [code for code, severity in run["told"] if severity == "error"] == []
    assert "outlier" not in [code for code, _ in run["told"]]


def test_two_parts_have_their_names():
    names = [f"{k}.png" for k in range(6)]
    late = two_findings(np.array([True, True, True, False, False, False]), names)
    assert (late[0].code, "2.png and 3.png" in late[0].message) == ("slip", True)
    mixed = two_findings(np.array([True, False, True, False, True, True]), names)
    assert mixed[0].code == "two_cameras"


def _with_poses(place, one, T, stated):
    folder = Folder(T, one.pixels, picture_names(one.views), stated=stated)
    every = np.arange(len(one.points))
    size = (one.camera.width, one.camera.height)
    write_corners(place, PlainSet(T, tuple((every, p) for p in one.pixels), size), folder.names)
    (place / folder.file).write_text(folder.text(T))
    return load(place, folder.board, mount=stated)


@pytest.mark.parametrize("mount", ["base", "flange"])
def test_inverted_poses_are_put_right_where_somebody_says_so(mount, tmp_path):
    """The camera on the arm came out as one in the base, and a warning was all."""
    one = make_set(ur5(), np.random.default_rng(31), 14, mount, ArmErrors(5e-5, 1e-4))
    found = _with_poses(tmp_path, one, se3.inverses(one.told), mount)
    assert [(f.code, f.severity) for f in found.findings] == [("pose_inverted", "warning")]
    (camera,) = found.cameras
    assert camera.mount == mount
    np.testing.assert_allclose(found.poses[camera.view], one.told, atol=1e-6)


@pytest.mark.parametrize("mount", ["base", "flange"])
def test_inverted_poses_are_asked_about_where_nobody_says_so(mount, tmp_path):
    """They were read as a camera inside the robot's base, without a word."""
    one = make_set(ur5(), np.random.default_rng(31), 14, mount, ArmErrors(5e-5, 1e-4))
    (said,) = _with_poses(tmp_path / "a", one, se3.inverses(one.told), None).findings
    assert (said.code, said.severity) == ("pose_inverted", "error")
    assert "say --hand or --beside" in said.cure
    assert _with_poses(tmp_path / "b", one, one.told, None).findings == ()
    # A wrong word is no reason to turn poses that are right.
    other = "flange" if mount == "base" else "base"
    wrong = _with_poses(tmp_path / "c", one, one.told, other)
    assert [(f.code, f.severity) for f in wrong.findings] == [("pose_inverted", "warning")]
    assert wrong.cameras[0].mount == mount
    np.testing.assert_allclose(wrong.poses[wrong.cameras[0].view], one.told, atol=1e-6)
