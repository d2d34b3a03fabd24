"""Chooses how far a network is trusted, on crops that were held back from its training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armsight.arrays import Floats, Mask
from armsight.recognition.any_arm.frames import find_lumps
from armsight.recognition.any_arm.learning.examples import held_back
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.any_arm.trust import FEATURES, Trust
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.sample import Sample

GOOD = 0.1
"""Mean joint error of a good answer, below [m]."""
WRONG = 0.1
"""Share of the answers that are believed which may be none."""
PARTS = 10
"""Parts of the answers, each judged by weights that were fitted to the others."""
_INSIDE_90 = 6.251
"""Of chi squared with three degrees of freedom, 90 %."""


@dataclass(frozen=True)
class Judged:
    """Answers on crops with truth.

    Attributes:
        features: (m, 8) of each answer; error: (m,) mean joint error [m].
        spread: (m, 4) squared Mahalanobis distances of four joints, NaN where there are fewer.
    """

    features: Floats
    error: Floats
    spread: Floats


def judge(model: CropModel, held: LabelledSet, names: Sequence[str], most: int) -> Judged:
    """Answers on held-back crops of known robots, their boxes given.

    Args:
        model: to be judged.
        held: the labelled set that it was trained on.
        names: what the set's robots are numbered by in the training.
        most: crops, spread over the set.
    """
    number = np.array([names.index(r.robot) for r in held.rows])
    back = held_back(number, np.array([r.scene for r in held.rows]))
    chosen = [i for i in np.flatnonzero(back) if held.rows[i].robot in model.robots]
    chosen = chosen[:: max(len(chosen) // most, 1)]
    seen = _Seen(ArmRecogniser(model))
    for i in chosen:
        sample = held[int(i)]
        row, column = np.nonzero(sample.mask)
        if len(row) < 60:
            continue
        low = np.array([column.min(), row.min()], float)
        high = np.array([column.max() + 1, row.max() + 1], float)
        seen.look(sample, low, high)
    return seen.judged()


def judge_pictures(model: CropModel, pictures: LabelledSet) -> Judged:
    """Answers on whole pictures of known robots, as in use: of the strongest lump of each.

    Args:
        model: to be judged.
        pictures: of another renderer than the crops', and never those that a figure is reported on.
    """
    seen = _Seen(ArmRecogniser(model))
    for i, row in enumerate(pictures.rows):
        if row.robot in model.robots:
            sample = pictures[i]
            for lump in find_lumps(model, sample.image)[0][:1]:
                seen.look(sample, lump.low, lump.high)
    return seen.judged()


class _Seen:
    """Gathers answers."""

    def __init__(self, recogniser: ArmRecogniser) -> None:
        self._recogniser = recogniser
        self._rows: list[Floats] = []
        self._errors: list[float] = []
        self._spreads: list[Floats] = []

    def look(self, sample: Sample, low: Floats, high: Floats) -> None:
        """At a box of a picture; where nothing is found there is nothing to be judged."""
        found = self._recogniser.examined(sample.image, sample.camera, low, high)
        if found is None:
            return
        arm, features = found
        n = min(len(arm.joints), len(sample.joints_camera))
        away = arm.joints[:n] - sample.joints_camera[:n]
        self._rows.append(features)
        self._errors.append(
            float(np.linalg.norm(away, axis=1).mean()) if arm.robot == sample.robot else 1.0
        )
        C = arm.covariance[:n] / self._recogniser.trust.widen**2
        self._spreads.append(
            np.einsum("ni,nij,nj->n", away, np.linalg.inv(C + 1e-8 * np.eye(3)), away)[1:5]
        )

    def judged(self) -> Judged:
        return Judged(
            np.array(self._rows).reshape(-1, len(FEATURES)),
            np.array(self._errors),
            np.array(self._spreads).reshape(-1, 4),
        )


def choose_trust(judged: Judged, elsewhere: Judged | None = None) -> tuple[Trust, dict[str, Any]]:
    """Weights, threshold and widening; and figures for the card.

    The threshold is the lowest from which at most :data:`WRONG` of the answers above it are wrong,
    of the crops and of those from elsewhere alike, each answer judged by weights that it was not
    fitted to: a fit promises more on its own answers than it keeps on others. Ellipsoids are as
    wide as the harder of the two needs.

    Args:
        judged: answers on held-back crops.
        elsewhere: answers on pictures of another renderer, which no figure is reported on.
    """
    sets = [judged] if elsewhere is None else [judged, elsewhere]
    every = Judged(*(np.concatenate([getattr(j, k) for j in sets]) for k in vars(judged)))
    good = every.error < GOOD
    weights = logistic(every.features, good)
    p = _unknown(every.features, good)
    ends = np.cumsum([len(j.error) for j in sets])[:-1]
    threshold = max(map(_lowest, np.split(p, ends), np.split(good, ends)))
    sure = p >= threshold
    believed = every.spread if not sure.any() else np.where(sure[:, None], every.spread, np.nan)
    widen = max(map(_widening, np.split(believed, ends)))
    figures = {
        "frames": len(p),
        "elsewhere": 0 if elsewhere is None else len(elsewhere.error),
        "good": float(good.mean()) if len(good) else 0.0,
        "believed": float(sure.mean()) if len(sure) else 0.0,
        "believed_wrong": float((~good[sure]).mean()) if sure.any() else 0.0,
    }
    return Trust(tuple(float(v) for v in weights), threshold, widen), figures


def _unknown(x: Floats, good: Mask) -> Floats:
    """(n,) probability of each answer, by weights fitted to the other parts of the answers.

    Parts are runs of answers: neighbours are of one room.
    """
    part = np.arange(len(x)) * PARTS // max(len(x), 1)
    p = np.empty(len(x))
    for k in np.unique(part):
        trust = Trust(tuple(float(v) for v in logistic(x[part != k], good[part != k])))
        p[part == k] = [trust.of(f) for f in x[part == k]]
    return p


def _widening(spread: Floats) -> float:
    """By how much 90 % ellipsoids have to grow to hold nine joints in ten."""
    inside = spread[np.isfinite(spread)]
    if not inside.size:
        return 1.0
    return float(np.clip(np.sqrt(np.quantile(inside, 0.9) / _INSIDE_90), 1.0, 20.0))


def _lowest(p: Floats, good: Mask) -> float:
    """The lowest threshold that keeps its promise on some answers; 1 where none does."""
    order = np.argsort(-p)
    share = np.cumsum(~good[order]) / np.arange(1, len(p) + 1)
    kept = np.flatnonzero(share <= WRONG)
    return max(float(p[order][kept[-1]]), 0.3) if len(kept) else 1.0


def logistic(x: Floats, y: Mask, hold: float = 0.1) -> Floats:
    """Weights of a logistic regression of (n, k) features on (n,) truth, by Newton's steps.

    Args:
        x: features, the first one 1.
        y: truth.
        hold: of the prior towards zero.
    """
    w = np.zeros(x.shape[1])
    penalty = hold * np.eye(x.shape[1])
    penalty[0, 0] = 1e-3
    for _ in range(30):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w, -30, 30)))
        g = x.T @ (p - y) + penalty @ w
        H = (x * (p * (1 - p))[:, None]).T @ x + penalty
        w = w - np.linalg.solve(H, g)
    return np.asarray(w)
