"""Recorded sets written down in every layout that people keep them in, for tests and experiments.

A set is written as corners by picture (a detector's, so that nothing is rendered twice) and poses.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Ints, Poses
from armsight.experiments.calibration_layouts_more import MORE_LAYOUTS
from armsight.experiments.calibration_layouts_odd import ODD_LAYOUTS
from armsight.geometry.camera import PinholeCamera


@dataclass(frozen=True)
class PlainSet:
    """What is written: poses and corners by view.

    Attributes:
        poses: (n, 4, 4) ``T_base_flange`` [m].
        corners: of each view, (m,) indices and (m, 2) pixels.
        size: (width, height) of the pictures [px].
        lens: given with the set, or None.
    """

    poses: Poses
    corners: tuple[tuple[Ints, Floats], ...]
    size: tuple[int, int]
    lens: PinholeCamera | None = None


def write_corners(folder: Path, one: PlainSet, names: Sequence[str] | None = None) -> None:
    """``corners.csv``: image, corner, u, v."""
    names = names or picture_names(len(one.corners))
    lines = [f"# {one.size[0]}x{one.size[1]}", "image,corner,u,v"]
    for name, (ids, pixel) in zip(names, one.corners):
        lines += [f"{name},{k},{p[0]:.5f},{p[1]:.5f}" for k, p in zip(ids, pixel)]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "corners.csv").write_text("\n".join(lines) + "\n")


def picture_names(count: int, first: int = 1) -> list[str]:
    """``im_1.png`` and so on."""
    return [f"im_{k}.png" for k in range(first, first + count)]


def _rows(value: Floats, delimiter: str = " ", form: str = "%.9f") -> str:
    return "\n".join(delimiter.join(form % v for v in row) for row in np.atleast_2d(value)) + "\n"


def _quaternions(T: Poses) -> Floats:
    return np.asarray(Rotation.from_matrix(T[:, :3, :3]).as_quat(), float)


def _angles(T: Poses, kind: str, degrees: bool) -> Floats:
    R = Rotation.from_matrix(T[:, :3, :3])
    if kind == "vector":
        return np.asarray(R.as_rotvec() * (180 / np.pi if degrees else 1.0), np.float64)
    return np.asarray(R.as_euler(kind, degrees=degrees), np.float64)  # type: ignore[call-overload]


Writer = Callable[[Path, Poses], None]


def _text(name: str, make: Callable[[Poses], str]) -> Writer:
    def write(folder: Path, T: Poses) -> None:
        (folder / name).write_text(make(T))

    return write


def _six(kind: str, degrees: bool, unit: float, delimiter: str = " ") -> Callable[[Poses], str]:
    def make(T: Poses) -> str:
        return _rows(np.hstack([T[:, :3, 3] / unit, _angles(T, kind, degrees)]), delimiter)

    return make


def _headed(
    header: str, values: Callable[[Poses], Floats], key: bool = False
) -> Callable[[Poses], str]:
    def make(T: Poses) -> str:
        lines = _rows(values(T), ",").splitlines()
        if key:
            lines = [f"{n},{line}" for n, line in zip(picture_names(len(T)), lines)]
        return "\n".join([header, *lines]) + "\n"

    return make


def _each(pattern: str, make: Callable[[Poses], str], first: int = 1) -> Writer:
    def write(folder: Path, T: Poses) -> None:
        for k in range(len(T)):
            file = folder / pattern.format(k + first)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(make(T[k : k + 1]))

    return write


def _yaml_pose(T: Poses) -> str:
    q, t = _quaternions(T)[0], T[0, :3, 3]
    words = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), (*t, *q))
    return "".join(f"{k}: {v:.9f}\n" for k, v in words)


def _ros_pose(T: Poses) -> str:
    q, t = _quaternions(T)[0], T[0, :3, 3]
    place = "\n".join(f"    {k}: {v:.9f}" for k, v in zip("xyz", t))
    turn = "\n".join(f"    {k}: {v:.9f}" for k, v in zip("xyzw", q))
    return f"header:\n  frame_id: base\npose:\n  position:\n{place}\n  orientation:\n{turn}\n"


def _halcon(T: Poses) -> str:
    a, t = _angles(T, "XYZ", True)[0] % 360.0, T[0, :3, 3]
    return (
        "# 3D POSE PARAMETERS: rotation and translation\n\n# Used representation type:\nf 0\n\n"
        "# Rotation angles [deg] or Rodriguez vector:\n"
        f"r {a[0]:.9f} {a[1]:.9f} {a[2]:.9f}\n\n# Translational vector (x,y,z [m]):\n"
        f"t {t[0]:.9f} {t[1]:.9f} {t[2]:.9f}\n"
    )


def _kuka(T: Poses) -> str:
    a, t = _angles(T, "ZYX", True), 1e3 * T[:, :3, 3]
    lines = [
        f"DECL E6POS XP{k + 1}={{X {p[0]:.5f},Y {p[1]:.5f},Z {p[2]:.5f},A {r[0]:.6f},B {r[1]:.6f},"
        f"C {r[2]:.6f},S 2,T 35,E1 0.0,E2 0.0}}"
        for k, (p, r) in enumerate(zip(t, a))
    ]
    return "DEFDAT calib\n" + "\n".join(lines) + "\nENDDAT\n"


def _rapid(T: Poses) -> str:
    q, t = _quaternions(T)[:, [3, 0, 1, 2]], 1e3 * T[:, :3, 3]
    lines = [
        f"  CONST robtarget p{k}:=[[{p[0]:.4f},{p[1]:.4f},{p[2]:.4f}],[{a[0]:.8f},{a[1]:.8f},"
        f"{a[2]:.8f},{a[3]:.8f}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];"
        for k, (p, a) in enumerate(zip(t, q))
    ]
    return "MODULE calib\n" + "\n".join(lines) + "\nENDMODULE\n"


def _urscript(T: Poses) -> str:
    r, t = _angles(T, "vector", False), T[:, :3, 3]
    return "".join(
        f"movel(p[{', '.join(f'{v:.8f}' for v in (*p, *a))}], a=0.5)\n" for p, a in zip(t, r)
    )


def _opencv(T: Poses) -> str:
    parts = []
    for k, M in enumerate(T):
        data = ", ".join(f"{v:.9f}" for v in M.ravel())
        parts.append(
            f"pose_{k}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ {data} ]\n"
        )
    return "%YAML:1.0\n---\n" + "".join(parts)


def _xml(T: Poses) -> str:
    data = " ".join(f"{v:.9f}" for v in T[0].ravel())
    return (
        '<?xml version="1.0"?>\n<opencv_storage>\n<T type_id="opencv-matrix"><rows>4</rows>'
        f"<cols>4</cols><dt>d</dt><data>{data}</data></T>\n</opencv_storage>\n"
    )


def _mat(folder: Path, T: Poses) -> None:
    from scipy.io import savemat

    savemat(folder / "robot.mat", {"H_base_tcp": np.moveaxis(T, 0, 2)})


def _mat_rows(folder: Path, T: Poses) -> None:
    from scipy.io import savemat

    savemat(folder / "poses.mat", {"arm": np.hstack([1e3 * T[:, :3, 3], _quaternions(T)])})


def _visp(T: Poses) -> str:
    six = np.concatenate([T[0, :3, 3], _angles(T, "vector", False)[0]])
    return "rows: 6\ncols: 1\ndata:\n" + "".join(f"  - [{v:.9f}]\n" for v in six)


def _samples(T: Poses) -> str:
    entries = [
        {"image_file": n, "robot_pose": {"translation": list(M[:3, 3]), "rotation": list(q)}}
        for n, M, q in zip(picture_names(len(T)), T, _quaternions(T))
    ]
    return json.dumps({"created": "today", "samples": entries})


def _moveit(T: Poses) -> str:
    lines = [
        "- effector_wrt_world: [" + ", ".join(f"{v:.9f}" for v in M.ravel()) + "]\n" for M in T
    ]
    return "".join(lines)


def _frames(T: Poses) -> str:
    entries = [
        {"file_path": f"images/{n}", "transform_matrix": M.tolist()}
        for n, M in zip(picture_names(len(T)), T)
    ]
    return json.dumps({"fl_x": 1.0, "frames": entries})


def _blocks(T: Poses) -> str:
    return "\n".join(_rows(M) for M in T)


def _tum(T: Poses) -> str:
    stamps = 1.6e9 + 2.5 * np.arange(len(T))
    return "# timestamp tx ty tz qx qy qz qw\n" + _rows(
        np.column_stack([stamps, T[:, :3, 3], _quaternions(T)])
    )


def _decimal_commas(T: Poses) -> str:
    text = _rows(np.hstack([1e3 * T[:, :3, 3], _angles(T, "ZYX", True)]), ";", "%.6f")
    return text.replace(".", ",")


def _xyz_q(T: Poses) -> Floats:
    return np.hstack([T[:, :3, 3], _quaternions(T)])


def _wxyz(T: Poses) -> Floats:
    return np.hstack([T[:, :3, 3], _quaternions(T)[:, [3, 0, 1, 2]]])


def _rpy(T: Poses) -> Floats:
    return np.hstack([T[:, :3, 3], _angles(T, "xyz", False)])


LAYOUTS: dict[str, Writer] = {
    "4x4 rows, one line a pose": _text(
        "RobotPosesVec.txt", lambda T: _rows(T.reshape(-1, 16), "\t")
    ),
    "4x4 blocks in one file": _text("poses.txt", _blocks),
    "4x4 column by column": _text("T.txt", lambda T: _rows(np.swapaxes(T, 1, 2).reshape(-1, 16))),
    "3x4 rows (KITTI)": _text("kitti.txt", lambda T: _rows(T[:, :3].reshape(-1, 12))),
    "4x4, a file a pose": _each("robot/pose_{:04d}.txt", lambda T: _rows(T[0])),
    "CSV x y z qx qy qz qw with names": _text(
        "poses.csv", _headed("image,x,y,z,qx,qy,qz,qw", _xyz_q, True)
    ),
    "CSV quaternion w first, named": _text("Robot.CSV", _headed("X,Y,Z,QW,QX,QY,QZ", _wxyz)),
    "quaternion x y z w without header": _text("tcp.txt", lambda T: _rows(_xyz_q(T))),
    "quaternion w x y z without header": _text("arm_poses.dat", lambda T: _rows(_wxyz(T))),
    "quaternion before position": _text(
        "q_t.txt", lambda T: _rows(np.hstack([_quaternions(T), T[:, :3, 3]]))
    ),
    "TUM with stamps": _text("trajectory.tum", _tum),
    "roll pitch yaw, header": _text("poses.csv", _headed("x_m,y_m,z_m,roll,pitch,yaw", _rpy)),
    "mm and degrees in the header": _text(
        "Poses.csv",
        _headed(
            "X (mm),Y (mm),Z (mm),Rx (deg),Ry (deg),Rz (deg)",
            lambda T: np.hstack([1e3 * T[:, :3, 3], _angles(T, "xyz", True)]),
        ),
    ),
    "Fanuc W P R, mm and degrees": _text(
        "fanuc.csv",
        _headed("X,Y,Z,W,P,R", lambda T: np.hstack([1e3 * T[:, :3, 3], _angles(T, "xyz", True)])),
    ),
    "UR's rotation vectors": _text("ur.txt", _six("vector", False, 1.0)),
    "UR's rotation vectors, mm": _text("ur_mm.csv", _six("vector", False, 1e-3, ",")),
    "URScript": _text("calib.script", _urscript),
    "KUKA's A B C, no header": _text("kuka.txt", _six("ZYX", True, 1e-3)),
    "KUKA's program": _text("calib.dat", _kuka),
    "KUKA, decimal commas": _text("punkte.csv", _decimal_commas),
    "ABB's RAPID": _text("calib.mod", _rapid),
    "Halcon's poses": _each("robot_pose_{:02d}.dat", _halcon),
    "Halcon's angles in one file": _text("gba.txt", _six("XYZ", True, 1.0)),
    "Euler about moving z y z": _text("oat.txt", _six("ZYZ", True, 1e-3)),
    "theta-u, ViSP": _each("pose_rPe_{}.yaml", _visp),
    "YAML x y z qx qy qz qw, a file a pose": _each("poses/{}.yaml", _yaml_pose),
    "ROS messages in YAML": _each("poses/pose{}.yaml", _ros_pose),
    "OpenCV's matrices in YAML": _text("robot_poses.yml", _opencv),
    "OpenCV's matrices in XML": _each("T_{:03d}.xml", _xml),
    "JSON samples": _text("samples.json", _samples),
    "JSON frames with 4x4": _text("transforms.json", _frames),
    "MoveIt's samples": _text("calibration_samples.yaml", _moveit),
    "MATLAB 4x4xn": _mat,
    "MATLAB rows with quaternions, mm": _mat_rows,
    "MATLAB text": _text(
        "poses.m",
        lambda T: (
            "T = [\n" + "\n".join(_rows(M.reshape(1, 16)).strip() + ";" for M in T) + "\n];\n"
        ),
    ),
    "an index before six numbers": _text(
        "log.csv",
        lambda T: _rows(
            np.column_stack([np.arange(1, len(T) + 1), T[:, :3, 3], _angles(T, "xyz", False)]), ","
        ),
    ),
}
"""Every layout: its words, and how it is written."""
LAYOUTS |= MORE_LAYOUTS | ODD_LAYOUTS


def write_layout(folder: Path, name: str, one: PlainSet) -> None:
    """A set in one of :data:`LAYOUTS`."""
    write_corners(folder, one)
    LAYOUTS[name](folder, one.poses)
