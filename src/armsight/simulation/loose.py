"""Things that lie somewhere: they fall, are pushed and gripped, and the page carries them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armsight.arrays import Vector3
from armsight.simulation.model import CellModel
from armsight.simulation.movers import towards
from armsight.simulation.spec import MovingObjectSpec

GRAVITY = 9.81
"""[m/s^2]"""
CARRY = 20.0
"""Natural frequency with which a carried thing follows the hand that nobody sees [rad/s]."""


class LooseThings:
    """The loose things of a world, and who of them is carried where."""

    def __init__(self, cell: CellModel, items: Sequence[MovingObjectSpec]) -> None:
        self._items = {item.solid.name: item for item in items}
        self._body = {name: cell.movers.shapes[name] for name in self._items}
        self._at = cell.movers.loose
        self.reset()

    def __contains__(self, name: str) -> bool:
        return name in self._items

    def reset(self) -> None:
        """Nobody carries anything."""
        self._target: dict[str, Vector3] = {}
        self._hand: dict[str, Vector3] = {}

    def drag(self, name: str, target: Vector3 | None) -> None:
        """Carry a thing to a point of the world [m] at its greatest speed; None puts it down."""
        self._hand.pop(name, None)
        self._target.pop(name, None)
        if target is not None:
            self._target[name] = np.asarray(target, float)

    def push(self, data: Any, seconds: float) -> None:
        """Write the forces of the hands that carry, for a step of some seconds [s]."""
        for name, body in self._body.items():
            if name not in self._target:
                data.xfrc_applied[body] = 0.0
                continue
            item = self._items[name]
            q, v = self._at[name]
            position, velocity = data.qpos[q : q + 3], data.qvel[v : v + 6]
            hand = self._hand.get(name, position.copy())
            hand = self._hand[name] = towards(hand, self._target[name], item.max_speed * seconds)
            pull = CARRY**2 * (hand - position) - 2.0 * CARRY * velocity[:3]
            data.xfrc_applied[body, :3] = item.mass * (pull + np.array([0.0, 0.0, GRAVITY]))
            data.xfrc_applied[body, 3:] = 0.0
