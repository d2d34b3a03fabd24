"""Materials as Blender's nodes: lacquer, metals by their measured colour, wood, concrete, cloth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

RAL = {
    "pure white": (0.80, 0.81, 0.77), "signal white": (0.85, 0.85, 0.83),
    "light grey": (0.55, 0.56, 0.53), "anthracite": (0.040, 0.050, 0.055),
    "jet black": (0.010, 0.010, 0.012), "pure orange": (0.78, 0.14, 0.016),
    "signal yellow": (0.76, 0.42, 0.0), "sky blue": (0.014, 0.17, 0.39),
    "traffic red": (0.52, 0.017, 0.016), "reseda green": (0.12, 0.20, 0.08),
    "silver": (0.36, 0.37, 0.37),
}  # fmt: skip
"""What machines are painted with, (3,) linear RGB."""
WHITE = ("pure white", "signal white")
METALS = {
    "aluminium": (0.912, 0.914, 0.920), "steel": (0.53, 0.51, 0.49), "chrome": (0.55, 0.56, 0.55),
    "brass": (0.91, 0.78, 0.42),
}  # fmt: skip
"""Reflectance straight on, as measured, (3,) linear RGB."""


class Material:
    """A material that is being made of nodes around Blender's principled one."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self._nodes = self.material.node_tree.nodes
        self._links = self.material.node_tree.links
        self.shader = self._nodes["Principled BSDF"]

    def set(self, **values: float | Sequence[float]) -> None:
        """Inputs of the shader, by their names with spaces for underscores."""
        for name, value in values.items():
            title = name.replace("_", " ").title().replace("Ior", "IOR")
            if isinstance(value, float | int):
                self.shader.inputs[title].default_value = float(value)
            else:
                self.shader.inputs[title].default_value = (*(float(v) for v in value), 1.0)

    def node(self, kind: str, **values: Any) -> Any:
        """A node, its inputs set by name."""
        made = self._nodes.new(kind)
        for name, value in values.items():
            made.inputs[name.replace("_", " ")].default_value = value
        return made

    def link(self, out: Any, into: Any) -> None:
        """Lead an output to an input."""
        self._links.new(out, into)

    def place(self, scale: Sequence[float]) -> Any:
        """Coordinates that stay with the object [m], stretched."""
        where = self.node("ShaderNodeTexCoord").outputs["Object"]
        mapping = self.node("ShaderNodeMapping", Scale=tuple(scale))
        self.link(where, mapping.inputs["Vector"])
        return mapping.outputs["Vector"]

    def noise(self, scale: float, detail: float = 3.0, stretch: Sequence[float] = (1, 1, 1)) -> Any:
        """A cloudy value between 0 and 1."""
        made = self.node("ShaderNodeTexNoise", Scale=float(scale), Detail=float(detail))
        self.link(self.place(stretch), made.inputs["Vector"])
        return made.outputs["Fac"]

    def ramp(
        self, value: Any, low: Sequence[float], high: Sequence[float], a: float, b: float
    ) -> Any:
        """A colour between two."""
        made = self.node("ShaderNodeValToRGB")
        first, last = made.color_ramp.elements
        first.position, last.position = a, b
        first.color, last.color = (*map(float, low), 1.0), (*map(float, high), 1.0)
        self.link(value, made.inputs["Fac"])
        return made.outputs["Color"]

    def bump(self, height: Any, strength: float, distance: float) -> None:
        """Unevenness of the surface [m]."""
        made = self.node("ShaderNodeBump", Strength=float(strength), Distance=float(distance))
        self.link(height, made.inputs["Height"])
        self.link(made.outputs["Normal"], self.shader.inputs["Normal"])


def painted(color: Sequence[float], rng: np.random.Generator, worn: bool = False) -> Any:
    """Lacquer, powder coat or plastic; worn: blotched, with duller places."""
    m = Material("paint")
    kind = str(rng.choice(["lacquer", "powder coat", "plastic"], p=[0.4, 0.35, 0.25]))
    m.set(base_color=color)
    if kind == "lacquer":
        m.set(roughness=rng.uniform(0.25, 0.5), coat_weight=1.0, coat_roughness=rng.uniform(0, 0.2))
        m.bump(m.noise(250.0, 1.0), 0.08, 0.0005)
    elif kind == "powder coat":
        m.set(roughness=rng.uniform(0.4, 0.7))
        m.bump(m.noise(900.0, 1.0), 0.35, 0.0004)
    else:
        m.set(roughness=rng.uniform(0.2, 0.45), ior=1.46)
    if worn:
        dark = np.asarray(color) * rng.uniform(0.35, 0.8)
        cloud = m.noise(rng.uniform(3, 15))
        m.link(
            m.ramp(cloud, color, dark, 0.45, rng.uniform(0.6, 0.9)), m.shader.inputs["Base Color"]
        )
        m.link(m.ramp(cloud, (0.3,) * 3, (0.8,) * 3, 0.4, 0.8), m.shader.inputs["Roughness"])
    return m.material


def metal(name: str, rng: np.random.Generator) -> Any:
    """Bare metal: cast, milled or brushed."""
    m = Material(name)
    m.set(base_color=METALS[name], metallic=1.0, roughness=rng.uniform(0.15, 0.5))
    kind = str(rng.choice(["cast", "milled", "brushed"]))
    if kind == "cast":
        m.set(roughness=rng.uniform(0.45, 0.65))
        m.bump(m.noise(400.0, 1.0), 0.4, 0.0006)
    elif kind == "brushed":
        m.set(anisotropic=0.7)
        m.bump(m.noise(300.0, 1.0, (1, 1, 0.02)), 0.15, 0.0003)
    return m.material


def rubber(rng: np.random.Generator) -> Any:
    """Black, dull."""
    m = Material("rubber")
    grey = rng.uniform(0.01, 0.04)
    m.set(base_color=(grey, grey, grey), roughness=rng.uniform(0.5, 0.9))
    return m.material


def floor(rng: np.random.Generator) -> Any:
    """Concrete, planks, tiles or linoleum."""
    m = Material("floor")
    kind = str(rng.choice(["concrete", "planks", "tiles", "linoleum"]))
    grey = rng.uniform(0.08, 0.5)
    if kind == "planks":
        light = np.array([0.42, 0.25, 0.12]) * rng.uniform(0.4, 1.4)
        grain = m.noise(6.0, 3.0, (1.0, 18.0, 1.0))
        m.link(m.ramp(grain, 0.45 * light, light, 0.3, 0.7), m.shader.inputs["Base Color"])
        m.set(roughness=rng.uniform(0.25, 0.6), coat_weight=rng.uniform(0, 0.5))
    elif kind == "tiles":
        a, b = rng.uniform(0.2, 0.7, 3), rng.uniform(0.05, 0.3)
        brick = m.node(
            "ShaderNodeTexBrick", Color1=(*a, 1.0), Color2=(*(0.9 * a), 1.0),
            Mortar=(b, b, b, 1.0), Scale=float(rng.uniform(1.5, 4)),
        )  # fmt: skip
        brick.offset = 0.0
        m.link(m.place((1, 1, 1)), brick.inputs["Vector"])
        m.link(brick.outputs["Color"], m.shader.inputs["Base Color"])
        m.set(roughness=rng.uniform(0.08, 0.4))
    elif kind == "concrete":
        cloud = m.noise(rng.uniform(0.8, 3.0), 5.0)
        warm = np.array([1.0, 0.98, 0.94])
        m.link(
            m.ramp(cloud, 0.6 * grey * warm, grey * warm, 0.3, 0.7), m.shader.inputs["Base Color"]
        )
        m.set(roughness=rng.uniform(0.4, 0.9))
        m.bump(m.noise(30.0, 2.0), 0.3, 0.004)
    else:
        m.set(base_color=np.clip(grey * rng.uniform(0.6, 1.4, 3), 0, 0.9), roughness=0.3)
        m.bump(m.noise(20.0, 2.0), 0.05, 0.002)
    return m.material


def plaster(rng: np.random.Generator) -> Any:
    """A wall."""
    m = Material("plaster")
    grey = rng.uniform(0.45, 0.85)
    m.set(base_color=np.clip(grey * (1 + 0.12 * rng.uniform(-1, 1, 3)), 0, 0.9), roughness=0.85)
    m.bump(m.noise(120.0, 1.0), 0.2, 0.002)
    return m.material


def wood(rng: np.random.Generator) -> Any:
    """A table's top, a box of plywood."""
    m = Material("wood")
    light = np.array([0.55, 0.36, 0.19]) * rng.uniform(0.35, 1.3)
    grain = m.noise(rng.uniform(4, 10), 3.0, (1.0, 14.0, 3.0))
    m.link(m.ramp(grain, 0.5 * light, light, 0.35, 0.65), m.shader.inputs["Base Color"])
    m.set(roughness=rng.uniform(0.25, 0.7))
    return m.material


def cloth(rng: np.random.Generator) -> Any:
    """Clothes, cardboard, foam."""
    m = Material("cloth")
    m.set(base_color=rng.uniform(0.02, 0.5, 3), roughness=1.0, sheen_weight=rng.uniform(0, 0.6))
    m.bump(m.noise(500.0, 2.0), 0.3, 0.001)
    return m.material


def anything(rng: np.random.Generator) -> Any:
    """Of what furniture and goods are."""
    kind = str(
        rng.choice(["paint", "metal", "wood", "cloth", "rubber"], p=[0.5, 0.15, 0.15, 0.12, 0.08])
    )
    if kind == "paint":
        name = str(rng.choice(list(RAL)))
        return painted(RAL[name], rng, worn=bool(rng.random() < 0.3))
    if kind == "metal":
        return metal(str(rng.choice(["aluminium", "steel", "steel", "chrome", "brass"])), rng)
    return {"wood": wood, "cloth": cloth, "rubber": rubber}[kind](rng)
