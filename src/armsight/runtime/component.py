"""What runs in the loop: an object with a period and an update; it does not know which clock."""

from __future__ import annotations

from typing import Protocol


class Component(Protocol):
    """A part of the loop.

    Attributes:
        name: unique in the loop.
        period: seconds between updates [s].
    """

    name: str
    period: float

    def update(self, now: float) -> None:
        """Do one round at time ``now`` [s]. What it publishes becomes visible after its latency."""
        ...
