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
SPECKLED = 0.03
"""Windows disagree about most corners by so much of a square where a picture is speckled [1]."""
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
    # The largest board is the one that was meant: a screen in the room may show it once more.
    windows.sort(key=lambda w: -(w[2] - w[0]) * (w[3] - w[1]))
    found: Floats | None = None
    for x0, y0, x1, y1 in windows:
        found = _search(gray[y0:y1, x0:x1], across, down)
        if found is not None:
            found = np.asarray(found + np.array([x0, y0]))
            break
    if windows and found is None:
        found = _search_whole(gray, across, down)
    rest = gray
    for _ in range(3):  # a small one: paint it over, and look for a larger one behind it
        if found is None or np.ptp(found, axis=0).max() > 0.12 * max(gray.shape):
            break
        rest = rest.copy()
        x0, y0 = np.maximum(found.min(0) - 4, 0).astype(int)
        x1, y1 = found.max(0).astype(int) + 5
        rest[y0:y1, x0:x1] = np.median(rest[y0:y1, x0:x1])
        other = _search_whole(rest, across, down)
        if other is None:
            break
        if np.ptp(other, axis=0).max() > np.ptp(found, axis=0).max():
            found = other
    return found


def saddle_windows(gray: Bytes, corners: int, most: int = 3) -> list[tuple[int, int, int, int]]:
    """Windows (x0, y0, x1, y1) of the image that hold about as many saddle points as a board.

    Where the determinant of the Hessian is strongly negative, dark and light meet crosswise.
    """
    h, w = gray.shape
    scale = 0.5 if w > 1200 else 1.0
    image = gray if scale == 1.0 else resized(gray, scale)
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


def _search_whole(gray: Bytes, across: int, down: int) -> Floats | None:
    """Corners in a whole image, at two sizes."""
    found = _search(gray, across, down)
    if found is not None:
        return found
    for longest in (1300.0, 640.0):
        factor = min(longest / max(gray.shape), 1.0)
        image = gray if factor == 1.0 else resized(gray, factor)
        ok, seen = cv2.findChessboardCornersSB(
            image, (across, down), flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if ok and seen is not None:
            return unscaled(np.asarray(seen, float).reshape(-1, 2), factor)
    return None


def _search(gray: Bytes, across: int, down: int) -> Floats | None:
    """Corners in a window, looked for at a size comfortable for the detectors."""
    size = (across, down)
    longer = max(gray.shape)
    # About 30 px a square is best; the window is a board and its margin.
    scale = float(np.clip(30.0 * (max(across, down) + 4) / longer, 0.4, 4.0))
    for factor in (scale, min(1.6 * scale, 4.0)):
        image = resized(gray, factor)
        # Without flags this detector finds dark and small boards that the classic one misses; its
        # corners are only a start.
        ok, found = cv2.findChessboardCornersSB(image, size, flags=0)
        if not ok:
            ok, found = cv2.findChessboardCorners(
                image, size, flags=_FLAGS | cv2.CALIB_CB_FAST_CHECK
            )
        if ok and found is not None and len(found) == across * down:
            rough = unscaled(np.asarray(found, float).reshape(-1, 2), factor)
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
    crop = resized(gray[y0:y1, x0:x1], scale)
    ok, found = cv2.findChessboardCorners(crop, (across, down), flags=_FLAGS)
    if not ok:
        return rough
    return np.asarray(unscaled(np.asarray(found, float).reshape(-1, 2), scale) + np.array([x0, y0]))


def refine(gray: Bytes, pixel: Floats, across: int, reach: float = 0.42) -> Floats:
    """Sub-pixel corners: the saddle point of the grey values about each.

    The window of a corner fits its own square, the shortest way to a neighbour, so that it holds
    one saddle however slanted the board is. Where windows of several sizes disagree, something
    else than the corner is in the larger one (a rim, glare, the next square): the smaller one is
    believed. In full grids a corner that lies off the smooth surface of the others is not given.

    Args:
        gray: the image.
        pixel: (m, 2) rough places.
        across: corners in a row, or 0 when they are not a full grid.
        reach: half width of the window as a share of the distance to the nearest corner.

    Returns:
        (m, 2); NaN where the image has no corner.
    """
    pixel = np.ascontiguousarray(pixel, np.float64)
    near = _nearest_corner(pixel)
    # A crop enlarged to a comfortable size: windows of whole pixels are coarse for small squares.
    scale = int(np.clip(np.ceil(16.0 / max(float(np.median(near)), 1.0)), 1, 4))
    pad = int(2 * float(near.max())) + 6
    x0, y0 = np.maximum(np.floor(pixel.min(0) - pad), 0).astype(int)
    x1, y1 = np.ceil(pixel.max(0) + pad).astype(int)
    crop = gray[y0:y1, x0:x1] if scale == 1 else resized(gray[y0:y1, x0:x1], scale)
    rough = scaled(pixel - [x0, y0], scale)
    tries = [_saddles(crop, rough, near * scale, share * reach) for share in (1.0, 0.6)]
    if _speckled(near * scale, tries):
        # A projector's dots, or coarse noise: saddles of the smoothed picture are the corners'.
        blur = 0.12 * float(np.median(near)) * scale
        smooth = np.asarray(cv2.GaussianBlur(crop, (0, 0), blur), np.uint8)
        tries = [_saddles(smooth, rough, near * scale, share * reach) for share in (1.0, 0.6)]
    refined = tries[0]
    apart = np.linalg.norm(tries[0] - tries[1], axis=1)
    usual = max(float(np.nanmedian(apart)), 0.05)
    doubtful = apart > 4.0 * usual
    refined[doubtful] = tries[1][doubtful]
    refined = unscaled(refined, scale) + np.array([x0, y0])
    # A corner that wandered off is better left where it was found.
    moved = ~(np.linalg.norm(refined - pixel, axis=1) <= np.maximum(0.3 * near, 1.5))
    refined[moved] = pixel[moved]
    if across and len(pixel) >= 4 * across and len(pixel) % across == 0 and len(pixel) >= 16:
        off = _off_surface(refined, across)
        refined[off > np.maximum(0.3, 8.0 * np.median(off))] = np.nan
    return refined


def _speckled(near: Floats, tries: list[Floats]) -> bool:
    """Whether windows of two sizes disagree about most corners."""
    apart = np.linalg.norm(tries[0] - tries[1], axis=1) / near
    return bool(np.median(near) > 8.0 and np.nanmedian(apart) > SPECKLED)


def _nearest_corner(pixel: Floats) -> Floats:
    """(m,) distance of each corner to the nearest other one [px]."""
    if len(pixel) < 2:
        return np.full(len(pixel), 20.0)
    gaps = np.linalg.norm(pixel[:, None] - pixel[None], axis=-1)
    np.fill_diagonal(gaps, np.inf)
    return np.asarray(gaps.min(1), np.float64)


def _saddles(gray: Bytes, pixel: Floats, near: Floats, reach: float) -> Floats:
    """Corners refined in windows of half width ``reach * near``, whole pixels, 2 to 14."""
    half = np.clip(np.rint(reach * near), 2, 14).astype(int)
    out = pixel.copy()
    for size in np.unique(half):
        mine = half == size
        points = pixel[mine].astype(np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(gray, points, (int(size), int(size)), (-1, -1), _STOP)
        out[mine] = np.asarray(found, float).reshape(-1, 2)
    return out


def _off_surface(pixel: Floats, across: int) -> Floats:
    """(m,) distance of grid corners from a smooth surface through the others [px].

    A perspective with a cubic bend (the lens), fitted without what does not fit.
    """
    m = len(pixel)
    j, i = np.divmod(np.arange(m), across)
    flat = np.stack([i / (across - 1) - 0.5, j / max(m // across - 1, 1) - 0.5], axis=1)
    good = np.ones(m, bool)
    away = np.zeros(m)
    for _ in range(3):
        H: Floats | None = cv2.findHomography(flat[good], pixel[good], 0)[0]  # type: ignore[assignment]
        if H is None:
            return away
        p = np.column_stack([flat, np.ones(m)]) @ H.T
        left = pixel - p[:, :2] / p[:, 2:]
        x, y = flat.T
        A = np.stack([np.ones(m), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], 1)
        bend = np.linalg.lstsq(A[good], left[good], rcond=1e-9)[0]
        away = np.linalg.norm(left - A @ bend, axis=1)
        good = away <= max(4.0 * float(np.median(away)), 0.1)
        if good.sum() < 14:
            return away
    return away


def straightness(flat: Floats, pixel: Floats) -> float:
    """Rms distance of corners from the best perspective of a flat board [px]."""
    found: Floats | None = cv2.findHomography(flat, pixel, 0)[0]  # type: ignore[assignment]
    if found is None:
        return float("inf")
    p = np.column_stack([flat, np.ones(len(flat))]) @ found.T
    d = p[:, :2] / p[:, 2:] - pixel
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))


def resized(gray: Bytes, scale: float) -> Bytes:
    """An image enlarged (cubic) or shrunk (by areas)."""
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=method), np.uint8)


def unscaled(pixel: Floats, scale: float) -> Floats:
    """From a resized image back: pixel centres stay where they belong."""
    return (pixel + 0.5) / scale - 0.5


def scaled(pixel: Floats, scale: float) -> Floats:
    """Into a resized image: pixel centres stay where they belong."""
    return (pixel + 0.5) * scale - 0.5
