"""What a task says of a parked car to the cell: its body, once its port has been found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.charging.closer import Where
from armsight.charging.moves import apart
from armsight.charging.vehicle_file import VehicleShape
from armsight.charging.visit import ASIDE
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.permitted import outside_the_map
from armsight.motion.regions import Region
from armsight.workcell.schema_devices import PlugSection

ELSEWHERE = (0.03, float(np.deg2rad(2.5)))
"""Found farther than this from where its body was declared, it has moved [m], [rad]."""
SURER = (0.003, float(np.deg2rad(0.3)))
"""Found this far from there, its body is declared anew beside the old one, which then goes."""

NEARER = 0.01
"""Or where it need not be said so much farther out any more [m]."""
SIGMAS, REACH, MOST = 3.0, 0.5, 0.05
"""The body may be farther out than its port says by so many standard deviations of the port's tilt,
this far from the port [m], and by no more than this [m]: else cameras would see through it."""
MOST_INWARD = 0.15
"""Or farther in, at the ends of its side, by no more than this [m]."""
UNSURE = 0.005
"""Its place is known to this when the guard is asked [m], one standard deviation."""


class ParkedCarOnMap:
    """Where a car's body is, by its port.

    Args:
        shape: of the car; None: its side is among the cell's solids, and nothing is to be said.
        T_world_base: of the arm.
        aside: half the side of what is to be touched about its port [m].

    Attributes:
        counts: whether the map counts its body.
    """

    def __init__(
        self, shape: VehicleShape | None, T_world_base: Pose, aside: float = ASIDE
    ) -> None:
        self.shape, self._T_world_base, self._aside = shape, T_world_base, aside
        self._map: WorkspaceSnapshot | None = None
        self._number, self._margin = 0, 0.0
        self.gone()

    def gone(self) -> None:
        """It is not there, or not any more: whatever is may be a person."""
        self._bodies: dict[str, tuple[Solid, ...]] = {}
        self._lid: tuple[str, tuple[Solid, ...]] | None = None
        self._at: Pose | None = None
        self.counts = self.shape is None

    @property
    def standing(self) -> dict[str, tuple[Solid, ...]]:
        """What to say, see :class:`~armsight.motion.task.Task`."""
        return self._bodies if self._lid is None else self._bodies | dict([self._lid])

    @property
    def solids(self) -> tuple[Solid, ...]:
        """Its body where it was found last, and its open lid."""
        newest = list(self._bodies.values())[-1:] + ([] if self._lid is None else [self._lid[1]])
        return tuple(solid for solids in newest for solid in solids)

    def lid(self, T_base_port: Pose | None) -> None:
        """The lid stands open, of the port that is here; None: it does not, or nobody knows."""
        if self.shape is None or T_base_port is None:
            self._lid = None
        elif self._lid is None:
            leaf = self.shape.open_lid
            self._number += 1
            T = T_base_port @ leaf.T_frame_solid
            self._lid = f"lid {self._number}", (replace(leaf, T_frame_solid=T),)

    def contradiction(self, T_base_port: Pose) -> str:
        """Why nobody can plug in where a port was found, in words; empty when that can be."""
        if self.shape is not None:
            wrong = self.shape.contradiction(self._T_world_base @ T_base_port)
            if wrong:
                return f"not the car that is expected: {wrong}"
        seen, side = self._map, 2.0 * self._aside
        if seen is None or not math.isfinite(seen.stamp):
            return ""
        unsure = UNSURE**2 * np.eye(3)
        about = Region("box", (side, side, side), T_base_port, seen.stamp, covariance=unsure)
        if not outside_the_map(seen, about):
            return ""
        return (
            "the port is too near the end of the mapped box for anybody to see who is beside it; "
            "park elsewhere, or enlarge [mapping] in the cell's file"
        )

    def found(self, T_base_port: Pose, covariance: Floats) -> None:
        """The port is here, and so is the car.

        Args:
            T_base_port: where.
            covariance: (6, 6) of that as a twist in its own frame [m], [rad].
        """
        if self.shape is None:
            return
        tilt = float(np.sqrt(max(covariance[3, 3], covariance[4, 4])))
        margin = min(SIGMAS * tilt * REACH, MOST)
        side = max(self.shape.side_m.left, self.shape.side_m.right)
        inward = min(SIGMAS * tilt * side, MOST_INWARD)
        if self._at is not None:
            gap = apart(self._at, T_base_port)
            if all(a < b for a, b in zip(gap, SURER)) and margin > self._margin - NEARER:
                return
            if any(a > b for a, b in zip(gap, ELSEWHERE)):
                self.gone()
        self._at, self._number = T_base_port.copy(), self._number + 1
        self._margin = margin
        solids = tuple(
            replace(s, T_frame_solid=T_base_port @ s.T_frame_solid)
            for s in self.shape.within(margin, inward)
        )
        newest = list(self._bodies.items())[-1:]
        self._bodies = dict([*newest, (f"car {self._number}", solids)])

    def told(self, snapshot: WorkspaceSnapshot | None) -> str:
        """What the map says: once it counts the newest, the one before is withdrawn.

        Returns:
            Why it does not count the newest, in words; empty when it does, or may.
        """
        self._map = snapshot
        declared = {} if snapshot is None else {d.name: d for d in snapshot.declared}
        newest = next(reversed(self._bodies), "") if self._bodies else ""
        mine = declared.get(newest)
        if mine is not None and mine.taken:
            self._bodies, self.counts = {newest: self._bodies[newest]}, True
        elif mine is not None and not mine.waiting:
            return f"the car's side: {mine.reason}"
        lid = None if self._lid is None else declared.get(self._lid[0])
        if lid is None or lid.taken or lid.waiting:
            return ""
        self._lid = None  # the finger was still there, say: once more
        return f"the open lid: {lid.reason}"


def where_parked(
    section: PlugSection, T_world_base: Pose, possible: Callable[[Pose], bool]
) -> Where:
    """Where a port can be, in ``base``.

    Args:
        section: of the cell's file.
        T_world_base: where the robot stands.
        possible: whether one can be at a pose in ``base``.
    """
    parking = section.parking
    if parking is None:
        return Where(possible)
    about = np.asarray(inverse(T_world_base) @ parking.pose)
    return Where(possible, about, parking.within_m)
