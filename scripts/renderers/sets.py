"""A test set of another renderer, in the layout of ``armsight dataset generate``.

What stands where, the camera and the labels are drawn here, the same way for every renderer;
what is seen besides the arm is the renderer's own: see ``Scene``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from armsight.errors import ArmsightError
from armsight.recognition.data.arms import Arm, catalogue_arm, made_up_arm, mesh_hash
from armsight.recognition.data.configuration import draw_configuration
from armsight.recognition.data.framing import View, draw_view
from armsight.recognition.data.labels import label_row
from armsight.recognition.data.manifest import Manifest
from armsight.recognition.data.recipe import Recipe, find_recipe
from armsight.recognition.data.rows import Drawn
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.recognition.data.shards import fill
from armsight.recognition.data.things import Surface, Thing

LEAST_SHARE = 0.004
"""An arm that covers less of the picture is not seen."""


@dataclass(frozen=True)
class Place:
    """Where an arm stands.

    Attributes:
        name: of the surroundings.
        corners: (2, 3) of where a camera may be [m].
        T_world_base: of the arm.
        boxes: poses and half sizes [m] of what the arm must not touch.
    """

    name: str
    corners: np.ndarray
    T_world_base: np.ndarray
    boxes: list[tuple[np.ndarray, Any]]


class Scene(Protocol):
    """One scene of a renderer; all lengths in metres, all poses 4x4."""

    def place(self, recipe: Recipe, rng: np.random.Generator) -> Place:
        """Surroundings with their light, and what the arm stands on."""
        ...

    def arm(
        self, recipe: Recipe, arm: Arm, T_world_link: np.ndarray, rng: np.random.Generator
    ) -> None:
        """The arm itself."""
        ...

    def tool(self, T_world_flange: np.ndarray, rng: np.random.Generator) -> str:
        """Something on its flange; what, in words."""
        ...

    def before(
        self, eye: np.ndarray, target: np.ndarray, span: float, rng: np.random.Generator
    ) -> None:
        """Something between the camera and a point of an arm that is ``span`` [m] large."""
        ...

    def links(self, view: View) -> np.ndarray:
        """(h, w) uint8: which link a pixel's centre sees, plus 1; 0 for none."""
        ...

    def picture(
        self, view: View, recipe: Recipe, index: int, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w, 3) uint8 RGB."""
        ...


def main(
    renderer: str, stream: int, samples: int, new: Callable[[int], Scene], words: str | None
) -> int:
    """Render what is missing of a set.

    Args:
        renderer: name and version, for the manifest.
        stream: keeps the renderer's random numbers apart from those of others.
        samples: light paths a pixel, unless told otherwise.
        new: an empty scene that is drawn with so many.
        words: what the program does.
    """
    parser = argparse.ArgumentParser(description=words)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", choices=["paper-like", "wild"], default="paper-like")
    parser.add_argument("--robots", nargs="+", default=list(KNOWN_ROBOTS))
    parser.add_argument("--count", type=int, default=100, help="of each robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", default="256x212")
    parser.add_argument("--samples", type=int, default=samples, help="light paths a pixel")
    parser.add_argument("--shard", type=int, default=50)
    parser.add_argument(
        "--distance", type=float, nargs=2, help="of the camera to the base [m]; else the set's"
    )
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    manifest = Manifest(
        kind=options.set,
        renderer=renderer,
        seed=options.seed,
        width=width,
        height=height,
        counts=dict.fromkeys(options.robots, options.count),
        scenes=0,
        shard_size=options.shard,
        meshes={name: mesh_hash(name) for name in options.robots if name in KNOWN_ROBOTS},
        settings={"samples": str(options.samples)} | _said(options.distance),
    )
    # No recordings here: every picture has a place of its own.
    recipe = find_recipe(options.set)
    if options.distance is not None:
        recipe = replace(recipe, distance=tuple(options.distance))

    def draw(batches: Iterator[range]) -> Iterator[list[Drawn]]:
        for batch in batches:
            yield [
                _sample(manifest, recipe, stream, lambda: new(options.samples), i) for i in batch
            ]

    try:
        fill(manifest, options.out, draw, lambda done, total: print(done, "of", total), 5)
    except ArmsightError as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted; run the same command again to go on", file=sys.stderr)
        return 130
    return 0


def _said(distance: list[float] | None) -> dict[str, str]:
    return {} if distance is None else {"distance": f"{distance[0]:g} {distance[1]:g}"}


def _sample(
    manifest: Manifest, recipe: Recipe, stream: int, new: Callable[[], Scene], index: int
) -> Drawn:
    """Sample ``index``: robots take turns."""
    names = list(manifest.counts)
    robot = names[index % len(names)]
    for attempt in range(60):
        rng = np.random.default_rng([manifest.seed, stream, index, attempt])
        scene = new()
        found = _set_up(scene, manifest, recipe, robot, rng)
        if found is None:
            continue
        q, T_world_link, T_world_base, view, words = found
        links = scene.links(view)
        if robot != "none" and (links > 0).mean() < LEAST_SHARE:
            continue
        image = scene.picture(view, recipe, index, rng)
        quality = int(rng.integers(80, 98))
        jpeg = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        png = cv2.imencode(".png", links)[1]
        words["brightness"] = float(image.mean() / 255.0)
        words["burnt"] = float((image.min(axis=2) >= 250).mean())
        numbers = (index, manifest.seed, index)
        row = label_row(numbers, robot, view, q, T_world_link, T_world_base, links, words)
        return Drawn(row, jpeg.tobytes(), png.tobytes())
    raise ArmsightError(f"sample {index}: no scene after 60 attempts; take another seed")


def _set_up(
    scene: Scene, manifest: Manifest, recipe: Recipe, robot: str, rng: np.random.Generator
) -> Any:
    place = scene.place(recipe, rng)
    blocked = [
        Thing("box", (float(h[0]), float(h[1]), float(h[2])), T, Surface((0.5, 0.5, 0.5)))
        for T, h in place.boxes
    ]
    if robot == "unknown":
        arm = made_up_arm(rng)
    else:
        arm = catalogue_arm(str(rng.choice(KNOWN_ROBOTS)) if robot == "none" else robot)
    q = draw_configuration(arm, place.T_world_base, blocked, rng)
    if q is None:
        return None
    T_world_link = place.T_world_base @ arm.link_poses(q)
    centers = arm.spheres(T_world_link)
    size = (manifest.width, manifest.height)
    base = place.T_world_base[:3, 3]
    view = draw_view(recipe, size, centers, arm.sphere_radius, base, place.corners, rng)
    if view is None:
        return None
    # These renderers' pixels are square, and their lenses know no shift and no bend.
    middle = {"cx": 0.5 * (size[0] - 1), "cy": 0.5 * (size[1] - 1)}
    lens = replace(view.lens, fy=view.lens.fx, distortion=(0.0, 0.0, 0.0, 0.0, 0.0), **middle)
    view = View(lens, view.T_world_camera, view.cut)
    words: dict[str, float | str] = {"place": place.name, "cut": float(view.cut), "tool": "none"}
    if robot != "none":
        scene.arm(recipe, arm, T_world_link, rng)
        if rng.random() < recipe.tool:
            words["tool"] = scene.tool(T_world_link[-1] @ arm.T_last_flange, rng)
        if rng.random() < 0.5 * recipe.occluder:
            target = centers[rng.integers(len(centers))]
            span = float(np.linalg.norm(np.ptp(centers, axis=0)))
            scene.before(view.T_world_camera[:3, 3], target, span, rng)
    return q, T_world_link, place.T_world_base, view, words
