"""What an inlet sits in: a pocket of the car's painted side."""

from __future__ import annotations

from armsight.charging.ports.meshes import Surface, band, flat
from armsight.charging.ports.outline import Outline
from armsight.charging.ports.table import MM, Port

FRONT, FLOOR, WIDER = 14 * MM, -9 * MM, 14 * MM
"""The side before the port's face, the pocket's floor, and how much wider than the plate it is."""


def flank(port: Port) -> tuple[tuple[Surface, str], ...]:
    """A car's painted side with the pocket in which the inlet sits, and the looks of both."""
    pocket = port.plate.grown(WIDER)
    front, floor = FRONT, FLOOR
    side = Outline(0.0, 0.0, 0.45, 0.35)
    return (
        (flat("face", [side], [pocket], front), "paint"),
        (band("wall", [pocket], [pocket], floor, front, outward=False), "pocket"),
        (flat("floor", [pocket], [port.plate], floor), "pocket"),
    )
