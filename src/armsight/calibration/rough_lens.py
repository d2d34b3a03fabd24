"""A lens from the pictures alone, good enough to tell readings of poses apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from armsight.calibration.boards import Board, Detection
from armsight.calibration.lens import zhang
from armsight.geometry.camera import PinholeCamera


def rough_lens(
    board: Board, detections: Sequence[Detection], size: tuple[int, int]
) -> PinholeCamera:
    """A lens from the pictures alone, good enough to tell readings of poses apart.

    Zhang's closed form, then focal length and radial distortion by OpenCV over some views; a usual
    lens where the pictures do not tell.
    """
    points = [np.asarray(board.points[d.corner], np.float32) for d in detections]
    pixels = [np.asarray(d.pixel, np.float32) for d in detections]
    found = zhang(points, [d.pixel for d in detections], *size)
    if found is None:
        f = 1.1 * max(size)
        return PinholeCamera(*size, f, f, 0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    pick = np.linspace(0, len(points) - 1, min(len(points), 20)).astype(int)
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
    )  # fmt: skip
    try:
        rms, K, d, _, _ = cv2.calibrateCamera(
            [points[int(k)] for k in pick], [pixels[int(k)] for k in pick], size,
            found.K.copy(), np.zeros(5), flags=flags,
        )  # fmt: skip
    except cv2.error:
        return found
    k1, k2 = (float(v) for v in np.ravel(d)[:2])
    if not np.isfinite(rms) or not 0.6 < K[0, 0] / found.fx < 1.7 or max(abs(k1), abs(k2)) > 3.0:
        return found
    return replace(found, fx=float(K[0, 0]), fy=float(K[1, 1]), distortion=(k1, k2, 0.0, 0.0, 0.0))
