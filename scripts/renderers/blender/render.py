"""Renders a test set with Blender's Cycles: see README.md in the folder above."""

from __future__ import annotations

import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"

import bpy
import cv2
import materials
import mathutils
import numpy as np
import rooms
import shapes
import trimesh
from sets import Place, main

from armsight.recognition.data.arms import Arm
from armsight.recognition.data.framing import View
from armsight.recognition.data.recipe import Recipe
from armsight.robots.catalogue import load_robot
from armsight.robots.meshes import read_mesh

STREAM = 8_400_000
THREADS = int(os.environ.get("ARMSIGHT_THREADS", "0"))
"""Of one picture; 0: all cores."""
STEP = 16
"""Labels are painted as greys in steps of so many."""
FOLDER = tempfile.TemporaryDirectory()


class BlenderScene:
    """Blender's one scene, emptied; see ``sets.Scene``."""

    def __init__(self, samples: int) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._samples = samples
        self._scene = bpy.context.scene
        render = self._scene.render
        render.engine = "CYCLES"
        render.threads_mode, render.threads = ("FIXED", THREADS) if THREADS else ("AUTO", 1)
        render.resolution_percentage = 100

    def place(self, recipe: Recipe, rng: np.random.Generator) -> Place:
        """Surroundings with their light, and what the arm stands on."""
        name, corners = rooms.draw(rng, recipe.calm_light)
        T_world_base, boxes = rooms.stand(rng)
        return Place(name, corners, T_world_base, boxes)

    def arm(
        self, recipe: Recipe, arm: Arm, T_world_link: np.ndarray, rng: np.random.Generator
    ) -> None:
        """The arm in its maker's paint or another, caps of plastic, flanges of metal."""
        paint = _paint(recipe, rng)
        worn = bool(rng.random() < recipe.worn)
        known: dict[Any, Any] = {}
        for part in arm.parts:
            linear = np.asarray(part.color) ** 2.2
            look = known.get(part.color)
            if look is None:
                look = known[part.color] = _look(linear, paint, worn, rng)
            T = T_world_link[part.link] @ part.T_link_part
            if part.kind == "mesh":
                shapes.solid(_surface(part.mesh), T, look, part.link + 1)
            else:
                shapes.primitive(part.kind, part.size, T, look, part.link + 1)
        if rng.random() < recipe.cable:
            rooms.hang(rng, T_world_link[:, :3, 3])

    def tool(self, T_world_flange: np.ndarray, rng: np.random.Generator) -> str:
        """Something on the flange."""
        return rooms.tool(rng, T_world_flange)

    def before(
        self, eye: np.ndarray, target: np.ndarray, span: float, rng: np.random.Generator
    ) -> None:
        """Something between the camera and a point."""
        rooms.before(rng, eye, target, span)

    def links(self, view: View) -> np.ndarray:
        """(h, w) link + 1 seen through each pixel's centre."""
        self._look(view)
        scene, layer = self._scene, self._scene.view_layers[0]
        world, scene.world = scene.world, None
        layer.material_override = _labels()
        scene.cycles.samples, scene.cycles.use_denoising = 1, False
        scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
        scene.view_settings.view_transform = "Raw"
        scene.render.dither_intensity = 0.0
        image = self._shoot("PNG", "8")
        scene.world, layer.material_override = world, None
        return np.asarray(np.round(image[..., 0].astype(float) / STEP), np.uint8)

    def picture(
        self, view: View, recipe: Recipe, index: int, rng: np.random.Generator
    ) -> np.ndarray:
        """(h, w, 3) uint8."""
        self._look(view)
        cycles, lens = self._scene.cycles, self._scene.camera.data
        cycles.samples, cycles.seed, cycles.max_bounces = self._samples, index, 4
        cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
        cycles.use_adaptive_sampling, cycles.caustics_reflective = False, False
        cycles.denoising_quality, cycles.denoising_prefilter = "BALANCED", "ACCURATE"
        cycles.diffuse_bounces, cycles.sample_clamp_indirect = 2, 5.0
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 1.5
        if rng.random() < 0.5:
            lens.dof.use_dof, lens.dof.aperture_fstop = True, float(rng.uniform(1.8, 8.0))
            lens.dof.focus_distance = float(rng.uniform(*recipe.distance))
        light = self._shoot("OPEN_EXR", "32")[..., 2::-1]
        return _develop(np.nan_to_num(light), recipe, rng)

    def _look(self, view: View) -> None:
        """Blender's camera looks along -z, y up."""
        camera, scene = view.lens, self._scene
        if scene.camera is None:
            made = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
            scene.collection.objects.link(made)
            scene.camera = made
        lens = scene.camera.data
        lens.sensor_fit, lens.clip_start = "HORIZONTAL", 0.02
        lens.angle = float(2 * np.arctan(0.5 * camera.width / camera.fx))
        lens.dof.use_dof = False
        turned = view.T_world_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
        scene.camera.matrix_world = mathutils.Matrix(turned.tolist())
        scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height

    def _shoot(self, form: str, depth: str) -> np.ndarray:
        """(h, w, 3) BGR as it was written."""
        render = self._scene.render
        ending = ".png" if form == "PNG" else ".exr"
        file = Path(FOLDER.name) / f"shot{ending}"
        settings = render.image_settings
        settings.file_format, settings.color_mode, settings.color_depth = form, "RGB", depth
        render.filepath = str(file)
        bpy.ops.render.render(write_still=True)
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert image is not None
        return np.asarray(image)


def _paint(recipe: Recipe, rng: np.random.Generator) -> np.ndarray | None:
    """(3,) linear RGB of another paint than the maker's; None: the maker's."""
    if rng.random() >= recipe.repaint:
        return None
    white = rng.random() < 0.55
    names = materials.WHITE if white else tuple(materials.RAL)
    return np.asarray(materials.RAL[str(rng.choice(names))])


def _look(
    linear: np.ndarray, paint: np.ndarray | None, worn: bool, rng: np.random.Generator
) -> Any:
    """The material of all parts of one colour."""
    grey, bright = np.ptp(linear) < 0.03, float(linear.mean())
    if bright < 0.02:
        return materials.rubber(rng)
    if grey and 0.05 < bright < 0.6 and rng.random() < 0.6:
        return materials.metal(str(rng.choice(["aluminium", "steel"])), rng)
    color = linear if paint is None else 0.85 * paint + 0.15 * linear
    return materials.painted(np.clip(color * rng.uniform(0.95, 1.05), 0.005, 0.95), rng, worn)


@cache
def _surface(name: str) -> trimesh.Trimesh:
    robot, number = name.split("/")
    vertices, faces = read_mesh(load_robot(robot).meshes[int(number)])
    return trimesh.Trimesh(vertices, faces)


def _labels() -> Any:
    """Shines with the number of what it is on."""
    made = bpy.data.materials.new("labels")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    which, times = nodes.new("ShaderNodeObjectInfo"), nodes.new("ShaderNodeMath")
    shines, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    times.operation = "MULTIPLY"
    times.inputs[1].default_value = STEP / 255.0
    links.new(which.outputs["Object Index"], times.inputs[0])
    links.new(times.outputs[0], shines.inputs["Strength"])
    links.new(shines.outputs[0], out.inputs["Surface"])
    return made


def _develop(light: np.ndarray, recipe: Recipe, rng: np.random.Generator) -> np.ndarray:
    """(h, w, 3) uint8: as a phone does, exposed for the middle, bright parts held, sharpened."""
    h, w = light.shape[:2]
    v, u = np.mgrid[0:h, 0:w]
    away = np.hypot((u - 0.5 * w) / w, (v - 0.5 * h) / h)
    level = np.log(light.mean(axis=2) + 1e-4)
    middle = np.exp(np.average(level, weights=np.exp(-8.0 * away**2)))
    x = light / middle * 0.16 * 2.0 ** np.clip(rng.normal(0, recipe.exposure), -1.5, 1.5)
    x = x * (1 + recipe.white_balance * rng.uniform(-1, 1, 3))
    x = x * (1 - rng.uniform(0, 0.5) * away[..., None] ** 2)  # the lens' corners are darker
    full = 1.0 - 0.15
    x = np.where(x > full, full + 0.15 * np.tanh((x - full) / 0.6), x)  # a soft shoulder
    noise = (0.003 + recipe.noise * rng.random()) * np.sqrt(np.maximum(x, 0.02))
    x = np.clip(x + noise * rng.normal(0, 1, x.shape), 0, 1)
    tone = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    sharp = tone + rng.uniform(0, 0.8) * (tone - cv2.GaussianBlur(tone, None, 1.2))
    return np.asarray(np.clip(np.round(255 * sharp), 0, 255), np.uint8)


if __name__ == "__main__":
    name = f"blender {bpy.app.version_string} cycles"
    sys.exit(main(name, STREAM, 10, BlenderScene, __doc__))
