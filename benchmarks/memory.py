"""Whether a session that runs for long takes ever more memory, and of what.

The packaged patrol with its person, without a page; two of its cameras at 5 Hz, since what grows by
the picture grows all the same and time is short. Resident memory is looked at every ten seconds,
after a round of the garbage collector. What fills up once and then stays (commands on their way,
measured reaction times, the first compilations) has done so after 100 s; only the simulation's own
truth, which no real cell has, keeps 400 s, and is told to keep 10 here. The growth is counted from
there, as the slope of a line, and told by the hour. Beside it what Python's collector knows of:
objects that are more than they were then, by type.

``--quick`` counts from 50 s to 110, and says hardly more than which objects grow.
"""

from __future__ import annotations

import gc
from collections import Counter
from pathlib import Path

import numpy as np

from armsight.runtime.session import Session
from armsight.simulation import truth
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged
from common import Report

CELL = "ur5_four_cameras"
CAMERAS, RATE = 2, 5.0
SECONDS, WARM, PERIOD = 700.0, 100.0, 10.0
QUICK_SECONDS, QUICK_WARM = 110.0, 50.0
PAGE_MB = 4096 / 1e6
"""A page of memory, as ``/proc`` counts them [MB]."""


def resident_mb() -> float:
    """What this process has in memory now [MB]; Linux only."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB


class Scales:
    """Weighs the process; an observer of the session.

    Attributes:
        times: of the looks [s]; sizes: of the process then [MB].
        first: objects by type at the first look after ``warm`` [s]; last: at the newest.
    """

    name = "scales"
    period = PERIOD

    def __init__(self, warm: float) -> None:
        self.times: list[float] = []
        self.sizes: list[float] = []
        self.first: Counter[str] | None = None
        self.last: Counter[str] = Counter()
        self._warm = warm

    def update(self, now: float) -> None:
        """Called by the session."""
        gc.collect()
        self.times.append(now)
        self.sizes.append(resident_mb())
        self.last = Counter(type(thing).__name__ for thing in gc.get_objects())
        if self.first is None and now >= self._warm:
            self.first = self.last.copy()


def main() -> None:
    """Run, weigh, report."""
    report = Report("memory", __doc__)
    seconds, warm = (QUICK_SECONDS, QUICK_WARM) if report.quick else (SECONDS, WARM)
    workcell = load_workcell(packaged()[CELL])
    slow = {"rate_hz": RATE, "phase_ms": 0.0}
    cameras = tuple(c.model_copy(update=slow) for c in workcell.camera[:CAMERAS])
    workcell = workcell.model_copy(update={"camera": cameras})
    scales = Scales(warm)
    truth.KEPT = 500
    with open_cell(workcell, seed=1) as cell:
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        Session(cell, task, seed=1, observers=(scales,)).run(seconds)
    times, sizes = np.array(scales.times), np.array(scales.sizes)
    late = times >= warm
    slope = np.polyfit(times[late], sizes[late], 1)[0]
    assert scales.first is not None
    more = scales.last - scales.first
    passed = float(times[-1] - times[late][0])
    named = ", ".join(f"{name} {count}" for name, count in more.most_common(4))
    report.add("resident", sizes[-1], "MB", note=f"after {times[-1]:.0f} s")
    report.add("growth", 3600.0 * slope, "MB/h", must="<= 5", note=f"from {warm:.0f} s on")
    report.add("objects", sum(more.values()) / passed, "1/s", note=named)
    report.finish()


if __name__ == "__main__":
    main()
