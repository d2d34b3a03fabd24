"""``armsight experiment``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class ExperimentCommand:
    """Run an experiment and print its table beside the paper's figures.

    Example: armsight experiment patrol-smoke --seed 3 --json result.json

    Attributes:
        name: which one; lists all if left out.
        runs: how many runs; the experiment's own default if left out.
        seed: of everything random.
        json: write the figures here; `-` is standard output.
        publish: write NAME.json, NAME.md and the plots into `folder`.
        folder: where to publish.
        strict: exit with 1 when a figure misses its `must`.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = ""
    runs: int | None = None
    seed: int = 0
    json: Path | None = None
    publish: bool = False
    folder: Path = Path("docs/results")
    strict: bool = False

    def run(self) -> int:
        """Run it; 1 only on an error, or with ``--strict`` on a missed budget."""
        from rich.console import Console

        from armsight.commands.running import progress_bar, say, write_summary
        from armsight.commands.terminal import results
        from armsight.errors import UsageError
        from armsight.experiments import NAMES, load_experiment

        if not self.name:
            for name, title in NAMES.items():
                # One line each, for grep as well.
                results().print(f"{name:24} {title}", markup=False, soft_wrap=True)
            return 0
        from armsight.experiments.frame import print_result, publish, run_experiment

        if self.runs is not None and self.runs < 1:
            raise UsageError(f"--runs is {self.runs}, expected at least 1")
        experiment = load_experiment(self.name)
        with progress_bar() as progress:
            result = run_experiment(experiment, self.runs, self.seed, progress)
        print_result(result, Console(stderr=str(self.json) == "-"))
        if self.json is not None:
            write_summary(self.json, result.to_json())
        if self.publish:
            for file in publish(result, self.folder):
                say(f"wrote {file}")
        return 1 if self.strict and result.missed else 0
