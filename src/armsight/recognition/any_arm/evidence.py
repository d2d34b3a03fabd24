"""What a network says of a crop before anything is read off it, and two sayings brought together.

Two looks at one arm, turned and zoomed a little differently, err differently. The probabilities of
where a landmark is are averaged: where they agree it stays as sure, and what they disagree about
has two places, each of them half as likely.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Floats, Floats32

STRIDE = 4
"""Pixels a cell of the outputs."""


@dataclass(frozen=True)
class Surface:
    """What of an arm is where; cells are of 4 pixels.

    Attributes:
        links: (10, h, w) probability of background, link 0, link 1 ...
        coordinates: (h, w, 3) place in its link's box, -1..1; spread: (h, w) of these.
    """

    links: Floats32
    coordinates: Floats32
    spread: Floats32


@dataclass(frozen=True)
class Evidence:
    """Of one crop; h x w cells.

    Attributes:
        surface: of the robots that the network was trained on; own: of those added to it.
        heat: (p, h, w) log of the probability that a robot's landmark is in a cell, by its name;
            outside: (p,) that it is in none.
        types: (n + 2,) log of the probabilities of the trained types, ``none`` and ``unknown``.
        strength: log of the odds of each robot that was added, against all of these.
    """

    surface: Surface
    own: dict[str, Surface]
    heat: dict[str, Floats32]
    outside: dict[str, Floats32]
    types: Floats
    strength: dict[str, float]


def surface_of(links: Floats32, coordinates: Floats32, spread: Floats32) -> Surface:
    """Of (10, h, w) logits, (3, h, w) coordinates and the (h, w) log of their spread."""
    return Surface(
        _softmax(links).astype(np.float32),
        np.ascontiguousarray(coordinates.transpose(1, 2, 0)),
        np.exp(np.clip(spread, -4.0, 1.5)),
    )


def log_places(heat: Floats32, outside: Floats32) -> tuple[Floats32, Floats32]:
    """(p, h, w) and (p,) logits of one softmax as logs of probabilities."""
    flat = heat.reshape(len(heat), -1)
    top = np.maximum(flat.max(axis=1), outside)
    whole = top + np.log(np.exp(flat - top[:, None]).sum(axis=1) + np.exp(outside - top))
    return np.asarray(heat - whole[:, None, None], np.float32), np.asarray(
        outside - whole, np.float32
    )


def together(first: Evidence, second: Evidence, H: Floats) -> Evidence:
    """Two looks at one scene, in the second one's cells.

    Surface coordinates are the second one's: it looks nearer. Where the first did not look, all is.

    Args:
        first: one look.
        second: another.
        H: (3, 3) from the second one's pixels to the first one's.
    """
    moved = _Moved(H, first.surface.links.shape[1:], second.surface.links.shape[1:])
    heat = {name: _mean(moved(first.heat[name], mine), mine) for name, mine in second.heat.items()}
    outside = {name: _mean(first.outside[name], v) for name, v in second.outside.items()}
    types = 0.5 * (first.types + second.types)
    strength = {name: 0.5 * (first.strength[name] + v) for name, v in second.strength.items()}
    return Evidence(
        _joined(first.surface, second.surface, moved),
        {name: _joined(first.own[name], mine, moved) for name, mine in second.own.items()},
        heat,
        outside,
        types - np.log(np.exp(types - types.max()).sum()) - types.max(),
        strength,
    )


class _Moved:
    """Brings maps of the first look into the second one's cells."""

    def __init__(self, H: Floats, source: tuple[int, ...], target: tuple[int, ...]) -> None:
        rows, columns = np.mgrid[0 : target[0], 0 : target[1]].astype(float)
        middle = 0.5 * (STRIDE - 1)
        at = np.stack([columns * STRIDE + middle, rows * STRIDE + middle, np.ones_like(rows)], -1)
        at = at @ H.T
        front = at[..., 2] > 1e-3
        cell = (at[..., :2] / np.where(front, at[..., 2], 1.0)[..., None] - middle) / STRIDE
        inside = front & (cell > -0.5).all(-1) & (cell < np.array(source[::-1]) - 0.5).all(-1)
        self._inside = inside
        self._x = np.where(inside, cell[..., 0], -9).astype(np.float32)
        self._y = np.where(inside, cell[..., 1], -9).astype(np.float32)

    def __call__(self, maps: Floats32, elsewhere: Floats32) -> Floats32:
        """(k, h, w) maps; where they do not reach, what ``elsewhere`` says."""
        found = np.stack([
            cv2.remap(m, self._x, self._y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for m in maps
        ])  # fmt: skip
        return np.where(self._inside, found, elsewhere)


def _joined(first: Surface, second: Surface, moved: _Moved) -> Surface:
    links = 0.5 * (second.links + moved(first.links, second.links))
    return Surface(links.astype(np.float32), second.coordinates, second.spread)


def _mean(a: Floats32, b: Floats32) -> Floats32:
    """Log of the mean of two probabilities, of their logs."""
    # As np.logaddexp has it, of functions that are compiled for many numbers at once.
    less = np.log(1.0 + np.exp(-np.abs(a - b)))
    return np.asarray(np.maximum(a, b) + less - np.float32(np.log(2.0)), np.float32)


def _softmax(x: Floats32) -> Floats:
    e = np.exp(x.astype(np.float64) - x.max(axis=0))
    return np.asarray(e / e.sum(axis=0))
