"""What drivers of cameras report and deliver, checked before anybody relies on it."""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Bytes, ColorImage, DepthImage, Pose
from armsight.devices.data import DepthNoise
from armsight.devices.port import CameraReport
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import is_rotation

LEAST_APART, MOST_APART = 0.001, 2.0
"""The lenses of a pair are so far apart [m]."""


def check_lens(name: str, which: str, lens: PinholeCamera) -> None:
    """Intrinsics that a lens can have.

    Raises:
        DeviceError: they cannot be.
    """
    if not (isinstance(lens.distortion, tuple) and len(lens.distortion) == 5):
        raise DeviceError(
            f"{name}: its driver reports a {which} lens with the distortion {lens.distortion!r}, "
            "expected a tuple of 5 numbers: k1, k2, p1, p2, k3"
        )
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    inside = -lens.width < lens.cx < 2 * lens.width and -lens.height < lens.cy < 2 * lens.height
    if not (
        min(lens.width, lens.height) > 0
        and all(math.isfinite(number) for number in numbers)
        and min(lens.fx, lens.fy) > 1.0
        and inside
    ):
        raise DeviceError(
            f"{name}: its driver reports a {which} lens of {lens.width}x{lens.height} px with "
            f"fx {lens.fx:g}, fy {lens.fy:g}, cx {lens.cx:g}, cy {lens.cy:g} px, which cannot be"
        )


def check_range(name: str, reach: tuple[float, float], noise: DepthNoise) -> None:
    """Depths that a camera can measure [m], and how well.

    Raises:
        DeviceError: they cannot be.
    """
    fault = noise.fault(reach)
    if fault:
        raise DeviceError(f"{name}: its driver reports {fault}")


def check_pose(name: str, what: str, pose: Pose) -> None:
    """A pose that a driver reports.

    Raises:
        DeviceError: it is none.
    """
    T = np.asarray(pose)
    if T.shape != (4, 4) or T.dtype.kind not in "fiu" or not np.isfinite(T).all():
        raise DeviceError(f"{name}: its driver reports a {what} that is no 4 x 4 pose")
    if not is_rotation(T[:3, :3], 1e-4):
        raise DeviceError(f"{name}: its driver reports a {what} whose turn is no rotation")


def check_pair(name: str, T_left_right: Pose) -> None:
    """Where the right lens of a pair can be, in the left one's frame.

    Raises:
        DeviceError: it cannot be there.
    """
    check_pose(name, "T_left_right", T_left_right)
    T = np.asarray(T_left_right)
    x, y, z = T[:3, 3]
    apart = float(np.linalg.norm(T[:3, 3]))
    if not LEAST_APART < apart < MOST_APART:
        raise DeviceError(
            f"{name}: its driver reports lenses {apart:g} m apart; expected metres, between "
            f"{LEAST_APART:g} and {MOST_APART:g}"
        )
    if -x > max(abs(y), abs(z)):
        raise DeviceError(
            f"{name}: its driver reports the right lens to the left of the left one, at "
            f"x = {x:g} m of its frame; are the lenses swapped, or the pose inverted?"
        )


def check_rate(name: str, rate: float, latency: float) -> None:
    """A camera's rate [Hz] and latency [s].

    Raises:
        DeviceError: they cannot be.
    """
    if not 0.0 < rate <= 1000.0 or not 0.0 <= latency <= 2.0:
        raise DeviceError(
            f"{name}: its driver reports {rate:g} Hz and a latency of {latency:g} s, expected "
            "up to 1000 Hz and 2 s"
        )


def clean_depth(name: str, depth: DepthImage, lens: PinholeCamera) -> DepthImage:
    """A copy of depth [m] in which everything that is no distance is NaN.

    Raises:
        DeviceError: wrong shape or type, or numbers that look like millimetres.
    """
    depth = np.asarray(depth)
    if depth.shape != (lens.height, lens.width) or depth.dtype != np.float32:
        raise DeviceError(
            f"{name}: depth is {depth.dtype} of shape {depth.shape}, expected float32 metres of "
            f"shape ({lens.height}, {lens.width}) as its lens says"
        )
    with np.errstate(invalid="ignore"):
        clean = np.where((depth > 0.0) & (depth < np.inf), depth, np.float32(np.nan))
    with np.errstate(all="ignore"):
        if np.any(clean > 100.0) and np.nanmedian(clean) > 100.0:
            raise DeviceError(
                f"{name}: depth has a median of {np.nanmedian(clean):.0f}, expected metres; "
                "looks like millimetres"
            )
    clean.flags.writeable = False
    return clean


def checked_color(name: str, which: str, image: ColorImage, lens: PinholeCamera) -> ColorImage:
    """A copy of a picture.

    Raises:
        DeviceError: wrong shape or type.
    """
    image = np.asarray(image)
    if image.shape != (lens.height, lens.width, 3) or image.dtype != np.uint8:
        raise DeviceError(
            f"{name}: {which} is {image.dtype} of shape {image.shape}, expected uint8 RGB of "
            f"shape ({lens.height}, {lens.width}, 3) as its lens says"
        )
    return image.copy()


def checked_infrared(name: str, image: Bytes, report: CameraReport) -> Bytes:
    """A copy of the depth lens's own picture.

    Raises:
        DeviceError: wrong shape or type, or the driver has reported none.
    """
    image, m = np.asarray(image), report.infrared_scale
    shape = (m * report.depth.height, m * report.depth.width)
    if m == 0:
        raise DeviceError(f"{name}: delivers infrared but reports an infrared_scale of 0")
    if image.shape != shape or image.dtype != np.uint8:
        raise DeviceError(
            f"{name}: infrared is {image.dtype} of shape {image.shape}, expected uint8 of shape "
            f"{shape}: {m} times the depth picture's, as its driver reports"
        )
    return image.copy()
