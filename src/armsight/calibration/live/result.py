"""The end: everything solved at once with the left-out test, and the depth models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.calibration.calibrate import Calibration, CalibrationOptions, calibrate
from armsight.calibration.depth import DepthSamples, fit_depth, plane_depth
from armsight.calibration.findings import Finding
from armsight.calibration.live.seen import SeenView, problem_of
from armsight.calibration.live.setup import Setup
from armsight.calibration.problem import Problem
from armsight.devices.depth_model import DepthModel
from armsight.geometry.pose import inverse


@dataclass(frozen=True)
class LiveResult:
    """What the procedure ends with.

    Attributes:
        calibration: lenses, cameras, board, arm.
        depth: of each camera, or None.
        views: all that were taken.
        findings: cameras without enough views and why, cameras that hang upside down.
        stopped: why it ended.
    """

    calibration: Calibration
    depth: tuple[DepthModel | None, ...]
    views: tuple[SeenView, ...]
    findings: tuple[Finding, ...]
    stopped: str


def finish(
    setup: Setup, views: Sequence[SeenView], rng: np.random.Generator, stopped: str = ""
) -> LiveResult:
    """Solve all views with the left-out test, then the depth models."""
    problem = problem_of(setup, views)
    answer = calibrate(problem, rng, CalibrationOptions())
    findings = (*_unseen(setup, problem, views), *_upside_down(answer))
    return LiveResult(
        answer, depth_models(setup, answer, views), tuple(views), tuple(findings), stopped
    )


def _unseen(setup: Setup, problem: Problem, views: Sequence[SeenView]) -> list[Finding]:
    """Cameras that saw the board never, or too seldom, and why."""
    out = []
    for index, camera in enumerate(setup.cameras):
        lenses = {k for k, lens in enumerate(problem.lenses) if lens.rig == index}
        count = len({s.view for s in problem.sightings if s.lens in lenses})
        if count >= 3:
            continue
        reasons = [reason for v in views for k, reason in v.missed if k in lenses]
        why = f" (mostly: {max(set(reasons), key=reasons.count)})" if reasons else ""
        times = "never saw the board" if count == 0 else f"saw the board in {count} views only"
        out.append(
            Finding(
                "camera_unseen",
                "warning",
                f"camera {camera.name} {times}{why}; three views are the least",
                "turn it towards the arm, or check its picture, the light and the board's kind",
            )
        )
    return out


def _upside_down(answer: Calibration) -> list[Finding]:
    """Cameras whose picture stands on its head: fine for the solve, worth knowing for people."""
    seen = {answer.problem.lenses[s.lens].rig for s in answer.problem.sightings}
    return [
        Finding(
            "upside_down",
            "note",
            f"camera {rig.name} hangs upside down",
            "nothing to do: its pose says so; turn its picture where people look at it",
        )
        for index, rig in enumerate(answer.problem.rigs)
        if index in seen and rig.mount == "base" and answer.camera_pose(index)[2, 1] > 0.5
    ]


def depth_models(
    setup: Setup, answer: Calibration, views: Sequence[SeenView]
) -> tuple[DepthModel | None, ...]:
    """Depth model of each camera from the boards' solved places."""
    out = []
    arms, _ = answer.solution.model.arm_poses(answer.solution.state)
    for index, camera in enumerate(setup.cameras):
        lens_index = answer.main_lens(index)
        lens = answer.lens(lens_index)
        if camera.depth_scale != 1.0:
            lens = lens.scaled(1 / camera.depth_scale)
        samples = []
        seen = {s.view for s in answer.problem.sightings if s.lens == lens_index}
        for v, view in enumerate(views):
            if v not in seen:
                continue
            for c, pixel, z in view.depth:
                if c != index or not len(z):
                    continue
                T = inverse(answer.camera_pose(index)) @ arms[v] @ answer.board_pose()
                true = plane_depth(T, pixel, lens)
                samples.append(DepthSamples(pixel, z, true, np.full(len(z), 0.0015)))
        out.append(fit_depth(samples, lens))
    return tuple(out)
