"""A camera's pose from colour pictures of the moving arm: what moved, then the arm's outline.

The median of the pictures is the room; what differs from it moved: the arm, people, their shadows.
An arm drawn at a pose must explain what moved, and its outline must lie on edges of the picture.
The first is wide and finds the pose to centimetres, the second is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import ColorImage, Floats, Floats32, Ints, Points, Pose, Poses, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, transform
from armsight.recognition.own_arm.answer import ColorView, OwnArmPose, spread
from armsight.recognition.own_arm.color_kernels import outline_equations, silhouette_agreement
from armsight.recognition.own_arm.depth import clustered_covariance
from armsight.recognition.own_arm.kernels import lens_array
from armsight.recognition.own_arm.search import need_views
from armsight.recognition.own_arm.starts import Narrowing, beam, best_apart, scattered
from armsight.recognition.own_arm.surface import SPACING, ArmSurface, render

Masks = NDArray[np.bool_]


@dataclass(frozen=True)
class ColorOptions:
    """How the registration works.

    Attributes:
        shift, turn: how far an old pose may be off at the arm [m] and in direction [rad].
        starts: poses that are tried about an old one; followed: of these, to the end.
        width: of the pictures that are worked on [px].
        cell: edge of the cells in which what moved is compared, the coarse and the fine ones [px].
        moved: least difference from the median picture, grey levels.
        edge: least strength of an edge, grey levels.
        reaches: how far edges are looked for, one an iteration [px].
        least_score, least_seen, most_apart, most_sigma: what an answer must reach to be believed:
            share of what moved that it explains, share of the outline that lies on edges,
            disagreement of the two halves of the views [m], standard deviation [m].
    """

    shift: float = 0.16
    turn: float = 0.14
    starts: int = 2500
    followed: int = 4
    width: int = 640
    cell: tuple[int, int] = (8, 4)
    moved: float = 14.0
    edge: float = 24.0
    reaches: tuple[int, ...] = (16, 14, 12, 10, 8, 7, 6, 5, 4, 4, 3, 3, 3)
    least_score: float = 0.3
    least_seen: float = 0.75
    most_apart: float = 0.03
    most_sigma: float = 0.015


@dataclass(frozen=True)
class Patches:
    """What moved, in cells.

    Attributes:
        cells: (f, h, w) number of the patch, 0 for none. areas: (f, p) cells of each that are no
            shadow.
        lens: of the cells: fx, fy, cx, cy.
    """

    cells: Ints
    areas: Ints
    lens: Floats


@dataclass
class ColorScene:
    """Colour views of the arm by one standing camera, ready to be compared with poses of it.

    Attributes:
        surface: of the arm. options: how.
        lens: straight, of the pictures that are worked on.
        images: (f, h, w, 4) red, green, blue, and how far it differs from the median picture.
        coarse, fine: what moved.
        corners: of each view, the arm's triangles in ``base``.
        points: (f, m, 3) of the arm's surface in ``base``.
        pivot: (3,) the middle of the arm in ``base``.
    """

    surface: ArmSurface
    options: ColorOptions
    lens: PinholeCamera
    images: Floats32
    coarse: Patches
    fine: Patches
    corners: list[Points]
    points: Points
    pivot: Vector3 = field(init=False)

    def __post_init__(self) -> None:
        self.pivot = self.points.reshape(-1, 3).mean(axis=0)

    def agreement(self, poses: Poses, fine: bool, points: int) -> Floats:
        """(k,) how well (k, 4, 4) poses explain what moved, by about so many points a view."""
        patches = self.fine if fine else self.coarse
        step = max(self.points.shape[1] // points, 1)
        spacing = SPACING * float(np.sqrt(step))
        some = np.ascontiguousarray(self.points[:, ::step], np.float64)
        return silhouette_agreement(
            np.ascontiguousarray(poses), some, patches.cells, patches.areas, patches.lens, spacing
        )


def color_scene(
    surface: ArmSurface,
    lens: PinholeCamera,
    views: Sequence[ColorView],
    options: ColorOptions | None = None,
) -> ColorScene:
    """Rectify the pictures and see what moved in them.

    Args:
        surface: of the arm.
        lens: of the pictures.
        views: of one standing camera, the arm in different poses.
        options: how.

    Raises:
        ValueError: there are fewer than three views.
    """
    need_views(views, "colour views")
    o = options or ColorOptions()
    straight = PinholeCamera(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
    small = straight.scaled(o.width / lens.width)
    colors = np.stack([_rectified(v.color, lens, small) for v in views])
    median = np.median(colors, axis=0).astype(np.float32)
    moved = np.abs(colors - median).max(axis=-1)
    images = np.concatenate([colors, np.minimum(2.0 * moved, 255.0)[..., None]], axis=-1)
    noise = 1.48 * float(np.median(moved))
    mask = moved > max(o.moved, 5.0 * noise)
    solid = mask & ~_shadowed(colors, median)
    coarse, fine = (_patches(mask, solid, small, cell) for cell in o.cell)
    posed = np.stack([surface.posed_points(v.joints)[0] for v in views])
    corners = [surface.posed(v.joints) for v in views]
    images = np.ascontiguousarray(images, np.float32)
    return ColorScene(surface, o, small, images, coarse, fine, corners, posed)


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
    """Where a start led to: pose, what it explains, share of the outline on edges, equations."""

    T: Pose
    score: float
    seen: float
    H: Floats
    g: Floats


def _refined(scene: ColorScene, start: Pose, frames: Sequence[int]) -> _End:
    """Gauss-Newton on the outline from one start."""
    T, o = start.copy(), scene.options
    links = scene.surface.robot.n + 1
    lens = lens_array(scene.lens)
    H, g = np.zeros((6, 6)), np.zeros((len(scene.images) * links, 6))
    on, of = 0, 1
    for reach in o.reaches:
        H, g, on, of = np.zeros((6, 6)), np.zeros_like(g), 0, 0
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
        if used < 40:
            break
        step = np.linalg.solve(H + 1e-3 * np.diag(np.diag(H)) + 1e-9 * np.eye(6), -g.sum(axis=0))
        length = float(np.linalg.norm(step[:3]) + np.linalg.norm(step[3:]))
        T = exp(step * min(1.0, 0.15 / max(length, 1e-9))) @ T
    score = float(scene.agreement(T[None], True, 1000)[0])
    return _End(T, score, on / max(of, 1), H, g)


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
    if np.linalg.matrix_rank(end.H) < 6:
        problem = "the arm's outline is hardly seen"
        return OwnArmPose(inverse(end.T), nothing, np.inf, end.score, end.seen, 0.0, views, problem)
    halves = [_refined(scene, end.T, range(k, views, 2)) for k in (0, 1)]
    a, b = (transform(h.T, points) for h in halves)
    apart = float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1))))
    covariance = clustered_covariance(end.H, end.g)
    sigma = spread(covariance, end.T, points)
    # What half of the views say apart is an error that no pixel knows of.
    grown = max(1.0, 0.5 * apart / max(sigma, 1e-9))
    covariance, sigma = covariance * grown**2, sigma * grown
    problem = ""
    if end.score < o.least_score:
        problem = f"only {100 * end.score:.0f} % of what moves agrees with the arm"
    elif end.seen < o.least_seen:
        problem = f"only {100 * end.seen:.0f} % of the arm's outline lies on edges"
    elif apart > o.most_apart:
        problem = f"two halves of the views say {1e3 * apart:.0f} mm apart"
    elif not sigma < o.most_sigma:
        problem = f"what is seen leaves {1e3 * sigma:.0f} mm open; show other poses of the arm"
    return OwnArmPose(inverse(end.T), covariance, sigma, end.score, end.seen, 0.0, views, problem)


def _rectified(color: ColorImage, lens: PinholeCamera, small: PinholeCamera) -> Floats32:
    """(h, w, 3) the picture through a straight lens of the working size."""
    K, distortion = lens.K, np.array(lens.distortion)
    picture = color if lens.is_ideal else cv2.undistort(color, K, distortion, None, K)
    size = (small.width, small.height)
    how = cv2.INTER_AREA if small.width < lens.width else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.float32)


def _shadowed(colors: Floats32, median: Floats32) -> Masks:
    """(f, h, w) where a picture is as the median one, only darker: an arm's shadow, most likely."""
    ratio = (colors + 4.0) / (median + 4.0)
    middle = ratio.mean(axis=-1)
    return np.asarray((np.ptp(ratio, axis=-1) < 0.08) & (middle < 0.95) & (middle > 0.35))


def _patches(mask: Masks, solid: Masks, lens: PinholeCamera, cell: int) -> Patches:
    """What moved, in cells of so many pixels; patches of a cell or two are noise.

    Shadows may be the arm or not: their cells need not be explained, so areas are of the rest.
    """
    h, w = -(-lens.height // cell), -(-lens.width // cell)
    cells = np.zeros((len(mask), h, w), np.int64)
    tables: list[Ints] = []
    for k, moved in enumerate(mask):
        padded = np.zeros((h * cell, w * cell), np.float32)
        padded[: lens.height, : lens.width] = moved
        share = padded.reshape(h, cell, w, cell).mean(axis=(1, 3))
        count, label = cv2.connectedComponents((share > 0.35).astype(np.uint8))
        padded[: lens.height, : lens.width] = solid[k]
        asked = padded.reshape(h, cell, w, cell).mean(axis=(1, 3)) > 0.35
        area = np.bincount(label[asked], minlength=count).astype(np.int64)
        small = np.flatnonzero(area < 3)
        label[np.isin(label, small)] = 0
        area[small] = 0
        cells[k] = label
        tables.append(area)
    areas = np.zeros((len(mask), max(len(t) for t in tables)), np.int64)
    for k, table in enumerate(tables):
        areas[k, : len(table)] = table
    middle = (cell - 1) / 2.0
    straight = np.array(
        [lens.fx / cell, lens.fy / cell, (lens.cx - middle) / cell, (lens.cy - middle) / cell]
    )
    return Patches(cells, areas, straight)
