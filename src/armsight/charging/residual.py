"""Whether what a station sees says that it has to be calibrated again.

The standing pair and the one on the flange see the same port before every visit. They agree to some
millimetres (docs/charging.md); where they go on disagreeing, one of them, the plug or the platform
has moved. One visit says nothing: somebody may have moved the car between the looks.
"""

from __future__ import annotations

import numpy as np

from armsight.charging.eye import PortLook, SeenPort

APART = 0.015
"""Median distance above which the pairs contradict each other [m]: five times what is left of a
calibration at 1.6 m."""
SAME = 0.15
"""What is farther apart is another port, or a car that was driven elsewhere [m]."""
SOON = 20.0
"""Looks of one visit lie no farther apart in time [s]."""
VISITS = 3
"""So many of them have to say so."""


class PairsApart:
    """Remembers how far apart both pairs saw the port, visit by visit.

    Args:
        far: name of the standing pair; near: of the one on the flange, empty for none.
        cell: its name, for what is said.
    """

    def __init__(self, far: str, near: str, cell: str) -> None:
        self._far, self._near, self._cell = far, near, cell
        self._seen: tuple[float, SeenPort] | None = None
        self._gaps: dict[float, float] = {}

    def take(self, look: PortLook) -> None:
        """Another look of either pair; only the newest second look of a first one counts."""
        if not look.ports:
            return
        if look.pair == self._far:
            self._seen = (look.stamp, look.ports[0])
        elif look.pair == self._near and self._seen is not None:
            stamp, first = self._seen
            second = next((p for p in look.ports if p.port == first.port), None)
            if second is None or not 0.0 < look.stamp - stamp < SOON:
                return
            gap = float(np.linalg.norm((second.T_base_port - first.T_base_port)[:3, 3]))
            if gap < SAME:
                self._gaps[stamp] = gap
                self._gaps = dict(list(self._gaps.items())[-VISITS:])

    @property
    def words(self) -> str:
        """What to do, or empty."""
        if len(self._gaps) < VISITS:
            return ""
        gap = float(np.median(list(self._gaps.values())))
        if gap < APART:
            return ""
        return (
            f"the two pairs saw the last {VISITS} ports {1e3 * gap:.0f} mm apart: a pair, the plug "
            f"or the platform has moved; calibrate again: armsight calibrate {self._cell} --plug"
        )
