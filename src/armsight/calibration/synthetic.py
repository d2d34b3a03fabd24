"""A calibration cell in numbers alone: known truth, seen corners with honest errors, no images.

For experiments, bounds and tests: thousands of calibrations a minute. The error models are those of
:class:`ErrorLevels`. Truth is only ever used to draw data and to score answers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from armsight.arrays import Floats, JointPath, Points, Pose, Poses
from armsight.calibration import arm, se3
from armsight.calibration.calibrate import target_points
from armsight.calibration.lens_prior import sheet_prior
from armsight.calibration.model import SHAPE, State
from armsight.calibration.problem import (
    ArmView,
    BoardPlacement,
    Lens,
    Problem,
    Rig,
    Sighting,
    lens_from_vector,
    lens_vector,
)
from armsight.calibration.projection import project
from armsight.calibration.robot_errors import RobotErrors
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, inverse, look_at, make_pose
from armsight.robots.robot import Robot


@dataclass(frozen=True)
class ErrorLevels:
    """How wrong the synthetic cell is; every figure is a standard deviation.

    Attributes:
        corner_color, corner_infrared: of a corner's coordinate [px].
        outliers: share of corners with 5 times that; wrong_boards: share of mis-seen boards.
        pose: repeatability of the arm (translation [m], rotation [rad]).
        kinematics: scale of the absolute error of the arm (1: as simulated); 0 is exact.
        board_scale: print scale [1]; board_warp: bending at the edge [m].
        lens: scale of how far the true lens is from its sheet; 0 is the sheet.
    """

    corner_color: float = 0.1
    corner_infrared: float = 0.2
    outliers: float = 0.02
    wrong_boards: float = 0.005
    pose: tuple[float, float] = (0.0001, float(np.deg2rad(0.01)))
    kinematics: float = 1.0
    board_scale: float = 0.002
    board_warp: float = 0.0003
    lens: float = 1.0

    @classmethod
    def ideal(cls, corner: float = 0.2) -> ErrorLevels:
        """Corner noise alone."""
        return cls(corner, corner, 0.0, 0.0, (0.0, 0.0), 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SheetCamera:
    """A camera as its sheet says: name, lenses (main first), where it roughly stands."""

    name: str
    lenses: tuple[tuple[str, PinholeCamera], ...]
    T_main_others: tuple[Pose, ...]
    T_base_camera: Pose


def t1_cameras(center: tuple[float, float, float] = (0.45, 0.0, 0.45)) -> tuple[SheetCamera, ...]:
    """T1's three cameras about a UR5: two Kinect v2 at about 45 deg, one Kinect v1 in front."""
    v2_ir = PinholeCamera(512, 424, 366.0, 366.0, 255.5, 211.5, (0.1, -0.28, 0.0, 0.0, 0.1))
    v2_color = PinholeCamera(1920, 1080, 1064.0, 1064.0, 959.5, 539.5, (0.05, -0.05, 0.0, 0.0, 0.0))
    v1_ir = PinholeCamera(640, 480, 585.0, 585.0, 319.5, 239.5, (-0.1, 0.3, 0.0, 0.0, -0.2))
    v1_color = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5, (0.2, -0.4, 0.0, 0.0, 0.3))
    v2_offset = make_pose(None, (-0.052, 0.0, 0.0))
    v1_offset = make_pose(None, (-0.025, 0.0, 0.0))

    def camera(
        name: str,
        ir: PinholeCamera,
        color: PinholeCamera,
        offset: Pose,
        angle: float,
        distance: float,
        height: float,
    ) -> SheetCamera:
        away = np.array([distance * np.cos(angle), distance * np.sin(angle), height])
        eye = np.array(center) + away
        return SheetCamera(
            name, (("infrared", ir), ("color", color)), (np.eye(4), offset), look_at(eye, center)
        )

    return (
        camera("left", v2_ir, v2_color, v2_offset, np.deg2rad(45), 1.15, 0.35),
        camera("right", v2_ir, v2_color, v2_offset, np.deg2rad(-45), 1.15, 0.35),
        camera("front", v1_ir, v1_color, v1_offset, 0.0, 1.1, 0.25),
    )


@dataclass(frozen=True)
class SyntheticCell:
    """A cell with its truth.

    Attributes:
        robot: the nominal arm.
        sheet: the cell as believed before calibration, without views.
        errors: the arm's true error model; state: the truth (E of no view).
        levels: how wrong everything is.
        T_flange_board_guess: what the user believes of the bracket.
    """

    robot: Robot
    sheet: Problem
    errors: RobotErrors
    state: State
    levels: ErrorLevels
    T_flange_board_guess: Pose
    board_half: Floats = field(default_factory=lambda: np.zeros(2))

    @property
    def points(self) -> Points:
        """Corners of the board as designed [m]."""
        return self.sheet.boards[0].points


def make_cell(
    robot: Robot,
    rng: np.random.Generator,
    levels: ErrorLevels | None = None,
    cameras: tuple[SheetCamera, ...] | None = None,
    board: Points | None = None,
    only: tuple[str, ...] = ("infrared", "color"),
) -> SyntheticCell:
    """Draw a cell.

    Args:
        robot: the arm.
        rng: draws the truth.
        levels: how wrong everything is.
        cameras: the sheet; T1's three when None.
        board: (k, 3) corners [m]; T1's 6 x 4 of 30 mm when None.
        only: which lenses take part.
    """
    levels = levels or ErrorLevels()
    cameras = cameras or t1_cameras()
    if board is None:
        y, x = np.mgrid[0:4, 0:6]
        board = np.stack([x.ravel(), y.ravel(), np.zeros(24)], 1) * 0.03
    middle = 0.5 * (board.max(0) + board.min(0))
    guess = from_rpy((np.pi, 0.0, 0.0), (0.0, 0.0, 0.06)) @ make_pose(None, -middle)
    bracket = se3.exps(rng.normal(0, 1, (1, 6)) * [0.015, 0.015, 0.015, 0.05, 0.05, 0.05])[0]
    rigs, lenses, true_lens, true_offset, true_rig = [], [], [], [], []
    for index, sheet in enumerate(cameras):
        rigs.append(Rig(sheet.name))
        shift = rng.normal(0, 1, (1, 6)) * [0.03, 0.03, 0.03, 0.03, 0.03, 0.03]
        true_rig.append(sheet.T_base_camera @ se3.exps(shift)[0])
        first = True
        for (name, lens), offset in zip(sheet.lenses, sheet.T_main_others):
            if name not in only:
                continue
            lenses.append(
                Lens(
                    f"{sheet.name} {name}",
                    index,
                    lens,
                    np.eye(4) if first else offset,
                    not first,
                    sheet_prior(lens),
                )
            )
            true_lens.append(_true_lens(lens, levels.lens, rng))
            d = rng.normal(0, 1, (1, 6)) * [0.001, 0.001, 0.001, 0.003, 0.003, 0.003]
            true_offset.append(np.eye(4) if first else offset @ se3.exps(levels.lens * d)[0])
            first = False
    errors = RobotErrors(robot)
    theta = levels.kinematics * rng.normal(0, 1, errors.size) * errors.sigma
    shape = np.zeros((1, SHAPE))
    shape[0] = rng.normal(0, 1, 3) * [levels.board_scale, levels.board_warp, levels.board_warp]
    state = State(
        np.array(true_lens),
        np.array(true_offset),
        np.array(true_rig),
        np.zeros(len(rigs)),
        np.array([bracket @ guess]),
        shape,
        theta,
        np.zeros((0, 4, 4)),
    )
    sheet_problem = Problem(
        tuple(rigs), tuple(lenses), (BoardPlacement("board", board),), (), (), errors
    )
    return SyntheticCell(robot, sheet_problem, errors, state, levels, guess)


def _true_lens(lens: PinholeCamera, scale: float, rng: np.random.Generator) -> Floats:
    v = lens_vector(lens)
    common = rng.normal(0, 0.01)
    v[0] *= 1 + scale * (common + rng.normal(0, 0.001))
    v[1] *= 1 + scale * (common + rng.normal(0, 0.001))
    v[2:4] += scale * rng.normal(0, 0.006 * lens.width, 2)
    v[4:9] += scale * rng.normal(0, 1, 5) * [0.02, 0.04, 0.001, 0.001, 0.03]
    return v


def true_flanges(cell: SyntheticCell, joints: JointPath, rng: np.random.Generator | None) -> Poses:
    """(v, 4, 4) where the flange really is; with the repeatability's error if a generator."""
    T, _ = cell.errors.flange_poses(joints, cell.state.theta)
    if rng is None:
        return T
    t, r = cell.levels.pose
    return T @ se3.exps(rng.normal(0, 1, (len(joints), 6)) * [t, t, t, r, r, r])


def corners_in_lens(cell: SyntheticCell, flanges: Poses, lens: int) -> Floats:
    """(v, k, 3) corners of the true board in a lens's frame [m]."""
    state = cell.state
    X = true_corners(cell)
    T_base_lens = state.T_mount_rig[cell.sheet.lenses[lens].rig] @ state.T_rig_lens[lens]
    T = inverse(T_base_lens) @ flanges @ state.T_mount_board[0]
    return np.asarray(X @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3])


def true_corners(cell: SyntheticCell) -> Points:
    """(k, 3) corners of the board as printed and bent [m]."""
    X = np.array(cell.points, float)
    scale, bend_x, bend_y = cell.state.shape[0]
    half = np.ptp(X, axis=0)[:2] / 2
    unit = (X[:, :2] - X[:, :2].min(0) - half) / half
    X[:, 2] += bend_x * (unit[:, 0] ** 2 - 1 / 3) + bend_y * (unit[:, 1] ** 2 - 1 / 3)
    X[:, :2] *= 1 + scale
    return X


def seen_by(
    points: Floats, pixels: Floats, lens: PinholeCamera, least_square: float = 6.0
) -> Floats:
    """(v,) whether a detector would find the board: whole, in front, not too slanted or small.

    Args:
        points: (v, k, 3) corners in the lens's frame [m].
        pixels: (v, k, 2) [px].
        lens: image size.
        least_square: a square's short side must span this many pixels.
    """
    margin = 4.0
    inside = (
        (points[..., 2].min(1) > 0.3)
        & (pixels.min((1, 2)) > margin)
        & (pixels[..., 0].max(1) < lens.width - 1 - margin)
        & (pixels[..., 1].max(1) < lens.height - 1 - margin)
    )
    a, b = points[:, 1] - points[:, 0], points[:, -1] - points[:, 0]
    normal = np.cross(a, b)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    toward = points.mean(1)
    toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("vi,vi->v", normal, toward)  # board z points away from the viewer
    short = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1)
    # Reading order must be that of a board seen from its front.
    return np.asarray(inside & (facing > np.cos(np.deg2rad(62))) & (short > least_square))


def observe(
    cell: SyntheticCell,
    joints: JointPath,
    rng: np.random.Generator,
    flanges: Poses | None = None,
) -> Problem:
    """What all lenses see of the board with the arm at (v, n) configurations [rad].

    The returned problem has the sheet's start values, the controller's poses and the noisy corners;
    the views that no lens saw are kept without sightings.
    """
    flanges = true_flanges(cell, joints, rng) if flanges is None else flanges
    nominal = arm.flange_poses(cell.robot, joints)
    levels = cell.levels
    sightings: list[Sighting] = []
    for index, lens in enumerate(cell.sheet.lenses):
        p = corners_in_lens(cell, flanges, index)
        vector = np.broadcast_to(cell.state.lens[index], (len(p), 9))
        pixel, _, _ = project(p, vector, False)
        sigma = levels.corner_infrared if "infrared" in lens.name else levels.corner_color
        visible = seen_by(p, pixel, lens.camera)
        noise = rng.normal(0, sigma, pixel.shape)
        noise *= np.where(rng.random(pixel.shape[:2]) < levels.outliers, 5.0, 1.0)[..., None]
        wrong = rng.random(len(p)) < levels.wrong_boards
        for v in np.flatnonzero(visible):
            seen = pixel[v] + noise[v]
            if wrong[v]:  # a detector that slipped by one column
                seen = seen + (pixel[v, 1] - pixel[v, 0])
            sightings.append(Sighting(int(v), index, 0, np.arange(len(cell.points)), seen, sigma))
    sightings.sort(key=lambda s: (s.view, s.lens))
    views = tuple(ArmView(T, q) for T, q in zip(nominal, joints))
    return replace(cell.sheet, views=views, sightings=tuple(sightings))


def random_views(
    cell: SyntheticCell,
    count: int,
    rng: np.random.Generator,
    cameras: tuple[int, ...] | None = None,
    distance: tuple[float, float] = (0.6, 1.45),
    tilt: float = np.deg2rad(40),
) -> JointPath:
    """Configurations that show the board somewhere in a camera's image, as a careful user would.

    Cameras take turns; each view is seen by the main and the colour lens of its camera as far as
    their fields of view agree, and by other cameras by luck.

    Returns:
        (count, n) reachable configurations [rad], none of which hides the board behind the arm.
    """
    cameras = cameras or tuple(range(len(cell.sheet.rigs)))
    found: list[Floats] = []
    turn = 0
    for _ in range(60):
        want = 24
        rigs = np.array([cameras[(turn + k) % len(cameras)] for k in range(want)])
        turn += want
        targets, keep_rig = [], []
        for rig in rigs:
            T = _aim(cell, int(rig), rng, distance, tilt)
            targets.append(T)
            keep_rig.append(int(rig))
        q, ok = arm.reach_some(cell.robot, np.array(targets), rng)
        flanges = true_flanges(cell, q, None)
        for k in np.flatnonzero(ok):
            rig = keep_rig[k]
            if (len(found) % len(cameras)) != cameras.index(rig):
                continue
            lens = next(i for i, lens in enumerate(cell.sheet.lenses) if lens.rig == rig)
            p = corners_in_lens(cell, flanges[k : k + 1], lens)
            pixel, _, _ = project(p, cell.state.lens[lens][None], False)
            if not seen_by(p, pixel, cell.sheet.lenses[lens].camera)[0]:
                continue
            found.append(q[k])
            if len(found) == count:
                return np.array(found)
    raise ValueError(f"only {len(found)} of {count} views of this cell can be reached")


def _aim(
    cell: SyntheticCell,
    rig: int,
    rng: np.random.Generator,
    distance: tuple[float, float],
    tilt: float,
) -> Pose:
    """A flange pose that shows the board at a random place of a camera's image."""
    index = next(i for i, lens in enumerate(cell.sheet.lenses) if lens.rig == rig)
    lens = cell.sheet.lenses[index].camera
    u = rng.uniform(0.12, 0.88, 2) * [lens.width, lens.height]
    z = rng.uniform(*distance)
    ray = np.append(lens.normalise(u[None])[0], 1.0)
    axis = rng.normal(size=3)
    axis[2] = 0.0
    axis /= np.linalg.norm(axis)
    turn = se3.exps(np.array([[0, 0, 0, *(axis * rng.uniform(0, tilt))]]))[0]
    roll = se3.exps(np.array([[0, 0, 0, 0, 0, rng.uniform(-0.7, 0.7)]]))[0]
    middle = 0.5 * (cell.points.max(0) + cell.points.min(0))
    T_lens_board = make_pose(None, ray * z) @ turn @ roll @ make_pose(None, -middle)
    T_base_lens = cell.state.T_mount_rig[rig] @ cell.state.T_rig_lens[index]
    return T_base_lens @ T_lens_board @ inverse(cell.T_flange_board_guess)


def target_error(cell: SyntheticCell, state: State, lens: int) -> float:
    """True target error of an answer [m]: 3D rms in ``base`` over the lens's volume.

    A point is given by its pixel and its true depth (z); the answer's lens and pose map it into
    the base, and so does the truth.
    """
    width, height = cell.sheet.lenses[lens].camera.width, cell.sheet.lenses[lens].camera.height
    sheet = cell.sheet.lenses[lens].camera
    pixels, z = target_points(sheet)
    rig = cell.sheet.lenses[lens].rig
    answers = []
    for s in (state, cell.state):
        camera = lens_from_vector(s.lens[lens], width, height)
        ray = np.column_stack([camera.normalise(pixels), np.ones(len(z))]) * z[:, None]
        T = s.T_mount_rig[rig] @ s.T_rig_lens[lens]
        answers.append(ray @ T[:3, :3].T + T[:3, 3])
    return float(np.sqrt(np.mean(np.sum((answers[0] - answers[1]) ** 2, axis=1))))
