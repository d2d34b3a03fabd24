"""A search of all poses, for either kind of view: attempts until an answer believes itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armsight.arrays import Floats, Points, Poses
from armsight.recognition.own_arm.answer import OwnArmPose
from armsight.recognition.own_arm.surface import ArmSurface

LEAST_VIEWS = 3
"""With fewer, what moves cannot be told from what only stands near."""


def need_views(views: Sequence[object], kind: str) -> None:
    """See that there are enough views for a search.

    Args:
        views: that there are.
        kind: of the views, in words.

    Raises:
        ValueError: there are fewer than three.
    """
    if len(views) < LEAST_VIEWS:
        raise ValueError(
            f"{len(views)} {kind} of the arm: at least {LEAST_VIEWS} are needed to tell what moves "
            "from what stands"
        )


def attempted(
    attempts: int,
    seed: int,
    attempt: Callable[[np.random.Generator, int], OwnArmPose],
    worth: Callable[[OwnArmPose], float],
) -> OwnArmPose:
    """The first answer that believes itself, or the one that is worth most.

    Args:
        attempts: at most; each tries other rotations.
        seed: of these.
        attempt: one search, with a source of randomness and its number.
        worth: of an answer that is not believed.
    """
    answers: list[OwnArmPose] = []
    for number in range(attempts):
        answers.append(attempt(np.random.default_rng([seed, number]), number))
        if answers[-1].believed:
            return answers[-1]
    return max(answers, key=worth)


def nothing_moves(views: int, score: float) -> OwnArmPose:
    """The answer where nothing moves."""
    nothing = np.full((6, 6), np.nan)
    problem = "nothing moves before the camera"
    return OwnArmPose(np.eye(4), nothing, np.inf, score, 0.0, 0.0, views, problem)


def moving_points(surface: ArmSurface, thinned: int) -> list[int]:
    """Some points of the links that move much: where their middle is, something moves."""
    return [int(k) for k in np.flatnonzero(surface.owner >= 2)[::thinned]]


def turned_about(rotations: Floats, middles: Points, target: Points) -> Poses:
    """(k, 4, 4) ``T_camera_base`` with given rotations that put a point of the arm somewhere.

    Args:
        rotations: (k, 3, 3).
        middles: (k, 3) or (3,) the point in ``base`` [m].
        target: (3,) where it goes, in the camera's frame [m].
    """
    T = np.tile(np.eye(4), (len(rotations), 1, 1))
    T[:, :3, :3] = rotations
    T[:, :3, 3] = (
        target - (rotations @ np.broadcast_to(middles, (len(rotations), 3))[..., None])[..., 0]
    )
    return T
