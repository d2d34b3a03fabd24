"""Mistakes in how poses and images were written down (design page, 5.8).

Each mistake leaves a sign. Angles between views survive an inversion, a wrong unit or a wrong board
size; they do not survive a wrong rotation format or a wrong pairing. So every other reading of the
poses is tried, and one that fits several times better names the mistake.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Poses
from armsight.calibration import se3
from armsight.calibration.diagnosis.flips import some_flipped, turned_boards
from armsight.calibration.diagnosis.order import other_orders
from armsight.calibration.diagnosis.raw_poses import RawPoses, other_rotations
from armsight.calibration.diagnosis.reading import BETTER, Fit, Item, fit_reading, items_of
from armsight.calibration.diagnosis.scale import scale_finding, unit_scale
from armsight.calibration.diagnosis.spread import resolution_findings, view_findings
from armsight.calibration.findings import Finding
from armsight.calibration.problem import Problem
from armsight.calibration.start import arm_for


def diagnose_start(
    problem: Problem, rig: int, raw: RawPoses | None = None, seed: int = 0
) -> list[Finding]:
    """Mistakes in how poses and images were written down.

    Args:
        problem: with sightings and arm poses as read.
        rig: the camera.
        raw: the poses as they stood in the file, to try other formats.
        seed: of the random samples.
    """
    name = problem.rigs[rig].name
    items = items_of(problem, rig)
    findings = view_findings(problem, rig, items) + resolution_findings(problem, rig)
    if len(items) < 3 or any(f.code == "lens_resolution" for f in findings):
        return findings
    A = arm_for(problem, rig)
    asis = fit_reading(A, items, problem, seed)
    if asis is None:
        return findings
    focal = problem.lenses[items[0][2].lens].camera.fx
    if asis.median_px < max(2.0, 0.004 * focal):
        return findings + some_flipped(problem, items, asis, A)
    trials: list[tuple[Fit, Finding]] = []

    def consider(poses: Poses, pairs: list[Item], finding: Finding) -> None:
        fit = fit_reading(poses, pairs, problem, seed)
        if fit is not None:
            trials.append((fit, finding))

    hand = problem.rigs[rig].mount == "flange"
    place = "on the flange" if hand else "beside the robot"
    other = "beside the robot" if hand else "on the flange"
    consider(
        se3.inverses(A),
        items,
        Finding(
            "pose_inverted",
            "error",
            f"the poses fit only when inverted: they map base to flange, or camera {name} stands "
            f"{other} and not {place}",
            "write T_base_flange (the flange in the base), and say where the camera is mounted",
        ),
    )
    if raw is not None:
        for code, words, cure, poses in other_rotations(raw):
            P = poses if not hand else se3.inverses(poses)
            consider(P, items, Finding(code, "error", f"{words}: so read, the data fit", cure))
            consider(
                se3.inverses(P),
                items,
                Finding(
                    code,
                    "error",
                    f"{words}, and the poses are inverted: so read, the data fit",
                    cure,
                ),
            )
    for finding, permuted in other_orders(items):
        consider(A, permuted, finding)
    scale = unit_scale(A, items)
    if scale is not None:
        scaled = A.copy()
        scaled[:, :3, 3] *= scale
        consider(scaled, items, scale_finding(scale, problem, items))
    flipped = turned_boards(problem, items, asis, A)
    if flipped is not None:
        consider(A, flipped[1], flipped[0])
    if trials:
        fit, finding = min(trials, key=lambda t: t[0].median_px)
        if fit.median_px * BETTER < asis.median_px and fit.median_px < 0.02 * focal:
            detail = f" ({asis.median_px:.0f} px as read, {fit.median_px:.1f} px so)"
            return [*findings, replace(finding, message=finding.message + detail)]
    if asis.median_px > 0.03 * focal:
        words = (
            f"arm and board turn by different angles between the views (by "
            f"{np.rad2deg(asis.angle_gap):.1f} deg)"
            if asis.angle_gap > np.deg2rad(2)
            else "angles agree but positions do not"
        )
        findings.append(
            Finding(
                "poses_do_not_match",
                "error",
                f"camera {name}: poses and images do not belong together: {words}, "
                f"{asis.median_px:.0f} px",
                "check that each image was taken at its pose, with the arm at rest",
            )
        )
    return findings
