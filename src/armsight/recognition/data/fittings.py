"""What an arm wears that is no robot: tools on its flange, hoses and cables along it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from armsight.arrays import Points, Pose, Poses, Vector3
from armsight.geometry.pose import make_pose
from armsight.recognition.data.arms import Arm
from armsight.recognition.data.clutter import draw_surface
from armsight.recognition.data.things import Surface, Thing, cross, rod, turned_box
from armsight.robots.tools import TOOL_NAMES, load_tool


def draw_tool(T_world_flange: Pose, rng: np.random.Generator) -> tuple[str, list[Thing]]:
    """A tool of the catalogue or a made-up one of 5 to 25 cm; its name and its parts."""
    if rng.random() < 0.5:
        name = str(rng.choice(TOOL_NAMES))
        tool = load_tool(name)
        shift = rng.uniform(0.8, 1.2)
        parts = []
        for k, mesh in enumerate(tool.meshes):
            r, g, b = np.clip(np.asarray(mesh.color) * shift, 0, 1)
            surface = Surface((float(r), float(g), float(b)), specular=0.4)
            parts.append(Thing("mesh", (1.0, 1.0, 1.0), T_world_flange, surface, 0, f"{name}/{k}"))
        return name, parts
    return "made up", _made_up_tool(T_world_flange, rng)


def _made_up_tool(T: Pose, rng: np.random.Generator) -> list[Thing]:
    """A body on a stem, sometimes with fingers."""
    long = rng.uniform(0.05, 0.25)
    stem, body = draw_surface(rng, -1), draw_surface(rng)
    r = rng.uniform(0.02, 0.04)
    a, b = T[:3, 3], (T @ [0, 0, 0.3 * long, 1.0])[:3]
    parts = [rod(a, b, r, stem, "cylinder")]
    half = rng.uniform([0.02, 0.02], [0.07, 0.07])
    T_body = T @ make_pose(None, (*rng.uniform(-0.02, 0.02, 2), 0.5 * long))
    if rng.random() < 0.6:
        parts.append(turned_box(T_body, (half[0], half[1], 0.25 * long), body))
    else:
        parts.append(Thing("cylinder", (half[0], half[0], 0.25 * long), T_body, body))
    if rng.random() < 0.6:
        opening = rng.uniform(0.01, 0.06)
        for sign in (-1, 1):
            T_finger = T @ make_pose(None, (sign * opening, 0, 0.85 * long))
            parts.append(turned_box(T_finger, (0.008, 0.012, 0.2 * long), stem))
    return parts


def draw_cable(
    arm: Arm, T_world_link: Poses, T_world_flange: Pose, rng: np.random.Generator
) -> list[Thing]:
    """A hose that follows the arm from some link to the flange, beside the joints."""
    first = int(rng.integers(1, max(arm.n - 2, 2)))
    anchors = []
    for i in range(first, arm.n):
        T = T_world_link[i + 1]
        aside = T[:3, :3] @ _across(arm.axis[i], rng)
        anchors.append(T[:3, 3] + aside * rng.uniform(0.05, 0.11))
    side = T_world_flange[:3, :3] @ np.array([rng.uniform(0.03, 0.06), 0.0, 0.02])
    anchors.append(T_world_flange[:3, 3] + side)
    curve = _smooth(np.array(anchors), 6)
    value = float(rng.uniform(0.02, 0.9)) if rng.random() < 0.4 else 0.06
    surface = Surface((value, value, value), specular=0.3)
    radius = float(rng.uniform(0.004, 0.016))
    return [rod(a, b, radius, surface) for a, b in pairwise(curve)]


def _across(axis: Vector3, rng: np.random.Generator) -> Vector3:
    v = cross(axis, rng.standard_normal(3))
    return np.asarray(v / max(float(np.linalg.norm(v)), 1e-9))


def _smooth(anchors: Points, steps: int) -> Points:
    """A Catmull-Rom curve through the anchors."""
    p = np.concatenate([anchors[:1], anchors, anchors[-1:]])
    t = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None]
    pieces = []
    for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:]):
        pieces.append(
            0.5
            * (
                2 * b
                + (c - a) * t
                + (2 * a - 5 * b + 4 * c - d) * t**2
                + (3 * b - a - 3 * c + d) * t**3
            )
        )
    return np.concatenate([*pieces, anchors[-1:]])
