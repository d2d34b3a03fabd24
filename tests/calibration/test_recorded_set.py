"""A folder with several cameras, and pictures that are no pictures."""

from pathlib import Path

import numpy as np
import pytest
from arms import ur5
from PIL import Image

from armsight.calibration import pictures, set_pictures
from armsight.calibration.boards import Checkerboard, Detection
from armsight.calibration.diagnosis.pictures import picture_findings
from armsight.calibration.layouts.folder import list_folder
from armsight.calibration.pictures import Seen, look, read_gray
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic_set import LENS, ArmErrors, make_set, seen_from
from armsight.geometry.pose import exp

BOARD = Checkerboard(10, 7, 0.025, hollow=False)


def dot(file: Path, size=(64, 48)):
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.new("L", size, 128).save(file)


def test_two_cameras_and_one_arm_are_one_solve(tmp_path, monkeypatch):
    rng = np.random.default_rng(12)
    one = make_set(ur5(), rng, 14, "base", ArmErrors(1e-4, 2e-4))
    other_X = one.T_mount_camera @ exp([0.08, 0.01, 0.0, 0.02, -0.08, 0.05])
    second = seen_from(one, one.true, other_X, one.T_mount_board)
    second = second + rng.normal(0, 0.1, second.shape)
    corners = {"left": one.pixels, "right": second}
    for side in corners:
        for k in range(14):
            dot(tmp_path / side / f"{side}_{k:02d}.png")
    (tmp_path / "poses.txt").write_text(
        "\n".join(" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told)
    )

    def seen(board, files, progress=None):
        side = files[0].parent.name
        found = tuple(Detection(np.arange(54), p, 0.1) for p in corners[side])
        names = tuple(f.name for f in files)
        size = (LENS.width, LENS.height)
        return Seen(names, found, ("",) * 14, size, np.ones(14), names)

    monkeypatch.setattr(set_pictures, "look", seen)
    monkeypatch.setattr(set_pictures, "settle_board", lambda board, files, more: (board, []))
    recorded = load(tmp_path, BOARD)
    assert [(c.name, c.mount) for c in recorded.cameras] == [("left", "base"), ("right", "base")]
    answer = solve_set(recorded).calibration
    assert answer is not None
    for rig, truth in enumerate((one.T_mount_camera, other_X)):
        gap = np.linalg.norm(answer.camera_pose(rig)[:3, 3] - truth[:3, 3])
        assert gap < 4e-3
        sigma = np.sqrt(np.trace(answer.covariance.camera_pose(rig)[:3, :3]))
        assert gap < 4 * sigma
    assert [f.code for f in recorded.findings] == []


def test_hostile_pictures_have_a_reason_and_a_name(tmp_path):
    for k in range(4):
        dot(tmp_path / f"im_{k}.png")
    (tmp_path / "im_4.png").write_bytes((tmp_path / "im_0.png").read_bytes()[:40])
    (tmp_path / "im_5.png").write_bytes(b"GIF89a not really")
    dot(tmp_path / "im_6.png", (80, 60))
    assert read_gray(tmp_path / "im_5.png") == "picture cannot be read"
    listed = list_folder(tmp_path)
    found = look(BOARD, listed.series[0].files)
    assert found.size == (64, 48)
    assert [m.split(",")[0] for m in found.misses[4:]] == [
        "picture cannot be read",
        "picture cannot be read",
        "picture is 80x60",
    ]
    recorded = load(tmp_path, BOARD)
    (unseen,) = [f for f in picture_findings(recorded) if f.code == "unseen"]
    assert "im_4.png" in unseen.message
    assert "im_6.png" in unseen.message


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["left_1.png", "left_2.png", "left_3.png", "right_1.png", "right_2.png", "right_3.png"],
         ["left", "right"]),
        (["a/1.png", "a/2.png", "a/3.png", "b/1.png", "b/2.png", "b/3.png"], ["a", "b"]),
        (["IMG_1.JPG", "IMG_2.JPG", "IMG_3.JPG", "depth_1.png"], ["camera"]),
        (["one.png", "two.png", "three.png"], ["camera"]),
    ],
)  # fmt: skip
def test_series_of_pictures(tmp_path, names, expected):
    for name in names:
        dot(tmp_path / name)
    assert sorted(s.name for s in list_folder(tmp_path).series) == expected


def test_pictures_are_paired_by_order_though_not_all_are_looked_at(tmp_path, monkeypatch):
    """Of more than 400 pictures some were dropped before they were paired: nothing fitted."""
    one = make_set(ur5(), np.random.default_rng(12), 14, "base", ArmErrors(1e-4, 2e-4))
    for k in range(14):
        Image.new("L", (LENS.width, LENS.height), 10 * k).save(tmp_path / f"{chr(97 + k)}.png")
    (tmp_path / "poses.txt").write_text(
        "\n".join(" ".join(f"{v:.9f}" for v in T.ravel()) for T in one.told)
    )

    def detect(self, gray):
        return Detection(np.arange(54), one.pixels[int(gray[0, 0]) // 10], 0.1)

    monkeypatch.setattr(Checkerboard, "detect", detect)
    monkeypatch.setattr(set_pictures, "settle_board", lambda board, files, more: (board, []))
    monkeypatch.setattr(pictures, "MOST", 10)
    monkeypatch.setattr(set_pictures, "MOST", 10)
    recorded = load(tmp_path, BOARD)
    (camera,) = recorded.cameras
    found = [k for k, d in enumerate(camera.seen.detections) if d is not None]
    assert len(found) == 10
    np.testing.assert_allclose(recorded.poses[camera.view[found]], one.told[found], atol=1e-6)
    told = [f.code for f in (*recorded.findings, *picture_findings(recorded))]
    assert told == ["many_pictures"]
