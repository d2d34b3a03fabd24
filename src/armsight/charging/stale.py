"""When a station wants its pair and its plug calibrated again: between two visits, once a cause.

The plug's tip was seen where the calibration does not have it, or the two pairs go on seeing the
ports in different places. A plug of another type is no matter of calibration.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from armsight.charging.residual import PairsApart
from armsight.charging.station import Station

Kind = Literal["plug", "pairs"]


@dataclass(frozen=True)
class Cause:
    """Why it wants to be calibrated again.

    Attributes:
        kind: the plug's tip is elsewhere, or the pairs disagree; words: what was seen.
    """

    kind: Kind
    words: str


class Stale:
    """Asked between visits: does what was seen ask for a calibration before the next one?

    Args:
        station: that makes the visits; apart: what its pairs say of each other.
        leaves: whether to wait until the car has driven off: with one at the station its body would
            be something that nobody has explained. A simulated car is taken away.
        settled: kinds for which it was calibrated already; once more would help no more.
    """

    def __init__(
        self, station: Station, apart: PairsApart, leaves: bool, settled: Collection[Kind] = ()
    ) -> None:
        self._station, self._apart = station, apart
        self._leaves, self._settled = leaves, settled

    def cause(self, now: float) -> Cause | None:
        """Why, or None where nothing asks for it or it is not the time."""
        if self._station.busy:
            return None
        if self._leaves:
            car = self._station.vehicle.status(now)
            if car is None or car.parked:
                return None
        seen: dict[Kind, str] = {
            "plug": self._station.check.elsewhere,
            "pairs": self._apart.words,
        }
        return next((Cause(k, w) for k, w in seen.items() if w and k not in self._settled), None)
