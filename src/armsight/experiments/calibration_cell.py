"""A simulated cell ready to be calibrated: world, studio, mover, what is believed, and scoring."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, JointVector, Pose
from armsight.calibration.boards import Board, Checkerboard, raster
from armsight.calibration.calibrate import Calibration, target_points
from armsight.calibration.live.result import LiveResult
from armsight.calibration.live.seen import Picture
from armsight.calibration.live.setup import CameraSetup, Setup
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.simulation.board import BoardStudio, Print, StudioErrors
from armsight.simulation.spec import ArmSpec
from armsight.simulation.studio_mover import StudioMover
from armsight.simulation.world import SimulatedWorld
from armsight.workcell.build import world_spec
from armsight.workcell.schema import Workcell

PER_METER = 6000
"""Pixels a metre of the print in simulation: 180 a square of 30 mm."""


@dataclass
class CalibrationCell:
    """Everything that a calibration in simulation needs.

    Attributes:
        setup: as believed; world, studio: the truth; mover: moves and photographs.
        T_world_base: where the arm stands.
    """

    setup: Setup
    world: SimulatedWorld
    studio: BoardStudio
    mover: StudioMover
    T_world_base: Floats

    def move(self, joints: JointVector) -> bool:
        """See :class:`armsight.calibration.live.drive.Mover`."""
        return self.mover.move(joints)

    def joints(self) -> JointVector:
        """See :class:`armsight.calibration.live.drive.Mover`."""
        return self.mover.joints()

    def now(self) -> float:
        """See :class:`armsight.calibration.live.drive.Mover`."""
        return self.mover.now()

    def look(self, cameras: tuple[int, ...], rest: float, frames: int) -> list[Picture]:
        """See :class:`armsight.calibration.live.drive.Eyes`."""
        photographs = self.mover.look(cameras, rest, frames)
        return [Picture(p.color, p.infrared, p.depth) for p in photographs]

    def close(self) -> None:
        """Let the simulation go."""
        self.world.close()


def sheet(lens: PinholeCamera) -> PinholeCamera:
    """What the maker's sheet says of a lens: its focal length, the middle, no distortion."""
    f = 0.5 * (lens.fx + lens.fy)
    return PinholeCamera(
        lens.width, lens.height, f, f, 0.5 * (lens.width - 1), 0.5 * (lens.height - 1)
    )


def open_calibration_cell(
    workcell: Workcell,
    board: Board | None = None,
    seed: int = 0,
    errors: StudioErrors | None = None,
    redraw: float = float("inf"),
    factory: bool = False,
) -> CalibrationCell:
    """Build a simulated cell with a board on its flange.

    Args:
        workcell: the cell.
        board: T1's when None.
        seed: of the truth.
        errors: how wrong everything is.
        redraw: see :class:`BoardStudio`.
        factory: the cameras report lenses calibrated at the factory, which are kept.
    """
    board = board or Checkerboard()
    spec = world_spec(workcell)
    world = SimulatedWorld(replace(spec, cameras=(), arm=_without_plate(spec.arm)), seed)
    image, x0, y0 = raster(board, PER_METER, 0.02)
    points = board.points
    middle = 0.5 * (points.max(0) + points.min(0))
    half = 0.5 * np.ptp(points, axis=0)
    printed = Print(image, x0, y0, PER_METER, (middle[0], middle[1]), (half[0], half[1]))
    guess = from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 0.06)) @ make_pose(None, -middle)
    studio = BoardStudio(world, spec.cameras, printed, guess, seed, errors, redraw)
    cameras = []
    for truth, declared in zip(studio.cameras, spec.cameras):
        info = declared.info
        if factory:
            color = truth.color if info.color is not None else None
            T = truth.T_infrared_color
            cameras.append(CameraSetup(info.name, truth.infrared, color, T, keep=True))
            continue
        cameras.append(
            CameraSetup(
                info.name,
                sheet(truth_sheet(info.depth, truth.infrared)),
                sheet(info.color) if info.color is not None else None,
                make_pose(None, info.T_depth_color[:3, 3]),
                depth_scale=1.0,
            )
        )
    T_world_base = spec.arm.T_world_base
    static = tuple(
        replace(s, T_frame_solid=inverse(T_world_base) @ s.T_frame_solid) for s in spec.static
    )
    robot = spec.arm.robot
    setup = Setup(
        robot,
        tuple(cameras),
        board,
        guess,
        lambda q: stands_free(robot, q, static),
        lambda a, b: way_free(robot, a, b, static),
        spec.arm.speed,
        spec.arm.acceleration,
        1.0 / min(c.info.rate for c in spec.cameras),
    )
    return CalibrationCell(setup, world, studio, StudioMover(world, studio), T_world_base)


def _without_plate(arm: ArmSpec) -> ArmSpec:
    """The arm without the looks of its tool: the studio draws the board where it really hangs.

    The designed plate, drawn as well, would hide the true one wherever the bracket is off.
    """
    robot = arm.robot
    if robot.tool is None:
        return arm
    return replace(arm, robot=replace(robot, tool=replace(robot.tool, meshes=())))


def truth_sheet(declared: PinholeCamera, infrared: PinholeCamera) -> PinholeCamera:
    """The catalogue's depth lens at the resolution of the infrared picture."""
    return declared.scaled(infrared.width / declared.width)


def stands_free(
    robot: Robot, q: JointVector, static: tuple[Solid, ...], clearance: float = 0.03
) -> bool:
    """Whether no moving part is near a declared solid, the floor below the base or another part."""
    centers = sphere_centers(robot, q)
    link, radius = robot.spheres.link, robot.spheres.radius
    # The shoulder stands on the table; the elbow, where the forearm begins, guards the upper arm.
    moving = link >= 3
    for solid in static:
        if np.any(solid.distance(centers[moving]) < radius[moving] + clearance):
            return False
    for a, b in robot.self_pairs:
        i, j = np.flatnonzero(link == a), np.flatnonzero(link == b)
        if len(i) and len(j):
            gap = np.linalg.norm(centers[i][:, None] - centers[j][None], axis=-1)
            if np.any(gap < radius[i][:, None] + radius[j][None]):
                return False
    return True


def way_free(
    robot: Robot, a: JointVector, b: JointVector, static: tuple[Solid, ...], step: float = 0.08
) -> bool:
    """Whether the arm is free all along a straight joint move, looked at every ``step`` [rad]."""
    count = max(2, int(np.ceil(np.abs(b - a).max() / step)))
    return all(
        stands_free(robot, a + w * (b - a), static) for w in np.linspace(0.0, 1.0, count + 1)[1:]
    )


def true_lens(cell: CalibrationCell, rig: int, name: str) -> tuple[PinholeCamera, Pose]:
    """The true lens of a camera by its name in the answer, and ``T_base_lens``."""
    truth = cell.studio.cameras[rig]
    T = inverse(cell.T_world_base) @ truth.T_world_infrared
    if name.endswith("color"):
        return truth.color, T @ truth.T_infrared_color
    return truth.infrared, T


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
        truth = cell.studio.cameras[index]
        if model is None:
            out[truth.name] = float("nan")
            continue
        lens = truth.infrared
        z = np.linspace(1.0, 2.0, 21)
        u, v = np.meshgrid(np.linspace(0.05, 0.95, 9), np.linspace(0.05, 0.95, 7))
        pixel = np.stack([u.ravel() * (lens.width - 1), v.ravel() * (lens.height - 1)], 1)
        errors = []
        for d in z:
            depth = np.full(len(pixel), d)
            radius = np.hypot((pixel[:, 0] - lens.cx) / lens.cx, (pixel[:, 1] - lens.cy) / lens.cy)
            error = truth.depth.of(depth, radius / np.sqrt(2))
            measured = depth + error
            true = measured.copy()
            for _ in range(3):
                true = measured - model.error(true, pixel, lens)
            errors.append(true - depth)
        out[truth.name] = float(np.median(np.abs(errors)))
    return out
