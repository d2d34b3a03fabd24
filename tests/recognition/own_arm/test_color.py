"""A colour camera finds itself by the moving arm, and knows when it did not."""

import cv2
import numpy as np
import pytest
from tests.recognition.own_arm.synthetic import LENS, T_BASE_CAMERA, corners, robot

from armsight.geometry.pose import exp, inverse, transform
from armsight.recognition.own_arm import color, color_search
from armsight.recognition.own_arm.answer import ColorView, OwnArmPose
from armsight.recognition.own_arm.color import register_color
from armsight.recognition.own_arm.color_scene import ColorOptions, ColorScene
from armsight.recognition.own_arm.color_search import search_color
from armsight.recognition.own_arm.surface import arm_surface

OPTIONS = ColorOptions(width=256, starts=600, cell=(4, 2))
TURNS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.9, 0.3, -0.4, 0.3, 0.5, 0.0],
        [-0.8, -0.3, 0.6, -0.5, 0.2, 0.4],
        [1.6, 0.2, 0.3, 0.6, -0.6, 0.1],
        [-1.5, 0.4, -0.2, -0.3, 0.3, 0.2],
    ]
)


def painted(triangles: np.ndarray, number: int) -> np.ndarray:
    """(h, w, 3) the arm before a patterned wall, filled triangle by triangle by OpenCV, far first.

    Drawn at four times the size and shrunk, so that its outline is smooth.
    """
    rng = np.random.default_rng(number)
    wall = np.random.default_rng(99).uniform(60, 200, (12, 14, 3)).astype(np.float32)
    big = cv2.resize(wall, (4 * LENS.width, 4 * LENS.height), interpolation=cv2.INTER_NEAREST)
    seen = transform(inverse(T_BASE_CAMERA), triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    n = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    pixels = (LENS.project(seen.reshape(-1, 3)).reshape(-1, 3, 2) + 0.5) * 4 - 0.5
    for k in np.argsort(-seen[:, :, 2].mean(axis=1)):
        if (n[k] * seen[k].mean(axis=0)).sum() < 0:
            shade = 225 + 25 * float(n[k, 0])
            cv2.fillConvexPoly(big, np.round(pixels[k] * 16).astype(int), (shade,) * 3, shift=4)
    small = cv2.resize(big, (LENS.width, LENS.height), interpolation=cv2.INTER_AREA)
    return np.clip(small + rng.normal(0, 2, small.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def views() -> list[ColorView]:
    arm = robot()
    return [
        ColorView(arm.home + turn, painted(corners(arm, arm.home + turn), k))
        for k, turn in enumerate(TURNS)
    ]


def off(T_base_camera: np.ndarray) -> float:
    """Root mean square error of where corners of the arm's reach are placed [m]."""
    box = np.array([[x, y, z, 1.0] for x in (-0.4, 0.4) for y in (-0.4, 0.4) for z in (0, 0.8)])
    T = T_base_camera @ inverse(T_BASE_CAMERA)
    return float(np.sqrt((((box @ T.T - box)[:, :3]) ** 2).sum(axis=1).mean()))


def test_an_old_pose_is_mended(views: list[ColorView]) -> None:
    start = T_BASE_CAMERA @ exp([0.05, -0.06, 0.05, 0.06, -0.06, 0.06])
    assert off(start) > 0.1
    answer = register_color(arm_surface(robot()), LENS, views, start, OPTIONS)
    assert answer.believed
    assert off(answer.T_base_camera) < 0.012
    assert answer.sigma < 0.015


def test_a_half_of_the_views_that_shows_no_arm_does_not_agree(
    views: list[ColorView], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of every second view the arm is beyond the picture: nobody says anything against the rest."""
    drawn = color.outline

    def outline(scene: ColorScene, frame: int, T: np.ndarray) -> object:
        points, normals, links = drawn(scene, frame, T)
        shown = len(points) if frame % 2 == 0 else 0
        return points[:shown], normals[:shown], links[:shown]

    monkeypatch.setattr(color, "outline", outline)
    answer = register_color(arm_surface(robot()), LENS, views, T_BASE_CAMERA, OPTIONS)
    assert not answer.believed
    assert "half of the views" in answer.problem


def test_joints_of_another_moment_are_not_believed(views: list[ColorView]) -> None:
    wrong = [ColorView(views[(k + 1) % 5].joints, v.color) for k, v in enumerate(views)]
    answer = register_color(arm_surface(robot()), LENS, wrong, T_BASE_CAMERA, OPTIONS)
    assert not answer.believed
    assert answer.problem


def test_a_room_in_which_nothing_moves_is_not_believed(views: list[ColorView]) -> None:
    rng = np.random.default_rng(5)
    empty = rng.integers(90, 100, views[0].color.shape, np.uint8)
    still = [ColorView(v.joints, empty) for v in views]
    surface = arm_surface(robot())
    assert not register_color(surface, LENS, still, T_BASE_CAMERA, OPTIONS).believed
    answer = search_color(surface, LENS, still, OPTIONS)
    assert not answer.believed
    assert "nothing moves" in answer.problem


GUESSES = ([0.03, -0.04, 0.02, 0.03, -0.02, 0.03], [-0.03, 0.02, 0.04, -0.03, 0.03, 0.0])
"""Twists by which single pictures err [m, rad]."""


def test_guesses_of_single_pictures_are_brought_to_the_outline(
    views: list[ColorView], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two are about right and one is another camera's: nothing else needs to be searched."""
    monkeypatch.setattr(color_search, "_proposed", lambda *_: pytest.fail("searched all poses"))
    wild = T_BASE_CAMERA @ exp([1.5, 0.3, 0.2, 0.4, 2.0, 0.1])
    guesses = [wild, *(T_BASE_CAMERA @ exp(twist) for twist in GUESSES)]
    answer = search_color(arm_surface(robot()), LENS, views, OPTIONS, guesses=guesses)
    assert answer.believed
    assert off(answer.T_base_camera) < 0.012


def test_an_answer_far_from_what_guesses_agree_on_must_show_more_of_itself(
    views: list[ColorView], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float] = []
    nearest = color_search.near

    def near(scene: ColorScene, *rest: object) -> OwnArmPose:
        asked.append(scene.options.least_seen)
        return nearest(scene, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(color_search, "near", near)
    aside = exp([0.05, 0.05, 0.05, 0.0, 0.0, 0.0])
    guesses = [T_BASE_CAMERA @ aside @ exp([0.0, 0.0, d, 0.0, 0.0, 0.0]) for d in (0.0, 0.01)]
    found = search_color(arm_surface(robot()), LENS, views, OPTIONS, guesses=guesses)
    assert asked[:2] == [OPTIONS.least_seen, color_search.LEAST_SEEN]
    assert off(found.T_base_camera) < 0.012


def test_wrong_guesses_do_not_keep_the_search_from_looking_everywhere(
    views: list[ColorView], monkeypatch: pytest.MonkeyPatch
) -> None:
    searched: list[int] = []

    def proposed(scene: ColorScene, rotations: np.ndarray) -> np.ndarray:
        searched.append(len(rotations))
        return np.stack([inverse(T_BASE_CAMERA @ exp(0.2 * np.array(GUESSES[0])))])

    monkeypatch.setattr(color_search, "_proposed", proposed)
    wild = [T_BASE_CAMERA @ exp([1.5, 0.3, 0.2, 0.4, 2.0, 0.1])]
    answer = search_color(arm_surface(robot()), LENS, views, OPTIONS, guesses=wild)
    assert searched
    assert off(answer.T_base_camera) < 0.012


def test_views_are_asked_for() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        register_color(arm_surface(robot()), LENS, [], T_BASE_CAMERA)
