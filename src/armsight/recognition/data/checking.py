"""Finds damage in a set, and says what is in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from armsight.arrays import Floats
from armsight.errors import DatasetError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import is_rotation
from armsight.recognition.data.keypoints import (
    placed_keypoints,
    robot_keypoints,
    visible_keypoints,
)
from armsight.recognition.data.labelled_set import LabelledSet, read_shard
from armsight.recognition.data.manifest import FILE, Manifest, read_manifest, shard_folder
from armsight.recognition.data.rows import Row
from armsight.recognition.data.sample import KNOWN_ROBOTS, Sample
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses

JITTER = 0.02
"""Greatest distance of a joint from the nominal kinematics [m]: links are up to 1 mm off along
each axis, and the arm's joints add up what the links before them are off."""


@dataclass(frozen=True)
class CheckReport:
    """What a set holds.

    Attributes:
        read: samples that were read.
        problems: one line each, with the file.
        values: of each robot, (n, 8) columns of :data:`COLUMNS`; NaN where there is no robot.
    """

    read: int
    problems: tuple[str, ...]
    values: dict[str, Floats]


COLUMNS = (
    "share of the picture, %",
    "distance of the base, m",
    "horizontal field of view, deg",
    "camera above the base, deg",
    "turn about the view, deg",
    "brightness, %",
    "white out, %",
    "key points seen, %",
)


def check(folder: Path) -> CheckReport:
    """Read every sample of a set; missing shards and foreign files are problems too.

    Raises:
        DatasetError: there is no set at all, or its description is broken.
    """
    manifest = read_manifest(folder)
    problems = _foreign(folder, manifest)
    values: dict[str, list[list[float]]] = {}
    read = 0
    for shard in range(manifest.shards):
        try:
            rows = read_shard(folder, manifest, shard)
        except DatasetError as error:
            problems.append(str(error))
            continue
        one = LabelledSet(folder, manifest, rows)
        for i, row in enumerate(rows):
            try:
                sample = one[i]
            except DatasetError as error:
                problems.append(str(error))
                continue
            read += 1
            problems += [f"{one.image_path(i)}: {p}" for p in contradictions(sample)]
            values.setdefault(row.robot, []).append(_measure(sample, row))
    arrays = {name: np.array(values[name]) for name in manifest.counts if name in values}
    return CheckReport(read, tuple(problems), arrays)


def contradictions(sample: Sample) -> list[str]:
    """What in the labels of a sample contradicts itself, in words."""
    if sample.robot not in KNOWN_ROBOTS:
        return []
    found = []
    robot = load_robot(sample.robot)
    if len(sample.q) != robot.n:
        return [f"{len(sample.q)} joints, {sample.robot} has {robot.n}"]
    if not is_rotation(sample.T_camera_base[:3, :3]):
        found.append("T_camera_base is no rigid transform")
    T_camera_link = sample.T_camera_base @ link_poses(robot, sample.q)
    if np.abs(T_camera_link[1:, :3, 3] - sample.joints_camera).max() > JITTER:
        found.append("joints_camera does not follow from q and T_camera_base")
    points = robot_keypoints(sample.robot)
    if len(points.names) != len(sample.keypoints_camera):
        return [*found, f"{len(sample.keypoints_camera)} key points, expected {len(points.names)}"]
    placed = placed_keypoints(points, T_camera_link)
    if np.abs(placed - sample.keypoints_camera).max() > JITTER:
        found.append("keypoints_camera does not follow from q and T_camera_base")
    d = [float(v) for v in sample.distortion]
    h, w = sample.mask.shape
    K = sample.K
    lens = PinholeCamera(w, h, K[0, 0], K[1, 1], K[0, 2], K[1, 2], (d[0], d[1], d[2], d[3], d[4]))
    pixels = lens.project(sample.keypoints_camera)
    if np.nanmax(np.abs(pixels - sample.keypoints_px), initial=0.0) > 0.01:
        found.append("keypoints_px is not where the lens puts keypoints_camera")
    elif np.any(visible_keypoints(points, pixels, sample.link_ids) != sample.keypoints_visible):
        found.append("keypoints_visible does not follow from the link ids")
    return found


def statistics_table(report: CheckReport) -> Table:
    """Median and range (5 to 95 %) of each measure, a robot a column."""
    names = list(report.values)
    table = Table("5 %, median, 95 %", *names)
    table.add_row("samples", *(str(len(report.values[name])) for name in names))
    for k, measure in enumerate(COLUMNS):
        table.add_row(measure, *(_spread(report.values[name][:, k]) for name in names))
    return table


def _spread(column: Floats) -> str:
    there = column[np.isfinite(column)]
    if len(there) == 0:
        return "-"
    low, middle, high = np.percentile(there, [5, 50, 95])
    return f"{low:.3g} {middle:.3g} {high:.3g}"


def _measure(sample: Sample, row: Row) -> list[float]:
    w = sample.mask.shape[1]
    T = sample.T_camera_base
    # Where the camera is, seen from the base; z of the base is up unless the arm hangs.
    eye = -T[:3, :3].T @ T[:3, 3]
    distance = float(np.linalg.norm(eye))
    up = T[:3, 2]
    return [
        100.0 * float(sample.mask.mean()) if len(sample.q) else np.nan,
        distance,
        float(np.rad2deg(2 * np.arctan(0.5 * w / sample.K[0, 0]))),
        float(np.rad2deg(np.arcsin(np.clip(eye[2] / max(distance, 1e-9), -1, 1)))),
        float(np.rad2deg(np.arctan2(up[0], -up[1]))),
        100.0 * float(sample.image.mean()) / 255.0,
        100.0 * float((sample.image.min(axis=2) >= 250).mean()),
        100.0 * float(sample.keypoints_visible.mean()) if len(sample.keypoints_visible) else np.nan,
    ]


def _foreign(folder: Path, manifest: Manifest) -> list[str]:
    """Unfinished and unexpected things in the folder."""
    problems = [
        f"{p}: is unfinished; generate goes on with it" for p in folder.glob("shards/*.part")
    ]
    expected = {shard_folder(folder, k).name for k in range(manifest.shards)}
    for path in sorted((folder / "shards").glob("*")):
        if path.suffix != ".part" and path.name not in expected:
            problems.append(f"{path}: is no shard that {FILE} knows")
    return problems
