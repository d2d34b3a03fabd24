"""How well a robot was recognised; every frame counts, also those without an answer.

Distances in [m]. A frame without an answer has infinite errors and an empty mask.
"""

from __future__ import annotations

import itertools

import numpy as np

from armsight.arrays import Floats, Mask

AUC_LIMIT = 0.1
"""[m]; end of the area under the ADD curve."""


def mask_accuracy(estimate: Mask, truth: Mask) -> Floats:
    """(n,) share of the pixels that are right, of (n, h, w) masks (T4 to T7).

    It counts background: an empty mask scores 0.9 where the robot fills a tenth of the image.
    """
    return np.asarray((estimate == truth).mean(axis=(1, 2)))


def mask_iou(estimate: Mask, truth: Mask) -> Floats:
    """(n,) intersection over union of (n, h, w) masks; 1 where both are empty."""
    both = (estimate & truth).sum(axis=(1, 2))
    either = (estimate | truth).sum(axis=(1, 2))
    return np.where(either == 0, 1.0, both / np.maximum(either, 1))


def point_errors(estimate: Floats, truth: Floats) -> Floats:
    """(n, j) distances [m] of (n, j, 3) points; NaN where the truth is NaN: no such joint.

    Where there is a joint and the estimate is not finite, the error is infinite.
    """
    errors = np.linalg.norm(np.asarray(estimate, float) - np.asarray(truth, float), axis=-1)
    no_joint = np.isnan(truth).any(axis=-1)
    return np.where(no_joint, np.nan, np.where(np.isfinite(errors), errors, np.inf))


def frame_errors(errors: Floats) -> Floats:
    """(n,) mean over each frame's joints [m] of (n, j) errors: its ADD."""
    present = ~np.isnan(errors)
    total = np.where(present, errors, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(present.sum(axis=1), 1))


def add_auc(add: Floats, limit: float = AUC_LIMIT) -> float:
    """Area under the share of frames with ADD <= t, t = 0 to ``limit``, in 0..1.

    Equal to 1 - E[min(ADD, limit)] / limit; a frame without an answer (infinite) counts limit.
    """
    if len(add) == 0:
        return float("nan")
    shares = np.minimum(np.nan_to_num(add, nan=np.inf), limit) / limit
    return float(1.0 - shares.mean())


def share_over(add: Floats, limit: float = AUC_LIMIT) -> float:
    """Share of the frames whose ADD is above a limit [m] or not finite."""
    return float((~(np.asarray(add) <= limit)).mean())


def recognised(
    add: Floats, type_estimate: Floats | np.ndarray, type_truth: Floats | np.ndarray
) -> float:
    """Share of the frames with the right type and ADD within 0.1 m: both have to be right."""
    right = np.asarray(type_estimate) == np.asarray(type_truth)
    return float((right & (np.asarray(add) <= AUC_LIMIT)).mean())


def against(values: Floats, by: Floats, edges: Floats) -> list[tuple[float, float, Floats]]:
    """Values in bins of another quantity: (lower edge, upper edge, values) each."""
    return [
        (float(low), float(high), values[(by >= low) & (by < high)])
        for low, high in itertools.pairwise(edges)
    ]
