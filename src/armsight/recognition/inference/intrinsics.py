"""The camera of a picture, as its owner gives it, and what a network can make of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from armsight.arrays import ColorImage, Floats
from armsight.errors import RecognitionError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.inference.resample import fit, fit_K

_LARGEST_FILE = 1_000_000
_FOCAL = (0.2, 20.0)
"""Focal length over image width that a lens can have."""


@dataclass(frozen=True)
class View:
    """A picture as a network takes it, and how to get back.

    Attributes:
        image: (h, w, 3) at the network's size.
        K: (3, 3) camera of the picture itself [px].
        distortion: (5,) of the picture's lens.
        given: the camera was given; else it is assumed to be the network's own.
        covered: share of the network's input that the picture fills.
    """

    image: ColorImage
    K: Floats
    distortion: Floats
    given: bool
    covered: float


def view_through(
    image: ColorImage, camera: PinholeCamera | None, K_network: Floats, width: int, height: int
) -> View:
    """A picture as the network's own camera would have taken it from the same place.

    T4's to T7's networks answer in metres without being told the camera: they hold for the one
    that they learned from. Where the picture's camera is known, its rays are taken instead of its
    pixels, so that the metres are right for any lens. Where it is not, the picture is cut to the
    network's shape, and its camera is taken to have the network's field of view.

    Args:
        image: (rows, columns, 3) of any size.
        camera: of the picture, or None.
        K_network: (3, 3) of the network's input [px].
        width: of the network's input [px].
        height: likewise.
    """
    rows, columns = image.shape[:2]
    if camera is None:
        to_network = fit_K(np.eye(3), columns, rows, width, height)
        K = np.linalg.inv(to_network) @ K_network
        return View(fit(image, width, height), K, np.zeros(5), False, 1.0)
    distortion = np.array(camera.distortion)
    # Shrunk by area first: taking single pixels of a large picture would alias.
    share = min(1.0, K_network[0, 0] / camera.fx, K_network[1, 1] / camera.fy)
    small = (max(1, round(share * columns)), max(1, round(share * rows)))
    shrunk = cv2.resize(image, small, interpolation=cv2.INTER_AREA)
    sx, sy = small[0] / columns, small[1] / rows
    K_small = np.array(
        [
            [sx * camera.fx, 0.0, sx * (camera.cx + 0.5) - 0.5],
            [0.0, sy * camera.fy, sy * (camera.cy + 0.5) - 0.5],
            [0.0, 0.0, 1.0],
        ]
    )
    maps = cv2.initUndistortRectifyMap(
        K_small, distortion, np.eye(3), K_network, (width, height), cv2.CV_32FC1
    )
    seen = cv2.remap(shrunk, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    inside = (maps[0] >= -0.5) & (maps[0] < small[0] - 0.5)
    inside &= (maps[1] >= -0.5) & (maps[1] < small[1] - 0.5)
    return View(np.asarray(seen, np.uint8), camera.K, distortion, True, float(inside.mean()))


def project(points: Floats, K: Floats, distortion: Floats) -> Floats:
    """(n, 2) pixels of (n, 3) points in the camera's frame [m]; NaN for those behind it."""
    pixels = np.full((len(points), 2), math.nan)
    front = points[:, 2] > 1e-6
    if front.any():
        found, _ = cv2.projectPoints(
            np.ascontiguousarray(points[front], np.float64),
            np.zeros(3),
            np.zeros(3),
            K,
            distortion,
        )
        pixels[front] = found.reshape(-1, 2)
    return pixels


def parse_intrinsics(text: str, width: int, height: int) -> PinholeCamera:
    """A camera from ``fx,fy,cx,cy`` [px], for a picture of a size.

    Raises:
        RecognitionError: these are no four numbers, or no camera of such a picture.
    """
    try:
        fx, fy, cx, cy = (float(word) for word in text.split(","))
    except ValueError:
        raise RecognitionError(
            f'--intrinsics is "{text}", expected four numbers: fx,fy,cx,cy in pixels'
        ) from None
    camera = PinholeCamera(width, height, fx, fy, cx, cy)
    check_camera(camera, "--intrinsics")
    return camera


def read_camera(file: Path) -> PinholeCamera:
    """A camera from a YAML file in the layout of ROS's camera_info.

    Raises:
        RecognitionError: it cannot be read, a key is missing, or it describes no camera.
    """
    try:
        if file.stat().st_size > _LARGEST_FILE:
            raise RecognitionError(f"{file}: is too large to be a camera's description")
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecognitionError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (UnicodeDecodeError, yaml.YAMLError, RecursionError):
        raise RecognitionError(f"{file}: is no YAML; expected ROS's camera_info layout") from None
    try:
        width, height = map(int, _numbers([data["image_width"], data["image_height"]], 2))
        K = _numbers(data["camera_matrix"]["data"], 9).reshape(3, 3)
        entry = data.get("distortion_coefficients", {"data": [0.0] * 5})
        bent = _numbers(entry["data"], 5)
        model = data.get("distortion_model", "plumb_bob")
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise RecognitionError(
            f"{file}: expected image_width, image_height, camera_matrix with 9 numbers and "
            "distortion_coefficients with 5, as ROS's camera_info has them"
        ) from None
    if model != "plumb_bob":
        raise RecognitionError(f'{file}: distortion_model is "{model}", expected plumb_bob')
    k1, k2, p1, p2, k3 = (float(v) for v in bent)
    camera = PinholeCamera(
        width,
        height,
        float(K[0, 0]),
        float(K[1, 1]),
        float(K[0, 2]),
        float(K[1, 2]),
        (k1, k2, p1, p2, k3),
    )
    check_camera(camera, str(file))
    return camera


def check_camera(camera: PinholeCamera, where: str) -> None:
    """See that these are intrinsics that a camera can have: wrong ones ruin every metre silently.

    Raises:
        RecognitionError: they are not.
    """
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
    if not all(math.isfinite(v) for v in numbers) or camera.width < 1 or camera.height < 1:
        raise RecognitionError(f"{where}: holds something that is no number")
    least, most = (f * camera.width for f in _FOCAL)
    if not (least <= camera.fx <= most and 0.5 <= camera.fy / camera.fx <= 2.0):
        raise RecognitionError(
            f"{where}: focal lengths {camera.fx:g}, {camera.fy:g} px do not suit a picture of "
            f"{camera.width} x {camera.height} px; are they in pixels of this very picture?"
        )
    if not (
        0.1 <= (camera.cx + 0.5) / camera.width <= 0.9
        and 0.1 <= (camera.cy + 0.5) / camera.height <= 0.9
    ):
        raise RecognitionError(
            f"{where}: the principal point {camera.cx:g}, {camera.cy:g} lies at the edge or "
            f"outside of {camera.width} x {camera.height} px; are they of this very picture?"
        )


def check_size(camera: PinholeCamera, width: int, height: int) -> None:
    """See that a camera is of a picture's very size: of another one, it places all wrongly.

    Raises:
        RecognitionError: it is not.
    """
    if (camera.width, camera.height) != (width, height):
        raise RecognitionError(
            f"the camera is of pictures of {camera.width} x {camera.height} px, this one has "
            f"{width} x {height}; scale it (PinholeCamera.scaled, or camera_for)"
        )


def camera_for(
    camera: PinholeCamera, width: int, height: int, where: str, orientation: int = 1
) -> PinholeCamera:
    """The camera for a picture that may be a scaled one of the size it was calibrated at.

    Args:
        camera: as it was calibrated.
        width: of the upright picture [px].
        height: likewise.
        where: the camera is from, for words.
        orientation: of the picture as it lay in its file (EXIF). Where it was turned on its side, a
            camera of lying pictures is turned as well.

    Raises:
        RecognitionError: the picture has another shape: it is of another camera, turned, or cut.
    """
    shape = camera.width / camera.height
    if not _alike(width / height, shape) and _alike(height / width, shape):
        if orientation not in (6, 8):
            raise RecognitionError(
                f"{where}: is for pictures of {camera.width} x {camera.height} px, this one has "
                f"{width} x {height}: it lies on its side; turn it, or calibrate the camera so"
            )
        camera = _on_its_side(camera, orientation == 6)
    if (camera.width, camera.height) == (width, height):
        return camera
    sx, sy = width / camera.width, height / camera.height
    if not _alike(sx, sy):
        raise RecognitionError(
            f"{where}: is for pictures of {camera.width} x {camera.height} px, this one has "
            f"{width} x {height}: it was cut, or another camera took it"
        )
    return PinholeCamera(
        width,
        height,
        sx * camera.fx,
        sy * camera.fy,
        sx * (camera.cx + 0.5) - 0.5,
        sy * (camera.cy + 0.5) - 0.5,
        camera.distortion,
    )


def _alike(a: float, b: float) -> bool:
    return abs(a / b - 1.0) <= 0.01


def _on_its_side(camera: PinholeCamera, clockwise: bool) -> PinholeCamera:
    """The camera of its pictures after a quarter of a turn."""
    c, (k1, k2, p1, p2, k3) = camera, camera.distortion
    if clockwise:  # x, y become -y, x
        cx, cy, bent = c.height - 1 - c.cy, c.cx, (k1, k2, p2, -p1, k3)
    else:
        cx, cy, bent = c.cy, c.width - 1 - c.cx, (k1, k2, -p2, p1, k3)
    return PinholeCamera(c.height, c.width, c.fy, c.fx, cx, cy, bent)


def _numbers(values: Any, count: int) -> Floats:
    array = np.array([float(v) for v in values])
    if len(array) != count:
        raise ValueError(values)
    return array
