"""Plays a folder of posed depth images: a camera that moves through a place, without an arm.

The layout is that of 3DMatch, 7-Scenes and TSDF fusion: ``frame-NNNNNN.depth.png`` (16 bit [mm],
0 and 65535 are no return), ``frame-NNNNNN.pose.txt`` (4x4, camera to world), optionally
``frame-NNNNNN.color.png``, and ``camera-intrinsics.txt`` (3x3) beside them or one folder above.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from armsight.arrays import DepthImage, Points, Pose
from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, RgbdFrame
from armsight.errors import RecordingError
from armsight.geometry.camera import PinholeCamera
from armsight.pictures import read_picture
from armsight.recording.description import CellDescription
from armsight.recording.gravity_alignment import upright
from armsight.recording.no_robot import NAME as NO_ROBOT
from armsight.recording.no_robot import no_robot
from armsight.recording.playback import Delivery, Source
from armsight.recording.replay import bare_workcell, recorded_cell
from armsight.workcell import Cell

CAMERA = "camera"
RANGE = (0.3, 8.0)
LARGEST_BOX = (4.0, 4.0, 3.0)
"""The map is never larger than this, about the middle of what is mostly seen [m]."""
EPOCH = {13: 1e-3, 16: 1e-6, 19: 1e-9}
"""Digits of a time since 1970, and its unit [s]."""
LEAST_STEP = {1e-9: 1e6, 1e-6: 3e3}
"""From one file to the next, numbers that are times in this unit [s] grow by so many at least, and
numbers of frames by fewer."""
LOOKED_AT = 12
"""Frames from which direction of up, size and middle of the place are found."""


@dataclass(frozen=True)
class PosedImage:
    """One exposure: its number or its time, depth image, colour image or None, camera to world."""

    number: int
    depth: Path
    color: Path | None
    T_world_camera: Pose


def open_depth_folder(folder: str | Path, rate: float = 30.0, voxel: float = 0.02) -> Cell:
    """A cell whose only camera replays the folder; its map covers what the frames see.

    The base frame is set upright: z up, the floor (or the lowest surface seen) at z = 0.

    Args:
        folder: see the module.
        rate: frames a second where the files' names count frames [Hz]; names that are times (s with
            a point; ms, us or ns since 1970; us or ns of another clock) are taken as such.
        voxel: edge of the map's voxels [m].

    Raises:
        RecordingError: files are missing or cannot be read.
    """
    place = Path(folder)
    images, skipped = find_images(place)
    lens = read_lens(place, images[0].depth)
    unit, rate = time_of_numbers([image.number for image in images], rate)
    samples = [images[i] for i in np.linspace(0, len(images) - 1, LOOKED_AT).astype(int)]
    clouds = [(_camera_points(lens, read_depth(image.depth)), image) for image in samples]
    T_base_world, lower, upper = upright([(p, image.T_world_camera) for p, image in clouds])
    first = T_base_world @ images[0].T_world_camera
    colored = any(image.color is not None for image in images)
    info = RgbdCameraInfo(
        name=CAMERA,
        model="posed_depth",
        depth=lens,
        color=lens if colored else None,
        T_depth_color=np.eye(4),
        mounted_on="base",
        T_mount_camera=first,
        rate=rate,
        latency=0.0,
        range=RANGE,
        noise=DepthNoise(0.0, 0.0, 0.00285),
    )
    description = CellDescription(NO_ROBOT, "none", np.eye(4), (), (info,), ())
    note = f"{skipped} frames without a valid pose are left out" if skipped else ""
    source = Source(
        place.name,
        (0.0, (images[-1].number - images[0].number) * unit + 1.0 / rate),
        lambda: _deliveries(images, unit, T_base_world),
        note,
    )
    low, high = _fit(lower, upper, voxel)
    reach = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))))
    box = {"lower": low, "upper": high, "voxel": voxel, "crop": reach, "align": False}
    return recorded_cell(source, description, bare_workcell(place.name, NO_ROBOT, box), no_robot())


def find_images(folder: Path) -> tuple[list[PosedImage], int]:
    """The exposures of a folder in order, and how many were left out for want of a valid pose.

    Raises:
        RecordingError: there are none.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no such folder")
    files = sorted(folder.glob("*.depth.png")) or sorted(folder.glob("*/*.depth.png"))
    images, skipped = [], 0
    for depth in files:
        stem = depth.name.removesuffix(".depth.png")
        number = _number(stem)
        pose = _read_pose(depth.with_name(f"{stem}.pose.txt"))
        if pose is None or number is None:
            skipped += 1
            continue
        color = depth.with_name(f"{stem}.color.png")
        images.append(PosedImage(number, depth, color if color.exists() else None, pose))
    if not images:
        found = f"{skipped} depth images but no valid pose" if skipped else "no depth images"
        raise RecordingError(
            f"{folder}: {found}; expected frame-NNNNNN.depth.png with frame-NNNNNN.pose.txt "
            "(4x4, camera to world)"
        )
    return sorted(images, key=lambda image: image.number), skipped


def _number(stem: str) -> int | None:
    """The number in a file's name; of seconds with a point it is nanoseconds."""
    seconds = re.search(r"(\d+)\.(\d+)", stem)
    if seconds:
        return int(seconds[1] + f"{seconds[2]:0<9.9}")
    digits = "".join(c for c in stem if c.isdigit())
    return int(digits) if digits else None


def time_of_numbers(numbers: Sequence[int], rate: float) -> tuple[float, float]:
    """What one more in the names of files is in time [s], and the frames a second [Hz].

    Args:
        numbers: ascending.
        rate: where they count frames.
    """
    steps = [after - before for before, after in pairwise(numbers) if after > before]
    step = float(np.median(steps)) if steps else 1.0
    unit = EPOCH.get(len(str(numbers[0])))
    if unit is None:
        unit = next((u for u, least in LEAST_STEP.items() if step >= least), None)
    return (1.0 / rate, rate) if unit is None else (unit, 1.0 / (unit * step))


def _read_pose(file: Path) -> Pose | None:
    """A rigid 4x4 transform, its rotation made exact; None where tracking was lost."""
    try:
        T = np.loadtxt(file, dtype=np.float64)
    except (OSError, ValueError):
        return None
    if T.shape != (4, 4) or not np.all(np.isfinite(T)):
        return None
    u, scale, vt = np.linalg.svd(T[:3, :3])
    if np.any(np.abs(scale - 1.0) > 0.05) or np.linalg.det(u @ vt) < 0.0:
        return None
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = u @ vt, T[:3, 3]
    return pose


def read_lens(folder: Path, image: Path) -> PinholeCamera:
    """The depth lens: focal lengths and centre from the file, size from an image.

    Raises:
        RecordingError: the file is missing or no camera matrix.
    """
    name = "camera-intrinsics.txt"
    found = [p / name for p in (image.parent, folder, folder.parent) if (p / name).is_file()]
    if not found:
        raise RecordingError(f"{folder}: {name} is missing (3x3 camera matrix of the depth lens)")
    try:
        K = np.loadtxt(found[0], dtype=np.float64)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{found[0]}: cannot be read: {error}") from error
    if K.shape != (3, 3) or not K[0, 0] > 0 or not K[1, 1] > 0:
        raise RecordingError(f"{found[0]}: found {K.tolist()}, expected a 3x3 camera matrix")
    height, width = read_depth(image).shape
    fx, fy, cx, cy = (float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))
    return PinholeCamera(width, height, fx, fy, cx, cy)


def read_depth(file: Path) -> DepthImage:
    """(h, w) float32 depth [m], NaN where there is no return.

    Raises:
        RecordingError: no 16-bit grey PNG.
    """
    raw = read_picture(file, cv2.IMREAD_UNCHANGED)
    if raw is None or raw.dtype != np.uint16 or raw.ndim != 2:
        kind = "cannot be read" if raw is None else f"is {raw.dtype} with {raw.ndim} axes"
        raise RecordingError(f"{file}: {kind}; expected a 16-bit grey PNG in millimetres")
    missing = (raw == 0) | (raw == 65535)
    return np.where(missing, np.float32(np.nan), raw.astype(np.float32) * np.float32(0.001))


def _deliveries(
    images: Sequence[PosedImage], unit: float, T_base_world: Pose
) -> Iterator[Delivery]:
    none = np.zeros(0)
    for i, image in enumerate(images):
        stamp = (image.number - images[0].number) * unit
        at = round(stamp * 1e9)
        color = None
        if image.color is not None:
            raw = read_picture(image.color, cv2.IMREAD_COLOR)
            color = None if raw is None else np.ascontiguousarray(raw[..., ::-1], np.uint8)
        pose = T_base_world @ image.T_world_camera
        yield Delivery(at, JointState(stamp, none, none))
        depth = read_depth(image.depth)
        yield Delivery(at, RgbdFrame(CAMERA, i, stamp, stamp, depth, color, pose))


def _camera_points(lens: PinholeCamera, depth: DepthImage, step: int = 6) -> Points:
    """(h, w, 3) points [m] of every ``step``-th pixel in the camera's frame."""
    near = np.where((depth > RANGE[0]) & (depth < RANGE[1]), depth, np.nan)[::step, ::step]
    rays = lens.rays[::step, ::step]
    return np.concatenate([rays * near[..., None], near[..., None]], axis=-1)


def _fit(lower: Points, upper: Points, voxel: float) -> tuple[list[float], list[float]]:
    """The box with a margin, no larger than allowed, on whole voxels."""
    x, y, z = LARGEST_BOX
    low = np.floor(np.maximum(lower - 0.1, [-0.5 * x, -0.5 * y, -0.1]) / voxel) * voxel
    high = np.ceil(np.minimum(upper + 0.1, [0.5 * x, 0.5 * y, z - 0.1]) / voxel) * voxel
    return [round(float(v), 6) for v in low], [round(float(v), 6) for v in high]
