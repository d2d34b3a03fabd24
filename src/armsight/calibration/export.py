"""Results as files that others read: ROS, OpenCV, a TF list, and the cell's own workcell.toml.

Nothing good is overwritten by something worse without being told: the summary of an earlier
calibration in the folder is compared first.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armsight.arrays import Floats, Pose
from armsight.calibration.calibrate import Calibration
from armsight.calibration.findings import Finding
from armsight.devices.depth_model import DepthModel
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import to_quaternion
from armsight.writing import write_text

SUMMARY = "calibration.json"


def camera_info_yaml(name: str, lens: PinholeCamera) -> str:
    """A lens in the layout of ROS ``camera_calibration`` (``camera_info`` YAML)."""
    document = {
        "image_width": lens.width,
        "image_height": lens.height,
        "camera_name": name,
        "camera_matrix": _matrix(lens.K),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": _matrix(np.array([lens.distortion])),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.hstack([lens.K, np.zeros((3, 1))])),
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None)


def _matrix(M: Floats) -> dict[str, Any]:
    return {"rows": M.shape[0], "cols": M.shape[1], "data": [float(v) for v in M.ravel()]}


def opencv_yaml(lens: PinholeCamera) -> str:
    """A lens in the layout of OpenCV's ``FileStorage``."""

    def matrix(name: str, M: Floats) -> str:
        data = ", ".join(
            f"{v:.17g}" if not float(v).is_integer() else f"{v:.0f}." for v in M.ravel()
        )
        return (
            f"{name}: !!opencv-matrix\n   rows: {M.shape[0]}\n   cols: {M.shape[1]}\n   dt: d\n"
            f"   data: [ {data} ]\n"
        )

    return (
        "%YAML:1.0\n---\n"
        f"image_width: {lens.width}\nimage_height: {lens.height}\n"
        + matrix("cameraMatrix", lens.K)
        + matrix("distortionCoefficients", np.array([lens.distortion]))
    )


def tf_list(calibration: Calibration) -> list[dict[str, Any]]:
    """Every solved transform: parent, child, translation [m], rotation x y z w."""
    problem = calibration.problem
    frame = [f"{name}_optical_frame" for name in file_names([k.name for k in problem.lenses])]
    out = []
    for index, rig in enumerate(problem.rigs):
        main = calibration.main_lens(index)
        out.append(transform_entry(rig.mount, frame[main], calibration.camera_pose(index)))
    for index, lens in enumerate(problem.lenses):
        if lens.offset_free:
            main = calibration.main_lens(lens.rig)
            out.append(transform_entry(frame[main], frame[index], calibration.lens_pose(index)))
    for index, board in enumerate(problem.boards):
        out.append(transform_entry(board.mount, board.name, calibration.board_pose(index)))
    return out


def transform_entry(parent: str, child: str, T: Pose) -> dict[str, Any]:
    """A transform as a list of them has it: ``T_parent_child``, metres, rotation x y z w."""
    return {
        "parent": parent,
        "child": child,
        "translation": dict(zip("xyz", (float(v) for v in T[:3, 3]))),
        "rotation": dict(zip("xyzw", (float(v) for v in to_quaternion(T)))),
    }


def summary(
    calibration: Calibration,
    depth: tuple[DepthModel | None, ...] = (),
    findings: tuple[Finding, ...] = (),
) -> dict[str, Any]:
    """The answer with its uncertainty, as JSON knows it."""
    problem = calibration.problem
    cameras = []
    for index, rig in enumerate(problem.rigs):
        sigma = np.sqrt(np.maximum(np.diagonal(calibration.covariance.camera_pose(index)), 0.0))
        cameras.append(
            {
                "name": rig.name,
                "mount": rig.mount,
                "T_mount_camera": calibration.camera_pose(index).tolist(),
                "sigma_translation_m": sigma[:3].tolist(),
                "sigma_rotation_rad": sigma[3:].tolist(),
                "lenses": [
                    _lens(calibration, k)
                    for k, lens in enumerate(problem.lenses)
                    if lens.rig == index
                ],
                "depth": _depth(depth[index]) if index < len(depth) else None,
            }
        )
    left = calibration.left_out
    return {
        "cameras": cameras,
        "boards": [
            {"name": b.name, "mount": b.mount, "T_mount_board": calibration.board_pose(k).tolist()}
            for k, b in enumerate(problem.boards)
        ],
        "views": len(problem.used_views),
        "target_sigma_m": worst_target(calibration),
        "left_out": None if left is None else {"px": left.px, "mm": left.mm},
        "dropped_boards": [reason for _, reason in calibration.rejected],
        "findings": [
            {"code": f.code, "severity": f.severity, "message": f.message, "cure": f.cure}
            for f in findings
        ],
    }


def _lens(calibration: Calibration, index: int) -> dict[str, Any]:
    lens = calibration.lens(index)
    return {
        "name": calibration.problem.lenses[index].name,
        "width": lens.width,
        "height": lens.height,
        "fx": lens.fx,
        "fy": lens.fy,
        "cx": lens.cx,
        "cy": lens.cy,
        "distortion": list(lens.distortion),
        "T_camera_lens": calibration.lens_pose(index).tolist(),
        "rms_px": calibration.solution.rms_px(index),
        "target_sigma_m": calibration.target_sigma(index),
    }


def _depth(model: DepthModel | None) -> dict[str, Any] | None:
    if model is None:
        return None
    return {
        "offset_m": model.offset,
        "scale": model.scale if model.scale_known else None,
        "middle_m": model.middle,
        "knots_m": model.knots.tolist(),
        "values_m": model.values.tolist(),
        "surface_m": model.surface.tolist(),
        "range_m": list(model.range),
    }


def worst_target(calibration: Calibration) -> float:
    """The largest expected target error of all lenses that took part [m]."""
    used = sorted({s.lens for s in calibration.problem.sightings})
    return max(calibration.target_sigma(k) for k in used)


def write_results(
    folder: Path,
    calibration: Calibration,
    depth: tuple[DepthModel | None, ...] = (),
    findings: tuple[Finding, ...] = (),
    force: bool = False,
) -> list[Path]:
    """Write everything into a folder; returns the files.

    Raises:
        CalibrationError: a better calibration stands there already, or it cannot be written.
    """
    old = _old_target(folder / SUMMARY)
    new = worst_target(calibration)
    wrong = next((f for f in findings if f.severity == "error"), None)
    if old is not None and not force:
        now = f"now {1e3 * new:.1f} mm" if wrong is None else f"now: {wrong.message}"
        if wrong is not None or not new <= 1.25 * old:
            raise CalibrationError(
                f"{folder}: the calibration there is better (points to {1e3 * old:.1f} mm, {now}); "
                "nothing was overwritten: write elsewhere, or use --force"
            )
    files: list[Path] = []

    def put(name: str, text: str) -> None:
        write_text(folder / name, text, CalibrationError)
        files.append(folder / name)

    names = file_names([lens.name for lens in calibration.problem.lenses])
    for index, name in enumerate(names):
        put(f"{name}.camera_info.yaml", camera_info_yaml(name, calibration.lens(index)))
        put(f"{name}.opencv.yaml", opencv_yaml(calibration.lens(index)))
    put("tf.yaml", yaml.safe_dump({"transforms": tf_list(calibration)}, sort_keys=False))
    text = json.dumps(_finite(summary(calibration, depth, findings)), indent=2, allow_nan=False)
    put(SUMMARY, text + "\n")
    return files


def file_names(names: Sequence[str]) -> list[str]:
    """Names of files for cameras or lenses, each its own, whatever alphabet they are written in."""
    out: list[str] = []
    for name in names:
        word = re.sub(r"[\W_]+", "_", name.lower()).strip("_") or "camera"
        more = (f"{word}_{k}" for k in range(2, len(names) + 2))
        out.append(word if word not in out else next(w for w in more if w not in out))
    return out


def _old_target(file: Path) -> float | None:
    """What the calibration there is sure to [m]; None where there is none, or a wrong one."""
    try:
        old = json.loads(file.read_text(encoding="utf-8"))
        if any(f["severity"] == "error" for f in old.get("findings", ())):
            return None
        return float(old["target_sigma_m"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
