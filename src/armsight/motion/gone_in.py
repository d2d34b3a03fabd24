"""Who came near, and has gone into a region in which nobody counts, may come out of it again.

Within the region of a permit for a hand the whole arm is so slow that it may meet what is there.
A hand that runs into it is not on the map any more, and would find an arm that has set out again
where it comes out on the other side: beside a part that nobody may meet. So the arm stands until
it could have run through.

Whoever stays in the region, and runs out of it later, meets an arm that is as slow as the permit
says, and may be outside by then: a permit cannot promise more (``docs/guard.md``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from armsight.arrays import Points
from armsight.motion.permitted import Grant, grown_by
from armsight.motion.tick import Tick
from armsight.motion.velocity_filter import VelocityFilter


@dataclass(frozen=True)
class _Nearest:
    place: Points
    distance: float
    stamp: float


class GoneIn:
    """Watches the nearest hazard that was seen, from one snapshot to the next.

    Attributes:
        until: the arm stands until then [s].
    """

    def __init__(self) -> None:
        self.until = -math.inf
        self._before: _Nearest | None = None

    def forget(self) -> None:
        """The clock jumped."""
        self.until, self._before = -math.inf, None

    def see(self, tick: Tick, filter_: VelocityFilter, grant: Grant | None) -> None:
        """A new snapshot: did the nearest of all go where it does not count?

        Args:
            tick: with the snapshot as the arm may count with it.
            filter_: with its hazards.
            grant: what is permitted.
        """
        before, self._before = self._before, None
        seen = tick.snapshot
        if grant is None or not grant.person or seen is None:
            return
        speed, region = filter_.monitor.law.person, grant.region
        if before is not None and seen.stamp >= before.stamp:
            step = speed * (seen.stamp - before.stamp) + 2.0 * seen.hazard_radius
            border = float(region.distance(before.place, seen.stamp)[0]) - grown_by(seen, region)
            if border <= step and tick.near.least > before.distance + step:
                through = region.extent / speed
                self.until = tick.now + through + filter_.reaction.value
        nearest = int(tick.near.nearest[tick.near.closest])
        if nearest >= 0 and not filter_.unseen(nearest):
            place = filter_.hazards.blocks.points[nearest][None].astype(float)
            self._before = _Nearest(place, tick.near.least, seen.stamp)
