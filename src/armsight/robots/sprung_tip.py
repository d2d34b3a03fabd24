"""A holder in which a tool's tip floats on springs, as touch probes do: pushed, it gives way.

A seat holds the tip at its place up to a small force, so that it hangs nowhere else by its weight;
what pushes harder, from any side, moves it against a spring, until it meets a stop. In series with
what holds a thing that is pressed by ``p``::

    F = k p                                   up to the seat's force F_0
    F = (p + F_0 / c) / (1 / c + 1 / k)       while the spring of c gives way
    F = k (p - L)                             from its travel L on: the stop is stiff

k is the thing's own stiffness with that of what holds it. Friction in the holder is left out, and a
holder that is jammed is none: ``docs/guard.md`` says what then happens.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SprungTip:
    """Spring, stop and seat of a tip, the same whatever side it is pushed from.

    Attributes:
        stiffness: c, of the spring [N/m].
        travel: L, by which it gives way at most [m].
        seat: F_0, with which it is held at its place [N].
        length: so much of the tool, from its tip, floats [m].
    """

    stiffness: float
    travel: float
    seat: float
    length: float = 0.1

    def moved(self, force: float) -> float:
        """How far the tip is from its place when a force [N] pushes it [m]."""
        return min(max(force - self.seat, 0.0) / self.stiffness, self.travel)


def pressing_force(press: float, hold: float, tip: SprungTip | None = None) -> float:
    """Force [N] between a tip and what its own place is pressed into by so much [m].

    Args:
        press: overlap of the thing, where it would be alone, with the tip in its seat [m].
        hold: stiffness of the thing and of what holds it [N/m].
        tip: how the tip gives way; None for one that does not.
    """
    press = max(press, 0.0)
    stiff = hold * press
    if tip is None:
        return stiff
    series = (press + tip.seat / tip.stiffness) / (1.0 / tip.stiffness + 1.0 / hold)
    return max(min(stiff, series), hold * (press - tip.travel))


def press_depth(force: float, hold: float, tip: SprungTip | None = None) -> float:
    """How deep a tip presses a thing [m] when there is so much force [N] between the two.

    The inverse of :func:`pressing_force`.
    """
    force = max(force, 0.0)
    return force / hold + (0.0 if tip is None else tip.moved(force))
