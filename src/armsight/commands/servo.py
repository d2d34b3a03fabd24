"""``armsight servo``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from armsight.commands.serving import Page


@dataclass(frozen=True)
class Servo:
    """Follow a target that moves, and touch it: drag it on the page, and the arm comes after it.

    Example: armsight servo ur10_servoing --task ball

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        task: what to follow: touch the `ball`, dock with the `bullseye`, bring a `straw` to a
            mouth, or an item above a `hand`.
        mode: `ours`; `paper`: the Master and the segments of V; `fixed`: those without the pair.
        standoff: how far before the surface the tip stays [m]; 0 touches.
        seconds: how long on the cell's clock; until Ctrl-C if left out.
        cell_is_empty: you have looked, and nobody is in the cell: what stands there is no person.
        headless: no page, and as fast as the machine can.
        json: write the run's figures here; `-` is standard output.
        record: record everything into this new file (.mcap).
        pictures: of a recording: `small`, less than 100 MB a minute; `whole`, bit for bit.
        seed: of everything random.
        speed: simulated seconds a second; 0 for as fast as the machine can.
        page: where the live page is served.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    task: Literal["ball", "bullseye", "straw", "hand"] = "ball"
    mode: Literal["ours", "paper", "fixed"] = "ours"
    standoff: float = 0.0
    seconds: float | None = None
    cell_is_empty: bool = False
    headless: bool = False
    json: Path | None = None
    record: Path | None = None
    pictures: Literal["small", "whole"] = "small"
    seed: int = 0
    speed: float | None = None
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Servo; prints how it went."""
        from armsight.commands.run import run_and_tell
        from armsight.tasks.servo import ServoOptions

        return run_and_tell(self, ServoOptions(self.task, self.mode, self.standoff).make)
