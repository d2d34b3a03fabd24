"""Reading what people have on disk: lenses, poses, images; every error names file and cure."""

from __future__ import annotations

import csv
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armsight.arrays import Floats
from armsight.calibration.diagnosis.raw_poses import RawPoses
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")


@dataclass(frozen=True)
class PoseFile:
    """Poses with the names that tie them to images.

    Attributes:
        keys: what each pose belongs to: an image's file name, its stem, or a number; empty strings
            where the order alone ties them.
        raw: as written.
        joints: (n, j) [rad], or None.
        source: for messages.
    """

    keys: tuple[str, ...]
    raw: RawPoses
    joints: Floats | None
    source: str


class _OpenCvLoader(yaml.SafeLoader):
    """Safe YAML that reads OpenCV's matrices as plain mappings."""


_OpenCvLoader.add_constructor(
    "tag:yaml.org,2002:opencv-matrix",
    lambda loader, node: loader.construct_mapping(node, deep=True),  # type: ignore[arg-type]
)


def read_yaml(file: Path) -> Any:
    """A YAML file, OpenCV's dialect included.

    Raises:
        CalibrationError: it cannot be read.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{file}: cannot be read: {error}") from None
    if text.startswith("%YAML:"):  # OpenCV's header is not YAML's
        text = text.split("\n", 1)[1] if "\n" in text else ""
    try:
        return yaml.load(text, Loader=_OpenCvLoader)  # noqa: S506  (a SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        raise CalibrationError(f"{file}{where}: is not valid YAML") from None


def _numbers(value: Any) -> Floats | None:
    """The numbers of a list, of a ROS or OpenCV matrix, or of a mapping with ``data``."""
    if isinstance(value, dict):
        value = value.get("data")
    if value is None:
        return None
    try:
        return np.asarray(value, float).ravel()
    except (TypeError, ValueError):
        return None


def read_lens(file: Path, width: int, height: int) -> PinholeCamera | None:
    """A lens from ROS camera_info, OpenCV YAML, a ROS-Industrial or a ViSP file; None if none.

    Raises:
        CalibrationError: the file holds a lens that armsight cannot use, or none can be read.
    """
    if file.suffix == ".xml":
        return _visp_lens(file, width, height)
    document = read_yaml(file)
    if not isinstance(document, dict):
        return None
    w = int(document.get("image_width") or document.get("width") or width)
    h = int(document.get("image_height") or document.get("height") or height)
    if isinstance(document.get("intrinsics"), dict):
        k = document["intrinsics"]
        if {"fx", "fy", "cx", "cy"} <= set(k):
            fx, fy, cx, cy = (float(k[name]) for name in ("fx", "fy", "cx", "cy"))
            return PinholeCamera(w, h, fx, fy, cx, cy)
    matrix = next(
        (
            m
            for key in ("camera_matrix", "cameraMatrix", "K", "k")
            if (m := _numbers(document.get(key))) is not None
        ),
        None,
    )
    if matrix is None or len(matrix) != 9:
        return None
    model = str(document.get("distortion_model", "plumb_bob"))
    if model not in ("plumb_bob", "radtan", "brown", ""):
        raise CalibrationError(
            f"{file}: distortion model '{model}' is not supported; armsight reads plumb_bob"
        )
    d = next(
        (
            v
            for key in (
                "distortion_coefficients",
                "distortionCoefficients",
                "dist_coeffs",
                "D",
                "d",
            )
            if (v := _numbers(document.get(key))) is not None
        ),
        np.zeros(5),
    )
    if len(d) > 5 and np.any(d[5:] != 0):
        raise CalibrationError(f"{file}: {len(d)} distortion numbers; armsight uses k1 k2 p1 p2 k3")
    d = np.concatenate([d, np.zeros(5)])[:5]
    return PinholeCamera(
        w,
        h,
        matrix[0],
        matrix[4],
        matrix[2],
        matrix[5],
        tuple(float(v) for v in d),  # type: ignore[arg-type]
    )


def _visp_lens(file: Path, width: int, height: int) -> PinholeCamera | None:
    try:
        root = ET.parse(file).getroot()  # noqa: S314  (no entities are expanded by us)
    except (ET.ParseError, OSError) as error:
        raise CalibrationError(f"{file}: is not valid XML: {error}") from None
    values = {e.tag: (e.text or "").strip() for e in root.iter() if not len(e)}
    try:
        fx, fy, cx, cy = (float(values[k]) for k in ("px", "py", "u0", "v0"))
    except (KeyError, ValueError):
        return None
    w = int(values.get("image_width", width))
    h = int(values.get("image_height", height))
    k1 = float(values.get("kud", 0.0) or 0.0)
    return PinholeCamera(w, h, fx, fy, cx, cy, (k1, 0.0, 0.0, 0.0, 0.0))


def number_of(name: str) -> str:
    """The last number in a name without leading zeros, or the whole stem."""
    stem = Path(name).stem
    found = re.findall(r"\d+", stem)
    return str(int(found[-1])) if found else stem


def natural(path: Path) -> list[object]:
    """Sort key by which ``2`` comes before ``10``."""
    return [(0, int(t), "") if t.isdigit() else (1, 0, t) for t in re.split(r"(\d+)", path.name)]


def images_in(folder: Path) -> list[Path]:
    """Image files of a folder, or of its ``images`` folder, in natural order."""
    for place in (folder / "images", folder):
        if place.is_dir():
            found = [p for p in place.iterdir() if p.suffix.lower() in IMAGES and p.is_file()]
            if found:
                return sorted(found, key=natural)
    return []


def read_pose_mapping(document: Any, file: Path) -> tuple[Floats, Floats, str]:
    """Position, rotation and its kind of one pose in a YAML or JSON mapping or list."""
    if isinstance(document, dict):
        flat = dict(document)
        for key in (
            "position",
            "translation",
            "t",
            "orientation",
            "rotation",
            "quaternion",
            "pose",
        ):
            inner = flat.get(key)
            if isinstance(inner, dict) and "data" not in inner:
                turned = {"x": "qx", "y": "qy", "z": "qz", "w": "qw"}
                rename = turned if "w" in inner else {}
                flat.update({rename.get(k, k): v for k, v in inner.items()})
        keys = set(flat)
        if {"x", "y", "z", "qx", "qy", "qz", "qw"} <= keys:
            return (
                np.array([flat[k] for k in ("x", "y", "z")], float),
                np.array([flat[k] for k in ("qx", "qy", "qz", "qw")], float),
                "quaternion",
            )
        for names, kind in ((("rx", "ry", "rz"), "vector"), (("roll", "pitch", "yaw"), "rpy")):
            if {"x", "y", "z", *names} <= keys:
                return (
                    np.array([flat[k] for k in ("x", "y", "z")], float),
                    np.array([flat[k] for k in names], float),
                    kind,
                )
        data = _numbers(flat.get("data", flat.get("matrix", flat.get("T"))))
    else:
        data = _numbers(document)
    if data is not None and len(data) == 6:  # ViSP: translation, theta-u
        return data[:3], data[3:], "vector"
    if data is not None and len(data) == 7:
        return data[:3], data[3:], "quaternion"
    if data is not None and len(data) in (12, 16):
        T = data.reshape(-1, 4)
        return T[:3, 3].copy(), T[:3, :3].ravel(), "matrix"
    raise CalibrationError(
        f"{file}: no pose found; write x y z qx qy qz qw, or x y z rx ry rz (axis times angle), "
        "or a 4x4 matrix, of the flange in the base"
    )


def _joined(
    keys: list[str], poses: list[tuple[Floats, Floats, str]], joints: Floats | None, source: str
) -> PoseFile:
    kinds = {kind for _, _, kind in poses}
    if len(kinds) != 1:
        raise CalibrationError(f"{source}: rotations are written in different ways: {kinds}")
    raw = RawPoses(
        np.array([p for p, _, _ in poses]), np.array([r for _, r, _ in poses]), kinds.pop()
    )
    if not (np.isfinite(raw.position).all() and np.isfinite(raw.rotation).all()):
        raise CalibrationError(f"{source}: a pose holds a value that is not a number")
    if raw.kind == "quaternion" and np.any(np.linalg.norm(raw.rotation, axis=1) < 1e-6):
        raise CalibrationError(f"{source}: a quaternion is zero")
    return PoseFile(tuple(keys), raw, joints, source)


def read_poses(folder: Path) -> PoseFile:
    """Poses of a folder, in any of the layouts of :func:`armsight.calibration.recorded_set.load`.

    Raises:
        CalibrationError: there are none, or they cannot be read.
    """
    inner = folder / "poses"
    candidates = sorted(inner.glob("*.y*ml"), key=natural) if inner.is_dir() else []
    if not candidates:
        candidates = sorted(
            (p for p in folder.glob("*.y*ml") if re.search(r"pose.*\d", p.stem)), key=natural
        )
    if candidates:
        poses = [read_pose_mapping(read_yaml(file), file) for file in candidates]
        return _joined(
            [number_of(p.name) for p in candidates], poses, None, candidates[0].parent.name
        )
    for name in ("poses.csv", "poses.txt", "poses.tsv", "robot_poses.csv"):
        if (folder / name).is_file():
            return _table(folder / name)
    for name in ("poses.yaml", "poses.yml", "poses.json"):
        if (folder / name).is_file():
            return _list_file(folder / name)
    raise CalibrationError(
        f"{folder}: no robot poses found; give poses.csv with a header such as "
        "image,x,y,z,qx,qy,qz,qw (T_base_flange in metres), or poses/N.yaml beside images/N.png"
    )


def _list_file(file: Path) -> PoseFile:
    if file.suffix == ".json":
        try:
            document = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CalibrationError(f"{file}: is not valid JSON: {error}") from None
    else:
        document = read_yaml(file)
    if isinstance(document, dict):
        inner = next((v for v in document.values() if isinstance(v, list)), None)
        items: list[tuple[str, Any]] = (
            [("", v) for v in inner] if inner is not None else list(document.items())
        )
    elif isinstance(document, list):
        items = [("", v) for v in document]
    else:
        raise CalibrationError(f"{file}: expected a list of poses")
    keys, poses = [], []
    for key, value in items:
        if isinstance(value, dict):
            key = str(value.get("image", value.get("file", key)))
        poses.append(read_pose_mapping(value, file))
        keys.append(str(key))
    return _joined(keys, poses, None, file.name)


_ALIASES = {
    "tx": "x",
    "ty": "y",
    "tz": "z",
    "px": "x",
    "py": "y",
    "pz": "z",
    "pos_x": "x",
    "pos_y": "y",
    "pos_z": "z",
    "q_x": "qx",
    "q_y": "qy",
    "q_z": "qz",
    "q_w": "qw",
    "file": "image",
    "filename": "image",
    "name": "image",
    "frame": "image",
    "index": "image",
    "id": "image",
}


def _table(file: Path) -> PoseFile:
    try:
        lines = [
            line
            for line in file.read_text(encoding="utf-8-sig").splitlines()
            if line.strip() and not line.lstrip().startswith("#")
        ]
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{file}: cannot be read: {error}") from None
    if not lines:
        raise CalibrationError(f"{file}: is empty")
    delimiter = next((d for d in (",", ";", "\t") if d in lines[0]), " ")
    rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    rows = [[cell.strip() for cell in row if cell.strip() or delimiter != " "] for row in rows]
    header: list[str] | None = None
    if any(re.search("[a-zA-Z]", c) and not re.fullmatch(r"[-+0-9.eE]+", c) for c in rows[0][1:]):
        header = [_ALIASES.get(c.strip().lower(), c.strip().lower()) for c in rows.pop(0)]
    keys, poses, joints = [], [], []
    for number, row in enumerate(rows, 2 if header else 1):
        try:
            key, pose, joint = _row(row, header, file)
        except (ValueError, KeyError):
            raise CalibrationError(
                f"{file}, line {number}: cannot be read as a pose: {' '.join(row)[:60]}"
            ) from None
        keys.append(key)
        poses.append(pose)
        if joint is not None:
            joints.append(joint)
    return _joined(keys, poses, np.array(joints) if len(joints) == len(poses) else None, file.name)


def _row(
    row: list[str], header: list[str] | None, file: Path
) -> tuple[str, tuple[Floats, Floats, str], Floats | None]:
    if header is None:
        key = ""
        if not re.fullmatch(r"[-+0-9.eE]+", row[0]) or len(row) in (8, 13, 17):
            key, row = row[0], row[1:]
        return key, read_pose_mapping([float(c) for c in row], file), None
    cells = dict(zip(header, row))
    key = cells.pop("image", "")
    scale = 1.0
    for unit, factor in (("_mm", 1e-3), ("_m", 1.0)):
        if f"x{unit}" in cells:
            scale = factor
            cells.update({axis: cells.pop(axis + unit) for axis in "xyz"})
    turn = 1.0
    for names in (("rx", "ry", "rz"), ("roll", "pitch", "yaw")):
        if f"{names[0]}_deg" in cells:
            turn = np.pi / 180
            cells.update({n: cells.pop(f"{n}_deg") for n in names})
    joint_names = sorted(
        (n for n in cells if re.fullmatch(r"(j|q|joint_?)\d(_deg)?", n)),
        key=lambda n: int(re.findall(r"\d", n)[0]),
    )
    joint = None
    if joint_names:
        joint = np.array([float(cells.pop(n)) for n in joint_names])
        if joint_names[0].endswith("_deg"):
            joint = np.deg2rad(joint)
    if {"x", "y", "z"} <= set(cells):
        p, r, kind = read_pose_mapping({k: float(v) for k, v in cells.items() if v}, file)
        return key, (p * scale, r * (turn if kind != "quaternion" else 1.0), kind), joint
    return key, read_pose_mapping([float(v) for v in cells.values()], file), joint
