"""Joint angles as a user writes them down, and what is wrong with them, in one line."""

from pathlib import Path

import numpy as np
import pytest

from armsight.cli import run
from armsight.errors import UsageError
from armsight.recognition.any_arm.joint_list import joints_of, read_joints
from armsight.robots.catalogue import load_robot

UR5 = load_robot("ur5")


def test_lines_are_read_in_degrees_by_the_pictures_name(tmp_path: Path) -> None:
    file = tmp_path / "joints.csv"
    file.write_text("# of Monday\n\nb.png, 0, -90, 90, 0, 1.5, -720\n a.png,1,2,3,4,5,6\n")
    found = read_joints(file, UR5)
    assert list(found) == ["b.png", "a.png"]
    np.testing.assert_allclose(found["b.png"], np.deg2rad([0, -90, 90, 0, 1.5, -720]))


@pytest.mark.parametrize(("line", "words"), [
    ("a.png, 1, 2, 3", "line 1: ur5 has 6 joints, 3 numbers are given"),
    ("a.png, 1, 2, 3, 4, 5, x", "line 1: expected a picture's name and 6 angles"),
    ("a.png, 1, 2, 3, 4, 5, nan", "line 1: joint 6 is nan"),
    ("a.png, 1, 2, 3, 4, 5, 1e9", "line 1: joint 6 is"),
    ("a.png,1,2,3,4,5,6\na.png,1,2,3,4,5,6", "line 2: a.png stands there twice"),
])  # fmt: skip
def test_a_line_that_is_none_is_named(tmp_path: Path, line: str, words: str) -> None:
    file = tmp_path / "joints.csv"
    file.write_text(line)
    with pytest.raises(UsageError, match=words):
        read_joints(file, UR5)


def test_a_file_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_joints(tmp_path / "none.csv", UR5)
    (tmp_path / "bits.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot be read"):
        read_joints(tmp_path / "bits.csv", UR5)


def test_infinite_angles_are_none() -> None:
    with pytest.raises(UsageError, match="joint 2"):
        joints_of([0, float("inf"), 0, 0, 0, 0], UR5, "--joints-deg")


@pytest.mark.parametrize(("words", "said"), [
    ((), "give one of --joints-deg"),
    (("--joints-deg", "1", "--joints", "j.csv"), "give one of --joints-deg"),
    (("--joints-deg", "1", "--intrinsics", "1,1,1,1", "--camera", "c"), "one of --camera"),
    (("--joints-deg", "1", "2"), "ur5 has 6 joints"),
    (("--joints-deg", "0", "-90", "0", "0", "0", "0", "--threads", "-1"), "--threads is -1"),
])  # fmt: skip
def test_place_says_in_a_line_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    from PIL import Image

    file = tmp_path / "p.png"
    Image.fromarray(np.full((120, 160, 3), 90, np.uint8)).save(file)
    assert run(["place", str(file), "--robot", "ur5", *words]) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert len(captured.err.strip().splitlines()) == 1
