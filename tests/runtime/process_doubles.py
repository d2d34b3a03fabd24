"""What the tests of the command path's process make in another process: an arm, a guard."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field

import numpy as np
from doubles import FakeGuard, FakePlanner

from armsight.devices.port import ArmReading
from armsight.mapping.snapshot import FREE, CameraStatus, VoxelGrid, WorkspaceSnapshot
from armsight.runtime.parts import Parts


class NotedArm:
    """An integrator; every call of every process is a line of the file ``log``."""

    def __init__(self, settings):
        self.file = settings.connection["log"]
        self.q, self.v, self.at = np.zeros(2), np.zeros(2), time.perf_counter()
        self.note("open")

    def note(self, what):
        with open(self.file, "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()} {what}\n")

    def read(self):
        now = time.perf_counter()
        self.q, self.at = self.q + (now - self.at) * self.v, now
        return ArmReading(now, self.q.copy(), self.v.copy())

    def command_velocity(self, velocity):
        self.note("command")
        self.v = velocity

    def stop(self):
        self.note("stop")
        self.v = np.zeros(2)

    def close(self):
        self.note("close")


class StubbornArm(NotedArm):
    """Its stop() raises."""

    def stop(self):
        super().stop()
        raise RuntimeError("no brakes")


def snapshot(number=1, hazards=5, seed=0):
    """A small map with numbers of its own in every array."""
    rng = np.random.default_rng((seed, number))
    grid = VoxelGrid(np.zeros(3), 0.02, (4, 5, 6))
    floats = [rng.random(grid.shape).astype(np.float32) for _ in range(2)]
    return WorkspaceSnapshot(
        number, 0.1 * number, 0.1 * number - 0.03, grid,
        np.full(grid.shape, FREE, np.uint8), floats[0], 0.3, floats[1],
        rng.random((hazards, 3)).astype(np.float32), 0.02, rng.random(hazards) < 0.5,
        rng.random((7, 3)).astype(np.float32), (CameraStatus("c", 0.1 * number, True, number, 0),),
        things=rng.random((3, 3)).astype(np.float32),
    )  # fmt: skip


@dataclass
class SmallMap:
    """Another small map at every update."""

    number: int = 0
    told: list = field(default_factory=list)

    def update(self, frames, joints, now, tracked=None):
        self.number += 1
        return snapshot(self.number)


class Failing:
    """A guard that raises in its tenth tick."""

    def __init__(self):
        self.fake, self.ticks = FakeGuard(), 0

    def step(self, *inputs):
        self.ticks += 1
        if self.ticks == 10:
            raise RuntimeError("on purpose")
        return self.fake.step(*inputs)


def make_parts_for(elsewhere):
    """Parts whose guard is made in the other process."""
    return lambda cell, config: Parts(SmallMap(), FakePlanner(), FakeGuard(), elsewhere=elsewhere)
