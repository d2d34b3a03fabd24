"""``armsight view``."""

from __future__ import annotations

from dataclasses import dataclass

from armsight.commands.live import Watching


@dataclass(frozen=True)
class ViewCommand(Watching):
    """Show a cell and its map on the live page; the arm gets no command.

    Example: armsight view workcells/panda_table.toml
    """

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
