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

from armsight.arrays import Floats, Ints, Poses
from armsight.calibration import se3
from armsight.calibration.boards import Turn
from armsight.calibration.findings import Finding
from armsight.calibration.hand_eye_fit import HandEyeFit, SeenBoards, angle_gaps, fit
from armsight.calibration.layouts.conventions import Reading, readings
from armsight.calibration.layouts.folder import Series
from armsight.calibration.layouts.pairing import Pairing, mistaken_pairings, proper_pairings
from armsight.calibration.layouts.table import PoseTable
from armsight.calibration.layouts.two_recordings import two_findings, two_parts
from armsight.calibration.problem import Mount

BETTER = 3.0
"""Another reading must fit this many times better than what was said to be believed."""
ALIKE = 1.3
"""Readings within this factor are alike: the more usual one is taken."""
UNITS = ((1.0, "metres"), (1e-3, "millimetres"), (1e-2, "centimetres"), (0.0254, "inches"))
SUSPECT = 0.008
"""Misfit over the focal length beyond which two recordings may be mixed [1]: a good arm is off by
0.001, one that errs by 3 mm by 0.005."""
SCORED = 40
"""Views that are enough to tell readings apart."""


@dataclass(frozen=True)
class Candidate:
    """One reading with its fit."""

    reading: Reading
    pairing: Pairing
    mount: Mount
    fit: HandEyeFit

    @property
    def length(self) -> tuple[float, str]:
        """The unit of the positions [m], and its name; the nearest one to the scale that fits."""
        said = self.reading.table.length
        known = [u for u in UNITS if abs(np.log(self.fit.scale / u[0])) < 0.35]
        if said is not None:
            known.sort(key=lambda u: u[0] != said)
        known.sort(key=lambda u: abs(np.log(self.fit.scale / u[0])) > 0.12)
        if known:
            return known[0]
        return next((u for u in UNITS if u[0] == (said or 1.0)), UNITS[0])

    def words(self) -> str:
        """The reading for people."""
        where = "on the arm" if self.mount == "flange" else "beside the arm"
        return f"{self.reading.words}, {self.length[1]}, {self.pairing.words}; camera {where}"

    @property
    def meaning(self) -> tuple[str, bool, Mount, str]:
        """What makes two candidates different."""
        return self.reading.kind, self.reading.degrees, self.mount, self.reading.table.source


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
        for pairing in proper_pairings(series, table):
            ways.append((table, pairing, meanings))
            found += _candidates(pairing, meanings, seen, boards)
    if not found:
        return None
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
    others = [c for c in found if c.meaning != best.meaning and c.pairing.code == ""]
    second = min(others, key=lambda c: c.fit.median_px, default=None)
    trusted = best.fit.median_px < limit
    findings = _named(best, said, stated, boards, square) if trusted else [_nothing(best, boards)]
    middling = best.fit.median_px
    if middling > SUSPECT * boards.focal or np.mean(best.fit.px > limit) > 0.15:
        near = limit if trusted and middling < 0.5 * limit else min(limit, 0.8 * middling)
        parted = _parted(series, found, best, trusted, seen, boards, near)
        if parted is not None:
            best, findings = parted
            trusted = True
    return Choice(best, second, said, tuple(findings), trusted)


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


def _named(
    best: Candidate,
    said: Candidate | None,
    stated: Mount | None,
    boards: SeenBoards,
    square: float,
) -> list[Finding]:
    """Mistakes that the chosen reading names."""
    out: list[Finding] = []
    table = best.reading.table

    def add(code: str, message: str, cure: str) -> None:
        out.append(Finding(code, "warning", message, cure))

    if said is not None and not best.reading.declared:
        code, cure = _kind_of_mistake(best.reading, said.reading)
        add(
            code,
            f"{table.source}: holds {best.reading.words}, not {said.reading.words} as it says "
            f"({_px(said)} so, {_px(best)} as read)",
            cure,
        )
    elif table.angle is not None and best.reading.degrees != (table.angle < 1.0):
        unit = "degrees" if best.reading.degrees else "radians"
        add(
            "degrees", f"{table.source}: the angles are in {unit}: read so", "name the unit rightly"
        )
    length, unit = best.length
    if table.length is not None and length != table.length:
        add(
            "millimetres",
            f"{table.source}: the positions are in {unit}, not as it says: read so",
            "name the unit rightly",
        )
    if stated is not None and best.mount != stated:
        beside = best.mount == "base"
        add(
            "pose_inverted",
            f"camera and poses fit only with the camera {'beside' if beside else 'on'} the arm, or "
            f"with all poses inverted (base in the flange instead of the flange in the base): read "
            f"as {'beside' if beside else 'on'} the arm",
            "say where the camera is (--hand: on the arm), and write T_base_flange",
        )
    if best.pairing.code:
        add(
            best.pairing.code,
            f"{table.source}: {best.pairing.words}: read so",
            "pair each picture with the pose at its exposure; number both with leading zeros",
        )
    out += _scale(best, length, square)
    return out


def _px(candidate: Candidate) -> str:
    px = candidate.fit.median_px
    return f"{px:.3g} px" if px < 1e5 else "nothing fits"


def _kind_of_mistake(best: Reading, said: Reading) -> tuple[str, str]:
    if "quaternion" in best.kind and "quaternion" in said.kind:
        return "quaternion_order", "reorder the columns, or name them qw qx qy qz"
    if "matrix" in best.kind:
        return "matrix_order", "write the matrices row by row"
    if best.kind == said.kind:
        return "degrees", "write radians, or name the columns with _deg"
    return "rotation_format", "name the columns by what they are"


def _scale(best: Candidate, length: float, square: float) -> list[Finding]:
    """Lengths of board and arm that do not agree by more than a print can be off."""
    ratio = best.fit.scale / length
    sigma = best.fit.scale_sigma
    if abs(np.log(ratio)) < max(0.05, 5 * sigma):
        return []
    if abs(np.log(ratio / 1e3)) < 0.12:
        words = "the board's size seems to be given in metres or the like, not in millimetres"
    else:
        words = "angles agree but lengths do not"
    return [
        Finding(
            "board_size",
            "error",
            f"{words}: the board fits with corners {1e3 * square / ratio:.4g} mm apart, not "
            f"{1e3 * square:.4g} mm",
            "measure the printed board over its whole length and give that size",
        )
    ]


def _nothing(best: Candidate, boards: SeenBoards) -> Finding:
    turn = float(np.median(best.fit.turn))
    words = (
        f"arm and board turn by different angles between the views (by {np.rad2deg(turn):.1f} deg)"
        if turn > np.deg2rad(2)
        else "angles agree but positions do not"
    )
    return Finding(
        "poses_do_not_match",
        "error",
        f"poses and pictures do not belong together: by the best of all readings "
        f"({best.words()}) {words}, {best.fit.median_px:.0f} px",
        "check that each picture was taken at its pose, with the arm at rest, and that all poses "
        "are of this recording",
    )


def board_options(
    T: Sequence[Poses], turns: Sequence[Turn], points: Floats, focal: float
) -> SeenBoards:
    """The poses that boards may have, from the one or two of each flat board.

    Args:
        T: of each picture, (1 or 2, 4, 4) ``T_camera_board``, the better first.
        turns: other ways to read the board.
        points: (k, 3) its corners [m].
        focal: of the lens [px].
    """
    two = np.array([[p[0], p[-1]] for p in T])
    parts = [two]
    for turn in turns:
        # Corner k is taken for turn.corner[k]: the board's frame moves by the opposite turn.
        parts.append(two @ se3.inverses(_onto(points, points[turn.corner])[None])[0])
    middle = 0.5 * (points.max(0) + points.min(0))
    radius = float(np.sqrt(np.mean(np.sum((points - points.mean(0)) ** 2, axis=1))))
    return SeenBoards(np.concatenate(parts, axis=1), radius, focal, middle)


def _onto(a: Floats, b: Floats) -> Floats:
    """(4, 4) turn about the board's normal that brings (k, 3) points a onto b."""
    x, y = a[:, :2] - a[:, :2].mean(0), b[:, :2] - b[:, :2].mean(0)
    angle = np.arctan2((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum(), (x * y).sum())
    S = np.eye(4)
    S[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    S[:3, 3] = b.mean(0) - S[:3, :3] @ a.mean(0)
    return S
