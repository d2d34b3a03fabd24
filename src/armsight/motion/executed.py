"""The path that was really driven, thinned, for the page and for the reflex that retraces it."""

from __future__ import annotations

import numpy as np

from armsight.arrays import JointPath, JointVector

STEP = 0.03
"""Distance between two remembered places [rad]."""
LONGEST = 2000
"""Places remembered; then every other one is dropped."""


def thinned(path: JointPath, tolerance: float = 0.01) -> JointPath:
    """A (k, n) path without the places that lie on the line between their neighbours.

    Ramer-Douglas-Peucker: what is left out is nowhere farther than ``tolerance`` [rad] from it.
    """
    if len(path) < 3:
        return path
    a, b = path[0], path[-1]
    along = b - a
    square = float(along @ along)
    share = np.clip((path - a) @ along / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(path))
    off = np.linalg.norm(path - (a + share[:, None] * along), axis=1)
    far = int(np.argmax(off))
    if off[far] <= tolerance:
        return np.array([a, b])
    return np.vstack([thinned(path[: far + 1], tolerance)[:-1], thinned(path[far:], tolerance)])


class Executed:
    """Places driven through since the goal was set."""

    def __init__(self) -> None:
        self._places: list[JointVector] = []
        self._array: JointPath | None = None

    def clear(self) -> None:
        """A new goal: begin anew."""
        self._places, self._array = [], None

    def add(self, q: JointVector) -> None:
        """The arm is at (n,) [rad]."""
        if self._places and np.abs(q - self._places[-1]).max() < STEP:
            return
        self._places.append(np.array(q, float))
        if len(self._places) > LONGEST:
            self._places = self._places[::2]
        self._array = None

    @property
    def path(self) -> JointPath | None:
        """(k, n) places [rad], or None before the second."""
        if len(self._places) < 2:
            return None
        if self._array is None:
            self._array = np.array(self._places)
            self._array.flags.writeable = False
        return self._array

    def retrace(self, q: JointVector, share: float) -> JointPath:
        """(k, n) way back from (n,) [rad] over the last ``share`` of the path's length."""
        places = [np.array(q, float)]
        if len(self._places) >= 2:
            lengths = np.linalg.norm(np.diff(np.array(self._places), axis=0), axis=1)
            left = share * float(lengths.sum())
            for place in self._places[::-1]:
                step = float(np.linalg.norm(place - places[-1]))
                if step < 1e-9:
                    continue
                part = min(1.0, left / step)
                places.append(places[-1] + part * (place - places[-1]))
                left -= step
                if left <= 0.0:
                    break
        return np.array(places)
