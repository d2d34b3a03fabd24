"""Where an item comes down that is handed over: what judges a trial of ``servo-handover``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.servo_onlooker import Onlooker, Seen
from armsight.experiments.servo_presses import Presses, led_speed
from armsight.motion.permits import Permit
from armsight.robots.kinematics import tcp_jacobian

FALLS = 3.0
"""An item that is still above the palm so long after it was let go hangs on the fingers [s]."""
ITEM = 0.05
"""Height of the item, held by its middle [m]."""
OPENED = 0.05
"""Told to open until it is open: the gripper's delay and the fingers' first millimetre [s]."""


class Landing:
    """Where an item comes down that the gripper holds, and how hard a hand is pressed.

    Attributes:
        way: rows of time [s], tip beside and above the palm [m], force [N] so far.
    """

    def __init__(self, task: Any) -> None:
        self._task, self._up = task, task.config.vertical
        self._off, self._let_go, self._begins = math.nan, math.inf, 0.0
        self._presses, self.over = Presses(), False
        self.way: list[list[float]] = []

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """See :class:`~.servo_onlooker.Judge`."""
        now, up = seen.now, self._up
        self._presses.look(seen, permit, led_speed(seen.path, now))
        if math.isinf(self._let_go) and now > self._task.released + OPENED:
            self._let_go, self._off = now, _lands(seen, up)
        if len(self.way) * 0.04 <= now:
            apart = seen.tip() - seen.place(now)
            high = float(apart @ up)
            beside = float(np.linalg.norm(apart - high * up))
            row = (now, beside, high, float(self._presses.force))
            self.way.append([round(v, 4) for v in row])
        self._begins, self.over = seen.begins, bool(self._task.phase == "done")

    def found(self) -> dict[str, Any]:
        """What came of it, as JSON values."""
        return {
            "mm": 1e3 * self._off if math.isfinite(self._off) else None,
            "seconds": self._let_go - self._begins if math.isfinite(self._let_go) else None,
            "force": float(self._presses.force),
            "struck": float(self._presses.struck),
            "harm": self._presses.harm,
            "iterations": int(self._task.chase.iterations),
            "phase": self._task.phase,
        }


def _lands(seen: Seen, up: Vector3) -> float:
    """How far beside the palm's middle an item that is let go now comes down [m]."""
    tip = seen.tip()
    velocity = (tcp_jacobian(seen.robot, seen.q) @ seen.v)[:3]
    place = seen.place(seen.now)
    height = float((tip - place) @ up) - 0.5 * ITEM
    if height < -0.01:
        return math.inf  # it was pushed into the palm
    falls = math.sqrt(2.0 * max(height, 0.0) / 9.81)
    palm = place + seen.path(seen.now + falls) - seen.path(seen.now)
    away = tip + falls * velocity - palm
    return float(np.linalg.norm(away - up * (away @ up)))


class Delivery(Landing):
    """Where the item itself comes down that was fetched: nothing lies on a simulated hand."""

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """See :class:`~.servo_onlooker.Judge`."""
        super().look(seen, permit)
        if math.isinf(self._let_go):
            return
        assert isinstance(seen, Onlooker)
        away = seen.item("item") - seen.place(seen.now)
        high = float(away @ self._up)
        landed = high < 0.5 * ITEM  # else it falls, or hangs on the fingers
        self.over = landed or seen.now > self._let_go + FALLS
        self._off = float(np.linalg.norm(away - high * self._up)) if landed else math.nan
