"""Pictures that a user can afford to keep: fewer, and coded as ROS's image_transport codes them.

Whole pictures of four depth cameras take 2.5 GB a minute, of which depth is nine tenths: noise does
not compress. Small ones take less than 100 MB: each camera's exposures no more often than every
0.5 s; colour as JPEG; depth in steps that grow with its square, as the sensors' noise does
(``compressedDepth``: inverse depth in 16 bits, as PNG). A reader needs nothing of ours for either.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any, TypeVar

import cv2
import numpy as np

from armsight.arrays import ColorImage, DepthImage
from armsight.devices.data import RgbdCameraInfo, RgbdFrame, StereoFrame, StereoInfo
from armsight.errors import RecordingError
from armsight.pictures import decode_picture
from armsight.recording import messages

Info = TypeVar("Info", RgbdCameraInfo, StereoInfo)
PERIOD = 0.5
"""Between two pictures of a camera that are kept [s]."""
WAITS = 0.3
"""A picture without colour is kept only so much later [s], of a camera that shows colour at all."""
QUALITY = 85
"""Of colour, as JPEG has it."""
STEPS = 930.0
"""Steps of inverse depth [1/m]: at Z one of them is Z^2 / 930, 1 mm at 1 m and 4 mm at 2 m."""
FARTHEST = 20.0
"""Farther returns are none [m]."""
LEVEL = 3
"""Of PNG's compression: 7 times as fast as its best, and a tenth larger."""
COLOR, DEPTH = "rgb8; jpeg compressed bgr8", "32FC1; compressedDepth png"


class Thinning:
    """Which of the pictures that come in are kept."""

    def __init__(self) -> None:
        self._last: dict[str, float] = {}
        self._colored: set[str] = set()

    def keeps(self, reading: Any) -> bool:
        """Whether a reading is recorded: all but pictures that come too soon after another."""
        if not isinstance(reading, RgbdFrame | StereoFrame):
            return True
        camera, wait = reading.camera, PERIOD
        if isinstance(reading, RgbdFrame) and reading.color is not None:
            self._colored.add(camera)
        elif camera in self._colored:
            wait += WAITS  # one with colour comes soon
        if reading.stamp < self._last.get(camera, -np.inf) + wait - 0.005:
            return False
        self._last[camera] = reading.stamp
        return True


def thinned(info: Info) -> Info:
    """A camera as the recording knows it: slower."""
    return replace(info, rate=min(info.rate, 1.0 / PERIOD))


def encode_color(color: ColorImage, stamp: float, frame: str) -> bytes:
    """CompressedImage of (h, w, 3) uint8 RGB."""
    shown = cv2.cvtColor(np.ascontiguousarray(color), cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return _message(COLOR, bytes(data), stamp, frame, done)


def encode_depth(depth: DepthImage, stamp: float, frame: str) -> bytes:
    """CompressedImage of (h, w) float32 depth [m], to half a step; NaN is no return."""
    offset = 1.0 - STEPS / FARTHEST
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.round(STEPS / np.asarray(depth, np.float64) + offset)
    value[~((value >= 1.0) & (value <= 65535.0))] = 0.0
    done, data = cv2.imencode(".png", value.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, LEVEL])
    return _message(DEPTH, struct.pack("<iff", 0, STEPS, offset) + bytes(data), stamp, frame, done)


def decode_color(message: Any) -> ColorImage:
    """(h, w, 3) uint8 RGB of a CompressedImage.

    Raises:
        RecordingError: it is no picture.
    """
    image = decode_picture(message.data, cv2.IMREAD_COLOR)
    if image is None:
        raise RecordingError(f"{_whose(message)}: {len(message.data)} bytes that are no picture")
    return np.ascontiguousarray(image[..., ::-1])


def decode_depth(message: Any) -> DepthImage:
    """(h, w) float32 depth [m] of a ``compressedDepth`` CompressedImage, NaN is no return.

    Raises:
        RecordingError: it is none, or not of floating point numbers in PNG.
    """
    data = bytes(message.data)
    if message.format.split(";")[0].strip() != "32FC1" or len(data) < 12:
        raise RecordingError(
            f"{_whose(message)}: depth coded as '{message.format}'; expected '{DEPTH}'"
        )
    _, steps, offset = struct.unpack_from("<iff", data)
    image = decode_picture(data[12:], cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2 or not steps > 0.0:
        raise RecordingError(f"{_whose(message)}: its depth is no 16-bit PNG with its steps")
    value = image.astype(np.float32)
    value[image == 0] = np.nan
    with np.errstate(divide="ignore"):
        return np.asarray(np.float32(steps) / (value - np.float32(offset)), np.float32)


def _message(kind: str, data: bytes, stamp: float, frame: str, done: bool) -> bytes:
    if not done:
        raise RecordingError(f"a picture of {frame} cannot be encoded")
    return messages.encode(
        messages.make(
            messages.COMPRESSED,
            header=messages.header(stamp, frame),
            format=kind,
            data=np.frombuffer(data, np.uint8),
        )
    )


def _whose(message: Any) -> str:
    return f"compressed picture of {message.header.frame_id or 'a camera'}"
