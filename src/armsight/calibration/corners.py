"""Finding and refining corners on grey images; OpenCV's pitfalls are dealt with here.

Checkerboards are found by the newer detector (SB) without its flags and counted again by the
classic one on an enlarged crop: with its accuracy flag SB returned wrong corners for most small
dark boards (61 of 78), while the classic one misses dark boards in large images.
"""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats

_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
_COMFORT = 26.0  # [px] a square of this size is found reliably


def exposure_problem(gray: Bytes) -> str:
    """``black``, ``over-exposed`` or nothing."""
    sample = gray[::4, ::4]
    if float(np.quantile(sample, 0.99)) < 20:
        return "black"
    if float(np.mean(sample >= 250)) > 0.7:
        return "over-exposed"
    return ""


def classic_checkerboard(gray: Bytes, across: int, down: int) -> Floats | None:
    """(across * down, 2) inner corners [px], row by row, or None.

    A board is a cluster of saddle points of the grey values: an image without one is done with at
    once, and the slow detectors look at the cluster alone.
    """
    windows = saddle_windows(gray, across * down)
    if windows:
        windows.append((0, 0, gray.shape[1], gray.shape[0]))  # a board that fills the image
    for x0, y0, x1, y1 in windows:
        found = _search(gray[y0:y1, x0:x1], across, down)
        if found is not None:
            return np.asarray(found + np.array([x0, y0]))
    return None


def saddle_windows(gray: Bytes, corners: int, most: int = 3) -> list[tuple[int, int, int, int]]:
    """Windows (x0, y0, x1, y1) of the image that hold about as many saddle points as a board.

    Where the determinant of the Hessian is strongly negative, dark and light meet crosswise.
    """
    h, w = gray.shape
    scale = 0.5 if w > 1200 else 1.0
    image = gray if scale == 1.0 else _resized(gray, scale)
    smooth = cv2.GaussianBlur(image, (0, 0), 1.6).astype(np.float32)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    strength = xy * xy - xx * yy
    peak = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 60.0)
    v, u = np.nonzero(peak)
    if len(u) < 0.6 * corners:
        return []
    order = np.argsort(-strength[v, u])[: 12 * corners]
    points = np.stack([u[order], v[order]], 1).astype(float)
    out: list[tuple[int, int, int, int]] = []
    for _ in range(most):
        if len(points) < 0.6 * corners:
            break
        gap = np.linalg.norm(points[:, None] - points[None], axis=-1)
        nearest = np.sort(gap, axis=1)
        # Start where points are closest in the way of a grid: their third neighbours are as far as
        # their first ones. Then grow while the next point is within two squares.
        n = min(int(0.4 * corners), len(points) - 1)
        seed = int(np.argmin(nearest[:, n] * (nearest[:, 3] / np.maximum(nearest[:, 1], 1.0))))
        step = 2.1 * nearest[seed, 3]
        near = gap[seed] <= step
        while True:
            grown = (gap[near] <= step).any(0)
            if grown.sum() == near.sum():
                break
            near = grown
        low, high = points[near].min(0), points[near].max(0)
        pad = 0.35 * (high - low).max() + 8.0
        x0, y0 = np.maximum((low - pad) / scale, 0).astype(int)
        x1, y1 = np.minimum((high + pad) / scale, [w, h]).astype(int)
        out.append((int(x0), int(y0), int(x1), int(y1)))
        points = points[~near]
    return out


def _search(gray: Bytes, across: int, down: int) -> Floats | None:
    """Corners in a window, looked for at a size comfortable for the detectors."""
    size = (across, down)
    longer = max(gray.shape)
    # About 30 px a square is best; the window is a board and its margin.
    scale = float(np.clip(30.0 * (max(across, down) + 4) / longer, 0.4, 4.0))
    for factor in (scale, min(1.6 * scale, 4.0)):
        image = _resized(gray, factor)
        # Without flags this detector finds dark and small boards that the classic one misses; its
        # corners are only a start.
        ok, found = cv2.findChessboardCornersSB(image, size, flags=0)
        if not ok:
            ok, found = cv2.findChessboardCorners(
                image, size, flags=_FLAGS | cv2.CALIB_CB_FAST_CHECK
            )
        if ok and found is not None and len(found) == across * down:
            rough = _unscaled(np.asarray(found, float).reshape(-1, 2), factor)
            return _on_crop(gray, rough, across, down)
    return None


def _on_crop(gray: Bytes, rough: Floats, across: int, down: int) -> Floats:
    grid = rough.reshape(down, across, 2)
    step = float(
        min(
            np.linalg.norm(np.diff(grid, axis=1), axis=2).min(),
            np.linalg.norm(np.diff(grid, axis=0), axis=2).min(),
        )
    )
    scale = float(np.clip(np.ceil(_COMFORT / max(step, 1.0)), 1, 4))
    if scale <= 1.0:
        return rough
    pad = 1.8 * float(np.linalg.norm(np.diff(grid, axis=1), axis=2).max()) + 4
    x0, y0 = np.maximum(np.floor(rough.min(0) - pad), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(rough.max(0) + pad), [gray.shape[1], gray.shape[0]]).astype(int)
    crop = _resized(gray[y0:y1, x0:x1], scale)
    ok, found = cv2.findChessboardCorners(crop, (across, down), flags=_FLAGS)
    if not ok:
        return rough
    return np.asarray(
        _unscaled(np.asarray(found, float).reshape(-1, 2), scale) + np.array([x0, y0])
    )


def refine(gray: Bytes, pixel: Floats, across: int, reach: float) -> Floats:
    """Sub-pixel corners: the saddle point of the grey values about each.

    Args:
        gray: the image.
        pixel: (m, 2) rough places.
        across: corners in a row, or 0 when they are not a full grid.
        reach: half width of the window as a share of the distance to the nearest corner.
    """
    pixel = np.ascontiguousarray(pixel, np.float64)
    gaps = np.linalg.norm(pixel[:, None] - pixel[None], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    nearest = float(np.median(gaps.min(1))) if len(pixel) > 1 else 20.0
    shortest = float(gaps.min()) if len(pixel) > 1 else 20.0
    # A crop enlarged to a comfortable size: windows of whole pixels are coarse for small ones.
    scale = int(np.clip(np.ceil(16.0 / max(shortest, 1.0)), 1, 4))
    half = int(np.clip(round(reach * min(nearest, 1.3 * shortest) * scale), 2, 14))
    if scale == 1:
        points = pixel.astype(np.float32).reshape(-1, 1, 2).copy()
        out = cv2.cornerSubPix(gray, points, (half, half), (-1, -1), _STOP)
        refined = np.asarray(out, float).reshape(-1, 2)
    else:
        pad = int(2 * nearest) + 6
        x0, y0 = np.maximum(np.floor(pixel.min(0) - pad), 0).astype(int)
        x1, y1 = np.ceil(pixel.max(0) + pad).astype(int)
        crop = _resized(gray[y0:y1, x0:x1], scale)
        points = _scaled(pixel - [x0, y0], scale).astype(np.float32).reshape(-1, 1, 2)
        out = cv2.cornerSubPix(crop, points, (half, half), (-1, -1), _STOP)
        refined = _unscaled(np.asarray(out, float).reshape(-1, 2), scale) + np.array([x0, y0])
    # A corner that wandered off is better left where it was found.
    moved = np.linalg.norm(refined - pixel, axis=1) > max(0.45 * nearest, 1.5)
    refined[moved] = pixel[moved]
    return refined


def straightness(flat: Floats, pixel: Floats) -> float:
    """Rms distance of corners from the best perspective of a flat board [px]."""
    found: Floats | None = cv2.findHomography(flat, pixel, 0)[0]  # type: ignore[assignment]
    if found is None:
        return float("inf")
    p = np.column_stack([flat, np.ones(len(flat))]) @ found.T
    d = p[:, :2] / p[:, 2:] - pixel
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def _resized(gray: Bytes, scale: float) -> Bytes:
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=method), np.uint8)


def _unscaled(pixel: Floats, scale: float) -> Floats:
    """From a resized image back: pixel centres stay where they belong."""
    return (pixel + 0.5) / scale - 0.5


def _scaled(pixel: Floats, scale: float) -> Floats:
    return (pixel + 0.5) * scale - 0.5
