"""How sure an answer is: one probability from what can be seen of it, and one threshold.

A logistic of what is seen of it. Weights, threshold and the factor of the covariances are chosen on
crops that were held back from training and on tuning frames of another renderer, and travel on the
network's card; never on a test set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats

FEATURES = ("offset", "residual", "overlap", "type", "mass", "sigma", "lead", "gap")
LEAD = 20.0
"""Score by which the best type leads the second one where there is no doubt."""
GAP = 40.0
"""The same of poses of one type."""


@dataclass(frozen=True)
class Trust:
    """How features become a probability.

    Attributes:
        weights: one for each of :data:`FEATURES`.
        threshold: of the probability, from which an answer is believed; 1: none is.
        widen: factor of the standard deviations.
    """

    weights: tuple[float, ...] = (0.0, -0.6, 6.0, 1.0, 3.0, -1.0, 1.0, 1.0)
    threshold: float = 1.0
    widen: float = 2.0

    def of(self, features: Floats) -> float:
        """Probability that the answer is a good one, of (8,) features."""
        return float(1.0 / (1.0 + np.exp(-np.clip(features @ np.array(self.weights), -30, 30))))


def features(
    cost: float,
    points: int,
    overlap: float,
    kind: float,
    mass: float,
    sigma: float,
    lead: float,
    gap: float,
) -> Floats:
    """(8,) what the logistic takes.

    Args:
        cost: of the fit.
        points: observations in it.
        overlap: of the outlines, 0..1.
        kind: probability of the type.
        mass: mean probability of the landmarks' peaks.
        sigma: standard deviation of the joints, mean [m].
        lead: score of the best fit of another type over that of this one: a UR5 looks like a UR10
            that stands nearer.
        gap: of the best fit of this type that puts the joints elsewhere likewise: one picture may
            have two explanations.
    """
    return np.array(
        [1.0, np.log(cost / max(points, 1) + 0.1), overlap - 0.6, kind - 0.7, mass - 0.4,
         np.log(max(sigma, 1e-3) / 0.05), min(lead, LEAD) / LEAD - 0.5,
         min(gap, GAP) / GAP - 0.5]
    )  # fmt: skip


def read_trust(card: dict[str, Any]) -> Trust:
    """The trust of a network's card, or the default where it has none: then nothing is believed.

    Raises:
        ValueError: it is damaged.
    """
    given = card.get("trust")
    if given is None:
        return Trust()
    if not isinstance(given, dict):
        raise ValueError
    weights = tuple(float(v) for v in given["weights"])
    threshold, widen = float(given["threshold"]), float(given["widen"])
    if len(FEATURES) - 2 <= len(weights) < len(FEATURES):
        # Of a card from before the last features.
        weights += (0.0,) * (len(FEATURES) - len(weights))
    if len(weights) != len(FEATURES) or not (np.abs([*weights, threshold, widen]) < 1e6).all():
        raise ValueError
    if not (0 <= threshold <= 1 and 0 < widen < 100):
        raise ValueError
    return Trust(weights, threshold, widen)
