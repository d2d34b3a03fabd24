"""The smallest cell that a session can run: an integrator for an arm, a camera of empty frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, RgbdFrame
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera
from armsight.motion.data import GuardMode, GuardStatus, PlanRequest
from armsight.motion.intents import JointIntent
from armsight.motion.task import Subscriptions
from armsight.runtime.parts import Parts


class FakeClock:
    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time


class FakeArm:
    joint_names = ("a", "b")

    def __init__(self, clock):
        self.clock = clock
        self.log = []
        self.stops = 0
        self.lost = False
        self.clear()

    def clear(self):
        self.q = np.zeros(2)
        self.v = np.zeros(2)

    def advance(self, dt):
        self.q = self.q + dt * self.v

    status = None

    def read(self):
        if self.lost:
            raise DeviceError("arm: no answer; check its cable")
        return JointState(self.clock.time, self.q.copy(), self.v.copy())

    def command_velocity(self, velocity):
        if self.lost:
            raise DeviceError("arm: no answer; check its cable")
        self.v = np.clip(velocity, -1.0, 1.0)
        self.log.append((self.clock.time, *self.v))
        return self.v.copy()

    def stop(self):
        self.stops += 1
        self.v = np.zeros(2)


class FakeCamera:
    def __init__(self, clock, name="c", rate=30.0):
        self.clock = clock
        lens = PinholeCamera.from_fov(4, 3, 1.0, 0.8)
        self.info = RgbdCameraInfo(
            name, "ideal", lens, None, np.eye(4), "base", np.eye(4), rate, 0.0, (0.2, 4.0),
            DepthNoise(0.0, 0.0, 0.0),
        )  # fmt: skip
        self.dead = False
        self.sent = 0

    def read(self):
        if self.dead:
            raise DeviceError(f"camera {self.info.name}: unplugged")
        if int(self.clock.time * self.info.rate) < self.sent:
            return None
        self.sent += 1
        return RgbdFrame(
            self.info.name, self.sent - 1, self.clock.time, self.clock.time,
            np.full((3, 4), np.nan, np.float32),
        )  # fmt: skip

    def want_color(self, rate, scale=1.0):
        self.color = (rate, scale)


class FakeWorld:
    def __init__(self):
        self.clock = FakeClock()
        self.arm = FakeArm(self.clock)
        self.cameras = (FakeCamera(self.clock),)
        self.dragged = []
        self.resets = 0

    def advance(self, until):
        assert until >= self.clock.time
        self.arm.advance(until - self.clock.time)
        self.clock.time = until

    def reset(self):
        self.resets += 1
        self.clock.time = 0.0
        self.arm.clear()
        for camera in self.cameras:
            camera.sent = 0

    def bodies(self):
        return ()

    def movers(self):
        return ()

    def drag(self, name, position):
        self.dragged.append((name, tuple(position)))


class FakeMap:
    def __init__(self):
        self.calls = []

    def update(self, frames, joints, now, tracked=None):
        self.calls.append((now, [f.sequence for f in frames], joints.latest))
        return SimpleNamespace(sequence=len(self.calls), stamp=now, cameras=(), inside=())

    def animate(self, points):
        self.calls.append(("animated", len(points)))

    def declare_empty(self):
        self.calls.append("empty")

    def exclude(self, camera, reason):
        self.calls.append((camera, reason))

    def place(self, info):
        self.calls.append(("placed", info.name))


class FakePlanner:
    def plan(self, request, snapshot, time_limit, rng):
        return SimpleNamespace(request=request.sequence, failure="", draw=rng.random())


@dataclass
class FakeGuard:
    """Drives towards the goal once a plan for it has arrived."""

    seen: list = field(default_factory=list)
    fail_at: float = np.inf
    sequence: int = -1

    def step(self, now, joints, snapshot, goal, plan):
        if now >= self.fail_at:
            raise RuntimeError("on purpose")
        self.seen.append((now, joints, snapshot, goal, plan))
        goal = goal if isinstance(goal, JointIntent) else None
        request = None
        command = np.zeros(2)
        if goal is not None and joints is not None:
            if self.sequence < 0:
                self.sequence = 0
                request = PlanRequest(0, joints.position, goal)
            if plan is not None:
                command = np.clip(goal.position - joints.position, -0.5, 0.5)
        status = GuardStatus(
            now, GuardMode.IDLE, "", goal.name if goal else "", False, command, 1.0, np.inf, 0.0,
            None, None, None, None, -1, 0.0,
        )  # fmt: skip
        return SimpleNamespace(command=command, status=status, request=request, brake=False)


class GoTo:
    name = "go"

    period = 0.008
    latency = 0.0
    subscriptions = Subscriptions(snapshot=True)

    def __init__(self, position=(1.0, -1.0)):
        self.goal = JointIntent("G", np.array(position))

    def update(self, observation):
        return self.goal


def make_cell():
    world = FakeWorld()
    return SimpleNamespace(
        workcell=SimpleNamespace(name="fake"),
        clock=world.clock,
        arm=world.arm,
        cameras=world.cameras,
        world=world,
        sensors=(),
        mixed=False,
        show_joints=None,
        robot=SimpleNamespace(name="fake", n=2),
        health=lambda: (),
        stereo=(),
        gripper=None,
        empty_switch=None,
    )


def make_fake_parts(cell, config):
    return Parts(FakeMap(), FakePlanner(), FakeGuard())
