"""What stands in for hardware in ``wall-loop``: an arm and cameras behind drivers of the port.

The arm is a formula, not a thread: where it is follows from its last command, so it needs no time
of a processor and is the same for every process that looks. Its state and the time of every command
lie in shared memory. The cameras play recorded pictures of the cell without its arm, with noise of
their own, and draw the arm's meshes over them where it is at the exposure.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import DepthImage, Floats, Ints, JointVector, Points
from armsight.devices.data import DepthNoise
from armsight.devices.port import (
    ArmReading,
    ArmSettings,
    CameraReport,
    CameraSettings,
    Connection,
    DepthReading,
)
from armsight.errors import DeviceError
from armsight.experiments.wall_lab_kernels import draw
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.robots import load_robot
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import read_mesh
from armsight.robots.robot import Robot
from armsight.runtime.shared_block import SharedBlock
from armsight.workcell import Cell, simulated_world
from armsight.writing import write_text

COMMANDS = 400_000
"""Commands that can be noted: 40 minutes at the highest rate that was seen."""
DIRECTIONS = 4
"""In which the arm stands in turn while the cell is recorded."""
SETTLE = 2
"""First pictures that still show the arm where it was."""
NOISE = 1 << 20
"""Samples of noise that are drawn from."""
ARM = np.dtype(
    [
        ("begun", "u8"), ("ended", "u8"), ("at", "f8"), ("until", "f8"), ("acceleration", "f8", 6),
        ("q", "f8", 6), ("v", "f8", 6), ("target", "f8", 6), ("count", "u8"),
        ("commands", "f8", COMMANDS),
    ]
)  # fmt: skip


def moved(q: Floats, v: Floats, target: Floats, most: Floats, dt: float) -> tuple[Floats, Floats]:
    """Joints and speeds after ``dt`` [s] of ramping to a target speed, and of keeping it."""
    change = target - v
    ramp = np.minimum(np.abs(change) / most, dt)
    bend = np.sign(change) * most
    faster = v + bend * ramp
    return q + v * ramp + 0.5 * bend * ramp * ramp + faster * (dt - ramp), faster


class LabArm:
    """The arm's state in shared memory.

    Args:
        block: of :meth:`needs` bytes; one process at a time commands, any may look.
    """

    def __init__(self, block: SharedBlock) -> None:
        self._block = block
        self._arm = np.frombuffer(block.memory, ARM, 1)

    @staticmethod
    def needs() -> int:
        """Bytes."""
        return int(ARM.itemsize)

    def command(self, target: JointVector, valid: float, most: Floats) -> None:
        """Ramp to a speed [rad/s] with at most ``most`` [rad/s^2]; to rest after ``valid`` [s]."""
        now, arm = time.perf_counter(), self._arm[0]
        q, v = self.joints(now)
        arm["begun"] += 1
        arm["at"], arm["until"] = now, now + valid
        arm["q"], arm["v"], arm["target"], arm["acceleration"] = q, v, target, most
        arm["ended"] = arm["begun"]
        arm["commands"][int(arm["count"]) % COMMANDS] = now
        arm["count"] += 1

    def joints(self, now: float) -> tuple[JointVector, JointVector]:
        """Positions and speeds at a time since the last command [s]."""
        state = self._state()
        while state is None:  # somebody commands it just now
            state = self._state()
        at, until, most, q, v, target = state
        if at == 0.0:
            return q, v
        q, v = moved(q, v, target, most, max(min(now, until) - at, 0.0))
        if now > until:  # its watchdog
            q, v = moved(q, v, np.zeros(6), most, now - until)
        return q, v

    def _state(self) -> tuple[float, float, Floats, Floats, Floats, Floats] | None:
        """What it does, or None while it is being written."""
        arm = self._arm[0]
        before = int(arm["ended"])
        state = (
            float(arm["at"]), float(arm["until"]), arm["acceleration"].copy(), arm["q"].copy(),
            arm["v"].copy(), arm["target"].copy(),
        )  # fmt: skip
        return state if int(arm["begun"]) == before else None

    def place(self, q: JointVector) -> None:
        """Put it somewhere, at rest, before anybody commands."""
        self._arm[0]["q"] = q

    def close(self) -> None:
        """Look no more."""
        self._arm = np.zeros(1, ARM)

    def commands(self) -> Floats:
        """When commands came [s on time.perf_counter()]."""
        count = int(self._arm[0]["count"])
        if count > COMMANDS:
            raise ValueError("more commands than were to be noted")
        return np.array(self._arm[0]["commands"][:count])


class Arm:
    """The driver of the arm; ``connection``: name of the memory (``lab``), and of its ``robot``."""

    def __init__(self, settings: ArmSettings) -> None:
        self._block = _attach(settings.connection)
        self._arm = LabArm(self._block)
        self._settings = settings
        self._brake = load_robot(str(settings.connection["robot"])).limits.acceleration

    def read(self) -> ArmReading:
        """Where it is now."""
        now = time.perf_counter()
        return ArmReading(now, *self._arm.joints(now))

    def command_velocity(self, velocity: JointVector) -> None:
        """Ramp to it."""
        self._arm.command(velocity, self._settings.watchdog, self._settings.acceleration)

    def stop(self) -> None:
        """Ramp to rest as fast as its drives can."""
        self._arm.command(np.zeros(6), self._settings.watchdog, self._brake)

    def close(self) -> None:
        """Let go of the memory."""
        self._arm.close()
        self._block.close()


class Camera:
    """The driver of a camera.

    ``connection``: ``lab``, ``robot``, ``pictures`` (their folder), ``phase`` [s].
    """

    def __init__(self, settings: CameraSettings) -> None:
        self._block = _attach(settings.connection)
        self._arm = LabArm(self._block)
        folder = Path(str(settings.connection["pictures"]))
        about = json.loads((folder / f"{settings.name}.json").read_text(encoding="utf-8"))
        self._pictures = np.load(folder / f"{settings.name}.npy")
        self.report = CameraReport(
            "recorded", _lens(about["lens"]), about["rate"], tuple(about["range"]),
            DepthNoise(**about["noise"]), about["latency"],
        )  # fmt: skip
        self._T_camera_base = inverse(np.array(about["T_base_camera"]))
        self._robot = load_robot(str(settings.connection["robot"]))
        self._parts, self._faces = _body(self._robot)
        self._noise = np.random.default_rng(0).normal(size=NOISE).astype(np.float32)
        self._phase = float(settings.connection["phase"])
        self._count = 0
        self._due = 0.0

    def read(self) -> DepthReading:
        """Waits for the next exposure and for its arrival."""
        period, now = 1.0 / self.report.rate, time.perf_counter()
        if now > self._due + period or self._due == 0.0:  # late by a picture: that one is lost
            self._due = (np.floor((now - self._phase) / period) + 1.0) * period + self._phase
        time.sleep(max(self._due - now, 0.0))
        stamp = time.perf_counter()
        depth = self._picture(self._arm.joints(stamp)[0])
        arrival = stamp + self.report.latency
        self._due += period
        self._count += 1
        time.sleep(max(arrival - time.perf_counter(), 0.0))
        return DepthReading(stamp, depth, sequence=self._count)

    def _picture(self, q: JointVector) -> np.ndarray:
        lens = self.report.depth
        recorded = self._pictures[self._count % len(self._pictures)]
        first = (7919 * self._count) % (NOISE - recorded.size)
        noise = self._noise[first : first + recorded.size].reshape(recorded.shape)
        poses = self._T_camera_base @ link_poses(self._robot, q)
        seen = np.concatenate([transform(poses[link], points) for link, points in self._parts])
        depth = np.empty_like(recorded)
        sigma = self.report.noise
        draw(
            recorded, noise, (sigma.a, sigma.b, sigma.c), seen, self._faces,
            (lens.fx, lens.fy, lens.cx, lens.cy), depth,
        )  # fmt: skip
        return depth

    def want_color(self, wanted: bool) -> None:
        """There is none."""

    def close(self) -> None:
        """Let go of the memory."""
        self._arm.close()
        self._block.close()


def _lens(told: dict[str, Any]) -> PinholeCamera:
    return PinholeCamera(**(told | {"distortion": tuple(told["distortion"])}))


def _attach(connection: Connection) -> SharedBlock:
    try:
        return SharedBlock(str(connection["lab"]))
    except OSError as error:
        raise DeviceError(f"the lab of wall-loop is gone ({error}); run the experiment") from error


def _body(robot: Robot) -> tuple[list[tuple[int, Points]], Ints]:
    """The arm's meshes: link and vertices in its frame of each, and the triangles of all."""
    parts: list[tuple[int, Points]] = []
    faces: list[Ints] = []
    count = 0
    for mesh in robot.meshes:
        points, triangles = read_mesh(mesh)
        parts.append((mesh.link, points))
        faces.append(triangles + count)
        count += len(points)
    return parts, np.concatenate(faces)


def record(cell: Cell, stance: JointVector, count: int, folder: Path) -> None:
    """Record pictures of a simulated cell without its arm, and what the cameras say they are.

    The arm stands in four directions in turn. Of every pixel the farthest return is kept; none
    where more than one is missing: what lies behind the arm may be out of range.

    Args:
        cell: simulated.
        stance: (n,) the arm with its first joint at 0, reaching out [rad].
        count: pictures a camera.
        folder: where to.
    """
    world = simulated_world(cell)
    taken: list[dict[str, list[DepthImage]]] = []
    for turn in range(DIRECTIONS):
        q = np.array(stance, float)
        q[0] = 2.0 * np.pi * turn / DIRECTIONS
        pictures: dict[str, list[DepthImage]] = {c.info.name: [] for c in cell.cameras}
        world.show_joints(q)
        while min(len(p) for p in pictures.values()) < count + SETTLE:
            world.advance(world.clock.now() + 0.004)
            world.show_joints(q)
            for camera in cell.cameras:
                frame = camera.read()
                if frame is not None:
                    pictures[frame.camera].append(frame.depth)
        taken.append(pictures)
    for camera in cell.cameras:
        info = camera.info
        stacks = np.stack([p[info.name][SETTLE : SETTLE + count] for p in taken])
        seen = np.isfinite(stacks).sum(axis=0) >= DIRECTIONS - 1
        farthest = np.where(seen, np.fmax.reduce(stacks), np.float32(np.nan))
        np.save(folder / f"{info.name}.npy", farthest)
        about = {
            "lens": asdict(info.depth),
            "noise": asdict(info.noise),
            "rate": info.rate,
            "range": info.range,
            "latency": info.latency,
            "T_base_camera": info.T_mount_camera.tolist(),
        }
        write_text(folder / f"{info.name}.json", json.dumps(about))
