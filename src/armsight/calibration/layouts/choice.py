"""Which reading of the poses is the right one: the one by which arm and board agree.

Every table, every way to tie it to the pictures, every convention of rotations, both directions of
the transform and both mounts are tried; angles between views sort most of them out, a fit of camera
and board decides the rest. What the file or the user said wins unless another reading fits several
times better; then it is the name of a mistake.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Ints, Poses
from armsight.calibration import se3
from armsight.calibration.findings import Finding, Severity
from armsight.calibration.hand_eye_fit import SeenBoards, angle_gaps, fit
from armsight.calibration.layouts.candidate import Candidate
from armsight.calibration.layouts.conventions import Reading, readings
from armsight.calibration.layouts.pairing import Pairing, mistaken_pairings, proper_pairings
from armsight.calibration.layouts.reading_findings import (
    named_twice,
    nothing_fits,
    reading_findings,
    undecided,
)
from armsight.calibration.layouts.series import Series
from armsight.calibration.layouts.table import PoseTable
from armsight.calibration.layouts.two_recordings import two_findings, two_parts
from armsight.calibration.problem import Mount

BETTER = 3.0
"""Another reading must fit this many times better than what was said to be believed."""
ALIKE = 1.3
"""Readings within this factor are alike: the more usual one is taken."""
RIVAL = 2.0
"""A reading that fits less than this many times worse cannot be told from the best one [1]."""
APART = (0.03, 0.05)
"""Camera poses that no errors of a good set explain [m], [rad]."""
SUSPECT = 0.008
"""Misfit over the focal length beyond which two recordings may be mixed [1]: a good arm is off by
0.001, one that errs by 3 mm by 0.005."""
SCORED = 40
"""Views that are enough to tell readings apart."""


@dataclass(frozen=True)
class Choice:
    """The reading that was taken.

    Attributes:
        best: it; second: the best one that means something else, or None.
        said: the best one that is as file and user say, or None where they say nothing.
        findings: mistakes that it names.
        trusted: arm and board agree by it; otherwise no reading fits.
    """

    best: Candidate
    second: Candidate | None
    said: Candidate | None
    findings: tuple[Finding, ...]
    trusted: bool

    def poses(self) -> Poses:
        """(n, 4, 4) ``T_base_flange`` of the table's rows [m]."""
        return self.best.reading.poses(self.best.length[0])


def choose(
    series: Series,
    tables: Sequence[PoseTable],
    seen: Ints,
    boards: SeenBoards,
    stated: Mount | None,
    square: float,
) -> Choice | None:
    """The best reading of poses for a series of pictures; None when nothing can be tried.

    Args:
        series: the pictures.
        tables: all that may be poses.
        seen: (s,) which pictures show the board; boards: their poses, likewise.
        boards: see there.
        stated: where the user says the camera is.
        square: distance of neighbouring corners [m], for messages.
    """
    found: list[Candidate] = []
    ways: list[tuple[PoseTable, Pairing, list[Reading]]] = []
    for table in tables:
        meanings = readings(table)
        if not meanings:
            continue
        for pairing in proper_pairings(series, table, seen):
            ways.append((table, pairing, meanings))
            found += _candidates(pairing, meanings, seen, boards)
    boards_own = [c for c in found if c.of_the_board]
    mine = [c for c in found if c.reading.table.source not in _sources(boards_own)]
    if not found:
        return None
    if not mine:
        return Choice(boards_own[0], None, None, (_not_the_arms(boards_own[0], "error"),), True)
    found = mine
    best = _preferred(found, stated)
    limit = 0.03 * boards.focal
    if best.fit.median_px > limit:
        more: list[Candidate] = []
        for table, pairing, meanings in ways:
            for wrong in mistaken_pairings(pairing, len(series.files), len(table.values)):
                more += _candidates(wrong, meanings, seen, boards)
        if more:
            rival = _preferred(more, stated)
            if rival.fit.median_px * BETTER < best.fit.median_px:
                found += more
                best = rival
    said = _said(found, stated)
    rivals = [
        c
        for c in found
        if c.pairing.code == ""
        and _elsewhere(c, best)
        and (stated is None or best.mount != stated or c.mount == stated)
    ]
    others = [c for c in found if c.meaning != best.meaning and c.pairing.code == ""]
    second = min(others, key=lambda c: c.fit.median_px, default=None)
    trusted = best.fit.median_px < limit
    findings = (
        reading_findings(best, said, square) if trusted else [nothing_fits(best, len(series.files))]
    )
    middling = best.fit.median_px
    if middling > SUSPECT * boards.focal or np.mean(best.fit.px > limit) > 0.15:
        near = limit if trusted and middling < 0.5 * limit else min(limit, 0.8 * middling)
        parted = _parted(series, found, best, trusted, seen, boards, near)
        if parted is not None:
            best, findings = parted
            trusted = True
    told = best.reading.declared and best.mount == stated
    if trusted and not told and not any(f.severity == "error" for f in findings):
        findings += undecided(best, rivals)
    findings += [_not_the_arms(c, "note") for c in _first_of_each(boards_own)]
    findings += named_twice(best)
    return Choice(best, second, said, tuple(findings), trusted)


def _elsewhere(candidate: Candidate, best: Candidate) -> bool:
    """Another reading of the same table that fits as well and puts the camera elsewhere."""
    if candidate.reading.table.source != best.reading.table.source:
        return False
    if candidate.fit.median_px > RIVAL * best.fit.median_px + 0.3:
        return False
    if candidate.mount != best.mount:
        return True
    step = se3.logs(se3.inverses(best.fit.X[None]) @ candidate.fit.X[None])[0]
    return bool(np.linalg.norm(step[:3]) > APART[0] or np.linalg.norm(step[3:]) > APART[1])


def _sources(candidates: Sequence[Candidate]) -> set[str]:
    return {c.reading.table.source for c in candidates}


def _first_of_each(candidates: Sequence[Candidate]) -> list[Candidate]:
    return list({c.reading.table.source: c for c in reversed(candidates)}.values())


def _not_the_arms(candidate: Candidate, severity: Severity) -> Finding:
    return Finding(
        "board_poses",
        severity,
        f"{candidate.reading.table.source}: holds the poses of the board in the camera, not the "
        "arm's: not used",
        "give the flange's poses in the robot's base, as the controller shows them",
    )


def _parted(
    series: Series,
    found: Sequence[Candidate],
    best: Candidate,
    trusted: bool,
    seen: Ints,
    boards: SeenBoards,
    limit: float,
) -> tuple[Candidate, list[Finding]] | None:
    """Two cameras in one folder, by the reading that tells; None when there are not two."""
    ways = [best]
    if not trusted:
        proper = [c for c in found if c.pairing.code == ""]
        ways = sorted(proper, key=lambda c: (not c.reading.declared, c.reading.rank))[:6]
    for way in ways:
        place = {int(p): k for k, p in enumerate(seen)}
        tied = zip(way.pairing.picture.tolist(), way.pairing.row.tolist())
        pairs = [(place[p], r, p) for p, r in tied if p in place]
        T = way.reading.poses()[[r for _, r, _ in pairs]]
        A = T if way.mount == "base" else se3.inverses(T)
        parts = two_parts([A], boards.only(np.array([k for k, _, _ in pairs])), 0.5 * limit)
        if parts is not None:
            names = [series.files[p].name for _, _, p in pairs]
            return way, two_findings(parts[0], names)
    return None


def _candidates(
    pairing: Pairing, meanings: Sequence[Reading], seen: Ints, boards: SeenBoards
) -> list[Candidate]:
    """Readings by whose angles arm and board agree best, fitted for both mounts."""
    place = {int(p): k for k, p in enumerate(seen)}
    pairs = [
        (place[int(p)], int(r)) for p, r in zip(pairing.picture, pairing.row) if int(p) in place
    ]
    if len(pairs) < 3:
        return []
    if len(pairs) > SCORED:
        pairs = [pairs[int(k)] for k in np.linspace(0, len(pairs) - 1, SCORED)]
    which = np.array([k for k, _ in pairs])
    rows = np.array([r for _, r in pairs])
    mine = boards.only(which)
    gaps = angle_gaps(np.array([m.R[rows] for m in meanings]), mine)
    least = float(gaps.min())
    order = np.argsort(gaps, kind="stable")
    near = [int(k) for k in order if gaps[k] <= 1.5 * least + np.deg2rad(0.3)][:14]
    near += [k for k, m in enumerate(meanings) if m.declared and k not in near]
    if not any(m.declared for m in meanings) and 0 not in near:
        near.append(0)
    out = []
    for k in near:
        T = meanings[k].poses()[rows]
        for mount in ("base", "flange"):
            A = T if mount == "base" else se3.inverses(T)
            found = fit(A, mine)
            if not (found.scale > 1e-7 and np.isfinite(found.px).all()):
                # Mirrored or nonsense: it fits nothing, and stays what the file says.
                found = replace(found, px=np.full(len(found.px), 1e6), scale=1.0)
            out.append(Candidate(meanings[k], pairing, mount, found))
    return out


def _preferred(found: Sequence[Candidate], stated: Mount | None) -> Candidate:
    """The best fit, the more usual among those alike; what was said unless it is far worse."""
    least = min(c.fit.median_px for c in found)
    said = [c for c in found if c.reading.declared and c.pairing.code == "" and c.mount == stated]
    if said:
        best = min(said, key=lambda c: c.fit.median_px)
        if best.fit.median_px <= BETTER * least + 0.3:
            return best
    # What was said of one thing holds although another one is wrong.
    alike = [c for c in found if c.fit.median_px <= ALIKE * least + 0.2]
    return min(
        alike,
        key=lambda c: (
            c.pairing.code != "",
            stated is not None and c.mount != stated,
            not c.reading.declared,
            c.reading.rank,
            c.fit.median_px,
        ),
    )


def _said(found: Sequence[Candidate], stated: Mount | None) -> Candidate | None:
    """What file and user say, as far as they say anything."""
    declared = [c for c in found if c.reading.declared and c.pairing.code == ""]
    mine = [c for c in declared if stated is None or c.mount == stated]
    return min(mine or declared, key=lambda c: c.fit.median_px, default=None)
