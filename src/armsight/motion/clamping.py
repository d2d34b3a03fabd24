"""Where a hand could be held fast between the arm and something firm.

Power and force limiting counts with a hand that gives way (:mod:`.contact_limits`). One that lies
on a table does not: its surface alone is pressed, and in the time in which the arm feels that and
stops, 0.1 m/s go 8 mm into a spring of 75 N/mm. So a part that closes in on something firm, nearer
than a hand is thick, and comes to where somebody may be, does it no faster than it can stop from
before that surface is pressed harder than was granted. Along something firm, and away from it,
nothing changes.

Firm is what is declared, and what is known to be a thing; what else stands there may be somebody.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Floats, Floats32, Points
from armsight.mapping.snapshot import OCCUPIED, WorkspaceSnapshot
from armsight.motion.contact_kernels import closing_shares
from armsight.motion.regions import Region

GAP = 0.10
"""Least gap in which a hand is not crushed (ISO 13854:2017, table 1) [m]."""
RISE = 4.0
"""Beyond that, and before whoever may be there, the speed may be greater by so much for each metre
[1/s]: the drives can follow that."""
LOOKED = GAP + 0.07
"""Firm things count up to here: beyond, any speed next to somebody's hand is allowed [m]."""


@dataclass(frozen=True)
class Clamp:
    """The law beside firm things.

    Attributes:
        firm: (f, 3) centres in ``base`` of firm cubes near a region [m].
        somebody: (s, 3) centres of cubes in which what is touched may be [m].
        radius: half diagonal of a cube [m].
        speed: at which a part may close in on one of them in the gap [m/s].
    """

    firm: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))
    somebody: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))
    radius: float = 0.0
    speed: float = 0.0

    def shares(
        self, center: Points, velocity: Points, radius: Floats, slack: float = 0.0
    ) -> Floats:
        """(m,) the greatest share of a motion at which each sphere keeps this law.

        Args:
            center: (m, 3) of the arm's spheres [m].
            velocity: (m, 3) of these [m/s].
            radius: (m,) of the spheres [m].
            slack: that much faster is no matter [m/s].
        """
        out = np.full(len(radius), np.inf)
        if len(self.firm):
            closing_shares(
                np.ascontiguousarray(center), np.ascontiguousarray(velocity), radius + self.radius,
                self.firm, self.somebody, self.speed + slack, (GAP, RISE, LOOKED), out,
            )  # fmt: skip
        return out


def firm_near(snapshot: WorkspaceSnapshot, region: Region) -> Floats32:
    """(f, 3) centres of what is firm in and close around a region [m]."""
    grid, center = snapshot.grid, region.center(snapshot.stamp)
    reach = 0.5 * region.extent + LOOKED
    low, box = grid.around(center, reach)
    declared = (snapshot.state[box] == OCCUPIED) & np.isneginf(snapshot.last_occupied[box])
    found = [np.asarray(grid.center(np.argwhere(declared) + low), np.float32)]
    things = np.asarray(snapshot.things, np.float32).reshape(-1, 3)
    found.append(things[(np.abs(things - center) <= reach).all(axis=1)])
    points = np.concatenate(found)
    return points[region.distance(points.astype(float), snapshot.stamp) <= LOOKED]
