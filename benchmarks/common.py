"""What every benchmark uses: warm-up, median and spread, the machine named, budgets beside them.

A benchmark is a plain script. It measures with :func:`measure`, adds one :class:`Figure` a line to
a :class:`Report`, and ends with ``report.finish()``::

    from common import Report, measure

    report = Report("rendering", __doc__)
    timing = measure(lambda: camera.render(), rounds=200, warmup=20)
    report.add("depth_512x424", timing.median * 1e3, "ms", spread=timing.spread_ms, must="<= 15")
    report.finish()

``--json FILE`` writes the figures as JSON, ``--quick`` asks for fewer rounds. Budgets are printed
and judged, never asserted by tests: a busy machine is not a bug.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from armsight.machine import commit, machine


@dataclass(frozen=True)
class Timing:
    """Durations of the rounds of one measurement [s]; the CPU time is that of this process.

    Attributes:
        seconds: (n,) wall time of each round.
        cpu: CPU seconds (user and system, all threads) of all rounds together.
    """

    seconds: np.ndarray
    cpu: float

    @property
    def median(self) -> float:
        """Median wall time of a round [s]."""
        return float(np.median(self.seconds))

    @property
    def p99(self) -> float:
        """99th percentile of the wall time [s]."""
        return float(np.percentile(self.seconds, 99))

    @property
    def cpu_per_round(self) -> float:
        """Mean CPU time of a round [s]: less disturbed by busy neighbours than wall time."""
        return self.cpu / max(1, len(self.seconds))

    @property
    def spread_ms(self) -> tuple[float, float]:
        """10th and 90th percentile of the wall time [ms]."""
        low, high = np.percentile(self.seconds, [10, 90]) * 1e3
        return float(low), float(high)


def measure(
    work: Callable[[], object],
    *,
    rounds: int = 100,
    warmup: int = 5,
    setup: Callable[[], object] | None = None,
) -> Timing:
    """Time ``rounds`` calls of ``work`` after ``warmup`` unmeasured ones (compilation, caches).

    Args:
        work: what is measured.
        rounds: measured calls.
        warmup: calls before them.
        setup: called, unmeasured, before every call.
    """
    prepare = setup or (lambda: None)
    for _ in range(warmup):
        prepare()
        work()
    seconds = np.empty(rounds)
    cpu = 0.0
    collecting = gc.isenabled()
    gc.disable()
    try:
        for i in range(rounds):
            prepare()
            cpu_start, start = time.process_time(), time.perf_counter()
            work()
            seconds[i] = time.perf_counter() - start
            cpu += time.process_time() - cpu_start
    finally:
        if collecting:
            gc.enable()
    return Timing(seconds, cpu)


def peak_memory_mb() -> float:
    """Greatest resident size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


@dataclass(frozen=True)
class Figure:
    """One measured line.

    Attributes:
        key: unique in the benchmark; value, unit: what was measured.
        low, high: spread, 10th and 90th percentile in the same unit, or None.
        must, aim: budgets such as ``"<= 15"`` or ``">= 1"``, or empty.
        note: peers, conditions.
    """

    key: str
    value: float
    unit: str
    low: float | None = None
    high: float | None = None
    must: str = ""
    aim: str = ""
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether ``must`` is reached; None where there is none."""
        return _judge(self.value, self.must)


def _judge(value: float, budget: str) -> bool | None:
    if not budget:
        return None
    relation, number = budget.split()
    bound = float(number)
    return {"<=": value <= bound, ">=": value >= bound, "<": value < bound, ">": value > bound}[
        relation
    ]


@dataclass
class Report:
    """Collects figures, prints them with the machine, writes JSON.

    Attributes:
        name: of the benchmark; about: its docstring, printed by ``--help``.
        quick: ``--quick`` was given: use few rounds.
    """

    name: str
    about: str | None = None
    figures: list[Figure] = field(default_factory=list)
    quick: bool = False
    _json: Path | None = None

    def __post_init__(self) -> None:
        parser = argparse.ArgumentParser(prog=f"benchmarks/{self.name}.py", description=self.about)
        parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
        parser.add_argument("--quick", action="store_true", help="few rounds, coarse figures")
        given, _ = parser.parse_known_args()
        self._json, self.quick = given.json, given.quick

    def rounds(self, wanted: int) -> int:
        """``wanted``, or a tenth of it (at least 3) with ``--quick``."""
        return max(3, wanted // 10) if self.quick else wanted

    def add(
        self,
        key: str,
        value: float,
        unit: str,
        *,
        spread: tuple[float, float] | None = None,
        must: str = "",
        aim: str = "",
        note: str = "",
    ) -> Figure:
        """Add a figure; ``spread`` is its 10th and 90th percentile in the same unit."""
        low, high = spread if spread is not None else (None, None)
        figure = Figure(key, float(value), unit, low, high, must, aim, note)
        self.figures.append(figure)
        return figure

    def finish(self) -> None:
        """Print the table, and write ``--json`` at once (never half a file)."""
        where = machine()
        load = os.getloadavg()[0]
        table = Table(title=f"{self.name}: {where}, load {load:.1f}, commit {commit()}")
        for column in ("key", "value", "spread", "must", "aim", "", "note"):
            table.add_column(column, no_wrap=column == "key")
        for f in self.figures:
            spread = "" if f.low is None or f.high is None else f"{f.low:.3g} - {f.high:.3g}"
            verdict = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[f.met]
            table.add_row(f.key, f"{f.value:.4g} {f.unit}", spread, f.must, f.aim, verdict, f.note)
        Console().print(table)
        if self._json is None:
            return
        document = {
            "name": self.name,
            "machine": where,
            "load": load,
            "commit": commit(),
            "figures": [{**asdict(f), "met": f.met} for f in self.figures],
        }
        partial = self._json.with_suffix(self._json.suffix + ".partial")
        partial.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
        partial.replace(self._json)
