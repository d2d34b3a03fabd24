"""Recorded sets as strangers make them, in numbers: one camera, one board, an arm that errs.

For experiments and tests. The truth is known and used for drawing and scoring alone. Nothing is
rendered: corners are projected and get noise, so that thousands of sets are made in minutes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointPath, Points, Pose, Poses
from armsight.calibration import arm, se3
from armsight.calibration.calibrate import target_points
from armsight.calibration.problem import Mount
from armsight.calibration.robot_errors import RobotErrors
from armsight.calibration.synthetic import seen_by
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, make_pose
from armsight.robots.robot import Robot

LENS = PinholeCamera(1280, 960, 1100.0, 1102.0, 645.0, 476.0, (-0.05, 0.08, 0.0004, -0.0003, -0.02))
"""A usual machine-vision lens."""


@dataclass(frozen=True)
class ArmErrors:
    """How an arm errs; every figure is an rms displacement of the flange over the views [m].

    Attributes:
        repeatability: independent at every pose (and a tenth of a radian a metre of turn).
        kinematics: zeros, link lengths and sag: the same error at the same pose.
        backlash: depends on the direction from which each joint arrived.
    """

    repeatability: float = 0.0001
    kinematics: float = 0.0003
    backlash: float = 0.0


@dataclass(frozen=True)
class SyntheticSet:
    """A set with its truth.

    Attributes:
        mount: what carries the camera.
        camera: the true lens.
        points: (k, 3) corners of the board as designed [m].
        told: (n, 4, 4) ``T_base_flange`` as the controller says; true: as it was.
        joints: (n, j) as the controller says [rad].
        pixels: (n, k, 2) corners as a detector saw them [px].
        T_mount_camera, T_mount_board: the truth.
        robot: the nominal arm.
    """

    mount: Mount
    camera: PinholeCamera
    points: Points
    told: Poses
    true: Poses
    joints: JointPath
    pixels: Floats
    T_mount_camera: Pose
    T_mount_board: Pose
    robot: Robot

    @property
    def views(self) -> int:
        """How many."""
        return len(self.told)

    def target_error(self, camera: PinholeCamera, T_mount_camera: Pose) -> float:
        """3D rms error of points given by pixel and true depth, over the image and depths [m]."""
        pixels, z = target_points(self.camera, (0.6, 0.8, 1.0))
        places = []
        for lens, T in ((camera, T_mount_camera), (self.camera, self.T_mount_camera)):
            ray = np.column_stack([lens.normalise(pixels), np.ones(len(z))]) * z[:, None]
            places.append(ray @ T[:3, :3].T + T[:3, 3])
        return float(np.sqrt(np.mean(np.sum((places[0] - places[1]) ** 2, axis=1))))


def seen_from(one: SyntheticSet, flanges: Poses, X: Pose, Z: Pose) -> Floats:
    """(n, k, 2) exact pixels of a set's board with camera X and board Z in their mounts [px]."""
    p = _in_camera(flanges, one.points, X, Z, one.mount)
    return one.camera.project(p.reshape(-1, 3)).reshape(*p.shape[:2], 2)


def corner_grid(columns: int, rows: int, spacing: float) -> Points:
    """(columns * rows, 3) corners of a checkerboard, row by row [m]."""
    y, x = np.mgrid[0:rows, 0:columns]
    return np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=1) * spacing


def make_set(
    robot: Robot,
    rng: np.random.Generator,
    views: int = 16,
    mount: Mount = "base",
    errors: ArmErrors | None = None,
    camera: PinholeCamera = LENS,
    points: Points | None = None,
    corner_sigma: float = 0.1,
    tilt: float = float(np.deg2rad(40)),
) -> SyntheticSet:
    """Draw a set as a careful user records it: turned about all axes, over the image.

    Args:
        robot: the arm; drawn about its home.
        rng: draws everything.
        views: how many.
        mount: what carries the camera.
        errors: of the arm.
        camera: the true lens.
        points: corners of the board [m]; 9 x 6 of 25 mm by default.
        corner_sigma: of a corner's coordinate [px].
        tilt: of the board against the image, at most [rad].
    """
    errors = errors or ArmErrors()
    points = corner_grid(9, 6, 0.025) if points is None else points
    middle = 0.5 * (points.max(0) + points.min(0))
    jitter = rng.normal(0, 1, 6) * [0.03, 0.03, 0.03, 0.15, 0.15, 0.15]
    if mount == "base":
        Z = make_pose(None, (0.0, 0.0, 0.05)) @ _turned_x(np.pi) @ se3.exps(jitter[None])[0]
        Z = Z @ make_pose(None, -middle)
        centre = np.array([0.45, 0.0, 0.4]) + rng.normal(0, 0.05, 3)
        around = rng.uniform(-0.6, 0.6)
        away = 1.0 * np.array([np.cos(around), np.sin(around), 0.3])
        X = look_at(centre + away, centre)
    else:
        X = make_pose(None, (0.0, -0.06, 0.04)) @ se3.exps(jitter[None])[0]
        Z = make_pose(None, (0.5, 0.0, 0.0)) @ _turned_x(np.pi) @ make_pose(None, -middle)
        Z = make_pose(None, rng.normal(0, 0.04, 3)) @ Z @ _about_z(rng.uniform(-3, 3))
    told, joints = _reachable(robot, rng, views, mount, camera, points, X, Z, tilt)
    true = told @ se3.exps(_arm_errors(robot, joints, errors, rng))
    seen = _in_camera(true, points, X, Z, mount)
    pixels = camera.project(seen.reshape(-1, 3)).reshape(*seen.shape[:2], 2)
    pixels = pixels + rng.normal(0, corner_sigma, pixels.shape)
    return SyntheticSet(mount, camera, points, told, true, joints, pixels, X, Z, robot)


def _in_camera(T: Poses, points: Points, X: Pose, Z: Pose, mount: Mount) -> Floats:
    """(n, k, 3) corners in the camera's frame [m]."""
    A = T if mount == "base" else se3.inverses(T)
    C = inverse(X) @ A @ Z
    return np.asarray(points @ np.swapaxes(C[:, :3, :3], 1, 2) + C[:, None, :3, 3])


def _reachable(
    robot: Robot,
    rng: np.random.Generator,
    views: int,
    mount: Mount,
    camera: PinholeCamera,
    points: Points,
    X: Pose,
    Z: Pose,
    tilt: float,
) -> tuple[Poses, JointPath]:
    """(n, 4, 4) flange poses that show the board whole, and their joints."""
    middle = 0.5 * (points.max(0) + points.min(0))
    joints: list[Floats] = []
    for _ in range(40):
        count = 2 * views
        u = rng.uniform(0.25, 0.75, (count, 2)) * [camera.width, camera.height]
        z = rng.uniform(0.45, 0.9, count)
        ray = np.column_stack([camera.normalise(u), np.ones(count)]) * z[:, None]
        angle, lean = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.15, 1.0, count) * tilt
        twist = np.zeros((count, 6))
        twist[:, 3], twist[:, 4] = lean * np.cos(angle), lean * np.sin(angle)
        roll = np.zeros((count, 6))
        roll[:, 5] = rng.uniform(-0.9, 0.9, count)
        C = np.tile(np.eye(4), (count, 1, 1))
        C[:, :3, 3] = ray
        C = C @ se3.exps(twist) @ se3.exps(roll) @ make_pose(None, -middle)
        A = X @ C @ inverse(Z)
        flanges = A if mount == "base" else se3.inverses(A)
        q, ok = arm.reach_some(robot, flanges, rng, tries=2)
        T = arm.flange_poses(robot, q)
        p = _in_camera(T, points, X, Z, mount)
        pixels = camera.project(p.reshape(-1, 3)).reshape(*p.shape[:2], 2)
        joints += list(q[ok & (seen_by(p, pixels, camera) > 0)])
        if len(joints) >= views:
            q = np.array(joints[:views])
            return arm.flange_poses(robot, q), q
    raise ValueError(f"only {len(joints)} of {views} views can be reached")


def _arm_errors(
    robot: Robot, joints: JointPath, errors: ArmErrors, rng: np.random.Generator
) -> Floats:
    """(n, 6) body twist of the flange's error at each view."""
    n = len(joints)
    out = rng.normal(0, 1, (n, 6)) * errors.repeatability / np.sqrt(3.0) * [1, 1, 1, 2, 2, 2]
    model = RobotErrors(robot)
    nominal = arm.flange_poses(robot, joints)
    if errors.kinematics > 0:
        theta = rng.normal(0, 1, model.size) * model.sigma
        twist = se3.logs(se3.inverses(nominal) @ model.flange_poses(joints, theta)[0])
        out += twist * errors.kinematics / _rms(twist)
    if errors.backlash > 0:
        before = np.vstack([joints[:1] + 0.1, joints[:-1]])
        side = np.sign(joints - before) * rng.uniform(0.3, 1.0, joints.shape[1])
        _, frames, flange = arm.joint_frames(robot, joints)
        twist = np.einsum("vij,vj->vi", arm.body_screws(robot, frames, flange), side)
        out += twist * errors.backlash / _rms(twist)
    return np.asarray(out, np.float64)


def _rms(twist: Floats) -> float:
    return max(float(np.sqrt(np.mean(np.sum(twist[:, :3] ** 2, axis=1)))), 1e-12)


def _turned_x(angle: float) -> Pose:
    return np.asarray(se3.exps(np.array([[0, 0, 0, angle, 0, 0]]))[0])


def _about_z(angle: float) -> Pose:
    return np.asarray(se3.exps(np.array([[0, 0, 0, 0, 0, angle]]))[0])
