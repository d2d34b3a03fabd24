"""A camera's pose from colour pictures of the moving arm with nothing believed of it.

A network that knows the arm may guess from single pictures; else what moved proposes, as in
:mod:`.depth_search`, but a patch that moved tells a direction only: each is tried at several
distances, with many rotations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, Points, Pose, Poses
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
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
ABOUT_GUESS, ABOUT_GUESSES = (0.10, 0.08, 1500), (0.04, 0.04, 800)
"""Of the search about a guess, and about one that others agree with: shift [m], turn [rad],
starts."""
AGREE = 0.08
"""Poses agree that put the arm's points so near to each other, root mean square [m]."""
WITNESSES, BORNE_OUT = 2, 0.02
"""Guesses that agree, and how near to the mean of these an answer puts the arm's points [m], from
which it counts as one that was believed before."""
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
    guesses: Sequence[Pose] = (),
) -> OwnArmPose:
    """The pose of a colour camera from pictures of the arm in different poses, with no start.

    What was guessed is tried first. Then poses in which the arm stands and the camera is upright:
    there are four times fewer of them, so that they are tried more closely.

    Args:
        surface: of the arm.
        lens: of the pictures.
        views: at least three, better six, by a camera that stands.
        options: how; an answer that no guesses bear out must show more of itself than they say.
        seed: of the rotations that are tried.
        guesses: ``T_base_camera``, at most one by each of the pictures; some may be wrong.

    Raises:
        ValueError: there are fewer than three views.
    """
    scene = color_scene(surface, lens, views, options)
    if not scene.coarse.areas[:, 1:].any():
        return nothing_moves(len(views), 0.0)
    from_nowhere = replace(scene.options, least_seen=max(scene.options.least_seen, LEAST_SEEN))
    strict = replace(scene, options=from_nowhere)
    guessed = np.array([inverse(T) for T in guesses])

    def attempt(rng: np.random.Generator, number: int) -> OwnArmPose:
        if number == 0 and len(guessed):
            return _about_guesses(scene, strict, guessed, rng)
        first = number == int(len(guessed) > 0)
        rotations = upright_rotations(rng) if first else all_rotations(ROTATIONS, rng)
        poses = _proposed(scene, rotations)
        scores = scene.agreement(poses, False, 60)
        poses = poses[np.argsort(-scores, kind="stable")[:WIDTH]]
        starts = narrowed_starts(scene, poses, BEAM, rng, PURSUED)
        found = follow(strict, promising(scene, starts, FOLLOWED))
        # A beam from everywhere ends near the answer, and often on a lower hill beside it.
        return near(strict, inverse(found.T_base_camera), *POLISH, rng)

    attempts = ATTEMPTS + int(len(guessed) > 0)
    return attempted(attempts, seed, attempt, lambda a: a.score * a.seen**2)


def _about_guesses(
    scene: ColorScene, strict: ColorScene, guessed: Poses, rng: np.random.Generator
) -> OwnArmPose:
    """The best answer about the guess that most others agree with."""
    points = scene.points.reshape(-1, 3)[::THINNED]
    places: Floats = np.stack([transform(T, points) for T in guessed])
    agree = np.array([[_apart(a, b) < AGREE for a in places] for b in places])
    explained = scene.agreement(guessed, False, 300)
    best = max(range(len(guessed)), key=lambda k: (agree[k].sum(), explained[k]))
    witnesses = int(agree[best].sum())
    about = ABOUT_GUESSES if witnesses > WITNESSES else ABOUT_GUESS
    found = near(scene, guessed[best], *about, rng)
    T = inverse(found.T_base_camera)
    borne_out = _apart(transform(T, points), places[agree[best]].mean(axis=0)) < BORNE_OUT
    if not found.believed or (witnesses >= WITNESSES and borne_out):
        return found
    return near(strict, T, *POLISH, rng)


def _apart(a: Points, b: Points) -> float:
    """Root mean square distance of (m, 3) points [m]."""
    return float(np.sqrt(((a - b) ** 2).sum(axis=1).mean()))


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
