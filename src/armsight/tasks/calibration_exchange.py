"""A cell's calibration as others' files: lenses of ROS and OpenCV, lists of transforms."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from armsight.arrays import Floats, Pose
from armsight.calibration.export import camera_info_yaml, opencv_yaml, transform_entry
from armsight.calibration.layouts.lens_files import read_lenses
from armsight.devices.data import RgbdCameraInfo
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_quaternion, inverse
from armsight.workcell.calibration_file.schema import CalibratedCamera, CellCalibration

Which = Literal["depth", "color"]
QUATERNION = ("qx", "qy", "qz", "qw")
LARGEST = 1_000_000
"""A file of transforms is never larger [bytes]."""


def frame_of(camera: str, which: Which) -> str:
    """What a lens's frame is called, as in recordings."""
    return f"{camera}_{which}_optical_frame"


def exported(calibration: CellCalibration) -> dict[str, str]:
    """Files by name: each lens in ROS's and in OpenCV's layout, and ``tf.yaml``."""
    files: dict[str, str] = {}
    transforms = []
    for camera in calibration.camera:
        place = frame_of(camera.name, "depth")
        transforms.append(transform_entry(camera.mount, place, camera.pose))
        lenses: list[tuple[Which, PinholeCamera]] = [("depth", camera.depth_lens.lens)]
        if camera.color_lens is not None:
            lenses.append(("color", camera.color_lens.lens))
            color = frame_of(camera.name, "color")
            transforms.append(transform_entry(place, color, camera.color_lens.pose))
        for which, lens in lenses:
            name = f"{camera.name}_{which}"
            files[f"{name}.camera_info.yaml"] = camera_info_yaml(name, lens)
            files[f"{name}.opencv.yaml"] = opencv_yaml(lens)
    board = calibration.board
    if board is not None:
        transforms.append(transform_entry(board.mounted_on, "board_middle", board.pose))
    files["tf.yaml"] = yaml.safe_dump(transforms, sort_keys=False)
    return files


@dataclass(frozen=True)
class Placed:
    """A transform of a file: parent and child may be empty where the file does not name them."""

    parent: str
    child: str
    T: Pose


def read_transforms(file: Path) -> list[Placed]:
    """Every transform of a YAML file: ours, ROS's ``TransformStamped`` or easy_handeye's.

    Raises:
        CalibrationError: it cannot be read, or a rotation in it is none.
    """
    try:
        if file.stat().st_size > LARGEST:
            raise CalibrationError(f"{file}: larger than 1 MB, expected a list of transforms")
        text = file.read_text(encoding="utf-8")
        if text.startswith("%YAML:"):  # OpenCV's, which is no YAML: a lens
            return []
        document = yaml.safe_load(text)
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        words = str(error).splitlines()[0]
        raise CalibrationError(f"{file}: cannot be read as YAML: {words}") from None
    return list(_placed(document, file, 0))


def _placed(document: Any, file: Path, depth: int) -> Iterator[Placed]:
    if isinstance(document, list):
        for item in document[:256]:
            yield from _placed(item, file, depth + 1)
        return
    if not isinstance(document, dict) or depth > 4:
        return
    T = _transform(document, file)
    if T is None:
        for value in document.values():
            yield from _placed(value, file, depth + 1)
        return
    header = document.get("header")
    above = header.get("frame_id", "") if isinstance(header, dict) else ""
    child = document.get("child", document.get("child_frame_id"))
    parent = document.get("parent", above)
    yield Placed(str(parent or "").lstrip("/"), str(child or "").lstrip("/"), T)


def _transform(document: dict[Any, Any], file: Path) -> Pose | None:
    """The transform that a mapping is; None for one that is none."""
    for key in ("transform", "transformation"):
        inner = document.get(key)
        if isinstance(inner, dict):
            document = inner
    place = _numbers(document.get("translation"), "xyz") or _numbers(document, "xyz")
    turn = _numbers(document.get("rotation"), "xyzw") or _numbers(document, QUATERNION)
    if place is None or turn is None:
        return None
    length = float(np.linalg.norm(turn))
    if not np.isfinite([*place, *turn]).all() or abs(length - 1.0) > 1e-3:
        raise CalibrationError(
            f"{file}: a rotation x y z w of length {length:.4g}, expected 1: it is no rotation"
        )
    if max(map(abs, place)) > 10.0:
        raise CalibrationError(f"{file}: a translation of {place}, expected metres")
    return from_quaternion(turn, place)


def _numbers(values: Any, keys: str | tuple[str, ...]) -> list[float] | None:
    if isinstance(values, list) and len(values) == len(keys):
        values = dict(zip(keys, values))
    if not isinstance(values, dict):
        return None
    found = [values.get(key) for key in keys]
    if all(isinstance(v, int | float) and not isinstance(v, bool) for v in found):
        return [float(v) for v in found]  # type: ignore[arg-type]
    return None


@dataclass(frozen=True)
class Brought:
    """What files tell of one camera; None where they say nothing.

    Attributes:
        T_mount_depth: the depth lens in base or flange.
        T_depth_color: the colour lens in the depth lens's frame.
        depth, color: the lenses, at the resolutions that the camera has.
    """

    T_mount_depth: Pose | None = None
    T_depth_color: Pose | None = None
    depth: PinholeCamera | None = None
    color: PinholeCamera | None = None


def brought(files: list[Path], info: RgbdCameraInfo, T_world_base: Pose) -> Brought:
    """What the files say of a camera.

    A lens is told by its file's name (``depth``, ``infrared``, ``color``, ``rgb``) or its size; a
    transform by its frames' names, or it is the only one.

    Args:
        files: lenses (ROS, OpenCV, Kalibr ...) and transforms.
        info: what the cell declares of the camera.
        T_world_base: where the arm stands: poses may be in world.

    Raises:
        CalibrationError: a file says nothing of this camera, or what cannot be.
    """
    T_mount: Pose | None = None
    T_color: Pose | None = None
    lenses: dict[Which, PinholeCamera] = {}
    for file in files:
        placed = read_transforms(file) if file.suffix.lower() in (".yaml", ".yml") else []
        if placed:
            mine = _of_camera(placed, info.name)
            if not mine:
                names = ", ".join(p.child or "?" for p in placed)
                raise CalibrationError(
                    f"{file}: no transform of {frame_of(info.name, 'depth')} (it has: {names})"
                )
            for p in mine:
                if p.parent == frame_of(info.name, "depth"):
                    T_color = p.T
                else:
                    T_mount = _in_mount(p, info, T_world_base, file)
            continue
        found = read_lenses(file, info.depth.width, info.depth.height)
        if not found:
            raise CalibrationError(f"{file}: holds neither a lens nor a transform")
        for lens in found:
            which, camera = _which(lens.camera, f"{file.name} {lens.name}", info, file)
            lenses[which] = camera
    return Brought(T_mount, T_color, lenses.get("depth"), lenses.get("color"))


def _of_camera(placed: list[Placed], camera: str) -> list[Placed]:
    """Those of a camera's frames; a lone nameless one is meant for it."""
    wanted = (frame_of(camera, "depth"), frame_of(camera, "color"), camera)
    mine = [p for p in placed if p.child in wanted]
    return mine or (placed if len(placed) == 1 and not placed[0].child else [])


def _in_mount(p: Placed, info: RgbdCameraInfo, T_world_base: Pose, file: Path) -> Pose:
    if p.parent in ("", info.mounted_on, f"{info.mounted_on}_link"):
        return p.T
    if p.parent == "world" and info.mounted_on == "base":
        return np.asarray(inverse(T_world_base) @ p.T)
    raise CalibrationError(
        f"{file}: gives {p.child or 'the camera'} in {p.parent}, expected {info.mounted_on}"
    )


def _which(
    lens: PinholeCamera, words: str, info: RgbdCameraInfo, file: Path
) -> tuple[Which, PinholeCamera]:
    """Which of the camera's lenses a file's is, brought to that lens's resolution."""
    color = info.color
    named = re.search(r"colou?r|rgb", words.lower()) is not None
    depthly = re.search(r"depth|infrared|\bir\b", words.lower()) is not None
    size = (lens.width, lens.height)
    if color is not None and (named or (not depthly and size == (color.width, color.height))):
        which: Which = "color"
        own = color
    else:
        which, own = "depth", info.depth
    if lens.width * own.height != lens.height * own.width:
        raise CalibrationError(
            f"{file}: is of a picture of {lens.width}x{lens.height} px, and the {which} lens of "
            f"{info.name} has {own.width}x{own.height}: another mode, or another camera"
        )
    return which, lens if size == (own.width, own.height) else lens.scaled(own.width / lens.width)


def covariance_of(sigma_m: float, sigma_rad: float) -> Floats:
    """(6, 6) of a pose that is as sure in every direction."""
    return np.diag(np.repeat([sigma_m**2, sigma_rad**2], 3))


def merged(old: CalibratedCamera | None, info: RgbdCameraInfo, new: Brought) -> Brought:
    """What is new, and else what was known, and else what is declared."""
    return Brought(
        _first(new.T_mount_depth, None if old is None else old.pose, info.T_mount_camera),
        _first(
            new.T_depth_color,
            None if old is None or old.color_lens is None else old.color_lens.pose,
            info.T_depth_color,
        ),
        new.depth or (old.depth_lens.lens if old is not None else info.depth),
        new.color
        or (old.color_lens.lens if old is not None and old.color_lens is not None else info.color),
    )


def _first(*poses: Pose | None) -> Pose:
    return next(pose for pose in poses if pose is not None)
