"""The pair on the wrist calibrated in a rendered cell: how far off points are through it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from armsight.arrays import Floats, Points, Pose
from armsight.calibration.live.wrist import FAR
from armsight.devices.data import StereoInfo
from armsight.errors import CalibrationError
from armsight.experiments.calibration_cell import carried_out
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Progress
from armsight.geometry.pose import inverse, transform
from armsight.robots.kinematics import flange_pose
from armsight.robots.robot import Robot
from armsight.runtime.config import SessionConfig
from armsight.runtime.configure import mapping_config
from armsight.runtime.session import Session
from armsight.simulation.arm_errors import true_geometry
from armsight.simulation.cameras import SimulatedStereo
from armsight.simulation.gl import mujoco
from armsight.simulation.world import SimulatedWorld
from armsight.tasks.calibrate_wrist import CalibrateWristTask, ball_at_rest, wrist_setup
from armsight.tasks.calibration_cell import unseen_is_empty
from armsight.workcell import open_cell
from armsight.workcell.build import simulated_world
from armsight.workcell.packaged import load

CELL = "ur10_servoing"
NEAR = 0.20
"""Points are judged from here to :data:`FAR` before the pair [m]."""
AROUND = 0.5
"""Of an arm that stands so far from home at most, each joint [rad]."""
POINTS = 400
"""Places, each with joints of its own."""


def cells(runs: int, seed: int, progress: Progress) -> list[dict[str, Any]]:
    """Cells with errors of their own, their pairs calibrated; kept as they end."""
    return run_episodes("servo-registration-wrist", one, range(runs), seed, progress)


def one(first: int, run: int) -> dict[str, Any]:
    """One cell: true errors before and after, by a mount that is exact, and what is stated [m].

    A pair whose calibration fails stays where the cell's file has it.
    """
    seed = first + run
    workcell = ball_at_rest(load(CELL))
    with open_cell(workcell, seed, calibrated=False) as cell:
        mapping = unseen_is_empty(mapping_config(workcell, cell.T_world_base, cell.robot.reach))
        setup = wrist_setup(cell, mapping)
        task = CalibrateWristTask(cell, setup, np.random.default_rng(seed))
        session = Session(cell, task, seed=seed, config=SessionConfig(mapping=mapping))
        result, why = None, ""
        try:
            result, _ = carried_out(session, task)
        except CalibrationError as error:
            why = str(error)
        world = simulated_world(cell)
        pair = next(p for p in world.stereo_cameras if p.info.name == setup.pair.name)
        robot = as_built(cell.robot, world, seed)

        def off(T: Pose) -> Floats:
            return errors(cell.robot, robot, world, pair, T, np.random.default_rng(seed))

        mount = setup.pair.T_mount_camera
        after = off(mount if result is None else result.T_flange_camera)
        return {
            "before": float(off(mount).mean()),
            "after": float(after.mean()),
            "p95": float(np.percentile(after, 95.0)),
            "exact": float(off(pair.T_mount_camera).mean()),
            "stated": None if result is None else result.target_error,
            "rms": None if result is None else result.rms,
            "looks": 0 if result is None else result.used,
            "why": why,
            "seconds": session.now(),
            "contacts": len(world.truth.contacts),
        }


def as_built(robot: Robot, world: SimulatedWorld, seed: int) -> Robot:
    """The arm with the geometry that the simulation has drawn for it."""
    scale = world.spec.arm.kinematic_error
    geometry = true_geometry(robot, scale, np.random.default_rng((seed, 10)))
    return replace(robot, T_link_joint=geometry)


def errors(
    believed: Robot,
    built: Robot,
    world: SimulatedWorld,
    pair: SimulatedStereo,
    T_flange_camera: Pose,
    rng: np.random.Generator,
) -> Floats:
    """(k,) errors of points through the pair and the joints, as they are reported [m].

    Args:
        believed: the arm as the cell has it.
        built: as it is.
        world: whose weights the joints bear.
        pair: as it is.
        T_flange_camera: where it is believed to be.
        rng: of joints and points.
    """
    model = world._cell.model
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    home = np.asarray(believed.home, float)
    out = []
    for _ in range(POINTS):
        joints = np.clip(
            home + rng.uniform(-AROUND, AROUND, believed.n),
            believed.limits.lower,
            believed.limits.upper,
        )
        data.qpos[: believed.n] = joints
        mujoco.mj_forward(model, data)
        told = joints + world.arm.compliance * data.qfrc_gravcomp[: believed.n]
        z = rng.uniform(NEAR, FAR)
        half = 0.8 * np.array([0.5 * pair.info.left.width, 0.5 * pair.info.left.height])
        u, v = rng.uniform(-half, half)
        point = np.array([[z * u / pair.info.left.fx, z * v / pair.info.left.fy, z]])
        true = transform(flange_pose(built, joints) @ pair.T_mount_camera, point)
        seen = measured(pair.info, pair, point)
        has = transform(flange_pose(believed, told) @ T_flange_camera, seen)
        out.append(float(np.linalg.norm(has - true)))
    return np.array(out)


def measured(info: StereoInfo, pair: SimulatedStereo, points: Points) -> Points:
    """(k, 3) points of the left lens's frame as a pair has them whose lenses are believed."""
    unit = pair.unit
    assert unit.color is not None
    T_right_left = inverse(unit.T_depth_color)
    left = unit.depth.project(points)
    right = unit.color.project(transform(T_right_left, points))
    return np.asarray(info.lenses.triangulate(left, right))
