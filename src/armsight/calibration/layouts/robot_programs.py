"""Poses in the words of robots' controllers and of tools that name every number by its place."""

from __future__ import annotations

import re

import numpy as np

from armsight.calibration.layouts.table import NUMBER, PoseTable, places, value_of


def kuka(text: str, source: str) -> PoseTable | None:
    """KUKA's frames: ``{X 1.0, Y 2.0, Z 3.0, A 10.0, B 20.0, C 30.0, ...}`` (mm, degrees)."""
    pattern = r"\{[^{}]*?" + r"[^{}]*?".join(rf"\b{a}\s+({NUMBER})" for a in "XYZABC")
    found = re.findall(pattern, text)
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(
        source, ("",) * len(value), value, names, 1e-3, np.pi / 180, "ZYX",
        decimals=places([c for row in found for c in row[3:]]),
    )  # fmt: skip


def rapid(text: str, source: str) -> PoseTable | None:
    """ABB's robtargets: ``[[x, y, z], [q1, q2, q3, q4], ...`` (mm, w x y z)."""
    number = rf"\s*({NUMBER})\s*"
    pattern = rf"\[\s*\[{','.join([number] * 3)}\]\s*,\s*\[{','.join([number] * 4)}\]"
    if not re.search(r"robtarget|pose\b", text, re.IGNORECASE):
        return None
    found = re.findall(pattern, text)
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "qw", "qx", "qy", "qz")
    return PoseTable(source, ("",) * len(value), value, names, 1e-3)


def urscript(text: str, source: str) -> PoseTable | None:
    """Universal Robots' poses: ``p[x, y, z, rx, ry, rz]`` (m, rotation vector)."""
    number = rf"\s*({NUMBER})\s*"
    found = re.findall(rf"\bp\[{','.join([number] * 6)}\]", text)
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(source, ("",) * len(value), value, names, 1.0, 1.0, "vector")


_HALCON = {0: "XYZ", 2: "ZYX", 4: "vector"}
"""Halcon's representation types 'gba', 'abg' and 'rodriguez', all 'Rp+T' of points."""


def halcon(text: str, source: str) -> PoseTable | None:
    """Halcon's pose files: lines ``f TYPE``, ``r A B C`` (degrees), ``t X Y Z`` (m)."""
    found = {
        letter: re.findall(rf"^{letter}((?:\s+{NUMBER})+)\s*$", text, re.MULTILINE)
        for letter in "frt"
    }
    if not all(len(found[letter]) == 1 for letter in "frt"):
        return None
    kind = int(value_of(found["f"][0].split()[0]))
    r = [value_of(c) for c in found["r"][0].split()]
    t = [value_of(c) for c in found["t"][0].split()]
    if len(r) != 3 or len(t) != 3 or kind not in _HALCON:
        return None
    if kind == 2:  # 'abg' writes its angles about x, y, z, and turns about z first
        r = r[::-1]
    names = ("x", "y", "z", "rx", "ry", "rz")
    unit = 1.0 if kind == 4 else np.pi / 180
    return PoseTable(source, ("",), np.array([t + r]), names, 1.0, unit, _HALCON[kind])


def fanuc(text: str, source: str) -> PoseTable | None:
    """Fanuc's positions: ``P[1]{ ... X = 1.0 mm, ... W = 10.0 deg, P = ..., R = ... };``."""
    pattern = r"P\s*\[[^\]]*\]\s*\{[^{}]*?" + r"[^{}]*?".join(
        rf"\b{a}\s*=\s*({NUMBER})" for a in "XYZWPR"
    )
    found = re.findall(pattern, text)
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(source, ("",) * len(value), value, names, 1e-3, np.pi / 180, "xyz")


def doosan(text: str, source: str) -> PoseTable | None:
    """Doosan's ``posx(x, y, z, a, b, c)`` (mm, degrees about moving z, y, z)."""
    number = rf"\s*({NUMBER})\s*"
    found = re.findall(rf"\bposx\s*\(\s*\[?{','.join([number] * 6)}", text)
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "rx", "ry", "rz")
    return PoseTable(source, ("",) * len(value), value, names, 1e-3, np.pi / 180, "ZYZ")


def tf_echo(text: str, source: str) -> PoseTable | None:
    """What ROS's ``tf_echo`` prints: a line of translation, one of a quaternion (m, x y z w)."""
    number = rf"\s*({NUMBER})\s*"
    found = re.findall(
        rf"Translation:\s*\[{','.join([number] * 3)}\][^\[]*?Quaternion[^\[]*"
        rf"\[{','.join([number] * 4)}\]",
        text,
    )
    if not found:
        return None
    value = np.array([[value_of(c) for c in row] for row in found])
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return PoseTable(source, ("",) * len(value), value, names, 1.0)


PROGRAMS = (kuka, rapid, urscript, halcon, fanuc, doosan, tf_echo)
"""Every form that names its numbers by itself."""
