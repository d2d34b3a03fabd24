"""Whether the plug in the hand is still the one that was calibrated.

A plug is not exchanged without being taken off, and that is felt: while the arm rests at its
stand-by nothing else changes what hangs on it. Then it is shown to the standing pair, which tells
its type, and whether its tip is where the calibration has it.
"""

from __future__ import annotations

import math

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.charging.eye import PortLook
from armsight.charging.feeling import Feeling
from armsight.charging.looking import OTHER
from armsight.charging.ports.table import PORTS
from armsight.geometry.pose import angle_between

OFF, FOR = 0.6, 0.5
"""A plug is off that takes this share of its weight away for so long [s]: a cable that is lifted
takes less, and a brush pulls aside."""
AGAIN = 0.15
"""What hangs there afterwards is the same where it pulls as before, to this share of its weight."""
SETTLED = 1.0
"""It hangs still after so long at the stand-by; and a sensor that is silent for so long was cut off
[s]."""
APART, TURNED = 0.015, math.radians(8.0)
"""A tip so far from where the calibration has it, or so turned, is another one [m], [rad]."""


class PlugCheck:
    """Feels whether somebody had the plug off, and says what a look at it shows.

    Args:
        plug: its type; weight: with its cable [N], None where nobody knows.

    Attributes:
        doubt: why it has to be looked at before it is used, in words; empty where it is believed.
        elsewhere: that its tip is not where the calibration has it, in words; empty where nobody
            saw that.
    """

    def __init__(self, plug: str, weight: float | None) -> None:
        self._plug, self._weight = plug, weight
        self._before: Vector3 | None = None  # felt before the doubt, and after it [N]
        self._after: Vector3 | None = None
        self.believe()
        self.leave()

    def believe(self) -> None:
        """It is the right one: it was seen, or somebody says so."""
        self.doubt, self.elsewhere, self._asked = "", "", False

    def ask(self) -> None:
        """Somebody wants it looked at: without that it is not used."""
        self.doubt, self._asked = "asked to look at the plug", True

    def leave(self) -> None:
        """The arm is not at rest at its stand-by."""
        self._rested = self._since = math.nan
        self._usual: Vector3 | None = None

    def feel(self, feeling: Feeling, now: float) -> None:
        """Another round at rest at the stand-by."""
        if self._weight is None:
            return
        if math.isnan(self._rested):
            self._rested = now
        if now - self._rested < SETTLED:
            return
        force = feeling.force
        if self.doubt:
            self._after = force
            return
        if self._usual is None:
            self._usual = force
        usual = self._usual
        if usual is None:
            return
        if feeling.silent(now) > SETTLED:
            self._doubted("the force sensor was silent at the stand-by")
            return
        if force is None:
            return
        size = float(np.linalg.norm(usual))
        share = float((usual - force) @ usual) / max(size * self._weight, 1e-9)
        if share < OFF:
            self._since = math.nan
        elif math.isnan(self._since):
            self._since = now
        elif now - self._since > FOR:
            felt = f"{feeling.pull:.0f} N instead of {size:.0f}"
            self._doubted(f"the plug was off at the stand-by ({felt})")

    def _doubted(self, why: str) -> None:
        self.doubt, self._before, self._after = why, self._usual, None

    @property
    def refusal(self) -> str:
        """Why a plug that could not be looked at is not used, in words; empty where it may be.

        It may where what hangs there pulls as before: one of another type would be refused by its
        socket, which the law of plugging in feels.
        """
        if self._asked:
            return self.doubt
        if not self.doubt or self._weight is None or self._before is None or self._after is None:
            return ""
        if float(np.linalg.norm(self._after - self._before)) < AGAIN * self._weight:
            return ""
        now, before = (float(np.linalg.norm(f)) for f in (self._after, self._before))
        return f"what hangs there pulls otherwise since ({now:.0f} N, {before:.0f} before)"

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
            self.elsewhere = (
                f"the plug's tip is {1e3 * off:.0f} mm and {math.degrees(turned):.0f} deg from "
                "where the calibration has it: another plug, or it has moved in its mount; "
                "calibrate again: armsight calibrate CELL --plug"
            )
            return self.elsewhere
        self.believe()
        return ""
