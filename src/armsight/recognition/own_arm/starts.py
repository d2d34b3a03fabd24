"""Where to begin: poses drawn about a belief, and the best of many made better by changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Mask, Pose, Poses, Vector3
from armsight.geometry.pose import transform

Score = Callable[[Poses], Floats]
"""(k,) how good each of (k, 4, 4) poses ``T_camera_base`` is; larger is better."""


def scattered(
    T_camera_base: Pose,
    pivot: Vector3,
    shift: float,
    turn: float,
    count: int,
    rng: np.random.Generator,
) -> Poses:
    """(count, 4, 4) poses about one, itself first: turned about a point of the arm, and shifted.

    Args:
        T_camera_base: in the middle.
        pivot: (3,) in ``base`` [m]: a turn about the camera would throw a distant arm far.
        shift: standard deviation along each axis [m].
        turn: standard deviation about each axis [rad].
        count: of the poses.
        rng: source of randomness.
    """
    R = Rotation.from_rotvec(turn * rng.standard_normal((count, 3))).as_matrix()
    t = shift * rng.standard_normal((count, 3))
    R[0], t[0] = np.eye(3), 0.0
    center = transform(T_camera_base, pivot[None])[0]
    out = np.tile(np.eye(4), (count, 1, 1))
    out[:, :3, :3] = R @ T_camera_base[:3, :3]
    out[:, :3, 3] = (R @ (T_camera_base[:3, 3] - center)[:, None])[..., 0] + center + t
    return out


@dataclass(frozen=True)
class Narrowing:
    """One narrowing of a beam.

    Attributes:
        shift, turn: standard deviations of the changes that are tried [m], [rad].
        tolerance: of the comparison, the scene's affair; points: of the surface, a view.
        kept, children: see :func:`narrowed`.
        apart: of poses within the changes' size of each other only the best remains.
    """

    shift: float
    turn: float
    tolerance: float
    points: int
    kept: int
    children: int
    apart: bool = False


def beam(
    poses: Poses,
    pivot: Vector3,
    score: Callable[[Poses, Narrowing], Floats],
    stages: Sequence[Narrowing],
    rng: np.random.Generator,
) -> tuple[Poses, Floats]:
    """Poses after all stages, the best first, and their scores.

    Args:
        poses: (k, 4, 4) ``T_camera_base``.
        pivot: see :func:`scattered`.
        score: of poses, as a stage compares.
        stages: one after the other.
        rng: source of randomness.
    """
    scores: Floats = np.zeros(len(poses))
    for stage in stages:

        def compare(candidates: Poses, stage: Narrowing = stage) -> Floats:
            return score(candidates, stage)

        poses, scores = narrowed(poses, pivot, compare, stage, rng)
    return poses, scores


def narrowed(
    poses: Poses, pivot: Vector3, score: Score, stage: Narrowing, rng: np.random.Generator
) -> tuple[Poses, Floats]:
    """The best of a beam after each pose has tried some changes of itself.

    Each pose is followed by its own best change only, so that one hill does not crowd out the rest.

    Args:
        poses: (k, 4, 4) ``T_camera_base``.
        pivot: see :func:`scattered`.
        score: of poses.
        stage: how large the changes are, how many each tries, and how many poses remain.
        rng: source of randomness.

    Returns:
        (kept, 4, 4) poses, the best first, and their scores.
    """
    count, children = len(poses), stage.children
    R = Rotation.from_rotvec(stage.turn * rng.standard_normal((count * children, 3))).as_matrix()
    R = R.reshape(count, children, 3, 3)
    t = stage.shift * rng.standard_normal((count, children, 3))
    R[:, 0], t[:, 0] = np.eye(3), 0.0
    center = poses[:, :3, :3] @ pivot + poses[:, :3, 3]
    tried = np.tile(np.eye(4), (count, children, 1, 1))
    tried[:, :, :3, :3] = R @ poses[:, None, :3, :3]
    arm = poses[:, :3, 3] - center
    tried[:, :, :3, 3] = (R @ arm[:, None, :, None])[..., 0] + center[:, None] + t
    scores = score(tried.reshape(-1, 4, 4)).reshape(count, children)
    own = np.argmax(scores, axis=1)
    best, value = tried[np.arange(count), own], scores[np.arange(count), own]
    order = np.argsort(-value, kind="stable")
    best, value = best[order], value[order]
    if stage.apart:
        alone = _alone(best, pivot, stage)
        best, value = best[alone], value[alone]
    return best[: stage.kept], value[: stage.kept]


def _alone(poses: Poses, pivot: Vector3, stage: Narrowing) -> Mask:
    """(k,) which poses have no better one near, the best first: many ways lead up one hill."""
    places = poses[:, :3, :3] @ pivot + poses[:, :3, 3]
    alone = np.ones(len(poses), bool)
    found = 0
    for k in range(len(poses)):
        if not alone[k]:
            continue
        found += 1
        if found > stage.kept:
            alone[k:] = False
            break
        rest = slice(k + 1, None)
        cosine = 0.5 * (np.einsum("nij,ij->n", poses[rest, :3, :3], poses[k, :3, :3]) - 1.0)
        near = np.linalg.norm(places[rest] - places[k], axis=1) < stage.shift
        alone[rest] &= ~(near & (cosine > np.cos(stage.turn)))
    return alone


def best_apart(poses: Poses, scores: Floats, pivot: Vector3, count: int) -> list[int]:
    """Indices of the best poses, at most ``count``, none a near copy of a better one.

    Near is within 4 cm at the pivot (in ``base``) and 12 deg.
    """
    chosen: list[int] = []
    places = poses[:, :3, :3] @ pivot + poses[:, :3, 3]
    for k in np.argsort(-scores, kind="stable"):
        for other in chosen:
            cosine = 0.5 * (np.trace(poses[k, :3, :3].T @ poses[other, :3, :3]) - 1.0)
            near = np.linalg.norm(places[k] - places[other]) < 0.04
            if near and cosine > np.cos(np.deg2rad(12.0)):
                break
        else:
            chosen.append(int(k))
            if len(chosen) == count:
                break
    return chosen


def climb(
    T_camera_base: Pose,
    pivot: Vector3,
    score: Score,
    shift: float,
    turn: float,
    rounds: int,
    count: int,
    rng: np.random.Generator,
) -> tuple[Pose, float]:
    """A better pose near one by random steps, each round 0.6 times as wide; and its score."""
    best, value = T_camera_base, float(score(T_camera_base[None])[0])
    for _ in range(rounds):
        poses = scattered(best, pivot, shift, turn, count, rng)
        scores = score(poses)
        k = int(np.argmax(scores))
        if scores[k] > value:
            best, value = poses[k], float(scores[k])
        shift, turn = 0.6 * shift, 0.6 * turn
    return best, value


def all_rotations(count: int, rng: np.random.Generator) -> Floats:
    """(count, 3, 3) rotations, evenly at random."""
    return np.asarray(Rotation.random(count, random_state=rng).as_matrix())
