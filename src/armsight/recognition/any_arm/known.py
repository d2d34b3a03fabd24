"""Where an arm is whose joint angles are known: many starts, judged by the whole silhouette.

Six numbers are left, and a mask of some hundred cells with a dozen landmarks: the landmarks propose
poses, each is drawn, and the best are moved at random in smaller and smaller steps towards more
overlap with the mask and less contradiction with the landmarks. The outline has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Floats32, JointVector, Mask, Pose
from armsight.geometry.pose import make_pose, transform
from armsight.recognition.any_arm.landmarks import Landmarks
from armsight.recognition.any_arm.outline import Edge, follow_outline, outline_overlap, within
from armsight.recognition.any_arm.solver import Fit, Observations, cost_of, far_starts, solve
from armsight.recognition.any_arm.views import Crop
from armsight.recognition.own_arm.surface import arm_surface, drawn
from armsight.robots.robot import Robot

CELLS = 40
"""Side of the small pictures in which poses are compared."""
WEIGHT = 0.06
"""Mean cost of an observation, in overlap: a landmark that is far off costs about 2 of it."""
STARTS = 10
"""Poses from far that are tried besides those that were followed."""
ENDS = 3
"""Poses that are brought to the outline."""


@dataclass(frozen=True)
class _Round:
    """One round: turn [rad], shift [m], share of the distance; poses kept, tries of each."""

    turn: float
    shift: float
    scale: float
    kept: int
    tries: int


ROUNDS = (
    _Round(0.30, 0.030, 0.12, 6, 8),
    _Round(0.15, 0.020, 0.08, 5, 10),
    _Round(0.08, 0.010, 0.04, 4, 12),
    _Round(0.04, 0.006, 0.02, 3, 12),
)


def place_known(
    robot: Robot,
    marks: Landmarks,
    seen: Observations,
    arm: Floats32,
    crop: Crop,
    q: JointVector,
    seed: int = 0,
) -> tuple[Fit, float] | None:
    """The pose of an arm at known joints, and its overlap with the mask; None without landmarks.

    Args:
        robot: the arm.
        marks: its landmarks.
        seen: what the network says of these.
        arm: (side, side) probability of the arm in the crop.
        crop: itself.
        q: (n,) joints [rad].
        seed: of the steps.
    """
    fits = solve(robot, marks, seen, known=q)
    if not fits:
        return None
    edge = Edge.of(arm, crop)
    score = _Score(fits[0], seen, arm, edge)
    poses = [fit.T_camera_base for fit in fits]
    poses += [make_pose(R, t) for R, t, _ in far_starts(robot, marks, seen, q)[:STARTS]]
    best = [(score(T), T) for T in poses]
    rng = np.random.default_rng([seed, 61])
    for step in ROUNDS:
        tried = [score.moved(T, step, rng) for _, T in best for _ in range(step.tries)]
        best = _apart([*best, *((score(T), T) for T in tried)], 0.5 * step.turn, step.kept)
    ends = [follow_outline(score.fit(T), seen, edge, known=True) for _, T in best[:ENDS]]
    found = max(ends, key=lambda fit: score.last(fit))
    return found, outline_overlap(found, edge)


class _Score:
    """How well a pose explains a crop."""

    def __init__(self, fit: Fit, seen: Observations, arm: Floats32, edge: Edge) -> None:
        self._fit, self._seen, self._edge = fit, seen, edge
        self._surface = arm_surface(fit.robot)
        self._corners = self._surface.posed(fit.q)
        self._middle = self._corners.mean(axis=0)
        crop = edge.crop
        f, middle = crop.f * CELLS / crop.side, 0.5 * (CELLS - 1)
        self._lens = np.array([f, f, middle, middle, 0, 0, 0, 0, 0.0])
        small = cv2.resize(arm, (CELLS, CELLS), interpolation=cv2.INTER_AREA)
        self._inside: Mask = within(crop, CELLS)
        self._wanted: Floats = np.clip(2.5 * (small - 0.5) + 0.5, 0.0, 1.0) * self._inside

    def fit(self, T: Pose) -> Fit:
        return Fit(self._fit.robot, T, self._fit.q, 0.0, self._fit.information)

    def __call__(self, T: Pose) -> float:
        if float((T[:3, :3] @ self._middle + T[:3, 3])[2]) < 0.2:
            return -np.inf
        seen = transform(T, self._corners)
        mask = drawn(self._surface, seen, self._lens, (CELLS, CELLS))[1] >= 0
        mine = (mask & self._inside).astype(float)
        overlap = np.minimum(mine, self._wanted).sum() / max(
            np.maximum(mine, self._wanted).sum(), 1.0
        )
        return float(overlap) - self._contradiction(self.fit(T))

    def last(self, fit: Fit) -> float:
        """The same of a pose at its outline, in the finer picture."""
        return outline_overlap(fit, self._edge) - self._contradiction(fit)

    def _contradiction(self, fit: Fit) -> float:
        return WEIGHT * cost_of(fit, self._seen) / max(len(self._seen.link), 1)

    def moved(self, T: Pose, step: _Round, rng: np.random.Generator) -> Pose:
        """Turned about the arm's middle, shifted across, nearer or farther."""
        R = Rotation.from_rotvec(step.turn * rng.normal(size=3)).as_matrix() @ T[:3, :3]
        at = T[:3, :3] @ self._middle + T[:3, 3]
        across = step.shift * rng.normal(size=3) * [1.0, 1.0, 0.0]
        at = at * np.exp(step.scale * rng.normal()) + across
        return make_pose(R, at - R @ self._middle)


def _apart(found: list[tuple[float, Pose]], turn: float, most: int) -> list[tuple[float, Pose]]:
    """The best few that differ."""
    kept: list[tuple[float, Pose]] = []
    for score, T in sorted(found, key=lambda f: -f[0]):
        if all(
            np.abs(T[:3, :3] - other[:3, :3]).max() > turn
            or np.abs(T[:3, 3] - other[:3, 3]).max() > 0.05
            for _, other in kept
        ):
            kept.append((score, T))
        if len(kept) == most:
            break
    return kept
