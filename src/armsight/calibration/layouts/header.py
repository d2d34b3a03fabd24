"""Names that people give to columns, in our words."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

_UNITS = {
    "mm": ("length", 1e-3),
    "cm": ("length", 1e-2),
    "m": ("length", 1.0),
    "in": ("length", 0.0254),
    "inch": ("length", 0.0254),
    "deg": ("angle", np.pi / 180),
    "degree": ("angle", np.pi / 180),
    "degrees": ("angle", np.pi / 180),
    "°": ("angle", np.pi / 180),
    "grad": ("angle", np.pi / 180),
    "rad": ("angle", 1.0),
    "radians": ("angle", 1.0),
}
_KEYS = {
    *("image", "file", "filename", "file_name", "name", "picture", "img", "frame", "view"),
    *("index", "idx", "id", "no", "nr", "number", "i", "n", "image_file", "image_name", "photo"),
    *("bild", "bildname", "datei", "imagen", "foto", "image_path", "img_path"),
}
_STAMPS = {
    "#timestamp",
    "timestamp_ns",
    "t",
    "time",
    "stamp",
    "timestamp",
    "sec",
    "secs",
    "seconds",
    "time_s",
}
_PREFIX = re.compile(
    r"^(t_base_flange|base_flange|base_tcp|tcp|flange|tool|ee|eef|robot|arm|pose|actual|cart|"
    r"position|pos|translation|trans|p|t)[._ /]+"
)
_ROTATION_PREFIX = re.compile(
    r"^(orientation|rotation|quaternion|quat|rot|ori|q|o)[._ /]*(?=[xyzw0-3ijk]$)"
)


def canonical(cell: str) -> tuple[str, str | None, float]:
    """A column's name in our words, the kind of unit that it names, and its size.

    ``X [mm]`` is ``("x", "length", 0.001)``; what is not known comes back as it is.
    """
    text = cell.strip().strip("\"'").lower()
    unit: tuple[str | None, float] = (None, 1.0)
    found = re.search(r"[\s_(\[/]+([a-z°]+)[\])]*$", text)
    if found and found.group(1) in _UNITS and found.start() > 0:
        unit = _UNITS[found.group(1)]
        text = text[: found.start()].strip(" _([/")
    if text in _KEYS:
        return "key", *unit
    if text in _STAMPS and unit[0] is None:
        return "stamp", *unit
    if re.fullmatch(r"r[._ ]?[xyz]", text):
        return f"r{text[-1]}", *unit
    turned = False
    for _ in range(3):
        shorter = _PREFIX.sub("", text)
        if shorter != text and shorter:
            text = shorter
            continue
        shorter = _ROTATION_PREFIX.sub("", text)
        if shorter != text:
            turned, text = True, shorter
        break
    if turned or text in ("qx", "qy", "qz", "qw"):
        axis = text[-1]
        four = {"0": "qw", "1": "qx", "2": "qy", "3": "qz", "i": "qx", "j": "qy", "k": "qz"}
        text = four.get(axis, {"w": "qw"}.get(axis, f"q{axis}"))
    return text, *unit


_POSITION = (("x", "y", "z"), ("tx", "ty", "tz"), ("px", "py", "pz"))
_ANGLES = (
    (("rx", "ry", "rz"), None),
    (("roll", "pitch", "yaw"), "xyz"),
    (("a", "b", "c"), "ZYX"),
    (("w", "p", "r"), "xyz"),
    (("o", "a", "t"), "ZYZ"),
    (("u", "v", "w"), "vector"),
    (("tux", "tuy", "tuz"), "vector"),
    (("rvx", "rvy", "rvz"), "vector"),
    (("rvec_x", "rvec_y", "rvec_z"), "vector"),
    (("alpha", "beta", "gamma"), None),
    (("qx", "qy", "qz"), None),  # "rotation x y z" without a fourth
)


class Columns:
    """What a header says of each column.

    Attributes:
        key: column of the picture's name, or None; stamp: of the time, or None.
        pose: columns of the pose's numbers, in the order of ``names``.
        names: their names in our words; empty where the header names no pose.
        length, angle: units that the header names, or None.
        rotation: the convention that it names, or None.
        joints: columns of joint angles; joint_unit: their unit [rad].
    """

    def __init__(self, header: Sequence[str]) -> None:
        words = [canonical(cell) for cell in header]
        place: dict[str, int] = {}
        for k, (name, _, _) in enumerate(words):
            place.setdefault(name, k)
        self.key = place.get("key")
        self.stamp = place.get("stamp")
        self.pose: list[int] = []
        self.names: tuple[str, ...] = ()
        self.length: float | None = None
        self.angle: float | None = None
        self.rotation: str | None = None
        joint: dict[int, int] = {}
        for k, cell in enumerate(header):
            found = re.match(r"^(?:j|q|joint|axis|a|theta)_?(\d+)", cell.strip().lower())
            if found:
                joint.setdefault(int(found.group(1)), k)
        self.joints = [joint[k] for k in sorted(joint)] if len(joint) >= 5 else []
        sizes = [words[k][2] for k in self.joints if words[k][1] == "angle"]
        self.joint_unit = sizes[0] if sizes else 1.0
        position = next((p for p in _POSITION if set(p) <= set(place)), None)
        if position is None:
            self._matrix(place)
            return
        columns = [place[p] for p in position]
        self.length = next((words[k][2] for k in columns if words[k][1] == "length"), None)
        free = {n: k for n, k in place.items() if k not in self.joints}
        if {"qx", "qy", "qz", "qw"} <= set(free):
            axes = ("qx", "qy", "qz")
            quaternion = (*axes, "qw") if free["qx"] < free["qw"] else ("qw", *axes)
            self.names = ("x", "y", "z", *quaternion)
            self.pose = columns + [free[q] for q in quaternion]
            return
        for angles, rotation in _ANGLES:
            if set(angles) <= set(free):
                self.pose = columns + [free[a] for a in angles]
                self.names = ("x", "y", "z", "rx", "ry", "rz")
                self.rotation = rotation
                units = [words[free[a]] for a in angles]
                self.angle = next((s for _, kind, s in units if kind == "angle"), None)
                return
        self._rotation_matrix(place, columns)

    def _rotation_matrix(self, place: dict[str, int], columns: list[int]) -> None:
        for base in (0, 1):
            cells = [f"r{i + base}{j + base}" for i in range(3) for j in range(3)]
            if set(cells) <= set(place):
                self.names = ("x", "y", "z", *(f"r{i}{j}" for i in range(3) for j in range(3)))
                self.pose = columns + [place[c] for c in cells]
                return

    def _matrix(self, place: dict[str, int]) -> None:
        for letter in ("m", "t"):
            for base in (0, 1):
                cells = [f"{letter}{i + base}{j + base}" for i in range(4) for j in range(4)]
                count = 16 if set(cells) <= set(place) else 12
                if set(cells[:count]) <= set(place):
                    self.names = tuple(f"m{k}" for k in range(count))
                    self.pose = [place[c] for c in cells[:count]]
                    return
