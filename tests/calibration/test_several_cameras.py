"""Several cameras and one arm: a stereo pair, cameras on the arm and beside it at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import ur5

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.layouts.series import patterns, series_of
from armsight.calibration.pairs import pairs
from armsight.calibration.recorded_set import RecordedSet, load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.report import lines
from armsight.calibration.synthetic_set import LENS, ArmErrors, SyntheticSet, make_set, seen_from
from armsight.experiments.calibration_mistakes import BOARD
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, make_pose

WIDE = PinholeCamera(1280, 960, 620.0, 620.0, 639.5, 479.5)


def write(folder: Path, one: SyntheticSet, corners: dict[str, Floats]) -> None:
    """``corners.csv`` with a column for the camera, and the arm's poses."""
    rows = [f"# {LENS.width}x{LENS.height}", "camera,image,corner,u,v"]
    for camera, pixels in corners.items():
        for k, seen in enumerate(pixels):
            if np.isfinite(seen).all():
                rows += [
                    f"{camera},{k:02d}.png,{i},{u:.4f},{v:.4f}" for i, (u, v) in enumerate(seen)
                ]
    (folder / "corners.csv").write_text("\n".join(rows) + "\n")
    poses = [
        f"{k:02d}.png," + ",".join(f"{v:.9f}" for v in T[:3].ravel())
        for k, T in enumerate(one.told)
    ]
    (folder / "poses.csv").write_text("\n".join(poses) + "\n")


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[SyntheticSet, RecordedSet]:
    """An arm that errs by a millimetre, before a stereo pair 80 mm apart."""
    rng = np.random.default_rng(21)
    one = make_set(ur5(), rng, 16, "base", ArmErrors(1e-3, 0.0))
    right = seen_from(one, one.true, one.T_mount_camera @ BESIDE, one.T_mount_board)
    folder = tmp_path_factory.mktemp("pair")
    seen = {"left": one.pixels, "right": right + rng.normal(0, 0.1, right.shape)}
    write(folder, one, seen)
    return one, load(folder, BOARD)


BESIDE = exp([0.08, 0.002, 0.0, 0.01, -0.05, 0.004])
"""The right camera of the pair in the left one."""


def test_a_stereo_pair_is_known_better_than_its_cameras(
    pair: tuple[SyntheticSet, RecordedSet],
) -> None:
    one, recorded = pair
    assert [(c.name, c.mount) for c in recorded.cameras] == [("left", "base"), ("right", "base")]
    answer = solve_set(recorded).calibration
    assert answer is not None
    (found,) = pairs(answer)
    d = se3.logs((inverse(found.T_first_second) @ BESIDE)[None])[0]
    assert d @ np.linalg.solve(found.covariance, d) < 22.5  # 99.9 % of chi squared of six
    alone = np.sqrt(np.trace(answer.covariance.camera_pose(0)[:3, :3]))
    assert np.sqrt(np.trace(found.covariance[:3, :3])) < 0.7 * alone
    left = se3.logs((inverse(answer.camera_pose(0)) @ one.T_mount_camera)[None])[0]
    assert np.linalg.norm(d[:3]) < np.linalg.norm(left[:3])
    told = [line for line in lines(answer) if line.startswith("right in left: ")]
    assert len(told) == 1
    assert "mm apart" in told[0]


def test_cameras_on_the_arm_and_beside_it_are_one_solve(tmp_path: Path) -> None:
    rng = np.random.default_rng(22)
    one = make_set(ur5(), rng, 18, "base", ArmErrors(1e-4, 2e-4))
    hand = make_pose(None, (0.0, -0.07, 0.03))
    # A second board of the same kind, where the hand looks at in the middle of the views.
    middle = one.true[
        int(np.argmin(np.linalg.norm(one.true[:, :3, 3] - one.true[:, :3, 3].mean(0), axis=1)))
    ]
    behind = middle @ hand @ make_pose(None, (0.0, 0.0, 0.7))
    table = behind @ make_pose(None, -0.5 * (one.points.max(0) + one.points.min(0)))
    C = inverse(hand) @ se3.inverses(one.true) @ table
    p = one.points @ np.swapaxes(C[:, :3, :3], 1, 2) + C[:, None, :3, 3]
    seen = WIDE.project(p.reshape(-1, 3)).reshape(len(p), -1, 2)
    whole = (
        (p[..., 2] > 0.1) & (seen > 5).all(-1) & (seen < [WIDE.width - 5, WIDE.height - 5]).all(-1)
    )
    seen = seen + rng.normal(0, 0.1, seen.shape)
    seen[~whole.all(1)] = np.nan
    assert whole.all(1).sum() >= 8
    write(tmp_path, one, {"fixed": one.pixels, "hand": seen})
    recorded = load(tmp_path, BOARD)
    assert {(c.name, c.mount) for c in recorded.cameras} == {("fixed", "base"), ("hand", "flange")}
    answer = solve_set(recorded).calibration
    assert answer is not None
    assert sorted(b.mount for b in answer.problem.boards) == ["base", "flange"]
    assert pairs(answer) == []
    truth = {"fixed": one.T_mount_camera, "hand": hand}
    for k, rig in enumerate(answer.problem.rigs):
        gap = np.linalg.norm(answer.camera_pose(k)[:3, 3] - truth[rig.name][:3, 3])
        sigma = np.sqrt(np.trace(answer.covariance.camera_pose(k)[:3, :3]))
        assert gap < 3e-3
        assert gap < 4 * sigma


def test_a_number_in_the_names_may_be_the_cameras() -> None:
    views = [Path(f"cam{c}_{k:03d}.png") for c in (0, 1) for k in range(12)]
    (found,) = patterns(views).values()
    assert {w: len(f) for w, f in found.items()} == {"cam0": 12, "cam1": 12}
    behind = [Path(f"{k}_camera_{c}.png") for c in (1, 2, 3) for k in range(9)]
    (found,) = patterns(behind).values()
    assert sorted(found) == ["camera1", "camera2", "camera3"]
    dated = [Path(f"2024-05-0{d}_{k}.png") for d, k in ((1, 1), (1, 2), (2, 3), (2, 4), (2, 5))]
    (found,) = patterns(dated).values()
    assert len(found) == 1


def test_mrcals_corners_are_read_camera_by_camera(tmp_path: Path) -> None:
    rng = np.random.default_rng(23)
    one = make_set(ur5(), rng, 8, "base", ArmErrors(0.0, 0.0))
    rows = ["# generated by mrgingham", "# filename x y level"]
    for camera in ("left", "right"):
        for k, seen in enumerate(one.pixels):
            name = f"{camera}-{k:02d}.png"
            rows += [f"{name} - - -"] if k == 3 else [f"{name} {u:.3f} {v:.3f} 0" for u, v in seen]
    (tmp_path / "corners.vnl").write_text("\n".join(rows) + "\n")
    (tmp_path / "poses.txt").write_text(
        "\n".join(" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told) + "\n"
    )
    recorded = load(tmp_path, BOARD)
    assert [c.name for c in recorded.cameras] == ["left", "right"]
    for camera in recorded.cameras:
        assert [d is None for d in camera.seen.detections] == [k == 3 for k in range(8)]
    assert recorded.poses is not None
    np.testing.assert_allclose(recorded.poses, one.told, atol=1e-6)


def test_series_of_one_folder_keep_their_cameras(tmp_path: Path) -> None:
    files = [tmp_path / f"cam{c}_{k}.png" for c in (0, 1) for k in range(5)]
    for file in files:
        file.write_bytes(b"")
    series, _ = series_of(tmp_path, files)
    assert sorted((s.name, len(s.files)) for s in series) == [("cam0", 5), ("cam1", 5)]
