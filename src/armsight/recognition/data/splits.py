"""Which frames of a labelled set are for training, for validation and for testing.

T4 to T7 draw a random 20 % of the frames for testing ("frame"): backgrounds and light of the test
are then those of the training. "scene" holds whole rooms back instead.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from armsight.arrays import Ints
from armsight.errors import UsageError

Part = Literal["train", "validation", "test"]
By = Literal["frame", "scene"]

TEST, VALIDATION = 0.2, 0.1
"""Shares of the test and of the validation; the papers' 80 % for training hold both others."""


def split(robots: Sequence[str], scenes: Sequence[int], part: Part, by: By, seed: int = 0) -> Ints:
    """Indices of the frames of one part, in rising order; the three parts cover every frame once.

    Each robot is split by itself, so that every part has every robot, and a frame stays in its part
    whichever other robots the set has. By scene, a robot of fewer
    than three scenes gives its last parts nothing to do: train first, then test, then validation.

    Args:
        robots: robot of each frame.
        scenes: scene of each frame.
        part: the part.
        by: what is held back whole.
        seed: of the draw.

    Raises:
        UsageError: no such part, or no such way to split.
    """
    if part not in get_args(Part) or by not in get_args(By):
        raise UsageError(
            f'no split "{part}" by "{by}"; parts: {", ".join(get_args(Part))}; '
            f"by: {', '.join(get_args(By))}"
        )
    names, numbers = np.asarray(robots, dtype=object), np.asarray(scenes, np.int64)
    chosen = []
    for robot in sorted(set(robots)):
        mine = np.flatnonzero(names == robot)
        rng = np.random.default_rng([seed, 17, zlib.crc32(robot.encode())])
        units = mine if by == "frame" else np.unique(numbers[mine])
        wanted = _units(rng.permutation(units), part)
        chosen.append(mine[np.isin(mine if by == "frame" else numbers[mine], wanted)])
    if not chosen:
        return np.empty(0, np.int64)
    return np.sort(np.concatenate(chosen)).astype(np.int64)


def _units(shuffled: Ints, part: Part) -> Ints:
    """What of the shuffled frames or scenes belongs to a part."""
    count = len(shuffled)
    test = max(round(TEST * count), 1) if count > 1 else 0
    validation = max(round(VALIDATION * count), 1) if count > 2 else 0
    if part == "test":
        return shuffled[:test]
    if part == "validation":
        return shuffled[test : test + validation]
    return shuffled[test + validation :]
