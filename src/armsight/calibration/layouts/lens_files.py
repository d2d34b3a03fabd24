"""Lenses as people keep them: ROS camera_info, OpenCV, Kalibr, ViSP, ROS-Industrial."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import Floats
from armsight.calibration.layouts.array_files import ARRAYS, as_document, read_arrays
from armsight.calibration.layouts.structured import _numbers as listed
from armsight.calibration.layouts.structured import read_document
from armsight.calibration.layouts.table import read_text
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera

LENSES = (".yaml", ".yml", ".xml", ".json", ".npz", ".mat", ".txt", ".ini", ".cfg", ".conf")
"""Endings of files that may hold a lens."""
MATRICES = ("camera_matrix", "cameramatrix", "k", "intrinsic_matrix", "camera_intrinsics", "mtx",
            "intrinsicmatrix", "intrinsic", "intrinsics", "camera_intrinsic", "cam_k", "intr",
            "kmat", "matrix")  # fmt: skip
DISTORTIONS = ("distortion_coefficients", "distortioncoefficients", "dist_coeffs", "distcoeffs",
               "d", "dist", "distortion_coeffs", "distortion", "distcoeff", "dist_coef",
               "dist_coefs", "distortion_coefficient", "kc")  # fmt: skip

LEAST_FOCAL = 5.0
"""No camera has a shorter lens [px]."""


class UnusableLens(CalibrationError):
    """A file holds a lens of a model that armsight does not use."""


@dataclass(frozen=True)
class LensFile:
    """A lens as a file gives it.

    Attributes:
        camera: its numbers, for the size that it names or was given.
        sized: the file itself names the size of its pictures.
        bent: the file gives a distortion (maybe zero).
        source: the file.
        name: of the camera, where the file has several or says so.
        sigma: (9,) standard deviations of fx fy cx cy k1 k2 p1 p2 k3, where the file gives them.
    """

    camera: PinholeCamera
    sized: bool
    bent: bool
    source: Path
    name: str = ""
    sigma: Floats | None = None


def read_lenses(file: Path, width: int, height: int) -> list[LensFile]:
    """Every lens of a file; none when it holds none.

    Raises:
        CalibrationError: it holds a lens that armsight cannot use, or cannot be read.
    """
    suffix = file.suffix.lower()
    if suffix in (".txt", ".ini", ".cfg", ".conf"):
        return _of_text(read_text(file), file, width, height)
    document = as_document(read_arrays(file)) if suffix in ARRAYS else read_document(file)
    return _lenses(document, file, width, height, "", 0)


def _lenses(
    document: Any, file: Path, width: int, height: int, name: str, depth: int
) -> list[LensFile]:
    if not isinstance(document, dict) or depth > 4:
        return []
    low = {str(k).strip().lower(): v for k, v in document.items()}
    one = _lens(low, file, width, height, name)
    if one is not None:
        return [one]
    out = []
    for key, value in document.items():
        if isinstance(value, dict):
            out += _lenses(value, file, width, height, str(key), depth + 1)
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            for inner in value[:16]:
                out += _lenses(inner, file, width, height, str(key), depth + 1)
    return out


def _lens(low: dict[str, Any], file: Path, width: int, height: int, name: str) -> LensFile | None:
    found = _pinhole(low, file)
    if found is None:
        if len(listed(low.get("intrinsics")) or []) in (5, 6):  # Kalibr's other models
            _refuse_other_model(low, file)
        return None
    fx, fy, cx, cy = found
    if 0 < fx < LEAST_FOCAL and 0 < fy < LEAST_FOCAL:
        return None  # a rotation, or a lens in other units
    if not (fx > 0 and fy > 0 and np.isfinite([fx, fy, cx, cy]).all()):
        raise CalibrationError(f"{file}: the lens has no positive focal length ({fx:g}, {fy:g})")
    size = listed(low.get("resolution")) or listed(low.get("image_size")) or []
    w = _pixels(low, "width", size, 0)
    h = _pixels(low, "height", size, 1)
    _refuse_other_model(low, file)
    model = str(low.get("distortion_model", "") or "").lower()
    if model not in ("plumb_bob", "radtan", "brown", "rational_polynomial", "none", ""):
        raise UnusableLens(
            f"{file}: distortion model '{model}' is not supported; armsight reads plumb_bob"
        )
    given = next((v for key in DISTORTIONS if (v := listed(low.get(key))) is not None), None)
    if given is None and _is_scalar(low.get("kud")):  # ViSP: one radial number
        given = [float(low["kud"])]
    d = np.array(given if given is not None else [], float)
    if len(d) > 5 and np.any(d[5:] != 0):
        raise UnusableLens(f"{file}: {len(d)} distortion numbers; armsight uses k1 k2 p1 p2 k3")
    if not np.isfinite(d).all():
        raise UnusableLens(f"{file}: not every distortion number is finite ({d.tolist()})")
    d = np.concatenate([d, np.zeros(5)])[:5]
    sigma = listed(low.get("sigma"))
    camera = PinholeCamera(
        w or width,
        h or height,
        fx,
        fy,
        cx,
        cy,
        tuple(float(v) for v in d),  # type: ignore[arg-type]
    )
    label = low.get("camera_name")
    return LensFile(
        camera,
        bool(w and h),
        given is not None,
        file,
        str(label) if isinstance(label, str) else name,
        np.array(sigma) if sigma is not None and len(sigma) == 9 else None,
    )


OTHER_MODELS = re.compile(
    r"fish.?eye|equidist|kannala|omni|mei\b|unified|double.?sphere|\be?ucm\b|f.?theta|\bfov\b|\bds\b"
)
"""Words for lenses that are no pinhole with radial and tangential distortion."""


def _refuse_other_model(low: dict[str, Any], file: Path) -> None:
    for key in ("camera_model", "model", "lens_model", "projection_model", "camera_type"):
        word = low.get(key)
        if isinstance(word, str) and OTHER_MODELS.search(word.lower()):
            raise UnusableLens(f"{file}: lens model '{word}' is not supported; it is no pinhole's")
    if low.get("fisheye_model") or low.get("fisheye"):  # OpenCV's sample writes 1
        raise UnusableLens(f"{file}: the lens is a fisheye's, which is not supported")


def _pixels(low: dict[str, Any], side: str, size: list[float], at: int) -> int:
    """A side of the pictures [px]; 0 where the file does not say."""
    value = low.get(f"image_{side}") or low.get(side) or (size[at] if len(size) == 2 else 0)
    return int(value) if _is_scalar(value) and 0 < value < 1e6 else 0


def _pinhole(low: dict[str, Any], file: Path) -> tuple[float, float, float, float] | None:
    given = (listed(low.get(key)) for key in MATRICES)
    matrix = next((m for m in given if m is not None and len(m) == 9), None)
    if matrix is not None and matrix[8] == 1 and matrix[1] < 0.1 * abs(matrix[0]):
        if matrix[2] == 0 and matrix[6] > 1:  # MATLAB keeps it transposed
            matrix = list(np.array(matrix).reshape(3, 3).T.ravel())
        return matrix[0], matrix[4], matrix[2], matrix[5]
    four = listed(low.get("intrinsics"))  # Kalibr: fx fy cx cy
    if four is not None and len(four) == 4:
        return four[0], four[1], four[2], four[3]
    for keys in (("fx", "fy", "cx", "cy"), ("px", "py", "u0", "v0"), ("fx", "fy", "ppx", "ppy")):
        values = [low.get(k) for k in keys]
        if all(_is_scalar(v) for v in values):
            a, b, c, d = (float(v) for v in values)  # type: ignore[arg-type]
            return a, b, c, d
    return None


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def _of_text(text: str, file: Path, width: int, height: int) -> list[LensFile]:
    """A lens in plain text, by the look of its nine numbers; ROS's ``ost.txt`` with its size."""
    numbers = [float(v) for v in _NUMBER.findall(text[:20_000])]
    for at in range(len(numbers) - 8):
        m = numbers[at : at + 9]
        if not (m[6] == m[7] == m[3] == 0.0 and m[8] == 1.0 and abs(m[1]) < 0.1 * m[0]):
            continue
        if not (20 < m[0] < 1e5 and 0.5 < m[4] / m[0] < 2 and m[2] > 0 and m[5] > 0):
            continue
        rest = numbers[at + 9 : at + 14]
        bent = len(rest) >= 4 and max(abs(v) for v in rest[:4]) < 3.0
        low: dict[str, Any] = {"camera_matrix": m}
        if bent:
            low["distortion"] = rest if len(rest) == 5 and abs(rest[4]) < 20 else rest[:4]
        size = {
            word: int(found.group(1))
            for word in ("width", "height")
            if (found := re.search(rf"{word}\W+(\d+)", text, re.IGNORECASE))
        }
        one = _lens({**low, **size}, file, width, height, "")
        return [one] if one is not None else []
    return []


def _is_scalar(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
