"""Which voxels the page shows, and in what colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats32
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.viewer.colors import DANGER, by_value

FADE = 24.48
"""Seconds after which T2's danger of a left voxel is gone; the page shows no older ones [s]."""


def voxels(
    snapshot: WorkspaceSnapshot, now: float, most: int
) -> tuple[Floats32, Bytes, NDArray[np.float32]]:
    """Voxels that something moving occupies, or did a while ago: the newest first.

    Returns:
        (n, 3) centres in base [m], (n, 3) colours, (n,) ages [s].
    """
    last = snapshot.last_occupied.reshape(-1)
    where = np.flatnonzero(last > np.float32(now - FADE))
    if len(where) > most:
        newest = np.argpartition(last[where], -most)[-most:]
        where = where[np.sort(newest)]
    age = np.maximum(np.float32(now) - last[where], 0.0).astype(np.float32)
    index = np.stack(np.unravel_index(where, snapshot.grid.shape), axis=1)
    centers = snapshot.grid.center(index).astype(np.float32)
    return centers, by_value(DANGER, -age, -FADE, 0.0), age
