"""A simulated cell ready to be calibrated: the task on it, photographs, truth, and scoring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats, JointVector, Pose
from armsight.calibration.calibrate import Calibration, target_points
from armsight.calibration.live.log import ProcedureOptions
from armsight.calibration.live.result import LiveResult
from armsight.calibration.live.setup import Setup
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.runtime.config import SessionConfig
from armsight.runtime.configure import mapping_config
from armsight.runtime.session import Session
from armsight.simulation.cameras import SimulatedCamera
from armsight.simulation.scoring import systematic
from armsight.simulation.world import SimulatedWorld
from armsight.tasks.calibrate import CalibrateTask
from armsight.tasks.calibration_cell import calibration_setup, to_calibrate, unseen_is_empty
from armsight.tasks.procedure_task import ProcedureTask
from armsight.workcell import Cell, open_cell
from armsight.workcell.build import simulated_world
from armsight.workcell.schema import Workcell

Result = TypeVar("Result")
FRAMES = 5
"""Exposures averaged in a photograph."""


@dataclass(frozen=True)
class Photograph:
    """What one camera sees of the resting arm: several exposures averaged.

    Attributes:
        color, infrared: (h, w) uint8 grey.
        depth: (h, w) float32 [m] at the infrared picture's resolution; NaN without a return.
    """

    color: Bytes
    infrared: Bytes
    depth: DepthImage


class CalibrationCell:
    """Everything that a calibration in simulation needs.

    Attributes:
        cell: open; setup: as believed; world: the truth.
        T_world_base: where the arm stands.
    """

    def __init__(self, workcell: Workcell, seed: int) -> None:
        self.cell: Cell = open_cell(to_calibrate(workcell), seed, calibrated=False)
        self.world: SimulatedWorld = simulated_world(self.cell)
        self.T_world_base = self.cell.T_world_base
        file, reach = self.cell.workcell, self.cell.robot.reach
        self._mapping = unseen_is_empty(mapping_config(file, self.T_world_base, reach))
        self.setup: Setup = calibration_setup(self.cell, self._mapping)
        self._joints = np.array(self.cell.robot.home)
        self._taken = 0

    def calibrate(self, options: ProcedureOptions, seed: int) -> tuple[LiveResult, float]:
        """Run the task on the cell; the result and the robot time that it took [s].

        Raises:
            CalibrationError: it failed; the message says why.
        """
        task = CalibrateTask(self.setup, options, np.random.default_rng(seed))
        config = SessionConfig(mapping=self._mapping, patience=3600.0, planning_time=0.2)
        return carried_out(Session(self.cell, task, seed=seed, config=config), task)

    def camera(self, rig: int) -> SimulatedCamera:
        """A camera with the truth about it."""
        return self.world.cameras[rig]

    def infrared(self, rig: int) -> PinholeCamera:
        """The true lens of a camera's infrared picture."""
        camera = self.camera(rig)
        return camera.unit.infrared(camera.info.infrared_scale)

    def T_base_camera(self, rig: int) -> Pose:
        """Where a camera truly is."""
        return np.asarray(inverse(self.T_world_base) @ self.camera(rig).T_mount_camera)

    def place(self, joints: JointVector) -> None:
        """Put the arm there at once, sagging as it would; for pools of photographs."""
        self._joints = np.array(joints, float)
        self.world.place(self._joints)

    def joints(self) -> JointVector:
        """Where the arm was placed, as it reports [rad]."""
        return self._joints

    def photograph(self, rig: int) -> Photograph:
        """What a camera sees of the placed arm."""
        color, infrared, depth = [], [], []
        for _ in range(FRAMES):
            self._taken += 1
            frame = self.world.snap(rig, self._taken)
            assert frame.color is not None
            assert frame.infrared is not None
            color.append(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY).astype(np.float32))
            infrared.append(frame.infrared.astype(np.float32))
            depth.append(frame.depth)
        mean = np.nanmean(np.stack(depth), axis=0) if len(depth) else depth[0]
        scale = self.camera(rig).info.infrared_scale
        return Photograph(
            np.rint(np.mean(color, axis=0)).astype(np.uint8),
            np.rint(np.mean(infrared, axis=0)).astype(np.uint8),
            np.kron(mean, np.ones((scale, scale))).astype(np.float32),
        )

    def close(self) -> None:
        """Let the simulation go."""
        self.cell.close()


def carried_out(session: Session, task: ProcedureTask[Result]) -> tuple[Result, float]:
    """Run a session until its calibration has ended; the result and the robot time [s].

    Raises:
        ArmsightError: it failed; the message says why.
    """
    while not task.done and not session.task_failure:
        session.run(1.0)
    if task.result is None:
        raise task.error or CalibrationError(session.task_failure)
    return task.result, session.now()


def open_calibration_cell(workcell: Workcell, seed: int = 0) -> CalibrationCell:
    """A simulated cell with a board on its flange."""
    return CalibrationCell(workcell, seed)


def true_lens(cell: CalibrationCell, rig: int, name: str) -> tuple[PinholeCamera, Pose]:
    """The true lens of a camera by its name in the answer, and ``T_base_lens``."""
    unit, T = cell.camera(rig).unit, cell.T_base_camera(rig)
    if name.endswith("color") and unit.color is not None:
        return unit.color, T @ unit.T_depth_color
    return cell.infrared(rig), T


def ray_points(camera: PinholeCamera, T: Pose, pixels: Floats, z: Floats) -> Floats:
    """(t, 3) points by (t, 2) pixels and (t,) depths, in the frame that T maps to [m]."""
    ray = np.column_stack([camera.normalise(pixels), np.ones(len(z))]) * z[:, None]
    return np.asarray(ray @ T[:3, :3].T + T[:3, 3])


def true_target_errors(cell: CalibrationCell, answer: Calibration) -> dict[str, float]:
    """True target error of each lens [m]: pixel and true depth into the base."""
    out = {}
    for index, lens in enumerate(answer.problem.lenses):
        T = answer.camera_pose(lens.rig) @ answer.lens_pose(index)
        pixels, z = target_points(lens.camera)
        d = ray_points(answer.lens(index), T, pixels, z)
        d = d - ray_points(*true_lens(cell, lens.rig, lens.name), pixels, z)
        out[lens.name] = float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
    return out


def true_depth_errors(cell: CalibrationCell, result: LiveResult) -> dict[str, float]:
    """Median absolute depth error after the depth model, 1-2 m, over the image [m]."""
    out = {}
    for index, model in enumerate(result.depth):
        camera = cell.camera(index)
        errors, lens = camera.unit.errors, camera.unit.depth
        if model is None or errors is None:
            out[camera.info.name] = float("nan")
            continue
        u, v = np.meshgrid(np.linspace(0.05, 0.95, 9), np.linspace(0.05, 0.95, 7))
        pixel = np.stack([u.ravel() * (lens.width - 1), v.ravel() * (lens.height - 1)], 1)
        left = []
        for d in np.linspace(1.0, 2.0, 21):
            depth = np.full(len(pixel), d)
            measured = depth + systematic(errors, lens, pixel, depth)
            true = measured.copy()
            for _ in range(3):
                true = measured - model.error(true, pixel, lens)
            left.append(true - depth)
        out[camera.info.name] = float(np.median(np.abs(left)))
    return out
