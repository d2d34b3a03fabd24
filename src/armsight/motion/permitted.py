"""A snapshot as a contact permit lets the guard, the reflex and the planner see it.

Within the region of a ``thing`` nothing is a person, and what is there is solid for all but the
parts that may touch. One derived snapshot carries both, so whoever is given it follows the permit.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats, Mask, Points
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.regions import Region

SEEN_WITHIN = 0.01
"""Depth noise and calibration put a surface this far from where it is [m], beyond the voxel."""
LINGERS = 0.1
"""What has moved on stays in the map for so long [s]."""
SURE = 2.0
"""Standard deviations of the region's place that count as possible."""
SHELL = 2
"""Voxels around the region in which nobody may be: a person hangs together, and is larger."""
TOUCHES = 3
"""As many voxels there are somebody; fewer are noise (as for things)."""


@dataclass(frozen=True)
class Grant:
    """What is permitted now.

    Attributes:
        region: where.
        touching: (k,) bool, those of ``Robot.spheres`` that may touch.
    """

    region: Region
    touching: Mask


NO_GRANT = Grant(Region("sphere", (1e-9, 0.0, 0.0), np.eye(4), 0.0), np.zeros(0, bool))


@dataclass(frozen=True)
class PermittedSnapshot(WorkspaceSnapshot):
    """A snapshot less the hazards of a granted region.

    Attributes:
        grant: solid cubes of its region are none for the parts that may touch.
    """

    grant: Grant = NO_GRANT


def growth(snapshot: WorkspaceSnapshot, region: Region) -> float:
    """How far from a region [m] the map may have what is in it, at the centre of a voxel."""
    unsure = SURE * region.deviation(snapshot.stamp)
    return snapshot.hazard_radius + SEEN_WITHIN + unsure + LINGERS * region.speed


def permitted(snapshot: WorkspaceSnapshot, grant: Grant) -> PermittedSnapshot:
    """What the arm may count with under a grant."""
    keep = _distance(snapshot, snapshot.hazards, grant.region) > growth(snapshot, grant.region)
    known = {f.name: getattr(snapshot, f.name) for f in fields(WorkspaceSnapshot)}
    known["hazards"] = np.ascontiguousarray(snapshot.hazards[keep])
    known["hazard_unknown"] = snapshot.hazard_unknown[keep]
    return PermittedSnapshot(**known, grant=grant)


def somebody_beside(snapshot: WorkspaceSnapshot, region: Region) -> str:
    """Where somebody could be close around a region, in words; empty where nobody is.

    Whoever is in the region without being around it would have to be smaller than it.
    """
    grown = growth(snapshot, region)
    distance = _distance(snapshot, snapshot.hazards, region)
    shell = np.flatnonzero((distance > grown) & (distance <= grown + SHELL * snapshot.grid.voxel))
    if len(shell) < TOUCHES:
        return ""
    nearest = shell[np.argmin(distance[shell])]
    x, y, z = snapshot.hazards[nearest]
    what = "unseen space" if snapshot.hazard_unknown[nearest] else "something"
    return f"{what} that may be a person is beside it, at ({x:.2f}, {y:.2f}, {z:.2f})"


def outside_the_map(snapshot: WorkspaceSnapshot, region: Region) -> bool:
    """Whether nobody is looked for around a region: it leaves the mapped box."""
    grid = snapshot.grid
    center = region.center(snapshot.stamp)
    reach = 0.5 * region.extent + growth(snapshot, region) + SHELL * grid.voxel
    low = np.asarray(grid.origin)
    high = low + np.asarray(grid.shape) * grid.voxel
    return bool((center - reach < low).any() or (center + reach > high).any())


def voxels_within(snapshot: WorkspaceSnapshot, region: Region) -> tuple[NDArray[np.int64], ...]:
    """Indices (i, j, k) of the voxels in which the map may have what is in a region."""
    grid, grown = snapshot.grid, growth(snapshot, region)
    center = region.center(snapshot.stamp)
    reach = 0.5 * region.extent + grown
    low = np.maximum(grid.index((center - reach)[None])[0], 0)
    high = np.minimum(grid.index((center + reach)[None])[0] + 1, grid.shape)
    if (low >= high).any():
        return tuple(np.zeros(0, np.int64) for _ in range(3))
    axes = [np.arange(a, b) for a, b in zip(low, high)]
    index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = region.distance(grid.center(index), snapshot.stamp) <= grown
    return tuple(index[inside].T)


def _distance(snapshot: WorkspaceSnapshot, points: Points, region: Region) -> Floats:
    """(n,) distance [m] from a region; inf for what is far from it."""
    points = np.asarray(points)
    out = np.full(len(points), np.inf)
    reach = 0.5 * region.extent + growth(snapshot, region) + SHELL * snapshot.grid.voxel
    center = region.center(snapshot.stamp).astype(points.dtype)
    near = np.flatnonzero((np.abs(points - center) <= reach).all(axis=1))
    out[near] = region.distance(points[near].astype(float), snapshot.stamp)
    return out
