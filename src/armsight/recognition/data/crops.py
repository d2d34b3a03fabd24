"""Crops that follow the arm: several cameras in one scene, since a room costs more than a look.

A scene follows from the seed and its number, a crop from these and its place in the scene, so that
any worker makes the same set; the scene's number is that of its first crop.
"""

from __future__ import annotations

from dataclasses import replace

from armsight.errors import DatasetError
from armsight.recognition.data.framing import draw_crop
from armsight.recognition.data.painter import Painter
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.recording import Place
from armsight.recognition.data.rows import Drawn
from armsight.recognition.data.sample import NO_ROBOT, robot_number
from armsight.recognition.data.sampling import finish, is_poor, look
from armsight.recognition.data.staging import Setting, draw_setting, stage
from armsight.recognition.data.streams import Streams

SCENES = 60
"""Scenes that are tried for one that has room for all its cameras."""
LOOKS = 12
"""Places of a camera that are tried in a scene."""


def draw_crops(
    painter: Painter, recipe: Recipe, robot: str, size: tuple[int, int], seed: int, scene: int
) -> list[Drawn]:
    """All ``recipe.views`` pictures of a scene.

    Args:
        painter: the renderer.
        recipe: of the set.
        robot: type of the samples.
        size: width, height [px].
        seed: of the set.
        scene: its number, from 0.

    Raises:
        DatasetError: no scene could be set up, which the recipes of armsight do not cause.
    """
    first = scene * recipe.views
    number = robot_number(robot)
    for attempt in range(SCENES):
        streams = Streams(seed, number, 0, first, attempt, shared=False)
        setting = draw_setting(recipe, robot, size, streams, Place(0))
        if setting is None:
            continue
        crops: list[Drawn] = []
        for k in range(recipe.views):
            own = replace(streams, index=first + k)
            crop = _draw_crop(painter, recipe, setting, size, streams, own)
            if crop is None:
                break
            crops.append(crop)
        else:
            return crops
    raise DatasetError(
        f"scene {scene} ({robot}): no room for its cameras after {SCENES} attempts; take another "
        "seed"
    )


def _draw_crop(
    painter: Painter,
    recipe: Recipe,
    setting: Setting,
    size: tuple[int, int],
    streams: Streams,
    own: Streams,
) -> Drawn | None:
    """One picture, or None if the scene does not let a camera see enough."""
    base, rng = setting.stand.T_world_base[:3, 3], own.of_sample("view")
    corners = setting.room.corners
    for _ in range(LOOKS):
        view = draw_crop(recipe, size, setting.centers, setting.radii, base, corners, rng)
        if view is None:
            return None
        staged = stage(recipe, setting, view, streams, own)
        links, seen = look(painter, staged, setting.robot)
        if setting.robot != NO_ROBOT and is_poor(links, seen):
            continue
        staged.words["seen"] = seen
        return finish(painter, recipe, setting.robot, staged, links, own)
    return None
