"""Where black plastic may be: the darker-than-average regions of a picture."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes


def dark_windows(image: Bytes, margin: int = 40, most: int = 4) -> list[tuple[int, int, int, int]]:
    """Windows (top, bottom, left, right) [px] about the darker regions; largest first."""
    small = cv2.resize(image, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
    dark = (small < 0.7 * float(small.mean())).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(dark)
    h, w = image.shape
    out = []
    for i in np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:most] + 1:
        x, y, dx, dy, area = (int(v) for v in stats[i])
        if area >= 4:
            out.append(
                (
                    max(0, 8 * y - margin),
                    min(h, 8 * (y + dy) + margin),
                    max(0, 8 * x - margin),
                    min(w, 8 * (x + dx) + margin),
                )
            )
    return out
