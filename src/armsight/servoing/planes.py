"""V's wrist stereo: depth by 30 planes between 0.20 and 0.40 m, about 7 mm apart."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Floats32, Points
from armsight.motion.perception import PosedPair
from armsight.servoing.segment import Region

PLANES = 30
NEAR, FAR = 0.20, 0.40
"""Nearest and farthest plane [m] (V)."""


def plane_sweep(view: PosedPair, region: Region, step: int = 3) -> Points:
    """(k, 3) points of a region of the left picture, in the left lens's frame [m].

    Every ``step``-th pixel takes the plane on which the right picture agrees best; the planes are
    equally spaced in depth, as V's steps of 7 mm are.
    """
    (u0, v0), (h, w) = region.corner, region.mask.shape
    v, u = np.mgrid[v0 : v0 + h : step, u0 : u0 + w : step]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    rays = np.column_stack([view.info.left.normalise(pixels), np.ones(len(pixels))])
    left = view.frame.left[v, u].astype(np.float32)
    depths = np.linspace(NEAR, FAR, PLANES)
    T = np.linalg.inv(view.info.T_left_right)
    best = np.full(u.shape, np.inf, np.float32)
    chosen = np.zeros(u.shape, np.float32)
    for depth in depths:
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
    inside = region.mask[v - v0, u - u0].ravel() > 0
    z = chosen.ravel()[inside].astype(float)
    return np.asarray(rays[inside] * z[:, None])
