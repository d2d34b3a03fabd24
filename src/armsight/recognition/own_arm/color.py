"""A camera's pose from colour pictures of the moving arm: what moved, then the arm's outline.

An arm drawn at a pose must explain what moved, and its outline must lie on edges of the picture.
The first is wide and finds the pose to centimetres, the second is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Floats, Ints, Points, Pose, Poses
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, transform
from armsight.recognition.own_arm.answer import ColorView, OwnArmPose, spread
from armsight.recognition.own_arm.arm_errors import in_camera, link_errors, link_places
from armsight.recognition.own_arm.color_kernels import outline_equations
from armsight.recognition.own_arm.color_scene import ColorOptions, ColorScene, color_scene
from armsight.recognition.own_arm.covariance import clustered_covariance, considered
from armsight.recognition.own_arm.kernels import lens_array
from armsight.recognition.own_arm.starts import Narrowing, beam, best_apart, scattered
from armsight.recognition.own_arm.surface import ArmSurface, render


def register_color(
    surface: ArmSurface,
    lens: PinholeCamera,
    views: Sequence[ColorView],
    start: Pose,
    options: ColorOptions | None = None,
    seed: int = 0,
) -> OwnArmPose:
    """The pose of a colour camera from an old one and pictures of the arm at work.

    Args:
        surface: of the arm.
        lens: of the pictures.
        views: at least three, better six, of a camera that stands.
        start: ``T_base_camera`` as it was believed.
        options: how.
        seed: of the starts that are tried.

    Raises:
        ValueError: there are fewer than three views.
    """
    scene = color_scene(surface, lens, views, options)
    o, rng = scene.options, np.random.default_rng(seed)
    return near(scene, inverse(start), o.shift, o.turn, o.starts, rng)


def near(
    scene: ColorScene, start: Pose, shift: float, turn: float, starts: int, rng: np.random.Generator
) -> OwnArmPose:
    """The best answer about a pose.

    Args:
        scene: the views.
        start: ``T_camera_base``, tried itself as well.
        shift: how far it may be off at the arm [m].
        turn: and in direction [rad].
        starts: poses that are tried about it.
        rng: source of randomness.
    """
    poses = scattered(start, scene.pivot, shift, turn, starts, rng)
    poses = poses[np.argsort(-scene.agreement(poses, False, 300), kind="stable")[:100]]
    return follow(scene, [start, *narrowed_starts(scene, poses, NEAR_BEAM, rng)])


LEAST_EDGES = 40
"""Points of the outline on edges, of all views together, that a step takes."""
NEAR_BEAM = (
    Narrowing(0.05, 0.06, 0.0, 300, 40, 16),
    Narrowing(0.025, 0.03, 1.0, 400, 20, 24),
    Narrowing(0.012, 0.015, 1.0, 600, 12, 24),
)
"""Stages with a tolerance compare in the fine cells."""


def narrowed_starts(
    scene: ColorScene,
    poses: Poses,
    stages: Sequence[Narrowing],
    rng: np.random.Generator,
    followed: int = 0,
) -> list[Pose]:
    """The best few poses, none like another; as many as the options say, or ``followed``."""

    def score(candidates: Poses, stage: Narrowing) -> Floats:
        return scene.agreement(candidates, stage.tolerance > 0.0, stage.points)

    found, scores = beam(poses, scene.pivot, score, stages, rng)
    chosen = best_apart(found, scores, scene.pivot, followed or scene.options.followed)
    return [found[k] for k in chosen]


def follow(scene: ColorScene, starts: Sequence[Pose]) -> OwnArmPose:
    """The answer that agrees best among those that the starts lead to."""
    every = range(len(scene.images))
    ends = [_refined(scene, T, every) for T in starts]
    # What moved includes people and shadows; edges under the whole outline are the arm's alone.
    best = max(ends, key=lambda e: e.score * e.seen**2)
    return _judged(scene, best)


@dataclass(frozen=True)
class _End:
    """Where a start led to: pose, what it explains, share of the outline on edges, equations.

    Those are (v links, 6, 6) and (v links, 6). ``held``: there were edges enough to hold on to.
    """

    T: Pose
    score: float
    seen: float
    H: Floats
    g: Floats
    held: bool


def promising(scene: ColorScene, poses: Sequence[Pose], most: int) -> list[Pose]:
    """Where a short pursuit leads, the best few: some views, large steps.

    What moved may be explained better by a wrong pose, which takes people for the arm; edges under
    its whole outline are not there then.
    """
    views = range(0, len(scene.images), 2)
    ends = [_refined(scene, T, views, scene.options.reaches[::3]) for T in poses]
    worth = np.array([e.score * e.seen**2 for e in ends])
    found = np.stack([e.T for e in ends])
    return [found[k] for k in best_apart(found, worth, scene.pivot, most)]


def _refined(
    scene: ColorScene, start: Pose, frames: Sequence[int], reaches: Sequence[int] = ()
) -> _End:
    """Gauss-Newton on the outline from one start."""
    T, o = start.copy(), scene.options
    links = scene.surface.robot.n + 1
    lens = lens_array(scene.lens)
    H, g = np.zeros((len(scene.images) * links, 6, 6)), np.zeros((len(scene.images) * links, 6))
    on, of, used = 0, 1, 0
    for reach in reaches or o.reaches:
        H, g, on, of = np.zeros_like(H), np.zeros_like(g), 0, 0
        used = 0
        for k in frames:
            points, normals, owner = outline(scene, k, T)
            if not len(points):
                continue
            found = np.empty(len(points))
            image, scale = scene.images[k], max(0.3 * reach, 1.0)
            used += outline_equations(
                T,
                points,
                normals,
                owner + k * links,
                image,
                lens[:4],
                reach,
                scale,
                o.edge,
                H,
                g,
                found,
            )
            with np.errstate(invalid="ignore"):
                on += int((np.abs(found) < 2.5).sum())
            of += len(points)
        if used < LEAST_EDGES:
            break
        whole = H.sum(axis=0)
        damped = whole + 1e-3 * np.diag(np.diag(whole)) + 1e-9 * np.eye(6)
        step = np.linalg.solve(damped, -g.sum(axis=0))
        length = float(np.linalg.norm(step[:3]) + np.linalg.norm(step[3:]))
        T = exp(step * min(1.0, 0.15 / max(length, 1e-9))) @ T
    score = float(scene.agreement(T[None], True, 1000)[0])
    return _End(T, score, on / max(of, 1), H, g, used >= LEAST_EDGES)


def outline(scene: ColorScene, frame: int, T: Pose) -> tuple[Points, Floats, Ints]:
    """Points of the arm's outline at a pose, with normals in the picture and links.

    Returns:
        (m, 3) in ``base``, (m, 2) outwards, (m,) links.
    """
    size = (scene.lens.width, scene.lens.height)
    drawn = render(scene.surface, scene.corners[frame], T, lens_array(scene.lens), size)
    inside = drawn.mask.astype(np.float32)
    if not inside.any():
        return np.empty((0, 3)), np.empty((0, 2)), np.empty(0, np.int64)
    core = cv2.erode(inside, np.ones((3, 3), np.uint8), borderValue=1.0)
    rim = (inside > 0) & (core < 1)
    soft = cv2.GaussianBlur(inside, (0, 0), 2.0)
    row, column = drawn.at.T
    mine = rim[row, column]
    row, column = row[mine], column[mine]
    slope = np.stack(
        [
            cv2.Sobel(soft, cv2.CV_32F, 1, 0)[row, column],
            cv2.Sobel(soft, cv2.CV_32F, 0, 1)[row, column],
        ],
        axis=1,
    ).astype(float)
    length = np.linalg.norm(slope, axis=1)
    good = np.flatnonzero(length > 1e-3)
    normals = -slope[good] / length[good][:, None]
    points = drawn.points[mine][good]
    return points[::2], normals[::2], drawn.owner[mine][good][::2]


def _judged(scene: ColorScene, end: _End) -> OwnArmPose:
    """The answer with its covariance, and whether it is to be believed."""
    o, views = scene.options, len(scene.images)
    points = scene.points.reshape(-1, 3)[:: max(scene.points.size // 600, 1)]
    nothing = np.full((6, 6), np.nan)
    whole = end.H.sum(axis=0)
    if np.linalg.matrix_rank(whole) < 6:
        problem = "the arm's outline is hardly seen"
        return OwnArmPose(inverse(end.T), nothing, np.inf, end.score, end.seen, 0.0, views, problem)
    halves = [_refined(scene, end.T, range(k, views, 2)) for k in (0, 1)]
    a, b = (transform(h.T, points) for h in halves)
    apart = float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))
    covariance = clustered_covariance(whole, end.g)
    # What half of the views say apart is an error that no pixel knows of.
    grown = max(1.0, 0.5 * apart / max(spread(covariance, end.T, points), 1e-9))
    moved = np.einsum("vlab,vlbm->am", end.H.reshape(views, -1, 6, 6), _unseen(scene, end.T))
    covariance = covariance * grown**2 + considered(whole, moved)
    sigma = spread(covariance, end.T, points)
    problem = ""
    if end.score < o.least_score:
        problem = f"only {100 * end.score:.0f} % of what moves agrees with the arm"
    elif end.seen < o.least_seen:
        problem = f"only {100 * end.seen:.0f} % of the arm's outline lies on edges"
    elif not all(half.held for half in halves):
        problem = "the arm is hardly seen in one half of the views; show it in more of them"
    elif apart > o.most_apart:
        problem = f"two halves of the views say {1e3 * apart:.0f} mm apart"
    elif not sigma < o.most_sigma:
        problem = f"what is seen leaves {1e3 * sigma:.0f} mm open; show other poses of the arm"
    return OwnArmPose(inverse(end.T), covariance, sigma, end.score, end.seen, 0.0, views, problem)


def _unseen(scene: ColorScene, T: Pose) -> Floats:
    """(v, links, 6, m) errors of the arm and of the lens as twists in the camera's frame.

    A picture that is shifted or too large shows each link as if it stood elsewhere.
    """
    robot, o, lens = scene.surface.robot, scene.options, scene.lens
    place = link_places(robot, scene.joints, T)
    shown = np.zeros((*place.shape[:2], 6, 3))
    shown[..., 0, 0] = o.middle * place[..., 2] / lens.fx
    shown[..., 1, 1] = o.middle * place[..., 2] / lens.fy
    shown[..., :2, 2] = o.focal * place[..., :2]
    arm = in_camera(link_errors(robot, scene.joints, o.arm), T)
    return np.concatenate([arm, shown], axis=-1)
