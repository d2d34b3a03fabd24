"""Colours of an arm: the maker's, a little off, or other ones."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np

from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.room import PAINT
from armsight.recognition.data.things import Color, Surface

STYLES = ("maker", "white", "grey", "dark", "texture")


@dataclass(frozen=True)
class Paintwork:
    """How an arm is painted.

    Attributes:
        style: one of :data:`STYLES`.
        hue: shift of the hue, share of the circle.
        value: factor of the brightness.
        specular, shininess: 0..1.
        wear: texture number for scratches, -1 for none.
        repeat: of the texture [1/m].
    """

    style: str
    hue: float
    value: float
    specular: float
    shininess: float
    wear: int
    repeat: float

    def surface(self, color: Color) -> Surface:
        """What a part of the maker's colour looks like."""
        texture = PAINT if self.style == "texture" else self.wear
        return Surface(
            self._color(color),
            self.specular,
            self.shininess,
            texture=texture,
            repeat=self.repeat,
        )

    def _color(self, color: Color) -> Color:
        h, s, v = colorsys.rgb_to_hsv(*color)
        r, g, b = colorsys.hsv_to_rgb((h + self.hue) % 1.0, s, min(v * self.value, 1.0))
        target = _TARGETS.get(self.style)
        if target is None:
            return r, g, b
        # Dark parts stay darker than light ones, so that the arm keeps its drawing.
        keep = 0.35
        value = (1 - keep) * target + keep * v
        return value, value, value


_TARGETS = {"white": 0.97, "grey": 0.5, "dark": 0.1, "texture": 0.95}


def draw_paintwork(recipe: Recipe, rng: np.random.Generator) -> Paintwork:
    """Paint of an arm."""
    style = "maker"
    if rng.random() < recipe.random_texture:
        style = "texture"
    elif rng.random() < recipe.repaint:
        style = str(rng.choice(recipe.paints))
    glossy = rng.random() < recipe.glossy
    return Paintwork(
        style,
        float(recipe.tint * rng.uniform(-0.5, 0.5)),
        float(1.0 + recipe.tint * rng.uniform(-1.0, 1.0)),
        float(rng.uniform(0.5, 1.0) if glossy else rng.uniform(0.05, 0.4)),
        float(rng.uniform(0.5, 0.95) if glossy else rng.uniform(0.1, 0.5)),
        PAINT if rng.random() < recipe.worn else -1,
        float(rng.uniform(0.7, 3.0)),
    )
