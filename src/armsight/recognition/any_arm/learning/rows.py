"""Fits the rows of an extension to features that stand still: convex but for the coordinates.

The terms are those of :mod:`armsight.recognition.any_arm.learning.losses` with their gradients
written out, so that numpy is enough: a softmax over a landmark's cells and "outside", one over the
links of each cell, Laplace's likelihood of the coordinates, and a logistic for the type against
what the network says of its own types together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats32, Ints
from armsight.recognition.any_arm.extension import CELLS, LINKS, Rows
from armsight.recognition.any_arm.landmarks import SLOTS

SPOT = 0.8
"""Standard deviation of a landmark's target [cells]."""
_RATE = 4e-3
_BATCH = 24
_DECAY = 1e-4
_LEAST, _MOST = -4.0, 1.5
"""Of the logarithm of a coordinate's spread."""


@dataclass(frozen=True)
class Shots:
    """Crops of the new robot as the network sees them, and what is to be said of them.

    Attributes:
        features: (n, c, h, w) float16; hidden: (n, d).
        links: (n, 10, 2 h, 2 w) shares; coordinates: (n, 3, 2 h, 2 w); known: (n, 2 h, 2 w).
        points: (n, SLOTS, 2) [cells], NaN where there is none.
    """

    features: np.ndarray
    hidden: Floats32
    links: Floats32
    coordinates: Floats32
    known: Floats32
    points: Floats32


def fit_rows(
    shots: Shots, other_hidden: Floats32, margin: Floats32, updates: int, seed: int
) -> Rows:
    """The rows that explain the shots.

    Args:
        shots: m crops of the robot.
        other_hidden: (k, d) of pictures of other robots and of none.
        margin: (m + k,) log of the sum of the network's own types' exponentials, of the shots
            and then of the others.
        updates: of the maps.
        seed: of the order.
    """
    n, c, h, w = shots.features.shape
    heat, surface, outside = (
        np.zeros((CELLS * SLOTS, c + 1), np.float32),
        np.zeros((CELLS * (LINKS + 4), c + 1), np.float32),
        np.zeros((SLOTS, shots.hidden.shape[1] + 1), np.float32),
    )
    steps = [_Adam(part) for part in (heat, surface, outside)]
    rng = np.random.default_rng([seed, 83])
    for update in range(updates):
        chosen = rng.integers(0, n, min(_BATCH, n))
        x = shots.features[chosen].astype(np.float32).transpose(1, 0, 2, 3).reshape(c, -1)
        x = np.vstack([x, np.ones((1, x.shape[1]), np.float32)])
        hidden = _with_one(shots.hidden[chosen])
        shape = (len(chosen), h, w)
        g_heat, g_outside = _heat(_cells(heat @ x, shape), hidden @ outside.T, shots.points[chosen])
        g_surface = _surface(_cells(surface @ x, shape), shots, chosen)
        rate = _RATE * 0.5 * (1.0 + np.cos(np.pi * update / updates))
        for step, gradient in zip(
            steps,
            (_places(g_heat) @ x.T, _places(g_surface) @ x.T, g_outside.T @ hidden),
            strict=True,
        ):
            step.take(gradient, rate)
    kind = _logistic(shots.hidden, other_hidden, margin)
    return Rows(heat, surface, outside, kind)


class _Adam:
    """Kingma and Ba (2015), in place, with decoupled decay."""

    def __init__(self, weight: Floats32) -> None:
        self._weight = weight
        self._mean, self._square = np.zeros_like(weight), np.zeros_like(weight)
        self._count = 0

    def take(self, gradient: Floats32, rate: float) -> None:
        self._count += 1
        self._mean += 0.1 * (gradient - self._mean)
        self._square += 0.005 * (gradient**2 - self._square)
        mean = self._mean / (1.0 - 0.9**self._count)
        square = self._square / (1.0 - 0.995**self._count)
        self._weight -= rate * (mean / (np.sqrt(square) + 1e-8) + _DECAY * self._weight)


def _with_one(hidden: Floats32) -> Floats32:
    return np.hstack([hidden, np.ones((len(hidden), 1), np.float32)])


def _cells(flat: Floats32, shape: tuple[int, int, int]) -> Floats32:
    """(4 k, n h w) as (n, k, 2 h, 2 w)."""
    n, h, w = shape
    split = flat.reshape(-1, 2, 2, n, h, w).transpose(3, 0, 4, 1, 5, 2)
    return np.ascontiguousarray(split).reshape(n, -1, 2 * h, 2 * w)


def _places(maps: Floats32) -> Floats32:
    """The other way about."""
    n, k, h, w = maps.shape
    split = maps.reshape(n, k, h // 2, 2, w // 2, 2).transpose(1, 3, 5, 0, 2, 4)
    return np.ascontiguousarray(split).reshape(4 * k, -1)


def _heat(heat: Floats32, outside: Floats32, points: Floats32) -> tuple[Floats32, Floats32]:
    """Gradients of the landmarks' cross-entropy by (n, p, h, w) heat and (n, p) outside."""
    h, w = heat.shape[2:]
    given = np.isfinite(points).all(2)
    x, y = np.moveaxis(np.nan_to_num(points, nan=-1e3), 2, 0)
    inside = (x > -0.5) & (y > -0.5) & (x < w - 0.5) & (y < h - 0.5)
    gx = np.exp(-0.5 * ((np.arange(w) - x[..., None]) / SPOT) ** 2)
    gy = np.exp(-0.5 * ((np.arange(h) - y[..., None]) / SPOT) ** 2)
    target = gy[..., :, None] * gx[..., None, :]
    target /= np.maximum(target.sum((2, 3), keepdims=True), 1e-6)
    top = np.maximum(heat.max((2, 3)), outside)
    e, e_out = np.exp(heat - top[..., None, None]), np.exp(outside - top)
    total = e.sum((2, 3)) + e_out
    weight = given / max(given.sum(), 1)
    by_heat = e / total[..., None, None] - target * inside[..., None, None]
    by_outside = e_out / total - ~inside
    return (
        (by_heat * weight[..., None, None]).astype(np.float32),
        (by_outside * weight).astype(np.float32),
    )


def _surface(seen: Floats32, shots: Shots, chosen: Ints) -> Floats32:
    """Gradient of the links' cross-entropy and of the coordinates' likelihood."""
    out = np.zeros_like(seen)
    logits, truth = seen[:, :LINKS], shots.links[chosen]
    e = np.exp(logits - logits.max(1, keepdims=True))
    out[:, :LINKS] = (e / e.sum(1, keepdims=True) - truth) / truth[:, 0].size
    known = shots.known[chosen][:, None] / max(float(shots.known[chosen].sum()), 1.0)
    away = seen[:, LINKS : LINKS + 3] - shots.coordinates[chosen]
    spread = seen[:, LINKS + 3 :]
    sharp = np.exp(-np.clip(spread, _LEAST, _MOST))
    out[:, LINKS : LINKS + 3] = np.sign(away) * sharp * known
    far = np.abs(away).sum(1, keepdims=True)
    free = (spread > _LEAST) & (spread < _MOST)
    out[:, LINKS + 3 :] = (3.0 - far * sharp) * known * free
    return out


def _logistic(mine: Floats32, others: Floats32, margin: Floats32) -> Floats32:
    """(d + 1,) of the logit that beats the network's own types on one's own pictures alone."""
    x = _with_one(np.vstack([mine, others])).astype(np.float64)
    y = np.r_[np.ones(len(mine)), np.zeros(len(others))]
    # Both kinds weigh the same, however many there are of each.
    share = np.where(y > 0, 0.5 / max(len(mine), 1), 0.5 / max(len(others), 1))
    scale = np.sqrt((x**2).mean(0)) + 1e-3
    x /= scale
    w = np.zeros(x.shape[1])
    hold = 2e-4 * np.eye(len(w))
    hold[-1, -1] = 1e-8
    for _ in range(25):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w - margin, -30, 30)))
        gradient = x.T @ (share * (p - y)) + hold @ w
        H = (x * (share * p * (1 - p))[:, None]).T @ x + hold + 1e-9 * np.eye(len(w))
        step = np.linalg.solve(H, gradient)
        w -= step * min(1.0, 5.0 / max(float(np.abs(step).max()), 1e-9))
    return np.asarray(w / scale, np.float32)
