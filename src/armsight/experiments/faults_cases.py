"""What else than the pictures may go wrong in a running cell, and what must be said of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Place = Literal["camera", "cameras", "arm", "computer", "loop", "map", "disk"]
"""Where it goes wrong: at one camera, at all, at the arm, at the computer's time, in the whole
loop, in the map, at the disk of the recording."""


@dataclass(frozen=True)
class Case:
    """A fault that begins while the arm moves.

    Attributes:
        name: of the case.
        place: where it goes wrong.
        what: in words.
        named: one of these words must be said, by the guard or of a component or a camera.
        stops: the arm has to come to rest.
    """

    name: str
    place: Place
    what: str
    named: tuple[str, ...]
    stops: bool = True


AGE, JUMPED = "ms old", "the clock jumped"
MAP = ("the map failed",)
SILENT = ("the map has been silent",)
ARM = ("does not follow", "jumped by")
CASES = (
    Case("camera_ahead", "camera", "one camera's clock jumps ahead", ("future",)),
    Case("camera_back", "camera", "one camera's clock jumps back", (AGE, "older", "order")),
    Case("cameras_ahead", "cameras", "all cameras' clocks jump ahead", ("future",)),
    Case("cameras_back", "cameras", "all cameras' clocks jump back", (AGE, "older", "order")),
    Case("arm_ahead", "arm", "the arm's clock jumps ahead", ("in the future",)),
    Case("arm_back", "arm", "the arm's clock jumps back", ("joint state is",)),
    Case("clock_ahead", "computer", "the computer's clock jumps ahead", (JUMPED, "late")),
    Case("clock_back", "computer", "the computer's clock jumps back", (JUMPED,)),
    Case("late", "loop", "nothing of the program runs for 0.3 s", ("late",)),
    Case("map_raises", "map", "the map raises at every picture", MAP),
    Case("map_hangs", "map", "the map does not return", SILENT),
    Case("map_eats", "map", "the map takes memory until there is no more", MAP),
    Case("still", "arm", "joint readings stand still", ARM),
    Case("off", "arm", "one joint's readings are off by 2 deg at once", ARM),
    Case("drifts", "arm", "one joint's readings drift off by 2 deg in a second", ARM),
    Case("deaf", "arm", "commands are accepted and lost, a stop as well", ARM),
    Case("stuck", "arm", "the fastest joint brakes and stays, the others follow", ARM),
    Case("disk", "disk", "the disk of the recording is full", ("the disk is full",), stops=False),
)
"""All, in the order of the table."""
