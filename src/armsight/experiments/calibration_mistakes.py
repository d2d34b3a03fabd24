"""Mistakes that people make with recorded sets, put into clean ones, and the names they must get.

Each mistake spoils a set as it would be spoiled in life: in the file of poses, in the corners, in
the lens file, or in what the user says on the command line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses
from armsight.calibration import se3
from armsight.calibration.boards import Checkerboard
from armsight.calibration.export import opencv_yaml
from armsight.calibration.problem import Mount
from armsight.calibration.recorded_set import load
from armsight.calibration.recorded_solve import solve_set
from armsight.calibration.synthetic_set import LENS, ArmErrors, SyntheticSet, make_set, seen_from
from armsight.errors import CalibrationError
from armsight.experiments.calibration_layouts import PlainSet, picture_names, write_corners
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, make_pose
from armsight.robots.robot import Robot

BOARD = Checkerboard(10, 7, 0.025, hollow=False)


@dataclass
class Folder:
    """A recorded set about to be written.

    Attributes:
        poses: (n, 4, 4) as the file will hold them [m]; corners: of each picture (n, k, 2) [px].
        names: of the pictures.
        text: the file of poses, made from ``poses`` when it is written.
        lens: given with the set; stated: where the user says the camera is; board: what they say.
    """

    poses: Poses
    corners: Floats
    names: list[str]
    text: Callable[[Poses], str] = field(
        default=lambda T: _table("x,y,z,qx,qy,qz,qw", _quaternions(T))
    )
    file: str = "poses.csv"
    lens: PinholeCamera | None = None
    stated: Mount | None = None
    board: Checkerboard = BOARD


Spoil = Callable[[Folder, SyntheticSet, np.random.Generator], Folder | None]


def _table(header: str, value: Floats, form: str = "%.8f") -> str:
    lines = [",".join(form % v for v in row) for row in value]
    return "\n".join(([header] if header else []) + lines) + "\n"


def _quaternions(T: Poses, order: tuple[int, ...] = (0, 1, 2, 3)) -> Floats:
    q = Rotation.from_matrix(T[:, :3, :3]).as_quat()[:, list(order)]
    return np.hstack([T[:, :3, 3], q])


def _angles(T: Poses, kind: str, degrees: bool, unit: float = 1.0) -> Floats:
    R = Rotation.from_matrix(T[:, :3, :3])
    r = R.as_rotvec(degrees) if kind == "vector" else R.as_euler(kind, degrees)  # type: ignore[call-overload]
    return np.hstack([T[:, :3, 3] / unit, np.asarray(r)])


def _written(header: str, make: Callable[[Poses], Floats], form: str = "%.8f") -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        return replace(f, text=lambda T: _table(header, make(T), form))

    return spoil


def _other(mount: Mount) -> Mount:
    return "flange" if mount == "base" else "base"


def _wrong_mount(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return replace(f, stated=_other(s.mount))


def _inverted(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return replace(f, poses=se3.inverses(f.poses), stated=s.mount)


def _transposed(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    T = f.poses.copy()
    T[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    return replace(f, poses=T, text=lambda T: _table("", T.reshape(-1, 16)).replace(",", " "))


def _rolled(step: int) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        return replace(f, poses=np.roll(f.poses, step, axis=0))

    return spoil


def _reversed(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return replace(f, poses=f.poses[::-1].copy())


def _text_order(of_poses: bool) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        order = np.array(sorted(range(1, len(f.poses) + 1), key=str)) - 1
        if not of_poses:
            order = np.argsort(order)
        return replace(f, poses=f.poses[order])

    return spoil


def _another_day(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return replace(f, poses=f.poses[rng.permutation(len(f.poses))])


def _size(factor: float) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        return replace(f, board=replace(BOARD, square=BOARD.square * factor))

    return spoil


def _lens_of(factor: float) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        scaled = s.camera.scaled(factor)
        return replace(f, lens=replace(scaled, width=s.camera.width, height=s.camera.height))

    return spoil


def _distortion(times: float) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        d = tuple(times * v for v in s.camera.distortion)
        return replace(f, lens=replace(s.camera, distortion=d))  # type: ignore[arg-type]

    return spoil


def _slip(of_camera: bool) -> Spoil:
    def spoil(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
        k = int(rng.integers(5, s.views - 4))
        direction = rng.normal(size=3)
        jump = np.append(0.004 * direction / np.linalg.norm(direction), rng.normal(0, 0.005, 3))
        X, Z = s.T_mount_camera, s.T_mount_board
        late = seen_from(
            s, s.true[k:], X @ exp(jump) if of_camera else X, Z if of_camera else Z @ exp(jump)
        )
        corners = f.corners.copy()
        corners[k:] = late + rng.normal(0, 0.1, late.shape)
        return replace(f, corners=corners)

    return spoil


def _some(f: Folder, index: list[int]) -> Folder:
    return replace(
        f, poses=f.poses[index], corners=f.corners[index], names=[f.names[k] for k in index]
    )


def _few(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return _some(f, [0, 1])


def _drawn(
    f: Folder, s: SyntheticSet, rng: np.random.Generator, twist: Callable[[int], Floats]
) -> Folder:
    """Views by small motions from the first one."""
    true = np.array([s.true[0] @ exp(twist(k)) for k in range(s.views)])
    told = np.array([s.told[0] @ exp(twist(k)) for k in range(s.views)])
    corners = seen_from(s, true, s.T_mount_camera, s.T_mount_board)
    return replace(f, poses=told, corners=corners + rng.normal(0, 0.1, corners.shape))


def _one_axis(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return _drawn(f, s, rng, lambda k: np.array([0, 0, 0.004 * k, 0, 0, 0.06 * (k - s.views / 2)]))


def _alike(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    return _drawn(f, s, rng, lambda k: np.array([0.004 * k, 0.003 * (k % 4), 0, 0, 0, 0]))


def _repeated(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    corners = f.corners.copy()
    at = rng.choice(np.arange(1, s.views), 3, replace=False)
    corners[at] = corners[at - 1]
    return replace(f, corners=corners)


def _blurred(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    corners = f.corners.copy()
    corners[int(rng.integers(s.views))] += rng.normal(0, 1.0, corners.shape[1:])
    return replace(f, corners=corners)


def _two_cameras(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    side = make_pose(None, (0.06, 0.01, 0.0)) @ exp([0, 0, 0, 0.03, -0.06, 0.1])
    other = seen_from(s, s.true, s.T_mount_camera @ side, s.T_mount_board)
    corners = f.corners.copy()
    mine = rng.random(s.views) < 0.5
    mine[:2] = (True, False)
    corners[mine] = other[mine] + rng.normal(0, 0.1, other[mine].shape)
    return replace(f, corners=corners)


def _mirrored(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    columns, rows = BOARD.inner
    order = np.arange(columns * rows).reshape(rows, columns)[:, ::-1].ravel()
    corners = f.corners[:, order].copy()
    corners[..., 0] = s.camera.width - 1 - corners[..., 0]
    return replace(f, corners=corners)


def _typo(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    T = f.poses.copy()
    T[int(rng.integers(s.views)), int(rng.integers(3)), 3] += 0.1
    return replace(f, poses=T)


def _stale(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    T = f.poses.copy()
    for k in rng.choice(np.arange(1, s.views), 2, replace=False):
        T[k] = T[k - 1]
    return replace(f, poses=T)


def _flipped(f: Folder, s: SyntheticSet, rng: np.random.Generator) -> Folder:
    corners = f.corners.copy()
    for k in rng.choice(s.views, 3, replace=False):
        corners[k] = corners[k][::-1]
    return replace(f, corners=corners)


_QUATERNION = "x,y,z,qx,qy,qz,qw"

_MM = np.array([1e3, 1e3, 1e3, 1, 1, 1, 1])

MISTAKES: dict[str, tuple[str, Spoil]] = {
    "wrong mount said": ("pose_inverted", _wrong_mount),
    "poses inverted": ("pose_inverted", _inverted),
    "millimetres under metres": (
        "millimetres", _written("x_m,y_m,z_m,qx,qy,qz,qw", lambda T: _quaternions(T) * _MM)),
    "metres under millimetres": (
        "millimetres", _written("x_mm,y_mm,z_mm,qx,qy,qz,qw", _quaternions)),
    "degrees under radians": (
        "degrees", _written("x,y,z,rx_rad,ry_rad,rz_rad", lambda T: _angles(T, "xyz", True))),
    "radians under degrees": (
        "degrees", _written("x,y,z,rx_deg,ry_deg,rz_deg", lambda T: _angles(T, "xyz", False))),
    "quaternion w first": (
        "quaternion_order", _written(_QUATERNION, lambda T: _quaternions(T, (3, 0, 1, 2)))),
    "A B C that are roll, pitch, yaw": (
        "rotation_format",
        _written("X_mm,Y_mm,Z_mm,A,B,C", lambda T: _angles(T, "xyz", True, 1e-3))),
    "rotation vectors under roll, pitch, yaw": (
        "rotation_format",
        _written("x,y,z,roll,pitch,yaw", lambda T: _angles(T, "vector", False))),
    "rotations transposed": ("matrix_order", _transposed),
    "shifted by one": ("shifted", _rolled(1)),
    "shifted back by one": ("shifted", _rolled(-1)),
    "opposite order": ("order", _reversed),
    "poses sorted as text": ("order", _text_order(True)),
    "pictures sorted as text": ("order", _text_order(False)),
    "poses of another day": ("poses_do_not_match", _another_day),
    "board 20 % too small": ("board_size", _size(0.8)),
    "board 2 % too large": ("board_size", _size(1.02)),
    "board in inches": ("board_size", _size(1 / 2.54)),
    "lens of half the size": ("lens_resolution", _lens_of(0.5)),
    "lens of twice the size": ("lens_resolution", _lens_of(2.0)),
    "distortion missing": ("distortion", _distortion(0.0)),
    "distortion twice": ("distortion", _distortion(2.0)),
    "board slipped": ("slip", _slip(False)),
    "camera bumped": ("slip", _slip(True)),
    "one axis": ("one_axis", _one_axis),
    "two views": ("few_views", _few),
    "views alike": ("alike", _alike),
    "pictures repeated": ("repeated", _repeated),
    "one blurred in twenty": ("blurred", _blurred),
    "two cameras in one folder": ("two_cameras", _two_cameras),
    "pictures mirrored": ("mirrored", _mirrored),
    "a typing error in a pose": ("outlier", _typo),
    "rotations rounded": ("rounded", _written(_QUATERNION, _quaternions, "%.2f")),
    "poses that stand still": ("stale_pose", _stale),
    "boards read turned": ("flipped", _flipped),
}  # fmt: skip
"""Every mistake: the code of the finding that names it, and how it is made."""

BESIDE: dict[str, set[str]] = {
    # What is also true of a set with that mistake, and so no wrong name.
    "pictures repeated": {"outlier", "stale_pose"},
    "one blurred in twenty": {"outlier"},
    "poses that stand still": {"outlier", "repeated"},
    "rotations rounded": {"outlier"},
    "board 2 % too large": set(),
    "two views": {"alike"},
    "views alike": {"one_axis"},
    "two cameras in one folder": {"mostly_left_out"},
    "board slipped": {"outlier", "mostly_left_out"},
    "camera bumped": {"outlier", "mostly_left_out"},
}
QUALITY = {"inconsistent", "arm_noise", "uncertain", "unseen", "unpaired", "board_count", "scatter",
           "few_views", "outlier"}  # fmt: skip
"""Findings about how good a set is; they name no mistake."""


def clean_set(robot: Robot, rng: np.random.Generator, large: float = 5e-4) -> SyntheticSet:
    """A set of a usual arm before a lens that bends as cheap ones do."""
    bent = replace(LENS, distortion=(-0.22, 0.12, 0.0003, -0.0002, -0.03))
    size = float(np.exp(rng.uniform(np.log(1e-4), np.log(large))))
    mount: Mount = "base" if rng.random() < 0.5 else "flange"
    errors = ArmErrors(5e-5, size, 0.3 * size)
    return make_set(robot, rng, int(rng.integers(14, 26)), mount, errors, bent)


def write_mistake(place: Path, name: str, one: SyntheticSet, rng: np.random.Generator) -> Folder:
    """A set with a mistake, or with none for an empty name, on disk."""
    folder = Folder(one.told, one.pixels, picture_names(one.views))
    if name:
        made = MISTAKES[name][1](folder, one, rng)
        assert made is not None
        folder = made
    every = np.arange(len(one.points))
    size = (one.camera.width, one.camera.height)
    plain = PlainSet(folder.poses, tuple((every, p) for p in folder.corners), size)
    write_corners(place, plain, folder.names)
    (place / folder.file).write_text(folder.text(folder.poses))
    if folder.lens is not None:
        text = opencv_yaml(folder.lens)
        if MISTAKES[name][0] == "lens_resolution":  # a file that does not say its size
            text = "\n".join(x for x in text.splitlines() if not x.startswith("image_")) + "\n"
        (place / "lens.yaml").write_text(text)
    return folder


def findings_of(place: Path, folder: Folder) -> list[tuple[str, str]]:
    """(code, severity) of everything that a user is told about a folder."""
    try:
        recorded = load(place, folder.board, mount=folder.stated)
        answer = solve_set(recorded)
    except CalibrationError as error:
        return [("refused", str(error))]
    return [(f.code, f.severity) for f in answer.findings]


def judge(name: str, told: list[tuple[str, str]]) -> tuple[bool, set[str]]:
    """Whether the right name was among what was told, and the wrong names."""
    wanted = MISTAKES[name][0]
    codes = {code for code, severity in told if severity != "refused"}
    named = wanted in codes
    return named, codes - {wanted} - QUALITY - BESIDE.get(name, set())
