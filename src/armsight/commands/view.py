"""``armsight view``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from armsight.commands.serving import Page


@dataclass(frozen=True)
class ViewCommand:
    """Show a cell and its map on the live page; the arm gets no command.

    Example: armsight view workcells/panda_table.toml

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        seconds: how long on the cell's clock; until Ctrl-C if left out.
        headless: no page, and as fast as the machine can.
        record: record everything into this new file (.mcap).
        pictures: of a recording: `small`, less than 100 MB a minute; `whole`, bit for bit.
        seed: of everything random.
        speed: simulated seconds a second; 0 for as fast as the machine can.
        page: where the live page is served.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    seconds: float | None = None
    headless: bool = False
    record: Path | None = None
    pictures: Literal["small", "whole"] = "small"
    seed: int = 0
    speed: float | None = None
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Run without a task."""
        from armsight.commands.running import RunOptions, exit_code, run_session, speed_of
        from armsight.errors import UsageError
        from armsight.workcell import open_cell
        from armsight.workcell.packaged import load

        workcell = load(self.workcell)
        if self.headless and self.seconds is None:
            raise UsageError("--headless needs --seconds: nobody would see when to end it")
        with open_cell(workcell, self.seed) as cell:
            wanted = RunOptions(
                seconds=self.seconds,
                page=None if self.headless else self.page,
                record=self.record,
                pictures=self.pictures,
                seed=self.seed,
                speed=speed_of(self.speed, self.headless),
                look_only=True,
            )
            session = run_session(cell, None, wanted)
        return exit_code(session, self.seconds)
