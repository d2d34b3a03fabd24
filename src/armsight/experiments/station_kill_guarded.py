"""The whole charging program killed in every phase of a visit and started again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from armsight.charging.visit import State
from armsight.experiments.cache import RunCache
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.station_kill import kill_row, kill_rows
from armsight.experiments.station_sigkill import killed

ABOUT = """
The session of `armsight charge ur10_charging --headless` in a process of its own (map, guard,
rendered cameras and pairs), killed by SIGKILL at a random moment of each phase in turn; where arm,
plug and car stand in its simulation is handed to the next process, as a real arm would stand where
its watchdog stopped it. Safe: it stands by or is on its way there, nobody is asked for help, the
arm touched nothing but the port, and the plug is out of the car by the truth (more than 5 cm before
its face). Home: it is at its stand-by, and its file is gone. `station-kill` has many more kills,
without map and guard.
"""
PHASES = (
    State.FIND,
    State.LOOK,
    State.APPROACH,
    State.ALIGN,
    State.TARE,
    State.INSERT,
    State.CHARGE,
    State.UNPLUG,
    State.LEAVE,
)
LATEST = {State.FIND: 0.5, State.TARE: 0.4, State.INSERT: 3.5, State.CHARGE: 1.5}
"""It is killed within so long after a phase began [s]; 1.5 unless named."""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` kills in each of nine phases."""
    cache = RunCache("station-kill-guarded", seed)
    kills: list[dict[str, Any]] = []
    for i in range(len(PHASES) * runs):
        progress(f"kill -9, {PHASES[i % len(PHASES)]}", i / (len(PHASES) * runs))
        kills.append(cache.get(i, partial(_program, seed, i)))
    rows = kill_rows("whole program", [phase.value for phase in PHASES], kills)
    home = [k | {"safe": k["home"]} for k in kills]
    what = "and back at the stand-by within 20 s of the new process"
    rows.append(replace(kill_row("home_after_kill", "whole program", home, None), measure=what))
    return Outcome(tuple(rows), notes=tuple(f"not safe: {k}" for k in kills if not k["safe"]))


def _program(seed: int, i: int) -> dict[str, Any]:
    """The program killed in one phase."""
    phase = PHASES[i % len(PHASES)]
    when = float(np.random.default_rng((seed, 42, i)).uniform(0.0, LATEST.get(phase, 1.5)))
    return killed(phase, when, 1000 * seed + i)


EXPERIMENT = Experiment(
    "station-kill-guarded",
    "The whole charging program that is killed and started again",
    run,
    runs=2,
    about=ABOUT,
)
