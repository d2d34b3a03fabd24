"""``permit``: touches by permit, and how hard they really press."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Vector3
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, wilson
from armsight.experiments.touch_cell import Target, TouchCell, Toucher
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.motion.guard_config import GuardConfig
from armsight.motion.permits import ContactKind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SECONDS, PATIENT = 16.0, 45.0
"""Longest episode, and that of a palm that lies on something firm [s]."""
KINDS = ("ball", "palm", "cheek", "clamped")
PERMITS: dict[str, ContactKind] = {
    "ball": "thing", "palm": "hand", "cheek": "face", "clamped": "hand",
}  # fmt: skip
FAULTS = ("none", "none", "none", "lost", "jump", "silent", "frozen", "lie", "push", "greedy")
"""What goes wrong, in turn; nothing in three of ten episodes."""
BUDGET = {"ball": (10.0, 5.0), "palm": (30.0, 15.0), "cheek": (5.0, 2.0), "clamped": (30.0, 15.0)}
"""Must and aim of the force [N]."""
FIRM = 1e5
"""Stiffness of what a clamped palm lies on [N/m]."""
START, APART = np.array([0.49, 0.11, 0.28]), 0.35
"""Where the pen's tip begins [m], and how far from it targets are."""
SOFT = 300.0
"""Stiffness of the brush with which a cheek is touched [N/m] (assumption)."""

ABOUT = """
A UR5 with a pen, its force sensor (500 readings a second, noise, bias, drift, 100 Hz low-pass, 4 ms
late), drives that answer 60 ms late; contact in steps of 1 ms. The map is made from the truth, but
as late as a real one. In turn: a **ball** on a stand (20 to 40 mm, 50 to 300 g, stand 1 to 5 N/mm),
still or moving at up to 6 cm/s; a **palm** (ISO/TS 15066's mass and surface of a hand, held with
0.3 to 0.8 N/mm) that moves to and fro by up to 5 cm; a **cheek** (4.4 kg, neck of 2 to 5 N/mm, a
brush of 0.3 N/mm before the face's own surface) that sways by 1 cm; a **clamped** palm, which lies
on something firm and declared (100 N/mm) on the far side from where the arm comes. A task sees its
target 90 ms late, 30 times a second, with 2 mm of noise, goes there at up to 0.4 m/s, stops when it
feels 2 N (cheek 1 N), holds for a second, and goes back.

In seven of ten episodes something goes wrong: the target is lost or jumps by 15 cm in the task's
eyes, the force sensor falls silent, says the same again and again, or begins to lie by 30 N, the
target is pushed at the tool at up to 0.3 m/s (one that is clamped is not), or the task asks for ten
times the speed and force. `force_n` is the greatest true force of every touch in episodes without a
push (who pushes makes the force), 99 % quantile; `harm` counts episodes in which the force was
above what the permit granted or, with the passing blow's factor (which a clamped palm has none of),
above what the body's region stands; pushes count by the region's limits alone.
"""


def _place(rng: np.random.Generator) -> Vector3:
    """(3,) where the target is, in reach and apart from where the arm begins [m]."""
    while True:
        turn, reach = rng.uniform(-1.3, 1.3), rng.uniform(0.5, 0.65)
        center = np.array([reach * np.cos(turn), reach * np.sin(turn), rng.uniform(0.2, 0.5)])
        if np.linalg.norm(center - START) > APART:
            return center


def _sway(center: Vector3, way: Vector3, rate: float) -> Any:
    return lambda t: center + way * np.sin(rate * t)


def episode(seed: int, run: int) -> dict[str, Any]:
    """One touch; module-level, so that worker processes can import it."""
    rng = np.random.default_rng((seed, run))
    kind, fault = KINDS[run % len(KINDS)], FAULTS[run // len(KINDS) % len(FAULTS)]
    if kind == "clamped" and fault == "push":
        fault = "none"
    center = _place(rng)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    limits, felt, config = (0.05, 10.0, 2.0), 2.0, GuardConfig()
    if kind == "ball":
        radius = float(rng.uniform(0.02, 0.04))
        speed = float(rng.choice([0.0, rng.uniform(0.0, 0.06)]))
        target = Target(
            _sway(center, way * speed / 0.8, 0.8), radius, rng.uniform(0.05, 0.3), 20e3,
            rng.uniform(1e3, 5e3),
        )  # fmt: skip
    elif kind in ("palm", "clamped"):
        radius, region = 0.05, BODY_REGIONS["hand"]
        limits = (0.1, 30.0, 5.0)
        sway, hold = rng.uniform(0.0, 0.05), rng.uniform(300, 800)
        if kind == "clamped":
            sway, hold = 0.0, FIRM
        path = _sway(center, way * sway, 1.2)
        target = Target(path, radius, region.mass, region.stiffness, hold)
    else:
        radius, region = 0.09, BODY_REGIONS["face"]
        limits, felt = (0.1, 5.0, 0.5), 1.0
        config = GuardConfig(soft=SOFT)
        path = _sway(center, way * rng.uniform(0.0, 0.01), 1.0)
        surface = 1.0 / (1.0 / SOFT + 1.0 / region.stiffness)
        target = Target(path, radius, region.mass, surface, rng.uniform(2e3, 5e3))
    when = float(rng.uniform(2.0, 5.0))
    if fault == "greedy":
        limits = (10 * limits[0], 10 * limits[1], limits[2])
    cell = TouchCell(target, config=config, seed=int(rng.integers(2**31)))
    if kind == "clamped":
        from_arm = (center - START) / np.linalg.norm(center - START)
        cell.declare_firm(center + radius * from_arm, from_arm)
    try:
        toucher = Toucher(cell, PERMITS[kind], radius, rng, limits=limits, felt=felt)
        if fault == "push":
            cell._path = _pushing(cell, target, when, float(rng.uniform(0.05, 0.3)))
        toucher.lost = when if fault == "lost" else np.inf
        toucher.jump = when if fault == "jump" else np.inf
        cell.silent = when if fault == "silent" else np.inf
        cell.frozen = when if fault == "frozen" else np.inf
        longest = PATIENT if kind == "clamped" else SECONDS
        while cell.now < longest and not toucher.done:
            cell.lie = 30.0 if fault == "lie" and cell.now > when else 0.0
            cell.tick(goal=toucher())
        return _result(cell, kind, fault)
    finally:
        cell.close()


def _pushing(cell: TouchCell, target: Target, when: float, speed: float) -> Any:
    """From a time on the target goes at the tool, for 15 cm at most."""
    from armsight.robots.kinematics import tcp_pose

    state: dict[str, Any] = {}

    def path(t: float) -> Vector3:
        own = np.asarray(target.path(min(t, when)))
        if t < when:
            return own
        if not state:
            tip = tcp_pose(cell.robot, cell.q)[:3, 3]
            state["way"] = (tip - own) / max(float(np.linalg.norm(tip - own)), 1e-9)
        return np.asarray(own + state["way"] * min(speed * (t - when), 0.15))

    return path


def _result(cell: TouchCell, kind: str, fault: str) -> dict[str, Any]:
    permits = [s.permit for s in cell.log if s.permit is not None]
    held = [p for p in permits if p.holds]
    force = max((c.force for c in cell.contacts if np.isfinite(c.force)), default=0.0)
    region = None if kind == "ball" else BODY_REGIONS["face" if kind == "cheek" else "hand"]
    most = held[-1].force if held else 0.0
    # What lies on something firm is pressed for as long as the arm goes on: that is no blow.
    blow = 1.0 if kind == "clamped" or region is None else region.transient
    stands = np.inf if region is None else region.force * blow
    return {
        "kind": kind,
        "fault": fault,
        "touched": bool(cell.contacts),
        "force": float(force),
        "granted": float(most),
        "stands": float(stands) if np.isfinite(stands) else None,
        "parts": sorted({int(c.link) for c in cell.contacts}),
        "permit": str(permits[-1]) if permits else "",
        "seconds": cell.now,
        "impulse": float(sum(c.impulse for c in cell.contacts)),
    }


def harmed(e: dict[str, Any]) -> bool:
    """Whether an episode pressed harder than was granted, or than the region stands."""
    above = e["force"] > e["granted"] and e["fault"] != "push"
    return bool(above or (e["stands"] is not None and e["force"] > e["stands"]))


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` episodes."""
    episodes = run_episodes("permit", episode, range(runs), seed, progress)
    rows = [_harm(episodes, "all episodes")]
    for kind in KINDS:
        mine = [e for e in episodes if e["kind"] == kind]
        rows.append(_harm(mine, kind))
        forces = [e["force"] for e in mine if e["touched"] and e["fault"] != "push"]
        must, aim = BUDGET[kind]
        where = {"ball": "ball on a stand", "clamped": "palm on something firm"}.get(kind, kind)
        rows.append(
            Row(
                "force_n",
                "greatest true force of a touch, 99 % quantile (median to greatest beside it)",
                where,
                float(np.quantile(forces, 0.99)) if forces else float("nan"),
                "N",
                n=len(forces),
                low=float(np.median(forces)) if forces else None,
                high=max(forces) if forces else None,
                must=must,
                aim=aim,
            )
        )
        calm = [e for e in mine if e["fault"] in ("none", "greedy")]
        done = sum(e["touched"] for e in calm)
        low, high = wilson(done, len(calm)) if calm else (0.0, 1.0)
        rows.append(
            Row(
                "touched_share",
                "episodes without a fault in which the target was touched",
                where,
                done / max(len(calm), 1),
                n=len(calm),
                low=low,
                high=high,
                better="higher",
            )
        )
    notes = [
        f"Harm in episode {k}: {e['kind']}, {e['fault']}: {e['force']:.1f} N, granted "
        f"{e['granted']:g}; {e['permit']}."
        for k, e in enumerate(episodes)
        if harmed(e)
    ]
    return Outcome(tuple(rows), {"forces": lambda: _plot(episodes)}, tuple(notes))


def _harm(episodes: list[dict[str, Any]], condition: str) -> Row:
    count = sum(harmed(e) for e in episodes)
    low, high = wilson(count, max(len(episodes), 1))
    return Row(
        "harm",
        "episodes with a force above the permit's or the region's (95 % bounds of the share)",
        condition,
        float(count),
        n=len(episodes),
        low=low,
        high=high,
        must=0.0,
        aim=0.0,
    )


def _plot(episodes: list[dict[str, Any]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    axes = figure.subplots()
    for k, kind in enumerate(KINDS):
        for fault in dict.fromkeys(FAULTS):
            mine = [e for e in episodes if e["kind"] == kind and e["fault"] == fault]
            x = np.full(len(mine), k) + 0.1 * (list(dict.fromkeys(FAULTS)).index(fault) - 3)
            axes.plot(
                x, [e["force"] for e in mine], "o", ms=3, color=f"C{FAULTS.index(fault)}",
                label=fault if k == 0 else None,
            )  # fmt: skip
        axes.hlines(BUDGET[kind][0], k - 0.4, k + 0.4, color="k", lw=1)
    axes.set_xticks(range(len(KINDS)), KINDS)
    axes.set_ylabel("greatest force [N]")
    axes.legend(ncols=4, fontsize=8)
    return figure


EXPERIMENT = Experiment(
    "permit", "touches by permit, and how hard they really press", run, 360, ABOUT
)
