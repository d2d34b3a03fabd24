"""What a recording says of its cell, as text: enough to open it again anywhere.

The numbers are written with Python's shortest exact decimals, so poses and lenses come back bit for
bit; the same things stand in standard messages (``/tf_static``, CameraInfo) for everybody else.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.devices.data import DepthNoise, RgbdCameraInfo, StereoInfo
from armsight.devices.depth_model import DepthModel
from armsight.errors import RecordingError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.shapes import Solid
from armsight.recording.messages import possible

VERSION = "1"
CELL = "armsight.cell"
CAMERA = "armsight.camera/"
STEREO = "armsight.stereo/"


@dataclass(frozen=True)
class CellDescription:
    """What a recording knows of its cell.

    Attributes:
        robot: key of the catalogue, or ``none``; tool: likewise.
        T_world_base: where the robot stands.
        joint_names: of the arm, in the order of joint vectors.
        cameras: what was known of each.
        static: declared solids in ``base``.
        started: wall-clock time of the recording's start, ISO 8601, or empty.
        stereo: what was known of each stereo pair.
        wrench: whether there was a force sensor.
        gripper: greatest width of the gripper [m], or None without one.
    """

    robot: str
    tool: str
    T_world_base: Pose
    joint_names: tuple[str, ...]
    cameras: tuple[RgbdCameraInfo, ...]
    static: tuple[Solid, ...]
    started: str = ""
    stereo: tuple[StereoInfo, ...] = ()
    wrench: bool = False
    gripper: float | None = None


def to_metadata(description: CellDescription) -> dict[str, dict[str, str]]:
    """MCAP metadata records: one for the cell, one a camera."""
    records = {
        CELL: {
            "version": VERSION,
            "robot": description.robot,
            "tool": description.tool,
            "T_world_base": _json(description.T_world_base),
            "joint_names": json.dumps(description.joint_names),
            "cameras": json.dumps([camera.name for camera in description.cameras]),
            "static": json.dumps([_solid_to_dict(solid) for solid in description.static]),
            "started": description.started,
            "stereo": json.dumps([pair.name for pair in description.stereo]),
            "wrench": json.dumps(description.wrench),
            "gripper": json.dumps(description.gripper),
        }
    }
    for pair in description.stereo:
        records[STEREO + pair.name] = {
            "model": pair.model,
            "left": _lens_to_json(pair.left),
            "right": _lens_to_json(pair.right),
            "T_left_right": _json(pair.T_left_right),
            "mounted_on": pair.mounted_on,
            "T_mount_camera": _json(pair.T_mount_camera),
            "rate": repr(float(pair.rate)),
            "latency": repr(float(pair.latency)),
            "covariance": json.dumps(
                None if pair.covariance is None else np.asarray(pair.covariance).tolist()
            ),
        }
    for camera in description.cameras:
        records[CAMERA + camera.name] = {
            "model": camera.model,
            "depth": _lens_to_json(camera.depth),
            "color": "" if camera.color is None else _lens_to_json(camera.color),
            "T_depth_color": _json(camera.T_depth_color),
            "mounted_on": camera.mounted_on,
            "T_mount_camera": _json(camera.T_mount_camera),
            "rate": repr(float(camera.rate)),
            "latency": repr(float(camera.latency)),
            "range": json.dumps([float(value) for value in camera.range]),
            "noise": json.dumps([camera.noise.a, camera.noise.b, camera.noise.c]),
            "guard": json.dumps(camera.guard),
            "infrared_scale": json.dumps(camera.infrared_scale),
            "covariance": json.dumps(
                None if camera.covariance is None else np.asarray(camera.covariance).tolist()
            ),
            "depth_model": json.dumps(_model_to_dict(camera.depth_model)),
        }
    return records


def from_metadata(records: Mapping[str, Mapping[str, str]]) -> CellDescription | None:
    """The description in a file's metadata; None when another program wrote the file.

    Raises:
        RecordingError: the description is of a newer version, or damaged.
    """
    cell = records.get(CELL)
    if cell is None:
        return None
    if cell.get("version") != VERSION:
        raise RecordingError(
            f"the recording's description has version {cell.get('version')!r}; this armsight reads "
            f"version {VERSION}: update armsight"
        )
    try:
        names = json.loads(cell["cameras"])
        return CellDescription(
            cell["robot"],
            cell["tool"],
            _pose(cell["T_world_base"]),
            tuple(json.loads(cell["joint_names"])),
            tuple(_camera(name, records[CAMERA + name]) for name in names),
            tuple(_solid_from_dict(solid) for solid in json.loads(cell["static"])),
            cell.get("started", ""),
            tuple(
                _pair(name, records[STEREO + name]) for name in json.loads(cell.get("stereo", "[]"))
            ),
            bool(json.loads(cell.get("wrench", "false"))),
            json.loads(cell.get("gripper", "null")),
        )
    except Exception as error:  # JSON of any shape and depth
        raise RecordingError(
            f"the recording's description of its cell is damaged ({type(error).__name__}: {error})"
        ) from error


def _camera(name: str, record: Mapping[str, str]) -> RgbdCameraInfo:
    nearest, farthest = json.loads(record["range"])
    return RgbdCameraInfo(
        name,
        record["model"],
        _lens_from_json(record["depth"]),
        _lens_from_json(record["color"]) if record["color"] else None,
        _pose(record["T_depth_color"]),
        record["mounted_on"],
        _pose(record["T_mount_camera"]),
        float(record["rate"]),
        float(record["latency"]),
        (nearest, farthest),
        DepthNoise(*json.loads(record["noise"])),
        bool(json.loads(record.get("guard", "true"))),
        int(json.loads(record.get("infrared_scale", "0"))),
        _covariance(json.loads(record.get("covariance", "null"))),
        _model_from_dict(json.loads(record.get("depth_model", "null"))),
    )


def _covariance(rows: Any) -> Floats | None:
    if rows is None:
        return None
    C = np.array(rows, float)
    if C.shape != (6, 6) or not np.isfinite(C).all():
        raise ValueError(f"a covariance of shape {C.shape} is no 6x6 of finite numbers")
    return C


def _model_to_dict(model: DepthModel | None) -> dict[str, Any] | None:
    if model is None:
        return None
    arrays = {name: getattr(model, name).tolist() for name in ("knots", "values", "surface")}
    return {
        "offset": float(model.offset),
        "scale": float(model.scale),
        **arrays,
        "middle": float(model.middle),
        "range": [float(value) for value in model.range],
        "rms": float(model.rms),
        "scale_known": bool(model.scale_known),
    }


def _model_from_dict(record: Mapping[str, Any] | None) -> DepthModel | None:
    if record is None:
        return None
    near, far = record["range"]
    knots, values, surface = (
        np.array(record[name], float) for name in ("knots", "values", "surface")
    )
    if knots.shape != values.shape or knots.ndim != 1 or surface.shape != (3,):
        raise ValueError("a depth model's curve or surface has another shape")
    return DepthModel(
        float(record["offset"]),
        float(record["scale"]),
        knots,
        values,
        surface,
        float(record["middle"]),
        (float(near), float(far)),
        float(record["rms"]),
        bool(record["scale_known"]),
    )


def _pair(name: str, record: Mapping[str, str]) -> StereoInfo:
    return StereoInfo(
        name,
        record["model"],
        _lens_from_json(record["left"]),
        _lens_from_json(record["right"]),
        _pose(record["T_left_right"]),
        record["mounted_on"],
        _pose(record["T_mount_camera"]),
        float(record["rate"]),
        float(record["latency"]),
        _covariance(json.loads(record.get("covariance", "null"))),
    )


def _lens_to_json(lens: PinholeCamera) -> str:
    numbers = [float(value) for value in (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)]
    return json.dumps([lens.width, lens.height, *numbers])


def _lens_from_json(text: str) -> PinholeCamera:
    width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3 = json.loads(text)
    lens = PinholeCamera(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3))
    if not possible(lens):
        raise ValueError(f"a lens of {width}x{height} pixels, {fx} and {fy} focal lengths, is none")
    return lens


def _solid_to_dict(solid: Solid) -> dict[str, Any]:
    return {
        "name": solid.name,
        "kind": solid.kind,
        "size": [float(value) for value in solid.size],
        "pose": np.asarray(solid.T_frame_solid, float).tolist(),
        "color": [float(value) for value in solid.color],
        "material": solid.material,
        "coarse": float(solid.coarse),
    }


def _solid_from_dict(record: Mapping[str, Any]) -> Solid:
    x, y, z = record["size"]
    red, green, blue = record["color"]
    pose = _checked(np.array(record["pose"], float))
    coarse = float(record.get("coarse", 0.0))
    look = (red, green, blue), record["material"]
    return Solid(record["name"], record["kind"], (x, y, z), pose, *look, coarse)


def _json(pose: Pose) -> str:
    return json.dumps(np.asarray(pose, float).tolist())


def _pose(text: str) -> Pose:
    return _checked(np.array(json.loads(text), float))


def _checked(pose: Pose) -> Pose:
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        raise ValueError(f"a pose of shape {pose.shape} is no 4x4 of finite numbers")
    return pose
