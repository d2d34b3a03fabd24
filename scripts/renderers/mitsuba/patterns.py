"""Textures that the training renderer does not have: cells, marble, weave, brushed metal."""

from __future__ import annotations

import numpy as np

SIZE = 192


def draw_pattern(rng: np.random.Generator) -> np.ndarray:
    """(192, 192, 3) float32 linear RGB."""
    kind = rng.choice(["cells", "marble", "weave", "brushed", "gradient"])
    value = {
        "cells": _cells,
        "marble": _marble,
        "weave": _weave,
        "brushed": _brushed,
        "gradient": _gradient,
    }[str(kind)](rng)[..., None]
    a, b = draw_color(rng), draw_color(rng)
    return (a * (1 - value) + b * value).astype(np.float32)


def draw_color(rng: np.random.Generator) -> np.ndarray:
    """(3,) linear RGB: mostly dull, now and then strong."""
    grey = rng.uniform(0.03, 0.8)
    strength = 0.5 if rng.random() < 0.2 else 0.12
    return np.clip(grey * (1 + strength * rng.uniform(-1, 1, 3) * 2), 0.01, 0.9)


def _cells(rng: np.random.Generator) -> np.ndarray:
    points = rng.random((int(rng.integers(8, 60)), 2))
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    d = np.sort(
        np.stack(
            [np.hypot(((u - x + 0.5) % 1) - 0.5, ((v - y + 0.5) % 1) - 0.5) for x, y in points]
        ),
        axis=0,
    )
    return np.clip((d[1] - d[0]) * 12, 0, 1) if rng.random() < 0.5 else np.clip(d[0] * 6, 0, 1)


def _marble(rng: np.random.Generator) -> np.ndarray:
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE * 2 * np.pi
    phase = np.zeros_like(u)
    for k in range(1, 6):
        a, b = rng.integers(-3, 4, 2)
        phase += rng.uniform(0.3, 1.5) / k * np.sin(k * (a * u + b * v) + rng.uniform(0, 6.28))
    return 0.5 + 0.5 * np.sin(rng.integers(1, 6) * u + 2 * phase)


def _weave(rng: np.random.Generator) -> np.ndarray:
    n = int(rng.choice([8, 16, 24]))
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE * n
    over = (np.floor(u) + np.floor(v)) % 2
    return np.where(over > 0, np.abs(np.sin(np.pi * u)), np.abs(np.sin(np.pi * v)))


def _brushed(rng: np.random.Generator) -> np.ndarray:
    line = np.convolve(rng.random(SIZE), np.ones(3) / 3, "same")
    return np.clip(line[:, None] + 0.1 * rng.random((SIZE, SIZE)), 0, 1)


def _gradient(rng: np.random.Generator) -> np.ndarray:
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    a = rng.uniform(-np.pi, np.pi)
    return 0.5 + 0.5 * np.sin(np.pi * (np.cos(a) * (u - 0.5) + np.sin(a) * (v - 0.5)))
