"""Calibration in numbers: against the bound, against OpenCV, honest ellipsoids, chosen views.

Everything runs in the synthetic cell (known truth, the error models of the design page's section 4,
corners without images), so that dozens of calibrations fit in minutes. The rendered procedure has
experiments of its own.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from armsight.arrays import Floats, JointPath, Poses
from armsight.calibration import se3, views
from armsight.calibration.calibrate import (
    Calibration,
    CalibrationOptions,
    calibrate,
    target_points,
)
from armsight.calibration.covariance import point_derivatives
from armsight.calibration.model import Model, State
from armsight.calibration.problem import Freedom, Problem, lens_from_vector
from armsight.calibration.solver import Solution, normal_equations, solve
from armsight.calibration.start import planar_poses
from armsight.calibration.synthetic import (
    ErrorLevels,
    SyntheticCell,
    make_cell,
    observe,
    random_views,
    target_error,
    true_flanges,
)
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row
from armsight.geometry.pose import inverse
from armsight.robots import load_robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

QUICK = CalibrationOptions(left_out=False)
LENSES = {"infrared": (0, 2, 4), "colour": (1, 3, 5)}


@dataclass
class Run:
    """One seed's figures: true errors [m], bounds [m], peers [m], ellipsoids hit."""

    random: Floats
    raster: Floats
    known: Floats
    chosen: dict[int, Floats]
    bound: Floats
    bound_known: Floats
    inside: list[bool]
    inside_points: list[bool]
    peers: dict[str, float]
    ours: float
    peers_three: dict[str, Floats]
    solve_s: float


def one(seed: int, full: bool) -> Run:
    """All figures of one seed; ``full`` adds the chosen views, which take longest."""
    rng = np.random.default_rng((seed, 0))
    cell = make_cell(load_robot("ur5"), rng)
    joints = random_views(cell, 45, rng)
    problem = observe(cell, joints, rng)
    answer = calibrate(problem, rng, QUICK)
    n = len(cell.sheet.lenses)
    raster = calibrate(problem.only_views(range(30)), rng, QUICK)
    known_problem = with_true_lenses(cell, problem)
    known = calibrate(known_problem, rng, replace(QUICK, solve_lenses=False))
    white = cell.levels.pose
    truth = truth_state(cell, problem)
    everything = Freedom(lens=True, robot=True, white=white)
    bound = bound_errors(cell, problem, truth, everything)
    bound_known = bound_errors(cell, known_problem, truth, replace(everything, lens=False))
    inside, inside_points = ellipsoids(cell, answer)
    peers, ours = against_opencv(cell, seed)
    peers_three = opencv_errors(cell, known_problem)
    chosen = chosen_views(cell, seed, (10, 12, 15, 20, 30) if full else ()) if full else {}
    start = time.process_time()
    model = Model(answer.problem, answer.freedom)
    solve(model)
    return Run(
        np.array([target_error(cell, answer.solution.state, k) for k in range(n)]),
        np.array([target_error(cell, raster.solution.state, k) for k in range(n)]),
        np.array([target_error(cell, known.solution.state, k) for k in range(n)]),
        chosen,
        bound,
        bound_known,
        inside,
        inside_points,
        peers,
        ours,
        peers_three,
        time.process_time() - start,
    )


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


HAND_EYE = {
    "Tsai": cv2.CALIB_HAND_EYE_TSAI,
    "Park": cv2.CALIB_HAND_EYE_PARK,
    "Horaud": cv2.CALIB_HAND_EYE_HORAUD,
    "Andreff": cv2.CALIB_HAND_EYE_ANDREFF,
    "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
ROBOT_WORLD = {
    "Shah": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    "Li": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI,
}


def opencv_poses(A: Poses, C: Poses) -> dict[str, Floats]:
    """``T_base_camera`` by each of OpenCV's solvers (methods are named, never positional)."""
    out: dict[str, Floats] = {}
    inverted = se3.inverses(A)  # for a fixed camera OpenCV wants the base in the flange
    for name, method in HAND_EYE.items():
        try:
            R, t = cv2.calibrateHandEye(
                list(inverted[:, :3, :3]),
                list(inverted[:, :3, 3]),
                list(C[:, :3, :3]),
                list(C[:, :3, 3]),
                method=method,
            )
        except cv2.error:
            continue
        out[name] = _pose(R, t)
    for name, method in ROBOT_WORLD.items():
        try:
            # A X = Z B with A = T_camera_board, B = T_base_flange: Z is the base in the camera.
            *_, R, t = cv2.calibrateRobotWorldHandEye(
                list(C[:, :3, :3]),
                list(C[:, :3, 3]),
                list(A[:, :3, :3]),
                list(A[:, :3, 3]),
                method=method,
            )
        except cv2.error:
            continue
        out[name] = inverse(_pose(R, t))
    return out


def _pose(R: Floats, t: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def opencv_errors(cell: SyntheticCell, problem: Problem) -> dict[str, Floats]:
    """Target error of each OpenCV solver, (cameras,): each camera by its colour corners alone."""
    errors: dict[str, list[float]] = {}
    state = truth_state(cell, problem)
    for lens in LENSES["colour"]:
        rig = problem.lenses[lens].rig
        camera = problem.lenses[lens].camera
        A, C = [], []
        for s in problem.sightings:
            if s.lens != lens:
                continue
            found = planar_poses(camera, problem.boards[0].points[s.corner], s.pixel)
            if found is not None and found.rms_px[0] < 2.0:
                A.append(problem.views[s.view].T_base_flange)
                C.append(found.T_lens_board[0])
        if len(A) < 3:
            continue
        for name, T in opencv_poses(np.array(A), np.array(C)).items():
            poses = cell.state.T_mount_rig.copy()
            poses[rig] = T @ inverse(cell.state.T_rig_lens[lens])
            error = target_error(cell, replace(state, T_mount_rig=poses), lens)
            errors.setdefault(name, []).append(error)
    return {name: np.array(e) for name, e in errors.items()}


def against_opencv(
    cell: SyntheticCell, seed: int, count: int = 15
) -> tuple[dict[str, float], float]:
    """Target error of every OpenCV solver and ours: one camera, true lens known, same corners."""
    rng = np.random.default_rng((seed, 1))
    alone = replace(cell, levels=replace(cell.levels, wrong_boards=0.0))
    joints = random_views(alone, count, rng, cameras=(0,))
    problem = with_true_lenses(alone, observe(alone, joints, rng)).only_lenses([1])
    ours = calibrate(problem, rng, replace(QUICK, solve_lenses=False))
    theirs = {name: float(e[0]) for name, e in opencv_errors(alone, problem).items()}
    return theirs, target_error(alone, ours.solution.state, 1)


def chosen_views(
    cell: SyntheticCell, seed: int, counts: tuple[int, ...], start: int = 6
) -> dict[int, Floats]:
    """True target errors (L,) after so many views: a few random ones, then chosen."""
    rng = np.random.default_rng((seed, 2))
    joints: JointPath = random_views(cell, start, rng)
    flanges = true_flanges(cell, joints, rng)
    out: dict[int, Floats] = {}
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
            out[len(joints)] = np.array(
                [target_error(cell, solution.state, k) for k in range(len(cell.sheet.lenses))]
            )
        if len(joints) >= max(counts):
            return out
        found = views.propose(answer.problem, solution.state, cell.robot, rng, 60, near=joints[-1])
        offers = views.information(
            answer.problem, solution.state, answer.freedom, cell.robot, found
        )
        seconds = views.travel_seconds(cell.robot, joints[-1], found, 0.5, 0.6) + 0.5
        best = views.choose(S, W, offers, seconds)
        S = S + offers.information[best.index]
        pick = found[best.index][None]
        joints = np.concatenate([joints, pick])
        flanges = np.concatenate([flanges, true_flanges(cell, pick, rng)])


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """All figures over ``runs`` seeds."""
    done: list[Run] = []
    for k in range(runs):
        progress(f"seed {seed + k}", k / runs)
        # Chosen views take most of the time: a quarter of the seeds, five at least.
        done.append(one(seed + k, full=k < max(5, runs // 4)))
    progress("tables", 1.0)
    return outcome(done)


def outcome(done: list[Run]) -> Outcome:
    """The rows."""
    rows: list[Row] = []
    budget = {"must": 2.5, "aim": 1.2, "paper": 10.0}
    budget_known = {"must": 1.2, "aim": 0.5, "paper": 10.0}
    with_chosen = [r for r in done if r.chosen]
    for name, lenses in LENSES.items():
        at = list(lenses)
        rows.append(
            _row(
                "tre_mm",
                TRE,
                f"15 random poses a camera, {name} lens",
                [1e3 * r.random[at].mean() for r in done],
                "mm",
                **budget,
            )
        )
        for count in (15, 30):
            rows.append(
                _row(
                    "tre_mm",
                    TRE,
                    f"{count} chosen poses for all three, {name} lens",
                    [1e3 * r.chosen[count][at].mean() for r in with_chosen],
                    "mm",
                    **budget,
                )
            )
        rows.append(
            _row(
                "tre_known_lenses_mm",
                TRE,
                f"15 random poses a camera, {name} lens",
                [1e3 * r.known[at].mean() for r in done],
                "mm",
                **budget_known,
            )
        )
    ratio, ratio_known = (
        float(
            np.sqrt(
                np.mean([np.mean(r_error(r) ** 2) for r in done])
                / np.mean([np.mean(r_bound(r) ** 2) for r in done])
            )
        )
        for r_error, r_bound in (
            (attrgetter("random"), attrgetter("bound")),
            (attrgetter("known"), attrgetter("bound_known")),
        )
    )
    measure = "rms true target error over the Cramer-Rao bound of the same views, outliers on"
    rows.append(
        Row("bound_ratio", measure, "lenses solved too", ratio, "1", n=len(done), must=1.5, aim=1.1)
    )
    rows.append(
        Row(
            "bound_ratio", measure, "lenses known", ratio_known, "1", n=len(done), must=1.5, aim=1.1
        )
    )
    for condition, values in (
        ("camera poses (6 numbers)", [x for r in done for x in r.inside]),
        ("points 1.0-1.5 m away (3 numbers)", [x for r in done for x in r.inside_points]),
    ):
        rows += _coverage(condition, values, len(done))
    color = list(LENSES["colour"])
    rows += _peers(
        "three cameras, 15 poses each, true lenses known",
        [{n: float(e.mean()) for n, e in r.peers_three.items()} for r in done],
        [float(r.known[color].mean()) for r in done],
    )
    rows += _peers(
        "one camera alone, 15 poses, true lens known",
        [r.peers for r in done],
        [r.ours for r in done],
    )
    if with_chosen:
        rows.append(_gain(with_chosen))
    rows.append(
        _row(
            "solve_s",
            "processor time of one solve, three cameras of two lenses, 45 views",
            "lenses, arm, print and poses",
            [r.solve_s for r in done],
            "s",
            must=10.0,
            aim=2.0,
        )
    )
    notes = (
        "True errors in a synthetic cell; the truth only scores. `tre_mm` is the 3D rms error in "
        "the base of points given by pixel and true depth, over the whole image at 1.0-1.5 m.",
    )
    return Outcome(tuple(rows), {"errors": lambda: plot(done)}, notes)


TRE = "true 3D error in the base of a point 1.0-1.5 m away, mean over three cameras"


def _row(
    key: str, measure: str, condition: str, values: list[float], unit: str, **budget: Any
) -> Row:
    v = np.array(values)
    return Row(
        key,
        measure,
        condition,
        float(np.mean(v)),
        unit,
        n=len(v),
        low=float(np.quantile(v, 0.025)),
        high=float(np.quantile(v, 0.975)),
        **budget,
    )


def _coverage(condition: str, values: list[bool], seeds: int) -> list[Row]:
    share = float(np.mean(values))
    measure = "share of 95 % ellipsoids that hold the truth (must 88-99 %, aim 93-97 %)"
    # Seeds are independent, an answer's cameras hardly: the interval counts seeds.
    half = 1.96 * np.sqrt(max(share * (1 - share), 0.25 / seeds) / seeds)
    return [
        Row(
            "coverage_95",
            measure,
            condition,
            100 * share,
            "%",
            n=len(values),
            low=100 * max(share - half, 0.0),
            high=100 * min(share + half, 1.0),
            must=88.0,
            aim=93.0,
            better="higher",
        ),
        Row(
            "coverage_95_above",
            "the same figure against its upper end",
            condition,
            100 * share,
            "%",
            n=len(values),
            must=99.0,
            aim=97.0,
        ),
    ]


def _peers(condition: str, theirs: list[dict[str, float]], ours: list[float]) -> list[Row]:
    names = sorted({n for r in theirs for n in r})
    medians = {n: float(np.median([r.get(n, np.inf) for r in theirs])) for n in names}
    best = min(medians, key=lambda n: medians[n])
    mine = float(np.median(ours))
    measure = "our median target error over that of OpenCV's best hand-eye solver, same corners"
    rows = [
        Row(
            "peer_ratio",
            measure,
            f"{condition}; best of OpenCV: {best}",
            mine / medians[best],
            "1",
            n=len(ours),
            must=0.5,
            aim=0.25,
        )
    ]
    for name, value in (*medians.items(), ("armsight", mine)):
        rows.append(
            Row(
                "peer_mm",
                "median target error",
                f"{name}, {condition}",
                1e3 * value,
                "mm",
                n=len(ours),
            )
        )
    return rows


def _gain(chosen: list[Run]) -> Row:
    """Chosen views (for all cameras at once) that reach the accuracy of random ones."""
    wanted = float(np.mean([np.mean(r.raster) for r in chosen]))
    counts = sorted(chosen[0].chosen)
    means = [float(np.mean([np.mean(r.chosen[c]) for r in chosen])) for c in counts]
    value = float(next((c for c, m in zip(counts, means) if m <= wanted), 2 * counts[-1]))
    return Row(
        "active_gain",
        "chosen views, all cameras at once, for the accuracy of 30 that a careful user takes",
        f"30 user views {1e3 * wanted:.2f} mm; chosen "
        + ", ".join(f"{c}: {1e3 * m:.2f}" for c, m in zip(counts, means)),
        value,
        "views",
        n=len(chosen),
        must=20,
        aim=10,
    )


def plot(done: list[Run]) -> Figure:
    """Errors of ours, of the bound and of OpenCV's solvers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4))
    axes = figure.subplots()
    names = sorted({n for r in done for n in r.peers})
    data = [[1e3 * r.peers[n] for r in done if n in r.peers] for n in names]
    data.append([1e3 * r.ours for r in done])
    axes.boxplot(data, tick_labels=[*names, "armsight"], whis=(5, 95))
    axes.set_yscale("log")
    axes.set_ylabel("true target error [mm]")
    axes.set_title("same corners, one camera, 15 poses, lens known")
    return figure


EXPERIMENT = Experiment(
    "calibration-peers",
    "Calibration against the bound and against OpenCV, same corners",
    run,
    runs=20,
    about=(
        "Three cameras about a UR5 (T1's cell), corners with the noise and outliers of real "
        "detectors, an arm with absolute errors, a board with print errors. Lenses start from the "
        "maker's sheet."
    ),
)

__all__ = ["EXPERIMENT", "ErrorLevels", "run"]
