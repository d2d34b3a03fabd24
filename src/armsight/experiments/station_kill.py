"""The station killed in every phase of a visit and started again: does the plug end safely?"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from armsight.charging.visit import State
from armsight.experiments.cache import RunCache
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, share_row
from armsight.experiments.station_phases import COPIES, LID_PHASES, PHASES, lid_kills, plain_kills
from armsight.experiments.station_sigkill import killed

VERSION = 9
GUARDED_VERSION = 8
"""Of the guarded kills: they take a minute or two each."""
FIRST_REAL = 10**6
"""Number of the first kill of a guarded program, in the cache."""
ABOUT = """
In each phase of a visit, at a random moment of it, the station's process is killed by SIGKILL, and
another one is started from the file that it left. Where arm, plug, lid and car stand in the
simulation is handed to it, as real ones would stand where the arm's watchdog stopped it. Two ways:

* *station*: contact physics (`experiments/station_bench.py`: no guard, looks drawn from the pairs'
  errors). Cars of the three types parked at random, the plug shown to the standing pair first; and
  cars under a lid with both latches, half of the kills while it is opened, half while it is shut. A
  visit under way is forked where a phase begins, the copy goes on to a moment within the phase and
  is killed (of a visit under a lid two copies), the visit goes on to its next phase. What is
  started again is a process that never was part of a visit. Safe: it ends by itself, nobody
  asked for help, at its stand-by, its file gone, the plug out of the car by the truth (more than
  5 cm before its face), nothing pressed with more than 125 N, nothing touched but the port (a
  finger touches its lid).
* *whole program*: the session of `armsight charge ur10_charging --headless` in a process of its
  own (map, guard, rendered cameras and pairs), a tenth as many, one of each phase at least. Safe:
  it stands by or is on its way there, nobody is asked for help, the arm touched nothing but the
  port, and the plug is out of the car by the truth. Home: it is at its stand-by, and its file is
  gone.
"""
WHOLE = (
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
"""The whole program is killed within so long after a phase began [s]; 1.5 unless named."""
Kills = list[dict[str, Any]]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` kills in each phase, and a tenth as many of the whole program."""
    station: Kills = []
    halved = max(1, runs // COPIES)
    for k, (part, visit, count) in enumerate(
        (("plain", plain_kills, runs), ("lid", lid_kills, halved))
    ):
        share = part_of(progress, 0.25 * k, 0.25)
        settings = {"version": VERSION, "part": part}
        visits = run_episodes("station-kill", visit, range(count), seed, settings, share)
        station += [kill for found in visits for kill in found["kills"]]
    cache = RunCache("station-kill", seed, {"version": GUARDED_VERSION})
    whole: Kills = []
    programs = len(WHOLE) * max(1, runs // 10)
    for i in range(programs):
        progress(f"the whole program, {WHOLE[i % len(WHOLE)]}", 0.5 + 0.5 * i / programs)
        whole.append(cache.get(FIRST_REAL + i, partial(_program, seed, i)))
    names = [phase.name for phase in (*PHASES, *LID_PHASES)]
    rows = _rows("station", names, station)
    rows += _rows("whole program", [phase.value for phase in WHOLE], whole)
    home = [k | {"safe": k["home"]} for k in whole]
    what = "and back at the stand-by within 20 s of the new process"
    rows.append(replace(_row("home_after_kill", "whole program", home, None), measure=what))
    forces = [k["force_n"] for k in station if "force_n" in k]
    if forces:
        what = "greatest force of a process that was started again"
        rows.append(Row("force_n", what, "station", max(forces), "N", len(forces)))
    notes = tuple(f"not safe: {k}" for k in [*station, *whole] if not k["safe"])
    return Outcome(tuple(rows), notes=notes)


def _rows(what: str, phases: list[str], kills: Kills) -> list[Row]:
    rows = [
        _row("safe_after_kill", f"{what}: {name}", [k for k in kills if k["phase"] == name])
        for name in phases
    ]
    return [*rows, _row("safe_after_kill", f"{what}: all phases", kills)]


def _program(seed: int, i: int) -> dict[str, Any]:
    """The whole program killed in one phase."""
    phase = WHOLE[i % len(WHOLE)]
    when = float(np.random.default_rng((seed, 42, i)).uniform(0.0, LATEST.get(phase, 1.5)))
    return killed(phase, when, 1000 * seed + i)


def _row(key: str, condition: str, kills: Kills, budget: float | None = 1.0) -> Row:
    good = sum(bool(k["safe"]) for k in kills)
    what = "killed by SIGKILL, started again, ended with the plug safely out"
    return share_row(key, what, condition, good, len(kills), None, budget, budget, "higher")


EXPERIMENT = Experiment(
    "station-kill", "A charging station that is killed and started again", run, runs=20, about=ABOUT
)
