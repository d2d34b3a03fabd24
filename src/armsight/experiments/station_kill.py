"""The station killed in every phase of a visit and started again: does the plug end safely?"""

from __future__ import annotations

from typing import Any

from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, share_row
from armsight.experiments.station_phases import COPIES, LID_PHASES, PHASES, lid_kills, plain_kills

ABOUT = """
In each phase of a visit, at a random moment of it, the station's process is killed by SIGKILL, and
another one is started from the file that it left. Where arm, plug, lid and car stand in the
simulation is handed to it, as real ones would stand where the arm's watchdog stopped it. Contact
physics (`experiments/station_bench.py`: no guard, looks drawn from the pairs' errors; the whole
program is `station-kill-guarded`). Cars of the three types parked at random, the plug shown to the
standing pair first; and cars under a lid, killed in turns while it is opened and while it is shut.
A visit under way is forked where a phase begins, the copy goes on to a moment within the phase and
is killed (of a visit under a lid two copies), the visit goes on to its next phase. What is started
again is a process that never was part of a visit. Safe: it ends by itself, nobody asked for help,
at its stand-by, its file gone, the plug out of the car by the truth (more than 5 cm before its
face), nothing pressed with more than 125 N, nothing touched but the port (a finger touches its
lid).
"""
Kills = list[dict[str, Any]]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` kills in each phase."""
    kills: Kills = []
    under = -(-runs // COPIES)
    for k, (part, visit, count) in enumerate(
        (("plain", plain_kills, runs), ("lid", lid_kills, under))
    ):
        share = part_of(progress, 0.5 * k, 0.5)
        visits = run_episodes("station-kill", visit, range(count), seed, share, part)
        kills += [kill for found in visits for kill in found["kills"]]
    rows = kill_rows("station", [phase.name for phase in (*PHASES, *LID_PHASES)], kills)
    forces = [k["force_n"] for k in kills if "force_n" in k]
    if forces:
        what = "greatest force of a process that was started again"
        rows.append(Row("force_n", what, "station", max(forces), "N", len(forces)))
    return Outcome(tuple(rows), notes=tuple(f"not safe: {k}" for k in kills if not k["safe"]))


def kill_rows(what: str, phases: list[str], kills: Kills) -> list[Row]:
    """A row a phase, and one of all.

    Args:
        what: is killed.
        phases: their names, in order.
        kills: with ``phase`` and ``safe``.
    """
    rows = [
        kill_row("safe_after_kill", f"{what}: {name}", [k for k in kills if k["phase"] == name])
        for name in phases
    ]
    return [*rows, kill_row("safe_after_kill", f"{what}: all phases", kills)]


def kill_row(key: str, condition: str, kills: Kills, budget: float | None = 1.0) -> Row:
    """The share of kills that ended safe."""
    good = sum(bool(k["safe"]) for k in kills)
    what = "killed by SIGKILL, started again, ended with the plug safely out"
    return share_row(key, what, condition, good, len(kills), None, budget, budget, "higher")


EXPERIMENT = Experiment(
    "station-kill", "A charging station that is killed and started again", run, runs=20, about=ABOUT
)
