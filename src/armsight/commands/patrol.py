"""``armsight patrol``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from armsight.commands.live import Working

if TYPE_CHECKING:
    from armsight.motion.task import Task
    from armsight.workcell import Cell


@dataclass(frozen=True)
class Patrol(Working):
    """Move the arm between the cell's goals, around what is there, guarding people.

    Example: armsight patrol ur5_four_cameras --seconds 120 --headless --json patrol.json
    """

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
