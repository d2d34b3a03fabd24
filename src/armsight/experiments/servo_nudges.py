"""What a tip does to a ball on a stand: whether it may touch it, and how hard it presses."""

from __future__ import annotations

from dataclasses import dataclass

MOVING = 0.05
"""A tip pushes that comes into the ball faster than this [m/s]."""
HARM = (
    "ticks in which the tip pushed into a ball that it did not touch by a permit, or the ball "
    "pushed it back with more than the permit's force"
)
"""Where a permit ends in contact the force counts until the tip is out: no arm stands at once."""


@dataclass
class Nudges:
    """Of one trial.

    Attributes:
        harm: see :data:`HARM`.
        after: ticks in which the tip still pushed into the ball when a permit had ended in contact.
        force: greatest of the ball on the tip [N].
    """

    harm: int = 0
    after: int = 0
    force: float = 0.0
    _by_permit: bool = False

    def look(self, pushes: float, force: float, held: bool, most: float) -> None:
        """At the end of a tick.

        Args:
            pushes: how fast the tip comes into the ball, by its own motion [m/s].
            force: of the ball on the tip [N]; none where they do not touch.
            held: a permit holds.
            most: force that one allows [N].
        """
        self._by_permit = force > 0.0 and (held or self._by_permit)
        self.force = max(self.force, force)
        pushed = force > 0.0 and not held and pushes > MOVING
        self.after += pushed and self._by_permit
        self.harm += (pushed and not self._by_permit) or force > most
