"""What stands about a port that is none: round dark things."""

from __future__ import annotations

import numpy as np

from armsight.charging.ports.meshes import Surface, band, flat
from armsight.charging.ports.outline import Outline

DECOYS = ("cup", "ring", "wheel", "vent", "knob", "socket")
"""Round dark things: a cup, a washer, a hub with its nuts, a vent, a knob, a wall socket."""


def decoy(kind: str) -> tuple[Surface, ...]:
    """Surfaces of a round dark thing, in turns of the face's look and the darker one's."""
    if kind == "cup":
        rim, inner = Outline(0, 0, 0.040), Outline(0, 0, 0.036)
        return (
            flat("face", [rim], [inner], 0.0),
            band("wall", [inner], [inner], -0.08, 0.0, outward=False),
            band("face", [rim], [rim], -0.08, 0.0, outward=True),
            flat("wall", [inner], [], -0.08),
        )
    if kind == "ring":
        outer, inner = Outline(0, 0, 0.030), Outline(0, 0, 0.019)
        return (
            flat("face", [outer], [inner], 0.0),
            flat("wall", [inner], [], -0.010),
            band("face", [outer], [outer], -0.02, 0.0, outward=True),
        )
    if kind == "wheel":
        hub = Outline(0, 0, 0.075)
        nuts = [_around(0.047, i, 5, 0.011) for i in range(5)]
        return (
            flat("face", [hub], nuts, 0.0),
            flat("wall", nuts, [], -0.012),
            band("face", [hub], [hub], -0.05, 0.0, outward=True),
        )
    if kind == "vent":
        cover = Outline(0, 0, 0.045)
        slots = [Outline(0, (i - 3) * 0.010, 0.003, 0.022) for i in range(7)]
        return (
            flat("face", [cover], slots, 0.0),
            flat("wall", slots, [], -0.008),
            band("face", [cover], [cover], -0.02, 0.0, outward=True),
        )
    if kind == "knob":
        base, cap = Outline(0, 0, 0.034), Outline(0, 0, 0.021)
        return (
            flat("face", [cap], [], 0.012),
            flat("wall", [base], [], 0.0),
            band("face", [cap], [cap], 0.0, 0.012, outward=True),
        )
    frame, cup = Outline(0, 0, 0.041), Outline(0, 0, 0.020)  # a wall socket of two holes
    holes = [Outline(side * 0.0095, 0, 0.0025) for side in (-1, 1)]
    return (
        flat("face", [frame], [cup], 0.0),
        band("wall", [cup], [cup], -0.015, 0.0, outward=False),
        flat("face", [cup], holes, -0.015),
        flat("wall", holes, [], -0.02),
    )


def _around(radius: float, i: int, n: int, size: float) -> Outline:
    angle = 2 * np.pi * i / n
    return Outline(radius * np.cos(angle), radius * np.sin(angle), size)
