"""T2's clouds: cleaned, merged, aligned; against synthetic truth."""

import numpy as np
import pytest

from armsight.geometry.pose import exp, inverse, transform
from armsight.mapping.snapshot import FREE, OCCUPIED
from baselines import merged_clouds as cleaning
from baselines.octomap_map import OctomapBaseline

from . import scenes

THINGS = [
    scenes.box("table", (0, 0, -0.05), (3.0, 3.0, 0.1)),
    scenes.box("box", (0.3, 0.2, 0.15), (0.2, 0.3, 0.3)),
    scenes.sphere("ball", (-0.3, -0.2, 0.25), 0.15),
    scenes.box("post", (0.0, 0.5, 0.3), (0.1, 0.1, 0.6)),
]
SIZE = (192, 159)
CAMERAS = [
    scenes.camera_info("left", (1.0, 1.0, 1.4), size=SIZE),
    scenes.camera_info("right", (1.0, -1.0, 1.4), size=SIZE),
    scenes.camera_info("back", (-1.2, 0.1, 1.4), size=SIZE),
]


def clouds():
    found = []
    for info in CAMERAS:
        depth = scenes.ray_cast(info.depth, info.T_mount_camera, THINGS)
        points = info.depth.deproject(depth).reshape(-1, 3)
        found.append(points[np.isfinite(points).all(axis=1)])
    return found


def surface_error(points):
    """Distance of points to the nearest thing's surface [m]."""
    return np.min([np.abs(s.distance(points)) for s in THINGS], axis=0)


def test_cleaning_crops_thins_and_drops_strays():
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-0.5, 0.5, 0.01), np.arange(-0.5, 0.5, 0.01))
    sheet = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    strays = rng.uniform([-0.5, -0.5, 0.3], [0.5, 0.5, 1.0], (40, 3))
    far = sheet + 5.0
    bad = np.full((3, 3), np.nan)
    found = cleaning.clean(np.concatenate([sheet, strays, far, bad]), 1.5, 0.05)
    assert np.isfinite(found).all()
    assert (np.linalg.norm(found, axis=1) < 1.5).all()
    assert (np.abs(found[:, 2]) < 1e-6).mean() > 0.97
    assert len(found) == pytest.approx(400, rel=0.15)  # one in each of 20 x 20 voxels


@pytest.mark.parametrize("cloud", [np.zeros((0, 3)), np.full((5, 3), np.nan), np.zeros((1, 3))])
def test_clouds_of_nothing(cloud):
    assert len(cleaning.clean(cloud)) <= 1
    merger = cleaning.CloudMerger(2)
    assert len(merger.merge([cloud, cloud], [np.eye(4)] * 2)) == 2
    assert all((np.eye(4) == T).all() for T in merger.corrections)


def believed(rng, translation=0.015, rotation=0.008):
    """Poses with calibration errors; the first camera's is right."""
    poses = [CAMERAS[0].T_mount_camera]
    for info in CAMERAS[1:]:
        twist = np.concatenate(
            [rng.uniform(-1, 1, 3) * translation, rng.uniform(-1, 1, 3) * rotation]
        )
        poses.append(info.T_mount_camera @ exp(twist))
    return poses


@pytest.mark.parametrize("seed", range(3))
def test_alignment_brings_cameras_together(seed):
    poses = believed(np.random.default_rng(seed))
    merger = cleaning.CloudMerger(3)
    merged = merger.merge(clouds(), poses)
    assert merger.alignments == 1
    assert (merger.corrections[0] == np.eye(4)).all()
    before, after = [], []
    for info, pose, correction in zip(CAMERAS, poses, merger.corrections):
        for T, errors in ((pose, before), (correction @ pose, after)):
            errors.append(np.linalg.norm((inverse(info.T_mount_camera) @ T)[:3, 3]))
    assert max(after) < 0.008  # clouds of 2 cm voxels
    assert sum(after) < 0.4 * sum(before)
    raw = [transform(T, c) for T, c in zip(poses, clouds())]
    assert np.median(surface_error(np.concatenate(raw))) > 0.002
    assert np.median(surface_error(np.concatenate(merged))) < 0.001


def test_aligned_once_and_again_when_something_moved():
    poses = believed(np.random.default_rng(0))
    merger = cleaning.CloudMerger(3)
    for _ in range(3):
        merger.merge(clouds(), poses)
    assert merger.alignments == 1
    poses[2] = poses[2] @ exp(np.array([0.02, -0.01, 0.02, 0.0, 0.01, 0.0]))
    merger.merge(clouds(), poses)
    assert merger.alignments == 2
    merged = merger.merge(clouds(), poses)
    assert merger.alignments == 2
    assert np.median(surface_error(merged[2])) < 0.004


def test_as_many_clouds_as_cameras():
    with pytest.raises(ValueError, match="2 clouds and 1 poses of 3 cameras"):
        cleaning.CloudMerger(3).merge([np.zeros((0, 3))] * 2, [np.eye(4)])


def test_the_baseline_maps_what_is_merged():
    baseline = OctomapBaseline()
    baseline.insert_merged(clouds(), believed(np.random.default_rng(1)))
    centers, edges = baseline.occupied()
    assert len(centers) > 300
    assert (surface_error(centers) < 0.9 * edges + 0.01).mean() > 0.98
    above = np.array([[0.0, 0.0, 0.6], [0.3, 0.2, 0.29]])
    assert baseline.state(above).tolist() == [FREE, OCCUPIED]
