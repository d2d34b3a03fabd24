"""The panel's words and figures as small pieces of HTML; every text from outside is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from armsight.mapping.snapshot import FREE, OCCUPIED, CameraStatus, WorkspaceSnapshot
from armsight.motion.data import GuardMode, GuardStatus
from armsight.runtime.view import ComponentHealth
from armsight.viewer.colors import MODES

FONT = "font-family:ui-sans-serif,system-ui,sans-serif"
DIM = "opacity:.65"
GOOD, BAD, OFF = "#2dd4bf", "#ef4444", "#94a3b8"
STILL = "#334155"

OLD_CAMERA = 2.5
"""No map may wait longer for a camera: one that is said to be alive is then not [s]."""
NO_NEWS = 3
"""A browser that has heard nothing for so long says so by itself [s]."""

REASONS = {
    "idle": "no goal: the arm holds still",
    "planning": "holds still until a path is ready",
    "predictive": "follows its path at full allowed speed",
    "velocity": "moves as its task says, within limits and separation",
}
"""What a mode means where the guard gives no reason of its own."""


def pulse(beat: int) -> str:
    """What a browser shows by itself when no further beat comes: connection or program is gone.

    A style that starts anew with every beat: without one the page's colours go, and words come.
    """
    return (
        f"<style>@keyframes armsight-old-{beat}{{to{{filter:grayscale(1) brightness(.6)}}}}"
        f"@keyframes armsight-say-{beat}{{to{{max-height:9em;padding:.65em .8em}}}}"
        f".armsight-live{{animation:armsight-old-{beat} .1s {NO_NEWS}s both}}"
        f".armsight-silent{{max-height:0;padding:0 .8em;overflow:hidden;"
        f"animation:armsight-say-{beat} .1s {NO_NEWS}s both}}</style>"
        f"<div class='armsight-silent' style='{FONT};margin:0 .7em .3em .2em;border-radius:.5em;"
        f"background:#000;color:#fff;font-weight:700'>No news for {NO_NEWS} s: armsight or the "
        f"connection to it is gone, and all below is old.</div>"
    )


def banner(
    guard: GuardStatus | None, note: str, armless: bool = False, *, old: bool = False
) -> str:
    """The guard's mode in its colour, and why; without an arm, that depth is being mapped.

    Where that is ``old``, it is grey: no colour says that all is well.
    """
    if armless:
        guard, title, color, words = None, "mapping", "#0e7490", "depth images without an arm"
    elif guard is None:
        title, color, words = "starting", "#64748b", "waiting for the first look at the cell"
    else:
        title, color = MODES[guard.mode]
        words = guard.reason or REASONS.get(guard.mode.value, "")
    if old:
        color = STILL
    if note:
        words = f"{note} — {words}" if words else note
    goal = ""
    if guard is not None and guard.goal:
        # A velocity's name says what is done; a goal's name says where to.
        to = "" if guard.mode is GuardMode.VELOCITY else "at " if guard.reached else "to "
        style = f"float:right;text-transform:none;{DIM}"
        goal = f"<span style='{style}'>{to}{escape(guard.goal)}</span>"
    return (
        f"<div class='armsight-live' style='{FONT};margin:0 .7em .5em .2em;padding:.65em .8em;"
        f"border-radius:.5em;background:{color};color:#fff'>"
        f"<div style='font-size:1.25em;font-weight:700;letter-spacing:.04em;"
        f"text-transform:uppercase'>{title}{goal}</div>"
        f"<div style='font-size:.85em;line-height:1.3;min-height:2.6em'>{escape(words)}</div></div>"
    )


def figures(guard: GuardStatus | None, tip_speed: float, now: float) -> str:
    """The four numbers that one looks for first."""
    distance = protective = scale = "–"
    speed = f"{tip_speed:.2f} m/s" if np.isfinite(tip_speed) else "–"
    color = "inherit"
    if guard is not None:
        distance = metres(guard.distance)
        protective = metres(guard.protective_distance)
        scale = f"{100 * guard.speed_scale:.0f} %"
        if np.isfinite(guard.distance) and guard.distance < guard.protective_distance:
            color = BAD
    cells = (
        ("distance", distance, color, "nearest hazard to the robot's body"),
        ("protective", protective, "inherit", "distance that separation demands now"),
        ("tip speed", speed, "inherit", "of the flange, measured"),
        ("speed scale", scale, "inherit", "share of the planned speed"),
    )
    counts = ""
    if guard is not None:
        counts = f"{guard.replans} plans · {guard.reflexes} reflexes · "
    return boxes(cells, f"{counts}t = {now:.1f} s")


def permit(guard: GuardStatus | None) -> str:
    """What may be touched, what of it is not granted, and how hard it is pressed."""
    asked = None if guard is None else guard.permit
    if asked is None:
        return ""
    title = f"contact with {escape(asked.name)} ({escape(asked.kind)}): {asked.state.value}"
    words = escape(asked.reason)
    if asked.holds:
        least = f"{asked.speed:.2f} m/s, {asked.force:.0f} N, {asked.torque:.1f} N m"
        pressed = f" · pressed with {asked.pressed:.1f} N" if np.isfinite(asked.pressed) else ""
        words = f"at most {least}{pressed}{' · ' + words if words else ''}"
    color = GOOD if asked.holds else BAD
    return (
        f"<div class='armsight-live' style='{FONT};margin:0 .7em .5em .2em;padding:.4em .7em;"
        f"border-radius:.4em;border-left:.3em solid {color};background:rgba(127,127,127,.12);"
        f"font-size:.85em'>"
        f"<b>{title}</b><br>{words}</div>"
    )


def boxes(cells: Sequence[tuple[str, str, str, str]], below: str) -> str:
    """Figures as (name, value, colour, hint), two a row, and a faint line below."""
    boxes = "".join(
        f"<div title='{hint}' style='background:rgba(127,127,127,.12);border-radius:.4em;"
        f"padding:.35em .6em'><div style='font-size:.72em;{DIM}'>{name}</div>"
        f"<div style='font-size:1.15em;font-weight:600;font-variant-numeric:tabular-nums;"
        f"color:{tint}'>{value}</div></div>"
        for name, value, tint, hint in cells
    )
    return (
        f"<div class='armsight-live' style='{FONT};margin:0 .7em .4em .2em'>"
        f"<div style='display:grid;grid-template-columns:1fr 1fr;gap:.35em'>{boxes}</div>"
        f"<div style='font-size:.75em;{DIM};margin-top:.4em;text-align:right;"
        f"font-variant-numeric:tabular-nums'>{below}</div></div>"
    )


def map_figures(snapshot: WorkspaceSnapshot | None, now: float) -> str:
    """What a map without an arm holds."""
    if snapshot is None:
        return _faint("no map yet")
    cells = (
        ("occupied voxels", f"{int((snapshot.state == OCCUPIED).sum()):,}", ""),
        ("free voxels", f"{int((snapshot.state == FREE).sum()):,}", ""),
        ("points", f"{len(snapshot.cloud):,}", "in the merged cloud"),
        ("voxel", f"{1e3 * snapshot.grid.voxel:.0f} mm", "edge"),
    )
    return boxes([(*cell[:2], "inherit", cell[2]) for cell in cells], f"t = {now:.1f} s")


def cameras(statuses: Sequence[CameraStatus], now: float) -> str:
    """Health of the cameras."""
    rows = []
    for status in statuses:
        age = now - status.stamp
        told = f"{1e3 * age:.0f} ms" if np.isfinite(age) else "never"
        old = status.alive and not age <= OLD_CAMERA  # said by a map that stands still
        rows.append(
            table_row(
                GOOD if status.alive and not old else BAD,
                status.name,
                (told, f"{status.frames}", f"{status.dropped}"),
                "the map has taken nothing of it since" if old else status.reason,
            )
        )
    return table(("camera", "age", "frames", "lost"), rows) if rows else _faint("no cameras")


def components(reports: Sequence[ComponentHealth]) -> str:
    """Health of the loop's components."""
    rows = [
        table_row(
            BAD if report.problem else GOOD,
            report.name,
            (
                f"{1e3 * report.seconds[0]:.1f}",
                f"{1e3 * report.seconds[1]:.1f}",
                f"{report.missed}",
            ),
            report.problem,
        )
        for report in reports
    ]
    return table(("component", "ms", "p99", "missed"), rows) if rows else _faint("nothing runs")


def timings(stages: Sequence[tuple[str, float]]) -> str:
    """Seconds of each stage as bars on one scale."""
    if not stages:
        return _faint("no timings yet")
    longest = max(max(seconds for _, seconds in stages), 1e-6)
    bars = "".join(
        f"<div style='display:grid;grid-template-columns:7.5em 1fr 4em;gap:.4em;"
        f"align-items:center;font-size:.78em;margin:.1em 0'>"
        f"<span style='overflow:hidden;text-overflow:ellipsis;{DIM}'>{escape(name)}</span>"
        f"<span style='background:rgba(127,127,127,.15);border-radius:.2em;height:.7em'>"
        f"<span style='display:block;height:100%;border-radius:.2em;background:#38bdf8;"
        f"width:{100 * seconds / longest:.0f}%'></span></span>"
        f"<span style='text-align:right;font-variant-numeric:tabular-nums'>"
        f"{1e3 * seconds:.2f} ms</span></div>"
        for name, seconds in stages
    )
    return f"<div style='{FONT};margin:0 .3em'>{bars}</div>"


def emptiness(snapshot: WorkspaceSnapshot | None) -> str:
    """What became of what somebody has said: that the cell is empty, that solids stand there."""
    if snapshot is None:
        return ""
    word = snapshot.emptiness
    if word.said:
        n = len(snapshot.things)
        text = (
            f"things are told from people: {n:,} voxels of things" if n else "nothing stands here"
        )
    else:
        text = word.reason
    said = [f"{d.name} is declared" for d in snapshot.declared if d.taken]
    said += [f"{d.name}: {d.reason}" for d in snapshot.declared if not d.taken]
    said += map(str, snapshot.inside)
    lines = "<br>".join(escape(words) for words in (text, *said))
    return f"<div style='{FONT};margin:.2em .3em;font-size:.8em;{DIM}'>{lines}</div>"


def legend() -> str:
    """What the voxels' colours mean, and the plain word on safety."""
    return (
        f"<div style='{FONT};margin:.2em .3em .5em;font-size:.74em'>"
        "<div style='height:.5em;border-radius:.25em;background:linear-gradient(90deg,"
        "rgb(60,90,150),rgb(75,150,110),rgb(235,185,40),rgb(240,115,35),rgb(230,40,40))'></div>"
        f"<div style='display:flex;justify-content:space-between;{DIM}'>"
        "<span>left 24 s ago</span><span>voxels</span><span>there now</span></div>"
        f"<div style='margin-top:.6em;{DIM}'>This is no certified safety function: "
        "never rely on it alone to protect people.</div></div>"
    )


def metres(value: float) -> str:
    """A distance, or a dash where there is none."""
    return f"{value:.2f} m" if np.isfinite(value) else "–"


def table_row(color: str, name: str, values: Sequence[str], reason: str) -> str:
    """A line with a dot of its colour; the reason, if any, below it."""
    dot = (
        f"<span style='display:inline-block;width:.6em;height:.6em;border-radius:50%;"
        f"background:{color};margin-right:.45em'></span>"
    )
    cells = "".join(
        f"<td style='text-align:right;padding-left:.6em'>{escape(v)}</td>" for v in values
    )
    line = f"<tr><td>{dot}{escape(name)}</td>{cells}</tr>"
    if reason:
        line += (
            f"<tr><td colspan='{1 + len(values)}' style='color:{BAD};padding-left:1.1em;"
            f"white-space:normal'>{escape(reason)}</td></tr>"
        )
    return line


def table(heads: Sequence[str], rows: Sequence[str]) -> str:
    """Rows under their heads."""
    titles = "".join(
        f"<th style='font-weight:500;{DIM};text-align:{'left' if i == 0 else 'right'}'>{head}</th>"
        for i, head in enumerate(heads)
    )
    return (
        f"<table style='{FONT};width:calc(100% - .6em);margin:0 .3em;font-size:.78em;"
        f"border-collapse:collapse;font-variant-numeric:tabular-nums'>"
        f"<tr>{titles}</tr>{''.join(rows)}</table>"
    )


def _faint(text: str) -> str:
    return f"<div style='{FONT};margin:0 .3em;font-size:.8em;{DIM}'>{text}</div>"
