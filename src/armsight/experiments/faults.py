"""``faults``: what goes wrong in a running cell; is it named, does the arm stop, does it go on?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments import faults_kill, faults_lies, faults_run
from armsight.experiments.cache import RunCache
from armsight.experiments.episodes import part_of, run_episodes
from armsight.experiments.faults_cases import CASES
from armsight.experiments.faults_lies import KINDS
from armsight.experiments.faults_rows import (
    NAMED,
    STOPPED,
    contact_row,
    kill_rows,
    lie_rows,
    other_rows,
    restarted,
    whole,
)
from armsight.experiments.frame import Experiment, Outcome, Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEWER = 2
"""One group of lies and of kills for so many groups of other faults."""

ABOUT = """
The packaged cell `ur5_four_cameras` with its person and all sensor errors patrols, and something
goes wrong.

**Cameras lie** with fresh stamps. For 2 s, from somewhere between 4 and 8 s on, one, two or all
four cameras show everything at nine tenths of the range with noise (`far`), the picture of 4 s ago
(`old`), left and right exchanged (`mirror`), another camera's picture (`neighbour`), the last
picture again and again (`freeze`), half of the lens covered (`cover`); or their stands are bumped,
by 30 mm and 3 deg, and stay so (`bump`). Named is a camera when the map gives a reason for it.
Recovered is a run in which every camera is believed again at the end and none is blamed; a bumped
one is aligned again, or not used until it has been calibrated. Where all four lie and the arm was
moving, `stop_s` counts until it stands.

**Something else goes wrong** for 2 s, from a moment on at which the arm moves faster than
0.15 rad/s (the cases stand in the table; `late` lasts 0.3 s). Clocks jump by 0.1 to 3 s and
back again, the computer's as guard and map are told it. Named is a fault when the guard, or the
health of a component or a camera, says it in words (`experiments/faults_cases.py`) while it lasts;
what names the wrong culprit does not count. `stop_s` ends when the true joints are slower than
0.05 rad/s. Recovered is a run in which, within 9 s after the fault, every camera is believed,
nothing is said of the fault any more, and the arm has moved again, or somebody is within 1.5 m of
it; with a full disk it is one in which the recording can be read up to there. A map that hangs
hands out nothing new here: a simulated clock stands while it waits.

**And the program is killed** by SIGKILL within 2 s after each of these other faults began: the
session's process, that of its command path, or both at once. Arm and cameras stand behind drivers
as real ones do, under the wall clock, with recorded pictures of the cell
(`experiments/wall_lab.py`: nobody is in them); the arm outlives the programs, and rests 0.1 s
after its last command. Here a map that hangs does hang, and the arm's clock is that of a device.
`kill_stop_s` counts until the arm stands for good, `kill_files` are kills after which the recording
can be read and nothing half-written lies beside it, `kill_restart` those after which no process is
left and the same program, started again, moves the arm: it is the one that is killed next, or,
after six of them, ends in order.
"""


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` groups of other faults, half as many of lies and of kills, but one."""
    groups = max(1, runs // FEWER)
    lies = run_episodes(
        "faults-lies",
        faults_lies.episode,
        range(groups * faults_lies.MEMBERS),
        seed,
        part_of(progress, 0.0, 0.4),
    )
    others = run_episodes(
        "faults-others",
        faults_run.episode,
        range(runs * len(CASES)),
        seed,
        part_of(progress, 0.4, 0.3),
    )
    kills = _kills(groups, seed, part_of(progress, 0.7, 0.3))
    return Outcome(
        (*lie_rows(lies), *other_rows(others), contact_row(lies, others), *kill_rows(kills)),
        {"named": lambda: _named(lies, others), "stopped": lambda: _stopped(others, kills)},
        tuple(_notes(others, kills)),
    )


def _kills(groups: int, seed: int, progress: Progress) -> list[dict[str, Any]]:
    """One after the other: each has two processes of its own."""
    cache = RunCache("faults-kills", seed)
    count = groups * len(CASES) // faults_kill.LINKS
    found: list[dict[str, Any]] = []
    for number in range(count):
        progress(f"faults-kills: {number} of {count} chains", number / count)
        found += cache.get(number, lambda number=number: _chain(seed, number))["kills"]  # type: ignore[misc]
    return found


def _chain(seed: int, number: int) -> dict[str, Any]:
    return {"kills": faults_kill.chain(seed, number)}


def _notes(others: list[dict[str, Any]], kills: list[dict[str, Any]]) -> Iterator[str]:
    for r in others:
        if not (math.isfinite(r["named"]) and r["recovered"]):
            named = f"named after {r['named']:.2f} s" if math.isfinite(r["named"]) else "not named"
            end = "recovered" if r["recovered"] else f"not recovered ({r['failure'] or r['last']})"
            yield f"`{r['case']}`, clocks by {r['jump']:.2f} s: {named}, {end}."
    for r in kills:
        if not r["began"]:
            yield f"Kill in `{r['case']}`: the arm did not move before ({r['words']})."
        elif not (whole(r) and restarted(r)):
            wrong = {key: r[key] for key in ("readable", "left", "gone", "again")}
            yield f"Kill of {r['who']} in `{r['case']}`: {wrong}."


def _named(lies: list[dict[str, Any]], others: list[dict[str, Any]]) -> Figure:
    times = {kind: [t for r in lies if r["kind"] == kind for t in r["named"]] for kind in KINDS}
    times |= {c.name: [r["named"] for r in others if r["case"] == c.name] for c in CASES}
    return _strip(times, "s until named", {"must": NAMED})


def _stopped(others: list[dict[str, Any]], kills: list[dict[str, Any]]) -> Figure:
    times = {c.name: [r["stood"] for r in others if r["case"] == c.name] for c in CASES if c.stops}
    times["killed"] = [r["stood"] for r in kills if r["began"]]
    return _strip(times, "s until the arm stands", {"must": STOPPED})


def _strip(times: dict[str, list[float]], label: str, lines: dict[str, float]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.5))
    axes = figure.subplots()
    for i, each in enumerate(times.values()):
        known = [t for t in each if math.isfinite(t)]
        axes.plot(np.full(len(known), i), known, "o", color="C0", alpha=0.5)
        if len(known) < len(each):
            axes.plot([i], [0.0], "x", color="C3")  # one or more never
    for style, (name, at) in zip(("-", "--"), lines.items()):
        axes.axhline(at, color="C3", linewidth=1.0, linestyle=style, label=name)
    axes.set_xticks(range(len(times)), list(times), rotation=60, ha="right")
    axes.set(ylabel=label, ylim=(-0.02, None))
    axes.legend()
    return figure


EXPERIMENT = Experiment(
    name="faults",
    title="Faults in a running cell with a person in it",
    run=run,
    runs=6,
    about=ABOUT,
)
