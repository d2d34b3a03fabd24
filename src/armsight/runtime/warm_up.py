"""Everything is compiled and touched once before the arm may move: the first frame is no test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent, VelocityIntent
from armsight.robots.robot import Robot

if TYPE_CHECKING:
    from armsight.mapping.workspace_map import WorkspaceMap
    from armsight.motion.guard import Guard
    from armsight.motion.plan import Planner

Progress = Callable[[str, float], None]
"""Told the stage and the share of the whole that is done, 0..1."""
ROUNDS = 3
"""Times that the chain is run; later rounds take ways that the first does not."""


def warm_up(
    robot: Robot,
    cameras: Sequence[RgbdCameraInfo],
    make: Callable[[], tuple[WorkspaceMap, Planner, Guard]],
    planning_time: float,
    progress: Progress,
) -> None:
    """Run map, planner and guard of a made-up scene, then throw them away.

    Args:
        robot: the arm.
        cameras: of the cell.
        make: builds fresh parts.
        planning_time: the planner's time limit [s].
        progress: told where we are.
    """
    progress("preparing", 0.0)
    workspace, planner, guard = make()
    home = np.asarray(robot.home, float)
    history = JointHistory()
    goal = JointIntent("warm-up", home + 0.3)
    plan = None
    for k in range(ROUNDS):
        now = 1.0 + 0.1 * k
        for step in range(5):
            history.add(JointState(now - 0.04 + 0.01 * step, home, np.zeros(robot.n)))
        done = k / ROUNDS
        progress("preparing the map", done + 0.1)
        frames = [_made_up(info, k, now - info.latency) for info in cameras]
        snapshot = workspace.update(frames, history, now)
        progress("preparing the planner", done + 0.2)
        request = PlanRequest(k, home, goal)
        plan = planner.plan(request, snapshot, planning_time, np.random.default_rng(k))
        progress("preparing the guard", done + 0.3)
        for tick in range(3):
            at = now + 0.008 * tick
            joints = JointState(at, home, np.zeros(robot.n))
            guard.step(at, joints, snapshot, goal, plan)
        for tick in range(3, 6):  # as fast as can be: something limits it, and is slid along
            at = now + 0.008 * tick
            joints = JointState(at, home, np.zeros(robot.n))
            wish = VelocityIntent("warm-up", np.full(6, 2.0), "base", at, at + 0.1)
            guard.step(at, joints, snapshot, wish, None)
    progress("prepared", 1.0)


def _made_up(info: RgbdCameraInfo, sequence: int, stamp: float) -> RgbdFrame:
    """A frame of a wall at 2 m with a box before it, so that every stage has something to do."""
    lens = info.depth
    near, far = info.range
    depth = np.full((lens.height, lens.width), min(2.0, far), np.float32)
    h, w = depth.shape
    depth[h // 3 : h // 2, w // 3 : w // 2] = max(near * 1.2, min(1.2, far))
    depth[: h // 20] = np.nan
    depth.flags.writeable = False  # as that of every camera: kernels are compiled for it
    return RgbdFrame(info.name, sequence, stamp, stamp + info.latency, depth)
