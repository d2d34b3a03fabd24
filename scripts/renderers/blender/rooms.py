"""Surroundings, stands, tools and things for Blender: photographs, workshops, dark cells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import materials
import numpy as np
from shapes import hose, lamp, pose, primitive

PHOTOGRAPHS = Path(bpy.utils.resource_path("LOCAL")) / "datafiles/studiolights/world"
"""Panoramas of real places that come with Blender (CC0, from Poly Haven)."""
INDOORS, OUTDOORS = ("city", "courtyard", "interior", "studio"), ("forest", "sunrise", "sunset")


def draw(rng: np.random.Generator, calm: bool) -> tuple[str, np.ndarray]:
    """Surroundings with their light: name, (2, 3) corners of where a camera may be."""
    kind = str(rng.choice(["photograph", "workshop", "dark cell"], p=[0.5, 0.35, 0.15]))
    if kind == "photograph":
        name = str(rng.choice(INDOORS if calm or rng.random() < 0.7 else OUTDOORS))
        _world(name, rng.uniform(0, 6.28), 1.0)
        radius = float(rng.uniform(2.5, 6.0))
        ground = pose(0, 0, -0.02, rng.uniform(0, 6.28))
        primitive("cylinder", (radius, radius, 0.02), ground, materials.floor(rng))
        if rng.random() < 0.4:
            _lamps(rng, 1, 4.0, 150.0)
        _furnish(rng, int(rng.integers(2, 9)), 1.6, radius)
        return f"photograph of {name}", np.array([[-4, -4, 0.0], [4, 4, 3.0]])
    half, height = rng.uniform(2.8, 5.5, 2), float(rng.uniform(2.5, 4.0))
    _world(str(rng.choice(INDOORS)), rng.uniform(0, 6.28), 1.5 if kind == "workshop" else 0.02)
    _walls(rng, half, height)
    if kind == "workshop":
        _lamps(rng, int(rng.integers(1, 5)), height, 60.0)
    else:
        _lamps(rng, 1, height, float(rng.uniform(20, 80)))
    _furnish(rng, int(rng.integers(5, 18)), 1.6, float(half.min()))
    return kind, np.array([[-half[0], -half[1], 0.0], [half[0], half[1], min(height, 3.2)]])


def stand(rng: np.random.Generator) -> tuple[np.ndarray, list[tuple[np.ndarray, Any]]]:
    """Base pose, boxes (pose, half sizes) that the arm must not touch."""
    height = float(rng.uniform(0.05, 1.0))
    T = pose(*rng.uniform(-0.3, 0.3, 2), height, rng.uniform(-3.14, 3.14))
    kind = str(rng.choice(["bench", "column", "trolley"]))
    if kind == "bench":
        a, b = rng.uniform(0.35, 0.9), rng.uniform(0.3, 0.6)
        top = materials.wood(rng) if rng.random() < 0.5 else materials.anything(rng)
        shift = pose(*(rng.uniform(-0.5, 0.5, 2) * (a - 0.15, b - 0.15)), 0)
        primitive("box", (a, b, 0.02), T @ shift @ pose(0, 0, -0.02), top)
        leg = materials.metal("aluminium", rng)
        for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            T_leg = T @ shift @ pose(x * (a - 0.04), y * (b - 0.04), -0.5 * height - 0.02)
            primitive("box", (0.025, 0.025, 0.5 * height), T_leg, leg)
        return T, [(T @ shift @ pose(0, 0, -0.5 * height), (a, b, 0.5 * height))]
    if kind == "column":
        r = float(rng.uniform(0.08, 0.18))
        primitive("cylinder", (r, r, 0.5 * height), T @ pose(0, 0, -0.5 * height), _coat(rng))
        plate = materials.metal("steel", rng)
        primitive("box", (1.5 * r, 1.5 * r, 0.008), T @ pose(0, 0, -0.008), plate)
        return T, [(T @ pose(0, 0, -0.5 * height), (1.5 * r, 1.5 * r, 0.5 * height))]
    w = rng.uniform(0.2, 0.4, 2)
    primitive("box", (w[0], w[1], 0.5 * height - 0.03), T @ pose(0, 0, -0.5 * height), _coat(rng))
    primitive(
        "box",
        (w[0] + 0.01, w[1] + 0.01, 0.015),
        T @ pose(0, 0, -0.015),
        materials.metal("aluminium", rng),
    )
    return T, [(T @ pose(0, 0, -0.5 * height), (w[0] + 0.01, w[1] + 0.01, 0.5 * height))]


def tool(rng: np.random.Generator, T: np.ndarray) -> str:
    """Two fingers, a screwdriver, a bracket with a camera, or three rods with a ring."""
    kind = str(rng.choice(["two fingers", "screwdriver", "camera bracket", "ring"]))
    dark, bare = materials.rubber(rng), materials.metal("aluminium", rng)
    if kind == "two fingers":
        w = float(rng.uniform(0.01, 0.05))
        primitive("box", (0.06, 0.035, 0.035), T @ pose(0, 0, 0.035), materials.anything(rng))
        for side in (-1, 1):
            primitive("box", (0.008, 0.012, 0.035), T @ pose(side * w, 0, 0.105), bare)
            primitive("box", (0.004, 0.012, 0.018), T @ pose(side * (w - 0.01), 0, 0.12), dark)
    elif kind == "screwdriver":
        primitive("cylinder", (0.03, 0.03, 0.09), T @ pose(0, 0, 0.09), materials.anything(rng))
        primitive("cylinder", (0.008, 0.008, 0.04), T @ pose(0, 0, 0.22), bare)
    elif kind == "camera bracket":
        primitive("box", (0.09, 0.03, 0.004), T @ pose(0.05, 0, 0.004), bare)
        primitive("box", (0.045, 0.013, 0.013), T @ pose(0.09, 0, 0.02), dark)
        primitive("cylinder", (0.02, 0.02, 0.04), T @ pose(0, 0, 0.045), materials.anything(rng))
    else:
        for k in range(3):
            a = 2.1 * k
            rod = T @ pose(0.05 * np.cos(a), 0.05 * np.sin(a), 0.06)
            primitive("cylinder", (0.006, 0.006, 0.06), rod, bare)
        primitive("cylinder", (0.07, 0.07, 0.01), T @ pose(0, 0, 0.125), materials.anything(rng))
    return kind


def hang(rng: np.random.Generator, joints: np.ndarray) -> None:
    """A hose beside the arm, from its foot to its flange, through (n, 3) of its joints."""
    aside = (
        rng.normal(0, 0.04, joints.shape) + 0.06 * rng.choice([-1, 1]) * np.eye(3)[rng.integers(2)]
    )
    hose(joints + aside, float(rng.uniform(0.005, 0.012)), materials.rubber(rng))


def before(rng: np.random.Generator, eye: np.ndarray, target: np.ndarray, span: float) -> None:
    """Something between the camera and a point of the arm: a post, a box, a ball, somebody."""
    share = rng.uniform(0.3, 0.75)
    size = share * span * float(np.sqrt(rng.uniform(0.01, 0.10))) * 0.5
    there = eye + share * (target - eye)
    kind = str(rng.choice(["post", "box", "ball", "sleeve"]))
    if kind == "post":
        r = 0.4 * size
        primitive("cylinder", (r, r, 1.5), pose(there[0], there[1], 1.5), materials.anything(rng))
    elif kind == "sleeve":
        T = pose(*there, rng.uniform(0, 6.28))
        tilt = rng.uniform(0.5, 1.6)
        T[:3, :3] = T[:3, :3] @ [
            [1, 0, 0],
            [0, np.cos(tilt), -np.sin(tilt)],
            [0, np.sin(tilt), np.cos(tilt)],
        ]
        primitive("capsule", (0.5 * size, 0.5 * size, 2.0 * size), T, materials.cloth(rng))
    else:
        form = "box" if kind == "box" else "ellipsoid"
        T = pose(*there, rng.uniform(0, 6.28))
        primitive(form, (size, size, size * rng.uniform(0.4, 2.5)), T, materials.anything(rng))


def _coat(rng: np.random.Generator) -> Any:
    name = str(rng.choice(list(materials.RAL)))
    return materials.painted(materials.RAL[name], rng, worn=bool(rng.random() < 0.3))


def _world(name: str, turn: float, strength: float) -> None:
    """A panorama all around."""
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    image = nodes.new("ShaderNodeTexEnvironment")
    image.image = bpy.data.images.load(str(PHOTOGRAPHS / f"{name}.exr"), check_existing=True)
    mapping, where = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value[2] = turn
    links.new(where.outputs["Generated"], mapping.inputs["Vector"])
    links.new(mapping.outputs["Vector"], image.inputs["Vector"])
    links.new(image.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = strength
    bpy.context.scene.world = world


def _walls(rng: np.random.Generator, half: np.ndarray, height: float) -> None:
    """Four walls, one with a window to the panorama, a floor and a ceiling."""
    a, b = half
    wall = materials.plaster(rng)
    primitive("box", (a, b, 0.05), pose(0, 0, -0.05), materials.floor(rng))
    primitive("box", (a, b, 0.05), pose(0, 0, height + 0.05), materials.plaster(rng))
    primitive("box", (a, 0.05, 0.5 * height), pose(0, b, 0.5 * height), wall)
    primitive("box", (a, 0.05, 0.5 * height), pose(0, -b, 0.5 * height), wall)
    primitive("box", (0.05, b, 0.5 * height), pose(a, 0, 0.5 * height), wall)
    low, high = 0.9, min(height - 0.3, 2.3)
    y, w = rng.uniform(-0.4, 0.4) * b, rng.uniform(0.3, 0.5) * b
    for lo, hi, y0, y1 in (
        (0.0, low, -b, b), (high, height, -b, b), (low, high, -b, y - w), (low, high, y + w, b),
    ):  # fmt: skip
        size = (0.05, 0.5 * (y1 - y0), 0.5 * (hi - lo))
        primitive("box", size, pose(-a, 0.5 * (y0 + y1), 0.5 * (lo + hi)), wall)
    frame = materials.painted(materials.RAL["signal white"], rng)
    primitive("box", (0.03, 0.025, 0.5 * (high - low)), pose(-a, y, 0.5 * (low + high)), frame)


def _lamps(rng: np.random.Generator, count: int, height: float, power: float) -> None:
    for _ in range(count):
        x, y = rng.uniform(-2.2, 2.2, 2)
        size = float(rng.uniform(0.15, 1.2))
        lamp((x, y, height - 0.06), (x, y, 0.0), size, power * float(rng.uniform(0.5, 2.0)))


def _furnish(rng: np.random.Generator, count: int, near: float, far: float) -> None:
    """Tables, shelves, pipes, drums, screens and boxes, none near the arm."""
    for _ in range(count):
        a, r = rng.uniform(0, 6.28), rng.uniform(near, max(far - 0.3, near + 0.2))
        T = pose(r * np.cos(a), r * np.sin(a), 0.0, rng.uniform(0, 6.28))
        kind = str(rng.choice(["table", "shelf", "pipe", "drum", "screen", "boxes", "person"]))
        look = materials.anything(rng)
        if kind == "table":
            w, d, h = rng.uniform(0.35, 0.8), rng.uniform(0.25, 0.45), rng.uniform(0.6, 1.0)
            primitive("box", (w, d, 0.015), T @ pose(0, 0, h), look)
            leg = materials.metal("steel", rng)
            for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
                T_leg = T @ pose(x * (w - 0.04), y * (d - 0.04), 0.5 * h)
                primitive("box", (0.02, 0.02, 0.5 * h), T_leg, leg)
            goods = T @ pose(*rng.uniform(-0.15, 0.15, 2), h + 0.1)
            primitive(
                str(rng.choice(["box", "cylinder"])),
                (0.08, 0.08, 0.09),
                goods,
                materials.anything(rng),
            )
        elif kind == "shelf":
            w, h, n = rng.uniform(0.3, 0.6), rng.uniform(1.0, 2.0), int(rng.integers(3, 6))
            for k in range(n):
                z = 0.1 + k * (h - 0.1) / (n - 1)
                primitive("box", (w, 0.2, 0.012), T @ pose(0, 0, z), look)
                box = rng.uniform(0.05, 0.14, 3)
                T_box = T @ pose(rng.uniform(-0.5, 0.5) * w, 0, z + 0.012 + box[2])
                primitive("box", box, T_box, materials.anything(rng))
            for x in (-1, 1):
                primitive("box", (0.015, 0.2, 0.5 * h), T @ pose(x * w, 0, 0.5 * h), look)
        elif kind == "pipe":
            radius = rng.uniform(0.02, 0.08)
            primitive("cylinder", (radius, radius, 1.2), T @ pose(0, 0, 1.2), look)
        elif kind == "drum":
            radius, h = rng.uniform(0.12, 0.3), rng.uniform(0.2, 0.5)
            primitive("cylinder", (radius, radius, h), T @ pose(0, 0, h), look)
        elif kind == "screen":
            h = rng.uniform(0.9, 1.4)
            primitive("box", (0.3, 0.015, 0.18), T @ pose(0, 0, h), materials.rubber(rng))
            primitive("cylinder", (0.025, 0.025, 0.5 * h), T @ pose(0, 0.03, 0.5 * h), look)
        elif kind == "boxes":
            z = 0.0
            for _ in range(int(rng.integers(1, 5))):
                half = rng.uniform(0.08, 0.25, 3)
                primitive(
                    "box",
                    half,
                    T @ pose(0, 0, z + half[2], rng.uniform(0, 1)),
                    materials.anything(rng),
                )
                z += 2 * half[2]
        else:
            _person(rng, T)


def _person(rng: np.random.Generator, T: np.ndarray) -> None:
    """Somebody who stands there."""
    shirt, trousers = materials.cloth(rng), materials.cloth(rng)
    skin = materials.painted(np.array([0.55, 0.31, 0.2]) * rng.uniform(0.25, 1.2), rng)
    for side in (-1, 1):
        primitive("capsule", (0.075, 0.075, 0.36), T @ pose(0.1 * side, 0, 0.43), trousers)
        primitive("capsule", (0.05, 0.05, 0.26), T @ pose(0.25 * side, 0.03, 1.1), shirt)
        primitive("ellipsoid", (0.04, 0.03, 0.08), T @ pose(0.25 * side, 0.04, 0.76), skin)
    primitive("ellipsoid", (0.19, 0.12, 0.32), T @ pose(0, 0, 1.15), shirt)
    primitive("ellipsoid", (0.085, 0.105, 0.13), T @ pose(0, 0, 1.6), skin)
