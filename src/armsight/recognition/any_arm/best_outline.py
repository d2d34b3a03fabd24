"""Of fits to landmarks the one whose outline, brought to the mask's, speaks best for it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats32
from armsight.machine import usable_cores
from armsight.recognition.any_arm.lens_doubt import RIGHT
from armsight.recognition.any_arm.outline import Edge, follow_outline, outline_overlap
from armsight.recognition.any_arm.solver import Fit, Observations, cost_of
from armsight.recognition.any_arm.trust import GAP
from armsight.recognition.any_arm.views import Crop

OUTLINE = 120.0
"""Cost of an outline that overlaps nowhere, against landmarks; chosen on held-back crops of the
training's renderer."""


@dataclass(frozen=True)
class Outlined:
    """A fit with its outline on the mask's.

    Attributes:
        fit: itself.
        overlap: of its outline, 0..1.
        gap: by how much less it costs than the best other fit that puts the joints elsewhere.
    """

    fit: Fit
    overlap: float
    gap: float


def best_outlined(
    fits: Sequence[Fit], seen: Observations, arm: Floats32, crop: Crop, threads: int = 1
) -> Outlined | None:
    """Of fits to landmarks the one that ends up best on the mask.

    Args:
        fits: best first.
        seen: the observations that they explain.
        arm: (side, side) probability of the arm in the crop.
        crop: itself.
        threads: that follow them; 0 for as many as there are cores.
    """
    if not fits:
        return None
    edge = Edge.of(arm, crop)

    def end(fit: Fit) -> tuple[float, float, Fit]:
        drawn = follow_outline(fit, seen, edge)
        overlap = outline_overlap(drawn, edge)
        return cost_of(drawn, seen) + OUTLINE * (1.0 - overlap), overlap, drawn

    with ThreadPoolExecutor(threads or usable_cores()) as pool:
        ends = list(pool.map(end, fits))
    (cost, overlap, best), *others = sorted(ends, key=lambda end: end[0])
    gaps = [end[0] - cost for end in others if _apart(end[2], best) > RIGHT]
    return Outlined(best, overlap, min(gaps, default=GAP))


def _apart(a: Fit, b: Fit) -> float:
    """Mean distance of the joints of two fits of one robot [m]."""
    return float(np.linalg.norm(a.joints() - b.joints(), axis=1).mean())
