"""The page's table of what the cell believes of its cameras, and how wrong that truly is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.world import World
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.viewer.html import BAD, GOOD, OFF, table, table_row

NEVER = "never calibrated"


class TrueErrors:
    """Asks a simulation how wrong the cell is about its cameras; again only after a change.

    Args:
        world: behind the cell, or None; one that does not know says None.
        cameras: of the cell.
    """

    def __init__(self, world: World | None, cameras: Sequence[RgbdCameraInfo]) -> None:
        self._world = world
        self._cameras = tuple(cameras)
        self._told: dict[str, tuple[bytes, float | None]] = {}

    def now(self, snapshot: WorkspaceSnapshot | None) -> dict[str, float]:
        """True error of points 1.0-1.5 m from each camera, with the map's corrections [m]."""
        if self._world is None:
            return {}
        corrections = () if snapshot is None else snapshot.corrections
        corrected = {c.name: (c.T_believed_corrected, c.gain) for c in corrections}
        out = {}
        for info in self._cameras:
            T, gain = corrected.get(info.name, (np.eye(4), 1.0))
            error = self._error(info.name, T, gain)
            if error is not None:
                out[info.name] = error
        return out

    def _error(self, name: str, T: Pose, gain: float) -> float | None:
        assert self._world is not None
        key = T.tobytes() + np.float64(gain).tobytes()
        if name not in self._told or self._told[name][0] != key:
            self._told[name] = (key, self._world.camera_error(name, T, gain))
        return self._told[name][1]


def accuracy(cameras: Sequence[RgbdCameraInfo], truth: Mapping[str, float]) -> str:
    """A line a camera: standard deviation of its pose by its calibration, and the truth.

    Args:
        cameras: as they are believed.
        truth: what a simulation knows of them by name [m]; empty where nobody does.
    """
    rows = []
    for info in cameras:
        values = ["–", "–"]
        if info.covariance is not None:
            sigma = np.sqrt(np.maximum(np.diagonal(info.covariance), 0.0))
            values = [
                f"{1e3 * sigma[:3].max():.2f} mm",
                f"{np.rad2deg(sigma[3:].max()):.3f}°",
            ]
        if truth:
            error = truth.get(info.name)
            values.append("–" if error is None else f"{1e3 * error:.1f} mm")
        never = "" if info.calibrated else NEVER
        color = GOOD if info.calibrated else BAD if truth else OFF
        rows.append(table_row(color, info.name, values, never))
    if not rows:
        return ""
    heads = ["calibration", "σ place", "σ turn"]
    return table([*heads, "simulation: true"] if truth else heads, rows)
