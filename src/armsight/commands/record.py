"""``armsight record``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from armsight.commands.serving import Page


@dataclass(frozen=True)
class Record:
    """Record a cell as MCAP with ROS 2 types, for replay, Foxglove or `ros2 bag`.

    Example: armsight record ur5_four_cameras monday.mcap --seconds 30 --headless

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        file: to write (.mcap); never overwrites one.
        seconds: how long on the cell's clock; until Ctrl-C if left out.
        pictures: `whole`, bit for bit, 2.5 GB a minute of four depth cameras; `small`: fewer, and
            compressed, less than 100 MB.
        watch: only look: the arm holds still instead of patrolling.
        headless: no page, and as fast as the machine can.
        seed: of everything random.
        page: where the live page is served.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    seconds: float | None = None
    pictures: Literal["small", "whole"] = "whole"
    watch: bool = False
    headless: bool = False
    seed: int = 0
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Run and record."""
        from armsight.commands.patrol import Patrol
        from armsight.commands.view import ViewCommand

        if self.watch:
            return ViewCommand(
                self.workcell,
                seconds=self.seconds,
                headless=self.headless,
                record=self.file,
                pictures=self.pictures,
                seed=self.seed,
                page=self.page,
            ).run()
        return Patrol(
            self.workcell,
            seconds=self.seconds,
            headless=self.headless,
            record=self.file,
            pictures=self.pictures,
            seed=self.seed,
            page=self.page,
        ).run()
