"""A snapshot as a contact permit lets the guard, the reflex and the planner see it.

Within the region of a ``thing`` nothing is a person, and what is there is solid for all but the
parts that may touch. One derived snapshot carries both, so whoever is given it follows the permit.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats, Floats32, Ints, Mask, Vector3
from armsight.mapping.snapshot import OCCUPIED, UNKNOWN, WorkspaceSnapshot
from armsight.mapping.tracked import SHELL, TOUCHES, growth
from armsight.motion.contact_kernels import in_box, leave_out
from armsight.motion.regions import Region


@dataclass(frozen=True)
class Grant:
    """What is permitted now.

    Attributes:
        region: where.
        touching: (k,) bool, those of ``Robot.spheres`` that may touch.
        person: what is there is a part of somebody: power and force limiting, not nobody.
        ceiling: (up, height): what is above this plane in ``base`` is not in it; None without one.
        out: (3,) the one way out of a thing that holds what is in it, in ``base``; else None.
        force: with which it may be pulled at on that way [N].
    """

    region: Region
    touching: Mask
    person: bool = False
    ceiling: tuple[Vector3, float] | None = None
    out: Vector3 | None = None
    force: float = 0.0


NO_GRANT = Grant(Region("sphere", (1e-9, 0.0, 0.0), np.eye(4), 0.0), np.zeros(0, bool))


@dataclass(frozen=True)
class PermittedSnapshot(WorkspaceSnapshot):
    """A snapshot less the hazards of a granted region.

    Attributes:
        grant: solid cubes of its region are none for the parts that may touch.
        touchable: (t, 3) float32 centres in ``base`` [m] of the hazards that are in its region.
    """

    grant: Grant = NO_GRANT
    touchable: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))


def grown_by(snapshot: WorkspaceSnapshot, region: Region) -> float:
    """How far from a region [m] the map may have what is in it, at the centre of a voxel."""
    return growth(region, snapshot.stamp, snapshot.hazard_radius)


def permitted(snapshot: WorkspaceSnapshot, grant: Grant) -> PermittedSnapshot:
    """What the arm may count with under a grant.

    Single voxels close around a thing are its own, as they are for :func:`somebody_beside`.
    """
    grown = grown_by(snapshot, grant.region)
    near, distance = _near(snapshot, snapshot.hazards, grant.region)
    inside = distance <= grown
    if not grant.person:
        shell = ~inside & (distance <= grown + SHELL * snapshot.grid.voxel)
        if np.count_nonzero(shell) < TOUCHES:
            inside |= shell
    taken = near[inside & _below(grant, snapshot.hazards[near])]
    touchable = snapshot.hazards[taken]
    if grant.person:  # where the cell was said to be empty, a still face is a thing: not here
        things = np.asarray(snapshot.things, np.float32).reshape(-1, 3)
        near, distance = _near(snapshot, things, grant.region)
        close = things[near[distance <= grown]]
        touchable = np.concatenate([touchable, close[_below(grant, close)]])
    known = {f.name: getattr(snapshot, f.name) for f in fields(WorkspaceSnapshot)}
    if len(taken):
        rest = len(snapshot.hazards) - len(taken)
        hazards, unknown = np.empty((rest, 3), np.float32), np.empty(rest, bool)
        leave_out(snapshot.hazards, snapshot.hazard_unknown, taken, hazards, unknown)
        known |= {"hazards": hazards, "hazard_unknown": unknown}
    touchable = np.ascontiguousarray(touchable)
    return PermittedSnapshot(**known, grant=grant, touchable=touchable)


def _below(grant: Grant, points: Floats32) -> Mask:
    """(n,) bool, which of (n, 3) points [m] are not above a grant's ceiling."""
    if grant.ceiling is None:
        return np.ones(len(points), bool)
    up, height = grant.ceiling
    return np.asarray(points @ np.asarray(up, np.float32) <= height)


def somebody_beside(snapshot: WorkspaceSnapshot, region: Region) -> str:
    """Where somebody could be close around a region, in words; empty where nobody is.

    Whoever is in the region without being around it would have to be smaller than it.
    """
    grown = grown_by(snapshot, region)
    near, distance = _near(snapshot, snapshot.hazards, region)
    shell = np.flatnonzero((distance > grown) & (distance <= grown + SHELL * snapshot.grid.voxel))
    if len(shell) < TOUCHES:
        return ""
    nearest = near[shell[np.argmin(distance[shell])]]
    x, y, z = snapshot.hazards[nearest]
    what = "unseen space" if snapshot.hazard_unknown[nearest] else "something"
    return f"{what} that may be a person is beside it, at ({x:.2f}, {y:.2f}, {z:.2f})"


def outside_the_map(snapshot: WorkspaceSnapshot, region: Region) -> bool:
    """Whether nobody is looked for around a region: it leaves the mapped box."""
    grid = snapshot.grid
    center = region.center(snapshot.stamp)
    reach = region.half_box() + grown_by(snapshot, region) + SHELL * grid.voxel
    low = np.asarray(grid.origin)
    high = low + np.asarray(grid.shape) * grid.voxel
    return bool((center - reach < low).any() or (center + reach > high).any())


def voxels_within(snapshot: WorkspaceSnapshot, region: Region) -> tuple[NDArray[np.int64], ...]:
    """Indices (i, j, k) of the voxels not seen free in which what is in a region may be."""
    grid, grown = snapshot.grid, grown_by(snapshot, region)
    low, box = grid.around(region.center(snapshot.stamp), 0.5 * region.extent + grown)
    part = snapshot.state[box]
    index = np.argwhere((part == OCCUPIED) | (part == UNKNOWN)) + low
    inside = region.distance(grid.center(index), snapshot.stamp) <= grown
    return tuple(index[inside].T)


def _near(snapshot: WorkspaceSnapshot, points: Floats32, region: Region) -> tuple[Ints, Floats]:
    """(k,) which of (n, 3) points are near a region, ascending, and their distance from it [m]."""
    reach = 0.5 * region.extent + grown_by(snapshot, region) + SHELL * snapshot.grid.voxel
    found = np.empty(len(points), np.int64)
    count = in_box(points, region.center(snapshot.stamp), float(reach), found)
    near = found[:count]
    return near, region.distance(points[near].astype(float), snapshot.stamp)
