"""A cell without physics or pictures: an arm with delayed drives, snapshots made from moving balls.

The map is perfect but as late as a real one, and only whole voxels are seen. Ten times faster than
the rendered cell, so it serves searches that need thousands of episodes, and the guard's tests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from armsight.arrays import JointVector, Points, Vector3
from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, Wrench
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.config import MappingConfig
from armsight.mapping.overhead import Overhead
from armsight.mapping.snapshot import FREE, CameraStatus, VoxelGrid, WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.data import GuardStatus
from armsight.motion.guard import Guard
from armsight.motion.guard_config import GuardConfig
from armsight.motion.intents import Intent, JointIntent
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.plan import Plan
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.motion.pose_planner import PosePlanner
from armsight.motion.tick import GuardDecision
from armsight.robots import load_robot
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot
from armsight.simulation.kernels import drive_step
from armsight.simulation.truth import MOVING

REACH_ABOVE = 0.85
"""Longest part of a person above the mapped box [m]."""
STEP = 0.002
"""Time step of the drives [s]."""
VOXEL = 0.02
"""Edge of a voxel [m]."""
HALF = 1.2
"""Half edge of the mapped box [m]."""
MAP_LATENCY, PLAN_LATENCY = 0.025, 0.1
"""Compute times that are charged [s]; those of a session."""
LOOK = 5
"""Contacts are looked for every so many steps."""
KEEP: Any = object()
"""Stands for "what it really is" in :meth:`QuickCell.tick`."""


@dataclass
class Ball:
    """A hand: (3,) centre in ``base`` at a time [s], and radius [m]."""

    center: Callable[[float], Vector3]
    radius: float = 0.05


@dataclass(frozen=True)
class Touch:
    """Arm and ball overlap.

    Attributes:
        time: [s]; speed: of the arm's fastest point [m/s]; distance: of the surfaces [m].
        ball: number of the ball; sphere: of the moving body, the nearest.
        moving: distance of the nearest sphere of which a point is faster than :data:`MOVING` [m];
            inf if there is none.
    """

    time: float
    speed: float
    distance: float
    ball: int = 0
    sphere: int = 0
    moving: float = np.inf


class QuickCell:
    """Guard, planner and a kinematic arm among balls.

    Args:
        balls: who moves; goals: (n,) configurations, visited in turn [rad].
        rate: of the pictures [Hz]; latency: exposure to arrival [s].
        robot: key of the catalogue, or the arm itself; config: of the guard; seed: of the planner.
        box: lower and upper corner (3,) of what is mapped, in ``base`` [m]; None for a cube.

    Attributes:
        now: time [s]; q, v: true joints; snapshot, plan: newest that has arrived.
        log: the guard's words, one a tick; commands: (n + 1,) sent, and whether it was a stop.
        visits: when goals were reached [s]; touches: every overlap that was seen.
        margins: (time, distance, fastest speed) at every look while there are balls.
        brakes: share of the declared braking that the drives have.
    """

    def __init__(
        self,
        balls: Sequence[Ball] = (),
        goals: Sequence[JointVector] = (),
        *,
        rate: float = 30.0,
        latency: float = 0.04,
        robot: str | Robot = "ur5",
        config: GuardConfig | None = None,
        seed: int = 0,
        box: tuple[Vector3, Vector3] | None = None,
    ) -> None:
        self.balls = list(balls)
        self.goals = list(goals)
        self.rate, self.latency, self.seed = rate, latency, seed
        self.config = config or GuardConfig()
        self.robot = load_robot(robot) if isinstance(robot, str) else robot
        lens = PinholeCamera.from_fov(64, 48, 1.2, 1.0)
        eye = np.eye(4)
        self.info = RgbdCameraInfo(
            "cam", "ideal", lens, None, eye, "base", eye, rate, latency, (0.3, 4.5),
            DepthNoise(0.0, 0.0, 0.0),
        )  # fmt: skip
        lower, upper = box or (np.full(3, -HALF), np.full(3, HALF))
        i, j, k = (round(float(edge)) for edge in (upper - lower) / VOXEL)
        self.grid = VoxelGrid(lower, VOXEL, (i, j, k))
        self._upwards = self.config.up[2] > 0.0
        self._overhead = _overhead(self.grid, box, self.config.up) if box is not None else None
        self.state = np.full(self.grid.shape, FREE, np.uint8)
        self.field = np.full(self.grid.shape, 0.3, np.float32)
        self._never = np.full(self.grid.shape, -np.inf, np.float32)
        self.guard = Guard(self.robot, [self.info], self.config)
        speed, acceleration = self.config.planned
        speeds = PlannerConfig(speed=speed, acceleration=acceleration)
        planner = RrtConnectPlanner(self.robot, CollisionModel(self.robot), speeds)
        among_people = SeparationPlanner(planner, self.robot, [self.info], self.config)
        limits = self.robot.limits.scaled(speed, acceleration)
        self.planner = PosePlanner(among_people, self.robot, limits)
        self.now = 0.0
        self.q = np.array(self.robot.home, float)
        self.v = np.zeros(self.robot.n)
        self.snapshot: WorkspaceSnapshot | None = None
        self.plan: Plan | None = None
        self.log: list[GuardStatus] = []
        self.commands: list[JointVector] = []
        self.visits: list[float] = []
        self.touches: list[Touch] = []
        self.margins: list[Touch] = []
        self.brakes = 1.0
        self.plans: list[tuple[float, Plan]] = []
        self._pictures: list[tuple[float, WorkspaceSnapshot]] = []
        self._next_picture = 0.0
        self._sequence = -1
        self._queue: list[tuple[float, JointVector, bool]] = []
        self._target, self._braking = np.zeros(self.robot.n), True
        self._tool_velocity, self._tool_pull = np.zeros(3), np.zeros(3)
        self._goal = 0
        self.rng = np.random.default_rng(seed)

    @property
    def moving_touches(self) -> list[Touch]:
        """Touches while any part of the arm moved faster than :data:`MOVING`."""
        return [touch for touch in self.touches if touch.speed > MOVING]

    def run(self, seconds: float) -> QuickCell:
        """Tick on for a time [s]."""
        for _ in range(round(seconds / self.config.period)):
            self.tick()
        return self

    def tick(
        self,
        joints: JointState | None = KEEP,
        snapshot: WorkspaceSnapshot | None = KEEP,
        goal: Intent | None = KEEP,
        clock: float | None = None,
    ) -> GuardDecision:
        """One tick of the guard; what it is given may be replaced, to see what it does then."""
        self._deliver()
        if joints is KEEP:
            joints = JointState(self.now, self.q.copy(), self.v.copy())
        if snapshot is KEEP:
            snapshot = self.snapshot
        if goal is KEEP:
            goal = self._next_goal()
        now = self.now if clock is None else clock
        decision = self.guard.step(now, joints, snapshot, goal, self.plan)
        self.send(decision.command, decision.brake)
        if decision.request is not None and self.snapshot is not None:
            request = decision.request
            around = request.surroundings(self.snapshot)
            plan = self.planner.plan(request, around, 0.05, self.rng)
            self.plans.append((self.now + PLAN_LATENCY, plan))
        self.log.append(decision.status)
        self.drive(self.now + self.config.period)
        return decision

    def send(self, command: JointVector, brake: bool = False) -> None:
        """Tell the drives (n,) velocities [rad/s], or to brake; they act later."""
        acts = self.now + self.config.start_delay
        self._queue.append((acts, command.copy(), brake))
        self.commands.append(np.array([*command, float(brake)]))

    def drive(self, until: float) -> None:
        """Let the arm move on its own to a time [s]."""
        limits = self.robot.limits
        ramp = limits.acceleration * self.config.acceleration
        while self.now < until - 1e-9:
            while self._queue and self._queue[0][0] <= self.now + 1e-9:
                _, self._target, self._braking = self._queue.pop(0)
            drive_step(
                self._target, self._braking, self.q, self.v, limits.lower, limits.upper, ramp,
                self.brakes * limits.acceleration, STEP,
            )  # fmt: skip
            self.now += STEP
            if self.balls and round(self.now / STEP) % LOOK == 0:
                self._look()
        before, self._tool_velocity = (
            self._tool_velocity,
            _tool_velocity(self.robot, self.q, self.v),
        )
        self._tool_pull = (self._tool_velocity - before) / self.config.period

    def turn_back(self, seconds: float) -> None:
        """Turn the clock back by a time [s]: no picture or plan of the other time arrives."""
        self.now -= seconds
        self._next_picture = self.now
        self._pictures.clear()
        self.plans.clear()
        self._queue = [(at - seconds, command, brake) for at, command, brake in self._queue]

    def snapshot_at(self, stamp: float) -> WorkspaceSnapshot:
        """What a perfect map says of the balls at a time [s]."""
        points: list[Points] = [np.empty((0, 3))]
        for ball in self.balls:
            center = np.asarray(ball.center(stamp), float)
            low = np.floor((center - ball.radius - self.grid.origin) / VOXEL).astype(int)
            high = np.floor((center + ball.radius - self.grid.origin) / VOXEL).astype(int)
            axes = [np.arange(a, b + 1) for a, b in zip(low, high)]
            index = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
            corner = self.grid.origin + index * VOXEL
            gap = np.maximum(np.maximum(corner - center, center - corner - VOXEL), 0.0)
            inside = index[np.linalg.norm(gap, axis=1) <= ball.radius]
            # above the box nobody looks
            below = inside[:, 2] < self.grid.shape[2] if self._upwards else inside[:, 2] >= 0
            inside = inside[below]
            points.append(np.asarray(self.grid.center(inside), float))
        hazards = np.concatenate(points).astype(np.float32)
        if self._overhead is not None:
            hazards = np.concatenate([hazards, self._above(hazards)])
        self._sequence += 1
        return WorkspaceSnapshot(
            sequence=self._sequence,
            stamp=stamp,
            oldest=stamp,
            grid=self.grid,
            state=self.state,
            distance=self.field,
            distance_cap=0.3,
            last_occupied=self._never,
            hazards=hazards,
            hazard_radius=0.5 * np.sqrt(3.0) * VOXEL,
            hazard_unknown=np.zeros(len(hazards), bool),
            cloud=hazards,
            cameras=(CameraStatus("cam", stamp, True, self._sequence + 1, 0),),
            distance_counts_unknown=True,
        )

    def _above(self, hazards: Points) -> Points:
        """The lid's points within a person's reach of what is seen right under it."""
        assert self._overhead is not None
        cells = self._overhead.cells
        if self._upwards:
            crossed = hazards[hazards[:, 2] > cells.origin[2] - VOXEL, :2]
        else:
            crossed = hazards[hazards[:, 2] < cells.origin[2] + cells.voxel + VOXEL, :2]
        if len(crossed) == 0:
            return np.empty((0, 3), np.float32)
        every = cells.center(np.indices(cells.shape).reshape(3, -1).T)[:, :2]
        away = np.asarray(cKDTree(crossed).query(every)[0])
        return self._overhead.points((away <= REACH_ABOVE).reshape(cells.shape[:2]))

    def _deliver(self) -> None:
        """Pictures and plans that have arrived by now."""
        if self.now >= self._next_picture - 1e-9:
            arrives = self.now + self.latency + MAP_LATENCY
            self._pictures.append((arrives, self.snapshot_at(self.now)))
            self._next_picture += 1.0 / self.rate
        while self._pictures and self._pictures[0][0] <= self.now + 1e-9:
            self.snapshot = self._pictures.pop(0)[1]
        while self.plans and self.plans[0][0] <= self.now + 1e-9:
            self.plan = self.plans.pop(0)[1]

    def _next_goal(self) -> JointIntent | None:
        if not self.goals:
            return None
        last = self.log[-1] if self.log else None
        if last is not None and last.reached and last.goal == f"G{self._goal % len(self.goals)}":
            self.visits.append(self.now)
            self._goal += 1
        k = self._goal % len(self.goals)
        return JointIntent(f"G{k}", self.goals[k])

    def _look(self) -> None:
        """Distance of the body, and of what moves of it, to the balls, and its fastest speed."""
        body = self.guard.body
        center, velocity = body.motion(self.q, self.v)
        fastest = body.fastest(self.q, self.v, velocity)
        surface = body.radius * body.turning(self.q, self.v)
        moves = np.linalg.norm(velocity, axis=1) + surface > MOVING
        for number, ball in enumerate(self.balls):
            gaps = np.linalg.norm(center - ball.center(self.now), axis=1) - body.radius
            nearest = int(np.argmin(gaps))
            least = float(gaps[moves].min(initial=np.inf)) - ball.radius
            gap = float(gaps[nearest]) - ball.radius
            touch = Touch(self.now, fastest, gap, number, nearest, least)
            self.margins.append(touch)
            if touch.distance < 0.0:
                self.touches.append(touch)


def _overhead(grid: VoxelGrid, box: tuple[Vector3, Vector3], up: Sequence[float]) -> Overhead:
    """The lid of a box without walls around it."""
    lower, upper = (tuple(float(x) for x in corner) for corner in box)
    config = MappingConfig(lower=lower, upper=upper, reach=REACH_ABOVE, up=tuple(up))  # type: ignore[arg-type]
    return Overhead(grid, config)


def _tool_velocity(robot: Robot, q: JointVector, v: JointVector) -> Vector3:
    """(3,) of the tool's centre of mass [m/s]."""
    center = np.zeros(3) if robot.tool is None else np.asarray(robot.tool.center_of_mass, float)
    here, there = flange_pose(robot, q), flange_pose(robot, q + 1e-6 * v)
    return np.asarray(((there - here)[:3, :3] @ center + (there - here)[:3, 3]) / 1e-6)


def felt(cell: QuickCell, push: Vector3 | None = None) -> list[Wrench]:
    """What an ideal force sensor has said since the last tick, at 500 Hz.

    Args:
        cell: whose tool it carries.
        push: (3,) force on the tip in ``base`` [N]; None for the tool's weight and inertia alone.
    """
    tool = cell.robot.tool
    assert tool is not None
    R = flange_pose(cell.robot, cell.q)[:3, :3]
    falls = -9.81 * np.asarray(cell.config.up, float) - cell._tool_pull
    weight = R.T @ (tool.mass * falls)
    force = weight if push is None else weight + R.T @ push
    torque = np.cross(tool.center_of_mass, weight)
    torque = torque + np.cross(tool.T_flange_tcp[:3, 3], force - weight)
    return [Wrench(cell.now - 0.008 + 0.002 * k, force, torque) for k in range(1, 5)]
