"""The frame of all experiments: what one is, how its result is written, printed and published.

An experiment is one module of this package with a module-level ``EXPERIMENT``; it is named in
``armsight.experiments.NAMES`` and imported only when it is asked for.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from armsight.experiments.rows import Row
from armsight.machine import commit, machine
from armsight.writing import write_atomically, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Draw = Callable[[], "Figure"]


Progress = Callable[[str, float], None]
"""Told what comes now and the share of the whole that is done, 0..1; the command line draws it."""


def silent(stage: str, done: float) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True)
class Outcome:
    """What an experiment found.

    Attributes:
        rows: the figures.
        plots: name to a function that draws it, called only when the result is published.
        notes: sentences that belong beside the table: what was left out, and why.
    """

    rows: tuple[Row, ...]
    plots: dict[str, Draw] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Attributes:
        name: as the command line knows it, such as ``patrol-smoke``.
        title: one line for people.
        run: ``run(runs, seed, progress)`` does it all and returns the outcome.
        runs: how many runs are meant by default.
        about: what is done and how, in Markdown, for the published page.
    """

    name: str
    title: str
    run: Callable[[int, int, Progress], Outcome]
    runs: int = 1
    about: str = ""


@dataclass(frozen=True)
class Result:
    """An outcome with everything needed to repeat it."""

    experiment: Experiment
    outcome: Outcome
    runs: int
    seed: int
    commit: str
    machine: str

    @property
    def command(self) -> str:
        """The command line that makes this result."""
        return f"armsight experiment {self.experiment.name} --runs {self.runs} --seed {self.seed}"

    @property
    def missed(self) -> tuple[Row, ...]:
        """Rows whose ``must`` is not reached."""
        return tuple(row for row in self.outcome.rows if row.met is False)

    def to_json(self) -> dict[str, Any]:
        """The document that ``--json`` writes."""
        return {
            "name": self.experiment.name,
            "command": self.command,
            "commit": self.commit,
            "machine": self.machine,
            "seed": self.seed,
            "rows": [row.to_json() for row in self.outcome.rows],
        }


def run_experiment(
    experiment: Experiment,
    runs: int | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> Result:
    """Run an experiment and describe where and how it was run."""
    runs = experiment.runs if runs is None else runs
    outcome = experiment.run(runs, seed, progress)
    keys = [(row.key, row.condition) for row in outcome.rows]
    if len(set(keys)) != len(keys):
        raise ValueError(f"{experiment.name}: two rows share a key and condition")
    return Result(experiment, outcome, runs, seed, commit(), machine())


_WIDE = 220
"""Columns of a table that no terminal shows."""


def print_result(result: Result, console: Console | None = None) -> None:
    """The table, ours beside the paper's figures and the budget."""
    table = Table(title=result.experiment.title, caption=f"{result.machine}, {result.commit}")
    table.add_column("key", no_wrap=True)
    table.add_column("condition")
    for name in ("ours", "95 % / spread", "n", "paper", "must", "aim"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for row in result.outcome.rows:
        verdict = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[row.met]
        table.add_row(row.key, row.condition, *_cells(row), verdict)
    console = console or Console()
    # A file or a pipe has no width: rich's guess of 80 cut the figures off.
    if not console.is_terminal:
        console.width = max(console.width, _WIDE)
    console.print(table)
    for note in result.outcome.notes:
        console.print(note)


def _cells(row: Row) -> list[str]:
    spread = "" if _missing(row.low) else f"{_figure(row.low)} - {_figure(row.high)}"
    sign = {"lower": "<" if row.strict else "≤", "higher": ">" if row.strict else "≥"}[row.better]
    budgets = ["" if b is None else f"{sign} {_figure(b)}" for b in (row.must, row.aim)]
    ours = f"{_figure(row.value)} {row.unit}".strip()
    if _missing(row.value):
        ours = row.why or "no figure"
    return [ours, spread, str(row.n), _figure(row.paper), *budgets]


def _missing(value: float | None) -> bool:
    return value is None or math.isnan(value)


def _figure(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < 1e7 else f"{value:.4g}"


def write_json(result: Result, file: Path) -> None:
    """Write the result, whole or not at all.

    Raises:
        ArmsightError: the file cannot be written.
    """
    text = json.dumps(result.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(file, text)


def publish(result: Result, folder: Path) -> tuple[Path, ...]:
    """Write ``NAME.json``, ``NAME.md`` and the plots ``NAME-PLOT.png`` into a folder.

    Every file is written whole or not at all; the page comes last.

    Raises:
        ArmsightError: a file cannot be written.
    """
    name = result.experiment.name
    plots: list[Path] = []
    for plot, draw in result.outcome.plots.items():
        plots.append(folder / f"{name}-{plot}.png")
        _save(draw(), plots[-1])
    write_json(result, folder / f"{name}.json")
    page = folder / f"{name}.md"
    write_text(page, _page(result, plots))
    return (folder / f"{name}.json", *plots, page)


def _save(figure: Figure, file: Path) -> None:
    import io

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, bbox_inches="tight", metadata={"Software": None})
    write_atomically(file, buffer.getvalue())


def _page(result: Result, plots: Sequence[Path]) -> str:
    experiment = result.experiment
    lines = [f"# {experiment.title}", ""]
    if experiment.about:
        lines += [experiment.about.strip(), ""]
    lines += [
        f"Made by `{result.command} --publish` at commit {result.commit} on {result.machine}.",
        "",
        "| key | condition | ours | 95 % / spread | n | paper | must | aim | |",
        "|---|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    for row in result.outcome.rows:
        verdict = {None: "", True: "met", False: "**missed**"}[row.met]
        cells = [f"`{row.key}`", row.condition, *_cells(row), verdict]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    lines += ["", *(f"* `{row.key}`: {row.measure}" for row in _first_of_each_key(result)), ""]
    for note in result.outcome.notes:
        lines += [note, ""]
    for plot in plots:
        lines += [f"![{plot.stem}]({plot.name})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _first_of_each_key(result: Result) -> list[Row]:
    return list({row.key: row for row in reversed(result.outcome.rows)}.values())[::-1]
