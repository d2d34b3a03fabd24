"""How the learning rate falls, and when a stage has learned what it can."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

Fall = Literal["linear", "geometric"]
FALLS: tuple[str, ...] = get_args(Fall)


def ramp(ends: tuple[float, float], done: float, fall: Fall = "linear") -> float:
    """Value between two ends when a share ``done`` (0..1) of the updates is over.

    The papers say "gradually decreasing" only; linear is our reading.
    """
    first, last = ends
    done = min(max(done, 0.0), 1.0)
    if fall == "geometric":
        return float(first * (last / first) ** done)
    return first + (last - first) * done


@dataclass(frozen=True)
class SaturationRule:
    """When a stage ends before its last update (T7: "until no more improvement in the loss").

    Attributes:
        window: updates whose losses are averaged; 0 never ends a stage early.
        patience: windows without improvement that end it.
        gain: share by which a window's mean has to be below the best one to be an improvement.
    """

    window: int = 0
    patience: int = 3
    gain: float = 0.01


class Saturation:
    """Watches the training loss of one stage.

    Everything it knows fits into :meth:`state`, so that a resumed run decides as the whole run.
    """

    def __init__(self, rule: SaturationRule, state: Sequence[float] = ()) -> None:
        self._rule = rule
        self._best, self._idle = math.inf, 0
        self._window: deque[float] = deque()
        if state:
            self._best, self._idle = float(state[0]), int(state[1])
            self._window.extend(state[2:])

    def saturated(self, loss: float) -> bool:
        """Take the loss of one more update; whether the stage has saturated."""
        rule = self._rule
        if rule.window <= 0:
            return False
        self._window.append(loss)
        if len(self._window) < rule.window:
            return False
        mean = sum(self._window) / len(self._window)
        self._window.clear()
        if mean < self._best * (1.0 - rule.gain):
            self._best, self._idle = mean, 0
        else:
            self._idle += 1
        return self._idle >= rule.patience

    def state(self) -> list[float]:
        """Everything that is remembered."""
        return [self._best, float(self._idle), *self._window]
