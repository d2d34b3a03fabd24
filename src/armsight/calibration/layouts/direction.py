"""Poses written the other way round: the base in the flange instead of the flange in the base.

The pictures alone cannot tell: a camera on the arm with inverted poses is, number by number, a
camera beside the arm with right ones. Whoever says where the camera is (``--hand``, ``--beside``)
tells it, and so do distances: what hangs on the flange is nearer to it than what stands beside the
arm is to the base.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from armsight.arrays import Vector3
from armsight.calibration.findings import Finding, Severity
from armsight.calibration.layouts.candidate import Candidate
from armsight.calibration.layouts.choice import Choice
from armsight.calibration.layouts.conventions import Reading
from armsight.calibration.problem import Mount

NEARER = 2.0
"""By this factor one of the two must be nearer for distances to tell anything [1]."""
LONG = 0.4
"""What is nearer than this to the flange may hang on it, however near the other is [m]."""
_WHERE: dict[Mount, str] = {"base": "beside the arm", "flange": "on the arm"}


def settle_direction(
    choices: Mapping[int, Choice | None], stated: Mount | None, middle: Vector3
) -> dict[int, Choice | None]:
    """Readings by poses of the right direction, or with an error where nothing tells it.

    Args:
        choices: of each camera, by the poses as they are written.
        stated: where the user says that the cameras are, or None.
        middle: (3,) of the board's corners in its frame [m].
    """
    out = dict(choices)
    mine = {k: c for k, c in choices.items() if c is not None and c.trusted}
    if stated is None:
        doubt = {k: c for k, c in mine.items() if _inverted(c.best, middle)}
    else:
        doubt = {k: c for k, c in mine.items() if c.best.mount != stated}
    # One arm has poses of one direction: the camera that fits as it is says so for all.
    settled = len(doubt) < len(mine)
    for k, choice in doubt.items():
        best = choice.best
        if stated is None:
            found = [] if settled else [_unsaid(best, middle)]
        elif settled or _upright(best, middle):
            found = [_not_there(best, "warning", "")]
        elif _inverted(best, middle):
            best = replace(best, reading=_inverse(best.reading), mount=stated)
            found = [_taken_inverted(best, middle)]
        else:
            found = [_not_there(best, "error", ", and distances do not tell which")]
        out[k] = replace(choice, best=best, findings=(*found, *choice.findings))
    return out


def _distances(best: Candidate, middle: Vector3) -> tuple[float, float]:
    """Of what hangs on the flange from it, and of what stands beside the arm from the base [m]."""
    camera = float(np.linalg.norm(best.fit.X[:3, 3]))
    board = float(np.linalg.norm(best.fit.Z[:3, :3] @ middle + best.fit.Z[:3, 3]))
    return (camera, board) if best.mount == "flange" else (board, camera)


def _inverted(best: Candidate, middle: Vector3) -> bool:
    hangs, stands = _distances(best, middle)
    return hangs > NEARER * stands and hangs > LONG


def _upright(best: Candidate, middle: Vector3) -> bool:
    hangs, stands = _distances(best, middle)
    return stands > NEARER * hangs


def _inverse(reading: Reading) -> Reading:
    R = np.swapaxes(reading.R, 1, 2)
    position = -(R @ reading.position[:, :, None])[:, :, 0]
    return replace(reading, R=R, position=position, words=f"{reading.words}, inverted")


def _taken_inverted(best: Candidate, middle: Vector3) -> Finding:
    return Finding(
        "pose_inverted",
        "warning",
        f"{best.reading.table.source}: the poses are inverted (base in the flange instead of the "
        f"flange in the base): with the camera {_WHERE[best.mount]}, as is said, they fit only so "
        f"({_things(best, middle)}): read so",
        "write T_base_flange",
    )


def _not_there(best: Candidate, severity: Severity, more: str) -> Finding:
    taken = f": read as {_WHERE[best.mount]}" if severity == "warning" else more
    return Finding(
        "pose_inverted",
        severity,
        f"camera and poses fit only with the camera {_WHERE[best.mount]}, or with all poses "
        f"inverted (base in the flange instead of the flange in the base){taken}",
        "say where the camera is (--hand: on the arm), and write T_base_flange",
    )


def _unsaid(best: Candidate, middle: Vector3) -> Finding:
    return Finding(
        "pose_inverted",
        "error",
        f"{best.reading.table.source}: either the poses are inverted (base in the flange instead "
        f"of the flange in the base), or the camera is {_WHERE[best.mount]}: "
        f"{_things(best, middle)}",
        "say --hand or --beside; and write T_base_flange",
    )


def _things(best: Candidate, middle: Vector3) -> str:
    """Both distances, in words."""
    hangs, stands = _distances(best, middle)
    one, other = ("camera", "board") if best.mount == "flange" else ("board", "camera")
    return f"the {one} is {hangs:.2f} m from the flange, the {other} {stands:.2f} m from the base"
