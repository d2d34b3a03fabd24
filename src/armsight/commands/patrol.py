"""``armsight patrol``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.motion.task import Task
    from armsight.workcell import Cell


@dataclass(frozen=True)
class Patrol:
    """Move the arm between the cell's goals, around what is there, guarding people.

    Example: armsight patrol ur5_four_cameras --seconds 120 --headless --json patrol.json

    Attributes:
        workcell: a workcell file, or the name of a packaged cell.
        seconds: how long on the cell's clock; until Ctrl-C if left out.
        cell_is_empty: you have looked, and nobody is in the cell: what stands there is no person,
            and the arm works around it.
        headless: no page, and as fast as the machine can.
        json: write the run's figures here; `-` is standard output.
        record: record everything into this new file (.mcap).
        pictures: of a recording: `small`, less than 100 MB a minute; `whole`, bit for bit.
        seed: of everything random.
        speed: simulated seconds a second; 0 for as fast as the machine can.
        page: where the live page is served.
    """

    workcell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="WORKCELL")]
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
        """Run the patrol; prints its figures at the end."""
        from armsight.commands.running import exit_code, ran, say, write_summary
        from armsight.recording.patrol_log import PatrolLog
        from armsight.tasks.patrol import PatrolOptions

        logs: list[PatrolLog] = []

        def make(cell: Cell) -> tuple[Task, list[PatrolLog]]:
            task = PatrolOptions().make(cell)
            logs.append(PatrolLog(cell, task))
            return task, logs

        with ran(self, make) as session:
            summary, lines = logs[0].summary(session), logs[0].lines(session)
        for line in lines:
            say(line)
        if self.json is not None:
            write_summary(self.json, summary)
        return exit_code(session, self.seconds)
