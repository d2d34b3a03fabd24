"""What the answer itself says of the data's quality."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.calibration.calibrate import Calibration
from armsight.calibration.diagnosis.scale import scale_findings
from armsight.calibration.findings import Finding, names_of
from armsight.calibration.problem import Problem


def verdict_findings(answer: Calibration, problem: Problem, names: Sequence[str]) -> list[Finding]:
    """Whether poses and pictures agree, how the arm scatters, what was left out, how sure it is.

    Args:
        answer: the answer.
        problem: what the solve began with.
        names: of the views.
    """
    out = _left_out(answer, problem, names) + scale_findings(answer)
    sigma = max(answer.target_sigma(k) for k in range(len(answer.problem.lenses)))
    noise = float(np.median([s.sigma for s in answer.problem.sightings]))
    white = answer.freedom.white
    if answer.left_out is not None and answer.left_out.mm > 1.3:
        out.append(
            Finding(
                "inconsistent",
                "warning",
                f"poses and pictures agree only to {answer.left_out.mm:.1f} mm in views that the "
                f"solve has not seen ({answer.left_out.px:.1f} px; corners scatter by "
                f"{noise:.2f} px)",
                "check that the arm was at rest, its poses are those of the pictures, and board "
                "and camera are tight; link lengths and zeros of the arm show likewise",
            )
        )
    if white is not None and white[0] > 0.002:
        out.append(
            Finding(
                "arm_noise",
                "warning",
                f"the arm's poses scatter by {1e3 * white[0]:.1f} mm and "
                f"{np.rad2deg(white[1]):.2f} deg",
                "an arm repeats to 0.1 mm: look for late poses, a loose board or a wrong flange",
            )
        )
    if sigma > 0.005:
        out.append(
            Finding(
                "uncertain",
                "warning",
                f"a point 1.0-1.5 m away would be off by about {1e3 * sigma:.0f} mm",
                "take more views, tilted by 20-40 deg about different axes, over the whole image",
            )
        )
    return out


def _left_out(answer: Calibration, problem: Problem, names: Sequence[str]) -> list[Finding]:
    """Boards that the rest of the data contradict: a few are named, many are a mistake."""
    gone = {(s.view, s.lens) for s, _ in answer.rejected}
    total = len({(s.view, s.lens) for s in problem.sightings})
    if not gone:
        return []
    views = sorted({v for v, _ in gone})
    shown = names_of([names[v] if v < len(names) else str(v) for v in views])
    if len(gone) > 0.3 * total:
        return [
            Finding(
                "mostly_left_out",
                "error",
                f"{len(gone)} of {total} boards contradict the others and were left out ({shown}): "
                "what is left may be the wrong part",
                "look for two recordings in one folder, pictures and poses that do not belong "
                "together, or a board that moved",
            )
        ]
    return [
        Finding(
            "outlier",
            "warning" if len(gone) > 0.1 * total else "note",
            f"{shown}: left out, the others contradict it ({answer.rejected[0][1]})",
            "look at its picture and its pose",
        )
    ]
