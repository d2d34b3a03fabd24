"""Whether the plug in the hand is still the one that was calibrated.

A plug is not exchanged without being taken off, and that is felt: while the arm rests at its
stand-by nothing else changes what hangs on it. Then it is shown to the standing pair, which tells
its type, and whether its tip is where the calibration has it.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Pose
from armsight.charging.eye import PortLook
from armsight.charging.feeling import Feeling
from armsight.charging.looking import OTHER
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import angle_between

TAKEN, FOR = 0.3, 0.3
"""Somebody had hold of a plug of which this share of its weight more or less was felt, for so long
[s]."""
SETTLED = 1.0
"""It hangs still after so long at the stand-by; and a sensor that is silent for so long was cut off
[s]."""
APART, TURNED = 0.015, math.radians(8.0)
"""A tip so far from where the calibration has it, or so turned, is another one [m], [rad]."""


class PlugCheck:
    """Feels whether somebody had hold of the plug, and says what a look at it shows.

    Args:
        plug: its type; weight: with its cable [N], None where nobody knows.

    Attributes:
        doubt: why it has to be looked at before it is used, in words; empty where it is believed.
    """

    def __init__(self, plug: str, weight: float | None) -> None:
        self._plug, self._weight = plug, weight
        self.doubt = ""
        self.leave()

    def leave(self) -> None:
        """The arm is not at rest at its stand-by."""
        self._rested = self._since = math.nan
        self._usual = math.nan

    def feel(self, feeling: Feeling, now: float) -> None:
        """Another round at rest at the stand-by."""
        if self._weight is None or self.doubt:
            return
        if math.isnan(self._rested):
            self._rested = now
        if now - self._rested < SETTLED:
            return
        pull = feeling.pull
        if math.isnan(self._usual):
            self._usual = pull
        if feeling.silent(now) > SETTLED and np.isfinite(self._usual):
            self.doubt = "the force sensor was silent at the stand-by"
        elif not abs(pull - self._usual) > TAKEN * self._weight:
            self._since = math.nan
        elif math.isnan(self._since):
            self._since = now
        elif now - self._since > FOR:
            felt = f"{pull:.0f} N instead of {self._usual:.0f}"
            self.doubt = f"somebody had hold of the plug at the stand-by ({felt})"

    def wrong(self, look: PortLook, T_base_plug: Pose) -> str | None:
        """Why the plug that a look shows is not the right one, in words; empty where it is.

        None where the look does not tell. A plug that is right is believed again.

        Args:
            look: for plugs.
            T_base_plug: where it is by the calibration, as it hangs.
        """
        plugs = [p for p in look.ports if PORTS[p.port].plug]
        seen = max(plugs, key=lambda p: p.score, default=None)
        if seen is None or seen.score < OTHER or seen.doubtful:
            return None
        if seen.port != self._plug:
            return f"the plug in the hand is a {seen.port}: a {self._plug} is expected"
        off = float(np.linalg.norm((seen.T_base_port - T_base_plug)[:3, 3]))
        turned = angle_between(seen.T_base_port, T_base_plug)
        if off > APART or turned > TURNED:
            return (
                f"the plug's tip is {1e3 * off:.0f} mm and {math.degrees(turned):.0f} deg from "
                "where the calibration has it: another plug, or it has moved in its mount; "
                "calibrate again: armsight calibrate CELL --plug"
            )
        self.doubt = ""
        return ""
