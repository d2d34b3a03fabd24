"""Two arms before one camera: where one stands in the other's base."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from arms import ur5

from armsight.calibration import se3
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic_set import ArmErrors, make_set
from armsight.calibration.two_arms import two_arms
from armsight.commands.calibrate import Calibrate
from armsight.errors import CalibrationError
from armsight.experiments.calibration_layouts import write_corners
from armsight.experiments.calibration_mistakes import BOARD
from armsight.experiments.calibration_stranger_runs import plain
from armsight.geometry.pose import inverse


def write(folder: Path, seed: int, mount: str) -> np.ndarray:
    """A set in a folder; the true pose of what stands in the arm's base."""
    one = make_set(ur5(), np.random.default_rng(seed), 12, mount, ArmErrors(1e-4, 0.0))  # type: ignore[arg-type]
    write_corners(folder, plain(one))
    rows = [" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told]
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")
    return one.T_mount_camera if mount == "base" else one.T_mount_board


def test_two_arms_before_one_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Each arm sees the one camera in its own base: that is where the bases are to each other.
    A = write(tmp_path / "left", 31, "base")
    B = write(tmp_path / "right", 32, "base")
    out = tmp_path / "out"
    words = "checkerboard:9x6:25:inner"
    done = Calibrate(from_=tmp_path / "left", second_arm=tmp_path / "right", board=words, out=out)
    assert done.run() == 0
    said = capsys.readouterr().out
    assert "second arm's base in the first's, by camera camera: x " in said
    (entry,) = yaml.safe_load((out / "second_arm" / "bases.yaml").read_text())["transforms"]
    found = np.array([entry["translation"][a] for a in "xyz"])
    assert np.linalg.norm(found - (A @ inverse(B))[:3, 3]) < 3e-3
    assert (out / "calibration.json").exists()


def test_the_doubt_of_two_arms_is_that_of_both(tmp_path: Path) -> None:
    A = write(tmp_path / "left", 33, "flange")
    B = write(tmp_path / "right", 34, "flange")
    answers = [solve_set(load(tmp_path / s, BOARD)).calibration for s in ("left", "right")]
    assert answers[0] is not None
    assert answers[1] is not None
    found = two_arms(answers[0], answers[1])
    assert found.by == "the board"
    d = se3.logs((inverse(found.T_first_second) @ A @ inverse(B))[None])[0]
    assert d @ np.linalg.solve(found.covariance, d) < 22.5
    write(tmp_path / "beside", 35, "base")
    third = solve_set(load(tmp_path / "beside", BOARD)).calibration
    assert third is not None
    with pytest.raises(CalibrationError, match="the first knows the board, the second camera"):
        two_arms(answers[0], third)
