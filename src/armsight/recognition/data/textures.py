"""Patterns for walls, floors, cloth and pictures, made from noise."""

from __future__ import annotations

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats
from armsight.recognition.data.things import Color

SIZE = 256


def draw_texture(rng: np.random.Generator, calm: bool = False) -> Bytes:
    """(256, 256, 3) a random pattern.

    Args:
        rng: source of randomness.
        calm: only faint patterns, such as plaster or concrete have.
    """
    kind = "noise" if calm else str(rng.choice(list(_KINDS)))
    low = rng.uniform(0.75, 0.95) if calm else rng.uniform(0.1, 0.9)
    tint = 0.06 if calm else float(rng.choice([0.1, 0.25, 0.5]))
    first = _color(rng, low, tint)
    second = _color(rng, low + rng.uniform(0.03, 0.15) if calm else rng.uniform(0.0, 1.0), tint)
    mix = _KINDS[kind](rng)[..., None]
    picture = np.asarray(first, np.float32) * (1 - mix) + np.asarray(second, np.float32) * mix
    if kind == "poster":
        picture = _poster(rng)
    picture += 0.02 * rng.standard_normal((SIZE, SIZE, 1), np.float32)
    return np.asarray(np.clip(picture, 0.0, 1.0) * 255.0, np.uint8)


def draw_scratches(rng: np.random.Generator, stickers: float = 0.0) -> Bytes:
    """(256, 256, 3) white with dirt and thin scratches, to lie over paint.

    Args:
        rng: source of randomness.
        stickers: probability that there are labels and printed letters, too.
    """
    picture = 1.0 - rng.uniform(0.0, 0.25) * noise(rng, 5)
    for _ in range(int(rng.integers(3, 30))):
        a = tuple(int(v) for v in rng.integers(0, SIZE, 2))
        b = tuple(int(v) for v in np.array(a) + rng.integers(-40, 40, 2))
        cv2.line(picture, a, b, float(rng.uniform(0.3, 0.9)), 1, cv2.LINE_AA)
    paint = np.asarray(np.repeat(np.clip(picture, 0, 1)[..., None] * 255.0, 3, 2), np.uint8)
    if stickers and rng.random() < stickers:
        _stick(paint, rng)
    return paint


def _stick(paint: Bytes, rng: np.random.Generator) -> None:
    """Labels and letters, as makers and their customers put on arms."""
    for _ in range(int(rng.integers(1, 5))):
        corner = rng.integers(0, SIZE - 40, 2)
        size = rng.integers([20, 10], [110, 60])
        a, b = tuple(map(int, corner)), tuple(map(int, corner + size))
        ground, ink = (tuple(255.0 * c for c in _color(rng, v, 0.5)) for v in rng.random(2))
        if rng.random() < 0.6:
            cv2.rectangle(paint, a, b, ground, -1)
        word = "".join(chr(int(c)) for c in rng.integers(48, 91, int(rng.integers(2, 7))))
        foot = (a[0] + 2, b[1] - 3)
        scale = float(rng.uniform(0.4, 1.2))
        cv2.putText(paint, word, foot, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, 2, cv2.LINE_AA)


def noise(rng: np.random.Generator, octaves: int = 5, stretch: int = 1) -> Floats:
    """(256, 256) float32 0..1 of clouds; stretched along one side as wood is."""
    total = np.zeros((SIZE, SIZE), np.float32)
    weight = 1.0
    roughness = rng.uniform(0.45, 0.85)
    for octave in range(octaves):
        n = 2 ** (octave + 1)
        grid = rng.random((max(n // stretch, 1) + 1, n * stretch + 1), np.float32)
        total += weight * cv2.resize(grid, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
        weight *= roughness
    low, high = float(total.min()), float(total.max())
    return np.asarray((total - low) / max(high - low, 1e-6))


def _checks(rng: np.random.Generator) -> Floats:
    n = int(rng.choice([2, 4, 8, 16]))
    row = np.arange(SIZE) * n // SIZE
    return np.asarray((row[:, None] + row[None]) % 2, np.float32)


def _stripes(rng: np.random.Generator) -> Floats:
    n = int(rng.choice([2, 4, 8, 16, 32]))
    share = rng.uniform(0.1, 0.9)
    wave = ((np.arange(SIZE) * n / SIZE) % 1.0 < share).astype(np.float32)
    flat = np.broadcast_to(wave, (SIZE, SIZE))
    return np.asarray(flat if rng.random() < 0.5 else flat.T)


def _tiles(rng: np.random.Generator) -> Floats:
    """Tiles or bricks with joints."""
    rows, columns = int(rng.choice([2, 4, 8])), int(rng.choice([2, 4]))
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    shift = (np.floor(v * rows) % 2) * 0.5 * (rng.random() < 0.5)
    joint = rng.uniform(0.02, 0.08)
    inside = ((v * rows) % 1 > joint * rows / 4) & (((u * columns + shift) % 1) > joint)
    shade = 0.25 * noise(rng, 4)
    return np.asarray(np.where(inside, shade, 1.0), np.float32)


def _blobs(rng: np.random.Generator) -> Floats:
    return np.asarray(noise(rng, 4) > rng.uniform(0.3, 0.7), np.float32)


def _wood(rng: np.random.Generator) -> Floats:
    return noise(rng, 5, stretch=8)


def _speckle(rng: np.random.Generator) -> Floats:
    dots = rng.random((SIZE, SIZE), np.float32)
    return np.asarray(np.clip(3.0 * cv2.GaussianBlur(dots, (0, 0), rng.uniform(0.6, 3)) - 1, 0, 1))


def _flat(rng: np.random.Generator) -> Floats:
    return np.zeros((SIZE, SIZE), np.float32)


_KINDS = {
    "noise": noise,
    "checks": _checks,
    "stripes": _stripes,
    "tiles": _tiles,
    "blobs": _blobs,
    "wood": _wood,
    "speckle": _speckle,
    "poster": _flat,
}


def _poster(rng: np.random.Generator) -> Floats:
    """Rectangles, discs, lines and letters: a notice, a screen, a shelf of coloured things."""
    picture = np.empty((SIZE, SIZE, 3), np.float32)
    picture[:] = _color(rng, rng.uniform(0, 1), 0.5)
    for _ in range(int(rng.integers(4, 30))):
        a = tuple(int(v) for v in rng.integers(0, SIZE, 2))
        b = tuple(int(v) for v in np.clip(np.array(a) + rng.integers(-90, 90, 2), 0, SIZE))
        color = _color(rng, rng.uniform(0, 1), 0.6)
        what = rng.integers(0, 4)
        if what == 0:
            cv2.rectangle(picture, a, b, color, -1)
        elif what == 1:
            cv2.circle(picture, a, int(rng.integers(3, 50)), color, -1, cv2.LINE_AA)
        elif what == 2:
            cv2.line(picture, a, b, color, int(rng.integers(1, 8)), cv2.LINE_AA)
        else:
            word = "".join(chr(int(c)) for c in rng.integers(65, 91, int(rng.integers(2, 9))))
            scale = float(rng.uniform(0.4, 2.0))
            # OpenCV 5 writes on bytes alone.
            ink = np.zeros((SIZE, SIZE), np.uint8)
            cv2.putText(ink, word, a, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, 2, cv2.LINE_8)
            picture[ink > 0] = color
    return np.asarray(picture)


def _color(rng: np.random.Generator, brightness: float, tint: float) -> Color:
    r, g, b = np.clip(brightness + tint * rng.uniform(-1.0, 1.0, 3), 0.0, 1.0)
    return float(r), float(g), float(b)
