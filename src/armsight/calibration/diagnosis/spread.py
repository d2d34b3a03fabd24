"""Views that are too few or too much alike, and a lens of another resolution."""

from __future__ import annotations

import numpy as np

from armsight.calibration import se3
from armsight.calibration.covariance import FEW
from armsight.calibration.diagnosis.reading import Item
from armsight.calibration.findings import Finding
from armsight.calibration.lens import zhang
from armsight.calibration.problem import Problem
from armsight.calibration.start import arm_for

LEAST = 4
"""Views below which none checks another: with three, readings of the poses that put the camera
metres away fit to a pixel, too."""


def view_findings(problem: Problem, rig: int, items: list[Item]) -> list[Finding]:
    """Too few views, or views too much alike, to tell the unknowns apart."""
    name = problem.rigs[rig].name
    out = []
    if len(items) < LEAST:
        return [
            Finding(
                "few_views",
                "error",
                f"camera {name} saw the board in {len(items)} views; {LEAST} are the least, and "
                "fifteen are good",
                "take more views, and turn the board about all three axes",
            )
        ]
    A = arm_for(problem, rig)[[v for v, _, _ in items]]
    i, j = np.triu_indices(len(A), 1)
    turns = se3.logs(se3.inverses(A[i]) @ A[j])[:, 3:]
    angle = np.linalg.norm(turns, axis=1)
    largest = float(np.rad2deg(angle.max()))
    if largest < 10:
        return [
            Finding(
                "alike",
                "error",
                f"camera {name}: the arm turns by at most {largest:.1f} deg between the views",
                "turn the board by 30 deg or more about different axes between views",
            )
        ]
    # Turns about one axis leave the direction along it unknown.
    spread = np.linalg.svd(turns[angle > np.deg2rad(5)], compute_uv=False)
    second = float(spread[1] / spread[0])
    if second < 0.08:
        out.append(
            Finding(
                "one_axis",
                "error",
                f"camera {name}: all turns are about one axis; the position along it is unknown",
                "turn the board about a second axis by 30 deg or more in some views",
            )
        )
    elif largest < 25 or len(items) < FEW:
        out.append(
            Finding(
                "few_views",
                "warning",
                f"camera {name}: {len(items)} views with at most {largest:.0f} deg of turn",
                "take fifteen views with turns of 30 deg or more about all axes",
            )
        )
    return out


def resolution_findings(problem: Problem, rig: int) -> list[Finding]:
    """A lens that was given for images of another size, told by the board alone."""
    out = []
    for index, lens in enumerate(problem.lenses):
        mine = [s for s in problem.sightings if s.lens == index]
        if lens.rig != rig or len(mine) < 4:
            continue
        points = [problem.boards[s.board].points[s.corner] for s in mine]
        pixels = [s.pixel for s in mine]
        outside = max(float(p.max(0)[0]) for p in pixels) / lens.camera.width
        found = zhang(points, pixels, lens.camera.width, lens.camera.height)
        if outside > 1.02:  # the middle is wrong then: take that of an image that holds all
            grow = 2 ** np.ceil(np.log2(outside))
            found = zhang(
                points, pixels, int(lens.camera.width * grow), int(lens.camera.height * grow)
            )
        if found is None:
            continue
        ratio = found.fx / lens.camera.fx
        for factor in (0.25, 1 / 3, 0.5, 2 / 3, 1.5, 2.0, 3.0, 4.0):
            if abs(np.log(ratio / factor)) < 0.12:
                out.append(
                    Finding(
                        "lens_resolution",
                        "error",
                        f"lens {lens.name} belongs to another resolution: the images want a focal "
                        f"length {ratio:.2f} times that given",
                        f"scale the lens by {factor:.3g}, or give that of this image size",
                    )
                )
    return out
