"""``armsight check``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from armsight.workcell import Workcell


@dataclass(frozen=True)
class Check:
    """Check workcell files and say all that is wrong, one line a problem.

    Example: armsight check workcells/*.toml

    Attributes:
        files: workcell files, or names of packaged cells.
    """

    files: Annotated[
        tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE [FILE ...]")
    ]

    def run(self) -> int:
        """Check every file; 1 if any has a problem."""
        from armsight.commands.terminal import results
        from armsight.errors import ArmsightError, UsageError
        from armsight.workcell.packaged import load

        if not self.files:
            raise UsageError("name at least one file: armsight check FILE")
        out, bad = results(), 0
        for file in self.files:
            try:
                workcell = load(file)
                told = [("[yellow]hint[/]", hint) for hint in hints(workcell)]
                for tag, words in [("[green]good[/]", described(workcell)), *told]:
                    out.print(tag, end=" ")
                    out.print(f"{file}: {words}", markup=False, soft_wrap=True)
            except ArmsightError as error:
                bad += 1
                out.print(str(error), markup=False, soft_wrap=True)
        return 1 if bad else 0


def hints(workcell: Workcell) -> list[str]:
    """What is not wrong, and better otherwise, in words."""
    from armsight.runtime.configure import mapped_box
    from armsight.workcell.beliefs import robot_in
    from armsight.workcell.walls import past_walls

    box = mapped_box(workcell, workcell.robot.T_world_base, robot_in(workcell).reach)
    return past_walls(workcell, *box)


def described(workcell: Workcell) -> str:
    """A cell in a line."""
    counts = (
        (len(workcell.camera), "camera"),
        (len(workcell.solid), "solid"),
        (len(workcell.patrol.goals_deg), "goal"),
        (len(workcell.simulation.person), "simulated person"),
    )
    parts = [f"{n} {word}{'s' if n != 1 else ''}" for n, word in counts if n]
    file = workcell.calibration_file
    if workcell.cell.calibration and file is not None and not file.is_file():
        parts.append(f"not calibrated yet: {file} is not there")
    return ", ".join([f"{workcell.name}, {workcell.robot.model}", *parts]).replace(
        "persons", "people"
    )
