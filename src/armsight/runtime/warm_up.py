"""Everything is compiled and touched once before the arm may move: the first frame is no test.

The map looks at made-up pictures, and people come into these no less than into true ones. Planner
and guard then work in a map that is made up, too, in which the arm can move and somebody may be
touched: in what a map makes of made-up pictures, they would stand. What compiled in the loop took
up to 0.6 s of it, in the first run on a machine.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from armsight.arrays import JointVector, Vector3
from armsight.devices.data import JointState, RgbdCameraInfo, RgbdFrame, Wrench
from armsight.devices.history import JointHistory
from armsight.geometry.pose import make_pose
from armsight.mapping.snapshot import CameraStatus, WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.escape import leaves
from armsight.motion.intents import Intent, JointIntent, Rest, VelocityIntent
from armsight.motion.permits import ContactKind, PermitRequest
from armsight.motion.regions import Region
from armsight.robots.kinematics import tcp_pose
from armsight.robots.robot import Robot
from armsight.runtime.components import AROUND

if TYPE_CHECKING:
    from armsight.mapping.workspace_map import WorkspaceMap
    from armsight.motion.guard import Guard
    from armsight.motion.plan import Plan, Planner

Progress = Callable[[str, float], None]
"""Told the stage and the share of the whole that is done, 0..1."""
LOOKS, WHOLE, PERIOD = 11, 3, 0.2
"""Pictures of each camera, as many of them whole, and how far apart they are [s]: what has been
still for a second is a thing."""
TICK, PLANNED, STEPS = 0.008, 30, 12
"""From step to step of the guard [s], as many along a plan, and as many of each other kind."""
AHEAD = 0.15
"""What may be touched is so far before the tip at first [m]."""
CLEAR = 0.9
"""Nearer than this to the tip nobody is in the made-up map [m]; somebody who is touched is."""
CONTACTS: tuple[ContactKind, ...] = ("thing", "hand")
"""What may be touched: to a face it comes as to a hand."""


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
    progress("preparing the map", 0.1)
    snapshot = _mapped(workspace, cameras, robot)
    progress("preparing the planner", 0.4)
    trial = _Trial(planner, guard, robot, snapshot, planning_time)
    goal = JointIntent("warm-up", home + 0.3)
    trial.steps(PLANNED, lambda now: goal)
    progress("preparing the guard", 0.6)
    trial.steps(STEPS, _wish)
    for kind in CONTACTS:
        trial.steps(STEPS, lambda now: Rest())
        trial.touch(kind)
    leaves(CollisionModel(robot), np.stack([home, home + 0.01]), snapshot, home)  # what it touches
    progress("prepared", 1.0)


class _Trial:
    """The guard leads an arm that does what it is told, in a made-up map."""

    def __init__(
        self,
        planner: Planner,
        guard: Guard,
        robot: Robot,
        snapshot: WorkspaceSnapshot,
        planning_time: float,
    ) -> None:
        self._planner, self._guard, self._robot = planner, guard, robot
        self._snapshot, self._planning_time = _empty(snapshot), planning_time
        self._q, self._velocity, self._now = np.array(robot.home, float), np.zeros(robot.n), 1.0
        late = round(guard.config.start_delay / TICK)
        self._told = deque([np.zeros(robot.n)] * late)
        self._rng = np.random.default_rng(0)
        self._plan: Plan | None = None

    def touch(self, kind: ContactKind) -> None:
        """Come to what may be touched, until it presses harder than it may."""
        T = np.asarray(tcp_pose(self._robot, self._q))
        for ahead in (AHEAD, 0.0) if kind == CONTACTS[-1] else (AHEAD,):
            place = T[:3, 3] + ahead * T[:3, 2]
            self.steps(STEPS, partial(_touches, kind, place), place, 0.0 if ahead else 20.0)

    def steps(
        self,
        count: int,
        intent: Callable[[float], Intent],
        touched: Vector3 | None = None,
        pressed: float = 0.0,
    ) -> None:
        """Some steps with what is wanted at a time [s].

        Args:
            count: of steps.
            intent: what is wanted.
            touched: (3,) where somebody is, in ``base`` [m].
            pressed: force on the arm [N].
        """
        for _ in range(count):
            self._now += TICK
            stamps = self._now - TICK + 0.001 * np.arange(1, 9)
            forces = self._rng.normal(0.0, 0.1, (8, 3)) - [0.0, 0.0, pressed]
            self._guard.feel([Wrench(float(t), f, 0.1 * f) for t, f in zip(stamps, forces)])
            joints = JointState(self._now, self._q.copy(), self._velocity.copy())
            seen = _open(self._snapshot, self._robot, self._q, self._now, touched)
            decision = self._guard.step(self._now, joints, seen, intent(self._now), self._plan)
            if decision.request is not None:
                self._plan = self._planner.plan(
                    decision.request, seen, self._planning_time, self._rng
                )
            self._told.append(np.array(decision.command, float))
            self._velocity = self._told.popleft()
            self._q = self._q + TICK * self._velocity


def _mapped(
    workspace: WorkspaceMap, cameras: Sequence[RgbdCameraInfo], robot: Robot
) -> WorkspaceSnapshot:
    """What the map makes of made-up pictures."""
    history, home = JointHistory(), np.asarray(robot.home, float)
    workspace.declare_empty()
    for k in range(LOOKS):
        now = 1.0 + PERIOD * k
        for step in range(5):
            history.add(JointState(now - 0.04 + 0.01 * step, home, np.zeros(robot.n)))
        frames = [_made_up(info, k, now - info.latency, k < WHOLE) for info in cameras]
        # What is before the tip is asked for now and then: the map has ways of its own for that.
        region = Region("sphere", (0.05, 0.0, 0.0), tcp_pose(robot, home), now) if k % 2 else None
        snapshot = workspace.update(frames, history, now, region)
    return snapshot


def _empty(snapshot: WorkspaceSnapshot) -> WorkspaceSnapshot:
    """A map in which nothing is near the arm; as read-only as any."""
    distance = np.full_like(snapshot.distance, snapshot.distance_cap)
    distance.flags.writeable = snapshot.distance.flags.writeable
    return replace(snapshot, distance=distance)


def _open(
    snapshot: WorkspaceSnapshot,
    robot: Robot,
    q: JointVector,
    now: float,
    touched: Vector3 | None = None,
) -> WorkspaceSnapshot:
    """The same with nobody near the arm, besides who may be touched."""
    tip = np.asarray(tcp_pose(robot, q))[:3, 3]
    far = tip + CLEAR * np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    there = np.zeros((0, 3)) if touched is None else touched + AROUND
    hazards = np.concatenate([far, there]).astype(np.float32)
    made = {
        "hazards": hazards,
        "hazard_unknown": np.zeros(len(hazards), bool),
        "things": (there + 0.06).astype(np.float32),
    }
    for name, array in made.items():
        array.flags.writeable = getattr(snapshot, name).flags.writeable
    alive = tuple(CameraStatus(camera.name, now, True, 1, 0) for camera in snapshot.cameras)
    return replace(snapshot, stamp=now, oldest=now, cameras=alive, **made)  # type: ignore[arg-type]


def _wish(now: float, permit: PermitRequest | None = None) -> VelocityIntent:
    """As fast as can be: something limits it, and is slid along."""
    return VelocityIntent("warm-up", np.full(6, 2.0), "base", now, now + 0.1, permit)


def _touches(kind: ContactKind, place: Vector3, now: float) -> VelocityIntent:
    """The same, asking to touch what is at (3,) a place in ``base`` [m]."""
    region = Region("sphere", (0.05, 0.0, 0.0), make_pose(None, place), now)
    return _wish(now, PermitRequest(f"warm-up {kind}", kind, region, force=5.0))


def _made_up(info: RgbdCameraInfo, sequence: int, stamp: float, whole: bool) -> RgbdFrame:
    """A frame of a wall at 2 m with a box before it, so that every stage has something to do.

    Not the ``whole`` of it: the box alone, which is sooner compared with what the cell declares.
    """
    lens = info.depth
    near, far = info.range
    depth = np.full((lens.height, lens.width), min(2.0, far) if whole else np.nan, np.float32)
    h, w = depth.shape
    depth[h // 3 : h // 2, w // 3 : w // 2] = max(near * 1.2, min(1.2, far))
    depth[: h // 20] = np.nan
    depth.flags.writeable = False  # as that of every camera: kernels are compiled for it
    return RgbdFrame(info.name, sequence, stamp, stamp + info.latency, depth)
