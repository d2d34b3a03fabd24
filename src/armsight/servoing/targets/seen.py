"""What every detector needs of a picture: depth inside a region, rays, outlines of a colour."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Mask, Points, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import PosedFrame
from armsight.servoing.segment import (
    LabColor,
    Region,
    color_mask,
    outline,
    regions,
    saturation,
)

BEHIND = 0.15
"""What lies farther behind a region's nearest points is seen past it [m]."""
LEAST, LEAST_PAIR = 12.0, 60.0
"""Fewer pixels are no region: in a fixed camera, in the pair."""
PAD = 12
"""Pixels around a region in which its outline is looked for."""
BEFORE, BESIDE = 0.03, 2.0
"""What is nearer than a target by this much [m], and so near to its outline [px], hides a part of
it: the outline there is that of the other thing."""


def rays_of(lens: PinholeCamera, pixels: Floats) -> Points:
    """(k, 3) unit rays of a lens to (k, 2) pixels."""
    rays = np.column_stack([lens.normalise(pixels), np.ones(len(pixels))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def meeting(one: Vector3, a: Vector3, other: Vector3, b: Vector3) -> tuple[Floats, Vector3, float]:
    """Where two rays pass each other: (2,) how far along each, (3,) the place, and the gap [m].

    Args:
        one: (3,) where the first begins.
        a: (3,) unit, along it.
        other: (3,) where the other begins.
        b: (3,) unit, along it.
    """
    along, *_ = np.linalg.lstsq(np.stack([a, -b], axis=1), other - one, rcond=None)
    ends = one + along[0] * a, other + along[1] * b
    gap = float(np.linalg.norm(ends[0] - ends[1]))
    return np.asarray(along), np.asarray(0.5 * (ends[0] + ends[1])), gap


def outlines_in_frame(
    image: ColorImage, lens: PinholeCamera, color: LabColor, gap: int = 0
) -> list[tuple[Region, Points]]:
    """Regions of a colour in a fixed camera's picture, with the rays of their outlines.

    With a gap: of thin lines, which are not opened, those that lie so near each other [px] are one.
    """
    mask = color_mask(image, color, opening=1 if gap else 3)
    return _outlined(image, lens, color, regions(mask, LEAST, gap=gap))


def outlines_in_pair(
    image: ColorImage, lens: PinholeCamera, color: LabColor
) -> list[tuple[Region, Points]]:
    """The same in one picture of a pair, which is looked through at half its size."""
    halves = regions(_half_size_mask(image, color), LEAST_PAIR / 4.0)
    return _outlined(image, lens, color, [_doubled(half) for half in halves])


def _outlined(
    image: ColorImage, lens: PinholeCamera, color: LabColor, found: list[Region]
) -> list[tuple[Region, Points]]:
    """Those of some regions that have an outline, with the rays of it."""
    outlined = []
    for region in found:
        u, v = region.corner
        h, w = region.mask.shape
        u0, v0 = max(u - PAD, 0), max(v - PAD, 0)
        signal = saturation(image[v0 : v + h + PAD, u0 : u + w + PAD], color)
        inside = Region(region.mask, (u - u0, v - v0), region.center - (u0, v0), region.area)
        edge = outline(signal, inside) + np.array([u0, v0])
        if len(edge) >= 8:
            outlined.append((region, rays_of(lens, edge)))
    return outlined


def half_size_mask(image: ColorImage, color: LabColor) -> Bytes:
    """(h, w) where a picture has a colour, found at half its size."""
    h, w = image.shape[:2]
    mask = _half_size_mask(image, color)
    return np.asarray(cv2.resize(mask, (w, h), interpolation=cv2.INTER_NEAREST), np.uint8)


def _half_size_mask(image: ColorImage, color: LabColor) -> Bytes:
    """(h // 2, w // 2) where a picture has a colour; an odd last row or column is left out."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    small = cv2.resize(image[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)
    return color_mask(np.asarray(small, np.uint8), color)


def _doubled(half: Region) -> Region:
    """A region of a picture of half the size in the whole one."""
    mask = half.mask.repeat(2, axis=0).repeat(2, axis=1)
    corner = (2 * half.corner[0], 2 * half.corner[1])
    return Region(mask, corner, 2.0 * half.center + 0.5, 4.0 * half.area)


def points_of(view: PosedFrame, region: Region, deep: float = BEHIND) -> Points:
    """(k, 3) depth points in ``base`` whose colour pixel lies in a region.

    Args:
        view: of a fixed camera.
        region: of a colour.
        deep: no target reaches farther from its nearest points [m].
    """
    assert view.color_lens is not None
    assert view.T_base_camera is not None
    corner, (h, w) = region.corner, region.mask.shape
    points = _depth_points(view, corner, (h, w))
    pixels = view.color_lens.project(transform(inverse(view.info.T_depth_color), points))
    at = np.rint(np.nan_to_num(pixels, nan=-9.0) - corner).astype(int)
    inside = (at[:, 0] >= 0) & (at[:, 0] < w) & (at[:, 1] >= 0) & (at[:, 1] < h)
    inside[inside] = region.mask[at[inside, 1], at[inside, 0]] > 0
    points = points[inside]
    if len(points):
        # The lenses stand apart: what the target hides from the colour lens is no part of it.
        points = points[points[:, 2] < np.percentile(points[:, 2], 10.0) + deep]
    return transform(view.T_base_camera, points)


def own_outline(view: PosedFrame, region: Region, rays: Points, nearest: float) -> Mask:
    """(k,) which of the (k, 3) rays of a region's outline are its own.

    The others end at something before it, as half a ball does at an arm.

    Args:
        view: of a fixed camera.
        region: of a colour.
        rays: of its outline, unit.
        nearest: distance of the target's nearest point from the colour lens [m].
    """
    lens = view.color_lens
    assert lens is not None
    pad, (u, v), (h, w) = int(BESIDE) + 2, region.corner, region.mask.shape
    points = _depth_points(view, (u - pad, v - pad), (h + 2 * pad, w + 2 * pad))
    points = transform(inverse(view.info.T_depth_color), points)
    before = points[np.einsum("ij,ij->i", points, points) < max(nearest - BEFORE, 0.0) ** 2]
    if not len(before):
        return np.ones(len(rays), bool)
    away = np.linalg.norm(lens.project(rays)[:, None] - lens.project(before)[None], axis=2)
    return np.asarray(~(away < BESIDE).any(axis=1))


def _depth_points(view: PosedFrame, corner: tuple[int, int], shape: tuple[int, int]) -> Points:
    """(k, 3) points of the depth lens's frame that may show a window of the colour picture."""
    window = _depth_window(view, corner, shape)
    if window is None:
        return np.empty((0, 3))
    rows, columns = window
    depth = view.frame.depth[rows, columns]
    good = np.isfinite(depth)
    z, rays = depth[good].astype(float), view.info.depth.rays[rows, columns][good]
    model = view.info.depth_model
    if model is not None:
        v, u = np.nonzero(good)
        at_pixel = np.column_stack([u + columns.start, v + rows.start]).astype(float)
        z = z - model.error(z, at_pixel, view.info.depth)
    return np.column_stack([rays * z[:, None], z])


def _depth_window(
    view: PosedFrame, corner: tuple[int, int], shape: tuple[int, int]
) -> tuple[slice, slice] | None:
    """Rows and columns of the depth picture that may show a window (h, w) of the colour picture."""
    lens, info = view.color_lens, view.info
    assert lens is not None
    (u, v), (h, w) = corner, shape
    box = np.array([[u, v], [u + w, v], [u, v + h], [u + w, v + h]], float)
    rays = np.column_stack([lens.normalise(box), np.ones(4)])
    near, far = info.range
    corners = np.concatenate([rays * z for z in (near, 1.0, 2.0, far)])
    pixels = info.depth.project(transform(info.T_depth_color, corners))
    low = np.floor(np.nanmin(pixels, axis=0)).astype(int) - 2
    high = np.ceil(np.nanmax(pixels, axis=0)).astype(int) + 3
    low = np.maximum(low, 0)
    high = np.minimum(high, [info.depth.width, info.depth.height])
    if (high <= low).any():
        return None
    return slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))
