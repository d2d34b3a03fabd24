"""From what an ideal lens sees at twice the size to the JPEG of a cheap colour camera.

In the order of a real one: lens distortion and vignetting, defocus and motion blur, exposure and
white balance, Poisson and Gauss noise on a Bayer mosaic, demosaicing, sharpening, gamma, downscale
with some kernel, JPEG.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Floats32
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.data.recipe import Recipe

OVERSAMPLING = 2
"""The renderer's pixels a pixel of the finished picture, along each side."""
TARGET = 0.2
"""Mean linear brightness that the automatic exposure aims at."""
GAINS = (0.5, 6.0)
"""Least and greatest factor that it can choose."""
KERNELS = (
    cv2.INTER_AREA,
    cv2.INTER_LINEAR,
    cv2.INTER_CUBIC,
    cv2.INTER_LANCZOS4,
    cv2.INTER_NEAREST,
)


@dataclass(frozen=True)
class Sensor:
    """What a camera does to a picture.

    Attributes:
        exposure: factor on what the automatic exposure finds right. red, blue: gains against green.
        vignetting: loss of light in the corners.
        defocus: standard deviation of the blur [px of the finished picture].
        motion: (2,) streak [px of the finished picture].
        photons: electrons at full scale; read_noise: share of full scale.
        sharpening: strength of the halo; sharpening_width [px of the sensor].
        gamma: exponent of the curve.
        kernel: of the downscaling. quality: of the JPEG.
    """

    exposure: float
    red: float
    blue: float
    vignetting: float
    defocus: float
    motion: tuple[float, float]
    photons: float
    read_noise: float
    sharpening: float
    sharpening_width: float
    gamma: float
    kernel: int
    quality: int


def draw_sensor(recipe: Recipe, rng: np.random.Generator) -> Sensor:
    """A camera of the recipe."""
    streak = rng.uniform(1.0, 5.0) * (rng.random() < recipe.motion)
    angle = rng.uniform(-np.pi, np.pi)
    weights = np.array([0.5, 0.2, 0.12, 0.1, 0.08])
    return Sensor(
        float(2.0 ** np.clip(rng.normal(0.0, recipe.exposure), -1.8, 1.6)),
        float(1.0 + recipe.white_balance * rng.uniform(-1, 1)),
        float(1.0 + recipe.white_balance * rng.uniform(-1, 1)),
        float(rng.uniform(0.0, 0.35)),
        float(rng.uniform(0.0, recipe.blur) if rng.random() < 0.7 else 0.0),
        (float(streak * np.cos(angle)), float(streak * np.sin(angle))),
        float(np.exp(rng.uniform(np.log(800.0), np.log(20000.0)))),
        float(recipe.noise * rng.random() ** 2),
        float(rng.uniform(0.0, 1.2) if rng.random() < 0.6 else 0.0),
        float(rng.uniform(0.7, 1.8)),
        float(rng.uniform(1.9, 2.5)),
        int(rng.choice(KERNELS, p=weights)),
        int(rng.integers(recipe.quality[0], recipe.quality[1] + 1)),
    )


def expose(sensor: Sensor, seen: ColorImage, rng: np.random.Generator) -> Floats32:
    """(2h, 2w, 3) float32 0..1 linear: blurred, dimmed towards the corners, coloured, noisy."""
    h, w = seen.shape[:2]
    light = _blur(sensor, np.asarray(cv2.LUT(seen, _LINEAR), np.float32))
    # Cameras expose for the mean, as far as time and amplifier go.
    right = np.clip(TARGET / max(float(cv2.mean(light)[1]), 1e-4), *GAINS)
    gain = sensor.exposure * right * np.array([sensor.red, 1.0, sensor.blue], np.float32)
    mosaic = np.empty((h, w), np.float32)
    for dv, du, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):  # RGGB
        mosaic[dv::2, du::2] = light[dv::2, du::2, channel] * gain[channel]
    mosaic *= _falloff(h, w, sensor.vignetting)
    spread = np.sqrt(mosaic / np.float32(sensor.photons) + np.float32(sensor.read_noise**2))
    mosaic += spread * rng.standard_normal((h, w), np.float32)
    return mosaic


def develop(sensor: Sensor, mosaic: Floats32, size: tuple[int, int]) -> ColorImage:
    """(h, w, 3) finished picture of an RGGB mosaic of twice its size."""
    # Ten bits over the white level keep highlights for the sharpening and lose nothing else.
    raw = np.clip(mosaic * np.float32(1023.0), 0.0, 1023.0).astype(np.uint16)
    picture = cv2.demosaicing(raw, cv2.COLOR_BayerRGGB2RGB)
    if sensor.sharpening > 0:
        soft = cv2.GaussianBlur(picture, (0, 0), sensor.sharpening_width)
        picture = cv2.addWeighted(picture, 1 + sensor.sharpening, soft, -sensor.sharpening, 0.0)
    curve = (np.arange(1024, dtype=np.float64) / 1023.0) ** (1.0 / sensor.gamma)
    table = np.asarray(np.round(255.0 * curve), np.uint8)
    display = np.take(table, picture, mode="clip")
    return np.asarray(cv2.resize(display, size, interpolation=sensor.kernel))


def to_jpeg(sensor: Sensor, picture: ColorImage) -> bytes:
    """The file of a finished picture."""
    options = [cv2.IMWRITE_JPEG_QUALITY, sensor.quality]
    ok, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), options)
    if not ok:
        raise ValueError(f"a picture of {picture.shape} cannot be written as JPEG")
    return bytes(data.tobytes())


def distort(picture: Bytes, ideal: PinholeCamera, lens: PinholeCamera, nearest: bool) -> Bytes:
    """What ``lens`` (bent) sees, of a picture that ``ideal`` (not bent, wider) has taken."""
    map_u, map_v = _bend(ideal, lens)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return np.asarray(cv2.remap(picture, map_u, map_v, how, borderMode=cv2.BORDER_REPLICATE))


_CELL = 16


def _bend(ideal: PinholeCamera, lens: PinholeCamera) -> tuple[Floats32, Floats32]:
    """Where each pixel of ``lens`` lies in the picture of ``ideal``.

    Solved at every 16th pixel and one cell beyond the border, straight between them: the bend is
    smooth, and solving it for a million pixels takes longer than drawing them.
    """
    columns, rows = -(-lens.width // _CELL) + 2, -(-lens.height // _CELL) + 2
    u = (np.arange(columns) + 0.5) * _CELL - 0.5 - _CELL
    v = (np.arange(rows) + 0.5) * _CELL - 0.5 - _CELL
    nodes = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = lens.normalise(nodes).reshape(rows, columns, 2)
    there = rays * [ideal.fx, ideal.fy] + [ideal.cx, ideal.cy]
    fine = cv2.resize(there, (columns * _CELL, rows * _CELL), interpolation=cv2.INTER_LINEAR)
    fine = fine[_CELL : _CELL + lens.height, _CELL : _CELL + lens.width].astype(np.float32)
    return np.ascontiguousarray(fine[..., 0]), np.ascontiguousarray(fine[..., 1])


_LINEAR = ((np.arange(256) / 255.0) ** 2.2).astype(np.float32)
"""The renderer's colours are meant for a screen."""


def _blur(sensor: Sensor, light: Floats32) -> Floats32:
    if sensor.defocus > 0.05:
        sigma = OVERSAMPLING * sensor.defocus
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), sigma), np.float32)
    if any(sensor.motion):
        light = np.asarray(cv2.filter2D(light, -1, _streak(sensor.motion)), np.float32)
    return light


def _streak(motion: tuple[float, float]) -> Floats32:
    """Kernel of a straight motion during the exposure."""
    dx, dy = OVERSAMPLING * motion[0], OVERSAMPLING * motion[1]
    half = int(np.ceil(0.5 * max(abs(dx), abs(dy))))
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for t in np.linspace(-0.5, 0.5, 4 * half + 2):
        kernel[half + round(t * dy), half + round(t * dx)] += 1.0
    return np.asarray(kernel / kernel.sum())


def _falloff(h: int, w: int, strength: float) -> Floats32:
    v = np.linspace(-1.0, 1.0, h, dtype=np.float32)[:, None]
    u = np.linspace(-1.0, 1.0, w, dtype=np.float32)[None]
    return np.asarray(1.0 - np.float32(strength) * 0.5 * (u * u + v * v))


def brightness(picture: ColorImage) -> tuple[Floats, float]:
    """Mean RGB 0..1 of a picture, and the share of its pixels that are white out."""
    mean = picture.reshape(-1, 3).mean(axis=0) / 255.0
    return np.asarray(mean), float((picture.min(axis=2) >= 250).mean())
