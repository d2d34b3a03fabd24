"""The bulls-eye: red rings on white; its centre and the way it faces."""

from __future__ import annotations

from functools import cache

from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.sighting import Sighting
from armsight.servoing.targets.ball import RED
from armsight.servoing.targets.discs import Discs, Part, SeenDisc
from armsight.servoing.targets.rehearsal import Disc, rehearse

RINGS = (Part(0.060, 0.44), Part(0.030, 0.75))
"""Outer radii of its red rings [m], whose inner ones are 45 and 15 mm, and how much they fill."""


class Bullseye:
    """Finds red rings of known radii, and tells their centre and normal."""

    name = "bullseye"

    def __init__(self) -> None:
        self._discs = Discs(RED, RINGS)

    def warm_up(self) -> None:
        """Compile what finds it."""
        rehearsed()

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """In the colour and depth of one camera, the most believable first."""
        frame = view.frame
        return [_sighting(s, frame.camera, frame.stamp, False) for s in self._discs.in_frame(view)]

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """In both pictures of a pair, the most believable first."""
        frame = view.frame
        return [_sighting(s, frame.camera, frame.stamp, True) for s in self._discs.in_pair(view)]


def _sighting(seen: SeenDisc, camera: str, stamp: float, wrist: bool) -> Sighting:
    fit = seen.fit
    return Sighting(
        Bullseye.name, camera, stamp, fit.center, fit.covariance, seen.surface, fit.normal, wrist,
        fit.tilt,
    )  # fmt: skip


@cache
def rehearsed() -> tuple[Sighting, ...]:
    """A painted bulls-eye, looked for once."""
    red, white = (204, 15, 18), (237, 237, 235)
    rims = ((0.075, white), (0.060, red), (0.045, white), (0.030, red), (0.015, white))
    return tuple(rehearse(Bullseye(), [Disc(radius, color) for radius, color in rims]))
