"""The simulated cell: one object that owns physics, people, cameras and time."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import RgbdFrame
from armsight.simulation.arm import SimulatedArm
from armsight.simulation.cameras import SimulatedCamera
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.gl import mujoco
from armsight.simulation.model import build_model
from armsight.simulation.people import person_body
from armsight.simulation.rendering import Renderer
from armsight.simulation.skeleton import Proportions
from armsight.simulation.spec import WorldSpec


class SimulatedWorld:
    """See the module."""

    def __init__(self, spec: WorldSpec, seed: int = 0) -> None:
        self.spec = spec
        self.clock = SimulatedClock()
        people = [person_body(p.name, Proportions(p.height)) for p in spec.people]
        self.cell = build_model(spec, people, spec.arm.robot.T_link_joint, (640, 480))
        self._data: Any = mujoco.MjData(self.cell.model)
        self.arm = SimulatedArm(spec.arm, self.clock, spec.time_step, seed)
        self.cameras = tuple(SimulatedCamera(c, self.clock) for c in spec.cameras)
        self.renderer = Renderer(self.cell)
        self.reset()

    def reset(self) -> None:
        mujoco.mj_resetData(self.cell.model, self._data)
        n = self.spec.arm.robot.n
        self._data.qpos[:n] = self.spec.arm.home
        self._data.ctrl[:n] = self.spec.arm.home
        mujoco.mj_forward(self.cell.model, self._data)
        self._step = 0
        self.clock._set(0.0)
        self.arm.reset()
        for camera in self.cameras:
            camera.reset()

    def advance(self, until: float) -> None:
        dt = self.spec.time_step
        m, d = self.cell.model, self._data
        n = self.spec.arm.robot.n
        q, qd, ctrl, eff = d.qpos[:n], d.qvel[:n], d.ctrl, d.qfrc_actuator[:n]
        while True:
            now = self._step * dt
            self._expose(now)
            if now + dt > until + 1e-9:
                break
            self.arm.before_step(now, q, ctrl)
            mujoco.mj_step(m, d)
            self._step += 1
            self.arm.sense(self._step, self._step * dt, q, qd, eff)
        self.clock._set(max(until, self.clock.now()))

    def _expose(self, now: float) -> None:
        due = [c for c in self.cameras if c.next_exposure() <= now + 1e-9]
        if not due:
            return
        mujoco.mj_kinematics(self.cell.model, self._data)
        mujoco.mj_camlight(self.cell.model, self._data)
        for camera in due:
            T = self.camera_pose(camera)
            info = camera.info
            shot = self.renderer.take(self._data, T, info.depth)
            picture = self.renderer.depth(shot, info.depth)
            depth = picture.depth
            low, high = info.range
            depth[(depth < low) | (depth > high)] = np.nan
            color = None
            if camera.wants_color and info.color is not None:
                self.renderer.aim(shot, T @ info.T_depth_color, info.color)
                color = self.renderer.color(shot, info.color)
            self.renderer.give_back(shot)
            camera.deliver(
                RgbdFrame(info.name, camera.sequence, now, now + info.latency, depth, color)
            )
            camera.sequence += 1

    def camera_pose(self, camera: SimulatedCamera) -> Pose:
        return camera.spec.T_mount_camera_true

    def close(self) -> None:
        self.renderer.close()
