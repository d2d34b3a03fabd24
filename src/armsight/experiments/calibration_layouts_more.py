"""More layouts: other labs' logs, programs and arrays (see ``calibration_layouts``)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses

Writer = Callable[[Path, Poses], None]


def _rows(value: Floats, form: str = "%.9f", delimiter: str = " ") -> str:
    return "\n".join(delimiter.join(form % v for v in row) for row in np.atleast_2d(value)) + "\n"


def _q(T: Poses) -> Floats:
    return np.asarray(Rotation.from_matrix(T[:, :3, :3]).as_quat(), np.float64)


def _euler(T: Poses, kind: str) -> Floats:
    R = Rotation.from_matrix(T[:, :3, :3])
    return np.asarray(R.as_euler(kind, degrees=True), np.float64)  # type: ignore[call-overload]


def _vector(T: Poses) -> Floats:
    return np.asarray(Rotation.from_matrix(T[:, :3, :3]).as_rotvec(), np.float64)


def _text(name: str, make: Callable[[Poses], str]) -> Writer:
    def write(folder: Path, T: Poses) -> None:
        (folder / name).write_text(make(T))

    return write


def _each(pattern: str, make: Callable[[Poses], str]) -> Writer:
    def write(folder: Path, T: Poses) -> None:
        for k in range(len(T)):
            file = folder / pattern.format(k + 1)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(make(T[k : k + 1]))

    return write


def _rtde(T: Poses) -> str:
    names = [f"actual_q_{k}" for k in range(6)] + [f"actual_TCP_pose_{k}" for k in range(6)]
    q = np.cumsum(np.full((len(T), 6), 0.11), axis=0)  # somebody else's arm
    table = np.hstack([10.0 + np.arange(len(T))[:, None], q, T[:, :3, 3], _vector(T)])
    return " ".join(["timestamp", *names]) + "\n" + _rows(table)


def _franka(T: Poses) -> str:
    header = ",".join(["index", *(f"O_T_EE[{k}]" for k in range(16))])
    value = np.swapaxes(T, 1, 2).reshape(-1, 16)
    return header + "\n" + _rows(np.column_stack([np.arange(len(T)), value]), "%.9f", ",")


def _euroc(T: Poses) -> str:
    header = (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
        "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    )
    lines = [
        f"{1403636580838555648 + 2_000_000_000 * k},"
        + ",".join(f"{v:.9f}" for v in (*M[:3, 3], *q[[3, 0, 1, 2]]))
        for k, (M, q) in enumerate(zip(T, _q(T)))
    ]
    return "\n".join([header, *lines]) + "\n"


def _fanuc(T: Poses) -> str:
    blocks = [
        f"P[{k + 1}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX = {p[0]:9.4f}  mm,\tY = {p[1]:9.4f}  mm,\tZ = {p[2]:9.4f}  mm,\n"
        f"\tW = {a[0]:9.5f} deg,\tP = {a[1]:9.5f} deg,\tR = {a[2]:9.5f} deg\n}};\n"
        for k, (p, a) in enumerate(zip(1e3 * T[:, :3, 3], _euler(T, "xyz")))
    ]
    return "/PROG  CALIB\n/MN\n/POS\n" + "".join(blocks) + "/END\n"


def _doosan(T: Poses) -> str:
    return "".join(
        f"movel(posx({', '.join(f'{v:.5f}' for v in (*p, *a))}), v=50, a=50)\n"
        for p, a in zip(1e3 * T[:, :3, 3], _euler(T, "ZYZ"))
    )


def _tf_echo(T: Poses) -> str:
    return "".join(
        f"At time {1500000000 + k}.123\n- Translation: [{p[0]:.6f}, {p[1]:.6f}, {p[2]:.6f}]\n"
        f"- Rotation: in Quaternion [{q[0]:.6f}, {q[1]:.6f}, {q[2]:.6f}, {q[3]:.6f}]\n"
        f"            in RPY (radian) [{a[0]:.6f}, {a[1]:.6f}, {a[2]:.6f}]\n"
        for k, (p, q, a) in enumerate(zip(T[:, :3, 3], _q(T), np.deg2rad(_euler(T, "xyz"))))
    )


def _easy_handeye(T: Poses) -> str:
    """Samples of easy_handeye: the robot's transform beside the tracker's."""
    lines = ["samples:"]
    for p, q in zip(T[:, :3, 3], _q(T)):
        lines += [
            "- robot:",
            "    translation: {" + ", ".join(f"{a}: {v:.9f}" for a, v in zip("xyz", p)) + "}",
            "    rotation: {" + ", ".join(f"{a}: {v:.9f}" for a, v in zip("xyzw", q)) + "}",
            "  optical:",
            "    translation: {x: 0.1, y: 0.2, z: 0.9}",
            "    rotation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}",
        ]
    return "\n".join(lines) + "\n"


def _named_json(T: Poses) -> str:
    return json.dumps({f"im_{k + 1}.png": M.tolist() for k, M in enumerate(T)})


def _joint_and_pose(T: Poses) -> str:
    value = [*T[0, :3, 3], *_vector(T)[0]]
    return json.dumps({"joints": [0.1, -1.2, 1.4, -1.9, 1.7, 2.9], "pose_flange": value})


def _zivid(T: Poses) -> str:
    rows = ",\n      ".join("[" + ", ".join(f"{v:.7f}" for v in row) + "]" for row in _mm(T)[0])
    head = "__version__: {serializer: 1, data: 1}\nFloatMatrix:\n  Data:\n"
    return f"{head}    [\n      {rows}\n    ]\n"


def _mm(T: Poses) -> Poses:
    out = T.copy()
    out[:, :3, 3] *= 1e3
    return out


def _labelled(T: Poses) -> str:
    six = np.hstack([T[:, :3, 3], _vector(T)])
    return "".join(
        f"pose {k + 1}: [{', '.join(f'{v:.7f}' for v in row)}]\n" for k, row in enumerate(six)
    )


def _german(T: Poses) -> str:
    header = "Bild;X [mm];Y [mm];Z [mm];A [deg];B [deg];C [deg]"
    value = np.hstack([1e3 * T[:, :3, 3], _euler(T, "ZYX")])
    lines = [
        f"im_{k + 1}.png;" + ";".join(f"{v:.5f}".replace(".", ",") for v in row)
        for k, row in enumerate(value)
    ]
    return "\n".join([header, *lines]) + "\n"


def _npy(folder: Path, T: Poses) -> None:
    np.save(folder / "robot_poses.npy", T)


def _npz(folder: Path, T: Poses) -> None:
    np.savez(folder / "arm.npz", R_gripper2base=T[:, :3, :3], t_gripper2base=T[:, :3, 3:])


def _npy_each(folder: Path, T: Poses) -> None:
    (folder / "poses").mkdir()
    for k, M in enumerate(T):
        np.save(folder / "poses" / f"{k + 1}.npy", M)


def _long_log(folder: Path, T: Poses) -> None:
    """A trajectory at a rate of its own; pictures are named by their time in nanoseconds."""
    start = 1_700_000_000.0
    at = start + 3.0 * np.arange(len(T))
    times = np.arange(start - 0.95, at[-1] + 1.0, 0.1)
    near = np.clip(np.rint((times - start) / 3.0), 0, len(T) - 1).astype(int)
    rows = np.column_stack([T[near][:, :3, 3], _q(T[near])])
    text = [f"{t:.6f} " + " ".join(f"{v:.9f}" for v in row) for t, row in zip(times, rows)]
    (folder / "trajectory.txt").write_text("\n".join(text) + "\n")
    old = (folder / "corners.csv").read_text()
    for k in range(len(T), 0, -1):
        old = old.replace(f"im_{k}.png", f"{round((at[k - 1] + 0.02) * 1e9):d}.png")
    (folder / "corners.csv").write_text(old)


MORE_LAYOUTS: dict[str, Writer] = {
    "UR's RTDE recording, joints and pose": _text("robot_data.csv", _rtde),
    "Franka's O_T_EE by columns": _text("states.csv", _franka),
    "EuRoC, Kalibr: stamps, w first": _text("data.csv", _euroc),
    "Fanuc's LS program": _text("calib.ls", _fanuc),
    "Doosan's posx": _text("calib.drl", _doosan),
    "ROS's tf_echo": _text("tf.log", _tf_echo),
    "easy_handeye's samples": _text("samples.yaml", _easy_handeye),
    "JSON, 4x4 by picture": _text("poses.json", _named_json),
    "JSON, joints and pose, a file a pose": _each("{}.json", _joint_and_pose),
    "Zivid's YAML matrices, mm": _each("pos{:02d}.yaml", _zivid),
    "a label before each pose": _text("poses.txt", _labelled),
    "CSV, decimal commas and units": _text("Posen.csv", _german),
    "numpy (n, 4, 4)": _npy,
    "numpy's R and t": _npz,
    "numpy, a file a pose": _npy_each,
    "a trajectory by time": _long_log,
}
