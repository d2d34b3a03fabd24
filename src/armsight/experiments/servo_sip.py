"""Where a straw first touches a face, and how hard that is pressed: what judges ``servo-straw``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.servo_onlooker import Seen
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.motion.permits import Permit

FACE = "face"
HOLDS = 3.0
"""The force is watched this long after the first touch [s]: what presses slowly, too."""


class Sip:
    """Watches a trial until some time after the first touch.

    Args:
        normal: (3,) out of the face, in ``base``.
        guarded: what a permit grants counts, and not only what a face stands.
    """

    def __init__(self, normal: Vector3, guarded: bool = True) -> None:
        self._normal, self._guarded = normal, guarded
        self._touched, self._off, self._granted, self._begins = math.inf, math.nan, 0.0, 0.0
        self._states: set[str] = set()
        self._force, self._elsewhere = 0.0, False
        self.over = False

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """See :class:`~.servo_onlooker.Judge`."""
        if permit is not None:
            self._states.add(permit.state.value)
            self._granted = max(self._granted, permit.force)
        if seen.contacts and not math.isfinite(self._touched):
            self._touched, self._begins = seen.now, seen.begins
            away = seen.tip() - seen.place(seen.now)
            self._off = float(np.linalg.norm(away - self._normal * (away @ self._normal)))
        forces = [c.force for c in seen.contacts if np.isfinite(c.force)]
        self._force = max(forces, default=0.0)
        self._elsewhere = any(c.owner != FACE for c in seen.contacts)
        self.over = seen.now > self._touched + HOLDS

    def found(self) -> dict[str, Any]:
        """What came of it, as JSON values."""
        touched, most = math.isfinite(self._touched), region_force()
        if self._guarded:
            most = min(most, max(self._granted, 1e-9))
        return {
            "touched": touched,
            "mm": 1e3 * self._off if math.isfinite(self._off) else None,
            "seconds": self._touched - self._begins if touched else None,
            "force": float(self._force),
            "granted": self._granted,
            "harm": bool(self._force > most or self._elsewhere),
            "permits": sorted(self._states),
        }


def region_force() -> float:
    """What a face stands when it is struck [N]."""
    region = BODY_REGIONS["face"]
    return region.force * region.transient
