"""The search for a socket by feel: an Archimedean spiral that rests where the plug is caught.

A plug that has sunk a little stands with one side on the socket's chamfer. Dragged on it would be
torn out sideways (measured: 73 N, at a third of what is allowed to push); left alone and pressed,
it slides down the chamfer by itself. So the spiral's point waits, and pulls no more, while the
plug is caught.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats


@dataclass(frozen=True)
class SpiralOptions:
    """Of the path and of what pulls the plug along it.

    Attributes:
        pitch: between turns [m]; speed: along it [m/s]; rate: greatest, behind the delay [rad/s].
        radius: at which it ends [m].
        stiffness: of the pull [N/m]; pull: greatest [N].
        caught: a plug that has sunk by this is caught [m]; rest: it may be for so long [s].
    """

    pitch: float = 0.002
    speed: float = 0.016
    rate: float = 4.0
    radius: float = 0.0105
    stiffness: float = 3000.0
    pull: float = 15.0
    caught: float = 0.0012
    rest: float = 1.0


class Spiral:
    """A point that winds outwards about a centre.

    Args:
        options: of it.
        center: (2,) where it begins [m].
    """

    def __init__(self, options: SpiralOptions, center: Floats) -> None:
        self._options, self._center = options, np.asarray(center, float).copy()
        self._angle = self._rested = 0.0
        self._resting = False

    @property
    def ended(self) -> bool:
        """All of it was searched."""
        return self._radius > self._options.radius

    @property
    def _radius(self) -> float:
        return self._options.pitch * self._angle / (2 * np.pi)

    def advance(self, sunk: float, dt: float) -> None:
        """A tick later the plug has ``sunk`` below the face [m]: wind on, or rest."""
        o = self._options
        if sunk < 0.5 * o.caught:
            self._rested = 0.0
        self._resting = sunk > o.caught and self._rested < o.rest
        if self._resting:
            self._rested += dt
        else:
            self._angle += min(o.speed / max(self._radius, 1e-6), o.rate) * dt

    def pull(self, at: Floats) -> Floats:
        """(2,) force on a plug at ``at`` [m] towards the point."""
        o = self._options
        if self._resting:
            return np.zeros(2)
        away = self._center + self._radius * np.array([np.cos(self._angle), np.sin(self._angle)])
        force = o.stiffness * (away - at)
        size = float(np.linalg.norm(force))
        return np.asarray(force * min(1.0, o.pull / max(size, 1e-9)))

    def velocity(self) -> Floats:
        """(2,) of the point [m/s]."""
        o = self._options
        if self._resting:
            return np.zeros(2)
        speed = min(o.speed, o.rate * self._radius)
        return np.asarray(speed * np.array([-np.sin(self._angle), np.cos(self._angle)]))
