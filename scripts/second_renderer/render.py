"""Renders a test set with Mitsuba 3, in the layout of ``armsight dataset generate``.

Runs in an environment of its own: see README.md beside it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
import trimesh

mi.set_variant("scalar_rgb")

import world  # noqa: E402  # needs the variant

from armsight.errors import ArmsightError  # noqa: E402
from armsight.recognition.data.arms import Arm, catalogue_arm, made_up_arm, mesh_hash  # noqa: E402
from armsight.recognition.data.configuration import draw_configuration  # noqa: E402
from armsight.recognition.data.framing import View, draw_view  # noqa: E402
from armsight.recognition.data.labels import label_row  # noqa: E402
from armsight.recognition.data.manifest import Manifest  # noqa: E402
from armsight.recognition.data.recipe import Recipe, find_recipe  # noqa: E402
from armsight.recognition.data.rows import Drawn  # noqa: E402
from armsight.recognition.data.sample import KNOWN_ROBOTS  # noqa: E402
from armsight.recognition.data.shards import fill  # noqa: E402
from armsight.recognition.data.things import Surface, Thing  # noqa: E402
from armsight.robots.catalogue import load_robot  # noqa: E402
from armsight.robots.meshes import read_mesh  # noqa: E402

STREAM = 7_300_000
"""Keeps this renderer's random numbers apart from the training renderer's."""
LEAST_SHARE = 0.004


def main() -> int:
    """Render what is missing of the set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--set", choices=["paper-like", "wild"], default="paper-like")
    parser.add_argument("--robots", nargs="+", default=list(KNOWN_ROBOTS))
    parser.add_argument("--count", type=int, default=100, help="of each robot")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", default="256x212")
    parser.add_argument("--samples", type=int, default=16, help="light paths a pixel")
    parser.add_argument("--shard", type=int, default=50)
    parser.add_argument(
        "--distance", type=float, nargs=2, help="of the camera to the base [m]; else the set's"
    )
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    manifest = Manifest(
        kind=options.set,
        renderer=f"mitsuba {mi.__version__} scalar_rgb",
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
            yield [draw_sample(manifest, recipe, i, options.samples) for i in batch]

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


def draw_sample(manifest: Manifest, recipe: Recipe, index: int, samples: int) -> Drawn:
    """Sample ``index``: robots take turns."""
    names = list(manifest.counts)
    robot = names[index % len(names)]
    for attempt in range(60):
        rng = np.random.default_rng([manifest.seed, STREAM, index, attempt])
        found = _set_up(manifest, recipe, robot, rng)
        if found is None:
            continue
        q, T_world_link, T_world_base, view, shapes, words = found
        links = _see_links(shapes, view)
        if robot != "none" and (links > 0).mean() < LEAST_SHARE:
            continue
        image = _develop(_see_light(shapes, view, recipe, samples, index, rng), recipe, rng)
        quality = int(rng.integers(80, 98))
        jpeg = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        png = cv2.imencode(".png", links)[1]
        words["brightness"] = float(image.mean() / 255.0)
        words["burnt"] = float((image.min(axis=2) >= 250).mean())
        place = (index, manifest.seed, index)
        row = label_row(place, robot, view, q, T_world_link, T_world_base, links, words)
        return Drawn(row, jpeg.tobytes(), png.tobytes())
    raise ArmsightError(f"sample {index}: no scene after 60 attempts; take another seed")


def _set_up(manifest: Manifest, recipe: Recipe, robot: str, rng: np.random.Generator) -> Any:
    place, corners, shapes = world.place(rng, recipe.calm_light)
    T_world_base, boxes, stand = world.stand(rng)
    blocked = [
        Thing("box", (float(h[0]), float(h[1]), float(h[2])), T, Surface((0.5, 0.5, 0.5)))
        for T, h in boxes
    ]
    if robot == "unknown":
        arm = made_up_arm(rng)
    else:
        arm = catalogue_arm(str(rng.choice(KNOWN_ROBOTS)) if robot == "none" else robot)
    q = draw_configuration(arm, T_world_base, blocked, rng)
    if q is None:
        return None
    T_world_link = T_world_base @ arm.link_poses(q)
    centers = arm.spheres(T_world_link)
    size = (manifest.width, manifest.height)
    base = T_world_base[:3, 3]
    view = draw_view(recipe, size, centers, arm.sphere_radius, base, corners, rng)
    if view is None:
        return None
    # Mitsuba's pixels are square, and its thin lens knows no shift and no bend.
    middle = {"cx": 0.5 * (size[0] - 1), "cy": 0.5 * (size[1] - 1)}
    lens = replace(view.lens, fy=view.lens.fx, distortion=(0.0, 0.0, 0.0, 0.0, 0.0), **middle)
    view = View(lens, view.T_world_camera, view.cut)
    words: dict[str, float | str] = {"place": place, "cut": float(view.cut), "tool": "none"}
    shapes |= stand
    if robot != "none":
        shapes |= _arm_shapes(recipe, arm, T_world_link, rng)
        if rng.random() < recipe.tool:
            words["tool"], parts = world.tool(rng, T_world_link[-1] @ arm.T_last_flange)
            shapes |= parts
        if rng.random() < 0.5 * recipe.occluder:
            target = centers[rng.integers(len(centers))]
            span = float(np.linalg.norm(np.ptp(centers, axis=0)))
            eye = view.T_world_camera[:3, 3]
            shapes |= world.before(rng, eye, target, span)
    return q, T_world_link, T_world_base, view, shapes, words


@cache
def _ply(robot: str, number: int) -> str:
    """File of a part with corners kept sharp and curves smooth."""
    mesh = load_robot(robot).meshes[number]
    vertices, faces = read_mesh(mesh)
    solid = trimesh.graph.smooth_shade(trimesh.Trimesh(vertices, faces), angle=np.deg2rad(35))
    path = Path(_FOLDER.name) / f"{robot}_{number}.ply"
    clean = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    clean.export(path, vertex_normal=False)
    return str(path)


_FOLDER = tempfile.TemporaryDirectory()


def _arm_shapes(
    recipe: Recipe, arm: Arm, T_world_link: np.ndarray, rng: np.random.Generator
) -> dict[str, Any]:
    """The arm in lacquer, plastic and bare metal; ``link_i_k`` is a part of link i."""
    shapes: dict[str, Any] = {}
    repainted = rng.random() < recipe.repaint
    tint = world.draw_color(rng) if repainted else np.ones(3)
    rough, coat = float(rng.uniform(0.15, 0.6)), float(rng.uniform(0, 1))
    for k, part in enumerate(arm.parts):
        linear = np.asarray(part.color) ** 2.2
        color = 0.7 * tint + 0.3 * linear if repainted else linear * rng.uniform(0.95, 1.05)
        grey = np.ptp(part.color) < 0.04
        bsdf = {
            "type": "principled",
            "base_color": {"type": "rgb", "value": [float(c) for c in np.clip(color, 0.005, 0.95)]},
            "roughness": rough,
            "metallic": 0.5 if grey and 0.3 < part.color[0] < 0.85 else 0.0,
            "clearcoat": coat,
        }
        T = T_world_link[part.link] @ part.T_link_part
        key = f"link_{part.link}_{k}"
        if part.kind == "mesh":
            name, number = part.mesh.split("/")
            shapes[key] = {
                "type": "ply",
                "filename": _ply(name, int(number)),
                "to_world": world.transform(T),
                "bsdf": {"type": "twosided", "bsdf": bsdf},
            }
        else:
            shapes |= world.primitive(part.kind, part.size, T, bsdf, key)
    return shapes


def _sensor(view: View, film: dict[str, Any], sampler: dict[str, Any], lens: dict[str, Any]) -> Any:
    """Mitsuba's camera looks along +z with x to the left and y up."""
    camera = view.lens
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    return {
        "fov": float(np.rad2deg(2 * np.arctan(0.5 * camera.width / camera.fx))),
        "fov_axis": "x",
        "near_clip": 0.05,
        "far_clip": 100.0,
        "to_world": world.transform(view.T_world_camera @ turn),
        "film": {"type": "hdrfilm", "width": camera.width, "height": camera.height, **film},
        "sampler": sampler,
        **lens,
    }


def _see_links(shapes: dict[str, Any], view: View) -> np.ndarray:
    """(h, w) link + 1 seen through each pixel's centre."""
    # One sample a pixel, not shaken: through the centre.
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}
    film = {"pixel_format": "luminance", "rfilter": {"type": "box"}}
    sensor = _sensor(view, film, sampler, {"type": "perspective"})
    plain = {k: _labelled(k, v) for k, v in shapes.items() if "to_world" in v and "bsdf" in v}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, **plain})
    integrator = mi.load_dict({"type": "aov", "aovs": "label:albedo"})
    seen = np.array(mi.render(scene, integrator=integrator, spp=1))[..., -1]
    return np.round(np.nan_to_num(seen) * _WHITE).astype(np.uint8)


_WHITE = 32.0
"""Labels are painted as greys in steps of a 32nd."""


def _labelled(key: str, shape: dict[str, Any]) -> dict[str, Any]:
    """The shape in the grey that stands for its label."""
    label = int(key.split("_")[1]) + 1 if key.startswith("link_") else 0
    grey = {"type": "rgb", "value": [label / _WHITE] * 3}
    return shape | {"bsdf": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": grey}}}


def _see_light(
    shapes: dict[str, Any],
    view: View,
    recipe: Recipe,
    samples: int,
    index: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(h, w, 3) float32 linear."""
    sampler = {"type": "independent", "sample_count": samples, "seed": index}
    film = {"pixel_format": "rgb", "rfilter": {"type": "gaussian"}}
    lens: dict[str, Any] = {"type": "perspective"}
    if rng.random() < 0.4:
        lens = {
            "type": "thinlens",
            "aperture_radius": float(rng.uniform(0.001, 0.006)),
            "focus_distance": float(rng.uniform(*recipe.distance)),
        }
    scene = mi.load_dict({"type": "scene", "sensor": _sensor(view, film, sampler, lens), **shapes})
    path = mi.load_dict({"type": "path", "max_depth": 5})
    return np.array(mi.render(scene, integrator=path, spp=samples, seed=index), np.float32)


def _develop(light: np.ndarray, recipe: Recipe, rng: np.random.Generator) -> np.ndarray:
    """(h, w, 3) uint8: exposed for the median, then a film's curve instead of a power."""
    # What few light paths leave behind would be no camera's fault: fireflies are cut down.
    light = np.nan_to_num(light)
    light = np.minimum(light, 2.0 * cv2.medianBlur(light, 3) + 1e-3)
    middle = max(float(np.median(light)), 1e-4)
    x = light * 0.22 / middle * 2.0 ** np.clip(rng.normal(0, recipe.exposure), -1.5, 1.5)
    x *= 1 + recipe.white_balance * rng.uniform(-1, 1, 3)
    # Narkowicz's fit of the ACES curve.
    film = np.clip(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0, 1)
    display = np.asarray(np.round(255 * film ** (1 / 2.2)), np.uint8)
    # Few light paths leave more grain than cameras do; then comes the camera's own.
    clean = cv2.fastNlMeansDenoisingColored(display, None, 6, 6, 5, 15).astype(np.float32)
    grain = 255 * (0.004 + recipe.noise * rng.random()) * rng.normal(0, 1, clean.shape)
    return np.asarray(np.clip(np.round(clean + grain), 0, 255), np.uint8)


if __name__ == "__main__":
    sys.exit(main())
