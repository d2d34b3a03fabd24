"""``false-stops``: nobody is near, the sensors err as they do; how often does the arm stop?"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments.episodes import Watch, packaged_cell, run_episodes, with_simulation
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, poisson_bounds
from armsight.motion.data import GuardMode, GuardStatus
from armsight.recording.patrol_log import kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS = 30.0
"""Length of a run [s]."""
BEGIN = 1.0
"""What happens before is the start: no picture has come yet [s]."""
JITTER_MS, ERROR_MM, ERROR_DEG = 20.0, 5.0, 0.5
LOST = 0.001
"""Share of the pictures that never come, as cables and busy machines lose them."""
HALTED = (GuardMode.STOPPED, GuardMode.REFLEX)

ABOUT = """
The packaged cell `ur5_four_cameras` without people: a UR5 patrols under four simulated Kinect v2
with depth noise, stamps wrong by up to 20 ms, and calibration errors of 5 mm and 0.5 deg (standard
deviation, drawn anew for each run); one picture in a thousand is lost (since November 2026; 216 an
hour). The map is told that stamps may be 20 ms off
(`MappingConfig.stamp_error`), and believes the cameras to be within 5 mm and 0.5 deg. A false stop
is a change to "stopped" or "reflex" while there is a goal, after the first second. The interval is
that of a Poisson rate.
"""


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run; module-level, so that worker processes can import it."""
    from armsight.runtime.config import SessionConfig
    from armsight.runtime.configure import mapping_config
    from armsight.runtime.session import Session
    from armsight.simulation.camera_faults import Fault
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    workcell = with_simulation(
        packaged_cell(),
        person=(),
        object=(),
        stamp_jitter_ms=JITTER_MS,
        calibration_error_mm=ERROR_MM,
        calibration_error_deg=ERROR_DEG,
    )
    with open_cell(workcell, seed=int(np.random.default_rng((seed, run)).integers(2**31))) as cell:
        for camera in simulated_world(cell).cameras:
            camera.faults.add(Fault("drop", amount=LOST))
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        watch = Watch()
        mapping = replace(
            mapping_config(workcell, cell.T_world_base, cell.robot.reach),
            stamp_error=JITTER_MS / 1e3,
        )
        config = SessionConfig(mapping=mapping)
        Session(cell, task, seed=run, config=config, observers=(watch,)).run(SECONDS)
        log = [s for s in watch.log if s.stamp >= BEGIN]
        return {
            "stops": stops(log),
            "slowed": sum(s.mode == GuardMode.SLOWED for s in log) / max(1, len(log)),
            "goals": len(task.times),
            "reasons": dict(Counter(kind(s.reason) for s in log if s.mode in HALTED)),
        }


def stops(log: list[GuardStatus]) -> int:
    """How often the guard came to a halt while there was a goal to reach."""
    first = int(bool(log) and log[0].mode in HALTED and not log[0].reached)
    return first + sum(
        after.mode in HALTED and before.mode not in HALTED and not after.reached
        for before, after in pairwise(log)
    )


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` half minutes of patrol with nobody near."""
    results = run_episodes("false-stops", episode, range(runs), seed, progress)
    count = sum(r["stops"] for r in results)
    hours = runs * (SECONDS - BEGIN) / 3600.0
    low, high = poisson_bounds(count)
    reasons: Counter[str] = Counter()
    for result in results:
        reasons.update(result["reasons"])
    rows = (
        Row(
            "false_stops_per_hour",
            f"stops and reflexes with nobody near: upper 95 % bound of their rate, {count} counted",
            f"{runs} x {SECONDS:.0f} s",
            high / hours,
            "1/h",
            n=runs,
            low=low / hours,
            high=high / hours,
            must=2.0,
            aim=0.5,
            strict=True,
        ),
        Row(
            "slowed_share",
            "share of the time in which separation slowed the arm, mean",
            f"{runs} x {SECONDS:.0f} s",
            float(np.mean([r["slowed"] for r in results])),
            n=runs,
        ),
        Row(
            "goals_per_minute",
            "goals reached, mean",
            f"{runs} x {SECONDS:.0f} s",
            float(np.mean([r["goals"] for r in results])) * 60.0 / SECONDS,
            "1/min",
            n=runs,
            better="higher",
        ),
    )
    notes = [f"{reason or 'no reason given'}: {n} looks." for reason, n in reasons.most_common(5)]
    return Outcome(rows, {"runs": lambda: _plot(results)}, tuple(notes))


def _plot(results: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3))
    axes = figure.subplots()
    axes.bar(range(len(results)), [r["stops"] for r in results])
    axes.set(xlabel="run", ylabel="false stops")
    return figure


EXPERIMENT = Experiment(
    name="false-stops",
    title="Stops with nobody near, under sensor, stamp and calibration errors",
    run=run,
    runs=20,
    about=ABOUT,
)
