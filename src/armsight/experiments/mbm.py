"""``mbm``: MotionBenchMaker's problems through depth pictures; every path checked at 1 mm."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector, Pose, Vector3
from armsight.experiments.cache import RunCache
from armsight.experiments.depth_scene import depth_image, look_at, snapshot_of, voxels_seen
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.motion_bench import (
    ROBOTS,
    Problem,
    find_data,
    load_bench_robot,
    load_problems,
)
from armsight.experiments.rows import Row, wilson
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.snapshot import VoxelGrid, WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.data import JointGoal, PlanRequest
from armsight.motion.nearest import MovingBody
from armsight.motion.obstacles import CollisionConfig
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VOXEL = 0.005
"""Edge of a voxel of the planning grid [m]."""
HALF = 0.95
"""The grid reaches this far from the arm's base sideways [m],"""
BELOW, ABOVE = 0.6, 1.1
"""and this far down and up from the shoulder [m]."""
SHOULDER = {"ur5": 1.0, "panda": 0.333}
"""Height of the second joint in the frame of the problems [m]."""
LENS = PinholeCamera.from_fov(640, 480, np.deg2rad(70.0), np.deg2rad(55.0))
RING = 1.3
"""Distance of the cameras from the shoulder [m]."""
TIME = 2.0
"""Time limit of one plan [s]; a second is ``PlannerConfig.looks_per_second`` looks."""
STEP = 0.001
"""Paths are checked so often along the way of their fastest sphere [m]."""
POLICIES = {"unseen is solid": True, "unseen is free": False}

ABOUT = f"""
MotionBenchMaker's UR5 and Panda problems (Chamzas et al. 2022; `shared/data/motion`), seven sets of
50 each, planned from depth pictures: ten perfect cameras (640x480, no noise) in a ring of
{RING:.1f} m about the shoulder see the scene without the arm; a grid of {1e3 * VOXEL:.0f} mm is
occupied where a point lies, free only where a picture saw through the whole voxel, and unknown
elsewhere. Both policies for unknown voxels are shown. A run is one problem, the sets in turn.

Solvable is a problem whose start and goal touch nothing by exact geometry, with the spheres of the
problems' own robot files. A path is invalid if at any place of the motion, looked at every
millimetre of its fastest sphere, a sphere meets the exact scene, or the arm leaves its limits. The
planner is the guard's own; the grid is finer than the guard's 2 cm, which would refuse most of
these goals, and is made for the planner alone. Its time is not part of the planning time. Links
whose spheres overlap at some problem's start or goal are not checked against each other: with
meshes, the problems' makers found them free.
"""


def settings() -> dict[str, Any]:
    """All that changes a run, besides its seed."""
    return {"voxel": VOXEL, "ring": RING, "time": TIME, "half": HALF, "lens": [640, 480, 70, 55]}


@lru_cache(maxsize=1)
def all_problems() -> tuple[tuple[Robot, Problem], ...]:
    """Every problem with its robot: number by number, the sets and robots in turn."""
    folder = find_data()
    found = []
    for name in ROBOTS:
        robot = load_bench_robot(name, folder)
        problems = load_problems(name, robot, folder)
        robot = without_idle_pairs(robot, problems)
        found += [(robot, problem) for problem in problems]
    return tuple(sorted(found, key=lambda f: (f[1].number, f[1].robot, f[1].family)))


def without_idle_pairs(robot: Robot, problems: Sequence[Problem]) -> Robot:
    """The robot without the pairs of links whose spheres overlap at some start or goal."""
    spheres = robot.spheres
    body = MovingBody(robot, np.ones(robot.n))
    link = np.concatenate([body.link, np.zeros(int((spheres.link == 0).sum()), int)])
    fixed = np.asarray(spheres.center)[spheres.link == 0]
    radius = np.concatenate([body.radius, np.asarray(spheres.radius)[spheres.link == 0]])
    touching: set[tuple[int, int]] = set()
    for q in {tuple(q) for p in problems for q in (p.start, p.goal)}:
        moving, _ = body.motion(np.array(q), np.zeros(robot.n))
        center = np.concatenate([moving, fixed])
        apart = np.linalg.norm(center[:, None] - center[None], axis=2)
        a, b = np.nonzero(apart < radius[:, None] + radius[None])
        touching |= set(zip(link[a].tolist(), link[b].tolist()))
    kept = [pair for pair in robot.self_pairs.tolist() if tuple(pair) not in touching]
    return replace(robot, self_pairs=np.array(kept, np.int64).reshape(-1, 2))


def episode(seed: int, run: int) -> dict[str, Any]:
    """One problem under both policies."""
    robot, problem = all_problems()[run]
    result: dict[str, Any] = {"problem": problem.name, "robot": problem.robot}
    result["clearance"] = min(
        float(clearances(robot, problem, q[None]).min()) for q in (problem.start, problem.goal)
    )
    began = time.thread_time()
    grid, poses = grid_of(problem.robot), cameras(problem.robot)
    images = [depth_image(problem.solids, LENS, T) for T in poses]
    pictured = time.thread_time()
    state = voxels_seen(grid, LENS, poses, images)
    mapped = time.thread_time()
    result["pictures_s"] = pictured - began
    for name, solid in POLICIES.items():
        began = time.thread_time()
        snapshot = snapshot_of(grid, state, solid)
        result[name] = {"grid_s": mapped - pictured + time.thread_time() - began}
        result[name] |= _plan(robot, problem, snapshot, solid, np.random.default_rng((seed, run)))
    return result


def _plan(
    robot: Robot,
    problem: Problem,
    snapshot: WorkspaceSnapshot,
    solid: bool,
    rng: np.random.Generator,
) -> dict[str, Any]:
    model = CollisionModel(robot, CollisionConfig(avoid_unknown=solid))
    planner = RrtConnectPlanner(robot, model, PlannerConfig())
    goal = JointGoal("goal", problem.goal)
    began = time.thread_time()
    plan = planner.plan(PlanRequest(0, problem.start, goal), snapshot, TIME, rng)
    spent = time.thread_time() - began
    result = {"failure": plan.failure, "seconds": spent, "first_s": plan.planning_s}
    if plan.trajectory is not None:
        samples = plan.trajectory.sample(
            np.linspace(
                0.0, plan.trajectory.duration, max(2, int(plan.trajectory.duration / 0.005))
            )
        )
        result["least"] = check(robot, problem, samples, model)
        result["cost"] = plan.cost
    return result


def clearances(robot: Robot, problem: Problem, path: JointPath) -> Floats:
    """(k,) least exact distance of the moving spheres to the scene along a (k, n) path [m]."""
    body = MovingBody(robot, np.ones(robot.n))
    still = np.zeros(robot.n)
    least = np.empty(len(path))
    for i, q in enumerate(path):
        centers, _ = body.motion(q, still)
        gaps = [(solid.distance(centers) - body.radius).min() for solid in problem.solids]
        least[i] = min(gaps, default=np.inf)
    return least


def check(robot: Robot, problem: Problem, samples: JointPath, model: CollisionModel) -> float:
    """Least clearance of a motion [m], one look every :data:`STEP`; NaN beyond the limits."""
    if any(not model.within_limits(q) for q in samples):
        return float("nan")
    reach = model.body.lever.max(axis=0, initial=0.0)
    dense: list[JointVector] = []
    for a, b in pairwise(samples):
        count = max(1, int(np.ceil(float(np.abs(b - a) @ reach) / STEP)))
        dense += [a + (b - a) * k / count for k in range(count)]
    return float(clearances(robot, problem, np.array([*dense, samples[-1]])).min())


def grid_of(robot: str) -> VoxelGrid:
    """The planning grid about a robot."""
    height = SHOULDER[robot]
    lower = np.array([-HALF, -HALF, height - BELOW - 0.4])
    upper = np.array([HALF, HALF, height + ABOVE])
    shape = np.ceil((upper - lower) / VOXEL).astype(int)
    return VoxelGrid(lower, VOXEL, (int(shape[0]), int(shape[1]), int(shape[2])))


def cameras(robot: str) -> list[Pose]:
    """Ten optical poses: eight around, four of them low, and two at the arm's own head."""
    middle = np.array([0.0, 0.0, SHOULDER[robot]])
    poses = []
    for k in range(8):
        turn, lift = np.pi / 4.0 * k, np.deg2rad(35.0 if k % 2 else -10.0)
        away = [np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)]
        poses.append(look_at(middle + RING * np.array(away), middle))
    for side in (-1.0, 1.0):
        eye: Vector3 = middle + np.array([0.0, 0.0, 0.6])
        poses.append(look_at(eye, middle + np.array([0.7 * side, 0.7, -0.2])))
    return poses


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """The first ``runs`` problems; one process, for the times' sake."""
    cache = RunCache("mbm", seed, settings())
    results = []
    for k in range(min(runs, len(all_problems()))):
        results.append(cache.get(k, partial(episode, seed, k)))
        progress(f"mbm: {k + 1} of {runs}", (k + 1) / runs)
    rows = []
    for robot in (None, *ROBOTS):
        mine = [r for r in results if robot in (None, r["robot"])]
        for policy in POLICIES:
            rows += _rows(mine, policy, f"{robot or 'both'}, {policy}")
    notes = [
        f"{r['problem']}, {policy}: {r[policy]['failure']}."
        for r in results
        for policy in POLICIES
        if r["clearance"] > 0.0 and r[policy]["failure"]
    ]
    left_out = len(notes) - 12
    notes = notes[:12] + ([f"And {left_out} more like these."] if left_out > 0 else [])
    return Outcome(tuple(rows), {"clearance": lambda: _plot(results)}, tuple(notes))


def _rows(results: list[dict[str, Any]], policy: str, condition: str) -> list[Row]:
    """Figures of one policy."""
    solvable = [r for r in results if r["clearance"] > 0.0]
    if not solvable:
        return []
    solved = [r for r in solvable if not r[policy]["failure"]]
    bad = [r for r in solved if not r[policy]["least"] > 0.0]
    low, high = wilson(len(solved), len(solvable))
    sound = POLICIES[policy]
    rows = [
        Row(
            "mbm_solved",
            "share of the solvable problems that were solved, and its 95 % interval (Wilson)",
            condition,
            len(solved) / len(solvable),
            n=len(solvable),
            low=low,
            high=high,
            must=0.99 if sound else None,
            aim=1.0 if sound else None,
            better="higher",
        ),
        Row(
            "mbm_invalid",
            "paths that touch the exact scene, looked at every millimetre",
            condition,
            float(len(bad)),
            n=len(solved),
            must=0.0 if sound else None,
            aim=0.0 if sound else None,
        ),
    ]
    if not solved:
        return rows
    ms = np.array([1e3 * r[policy]["seconds"] for r in solved])
    first = np.array([1e3 * r[policy]["first_s"] for r in solved])
    grid = np.array([1e3 * (r[policy]["grid_s"]) for r in solved])
    for key, measure, values, must in (
        ("mbm_plan_median_ms", "plan of a solved problem, CPU time, median and p95", ms, 10.0),
        ("mbm_first_path_ms", "until the first path, wall time, median and p95", first, None),
        ("mbm_grid_ms", "grid and distance field, CPU time, median and p95", grid, None),
    ):
        rows.append(
            Row(
                key,
                measure,
                condition,
                float(np.median(values)),
                "ms",
                n=len(values),
                low=float(np.median(values)),
                high=float(np.percentile(values, 95)),
                must=must if sound else None,
                aim=2.0 if must and sound else None,
            )
        )
    return rows


def _plot(results: list[dict[str, Any]]) -> Figure:
    """Solved or not, by how much room start and goal have."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.2))
    axes = figure.subplots()
    rng = np.random.default_rng(0)
    for level, policy in enumerate(POLICIES):
        for failed, color in ((False, "tab:green"), (True, "tab:red")):
            x = [1e3 * r["clearance"] for r in results if bool(r[policy]["failure"]) == failed]
            y = level + rng.uniform(-0.2, 0.2, len(x))
            axes.plot(x, y, ".", color=color, label=("failed" if failed else "solved"))
    axes.set(xlabel="least exact clearance of start and goal [mm]", xlim=(-2.0, 60.0))
    axes.set_yticks([0, 1], list(POLICIES))
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(*zip(*dict(zip(labels, zip(handles, labels))).values()), loc="lower right")
    return figure


EXPERIMENT = Experiment(
    name="mbm",
    title="MotionBenchMaker's problems through depth pictures",
    run=run,
    runs=700,
    about=ABOUT,
)
