"""Mistakes that show before anything is solved: views that cannot tell, lenses of another size."""

from __future__ import annotations

from collections.abc import Sequence

from armsight.calibration.diagnosis.reading import items_of
from armsight.calibration.diagnosis.spread import resolution_findings, view_findings
from armsight.calibration.findings import Finding
from armsight.calibration.problem import Problem


def diagnose_start(problem: Problem, rig: int, names: Sequence[str] = ()) -> list[Finding]:
    """Views too few or too much alike, and a lens that belongs to pictures of another size.

    Args:
        problem: with sightings and arm poses as read.
        rig: the camera.
        names: of the views.
    """
    items = items_of(problem, rig)
    return view_findings(problem, rig, items) + resolution_findings(problem, rig)
