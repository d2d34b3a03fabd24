"""Draws more from where a network errs: weights of bins, read from a file.

::

    [distance]                     # m, camera to base
    edges = [0.8, 1.5, 2.5, 3.5]
    weights = [1.0, 1.0, 3.0]      # one a bin; a sample outside all bins weighs as the least

Scenes are drawn as ever and taken with a probability that follows the product of their weights, so
a set is as reproducible with an emphasis as without; its text is kept in ``dataset.toml``.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.errors import UsageError

MEASURES = ("distance", "elevation_deg", "fov_deg", "share", "seen")
"""What can be weighed: distance of the base [m]; angle of the camera above the arm's base [deg];
horizontal field of view [deg]; share of the picture that the robot fills; share of the robot that
nothing hides."""
LEAST = 0.01
"""Least weight against the greatest: drawing one sample takes at most so many scenes."""


@dataclass(frozen=True)
class Emphasis:
    """Weights of bins of some measures.

    Attributes:
        bins: of each measure, rising edges and one weight fewer.
    """

    bins: tuple[tuple[str, tuple[float, ...], tuple[float, ...]], ...] = ()

    def chance(self, measures: dict[str, float]) -> float:
        """Probability that a scene of these measures is taken; the best one's is 1."""
        chance = 1.0
        for name, edges, weights in self.bins:
            value = measures[name]
            k = int(np.searchsorted(edges, value, side="right")) - 1
            weight = weights[k] if 0 <= k < len(weights) else min(weights)
            chance *= max(weight / max(weights), LEAST)
        return chance

    def text(self) -> str:
        """All of it in one line; empty without any weight."""
        return json.dumps(self.bins) if self.bins else ""


NO_EMPHASIS = Emphasis()


def parse_emphasis(text: str) -> Emphasis:
    """What :meth:`Emphasis.text` has written."""
    if not text:
        return Emphasis()
    return Emphasis(tuple((name, tuple(edges), tuple(w)) for name, edges, w in json.loads(text)))


def read_emphasis(path: Path) -> Emphasis:
    """Weights of a file.

    Raises:
        UsageError: it cannot be read, or is no table of weights; says what is wrong.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is not TOML ({error})") from None
    bins = []
    for name, table in data.items():
        if name not in MEASURES:
            raise UsageError(f'{path}: "{name}" cannot be weighed; known: {", ".join(MEASURES)}')
        if not isinstance(table, dict):
            raise UsageError(f"{path}: [{name}] is no table with edges and weights")
        bins.append((name, *_bins(path, name, table.get("edges"), table.get("weights"))))
    if not bins:
        raise UsageError(f"{path}: weighs nothing; known: {', '.join(MEASURES)}")
    return Emphasis(tuple(bins))


def _bins(
    path: Path, name: str, edges: object, weights: object
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    lists = []
    for values in (edges, weights):
        if not isinstance(values, list) or not all(
            isinstance(v, int | float) and not isinstance(v, bool) and np.isfinite(v)
            for v in values
        ):
            raise UsageError(f"{path}: [{name}] needs lists of numbers: edges and weights")
        lists.append(tuple(float(v) for v in values))
    cuts, heavy = lists
    if len(heavy) < 1 or len(cuts) != len(heavy) + 1 or any(np.diff(cuts) <= 0):
        raise UsageError(f"{path}: [{name}] needs rising edges, one more than weights")
    if min(heavy) < 0 or max(heavy) <= 0:
        raise UsageError(f"{path}: [{name}] has weights below 0, or none above")
    return cuts, heavy
