"""Lamps of a room: several, hard or soft, near or far, and the light that is everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Vector3
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.room import Room
from armsight.recognition.data.things import Color, Lamp


@dataclass(frozen=True)
class Light:
    """All light of a scene; ``kind`` and ``strength`` are for the statistics."""

    kind: str
    strength: float
    ambient: Color
    lamps: list[Lamp]


def draw_light(recipe: Recipe, room: Room, target: Vector3, rng: np.random.Generator) -> Light:
    """Lamps in the upper part of a room around a place that should be seen.

    Shadows are hard, soft (three lamps close together, as a panel throws them) or absent.
    """
    warm = rng.uniform(-0.12, 0.12)
    tone = np.array([1.0 + warm, 1.0, 1.0 - warm])
    ambient = rng.uniform(0.25, 0.5) if recipe.calm_light else rng.uniform(0.1, 0.55)
    strength = rng.uniform(0.5, 0.9) if recipe.calm_light else rng.uniform(0.3, 1.3)
    kind = str(rng.choice(["none", "hard", "soft"], p=[0.35, 0.5, 0.15]))
    count = int(rng.integers(1, 4))
    share = rng.dirichlet(np.full(count, 2.0))
    lamps: list[Lamp] = []
    for k in range(count):
        place = _place(room, target, rng)
        shadow = kind if k == 0 else "none"
        offsets = rng.normal(0.0, 0.12, (3, 3)) if shadow == "soft" else np.zeros((1, 3))
        cutoff = rng.uniform(45, 85)
        exponent = rng.uniform(0.0, 4.0)
        gloss = rng.uniform(0.1, 0.8)
        for offset in offsets:
            spot = place + offset
            direction = target + rng.normal(0.0, 0.25, 3) - spot
            direction /= np.linalg.norm(direction)
            power = strength * share[k] / len(offsets)
            lamps.append(
                Lamp(
                    spot,
                    direction,
                    _color(power * tone),
                    specular=float(gloss * power),
                    cutoff_deg=float(cutoff),
                    exponent=float(exponent),
                    shadow=shadow != "none",
                )
            )
    return Light(kind, float(ambient + strength), _color(ambient * tone), lamps[:7])


def _place(room: Room, target: Vector3, rng: np.random.Generator) -> Vector3:
    """Somewhere above, in the room, at least a metre from the target."""
    low, high = room.corners[0] + 0.2, room.corners[1] - 0.1
    low[2] = min(1.4, high[2] - 0.3)
    for _ in range(20):
        place = rng.uniform(low, high)
        if np.linalg.norm(place - target) > 1.0:
            break
    return np.asarray(place)


def _color(values: Vector3) -> Color:
    return float(values[0]), float(values[1]), float(values[2])
