"""The rows of ``faults``: of cameras that lie, of other faults, of kills."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from armsight.experiments.faults_cases import CASES, Case
from armsight.experiments.faults_devices import DRIFT, OFF
from armsight.experiments.faults_lies import FREEING, KINDS
from armsight.experiments.rows import Row, share_row

Results = Sequence[dict[str, Any]]
NAMED, NAMED_AIM = 0.3, 0.15
"""A fault is to be named within [s]."""
STOPPED = 0.5
"""The arm is to stand within [s], as docs/guard.md promises."""
CREPT, CREPT_AIM = 1.5, 1.0
"""Readings that creep away are to stop the arm before they lie by this [deg]: of such a fault it is
not the time that harms. 1.5 deg are 24 mm at 0.9 m."""
LOST = 1.5
"""A recording may lack so much before a kill [s]: it is written twice a second."""
LIES, OTHERS = "cameras lie", "other faults"


def lie_rows(results: Results) -> Iterator[Row]:
    """Of cameras that lie."""
    named = [t for r in results for t in r["named"]]
    yield from _noticed(named, LIES, "lying cameras")
    for kind in KINDS:
        times = [t for r in results if r["kind"] == kind for t in r["named"]]
        yield _median(kind, times, "of one kind of lie")
    freeing = [r for r in results if r["count"] == 4 and r["kind"] in FREEING]
    yield _stop(
        "stop_s", f"all cameras lie: {', '.join(FREEING)}", [r["stop"] for r in freeing], STOPPED
    )
    yield _blamed(results, LIES)
    lies = [r for r in results if r["kind"] != "bump"]
    yield _recovered(lies, LIES)


def other_rows(results: Results) -> Iterator[Row]:
    """Of all other faults."""
    yield from _noticed([r["named"] for r in results], OTHERS, "faults")
    at_once = {case.name for case in CASES if case.stops and case.name != "drifts"}
    times = [r["stood"] for r in results if r["case"] in at_once]
    yield _stop("stop_s", f"{OTHERS} that begin at once", times, STOPPED)
    crept = [r["stood"] for r in results if r["case"] == "drifts"]
    yield Row(
        "drifts_off_deg",
        "by how much a reading that creeps away lies when the arm stands, greatest",
        "2 deg in a second",
        float(np.rad2deg(OFF)) * min(max(crept, default=math.nan) / DRIFT, 1.0),
        "deg",
        n=len(crept),
        must=CREPT,
        aim=CREPT_AIM,
    )
    yield _blamed(results, OTHERS)
    yield _recovered(results, OTHERS)
    for case in CASES:
        yield from _of_case(case, [r for r in results if r["case"] == case.name])


def _of_case(case: Case, results: Results) -> Iterator[Row]:
    times = [r["named"] for r in results]
    yield _median(case.name, times, case.what)
    if case.stops:
        yield _stop(f"{case.name}_stop_s", case.what, [r["stood"] for r in results], None)


def contact_row(lies: Results, others: Results) -> Row:
    """Contacts in all runs that have a person in them."""
    everything = [*lies, *others]
    return Row(
        "faults_contacts",
        "contacts of the moving arm with anything",
        f"{len(everything)} runs",
        sum(r["contacts"] for r in everything),
        n=len(everything),
        must=0.0,
        aim=0.0,
    )


def kill_rows(results: Results) -> Iterator[Row]:
    """Of kills; those in which the arm never moved before are counted as not restarted."""
    began = [r for r in results if r["began"]]
    yield _stop(
        "kill_stop_s", "session, command path, or both", [r["stood"] for r in began], STOPPED
    )
    files = sum(whole(r) for r in began)
    yield share_row(
        "kill_files",
        "kills that leave whole files",
        "",
        files,
        len(began),
        None,
        1.0,
        1.0,
        "higher",
    )
    yield Row(
        "kill_lost_s",
        "what a recording lacks before the kill (or before the disk was full), greatest",
        "written twice a second; what still waits is lost",
        max((r["lost"] for r in began if r["readable"]), default=math.nan),
        "s",
        n=len(began),
        must=LOST,
        why="none could be read",
    )
    again = sum(restarted(r) for r in results)
    yield share_row(
        "kill_restart", "kills after which the same program runs", "", again, len(results), None,
        1.0, 1.0, "higher",
    )  # fmt: skip


def whole(kill: dict[str, Any]) -> bool:
    """Whether the recording of a killed program can be read, and nothing else is left of it."""
    one = kill["left"] in (["run.mcap"], ["run.mcap.partial"])
    return bool(kill["readable"] and one)


def restarted(kill: dict[str, Any]) -> bool:
    """Whether all processes of a killed program were gone, and the next one moved the arm."""
    return bool(kill["began"] and kill["gone"] and kill["again"])


def _noticed(times: Sequence[float], condition: str, what: str) -> Iterator[Row]:
    found = np.array([t for t in times if math.isfinite(t)])
    yield share_row(
        "unnoticed", f"{what} that nobody named", condition, len(times) - len(found), len(times),
        None, 0.0, 0.0,
    )  # fmt: skip
    yield Row(
        "named_s",
        "from the beginning until it is named, 95th percentile of those that were",
        condition,
        float(np.percentile(found, 95)) if len(found) else math.nan,
        "s",
        n=len(times),
        must=NAMED,
        aim=NAMED_AIM,
        why="nothing was named",
    )


def _median(name: str, times: Sequence[float], what: str) -> Row:
    known = sum(math.isfinite(t) for t in times)
    value = float(np.median(times)) if times else math.nan
    return Row(
        f"{name}_named_s",
        "the same, median",
        f"{what}; {known} of {len(times)} were named",
        value if math.isfinite(value) else math.nan,
        "s",
        n=len(times),
        why="most were not named",
    )


def _stop(key: str, condition: str, times: Sequence[float | None], must: float | None) -> Row:
    counted = [t for t in times if t is not None]
    greatest = max(counted, default=math.nan)
    return Row(
        key,
        "from the beginning until the arm stands, greatest",
        condition,
        greatest if math.isfinite(greatest) else math.nan,
        "s",
        n=len(counted),
        must=must,
        why="no arm was moving" if not counted else "one went on",
    )


def _blamed(results: Results, condition: str) -> Row:
    return Row(
        "false_blame",
        "runs in which something honest was blamed before anything went wrong",
        condition,
        sum(r["early"] > 0 for r in results),
        n=len(results),
    )


def _recovered(results: Results, condition: str) -> Row:
    count = sum(r["recovered"] for r in results)
    return share_row(
        "recovered", "runs in which all is well again at the end", condition, count, len(results),
        None, 0.98, 1.0, "higher",
    )  # fmt: skip
