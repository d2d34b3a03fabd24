"""``armsight view``."""

from __future__ import annotations

from dataclasses import dataclass, replace

from armsight.commands.live import Watching


@dataclass(frozen=True)
class ViewCommand(Watching):
    """Show a cell and its map on the live page; the arm gets no command.

    Example: armsight view workcells/panda_table.toml
    """

    def run(self) -> int:
        """Run without a task."""
        from armsight.commands.running import exit_code, run_options, run_session
        from armsight.workcell import open_cell
        from armsight.workcell.packaged import load

        workcell, wanted = load(self.workcell), replace(run_options(self), look_only=True)
        with open_cell(workcell, self.seed) as cell:
            session = run_session(cell, None, wanted)
        return exit_code(session, self.seconds)
