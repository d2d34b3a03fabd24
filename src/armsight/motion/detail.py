"""Solid matter finer than a voxel: points that stand for surfaces, in rows of voxels.

A map of cubes refuses whatever comes nearer to a surface than its cubes protrude from it. Where
surfaces are known better than that, the voxels that they pass through are free but for points on
them. What may protrude between the points is the caller's to add as a margin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armsight.arrays import Floats32, Ints, Points
from armsight.mapping.snapshot import VoxelGrid, WorkspaceSnapshot


class Detail(NamedTuple):
    """Solid points by rows of voxels along z.

    Attributes:
        points: (k, 3) in ``base`` [m], sorted by row, then by z.
        rows: (nx ny + 1,) the points ``rows[r]:rows[r + 1]`` lie in row r = ix ny + iy; (0,) when
            there are no points at all.
    """

    points: Floats32
    rows: Ints


def _read_only(detail: Detail) -> Detail:
    for array in detail:
        array.flags.writeable = False
    return detail


NO_DETAIL = _read_only(Detail(np.zeros((0, 3), np.float32), np.zeros(0, np.int64)))
"""Cubes are all there is."""


@dataclass(frozen=True)
class DetailedSnapshot(WorkspaceSnapshot):
    """A snapshot whose solids are its solid cubes and these points.

    Attributes:
        detail: points; ``distance`` must be a bound of the distance to them as well.
    """

    detail: Detail = NO_DETAIL


def make_detail(grid: VoxelGrid, points: Points) -> Detail:
    """Sort (k, 3) points [m] into the rows of a grid; those outside are left out."""
    points = np.asarray(points, np.float32)
    index = grid.index(points)
    inside = np.all((index >= 0) & (index < grid.shape), axis=1)
    points, index = points[inside], index[inside]
    row = index[:, 0] * grid.shape[1] + index[:, 1]
    order = np.lexsort((points[:, 2], row))
    count = grid.shape[0] * grid.shape[1]
    rows = np.searchsorted(row[order], np.arange(count + 1)).astype(np.int64)
    return _read_only(Detail(np.ascontiguousarray(points[order]), rows))
