"""The joint fit on pictures made small, to start from farther off, or as fine as they tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32, Ints, Pose
from armsight.charging.fit import MAKE, Fit, FitOptions, fit
from armsight.charging.looks import SMOOTHING, look, window_about
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import Port
from armsight.geometry.camera import PinholeCamera

COARSE = 24.0
"""Radius of a mouth where fits are compared, about [px]."""
SMALL = 48.0
"""A mouth of a smaller radius is looked at twice as large [px]: its edges are some 3 px apart, and
in the picture as it was taken the blur before the gradients draws each towards the next."""
BLURS = (0.0, 2.0 * SMOOTHING)
"""Of what was made larger [px of it]: none, or in the dark as much as pictures have as taken."""


def fit_at_size(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    entry: Port,
    T_ref_port: Pose,
    blur: float | None = None,
) -> Fit:
    """Fit a port to pictures.

    Args:
        images: grey pictures.
        lenses: of each.
        T_lens_ref: reference frame in each lens's.
        entry: the type.
        T_ref_port: start.
        blur: of the pictures, fitted as fine as edges can be told apart and with makes unknown,
            see :func:`blurs_for`; without it they are made small so that a mouth is about 24 px in
            radius, and fitted by the table's measures: to compare starts.
    """
    fine = blur is not None
    extent = max(
        float(np.abs(rim.outline.y) + rim.outline.radius + rim.outline.spread) for rim in entry.rims
    )
    radius = _radius(lenses, T_lens_ref, entry, T_ref_port)
    halvings = int(np.clip(np.round(np.log2(radius / COARSE)), 0, 2))
    scale = (2.0 if radius < SMALL else 1.0) if fine else 0.5**halvings
    looks, corners = [], []
    for image, lens, T_l in zip(images, lenses, T_lens_ref):
        window = window_about(lens, T_l @ T_ref_port, 1.25 * extent)
        if window is None:
            continue
        top, bottom, left, right = window
        part = image[top:bottom, left:right]
        own = lens.window(top, bottom, left, right)
        looks.append(look(*_resized(part, own, scale), T_l, SMOOTHING if blur is None else blur))
        corners.append(np.array([left, top], float))
    if not looks:
        return _nothing(entry, T_ref_port)
    larger = max(scale, 1.0)
    options = FitOptions(
        reach=5.0,
        iterations=9 if fine else 6,
        makes=fine,
        spacing=2.5 * larger if fine else 2.0,
        matched=1.5 * larger,
    )
    result = fit(looks, entry, T_ref_port, options)
    edges = tuple((e + 0.5) / scale - 0.5 for e in result.edges)
    return replace(result, corners=tuple(corners), edges=edges)


def blurs_for(
    lenses: Sequence[PinholeCamera], T_lens_ref: Sequence[Pose], entry: Port, T: Pose
) -> tuple[float, ...]:
    """Blurs to try in the fine fit of a port at about this place: what shows more of it stays."""
    return BLURS if _radius(lenses, T_lens_ref, entry, T) < SMALL else (SMOOTHING,)


def _radius(
    lenses: Sequence[PinholeCamera], T_lens_ref: Sequence[Pose], entry: Port, T: Pose
) -> float:
    """Of the mouth, where it is seen largest [px]."""
    return max(
        lens.fx * entry.radius / max((T_l @ T)[2, 3], 0.05) for lens, T_l in zip(lenses, T_lens_ref)
    )


def _resized(
    part: Bytes, lens: PinholeCamera, scale: float
) -> tuple[Bytes | Floats32, PinholeCamera]:
    """A picture made smaller or larger, and the lens that would have taken it."""
    if scale == 1.0:
        return part, lens
    h, w = int(part.shape[0] * scale), int(part.shape[1] * scale)
    if scale < 1.0:
        seen: Bytes | Floats32 = np.asarray(
            cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA), np.uint8
        )
    else:  # in the dark an edge is a few grey levels high: no rounding
        large = cv2.resize(part.astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC)
        seen = np.asarray(large, np.float32)
    sx, sy = w / lens.width, h / lens.height
    return seen, replace(
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
        np.zeros((len(model.rims), MAKE)),
        (),
        none.astype(bool),
        model,
        np.nan,
        np.zeros(len(model.rims)),
    )
