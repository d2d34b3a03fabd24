"""V's wrist stereo: depth by 30 planes between 0.20 and 0.40 m, about 7 mm apart."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import ColorImage, Floats, Floats32, Ints, Points
from armsight.motion.perception import PosedPair
from armsight.servoing.segment import Region

PLANES = 30
NEAR, FAR = 0.20, 0.40
"""Nearest and farthest plane [m] (V)."""
DRAWN, CLEAR = 6, 0.25
"""Of so many pixels one is drawn, each way; where the best plane agrees worse than by this share of
what all do, nothing is said."""


def plane_sweep(view: PosedPair, region: Region, step: int = 3) -> Points:
    """(k, 3) points of a region of the left picture, in the left lens's frame [m].

    Every ``step``-th pixel takes the plane on which the right picture agrees best; the planes are
    equally spaced in depth, as V's steps of 7 mm are.
    """
    (u0, v0), (h, w) = region.corner, region.mask.shape
    v, u = np.mgrid[v0 : v0 + h : step, u0 : u0 + w : step]
    rays, depth, _ = _swept(view, u, v)
    inside = region.mask[v - v0, u - u0] > 0
    return np.asarray(rays[inside] * depth[inside].astype(float)[:, None])


def depth_picture(view: PosedPair, step: int = DRAWN) -> ColorImage:
    """What the planes say of the whole left picture, to look at: near is red, far is blue.

    Dark where no plane agrees better than the others: nothing to tell places apart by, or nothing
    between the nearest plane and the farthest.
    """
    h, w = view.frame.left.shape[:2]
    v, u = np.mgrid[step // 2 : h : step, step // 2 : w : step]
    _, depth, clear = _swept(view, u, v)
    level = np.rint(255.0 * (FAR - depth) / (FAR - NEAR)).astype(np.uint8)
    shown = cv2.cvtColor(cv2.applyColorMap(level, cv2.COLORMAP_TURBO), cv2.COLOR_BGR2RGB)
    shown[clear > CLEAR] //= 6
    return np.asarray(shown, np.uint8)


def _swept(view: PosedPair, u: Ints, v: Ints) -> tuple[Floats, Floats32, Floats32]:
    """Of pixels (h, w) of the left picture the plane on which the right picture agrees best.

    Returns:
        (h, w, 3) their rays, (h, w) depth [m], and (h, w) how far it differs there, as a share of
        how far it does on all planes.
    """
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    rays = np.column_stack([view.info.left.normalise(pixels), np.ones(len(pixels))])
    left = view.frame.left[v, u].astype(np.float32)
    T = np.linalg.inv(view.info.T_left_right)
    best = np.full(u.shape, np.inf, np.float32)
    chosen, total = np.zeros(u.shape, np.float32), np.zeros(u.shape, np.float32)
    for depth in np.linspace(NEAR, FAR, PLANES):
        points = (rays * depth) @ T[:3, :3].T + T[:3, 3]
        at = view.info.right.project(points).astype(np.float32).reshape(*u.shape, 2)
        right = cv2.remap(
            view.frame.right, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(np.float32)  # fmt: skip
        cost: Floats32 = np.abs(left - right).sum(axis=-1)
        cost = np.asarray(cv2.boxFilter(cost, -1, (7, 7)), np.float32)
        better = cost < best
        best[better], chosen[better] = cost[better], depth
        total += cost
    clear = np.asarray((best + 1.0) * PLANES / (total + PLANES), np.float32)
    return rays.reshape(*u.shape, 3), chosen, clear
