"""A camera's pose from colour pictures of the moving arm with nothing believed of it.

As :mod:`.depth_search`, but a patch that moved tells a direction only: each is tried at several
distances, with many rotations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Poses
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.recognition.own_arm.answer import ColorView, OwnArmPose
from armsight.recognition.own_arm.color import follow, narrowed_starts, near, promising
from armsight.recognition.own_arm.color_scene import ColorOptions, ColorScene, color_scene
from armsight.recognition.own_arm.search import (
    attempted,
    moving_points,
    nothing_moves,
    turned_about,
)
from armsight.recognition.own_arm.starts import Narrowing, all_rotations
from armsight.recognition.own_arm.surface import ArmSurface

ROTATIONS = 1500
ATTEMPTS = 2
"""Searches while the answer is not believed: among cameras that are held upright before an arm that
stands, as most are, and then among all."""
UPRIGHT = (0.4, 0.1)
"""Of the direction up in the camera's frame: to a side and downwards at most."""
DISTANCES = (0.8, 1.1, 1.5, 2.0, 2.7, 3.6)
"""Of the arm's middle from the camera that are tried [m]."""
LEAST_SEEN = 0.85
"""Share of the outline on edges; a pose from nowhere must show more than one that was believed."""
POLISH = (0.06, 0.06, 1200)
"""Of the search about its own answer: shift [m], turn [rad], starts."""
PATCHES = 3
"""Of each view, the largest ones."""
WIDTH = 2500
"""Proposals with which the beam begins."""
PURSUED, FOLLOWED = 100, 8
"""Of the beam: for some steps, and to the end."""
THINNED = 12
"""One in so many points of the surface says where its middle is."""
BEAM = (
    Narrowing(0.15, 0.20, 0.0, 120, 900, 16, apart=True),
    Narrowing(0.10, 0.15, 0.0, 150, 450, 20, apart=True),
    Narrowing(0.07, 0.10, 0.0, 200, 200, 24, apart=True),
    Narrowing(0.045, 0.06, 0.0, 300, 100, 30, apart=True),
    Narrowing(0.03, 0.04, 1.0, 400, 100, 24, apart=True),
)
"""Stages with a tolerance compare in the fine cells."""


def search_color(
    surface: ArmSurface,
    lens: PinholeCamera,
    views: Sequence[ColorView],
    options: ColorOptions | None = None,
    seed: int = 0,
) -> OwnArmPose:
    """The pose of a colour camera from pictures of the arm in different poses, with no start.

    Poses in which the arm stands and the camera is upright are tried first: there are four times
    fewer of them, so that they are tried more closely.

    Args:
        surface: of the arm.
        lens: of the pictures.
        views: at least three, better six, by a camera that stands.
        options: how; if absent, an answer must show more of itself than from an old pose.
        seed: of the rotations that are tried.

    Raises:
        ValueError: there are fewer than three views.
    """
    scene = color_scene(surface, lens, views, options or ColorOptions(least_seen=LEAST_SEEN))
    if not scene.coarse.areas[:, 1:].any():
        return nothing_moves(len(views), 0.0)

    def attempt(rng: np.random.Generator, number: int) -> OwnArmPose:
        rotations = upright_rotations(rng) if number == 0 else all_rotations(ROTATIONS, rng)
        poses = _proposed(scene, rotations)
        scores = scene.agreement(poses, False, 60)
        poses = poses[np.argsort(-scores, kind="stable")[:WIDTH]]
        starts = narrowed_starts(scene, poses, BEAM, rng, PURSUED)
        found = follow(scene, promising(scene, starts, FOLLOWED))
        # A beam from everywhere ends near the answer, and often on a lower hill beside it.
        return near(scene, inverse(found.T_base_camera), *POLISH, rng)

    return attempted(ATTEMPTS, seed, attempt, lambda a: a.score * a.seen**2)


def upright_rotations(rng: np.random.Generator) -> Floats:
    """(ROTATIONS, 3, 3) ``R_camera_base`` of cameras held upright, evenly at random."""
    every = all_rotations(8 * ROTATIONS, rng)
    aside, down = every[:, 0, 2], every[:, 1, 2]
    return every[(np.abs(aside) < UPRIGHT[0]) & (down < UPRIGHT[1])][:ROTATIONS]


def _proposed(scene: ColorScene, rotations: Floats) -> Poses:
    """(k, 4, 4) poses that put what moves of the arm into a patch, at one of the distances."""
    moving = moving_points(scene.surface, THINNED)
    fx, fy, cx, cy = scene.coarse.lens
    poses: list[Poses] = []
    for points, cells, areas in zip(scene.points, scene.coarse.cells, scene.coarse.areas):
        middle = points[moving].mean(axis=0)
        largest = np.argsort(-areas[1:], kind="stable")[:PATCHES] + 1
        for patch in largest[areas[largest] > 0]:
            v, u = np.nonzero(cells == patch)
            ray = np.array([(u.mean() - cx) / fx, (v.mean() - cy) / fy, 1.0])
            ray /= np.linalg.norm(ray)
            for distance in DISTANCES:
                poses.append(turned_about(rotations, middle, distance * ray))
    return np.concatenate(poses)
