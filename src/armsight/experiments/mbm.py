"""``mbm``: MotionBenchMaker's problems through depth pictures; every path checked at 1 mm."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector, Mask, Pose, Vector3
from armsight.experiments.cache import RunCache
from armsight.experiments.depth_scene import depth_image, look_at
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.motion_bench import (
    ROBOTS,
    Problem,
    find_data,
    load_bench_robot,
    load_problems,
)
from armsight.experiments.rows import Row, wilson
from armsight.experiments.seen_space import Seen, snapshot_of, space_seen
from armsight.experiments.seen_space_kernels import PARTS
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.snapshot import FREE, VoxelGrid, WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent
from armsight.motion.nearest import MovingBody
from armsight.motion.obstacles import CollisionConfig
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.robots.robot import Robot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VOXEL = 0.01
"""Edge of a voxel of the planning grid [m]."""
HALF = 0.95
"""The grid reaches this far from the arm's base sideways [m],"""
BELOW, ABOVE = 1.0, 1.1
"""and this far down and up from the shoulder [m]."""
SHOULDER = {"ur5": 1.0, "panda": 0.333}
"""Height of the second joint in the frame of the problems [m]."""
LENS = PinholeCamera.from_fov(960, 720, np.deg2rad(80.0), np.deg2rad(64.4))
RING, RAISED = 1.4, 0.15
"""Sixteen cameras so far from a place so high above the shoulder, which they look at [m];"""
LIFTS = (-25.0, 40.0, 0.0, 40.0)
"""Their elevations in turn [deg];"""
CEILING, ASIDE = 1.1, 0.55
"""six look straight down from so far above the shoulder, so far aside [m];"""
CLOSE, CLOSE_LIFT = 1.0, 10.0
"""eight look at the shoulder from so near [m], so high [deg], between those of the ring."""
TUNED = 25
"""Problems up to this number were looked at when cameras were placed; figures begin after them."""
TIME = 2.0
"""Time limit of one plan [s]; a second is ``PlannerConfig.looks_per_second`` looks."""
STEP = 0.001
"""Paths are checked so often along the way of their fastest sphere [m]."""
POLICIES = {"unseen is solid": True, "unseen is free": False}

NEAR = 0.1
"""Space is looked at in detail so near to the arm at its start and its goal [m]."""
MARGIN = 0.0011
"""May protrude between the points that stand for surfaces: half the diagonal of 1.25 mm [m]."""
ROOM, FLOOR = 0.0002, 0.0002
"""Clearance of paths above that of motions, and of motions above none [m]."""

ABOUT = f"""
MotionBenchMaker's UR5 and Panda problems (Chamzas et al. 2022), seven sets
of 50 each, planned from depth pictures: thirty perfect cameras (960x720, no noise), sixteen in a
ring of {RING:.1f} m, eight in one of {CLOSE:.1f} m and six above, see the scene without the arm. A
grid of {1e3 * VOXEL:.0f} mm is free only where a picture saw through the whole voxel; within
{1e2 * NEAR:.0f} cm of the arm at its start and goal it is divided to {1e3 * VOXEL / PARTS:.2f} mm
and the surfaces are points, {1e3 * MARGIN:.1f} mm thick (`experiments/seen_space.py`). Both
policies for unseen space are shown. A run is one problem, the sets in turn, from number {TUNED + 1}
of each on. The cameras were placed with the first {TUNED} of each, so that hardly any part of a
start or goal is seen by none of them: without the eight, two of the first 148 failed, cages whose
goal touched space that no picture saw. Those numbers come last, and only if so many runs are asked
for.

Solvable is a problem whose start and goal touch nothing by exact geometry, with the spheres of the
problems' own robot files; the others are named below. A path is invalid if at any place of the
motion, looked at every millimetre of its fastest sphere, a sphere meets the exact scene, or the arm
leaves its limits. The planner is the guard's own; its map is finer than the guard's 2 cm, which
would refuse most of these goals (half of them have less than 1 cm of room), and is made for this
experiment alone. Links whose spheres overlap at some problem's start or goal are not checked
against each other: with meshes, the problems' makers found them free.

Planning is from a finished map to the first path that is proven free (the checks of start and goal
included), which is what other planners' figures tell. Three more figures go on from there: until
there is a proven motion in time along that path, the same with 20 ms of looks spent on better
paths, and the making of the map. All are CPU times of the one thread that works: neighbours on the
machine disturb wall times.
"""


@lru_cache(maxsize=1)
def all_problems() -> tuple[tuple[Robot, Problem], ...]:
    """Every problem with its robot: number by number, the sets and robots in turn.

    Those that were looked at for placing the cameras come last.
    """
    folder = find_data()
    found = []
    for name in ROBOTS:
        robot = load_bench_robot(name, folder)
        problems = load_problems(name, robot, folder)
        robot = without_idle_pairs(robot, problems)
        found += [(robot, problem) for problem in problems]

    def order(entry: tuple[Robot, Problem]) -> tuple[bool, int, str, str]:
        problem = entry[1]
        return problem.number <= TUNED, problem.number, problem.robot, problem.family

    return tuple(sorted(found, key=order))


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
    divided = about_ends(robot, problem, grid)
    seen = space_seen(grid, LENS, poses, images, divided)
    mapped = time.thread_time()
    result["pictures_s"] = pictured - began
    for name, solid in POLICIES.items():
        began = time.thread_time()
        snapshot = snapshot_of(seen, solid)
        result[name] = {"grid_s": mapped - pictured + time.thread_time() - began}
        result[name] |= _plan(robot, problem, snapshot, solid, (seed, run))
    return result


def about_ends(robot: Robot, problem: Problem, grid: VoxelGrid) -> Mask:
    """(nx, ny, nz) voxels near the moving body at the problem's start or goal."""
    body = MovingBody(robot, np.ones(robot.n))
    mask = np.zeros(grid.shape, bool)
    for q in (problem.start, problem.goal):
        centers, _ = body.motion(q, np.zeros(robot.n))
        for center, radius in zip(centers, body.radius):
            reach = float(radius) + NEAR
            low = np.maximum(grid.index(center - reach), 0)
            high = np.minimum(grid.index(center + reach) + 1, grid.shape)
            part = tuple(slice(int(a), int(b)) for a, b in zip(low, high))
            index = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), -1)
            gap = np.linalg.norm(grid.center(index) - center, axis=-1)
            mask[part] |= gap <= reach
    return mask


@lru_cache(maxsize=8)
def planner_of(robot: str, solid: bool, improvement: float) -> RrtConnectPlanner:
    """The guard's planner with this experiment's margins, for one policy; ready to be timed."""
    arm, problem = next(p for p in all_problems() if p[1].robot == robot)
    model = CollisionModel(arm, CollisionConfig(MARGIN, FLOOR, avoid_unknown=solid))
    config = PlannerConfig(room=ROOM, improvement=improvement)
    planner = RrtConnectPlanner(arm, model, config, clock=time.thread_time)
    grid, nothing = grid_of(robot), np.zeros((0, 3), np.float32)
    empty = snapshot_of(Seen(grid, np.full(grid.shape, FREE, np.uint8), nothing, nothing), solid)
    request = PlanRequest(0, problem.start, JointIntent("goal", problem.goal))
    planner.plan(request, empty, TIME, np.random.default_rng(0))
    return planner


def _plan(
    robot: Robot,
    problem: Problem,
    snapshot: WorkspaceSnapshot,
    solid: bool,
    seed: tuple[int, int],
) -> dict[str, Any]:
    """Two plans of one beginning: without better paths, and with them."""
    request = PlanRequest(0, problem.start, JointIntent("goal", problem.goal))
    result: dict[str, Any] = {}
    for name, improvement in (("motion_s", 0.0), ("improved_s", PlannerConfig().improvement)):
        planner = planner_of(problem.robot, solid, improvement)
        began = time.thread_time()
        plan = planner.plan(request, snapshot, TIME, np.random.default_rng(seed))
        result[name] = time.thread_time() - began
        result.setdefault("first_s", plan.planning_s)
        result["failure"] = result.get("failure") or plan.failure
        if plan.trajectory is not None:
            count = max(2, int(plan.trajectory.duration / 0.005))
            samples = plan.trajectory.sample(np.linspace(0.0, plan.trajectory.duration, count))
            least = check(robot, problem, samples, planner.model)
            result["least"] = float(np.minimum(result.get("least", np.inf), least))
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
    """Least clearance met on a motion [m]; NaN beyond the limits.

    Places no more than :data:`STEP` of the fastest sphere apart. Those are passed over that are so
    close to one looked at that at least half of its clearance must be left.
    """
    # Sampling rounds: a goal that is just at a limit must not count as beyond it.
    if any(not model.within_limits(model.inside_limits(q, 1e-9)) for q in samples):
        return float("nan")
    reach = model.body.lever.max(axis=0, initial=0.0)
    dense: list[JointVector] = []
    for a, b in pairwise(samples):
        count = max(1, int(np.ceil(float(np.abs(b - a) @ reach) / STEP)))
        dense += [a + (b - a) * k / count for k in range(count)]
    dense.append(samples[-1])
    least, k = np.inf, 0
    while k < len(dense):
        here = float(clearances(robot, problem, dense[k][None]).min())
        least = min(least, here)
        k += max(1, int(0.5 * here / STEP))
    return min(least, float(clearances(robot, problem, dense[-1][None]).min()))


def grid_of(robot: str) -> VoxelGrid:
    """The planning grid about a robot."""
    height = SHOULDER[robot]
    lower = np.array([-HALF, -HALF, height - BELOW])
    upper = np.array([HALF, HALF, height + ABOVE])
    shape = np.ceil((upper - lower) / VOXEL - 1e-9).astype(int)
    return VoxelGrid(lower, VOXEL, (int(shape[0]), int(shape[1]), int(shape[2])))


def cameras(robot: str) -> list[Pose]:
    """Thirty optical poses: sixteen around at three heights, eight nearer, and six looking down."""
    shoulder = np.array([0.0, 0.0, SHOULDER[robot]])
    middle = shoulder + np.array([0.0, 0.0, RAISED])
    poses = [_around(middle, RING, np.pi / 8.0 * k, np.deg2rad(LIFTS[k % 4])) for k in range(16)]
    poses += [
        _around(shoulder, CLOSE, np.pi / 4.0 * (k + 0.25), np.deg2rad(CLOSE_LIFT)) for k in range(8)
    ]
    for k in range(6):
        turn = np.pi / 3.0 * k
        aside = np.array([ASIDE * np.cos(turn), ASIDE * np.sin(turn), CEILING])
        eye: Vector3 = shoulder + aside
        poses.append(look_at(eye, eye - np.array([0.0, 0.0, 1.0])))
    return poses


def _around(middle: Vector3, away: float, turn: float, lift: float) -> Pose:
    """An optical pose that looks at a place from a distance [m], by two angles [rad]."""
    way = np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
    return look_at(middle + away * way, middle)


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """The first ``runs`` problems; one process, for the times' sake."""
    cache = RunCache("mbm", seed)
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
    unsolvable = [r["problem"] for r in results if not r["clearance"] > 0.0]
    left_out = len(notes) - 12
    notes = notes[:12] + ([f"And {left_out} more like these."] if left_out > 0 else [])
    if unsolvable:
        notes.append(f"Not solvable, start or goal in collision: {', '.join(unsolvable)}.")
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
    for key, measure, name, must in (
        ("mbm_plan_median_ms", "until the first proven path, median and p95", "first_s", 10.0),
        ("mbm_motion_ms", "until a proven motion in time, median and p95", "motion_s", None),
        ("mbm_improved_ms", "the same with better paths looked for", "improved_s", None),
        ("mbm_grid_ms", "map of all pictures and distance field", "grid_s", None),
    ):
        values = np.array([1e3 * r[policy][name] for r in solved])
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
