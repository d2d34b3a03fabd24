"""A cell without pictures: an arm with delayed drives, and snapshots made from moving balls.

Fast enough for thousands of seconds a minute of guard; the map is perfect but late, as a map is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo
from armsight.geometry.camera import PinholeCamera
from armsight.mapping.snapshot import FREE, CameraStatus, VoxelGrid, WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.guard import Guard
from armsight.motion.guard_config import GuardConfig
from armsight.motion.keep_out import SeparationPlanner
from armsight.motion.planner import PlannerConfig, RrtConnectPlanner
from armsight.robots import load_robot
from armsight.robots.kinematics import sphere_centers
from armsight.simulation.kernels import drive_step

STEP = 0.002
VOXEL = 0.02


@dataclass
class Ball:
    """A hand: centre at a time, and radius [m]."""

    center: Callable[[float], np.ndarray]
    radius: float = 0.05


@dataclass
class GuardWorld:
    """Runs guard, planner and a kinematic arm on balls.

    Attributes:
        rate, latency: of the pictures [Hz], [s].
        balls: who moves; goals: visited in turn.
        contacts: (time, speed of the arm's fastest point [m/s], distance) of every contact.
    """

    balls: Sequence[Ball] = ()
    goals: Sequence[np.ndarray] = ()
    rate: float = 30.0
    latency: float = 0.04
    name: str = "ur5"
    config: GuardConfig = field(default_factory=GuardConfig)
    seed: int = 0

    def __post_init__(self):
        self.robot = load_robot(self.name)
        lens = PinholeCamera.from_fov(64, 48, 1.2, 1.0)
        self.info = RgbdCameraInfo(
            "cam", "ideal", lens, None, np.eye(4), "base", np.eye(4), self.rate,
            self.latency, (0.3, 4.5), DepthNoise(0, 0, 0),
        )  # fmt: skip
        half = 1.2
        count = int(2 * half / VOXEL)
        self.grid = VoxelGrid(np.full(3, -half), VOXEL, (count, count, count))
        self.empty = np.full(self.grid.shape, FREE, np.uint8)
        self.field = np.full(self.grid.shape, 0.3, np.float32)
        self.never = np.full(self.grid.shape, -np.inf, np.float32)
        self.model = CollisionModel(self.robot)
        self.guard = Guard(self.robot, [self.info], (), self.config, self.model)
        planner = RrtConnectPlanner(
            self.robot,
            CollisionModel(self.robot),
            PlannerConfig(speed=self.config.speed, acceleration=self.config.acceleration),
        )
        self.planner = SeparationPlanner(planner, self.robot, [self.info], self.config)
        self.reset()

    def reset(self):
        n = self.robot.n
        self.now = 0.0
        self.q = np.array(self.robot.home, float)
        self.v = np.zeros(n)
        self.target = np.zeros(n)
        self.braking = True
        self.queue = []
        self.sequence = -1
        self.snapshot = None
        self.pictures = []
        self.next_picture = 0.0
        self.plan = None
        self.plans = []
        self.contacts = []
        self.log = []
        self.commands = []
        self.goal_index = 0
        self.visits = []
        self.rng = np.random.default_rng(self.seed)

    def picture(self, stamp):
        """What a perfect map would say of the balls at a time."""
        points = []
        for ball in self.balls:
            c = np.asarray(ball.center(stamp), float)
            low = np.floor((c - ball.radius - self.grid.origin) / VOXEL).astype(int)
            high = np.floor((c + ball.radius - self.grid.origin) / VOXEL).astype(int)
            axes = [np.arange(a, b + 1) for a, b in zip(low, high)]
            ix = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
            lo = self.grid.origin + ix * VOXEL
            gap = np.maximum(np.maximum(lo - c, c - lo - VOXEL), 0.0)
            points.append(self.grid.center(ix[np.linalg.norm(gap, axis=1) <= ball.radius]))
        hazards = np.concatenate(points) if points else np.empty((0, 3))
        self.sequence += 1
        return self.make_snapshot(hazards.astype(np.float32), stamp)

    def make_snapshot(self, hazards, stamp):
        return WorkspaceSnapshot(
            self.sequence, stamp, stamp, self.grid, self.empty, self.field, 0.3, self.never,
            hazards, 0.5 * np.sqrt(3.0) * VOXEL, np.zeros(len(hazards), bool),
            np.empty((0, 3), np.float32), (CameraStatus("cam", stamp, True, 1, 0),),
            distance_counts_unknown=True,
        )  # fmt: skip

    def drive(self, until):
        limits = self.robot.limits
        while self.now < until - 1e-9:
            while self.queue and self.queue[0][0] <= self.now + 1e-9:
                _, self.target, self.braking = self.queue.pop(0)
            drive_step(
                self.target, self.braking, self.q, self.v, limits.lower, limits.upper,
                limits.acceleration * self.config.acceleration, limits.acceleration, STEP,
            )  # fmt: skip
            self.now += STEP
            if self.balls and round(self.now / STEP) % 5 == 0:
                self.check_contacts()

    def check_contacts(self):
        c = sphere_centers(self.robot, self.q)
        _, speed = self.guard._gate.body.motion(self.q, self.v)
        fastest = float(np.linalg.norm(speed, axis=1).max())
        for ball in self.balls:
            d = np.linalg.norm(c - ball.center(self.now), axis=1) - self.robot.spheres.radius
            d = float(d.min() - ball.radius)
            if d < 0.0:
                self.contacts.append((self.now, fastest, d))

    def tick(self, joints="read", snapshot="read", goal="next", clock=None):
        """One guard tick of 8 ms."""
        if self.now >= self.next_picture - 1e-9:
            self.pictures.append((self.now + self.latency + 0.012, self.picture(self.now)))
            self.next_picture += 1.0 / self.rate
        while self.pictures and self.pictures[0][0] <= self.now + 1e-9:
            self.snapshot = self.pictures.pop(0)[1]
        while self.plans and self.plans[0][0] <= self.now + 1e-9:
            self.plan = self.plans.pop(0)[1]
        if isinstance(joints, str):
            joints = JointState(self.now, self.q.copy(), self.v.copy())
        if isinstance(snapshot, str):
            snapshot = self.snapshot
        if isinstance(goal, str):
            goal = self.next_goal()
        now = self.now if clock is None else clock
        decision = self.guard.step(now, joints, snapshot, goal, self.plan)
        act = self.now + self.config.start_delay
        self.queue.append((act, decision.command.copy(), decision.brake))
        self.commands.append(np.append(decision.command, decision.brake))
        if decision.request is not None:
            plan = self.planner.plan(decision.request, self.snapshot, 0.05, self.rng)
            self.plans.append((self.now + 0.05, plan))
        self.log.append(decision.status)
        self.drive(self.now + 0.008)
        return decision

    def next_goal(self):
        from armsight.motion.data import JointGoal

        if not len(self.goals):
            return None
        k = self.goal_index % len(self.goals)
        if self.log and self.log[-1].reached and self.log[-1].goal == f"G{k}":
            self.visits.append(self.now)
            self.goal_index += 1
            k = self.goal_index % len(self.goals)
        return JointGoal(f"G{k}", self.goals[k])

    def run(self, seconds):
        for _ in range(round(seconds / 0.008)):
            self.tick()
        return self

    @property
    def moving_contacts(self):
        return [c for c in self.contacts if c[1] > 0.05]
