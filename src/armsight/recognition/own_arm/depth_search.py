"""A camera's pose from depth of the moving arm with nothing believed of it: a search of all poses.

What moves between the views stands out from what was seen behind it: lumps of depth, some of the
arm, some of people. For each of many rotations, each lump proposes the translation that would put
the arm's middle there, and every proposal is held against all views: a lump that is a person in one
view has no arm in the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats, Points, Poses
from armsight.devices.data import DepthNoise
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.own_arm.answer import DepthView, OwnArmPose
from armsight.recognition.own_arm.depth import (
    DepthOptions,
    DepthScene,
    MovingDepth,
    better,
    follow,
)
from armsight.recognition.own_arm.search import (
    attempted,
    moving_points,
    need_views,
    nothing_moves,
    turned_about,
)
from armsight.recognition.own_arm.starts import Narrowing, all_rotations, beam, best_apart
from armsight.recognition.own_arm.surface import ArmSurface

STEP = 0.06
"""Nearer than what is behind it by this, something moved there [m]."""
STANDING = 0.2
"""What a pixel is worth that shows nothing that moves."""
Masks = NDArray[np.bool_]
LEAST_PIXELS = 60
"""Of a lump."""
LUMPS = 5
"""Of each view, the largest ones."""
ATTEMPTS = 3
"""Searches with other rotations while the answer is not believed."""
ROTATIONS = 2500
THINNED = 6
"""One in so many points of the surface says where its middle is."""
WIDTH = 2000
"""Proposals with which the beam begins."""


BEAM = (
    Narrowing(0.10, 0.20, 0.08, 60, 800, 20),
    Narrowing(0.07, 0.15, 0.07, 60, 300, 24),
    Narrowing(0.05, 0.10, 0.06, 80, 120, 32),
    Narrowing(0.035, 0.07, 0.05, 100, 60, 40),
    Narrowing(0.025, 0.05, 0.035, 150, 40, 40),
    Narrowing(0.015, 0.03, 0.025, 200, 40, 40),
)


def search_depth(
    surface: ArmSurface,
    lens: PinholeCamera,
    noise: DepthNoise,
    views: Sequence[DepthView],
    options: DepthOptions | None = None,
    seed: int = 0,
) -> OwnArmPose:
    """The pose of a depth camera from views of the arm in different poses, with no start.

    Args:
        surface: of the arm.
        lens: of the depth images.
        noise: random error of its readings.
        views: at least three, better four or more, by a camera that stands.
        options: how.
        seed: of the rotations that are tried.

    Raises:
        ValueError: there are fewer than three views.
    """
    need_views(views, "depth views")
    scene = DepthScene(surface, lens, noise, views, options or DepthOptions())
    moved = nearer_than_behind(scene)
    lumps = moving_lumps(scene, moved)
    if not any(lumps):
        return nothing_moves(len(views), -1.0)
    images = {stage.tolerance: moving_depth(scene, moved, stage.tolerance) for stage in BEAM}
    return attempted(
        ATTEMPTS,
        seed,
        lambda rng, _: _searched(scene, lumps, images, rng),
        lambda a: a.score * a.seen,
    )


def _searched(
    scene: DepthScene,
    lumps: list[list[Points]],
    images: dict[float, MovingDepth],
    rng: np.random.Generator,
) -> OwnArmPose:
    """One search: proposals, a beam that narrows, the best few to the end."""
    poses = _proposed(scene, lumps, all_rotations(ROTATIONS, rng))
    first = BEAM[0].tolerance
    scores = scene.agreement(poses, first, 60, images[first])
    poses = poses[np.argsort(-scores, kind="stable")[:WIDTH]]

    def score(candidates: Poses, stage: Narrowing) -> Floats:
        image = images[stage.tolerance]
        return scene.agreement(candidates, stage.tolerance, stage.points, image)

    poses, scores = beam(poses, scene.pivot, score, BEAM, rng)
    chosen = best_apart(poses, scores, scene.pivot, scene.options.followed)
    return follow(scene, better(scene, [poses[k] for k in chosen], rng))


def nearer_than_behind(scene: DepthScene) -> Masks:
    """(f, h, w) where a view sees something before what another view sees there, or sees at all."""
    behind = np.where(np.isfinite(scene.depths), scene.depths, -np.inf).max(axis=0)
    with np.errstate(invalid="ignore"):
        nearer = np.asarray(behind - scene.depths > STEP)
    square = np.ones((3, 3), np.uint8)
    # Walls out of range give nothing; single pixels are lost anywhere.
    blank = np.stack([np.isnan(v.depth) for v in scene.views]).astype(np.uint8)
    empty = np.any([cv2.erode(m, square) for m in blank], axis=0).astype(np.uint8)
    appeared = np.isfinite(scene.depths) & cv2.dilate(empty, square).astype(bool)
    moved = (nearer | appeared).astype(np.uint8)
    return np.stack([cv2.morphologyEx(m, cv2.MORPH_OPEN, square) for m in moved]).astype(bool)


def moving_depth(scene: DepthScene, moved: Masks, tolerance: float) -> MovingDepth:
    """Depth in which what moved is as much wider as the search is coarse, and worth more.

    A coarse pose sees past the arm: without the rim, it would be punished more than one that hides
    the arm in a table, where nothing contradicts it.

    Args:
        scene: the views.
        moved: (f, h, w) from :func:`nearer_than_behind`.
        tolerance: of the search [m].
    """
    depths, credit = scene.depths.copy(), np.full(scene.depths.shape, STANDING, np.float32)
    for k, mask in enumerate(moved):
        if not mask.any():
            continue
        usual = float(np.nanmedian(scene.depths[k][mask]))
        reach = int(np.clip(round(scene.lens.fx * tolerance / usual), 1, 40))
        seen = np.where(mask & np.isfinite(depths[k]), depths[k], np.float32(1e3))
        wide = cv2.erode(seen, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        rim = (wide < 1e2) & ~mask
        depths[k][rim] = wide[rim]
        credit[k][rim | mask] = 1.0
    return MovingDepth(depths, credit)


def moving_lumps(scene: DepthScene, moved: Masks) -> list[list[Points]]:
    """Of each view, the clouds [m] of what moved."""
    found: list[list[Points]] = []
    for depth, mask in zip(scene.depths, moved):
        count, label, stats, _ = cv2.connectedComponentsWithStats(
            mask.astype(np.uint8), connectivity=4
        )
        sizes = stats[1:, cv2.CC_STAT_AREA] if count > 1 else np.empty(0, int)
        order = [int(k) + 1 for k in np.argsort(-sizes) if sizes[k] >= LEAST_PIXELS][:LUMPS]
        lumps: list[Points] = []
        for k in order:
            v, u = np.nonzero((label == k) & np.isfinite(depth))
            z = depth[v, u].astype(float)
            lumps.append(np.column_stack([scene.lens.rays[v, u] * z[:, None], z]))
        found.append(lumps)
    return found


def _proposed(scene: DepthScene, lumps: list[list[Points]], rotations: Floats) -> Poses:
    """(k, 4, 4) poses that put what moves of the arm where a lump is."""
    moving = moving_points(scene.surface, THINNED)
    poses: list[Poses] = []
    for points, normals, clouds in zip(scene.points, scene.normals, lumps):
        p, n = points[moving], normals[moving]
        for cloud in clouds:
            middle = np.median(cloud, axis=0)
            sight = middle / np.linalg.norm(middle)
            # The side that faces the camera is what the lump shows: its middle, for each rotation.
            facing = (rotations @ n.T).transpose(0, 2, 1) @ sight < -0.2
            count = np.maximum(facing.sum(axis=1), 1)
            shown = (facing @ p) / count[:, None]
            poses.append(turned_about(rotations, shown, middle))
    return np.concatenate(poses)
