"""Posed depth folders: made-up ones with known truth, and the real kitchen where it is at hand."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import octomap
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armsight.commands.replay import Replay
from armsight.devices.data import RgbdFrame
from armsight.errors import RecordingError, UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, make_pose, transform
from armsight.mapping.snapshot import FREE, OCCUPIED
from armsight.recording.depth_folder import open_depth_folder
from armsight.recording.gravity_alignment import upright
from armsight.recording.replay_parts import replay_parts
from armsight.runtime.session import Session

LENS = PinholeCamera(160, 120, 150.0, 150.0, 80.0, 60.0)
BOX = (np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.4]))


def render(T_world_camera: np.ndarray) -> np.ndarray:
    """Depth [m] of a floor at z = 0 with a box on it, by rays: slabs and a plane."""
    rays = np.concatenate([LENS.rays, np.ones((120, 160, 1))], axis=-1) @ T_world_camera[:3, :3].T
    eye = T_world_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(rays[..., 2] < 0, -eye[2] / rays[..., 2], np.inf)
        a, b = (BOX[0] - eye) / rays, (BOX[1] - eye) / rays
    near, far = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    box = np.where((near <= far) & (far > 0), near, np.inf)
    return np.minimum(floor, box)


def write_folder(folder: Path, turn: np.ndarray, frames: int = 12) -> list[np.ndarray]:
    """Frames around the box, in a world that lies as ``turn`` says; the poses in that world."""
    folder.mkdir(exist_ok=True)
    K = " ".join(f"{v}" for v in LENS.K.ravel())
    (folder / "camera-intrinsics.txt").write_text(
        "\n".join(" ".join(K.split()[3 * i : 3 * i + 3]) for i in range(3))
    )
    poses = []
    for i in range(frames):
        angle = 0.1 * i
        eye = [1.4 * np.cos(angle), 1.4 * np.sin(angle), 0.9]
        T = look_at(eye, [0.0, 0.0, 0.1])
        depth = render(T)
        raw = np.where(np.isfinite(depth) & (depth < 8.0), 1000.0 * depth, 0.0).round()
        cv2.imwrite(str(folder / f"frame-{150 + i:06d}.depth.png"), raw.astype(np.uint16))
        poses.append(turn @ T)
        np.savetxt(folder / f"frame-{150 + i:06d}.pose.txt", poses[-1])
    return poses


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_scan_is_set_upright(tmp_path: Path, seed: int) -> None:
    """Whatever way its world lies: the floor becomes z = 0, and up is up."""
    turn = make_pose(
        Rotation.random(None, np.random.default_rng(seed)).as_matrix(), [5.0, -3.0, 7.0]
    )
    poses = write_folder(tmp_path / "scan", turn)
    with open_depth_folder(tmp_path / "scan") as cell:
        T_base_world = cell.cameras[0].info.T_mount_camera @ inverse(poses[0])
        T_base_truth = T_base_world @ turn
        np.testing.assert_allclose(T_base_truth[2, :3], [0.0, 0.0, 1.0], atol=0.01)
        assert abs(transform(T_base_truth, np.zeros((1, 3)))[0, 2]) < 0.03
        box = cell.workcell.mapping
        assert box.lower is not None
        assert box.upper is not None
        assert box.lower[2] < 0.0 < box.upper[2]
        assert box.upper[2] > 0.4


def test_frames_come_in_time_with_their_poses(tmp_path: Path) -> None:
    poses = write_folder(tmp_path / "scan", np.eye(4))
    with open_depth_folder(tmp_path / "scan", rate=10.0) as cell:
        world = cell.world
        assert world.duration == pytest.approx(1.2)
        assert cell.robot.n == 0
        T = cell.cameras[0].info.T_mount_camera @ inverse(poses[0])
        for i in range(12):
            world.advance(0.1 * i)
            frame = cell.cameras[0].read()
            assert frame.stamp == pytest.approx(0.1 * i)
            np.testing.assert_allclose(frame.T_base_camera, T @ poses[i], atol=1e-9)
            truth = render(poses[i])
            known = np.isfinite(frame.depth)
            np.testing.assert_allclose(frame.depth[known], truth[known], atol=0.0006)
            assert cell.arm.read().stamp == pytest.approx(0.1 * i)
        assert world.finished


@pytest.mark.parametrize(
    ("names", "rate"),
    [
        ([f"{1403636579763555584 + 50_000_000 * i}" for i in range(12)], 20.0),  # EuRoC, ns
        ([f"{7_000_123_456 + 33_333_333 * i}" for i in range(12)], 30.0),  # ns since it was started
        ([f"{1305031102175304 + 33_333 * i}" for i in range(12)], 30.0),  # us
        ([f"{1305031102.95 + i / 20:.6f}" for i in range(12)], 20.0),  # TUM, s
        ([f"{1305031102.9 + i / 10:.1f}" for i in range(12)], 10.0),  # zeros left out at the end
        ([f"{1305031102175 + 100 * i}" for i in range(12)], 10.0),  # ms
        (
            [f"frame-{150 + i:06d}" for i in range(12)],
            25.0,
        ),  # no times: the rate that was asked for
        ([f"frame-{150 + 10 * i:06d}" for i in range(12)], 2.5),  # every tenth frame
    ],
)
def test_names_may_be_times(tmp_path: Path, names: list[str], rate: float) -> None:
    """A folder of a second, named in nanoseconds, was replayed for 19 days."""
    write_folder(tmp_path / "scan", np.eye(4))
    for i in range(12):
        for kind in ("depth.png", "pose.txt"):
            file = tmp_path / "scan" / f"frame-{150 + i:06d}.{kind}"
            file.rename(tmp_path / f"{i}.{kind}")
    for i, name in enumerate(names):
        for kind in ("depth.png", "pose.txt"):
            (tmp_path / f"{i}.{kind}").rename(tmp_path / "scan" / f"{name}.{kind}")
    with open_depth_folder(tmp_path / "scan", rate=25.0) as cell:
        told = 25.0 if "frame" in names[0] else rate
        assert cell.cameras[0].info.rate == pytest.approx(told, rel=1e-3)
        span = 11 / rate
        assert cell.world.duration == pytest.approx(span + 1 / told, rel=1e-3)
        cell.world.advance(span + 1e-3)
        assert cell.cameras[0].read().stamp == pytest.approx(span, rel=1e-3)
        assert cell.world.finished


def test_the_map_holds_what_was_scanned(tmp_path: Path) -> None:
    write_folder(tmp_path / "scan", np.eye(4))
    with open_depth_folder(tmp_path / "scan", voxel=0.04) as cell:
        first = cell.cameras[0].info.T_mount_camera
        T = first @ inverse(look_at([1.4, 0.0, 0.9], [0.0, 0.0, 0.1]))
        session = Session(cell, None, make=replay_parts)
        session.run(cell.world.duration)
        snapshot = session.view().snapshot
    assert snapshot is not None
    centers = snapshot.grid.center(np.argwhere(snapshot.state >= 0))
    x, y, z = transform(inverse(T), centers).T
    state = snapshot.state.reshape(-1)
    in_box = (np.abs(x) < 0.3) & (np.abs(y) < 0.2) & (z > 0.0) & (z < 0.4)
    deep = (np.abs(x) < 0.22) & (np.abs(y) < 0.12) & (z > 0.08) & (z < 0.32)
    near_box = (np.abs(x) < 0.38) & (np.abs(y) < 0.28) & (z < 0.48)
    lid = (np.abs(x) < 0.25) & (np.abs(y) < 0.15) & (np.abs(z - 0.4) < 0.04)
    assert not np.any(state[deep] == FREE)
    assert not np.any(state[~near_box & (z > 0.1)] == OCCUPIED)
    assert np.count_nonzero(state[in_box | lid] == OCCUPIED) > 100
    assert np.mean(state[lid].reshape(-1) == OCCUPIED) > 0.4  # one of two layers, or both
    assert np.count_nonzero(state == FREE) > 10_000


def test_the_map_is_written_as_octomap_and_as_cloud(tmp_path: Path) -> None:
    """OctoMap's own library and trimesh read what replay writes, with what the summary counted."""
    write_folder(tmp_path / "scan", np.eye(4), frames=4)
    bt, ply, figures = (tmp_path / name for name in ("scan.bt", "scan.ply", "scan.json"))
    scan = tmp_path / "scan"
    assert Replay(scan, headless=True, speed=0, map=bt, json=figures).run() == 0
    assert Replay(scan, headless=True, speed=0, map=ply).run() == 0
    told = json.loads(figures.read_text())
    tree = octomap.OcTree(str(bt).encode())
    volume = {True: 0.0, False: 0.0}
    for leaf in tree.begin_leafs():
        volume[bool(tree.isNodeOccupied(leaf))] += leaf.getSize() ** 3
    voxel = tree.getResolution() ** 3
    assert volume[True] / voxel == pytest.approx(told["voxels_occupied"])
    assert volume[False] / voxel == pytest.approx(told["voxels_free"])
    assert len(trimesh.load(ply).vertices) == told["cloud_points"] > 100


def test_a_map_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"ends in \.bt or \.ply"):
        Replay(tmp_path, map=tmp_path / "map.las").run()


def test_frames_without_a_pose_are_left_out_and_told(tmp_path: Path) -> None:
    write_folder(tmp_path / "scan", np.eye(4))
    lost = "-1.#IND " * 16
    (tmp_path / "scan" / "frame-000152.pose.txt").write_text(lost)
    (tmp_path / "scan" / "frame-000153.pose.txt").unlink()
    np.savetxt(tmp_path / "scan" / "frame-000154.pose.txt", np.eye(4) * 3.0)
    np.savetxt(tmp_path / "scan" / "frame-000155.pose.txt", np.eye(3))
    with open_depth_folder(tmp_path / "scan") as cell:
        assert cell.world.note == "4 frames without a valid pose are left out"
        frames = [d for d in cell.world.source.deliveries() if isinstance(d.item, RgbdFrame)]
    assert len(frames) == 8


def test_colour_comes_along(tmp_path: Path) -> None:
    write_folder(tmp_path / "scan", np.eye(4), 3)
    blue = np.zeros((120, 160, 3), np.uint8)
    blue[..., 0] = 200  # OpenCV writes BGR
    cv2.imwrite(str(tmp_path / "scan" / "frame-000150.color.png"), blue)
    with open_depth_folder(tmp_path / "scan") as cell:
        cell.world.advance(0.0)
        frame = cell.cameras[0].read()
        assert frame.color is not None
        assert tuple(frame.color[0, 0]) == (0, 0, 200)
        cell.world.advance(0.05)
        assert cell.cameras[0].read().color is None


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda f: [p.unlink() for p in f.glob("*.depth.png")], "no depth images"),
        (lambda f: [p.unlink() for p in f.glob("*.pose.txt")], "no valid pose"),
        (lambda f: (f / "camera-intrinsics.txt").unlink(), "camera-intrinsics.txt is missing"),
        (lambda f: (f / "camera-intrinsics.txt").write_text("1 2 3"), "3x3 camera matrix"),
        (lambda f: (f / "camera-intrinsics.txt").write_text("a b"), "cannot be read"),
        (lambda f: (f / "frame-000150.depth.png").write_bytes(b"no"), "16-bit grey PNG"),
        (
            lambda f: cv2.imwrite(str(f / "frame-000150.depth.png"), np.zeros((9, 9), np.uint8)),
            "uint8 with 2 axes",
        ),
    ],
)
def test_broken_folders_are_refused(tmp_path: Path, spoil, told: str) -> None:  # type: ignore[no-untyped-def]
    write_folder(tmp_path / "scan", np.eye(4), 3)
    spoil(tmp_path / "scan")
    with pytest.raises(RecordingError, match=told):
        open_depth_folder(tmp_path / "scan")


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such folder"):
        open_depth_folder(tmp_path / "nothing")


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_a_place_without_returns_is_still_upright(seed: int) -> None:
    rng = np.random.default_rng(seed)
    views = []
    for _ in range(3):
        T = look_at(rng.uniform(1.0, 2.0, 3), rng.uniform(-0.5, 0.5, 3))
        views.append((np.full((20, 20, 3), np.nan), T))
    T_base_world, lower, upper = upright(views)
    assert np.all(np.isfinite(T_base_world))
    assert np.all(upper > lower)
    assert T_base_world[2, 2] > 0.0


def test_the_real_kitchen_becomes_a_map(shared_data: Path) -> None:
    folder = shared_data / "motion" / "depth_kitchen"
    if not folder.is_dir():
        pytest.skip("no motion/depth_kitchen in ../shared/data")
    with open_depth_folder(folder, voxel=0.04) as cell:
        assert cell.cameras[0].info.depth.fx == 585.0
        session = Session(cell, None, make=replay_parts)
        session.run(cell.world.duration)
        snapshot = session.view().snapshot
    assert snapshot is not None
    assert snapshot.cameras[0].frames == 50
    occupied = np.count_nonzero(snapshot.state == OCCUPIED)
    free = np.count_nonzero(snapshot.state == FREE)
    assert occupied > 3000
    assert free > occupied
    # A room has a level surface: one layer holds far more than the layers beside it.
    layers = np.count_nonzero(snapshot.state == OCCUPIED, axis=(0, 1))
    assert layers.max() > 2.0 * np.median(layers[layers > 0])
