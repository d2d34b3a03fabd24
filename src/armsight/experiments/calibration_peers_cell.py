"""The synthetic cell of the comparison: truth, bounds, ellipsoids, rasters and chosen views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, JointPath
from armsight.calibration import arm, se3, views
from armsight.calibration.calibrate import (
    Calibration,
    CalibrationOptions,
    calibrate,
    target_points,
)
from armsight.calibration.covariance import point_derivatives
from armsight.calibration.live.paper import PaperSchedule
from armsight.calibration.model import Model, State
from armsight.calibration.problem import Freedom, Problem, lens_from_vector
from armsight.calibration.solver import Solution, normal_equations
from armsight.calibration.synthetic import (
    SyntheticCell,
    observe,
    random_views,
    target_error,
    true_flanges,
)
from armsight.geometry.pose import inverse, make_pose

QUICK = CalibrationOptions(left_out=False)
LENSES = {"infrared": (0, 2, 4), "colour": (1, 3, 5)}


def errors(cell: SyntheticCell, answer: Calibration) -> list[float]:
    """True target error of each lens [m]."""
    state = answer.solution.state
    return [target_error(cell, state, k) for k in range(len(cell.sheet.lenses))]


def raster_views(cell: SyntheticCell, count: int) -> JointPath:
    """T1's trajectory: rings outward from each image's centre, again 20 % farther, tilts in turn.

    The board is tilted by 30 deg about its axes in turn, as T1's tilt limits allow; views that the
    arm cannot reach, or that the camera would not see whole, are skipped, camera by camera.
    """
    limits = np.deg2rad(np.array([[-30.0, 30.0], [-30.0, 30.0], [-45.0, 45.0]])) / 0.8
    places = PaperSchedule(stages=3).views(limits)
    middle = 0.5 * (cell.points.max(0) + cell.points.min(0))
    rng = np.random.default_rng(0)
    found: list[list[Floats]] = []
    for rig in range(len(cell.sheet.rigs)):
        index = next(i for i, lens in enumerate(cell.sheet.lenses) if lens.rig == rig)
        lens = cell.sheet.lenses[index].camera
        half = 0.5 * np.array([lens.width - 1, lens.height - 1])
        targets = []
        for place, distance, tilt in places:
            ray = np.append(lens.normalise((half + place * half)[None])[0], 1.0)
            turn = se3.exps(np.array([[0, 0, 0, *tilt]]))[0]
            T = make_pose(None, ray * distance) @ turn @ make_pose(None, -middle)
            T_base_lens = cell.state.T_mount_rig[rig] @ cell.state.T_rig_lens[index]
            targets.append(T_base_lens @ T @ inverse(cell.T_flange_board_guess))
        q, ok = arm.reach_some(cell.robot, np.array(targets), rng)
        q = q[ok]
        seen = {s.view for s in observe(cell, q, rng).sightings if s.lens == index}
        mine = [q[k] for k in range(len(q)) if k in seen]
        # All over the schedule when there are more than a camera's share.
        share = -(-count // len(cell.sheet.rigs))
        pick = np.unique(np.linspace(0, len(mine) - 1, min(share, len(mine))).round().astype(int))
        found.append([mine[k] for k in pick])
    return np.array([q for views_of in found for q in views_of])[:count]


def truth_state(cell: SyntheticCell, problem: Problem) -> State:
    """The truth as a state of a problem."""
    return replace(cell.state, E=np.tile(np.eye(4), (len(problem.views), 1, 1)))


def with_true_lenses(cell: SyntheticCell, problem: Problem) -> Problem:
    """The same data with lenses known before: exact numbers, kept, and known offsets."""
    lenses = tuple(
        replace(
            lens,
            camera=lens_from_vector(cell.state.lens[k], lens.camera.width, lens.camera.height),
            T_rig_lens=cell.state.T_rig_lens[k],
            offset_free=False,
            keep=True,
        )
        for k, lens in enumerate(problem.lenses)
    )
    return replace(problem, lenses=lenses)


def bound_errors(cell: SyntheticCell, problem: Problem, truth: State, freedom: Freedom) -> Floats:
    """(L,) Cramer-Rao bound of each lens's target error [m], the true noise without outliers."""
    covariance = views.truth_bound(problem, truth, freedom)
    model = Model(problem, freedom)
    solution = solve_at(model, truth)
    out = []
    for lens, definition in enumerate(cell.sheet.lenses):
        D = point_derivatives(solution, lens, *target_points(definition.camera))
        out.append(np.sqrt(np.einsum("tig,gh,tih->", D, covariance, D, optimize=True) / len(D)))
    return np.array(out)


def solve_at(model: Model, state: State) -> Solution:
    """A solution object at a state, without moving it."""
    normal, residual = normal_equations(model, state, np.inf)
    return Solution(model, state, normal, residual, 0, True)


def ellipsoids(cell: SyntheticCell, answer: Calibration) -> tuple[list[bool], list[bool]]:
    """Whether the 95 % ellipsoids of camera poses (6) and of points (3) hold the truth."""
    state = answer.solution.state
    poses, points = [], []
    for rig in range(len(cell.sheet.rigs)):
        error = se3.logs(inverse(state.T_mount_rig[rig])[None] @ cell.state.T_mount_rig[rig])[0]
        C = answer.covariance.camera_pose(rig)
        poses.append(bool(error @ np.linalg.solve(C, error) < 12.592))
    for lens, definition in enumerate(cell.sheet.lenses):
        pixels, z = target_points(definition.camera)
        C = answer.covariance.points(lens, pixels, z)
        found = [mapped(cell, s, lens, pixels, z) for s in (state, cell.state)]
        d = found[0] - found[1]
        q = np.einsum("ti,ti->t", d, np.linalg.solve(C, d[..., None])[..., 0])
        points += [bool(x) for x in q < 7.815]
    return poses, points


def mapped(cell: SyntheticCell, state: State, lens: int, pixels: Floats, z: Floats) -> Floats:
    """(t, 3) points in the base [m] by pixel and depth."""
    definition = cell.sheet.lenses[lens]
    camera = lens_from_vector(state.lens[lens], definition.camera.width, definition.camera.height)
    ray = np.column_stack([camera.normalise(pixels), np.ones(len(z))]) * z[:, None]
    T = state.T_mount_rig[definition.rig] @ state.T_rig_lens[lens]
    return np.asarray(ray @ T[:3, :3].T + T[:3, 3])


def chosen_views(
    cell: SyntheticCell, seed: int, counts: tuple[int, ...], start: int = 6
) -> dict[str, list[float]]:
    """True target error of each lens after so many views: a few random ones, then chosen.

    Chosen as the live procedure does, but without regard to the way there: views are counted here.
    """
    rng = np.random.default_rng((seed, 2))
    joints: JointPath = random_views(cell, start, rng)
    flanges = true_flanges(cell, joints, rng)
    out: dict[str, list[float]] = {}
    noise_seed = int(rng.integers(1 << 30))
    S = W = None
    answer: Calibration | None = None
    while True:
        if S is None or len(joints) % 3 == 0 or len(joints) in counts:
            problem = observe(cell, joints, np.random.default_rng(noise_seed), flanges)
            answer = calibrate(problem, np.random.default_rng(0), QUICK)
            solution = answer.solution
            S = solution.normal.reduced()
            W = views.target_weight(solution, solution.normal.free)
        assert answer is not None
        assert W is not None
        solution = answer.solution
        if len(joints) in counts:
            out[str(len(joints))] = errors(cell, answer)
        if len(joints) >= max(counts):
            return out
        found = views.propose(answer.problem, solution.state, cell.robot, rng, 60, near=joints[-1])
        offers = views.information(
            answer.problem,
            solution.state,
            answer.freedom,
            cell.robot,
            found,
            sigma=answer.corner_sigma(),
        )
        best = views.choose(S, W, offers, np.ones(len(found)))
        S = S + offers.information[best.index]
        pick = found[best.index][None]
        joints = np.concatenate([joints, pick])
        flanges = np.concatenate([flanges, true_flanges(cell, pick, rng)])
