"""Places, lights, stands, tools and things of the second renderer, as Mitsuba dictionaries."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import trimesh
from patterns import draw_color, draw_pattern

Shapes = dict[str, Any]


def transform(T: np.ndarray, scale: Any = (1.0, 1.0, 1.0)) -> Any:
    """Mitsuba's transform of a 4x4 pose after a scaling."""
    return mi.ScalarTransform4f(np.asarray(T) @ np.diag([*scale, 1.0]))


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    """Pose turned about the vertical."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def primitive(kind: str, size: Any, T: np.ndarray, bsdf: Any, key: str) -> Shapes:
    """Box, cylinder, capsule or ellipsoid with MuJoCo's sizes."""
    look = {"bsdf": bsdf}
    if kind == "box":
        return {key: {"type": "cube", "to_world": transform(T, size), **look}}
    if kind == "ellipsoid":  # Mitsuba's own sphere cannot be stretched
        return {key: {"type": "ply", "filename": _ball(), "to_world": transform(T, size), **look}}
    r, half = size[0], size[2]
    up = T @ pose(0, 0, half)
    down = T @ pose(0, 0, -half)
    shapes = {
        key: {
            "type": "cylinder",
            "radius": float(r),
            "p0": [0, 0, -float(half)],
            "p1": [0, 0, float(half)],
            "to_world": transform(T),
            **look,
        }
    }
    if kind == "capsule":
        for name, end in (("a", up), ("b", down)):
            shapes[key + name] = {"type": "sphere", "to_world": transform(end, (r, r, r)), **look}
    else:
        flip = np.diag([1.0, -1.0, -1.0, 1.0])
        shapes[key + "a"] = {"type": "disk", "to_world": transform(up, (r, r, 1)), **look}
        shapes[key + "b"] = {"type": "disk", "to_world": transform(down @ flip, (r, r, 1)), **look}
    return shapes


@cache
def _ball() -> str:
    """File of a unit ball."""
    path = Path(_FOLDER.name) / "ball.ply"
    trimesh.creation.icosphere(subdivisions=4).export(path)
    return str(path)


_FOLDER = tempfile.TemporaryDirectory()


def paint(rng: np.random.Generator, color: Any = None, textured: float = 0.4) -> dict[str, Any]:
    """Any material: matt, lacquer, metal, cloth."""
    base: Any = {
        "type": "rgb",
        "value": [float(c) for c in (draw_color(rng) if color is None else color)],
    }
    if color is None and rng.random() < textured:
        base = {
            "type": "bitmap",
            "bitmap": mi.Bitmap(draw_pattern(rng)),
            "raw": True,
            "to_uv": mi.ScalarTransform3f().scale([float(rng.uniform(1, 6))] * 2),
        }
    return {
        "type": "principled",
        "base_color": base,
        "roughness": float(rng.uniform(0.08, 0.9)),
        "metallic": float(rng.uniform(0.6, 1.0)) if rng.random() < 0.15 else 0.0,
        "specular": float(rng.uniform(0.2, 0.8)),
        "clearcoat": float(rng.uniform(0, 1)) if rng.random() < 0.2 else 0.0,
    }


def place(rng: np.random.Generator, calm: bool) -> tuple[str, np.ndarray, Shapes]:
    """Surroundings with their light: name, (2, 3) corners of where a camera may be, shapes."""
    kind = str(rng.choice(["hall", "studio", "open air", "box room"], p=[0.35, 0.2, 0.15, 0.3]))
    ground = {
        "type": "rectangle",
        "to_world": transform(pose(0, 0, 0, rng.uniform(0, 6.28)), (15, 15, 1)),
        "bsdf": _two(paint(rng)),
    }
    shapes: Shapes = {"ground": ground}
    if kind == "open air":
        shapes["sky"] = {
            "type": "sunsky",
            "turbidity": float(rng.uniform(2, 8)),
            "sun_direction": _up(rng).tolist(),
            "sky_scale": 0.02,
            "sun_scale": float(0.02 * rng.uniform(0.0, 1.0)),
        }
        shapes |= _blocks(rng, 12, 4.0, 9.0)
        return kind, np.array([[-4, -4, 0.0], [4, 4, 3.0]]), shapes
    if kind == "studio":
        shapes["sky"] = {"type": "constant", "radiance": _light(rng, rng.uniform(0.1, 0.5))}
        for k in range(int(rng.integers(2, 4))):
            shapes |= _panel(rng, f"soft{k}", rng.uniform(1.5, 4.0, 3), 0.6, 5.0)
        shapes |= _blocks(rng, 5, 3.5, 7.0)
        return kind, np.array([[-4, -4, 0.0], [4, 4, 3.0]]), shapes
    half = rng.uniform(3.0, 5.0, 2) if kind == "box room" else rng.uniform(5.0, 9.0, 2)
    height = float(rng.uniform(2.5, 3.5) if kind == "box room" else rng.uniform(4.0, 7.0))
    shapes |= _walls(rng, half, height)
    if kind == "hall":
        for k in range(int(rng.integers(1, 4))):
            shapes |= _ceiling_lamp(rng, f"lamp{k}", half, height)
        shapes |= _blocks(rng, 14, 2.5, float(half.min()))
    else:
        shapes |= _window(rng, half, height)
        shapes |= _ceiling_lamp(rng, "lamp", half, height)
        shapes |= _blocks(rng, 9, 1.8, float(half.min()))
    shapes["fill"] = {"type": "constant", "radiance": _light(rng, 0.05)}
    corners = np.array([[-half[0], -half[1], 0.0], [half[0], half[1], min(height, 3.2)]])
    return kind, corners, shapes


def stand(rng: np.random.Generator) -> tuple[np.ndarray, list[tuple[np.ndarray, Any]], Shapes]:
    """Base pose, boxes (pose, half sizes) that the arm must not touch, shapes."""
    height = float(rng.uniform(0.05, 1.0))
    T = pose(*rng.uniform(-0.3, 0.3, 2), height, rng.uniform(-3.14, 3.14))
    kind = str(rng.choice(["round table", "block", "frame"]))
    look = paint(rng)
    if kind == "round table":
        r = float(rng.uniform(0.35, 0.8))
        top = T @ pose(0, 0, -0.02)
        shapes = primitive("cylinder", (r, r, 0.02), top, look, "stand")
        leg = T @ pose(0, 0, -0.5 * height - 0.02)
        shapes |= primitive("cylinder", (0.06, 0.06, 0.5 * height), leg, paint(rng), "leg")
        return T, [(T @ pose(0, 0, -0.5 * height), (r, r, 0.5 * height))], shapes
    if kind == "block":
        w = rng.uniform(0.12, 0.5, 2)
        half = (float(w[0]), float(w[1]), 0.5 * height)
        middle = T @ pose(0, 0, -0.5 * height)
        return T, [(middle, half)], primitive("box", half, middle, look, "stand")
    w = float(rng.uniform(0.15, 0.35))
    shapes = primitive("box", (w, w, 0.012), T @ pose(0, 0, -0.012), look, "stand")
    beam = paint(rng, (0.6, 0.61, 0.62))
    for i, (x, y) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        leg = T @ pose(x * (w - 0.03), y * (w - 0.03), -0.5 * height - 0.012)
        shapes |= primitive("box", (0.02, 0.02, 0.5 * height), leg, beam, f"leg{i}")
    return T, [(T @ pose(0, 0, -0.5 * height), (w, w, 0.5 * height))], shapes


def tool(rng: np.random.Generator, T: np.ndarray) -> tuple[str, Shapes]:
    """A torch, a suction plate, a sander or a spindle on the flange."""
    kind = str(rng.choice(["torch", "suction plate", "sander", "spindle"]))
    look, dark = paint(rng), paint(rng, (0.05, 0.05, 0.06))
    shapes: Shapes = {}
    if kind == "torch":
        point, way = np.eye(4), pose(0, 0, 0.05)
        for k in range(4):
            shapes |= primitive("capsule", (0.014, 0.014, 0.03), T @ point @ way, look, f"tool{k}")
            a = 0.25
            bend = np.eye(4)
            bend[1:3, 1:3] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
            point = point @ pose(0, 0, 0.06) @ bend
    elif kind == "suction plate":
        w = float(rng.uniform(0.06, 0.12))
        shapes |= primitive("box", (w, w, 0.008), T @ pose(0, 0, 0.05), look, "tool")
        shapes |= primitive("cylinder", (0.02, 0.02, 0.025), T @ pose(0, 0, 0.025), dark, "stem")
        for i, (x, y) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
            cup = T @ pose(0.8 * x * w, 0.8 * y * w, 0.075)
            shapes |= primitive("cylinder", (0.015, 0.015, 0.02), cup, dark, f"cup{i}")
    elif kind == "sander":
        shapes |= primitive("ellipsoid", (0.05, 0.05, 0.06), T @ pose(0, 0, 0.06), look, "tool")
        shapes |= primitive("cylinder", (0.065, 0.065, 0.008), T @ pose(0, 0, 0.12), dark, "disc")
    else:
        shapes |= primitive("box", (0.04, 0.05, 0.07), T @ pose(0, 0.03, 0.07), look, "tool")
        shapes |= primitive("cylinder", (0.006, 0.006, 0.05), T @ pose(0, 0.03, 0.18), dark, "bit")
    return kind, shapes


def before(rng: np.random.Generator, eye: np.ndarray, target: np.ndarray, span: float) -> Shapes:
    """Something between the camera and a point of the arm."""
    share = rng.uniform(0.35, 0.75)
    size = share * span * np.sqrt(rng.uniform(0.01, 0.12)) * 0.5
    T = pose(*(eye + share * (target - eye)), rng.uniform(0, 6.28))
    kind = str(rng.choice(["box", "ellipsoid", "cylinder"]))
    return primitive(kind, (size, size, size * rng.uniform(0.4, 2.5)), T, paint(rng), "before")


def _two(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"type": "twosided", "bsdf": bsdf}


def _walls(rng: np.random.Generator, half: np.ndarray, height: float) -> Shapes:
    shapes: Shapes = {}
    wall, ceiling = paint(rng, textured=0.25), paint(rng, (0.75, 0.75, 0.74))
    if rng.random() < 0.4:
        wall = paint(rng, (0.8, 0.8, 0.79))
    for k, (x, y, w) in enumerate(
        (
            (-half[0], 0, half[1]),
            (half[0], 0, half[1]),
            (0, -half[1], half[0]),
            (0, half[1], half[0]),
        )
    ):
        size = (0.05, w, 0.5 * height) if x else (w, 0.05, 0.5 * height)
        shapes |= primitive("box", size, pose(x, y, 0.5 * height), wall, f"wall{k}")
    top = pose(0, 0, height + 0.05)
    return shapes | primitive("box", (half[0], half[1], 0.05), top, ceiling, "ceiling")


def _blocks(rng: np.random.Generator, count: int, near: float, far: float) -> Shapes:
    """Things that stand around, none near the arm."""
    shapes: Shapes = {}
    for k in range(count):
        a, r = rng.uniform(0, 6.28), rng.uniform(near, max(far, near + 0.1))
        size = rng.uniform(0.06, 0.5, 3)
        kind = str(rng.choice(["box", "cylinder", "ellipsoid", "capsule"]))
        if kind in ("cylinder", "capsule"):
            size[1] = size[0] = 0.5 * size[0]
        tall = size[2] + (size[0] if kind == "capsule" else 0.0)
        T = pose(r * np.cos(a), r * np.sin(a), tall, rng.uniform(0, 6.28))
        shapes |= primitive(kind, size, T, paint(rng), f"thing{k}")
    return shapes


def _panel(
    rng: np.random.Generator, key: str, away: np.ndarray, size: float, power: float
) -> Shapes:
    """A soft box that faces the arm."""
    a = rng.uniform(0, 6.28)
    eye = np.array([away[0] * np.cos(a), away[0] * np.sin(a), rng.uniform(1.5, 3.5)])
    look = mi.ScalarTransform4f().look_at(origin=eye.tolist(), target=[0, 0, 0.6], up=[0, 0, 1])
    return {
        key: {
            "type": "rectangle",
            "to_world": look @ mi.ScalarTransform4f().scale([size, size, 1]),
            "emitter": {"type": "area", "radiance": _light(rng, power)},
        }
    }


def _ceiling_lamp(rng: np.random.Generator, key: str, half: np.ndarray, height: float) -> Shapes:
    x, y = rng.uniform(-0.7, 0.7, 2) * half
    size = rng.uniform(0.3, 1.2, 2)
    down = pose(x, y, height - 0.02) @ np.diag([1.0, -1.0, -1.0, 1.0])
    power = rng.uniform(0.6, 1.4) * height**2 / float(size[0] * size[1]) * 0.5
    return {
        key: {
            "type": "rectangle",
            "to_world": transform(down, (size[0], size[1], 1)),
            "emitter": {"type": "area", "radiance": _light(rng, power)},
        }
    }


def _window(rng: np.random.Generator, half: np.ndarray, height: float) -> Shapes:
    """A bright opening in a wall."""
    look = mi.ScalarTransform4f().look_at(
        origin=[-half[0] + 0.06, float(rng.uniform(-0.5, 0.5) * half[1]), 0.55 * height],
        target=[0, 0, 0.55 * height],
        up=[0, 0, 1],
    )
    return {
        "window": {
            "type": "rectangle",
            "to_world": look @ mi.ScalarTransform4f().scale([float(rng.uniform(0.4, 1.2)), 0.6, 1]),
            "emitter": {"type": "area", "radiance": _light(rng, rng.uniform(2, 10))},
        }
    }


def _light(rng: np.random.Generator, power: float) -> dict[str, Any]:
    warm = rng.uniform(-0.15, 0.15)
    return {
        "type": "rgb",
        "value": [float(power * (1 + warm)), float(power), float(power * (1 - warm))],
    }


def _up(rng: np.random.Generator) -> np.ndarray:
    a, e = rng.uniform(0, 6.28), rng.uniform(0.3, 1.3)
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
