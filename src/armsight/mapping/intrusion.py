"""What is seen inside of declared solids: somebody, or a solid that is declared too large."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.mapping.occupancy import Occupancy
from armsight.mapping.snapshot import SeenInside

LASTS = 1.0
"""What is seen inside of a solid for so long [s] is told: a stray sighting is withdrawn sooner."""


class Intrusions:
    """Tells which declared solids something is seen in, and how deep."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def update(self, now: float, layers: Sequence[Occupancy]) -> tuple[SeenInside, ...]:
        """What has been seen inside of solids for :data:`LASTS` at ``now`` [s], one a solid."""
        found: dict[str, SeenInside] = {}
        for layer in layers:
            occupied = layer.dynamic
            solid, depth = layer.inside_of(occupied)
            # A voxel's centre may be half a diagonal deeper than what was seen of it.
            sure = depth > layer.half_diagonal
            for s in np.unique(solid[sure]):
                own = np.flatnonzero(sure & (solid == s))
                deepest = own[np.argmax(depth[own])]
                declared = layer.declared.solids[s - 1]
                seen = SeenInside(
                    declared,
                    float(depth[deepest]) + declared.coarse,
                    np.asarray(layer.center(occupied[deepest]), float),
                )
                known = found.get(declared.name)
                if known is None or seen.depth > known.depth:
                    found[declared.name] = seen
        self._since = {name: self._since.get(name, now) for name in found}
        return tuple(s for name, s in found.items() if now - self._since[name] >= LASTS)

    def turn_back(self, seconds: float) -> None:
        """The clock was turned back by a time [s]."""
        self._since = {name: since - seconds for name, since in self._since.items()}
