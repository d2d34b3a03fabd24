"""Planned ways and the cable that the arm drags: past posts that only the cable would come to.

The ways of charging visits in ``ur10_charging_cable`` (stand-by, a second look, before the port,
stand-by), cars parked at random. On each a post of 8 cm is put where the straight way would lead
the cable through it, and nothing of the arm comes within 5 cm of it. Planned without the cable
(``unknowing``) and with it (``led``): on how many ways the still cable comes to the post, its least
distance from it, and the planning thread's CPU time; ``free_ms`` without the post.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armsight.charging.moves import before_port
from armsight.charging.vehicle_file import load_vehicle
from armsight.geometry.pose import from_rpy, inverse, make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.data import PlanRequest
from armsight.motion.ik import solve_ik
from armsight.motion.intents import JointIntent
from armsight.motion.nearest import MovingBody
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.robots.kinematics import tcp_pose
from armsight.runtime.configure import guard_config
from armsight.workcell import robot_in
from armsight.workcell.build import solids_in_base
from armsight.workcell.packaged import load
from common import Report
from scenes import snapshot_of

WIDE, SPARE = 0.04, 0.05
"""A post's radius, and how far from it the arm's way and the cable's ends are [m]."""
TRIES = 3000
CELL = load("ur10_charging_cable")
ROBOT = robot_in(CELL)
CABLE = ROBOT.tool.cable
BODY = MovingBody(ROBOT, ROBOT.limits.acceleration)


@dataclass(frozen=True)
class Way:
    """From ``start`` to ``goal``, (n,) [rad], among what stands there, past a post or without."""

    start: np.ndarray
    goal: np.ndarray
    post: Solid
    past: WorkspaceSnapshot
    free: WorkspaceSnapshot


def curve(q: np.ndarray) -> np.ndarray:
    """(60, 3) points of the still cable in base."""
    return CABLE.still(transform(tcp_pose(ROBOT, q), np.array([CABLE.root]))[0], 60)


def port_at(rng: np.random.Generator) -> np.ndarray:
    """``T_base_port`` of a car that is parked anyhow."""
    place = rng.uniform((0.84, -0.05, 0.75), (1.04, 0.15, 0.95))
    yaw, lean = np.deg2rad(rng.uniform(170.0, 190.0)), np.deg2rad(rng.uniform(0.0, 20.0))
    z = np.array([np.cos(yaw) * np.cos(lean), np.sin(yaw) * np.cos(lean), np.sin(lean)])
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    T = make_pose(np.column_stack([x, np.cross(z, x), z]), place)
    return np.asarray(inverse(CELL.robot.T_world_base) @ T)


def post_for(start: np.ndarray, goal: np.ndarray, rng: np.random.Generator) -> Solid | None:
    """A post in the cable's straight way, beside the arm's and the cable's ends; None if none."""
    straight = start + np.linspace(0.0, 1.0, 25)[:, None] * (goal - start)
    cables = [curve(q) for q in straight]
    arm = np.concatenate([BODY.motion(q, np.zeros(len(q)))[0] for q in straight])
    radius = np.tile(BODY.radius, len(straight))
    low = -float(CELL.robot.T_world_base[2, 3])
    for _ in range(TRIES):
        x, y, z = cables[rng.integers(6, 19)][rng.integers(2, 40)]
        high = z + 0.05 - low
        post = Solid("post", "cylinder", (WIDE, high, 0.0), make_pose(None, (x, y, low + high / 2)))
        ends = post.distance(np.concatenate([cables[0], cables[-1]])).min() - CABLE.radius
        if min(ends, (post.distance(arm) - radius).min()) > SPARE:
            return post
    return None


def ways(wanted: int) -> Iterator[Way]:
    """Ways of visits on which there is a place for such a post."""
    solids, seed = list(solids_in_base(CELL)), 0
    shape = load_vehicle("hatchback").solids
    while wanted > 0:
        seed += 1
        rng = np.random.default_rng(seed)
        T = port_at(rng)
        car = [replace(s, T_frame_solid=T @ s.T_frame_solid) for s in shape]
        model, empty = CollisionModel(ROBOT), snapshot_of(solids + car)
        tilt = make_pose(from_rpy((*rng.uniform(-0.4, 0.4, 2), 0.0))[:3, :3], (0.0, 0.1, 0.0))
        stays = [ROBOT.home]
        for pose in (before_port(T, 0.35) @ tilt, before_port(T, 0.10)):
            found = solve_ik(ROBOT, pose, ROBOT.home, rng)
            stays += [q for q in found if model.valid(q, empty)][:1]
        for start, goal in zip(stays, [*stays[1:], ROBOT.home]):
            post = post_for(start, goal, rng)
            if post is not None and wanted > 0:
                wanted -= 1
                yield Way(start, goal, post, snapshot_of([*solids, *car, post]), empty)


def main() -> None:
    """Run and print."""
    report = Report("cable", __doc__)
    wanted = max(3, report.rounds(12))
    speed, acceleration = guard_config(CELL).planned
    settings = PlannerConfig(speed=speed, acceleration=acceleration)
    bare = replace(ROBOT, tool=replace(ROBOT.tool, cable=None))
    planners = {
        name: RrtConnectPlanner(robot, None, settings, clock=time.thread_time)
        for name, robot in (("unknowing", bare), ("led", ROBOT))
    }
    gaps: dict[str, list[float]] = {name: [] for name in planners}
    times: dict[str, list[float]] = {f"{n}_{k}": [] for n in planners for k in ("ms", "free_ms")}
    warm = True
    for way in ways(wanted):
        request = PlanRequest(1, way.start, JointIntent("goal", way.goal))
        for kind, scene in (("ms", way.past), ("free_ms", way.free)):
            for name, planner in planners.items():
                for _ in range(2 if warm else 1):
                    begin = time.thread_time()
                    plan = planner.plan(request, scene, 0.05, np.random.default_rng(0))
                    spent = 1e3 * (time.thread_time() - begin)
                times[f"{name}_{kind}"].append(spent)
                if kind == "ms" and plan.trajectory is not None:
                    when = np.linspace(0.0, plan.trajectory.duration, 80)
                    on = np.concatenate([curve(plan.trajectory.position(t)) for t in when])
                    gaps[name].append(float(way.post.distance(on).min()) - CABLE.radius)
        warm = False
    for name, least in gaps.items():
        note = f"of {len(least)} ways that were planned, {wanted} asked for"
        report.add(f"{name}_touches", sum(g < 0.0 for g in least), "", note=note)
        report.add(f"{name}_least", 100.0 * min(least), "cm")
    for key, spent_ms in times.items():
        low, high = (float(x) for x in np.percentile(spent_ms, [10, 90]))
        report.add(key, float(np.median(spent_ms)), "ms", spread=(low, high))
    report.finish()


if __name__ == "__main__":
    main()
