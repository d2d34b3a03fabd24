"""One labelled picture from the set's seed and the sample's index, and from nothing else."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage
from armsight.errors import DatasetError
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.data.emphasis import NO_EMPHASIS, Emphasis
from armsight.recognition.data.labels import label_row
from armsight.recognition.data.painter import Painter
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.recording import Place
from armsight.recognition.data.rows import Drawn
from armsight.recognition.data.sample import NO_ROBOT, robot_number
from armsight.recognition.data.sensor import (
    OVERSAMPLING,
    brightness,
    develop,
    distort,
    draw_sensor,
    expose,
    to_jpeg,
)
from armsight.recognition.data.staging import Stage, set_up
from armsight.recognition.data.streams import Streams

ATTEMPTS = 60
PATIENCE = 40
"""Attempts after which an emphasis takes whatever comes."""
LEAST_SHARE = 0.004
"""Of the picture that a robot fills."""
LEAST_SEEN = 0.7
"""Share of the arm that things before it leave free; occluders that hide more are taken away."""


def draw_sample(
    painter: Painter,
    recipe: Recipe,
    robot: str,
    size: tuple[int, int],
    seed: int,
    index: int,
    place: Place,
    emphasis: Emphasis = NO_EMPHASIS,
) -> Drawn:
    """Draw sample ``index`` of a set.

    Args:
        painter: the renderer.
        recipe: of the set.
        robot: type of the sample.
        size: width, height [px].
        seed: of the set.
        index: of the sample.
        place: room of the sample, used if the recipe shares rooms, and its frame in a recording.
        emphasis: which scenes are taken more often.

    Raises:
        DatasetError: no scene could be set up, which the recipes of armsight do not cause.
    """
    number = robot_number(robot)
    for attempt in range(ATTEMPTS):
        streams = Streams(seed, number, place.scene, index, attempt, recipe.scenes > 0)
        stage = set_up(recipe, robot, size, streams, place)
        if stage is None:
            continue
        links, seen = look(painter, stage, robot)
        # A frame of a recording is what it is; its camera watches the whole sweep.
        if is_poor(links, seen) and robot != NO_ROBOT and not recipe.recorded:
            continue
        stage.words["seen"] = seen
        if emphasis.bins and attempt < PATIENCE:
            chance = emphasis.chance(_measures(stage, links, seen))
            if streams.of_sample("emphasis").random() >= chance:
                continue
        return finish(painter, recipe, robot, stage, links, streams)
    raise DatasetError(
        f"sample {index} ({robot}): no scene after {ATTEMPTS} attempts; take another seed"
    )


def is_poor(links: Bytes, seen: float) -> bool:
    """Whether too little is seen of the arm."""
    return bool((links > 0).mean() < LEAST_SHARE or seen < 0.5)


def _measures(stage: Stage, links: Bytes, seen: float) -> dict[str, float]:
    """What an emphasis can weigh."""
    lens = stage.view.lens
    sight = stage.view.T_world_camera[:3, 3] - stage.T_world_base[:3, 3]
    distance = float(np.linalg.norm(sight))
    return {
        "distance": distance,
        "elevation_deg": float(np.rad2deg(np.arcsin(sight[2] / distance))),
        "fov_deg": float(np.rad2deg(2 * np.arctan(0.5 * lens.width / lens.fx))),
        "share": float((links > 0).mean()),
        "seen": seen,
    }


def look(painter: Painter, stage: Stage, robot: str) -> tuple[Bytes, float]:
    """Link ids, and the share of the arm that nothing hides; takes occluders away if need be."""
    if robot == NO_ROBOT:
        return np.zeros((stage.view.lens.height, stage.view.lens.width), np.uint8), 1.0
    alone = int((see_links(painter, stage, robot_only=True) > 0).sum())
    links = see_links(painter, stage)
    seen = float((links > 0).sum() / max(alone, 1))
    if seen < LEAST_SEEN and stage.occluders:
        hidden = {id(thing) for thing in stage.occluders}
        stage.scene.things[:] = [t for t in stage.scene.things if id(t) not in hidden]
        stage.words["occluders"] = 0.0
        links = see_links(painter, stage)
        seen = float((links > 0).sum() / max(alone, 1))
    return links, seen


def see_links(painter: Painter, stage: Stage, robot_only: bool = False) -> Bytes:
    """(h, w) link + 1 that each pixel's centre sees, 0 where it sees something else."""
    lens = stage.view.lens
    wide = _ideal(lens, 1)
    things = stage.robot_things if robot_only else stage.scene.things
    ids = painter.labels(things, stage.view.T_world_camera, wide)
    return ids if lens.is_ideal else distort(ids, wide, lens, nearest=True)


def see_color(painter: Painter, stage: Stage) -> ColorImage:
    """(2h, 2w, 3) what the lens lets through."""
    lens = stage.view.lens.scaled(OVERSAMPLING)
    wide = _ideal(stage.view.lens, OVERSAMPLING)
    picture = painter.color(stage.scene, stage.view.T_world_camera, wide)
    return picture if lens.is_ideal else distort(picture, wide, lens, nearest=False)


def _ideal(lens: PinholeCamera, factor: int) -> PinholeCamera:
    """A lens that bends nothing and sees all that the given one sees, at a multiple of its size."""
    margin = 0 if lens.is_ideal else _margin(lens)
    wide = PinholeCamera(
        lens.width + 2 * margin,
        lens.height + 2 * margin,
        lens.fx,
        lens.fy,
        lens.cx + margin,
        lens.cy + margin,
    )
    return wide.scaled(factor)


def _margin(lens: PinholeCamera) -> int:
    """Pixels that a bent lens may see beyond the picture of a straight one."""
    corners = np.array(
        [[0, 0], [lens.width - 1, 0], [0, lens.height - 1], [lens.width - 1, lens.height - 1]],
        float,
    )
    rays = lens.normalise(corners)
    straight = rays * [lens.fx, lens.fy] + [lens.cx, lens.cy]
    return int(np.ceil(np.abs(straight - corners).max())) + 1


def finish(
    painter: Painter,
    recipe: Recipe,
    robot: str,
    stage: Stage,
    links: Bytes,
    streams: Streams,
) -> Drawn:
    """The picture and its labels, from a stage of which something is seen."""
    lens = stage.view.lens
    # A recording is made by one camera in one light.
    topic = streams.of_scene if recipe.recorded else streams.of_sample
    sensor = draw_sensor(recipe, topic("sensor"))
    mosaic = expose(sensor, see_color(painter, stage), streams.of_sample("noise"))
    picture = develop(sensor, mosaic, (lens.width, lens.height))
    if recipe.grey and streams.of_sample("grey").random() < recipe.grey:
        grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        picture = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2RGB), np.uint8)
    mean, burnt = brightness(picture)
    words = stage.words
    words["brightness"] = round(float(mean.mean()), 4)
    words["burnt"] = round(burnt, 4)
    words["exposure"] = sensor.exposure
    words["seen"] = round(float(words["seen"]), 4)
    ok, png = cv2.imencode(".png", links, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not ok:
        raise ValueError("link ids cannot be written as PNG")
    scene = 1000 * streams.robot + streams.scene if streams.shared else streams.index
    if recipe.views > 1:
        scene = streams.index // recipe.views
    row = label_row(
        (streams.index, streams.seed, scene),
        robot,
        stage.view,
        stage.q,
        stage.T_world_link,
        stage.T_world_base,
        links,
        stage.words,
    )
    return Drawn(row, to_jpeg(sensor, picture), bytes(png.tobytes()))
