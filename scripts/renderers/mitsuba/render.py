"""Renders a test set with Mitsuba 3: see README.md in the folder above."""

from __future__ import annotations

import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
import trimesh
from sets import Place, main

mi.set_variant("scalar_rgb")

import world  # noqa: E402  # needs the variant

from armsight.recognition.data.arms import Arm  # noqa: E402
from armsight.recognition.data.framing import View  # noqa: E402
from armsight.recognition.data.recipe import Recipe  # noqa: E402
from armsight.robots.catalogue import load_robot  # noqa: E402
from armsight.robots.meshes import read_mesh  # noqa: E402

STREAM = 7_300_000


class MitsubaScene:
    """Shapes by name, as Mitsuba's dictionaries; see ``sets.Scene``."""

    def __init__(self, samples: int) -> None:
        self._samples = samples
        self._shapes: dict[str, Any] = {}

    def place(self, recipe: Recipe, rng: np.random.Generator) -> Place:
        """Surroundings with their light, and what the arm stands on."""
        name, corners, shapes = world.place(rng, recipe.calm_light)
        T_world_base, boxes, stand = world.stand(rng)
        self._shapes |= shapes | stand
        return Place(name, corners, T_world_base, boxes)

    def arm(
        self, recipe: Recipe, arm: Arm, T_world_link: np.ndarray, rng: np.random.Generator
    ) -> None:
        """The arm, a shape a part."""
        self._shapes |= _arm_shapes(recipe, arm, T_world_link, rng)

    def tool(self, T_world_flange: np.ndarray, rng: np.random.Generator) -> str:
        """Something on the flange."""
        name, parts = world.tool(rng, T_world_flange)
        self._shapes |= parts
        return name

    def before(
        self, eye: np.ndarray, target: np.ndarray, span: float, rng: np.random.Generator
    ) -> None:
        """Something between the camera and a point."""
        self._shapes |= world.before(rng, eye, target, span)

    def links(self, view: View) -> np.ndarray:
        """(h, w) link + 1 seen through each pixel's centre."""
        return _see_links(self._shapes, view)

    def picture(
        self, view: View, recipe: Recipe, index: int, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w, 3) uint8."""
        light = _see_light(self._shapes, view, recipe, self._samples, index, rng)
        return _develop(light, recipe, rng)


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
    sys.exit(main(f"mitsuba {mi.__version__} scalar_rgb", STREAM, 16, MitsubaScene, __doc__))
