"""Which looks count: exposed while the arm rested, each once; and what they say to a plug."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.lid_eye import LidLook
from armsight.charging.visit import Seen, StationOptions

AnyLook = TypeVar("AnyLook", PortLook, LidLook)
INLETS_OF = {"type1_plug": ("type1",), "type2_plug": ("type2",), "ccs2_plug": ("ccs2",)}
"""Which inlets a plug enters."""
MAY_BE_OURS = INLETS_OF | {"ccs2_plug": ("ccs2", "type2")}
"""What such an inlet may look like where it is not clear: the upper half of a CCS2 is a Type 2."""
OTHER = 0.75
"""Score of a port of another type of which it is said that it is one."""
PERHAPS = 0.5
"""Score of a port of another type of which it is said that it may be one."""
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
        self._last = self._last_lid = -math.inf

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
        look = self._newest(seen, seen.looks, pair, begun, self._last)
        self._last = self._last if look is None else look.stamp
        return look

    def fresh_lid(self, seen: Seen, pair: str, begun: float) -> LidLook | None:
        """The same of looks at a lid."""
        look = self._newest(seen, seen.lids, pair, begun, self._last_lid)
        self._last_lid = self._last_lid if look is None else look.stamp
        return look

    def _newest(
        self, seen: Seen, looks: Sequence[AnyLook], pair: str, begun: float, last: float
    ) -> AnyLook | None:
        settle = self._options.settle
        if not self.rests(seen, begun, settle):
            return None
        assert self._resting is not None
        after = max(self._resting + settle - 0.1, begun, last + 1e-3)
        return next((k for k in looks if k.pair == pair and k.stamp > after), None)

    def of_ours(self, look: PortLook) -> SeenPort | None:
        """The surest port that the plug fits into, or None."""
        o, fits = self._options, INLETS_OF[self._options.plug]
        again = o.mode == "ours" and o.near  # the near one looks at it again
        least = o.least_far if look.pair == o.far and again else o.least
        good = [p for p in look.ports if p.port in fits and p.score >= least]
        return max(good, key=lambda p: p.score, default=None)

    def why_none(self, look: PortLook) -> str:
        """Why there is none, in words."""
        plug = self._options.plug
        other = next((p for p in look.ports if p.score >= OTHER), None)
        if other is not None:
            return f"the port is {other.port}: the {plug} does not fit"
        unclear = max(look.ports, key=lambda p: p.score, default=None)
        if unclear is None or unclear.port in MAY_BE_OURS[plug] or unclear.score < PERHAPS:
            return look.reason or "no port that is clear enough"
        return (
            f"no port that is clear enough; what is seen looks most like {unclear.port} "
            f"(score {unclear.score:.2f}), and there the {plug} does not fit"
        )
