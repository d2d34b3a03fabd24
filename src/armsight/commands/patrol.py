"""``armsight patrol``."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from armsight.commands.serving import Page


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
    seed: int = 0
    speed: float | None = None
    page: Page = field(default_factory=Page)

    def run(self) -> int:
        """Run the patrol; prints its figures at the end."""
        from armsight.commands.running import (
            RunOptions,
            exit_code,
            run_session,
            say,
            write_summary,
        )
        from armsight.errors import UsageError
        from armsight.recording.patrol_log import PatrolLog
        from armsight.tasks.patrol import PatrolTask
        from armsight.workcell import open_cell
        from armsight.workcell.packaged import load

        workcell = load(self.workcell)
        if len(workcell.goals) < 2:
            raise UsageError(
                f"{self.workcell}: no goals to patrol; give [patrol.goals_deg] at least two"
            )
        if self.headless and self.seconds is None:
            raise UsageError("--headless needs --seconds: nobody would see when to end it")
        with open_cell(workcell, self.seed) as cell:
            task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
            log = PatrolLog(cell, task)
            wanted = RunOptions(
                seconds=self.seconds,
                page=None if self.headless else self.page,
                record=self.record,
                seed=self.seed,
                speed=speed_of(self.speed, self.headless),
                observers=(log,),
                cell_is_empty=self.cell_is_empty,
            )
            session = run_session(cell, task, wanted)
            summary, lines = log.summary(session), log.lines(session)
        for line in lines:
            say(line)
        if self.json is not None:
            write_summary(self.json, summary)
        return exit_code(session, self.seconds)


def speed_of(given: float | None, headless: bool) -> float:
    """Wanted simulated seconds a second: real time for people, as fast as possible otherwise."""
    if given is None:
        return math.inf if headless else 1.0
    return math.inf if given == 0 else given
