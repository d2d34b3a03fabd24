"""The vehicle's side of a visit: what a car says, what it is told, and one that is simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

Word = Literal["plugged", "stop", "unplugged"]
"""What the station tells the car: the plug is seated; charging shall end; the plug is out."""


@dataclass(frozen=True)
class VehicleStatus:
    """What a car says of itself.

    Attributes:
        parked: it stands, and will not move.
        port: type of its inlet, if it says; else empty.
        locked: it holds the plug.
        charging: current flows.
        enough: it wants no more.
        problem: what is wrong with it, in words; empty when nothing is.
    """

    parked: bool
    port: str = ""
    locked: bool = False
    charging: bool = False
    enough: bool = False
    problem: str = ""


class Vehicle(Protocol):
    """A car that talks: over the plug's own contacts, by radio, or not at all."""

    def status(self, now: float) -> VehicleStatus | None:
        """The newest that it has said at ``now`` [s]; None where it is silent."""
        ...

    def tell(self, word: Word, now: float) -> None:
        """Tell it something."""
        ...


class SimulatedCar:
    """A car that is parked, says what it has, locks, charges for a while and unlocks.

    Args:
        port: type of its inlet that it says; empty for one that does not say.
        seconds: for which it charges [s].
        unlock: time from the word to an open lock [s].
        stands: whether it stands where it was parked.
    """

    def __init__(
        self,
        port: str = "",
        seconds: float = 5.0,
        unlock: float = 0.5,
        stands: Callable[[], bool] = lambda: True,
    ) -> None:
        self.port, self.seconds, self.unlock, self._stands = port, seconds, unlock, stands
        self.parked = True
        self.problem = ""
        self._since: float | None = None
        self._stop: float | None = None

    def status(self, now: float) -> VehicleStatus:
        """See :class:`Vehicle`."""
        parked = self.parked and self._stands()
        if self._since is None:
            return VehicleStatus(parked, self.port, problem=self.problem)
        enough = now - self._since >= self.seconds
        locked = self._stop is None or now - self._stop < self.unlock
        return VehicleStatus(
            parked, self.port, locked, self._stop is None and not enough, enough, self.problem
        )

    def tell(self, word: Word, now: float) -> None:
        """See :class:`Vehicle`."""
        if word == "plugged":
            self._since, self._stop = now, None
        elif word == "stop" and self._stop is None:
            self._stop = now
        elif word == "unplugged":
            self._since = self._stop = None
