"""Whole visits of the charging station: pictures searched or looks drawn."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments.charging_faults import FAULTS, faulty_visit
from armsight.experiments.charging_rows import agreement_row, fault_rows, rows_of, visit_rows
from armsight.experiments.charging_visits import TYPES, angled_cell, bench_visit, random_cell
from armsight.experiments.episodes import Episode, part_of, run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.station_eyes import Mode
from armsight.experiments.station_weather import surroundings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """
Cars with Type 2, Type 1 and CCS2 inlets in turn, parked within 20 x 20 cm and 10 deg, the port at
0.75 to 0.95 m, looking up by 0 to 20 deg, no flank nearer than 8 cm to the plug at its
stand-by; each lamp at 0.2 to 1.8 of the light's brightness; clearance 0.3 to 0.6 mm, friction 0.1
to 0.4, mated contacts 10 to 35 N; the packaged cells' arm with its errors, plug in its soft mount
with cable, force sensor. Seated: within 1 mm of the seat and 2 deg by the truth while the station
says that it charges. Two ways of looking (`charging-guarded` has a third):

* *pictures searched* (no prefix): contact physics, and the pairs' pictures rendered, searched and
  fitted as in the cell, their true poses off by what the cell's calibration leaves; no guard, and
  a map that sees nothing: ways are planned round what is declared, and round the car where its port
  was found. By seed: one of four places of the standing pair,
  1.0 to 2.3 m from the port, on both sides of it; one of five lights (indoor, dim, a low sun before
  which the arm may stand, overcast, over-exposed); dull to glossy plastic that mirrors the sky,
  dirt, in a quarter of them drops of water, in 0.3 of them a hard shadow (as in `port-pose`). In a
  fifth as many visits something goes wrong, nine kinds in turn: ice in the inlet (8 to 28 mm deep),
  an inlet of another type, a car that drives off, one that is moved by 3 cm without a word, a
  permit that is withdrawn, a force sensor that dies, and a car that somebody pushes (5 to 20 mm
  along the ground, at 0.02 to 0.1 m/s), leans on (3 to 10 mm down and 0.3 to 1 deg, one to three
  times) or draws away (5 to 20 mm, at 0.01 to 0.05 m/s) without a word while the plug goes in, is
  in, or comes out. Recovered: out again (or, without a force sensor, known to be in and left
  there), nothing pressed with more than 125 N, and the words say what it was, or it ended seated
  after all (moved, permit, pushed, leaned on, drawn away).
* *looks drawn* (`bench_`, no budget; a fifth as many): the same cars, but a look is the truth with
  errors drawn (3 mm and 1 deg from afar, 0.8 mm and 0.6 deg from near, standard deviations).

`ablation_no_second_look_`: the first of the same cars, a fifth as many, pictures searched: what the
standing pair saw from afar is gone in by, and no failed try is followed by another.

The charging paper's two rows: a Type 2 port at 10 and at 30 deg to the standing pair's line of
sight, five each, same seeds for ours and for `paper_` (one look, equation 1 and a plane through the
contacts, along Z until a force stops it), pictures searched.
"""
SEARCHED = "pictures searched, contact physics"
BLIND = "pictures searched, without the second look"
DRAWN = "contact physics, looks drawn"
ANGLES = (10.0, 30.0)
PAPER_RUNS = 5
PAPER = {
    10.0: ("Success", "Success: Misalignment", "Success", "Failed: Missed rotation",
           "Success: Misalignment"),
    30.0: ("Success: Misalignment", "Failed: Missed rotation", "Success", "Success: Misalignment",
           "Success: Misalignment"),
}  # fmt: skip
"""Table I of the charging paper."""
Runs = list[dict[str, Any]]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` visits with searched pictures, a fifth as many with drawn looks; see ``ABOUT``."""
    fifth = max(1, runs // 5)
    parts: dict[str, tuple[int, Episode]] = {
        "paper ours": (2 * PAPER_RUNS, partial(_angled, "ours")),
        "paper": (2 * PAPER_RUNS, partial(_angled, "paper")),
        "searched": (runs, partial(_visit, True)),
        "searched wrong": (fifth, partial(_fault, True)),
        "no second look": (fifth, partial(_visit, True, second_look=False)),
        "drawn": (fifth, partial(_visit, False)),
        "drawn wrong": (fifth, partial(_fault, False)),
    }
    total = sum(count for count, _ in parts.values())
    done, found = 0, dict[str, Runs]()
    for name, (count, visit) in parts.items():
        share = part_of(progress, done / total, count / total)
        found[name] = run_episodes("charging", visit, range(count), seed, share, name)
        done += count
    rows = [
        *visit_rows(found["searched"], SEARCHED),
        *rows_of(found["searched"], SEARCHED, "place"),
        *rows_of(found["searched"], SEARCHED, "light"),
        *fault_rows(found["searched wrong"], SEARCHED),
        *visit_rows(found["no second look"], BLIND, "ablation_no_second_look_"),
        *visit_rows(found["drawn"], DRAWN, "bench_"),
        *fault_rows(found["drawn wrong"], DRAWN, "bench_"),
        agreement_row(found["searched"], found["drawn"], "searched less drawn"),
        *visit_rows(found["paper ours"], "Type 2 at 10 and 30 deg", "angled_"),
        *visit_rows(found["paper"], "Type 2 at 10 and 30 deg", "paper_"),
    ]
    notes = (_table(found["paper ours"], found["paper"]), *_problems(found))
    return Outcome(tuple(rows), {"visits": lambda: _plot(found)}, notes)


def _visit(rendered: bool, seed: int, i: int, second_look: bool = True) -> dict[str, Any]:
    cell = random_cell(np.random.default_rng((seed, 51, i)), TYPES[i % len(TYPES)])
    around = surroundings(np.random.default_rng((seed, 56, i))) if rendered else None
    return bench_visit(cell, 10_000 * seed + i, rendered, second_look=second_look, around=around)


def _fault(rendered: bool, seed: int, i: int) -> dict[str, Any]:
    cell = random_cell(np.random.default_rng((seed, 52, i)))
    around = surroundings(np.random.default_rng((seed, 57, i))) if rendered else None
    fault = FAULTS[i % len(FAULTS)]
    return faulty_visit(cell, fault, 10_000 * seed + 5000 + i, rendered, around)


def _angled(mode: Mode, seed: int, i: int) -> dict[str, Any]:
    cell = angled_cell(np.random.default_rng((seed, 53, i)), ANGLES[i // PAPER_RUNS])
    return bench_visit(cell, 10_000 * seed + 7000 + i, True, mode)


def _table(ours: Runs, paper: Runs) -> str:
    """The paper's Table I, run by run, ours and its way done again beside it."""
    lines = [
        "| angle | run | the paper's table I | its way, here | misaligned | ours | misaligned |",
        "|---|---|---|---|---|---|---|",
    ]
    for i, (mine, theirs) in enumerate(zip(ours, paper)):
        angle, k = ANGLES[i // PAPER_RUNS], i % PAPER_RUNS
        cells = [f"{angle:.0f} deg", str(k + 1), PAPER[angle][k]]
        for visit in (theirs, mine):
            cells += [_ended(visit), f"{visit['tilt_deg']:.1f} deg" if visit["said"] else "-"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _ended(visit: dict[str, Any]) -> str:
    if visit["full"]:
        return "fully in"
    if visit["said"]:
        return f"halted {visit['depth_mm']:.0f} mm deep"
    return f"stopped: {visit['problem']}"


def _problems(found: dict[str, Runs]) -> list[str]:
    """What was said of visits that were meant to go well and did not."""
    return [
        f"{name}, visit {i + 1}: {visit['problem'] or _ended(visit)}"
        for name in ("searched", "drawn")
        for i, visit in enumerate(found[name])
        if not visit["full"]
    ]


def _plot(found: dict[str, Runs]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.2))
    labels = (("cycle_s", "stand-by to seated [s]"), ("axial_n", "greatest axial force [N]"))
    for i, (key, label) in enumerate(labels):
        axes = figure.add_subplot(1, 2, i + 1)
        for name in ("searched", "drawn"):
            values = np.sort([v[key] for v in found[name] if np.isfinite(v[key])])
            share = np.arange(1, len(values) + 1) / max(len(found[name]), 1)
            axes.step(values, share, where="post", label=name)
        axes.set_xlabel(label)
        axes.set_ylabel("share of visits")
        axes.set_ylim(0, 1.02)
        axes.legend(fontsize=7)
    figure.tight_layout()
    return figure


EXPERIMENT = Experiment(
    "charging", "Whole visits of the charging station", run, runs=100, about=ABOUT
)
