"""The whole chain: simulated seconds a second, the same seed twice, start-up times.

Four simulated Kinect v2 at 15 Hz, map, planner and guard on, the packaged UR5 cell, on however many
cores there are. The page's own load is in ``page.py``.
"""

from __future__ import annotations

import hashlib
import os
import resource
import subprocess
import sys
import time

import numpy as np

from armsight.recording.patrol_log import PatrolLog
from armsight.runtime.session import Session
from armsight.tasks.patrol import PatrolTask
from armsight.workcell import load_workcell, open_cell
from armsight.workcell.packaged import packaged
from common import Report, peak_memory_mb

CELL = "ur5_four_cameras"


class Digest:
    """An observer that hashes everything that a session publishes, bit for bit."""

    name = "digest"
    period = 0.02

    def __init__(self) -> None:
        self.hash = hashlib.sha256()
        self._session: Session | None = None
        self._sequence = -1

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """Take in joints, command and the newest map."""
        assert self._session is not None
        view = self._session.view()
        if view.joints is not None:
            self.hash.update(view.joints.position.tobytes())
        if view.guard is not None:
            self.hash.update(view.guard.command.tobytes())
        if view.snapshot is not None and view.snapshot.sequence != self._sequence:
            self._sequence = view.snapshot.sequence
            for array in (view.snapshot.state, view.snapshot.distance, view.snapshot.hazards):
                self.hash.update(np.ascontiguousarray(array).tobytes())


def patrol(seconds: float, seed: int, digest: bool = False) -> tuple[float, float, str, PatrolLog]:
    """Run a patrol; (wall seconds, CPU seconds, digest, log)."""
    workcell = load_workcell(packaged()[CELL])
    with open_cell(workcell, seed) as cell:
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        log, hasher = PatrolLog(cell, task), Digest()
        observers = (log, hasher) if digest else (log,)
        session = Session(cell, task, seed=seed, observers=observers)
        session.warm_up()
        cpu, start = cpu_seconds(), time.perf_counter()
        session.run(seconds)
        wall, cpu = time.perf_counter() - start, cpu_seconds() - cpu
        log.freeze()
    return wall, cpu, hasher.hash.hexdigest(), log


def cpu_seconds() -> float:
    """User and system time of this process so far, all threads [s]."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def seconds_until(words: list[str], text: str) -> float:
    """Wall time until a command prints a text on stderr or ends [s]."""
    start = time.perf_counter()
    process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if text in line:
            break
    seconds = time.perf_counter() - start
    process.terminate()
    process.communicate()
    return seconds


def main() -> None:
    report = Report("workcell", __doc__)
    seconds = 5.0 if report.quick else 30.0
    patrol(1.0, 0)  # compiles
    wall, cpu, _, log = patrol(seconds, 0)
    report.add(
        "realtime_factor",
        seconds / wall,
        "simulated s/s",
        must=">= 1.0",
        aim=">= 2.0",
        note=f"whole chain, {cpu / seconds:.2f} CPU s a simulated s",
    )
    milliseconds = 1e3 * np.array(log.map_seconds)
    report.add(
        "map_ms",
        float(np.median(milliseconds)),
        "ms",
        spread=(float(np.percentile(milliseconds, 10)), float(np.percentile(milliseconds, 90))),
        note=f"p99 {np.percentile(milliseconds, 99):.1f} ms, {len(milliseconds)} updates",
    )
    once, again = (patrol(min(seconds, 8.0), 7, digest=True)[2] for _ in range(2))
    report.add(
        "bit_for_bit", float(once == again), "1 = yes", must=">= 1", note="joints, commands, maps"
    )
    words = [sys.executable, "-m", "armsight"]
    for key, call, text in (
        ("help_s", ["--help"], "never"),
        ("demo_page_s", ["demo", "--port", "0", "--seconds", "1"], "live page"),
    ):
        times = [seconds_until([*words, *call], text) for _ in range(report.rounds(5))]
        must = {"help_s": "<= 0.5", "demo_page_s": "<= 15"}[key]
        aim = {"help_s": "", "demo_page_s": "<= 8"}[key]
        spread = (min(times), max(times))
        report.add(key, float(np.median(times)), "s", spread=spread, must=must, aim=aim)
    report.add("peak_memory", peak_memory_mb(), "MB", note=f"{os.cpu_count()} cores seen")
    report.finish()


if __name__ == "__main__":
    main()
