"""The joint fit on pictures made small first: it then starts from farther off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Pose
from armsight.charging.fit import Fit, FitOptions, fit
from armsight.charging.looks import look, window_about
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import Port
from armsight.geometry.camera import PinholeCamera


def fit_coarse_to_fine(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    entry: Port,
    T_ref_port: Pose,
    makes: bool = True,
    reach: float = 5.0,
    levels: int = 3,
    coarse_only: bool = False,
) -> Fit:
    """Fit a port to pictures, first made small so that a mouth is about 24 px in radius.

    Args:
        images: grey pictures.
        lenses: of each.
        T_lens_ref: reference frame in each lens's.
        entry: the type.
        T_ref_port: start.
        makes: see :class:`FitOptions`.
        reach: of the search at the smallest size [px].
        levels: most halvings.
        coarse_only: stop after the smallest size: to compare starts.
    """
    extent = max(
        float(np.abs(rim.outline.y) + rim.outline.radius + rim.outline.spread) for rim in entry.rims
    )
    T = T_ref_port
    result: Fit | None = None
    corners: list[Floats] = []
    radius = max(
        lens.fx * entry.radius / max((T_l @ T)[2, 3], 0.05) for lens, T_l in zip(lenses, T_lens_ref)
    )
    halvings = int(np.clip(np.round(np.log2(radius / 24.0)), 0, levels))
    for k in range(halvings, -1, -1):
        scale = 0.5**k
        looks, corners = [], []
        for image, lens, T_l in zip(images, lenses, T_lens_ref):
            window = window_about(lens, T_l @ T, 1.25 * extent)
            if window is None:
                continue
            top, bottom, left, right = window
            part = image[top:bottom, left:right]
            own = replace(
                lens, width=right - left, height=bottom - top, cx=lens.cx - left, cy=lens.cy - top
            )
            if k:
                h, w = int(part.shape[0] * scale), int(part.shape[1] * scale)
                part = np.asarray(cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA), np.uint8)
                own = _resized(own, w, h)
            looks.append(look(part, own, T_l))
            corners.append(np.array([left, top], float))
        if not looks:
            break
        last = k == 0 and not coarse_only
        options = FitOptions(
            reach=reach if k == halvings else 3.5,
            iterations=9 if last else 6,
            makes=makes and last,
            spacing=2.5 if last else 2.0,
        )
        result = fit(looks, entry, T, options)
        T = result.T_ref_port
        if coarse_only:
            break
        if not 0.05 < (T_lens_ref[0] @ T)[2, 3] < 10.0:
            break
    if result is None:
        return _nothing(entry, T_ref_port)
    return replace(result, corners=tuple(corners))


def _resized(lens: PinholeCamera, w: int, h: int) -> PinholeCamera:
    sx, sy = w / lens.width, h / lens.height
    return replace(
        lens,
        width=w,
        height=h,
        fx=lens.fx * sx,
        fy=lens.fy * sy,
        cx=(lens.cx + 0.5) * sx - 0.5,
        cy=(lens.cy + 0.5) * sy - 0.5,
    )


def _nothing(entry: Port, T: Pose) -> Fit:
    model = curves(entry, 0.002)
    none: Ints = np.zeros(0, np.int64)
    return Fit(
        T,
        np.eye(6),
        0.0,
        np.inf,
        0,
        np.zeros((len(model.rims), 4)),
        (),
        none.astype(bool),
        model,
        np.nan,
        np.zeros(len(model.rims)),
    )
