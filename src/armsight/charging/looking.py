"""Which looks count: exposed while the arm rested, each once; and what they say to a plug."""

from __future__ import annotations

import math

import numpy as np

from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.visit import Seen, StationOptions

INLETS_OF = {"type1_plug": ("type1",), "type2_plug": ("type2",), "ccs2_plug": ("ccs2",)}
"""Which inlets a plug enters."""
OTHER = 0.75
"""Score of a port of another type of which it is said that it is one."""
STILL = 0.01
"""Joints below this speed rest [rad/s]."""


class Looker:
    """Keeps since when the arm rests, and which looks were taken.

    Args:
        options: of the station.
    """

    def __init__(self, options: StationOptions) -> None:
        self._options = options
        self._resting: float | None = None
        self._last = -math.inf

    def take(self, seen: Seen) -> None:
        """Another round."""
        moving = float(np.abs(seen.joints.velocity).max()) > STILL
        if moving or self._resting is None:
            self._resting = seen.now

    def rests(self, seen: Seen, begun: float, seconds: float) -> bool:
        """Whether the arm has rested for so long [s] in a state that began at a time [s]."""
        assert self._resting is not None
        return seen.now - max(self._resting, begun) >= seconds

    def fresh(self, seen: Seen, pair: str, begun: float) -> PortLook | None:
        """A look that was exposed since the arm came to rest in this state, each one once."""
        settle = self._options.settle
        if not self.rests(seen, begun, settle):
            return None
        assert self._resting is not None
        after = max(self._resting + settle - 0.1, begun, self._last + 1e-3)
        for look in seen.looks:
            if look.pair == pair and look.stamp > after:
                self._last = look.stamp
                return look
        return None

    def of_ours(self, look: PortLook) -> SeenPort | None:
        """The surest port that the plug fits into, or None."""
        fits = INLETS_OF[self._options.plug]
        good = [p for p in look.ports if p.port in fits and p.score >= self._options.least]
        return max(good, key=lambda p: p.score, default=None)

    def why_none(self, look: PortLook) -> str:
        """Why there is none, in words."""
        other = next((p for p in look.ports if p.score >= OTHER), None)
        if other is not None:
            return f"the port is {other.port}: the {self._options.plug} does not fit"
        return look.reason or "no port that is clear enough"
