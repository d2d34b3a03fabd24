"""Boards in a camera's most used lens, as the diagnoses look at them."""

from __future__ import annotations

from armsight.calibration.problem import Problem, Sighting
from armsight.calibration.start import PlanarPose
from armsight.calibration.start import planar_poses as planar

Item = tuple[int, PlanarPose, Sighting]
"""View, poses of the board in the lens, what was seen."""


def items_of(problem: Problem, rig: int) -> list[Item]:
    """Board poses in a rig's most used lens, arm views only."""
    count: dict[int, int] = {}
    for s in problem.sightings:
        if problem.lenses[s.lens].rig == rig and not problem.views[s.view].free:
            count[s.lens] = count.get(s.lens, 0) + 1
    if not count:
        return []
    lens = max(count, key=lambda k: count[k])
    out: list[Item] = []
    for s in problem.sightings:
        if s.lens == lens and not problem.views[s.view].free:
            p = planar(
                problem.lenses[lens].camera, problem.boards[s.board].points[s.corner], s.pixel
            )
            if p is not None:
                out.append((s.view, p, s))
    return out
