"""What is wrong with a set's poses, told by the reading by which arm and board agree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.calibration.findings import Finding, names_of
from armsight.calibration.layouts.candidate import Candidate
from armsight.calibration.layouts.conventions import Reading
from armsight.calibration.layouts.joint_angles import may_be_joints


def reading_findings(
    best: Candidate,
    said: Candidate | None,
    square: float,
) -> list[Finding]:
    """Mistakes that the chosen reading names.

    Args:
        best: the reading that was taken.
        said: the best one that is as file and user say, or None.
        square: distance of neighbouring corners [m].
    """
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


def undecided(best: Candidate, rivals: Sequence[Candidate]) -> list[Finding]:
    """Readings that fit as well as the best one, and put the camera elsewhere.

    Args:
        best: the reading that was taken.
        rivals: the others, in any order.
    """
    if not rivals:
        return []
    rival = min(rivals, key=lambda c: c.fit.median_px)
    return [
        Finding(
            "undecided",
            "error",
            f"{best.reading.table.source}: the views do not tell {best.words()} "
            f"({best.fit.median_px:.1f} px) from {rival.words()} ({rival.fit.median_px:.1f} px), "
            "which puts the camera elsewhere",
            "take more views, turned about different axes; or say --hand or --beside, and name the "
            "columns by what they are",
        )
    ]


def named_twice(best: Candidate) -> list[Finding]:
    """What a table ties to several poses: none of them is surely the picture's."""
    twice = best.pairing.twice
    if not twice:
        return []
    return [
        Finding(
            "named_twice",
            "warning",
            f"{best.reading.table.source}: has {names_of(twice)} more than once, with "
            "different poses: left out",
            "keep the line of the picture that is in the folder",
        )
    ]


def nothing_fits(best: Candidate, pictures: int) -> Finding:
    """No reading of the poses agrees with the pictures; says how the best one fails.

    Args:
        best: of all readings.
        pictures: how many there are.
    """
    turn = float(np.median(best.fit.turn))
    words = (
        f"arm and board turn by different angles between the views (by {np.rad2deg(turn):.1f} deg)"
        if turn > np.deg2rad(2)
        else "angles agree but positions do not"
    )
    cure = (
        "check that each picture was taken at its pose, with the arm at rest, and that all poses "
        "are of this recording"
    )
    rows = len(best.reading.table.values)
    if rows != pictures and best.pairing.words.startswith("in order"):
        words += f"; {pictures} pictures and {rows} poses, and no name that ties them"
        cure = "write each picture's name into its line of poses"
    if may_be_joints(best.reading.table):
        cure += "; if the numbers are joint angles, say which arm it is: --robot ur5"
    return Finding(
        "poses_do_not_match",
        "error",
        f"poses and pictures do not belong together: by the best of all readings "
        f"({best.words()}) {words}, {best.fit.median_px:.0f} px",
        cure,
    )
