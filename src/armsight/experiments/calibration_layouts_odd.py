"""Layouts in which people's own scripts and consoles leave poses: lists, logs, printed arrays."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Poses

Writer = Callable[[Path, Poses], None]
Text = Callable[[Poses], str]


def _vectors(T: Poses) -> Floats:
    return np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_rotvec()])


def _quaternions(T: Poses) -> Floats:
    return np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()])


def _degrees(T: Poses) -> Floats:
    turn = Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz", degrees=True)
    return np.hstack([1e3 * T[:, :3, 3], turn])


def _name(k: int) -> str:
    return f"im_{k + 1}.png"


def _list(row: Sequence[float] | Floats) -> str:
    return ", ".join(f"{v:.7f}" for v in row)


def _lines(make: Callable[[int, Floats], str], values: Callable[[Poses], Floats]) -> Text:
    return lambda T: "\n".join(make(k, row) for k, row in enumerate(values(T))) + "\n"


def _printed(T: Poses) -> str:
    return str(np.array2string(T, precision=8, suppress_small=True, threshold=10**6)) + "\n"


def _json_samples(T: Poses) -> str:
    rows = [
        {
            "image_path": f"imgs/{_name(k)}",
            "robot": {
                "position": q[:3].tolist(),
                "orientation": dict(zip("xyzw", q[3:].tolist())),
            },
        }
        for k, q in enumerate(_quaternions(T))
    ]
    return json.dumps({"samples": rows})


def _json_stacks(T: Poses) -> str:
    return json.dumps(
        {"R_gripper2base": T[:, :3, :3].tolist(), "t_gripper2base": T[:, :3, 3:].tolist()}
    )


def _json_line(k: int, row: Floats) -> str:
    return json.dumps({"img": _name(k), "pose": row.tolist()})


def _topic_echo(T: Poses) -> str:
    def one(row: Floats) -> str:
        place = "".join(f"    {a}: {v:.8f}\n" for a, v in zip("xyz", row[:3]))
        turn = "".join(f"    {a}: {v:.8f}\n" for a, v in zip("xyzw", row[3:]))
        head = "header:\n  seq: 1\n  frame_id: base\n"
        return f"{head}pose:\n  position:\n{place}  orientation:\n{turn}---\n"

    return "".join(one(row) for row in _quaternions(T))


def _matlab(T: Poses) -> str:
    return "".join(
        f"T(:,:,{k + 1}) = [{'; '.join(' '.join(f'{v:.8f}' for v in row) for row in M)}];\n"
        for k, M in enumerate(T)
    )


def _german(k: int, r: Floats) -> str:
    return f"{1.7e9 + k:.2f};{_name(k)};" + ";".join(f"{v:.5f}" for v in r)


def _log(k: int, r: Floats) -> str:
    return f"2024-05-01 12:00:{k:02d},123 INFO saved {_name(k)} tcp=({_list(r)})"


def _text(name: str, make: Text, encoding: str = "utf-8", newline: str = "\n") -> Writer:
    def write(folder: Path, T: Poses) -> None:
        (folder / name).write_text(make(T), encoding=encoding, newline=newline)

    return write


_PAIRS = ("x", "y", "z", "rx", "ry", "rz")
_QUATERNION = "x,y,z,qx,qy,qz,qw\n"
_ROWS = _lines(lambda k, r: ",".join(f"{v:.7f}" for v in r), _quaternions)

ODD_LAYOUTS: dict[str, Writer] = {
    "Python's list": _text(
        "poses.txt", lambda T: "[" + ",\n ".join(f"[{_list(r)}]" for r in _vectors(T)) + "]\n"),
    "a Python program": _text(
        "record.py",
        lambda T: "import numpy as np\n\nposes = [\n"
        + "".join(f"    [{_list(r)}],\n" for r in _vectors(T)) + "]\n"),
    "an array of C": _text(
        "poses.h",
        lambda T: f"double poses[{len(T)}][6] = {{\n"
        + ",\n".join(f"{{{_list(r)}}}" for r in _vectors(T)) + "};\n"),
    "numpy, printed": _text("poses.txt", _printed),
    "name = value on a line": _text(
        "poses.txt",
        _lines(lambda k, r: " ".join(f"{n}={v:.5f}" for n, v in zip(_PAIRS, r)), _degrees)),
    "lines of a log": _text("session.log", _lines(_log, _vectors)),
    "a picture and a list a line": _text(
        "robot_poses.txt", _lines(lambda k, r: f"{_name(k)}: [{_list(r)}]", _quaternions)),
    "an index and a list a line, mm": _text(
        "xarm.txt", _lines(lambda k, r: f"{k} [{_list(r)}]", _degrees)),
    "JSON, lists beside names": _text("data.json", _json_samples),
    "JSON, stacks of R and t": _text("calib.json", _json_stacks),
    "JSON, an object a line": _text("poses.jsonl", _lines(_json_line, _quaternions)),
    "ROS's topic echo": _text("poses.yaml", _topic_echo),
    "MATLAB, a matrix a line": _text("poses.m", _matlab),
    "CSV, the picture's name amid numbers": _text(
        "log.csv",
        lambda T: "Timestamp;Bildname;Pos X [mm];Pos Y [mm];Pos Z [mm];Rot X [°];Rot Y [°];"
        "Rot Z [°]\n" + _lines(_german, _degrees)(T)),
    "CSV, a list in a cell": _text(
        "poses.csv",
        lambda T: "image,pose\n" + _lines(lambda k, r: f'{_name(k)},"[{_list(r)}]"', _vectors)(T)),
    "CSV of Windows, UTF-16": _text(
        "poses.csv", lambda T: _QUATERNION + _ROWS(T), "utf-16", "\r\n"),
    "CSV with a byte order mark": _text(
        "poses.csv", lambda T: _QUATERNION + _ROWS(T), "utf-8-sig", "\r\n"),
}  # fmt: skip
"""How each of them is written."""
