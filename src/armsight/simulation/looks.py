"""What the cell looks like: textures, materials, lights. No influence on depth or contact."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from armsight.arrays import Bytes
from armsight.geometry.shapes import Solid
from armsight.simulation.gl import mujoco

Color = tuple[float, float, float]

NEAR, FAR = 0.05, 25.0
"""Clipping planes of every picture [m]."""

LIGHTS = (
    ((1.2, -2.0, 5.5), (0.1, 0.1, 0.0), 0.42, True),
    ((-4.0, 3.0, 5.0), (0.0, 0.0, 0.8), 0.24, False),
    ((4.0, 3.5, 4.5), (0.0, 0.0, 0.8), 0.18, False),
)
"""Spot lights: position and target in world [m], brightness, shadow. Directional lights leave
specks on curved bodies in the classic renderer."""

HORIZON = (0.80, 0.82, 0.845)
SKIN, HAIR, EYES = (0.87, 0.67, 0.55), (0.20, 0.14, 0.10), (0.12, 0.10, 0.09)
SHOES = (0.16, 0.16, 0.18)
TROUSERS = ((0.17, 0.21, 0.32), (0.28, 0.27, 0.25), (0.13, 0.16, 0.17))
SHIRTS = ((0.93, 0.55, 0.16), (0.20, 0.48, 0.70), (0.36, 0.58, 0.36), (0.72, 0.28, 0.30))


def set_up(mj: Any) -> None:
    """Textures, lights and picture quality of a model's specification."""
    mj.stat.extent = 1.0
    mj.stat.center = [0.0, 0.0, 0.5]
    mj.visual.map.znear = NEAR
    mj.visual.map.zfar = FAR
    mj.visual.map.shadowclip = 1.0
    mj.visual.map.shadowscale = 0.55
    mj.visual.map.fogstart, mj.visual.map.fogend = 5.0, 14.0
    mj.visual.rgba.fog = [*HORIZON, 1.0]
    mj.visual.quality.shadowsize = 2048
    mj.visual.quality.offsamples = 4
    mj.visual.quality.numslices = 28
    mj.visual.quality.numstacks = 16
    mj.visual.global_.offwidth, mj.visual.global_.offheight = 640, 480  # grows when needed
    mj.visual.headlight.ambient = [0.40, 0.40, 0.41]
    mj.visual.headlight.diffuse = [0.20, 0.20, 0.20]
    mj.visual.headlight.specular = [0.0, 0.0, 0.0]
    for position, target, brightness, shadow in LIGHTS:
        light = mj.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            pos=position,
            dir=np.subtract(target, position),
            castshadow=shadow,
            cutoff=72.0 if shadow else 89.0,
            exponent=0.0,
            attenuation=[1.0, 0.0, 0.0],
        )
        light.diffuse = np.array([1.0, 0.98, 0.95]) * brightness
        light.ambient = [0.0, 0.0, 0.0]
        light.specular = np.full(3, 0.25 * brightness)
    _sky(mj)
    _texture(mj, "floor", _concrete(512, seed=1), repeat=(4.0, 4.0))
    _cube(mj, "wood", _wood(256, seed=2))
    _cube(mj, "plaster", _plaster(256, seed=3))


def arm_material(mj: Any, color: Color) -> str:
    """Painted or bare metal of the arm, and its plastics."""
    return _material(mj, "arm", color, specular=0.35, shininess=0.45)


def solid_material(mj: Any, solid: Solid) -> str:
    """Material of a declared solid."""
    if solid.material == "black_plastic":
        return _material(mj, "black_plastic", solid.color, specular=0.05, shininess=0.1)
    if solid.material == "shiny":
        return _material(mj, "shiny", solid.color, specular=0.9, shininess=0.9)
    wooden = max(solid.color) - min(solid.color) > 0.12
    texture = "wood" if wooden else "plaster"
    return _material(mj, "plain", solid.color, specular=0.1, shininess=0.2, texture=texture)


def cloth_material(mj: Any, look: str, person: str) -> str:
    """Skin, hair, eyes, shirt, trousers or shoes of a person."""
    shine = 0.15 if look in ("skin", "hair", "shoes") else 0.02
    return _material(mj, look, cloth_colors(person)[look], specular=shine, shininess=0.2)


def cloth_colors(person: str) -> dict[str, Color]:
    """Colours of a person's looks; the clothes follow the name."""
    choice = sum(person.encode())
    return {
        "skin": SKIN,
        "hair": HAIR,
        "eyes": EYES,
        "shoes": SHOES,
        "shirt": SHIRTS[choice % len(SHIRTS)],
        "trousers": TROUSERS[choice % len(TROUSERS)],
    }


def _material(
    mj: Any, kind: str, color: Color, specular: float, shininess: float, texture: str = ""
) -> str:
    name = f"{kind}/" + "/".join(f"{c:.3f}" for c in color)
    if mj.material(name) is None:
        material = mj.add_material(
            name=name, rgba=[*color, 1.0], specular=specular, shininess=shininess, reflectance=0.0
        )
        if texture:
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture
    return name


def _texture(mj: Any, name: str, image: Bytes, repeat: tuple[float, float]) -> None:
    texture = mj.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=image.shape[1],
        height=image.shape[0],
        nchannel=3,
    )
    texture.data = image.tobytes()
    material = mj.add_material(
        name=name, texrepeat=repeat, texuniform=True, specular=0.05, shininess=0.1
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _cube(mj: Any, name: str, side: Bytes) -> None:
    """A faint unevenness, nearly white, for every side of a solid: tinted by the solid's colour."""
    texture = mj.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_CUBE,
        width=side.shape[1],
        height=6 * side.shape[0],
        nchannel=3,
    )
    texture.data = np.concatenate([side] * 6).tobytes()


def _sky(mj: Any) -> None:
    mj.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.94, 0.95],
        rgb2=HORIZON,
        width=64,
        height=384,
    )


@lru_cache(maxsize=4)
def _concrete(size: int, seed: int) -> Bytes:
    """(size, size, 3) tiling grey noise with faint tile joints."""
    rng = np.random.default_rng(seed)
    value = np.full((size, size), 0.62)
    for sigma, weight in ((1.0, 0.5), (4.0, 0.7), (24.0, 1.0)):
        blurred = gaussian_filter(rng.standard_normal((size, size)), sigma, mode="wrap")
        value += 0.018 * weight * sigma * blurred
    value[:2, :] -= 0.10
    value[:, :2] -= 0.10
    return _to_bytes(value[..., None] * np.array([1.0, 1.0, 0.985]))


@lru_cache(maxsize=4)
def _wood(size: int, seed: int) -> Bytes:
    """(size, size, 3) grain along one axis, nearly white."""
    rng = np.random.default_rng(seed)
    grain = gaussian_filter(rng.standard_normal((size, size)), (0.7, 24.0), mode="wrap")
    wide = gaussian_filter(rng.standard_normal((size, size)), (8.0, 60.0), mode="wrap")
    value = 0.93 + 0.022 * grain / grain.std() + 0.018 * wide / wide.std()
    return _to_bytes(value[..., None] * np.ones(3))


@lru_cache(maxsize=4)
def _plaster(size: int, seed: int) -> Bytes:
    """(size, size, 3) fine and broad blotches, nearly white."""
    rng = np.random.default_rng(seed)
    fine = gaussian_filter(rng.standard_normal((size, size)), 0.9, mode="wrap")
    broad = gaussian_filter(rng.standard_normal((size, size)), 22.0, mode="wrap")
    value = 0.95 + 0.008 * fine / fine.std() + 0.014 * broad / broad.std()
    return _to_bytes(value[..., None] * np.ones(3))


def _to_bytes(image: Any) -> Bytes:
    return np.asarray(np.clip(255.0 * np.asarray(image), 0, 255), np.uint8)
