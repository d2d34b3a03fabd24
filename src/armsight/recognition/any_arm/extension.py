"""Another robot for a crop network: rows of its last layers, in a file of their own.

What the network sees (``features``, ``hidden``) stays as it is, and so does all that it says of the
robots that it was trained on: bit for bit, since nothing of it is touched. An extension reads its
own landmarks, link masks and surface coordinates off the same features, and a number that its robot
must win against all types of the network together before anything is said of it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Floats, Floats32, JointVector
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.landmarks import SLOTS, Landmarks, read_landmarks
from armsight.recognition.training.tensors_file import read_tensors, write_tensors
from armsight.robots.catalogue import load_robot
from armsight.robots.robot import Robot

FORMAT = "armsight-extension-1"
LINKS = 10
"""Background, the base and eight more."""
CELLS = 4
"""Cells of the outputs a place of the features."""


@dataclass(frozen=True)
class Rows:
    """Weights of a robot's own, for c features and d hidden numbers; the last column is added.

    Attributes:
        heat: (4 SLOTS, c + 1) landmarks.
        surface: (4 (LINKS + 4), c + 1) links, coordinates and their spread.
        outside: (SLOTS, d + 1) of landmarks that are not in the crop.
        type: (d + 1,) the robot's own logit.
    """

    heat: Floats32
    surface: Floats32
    outside: Floats32
    type: Floats32


@dataclass(frozen=True)
class Joints:
    """The joints of the robot that an extension learned.

    Attributes:
        names: n of them; lower, upper: (n,) limits [rad].
        places: (n, 15) of each its frame on its link (the upper three rows) and its axis in that.
    """

    names: tuple[str, ...]
    lower: JointVector
    upper: JointVector
    places: Floats

    def differs(self, other: Joints) -> str:
        """How other joints differ from these, the first thing; empty where they do not."""
        if len(self.names) != len(other.names):
            return f"{len(other.names)} joints, not {len(self.names)}"
        for k, (mine, name) in enumerate(zip(self.names, other.names, strict=True)):
            if mine != name:
                return f"joint {k + 1} is called {name}, not {mine}"
            now, then = ((j.lower[k], j.upper[k]) for j in (other, self))
            if not np.allclose(now, then, rtol=0.0, atol=_SAME):
                told = (f"{low:.4g} to {high:.4g} rad" for low, high in (now, then))
                return f"{name} turns from {', not '.join(told)}"
            if not np.allclose(self.places[k], other.places[k], rtol=0.0, atol=_SAME):
                return f"{name} has another place or axis on its link"
        return ""


_SAME = 1e-4
"""Difference up to which two joints are the same [rad], [m]."""


def joints_of(robot: Robot) -> Joints:
    """The joints of a robot."""
    places = np.hstack([robot.T_link_joint[:, :3].reshape(-1, 12), robot.axis])
    return Joints(robot.joint_names, robot.limits.lower, robot.limits.upper, places)


@dataclass(frozen=True)
class Extension:
    """A robot that a network learned later.

    Attributes:
        robot: its model: a name of the catalogue or the path of a user's own.
        network: SHA-256 of the file of the network that it belongs to.
        landmarks: of the robot.
        rows: weights.
        card: what it learned from, and how good it is.
        joints: of the robot as it was learned; None in files of November 2026 and before.
    """

    robot: str
    network: str
    landmarks: Landmarks
    rows: Rows
    card: dict[str, object]
    joints: Joints | None = None

    def check_robot(self) -> None:
        """See that the robot is still the one that was learned.

        Raises:
            RecognitionError: its joints are others now. RobotError: it is not where it was.
        """
        robot = load_robot(self.robot)
        differs = "" if self.joints is None else self.joints.differs(joints_of(robot))
        if differs or len(self.landmarks.middle) != robot.n + 1:
            raise RecognitionError(
                f"{self.robot}: is no more the robot that the extension learned "
                f"({differs or 'other links'}); run 'armsight extend' again, with another --out"
            )


@dataclass(frozen=True)
class Seen:
    """What an extension says, as the network says it; h x w cells.

    Attributes:
        heat: (SLOTS, h, w) logits; outside: (SLOTS,) logits.
        surface: (LINKS + 4, h, w) logits of the links, coordinates, log of their spread.
        type: logit.
    """

    heat: Floats32
    outside: Floats32
    surface: Floats32
    type: float


def apply(rows: Rows, features: Floats32, hidden: Floats32) -> Seen:
    """What the rows say of (c, h / 2, w / 2) features and (d,) hidden numbers."""
    return Seen(
        _maps(rows.heat, features),
        rows.outside[:, :-1] @ hidden + rows.outside[:, -1],
        _maps(rows.surface, features),
        float(rows.type[:-1] @ hidden + rows.type[-1]),
    )


def _maps(weight: Floats32, features: Floats32) -> Floats32:
    c, h, w = features.shape
    flat = weight[:, :-1] @ features.reshape(c, h * w) + weight[:, -1:]
    # Four rows are the four cells of a place: pixel shuffle, as the network does it.
    return shuffled(flat.reshape(-1, h, w))


def shuffled(maps: Floats32) -> Floats32:
    """(4 k, h, w) as (k, 2 h, 2 w)."""
    k, h, w = len(maps) // CELLS, *maps.shape[1:]
    split = maps.reshape(k, 2, 2, h, w).transpose(0, 3, 1, 4, 2)
    return np.ascontiguousarray(split.reshape(k, 2 * h, 2 * w))


def mark_of(data: bytes) -> str:
    """What an extension remembers its network by."""
    return hashlib.sha256(data).hexdigest()


def write_extension(file: Path, extension: Extension) -> None:
    """Write an extension whole or not at all.

    Raises:
        RecognitionError: the folder cannot be written.
    """
    words = {
        "format": FORMAT,
        "robot": extension.robot,
        "network": extension.network,
        "landmarks": json.dumps(extension.landmarks.to_json(), allow_nan=False),
        "card": json.dumps(extension.card, allow_nan=False),
    }
    if extension.joints is not None:
        plain = {k: np.asarray(v).tolist() for k, v in vars(extension.joints).items()}
        words["joints"] = json.dumps(plain, allow_nan=False)
    write_tensors(file, vars(extension.rows), words)


def read_extension(file: Path) -> Extension:
    """An extension from its file; nothing in it can be run.

    Raises:
        RecognitionError: it is missing or damaged.
    """
    arrays, words = read_tensors(file)
    if words.get("format") != FORMAT:
        raise RecognitionError(f"{file}: is no extension; 'armsight extend' writes one")
    try:
        rows = Rows(**arrays)
        marks = read_landmarks(json.loads(words["landmarks"]))
        card = json.loads(words["card"])
        joints = _read_joints(json.loads(words["joints"])) if "joints" in words else None
        robot, network = words["robot"], words["network"]
        c, d = rows.heat.shape[1], rows.outside.shape[1]
        shapes: dict[str, tuple[int, ...]] = {
            "heat": (CELLS * SLOTS, c),
            "surface": (CELLS * (LINKS + 4), c),
            "outside": (SLOTS, d),
            "type": (d,),
        }
        good = all(
            getattr(rows, k).shape == s and getattr(rows, k).dtype == np.float32
            for k, s in shapes.items()
        ) and all(bool(np.isfinite(v).all()) for v in vars(rows).values())
        if not good or not isinstance(card, dict):
            raise ValueError
    except (
        ValueError, TypeError, AttributeError, LookupError, OverflowError, RecursionError,
    ):  # fmt: skip
        raise RecognitionError(f"{file}: is damaged; make it anew with 'armsight extend'") from None
    return Extension(robot, network, marks, rows, card, joints)


def _read_joints(entry: dict[str, list[object]]) -> Joints:
    lower, upper, places = (np.array(entry[k], np.float64) for k in ("lower", "upper", "places"))
    n = len(entry["names"])
    if not lower.shape == upper.shape == (n,) or places.shape != (n, 15):
        raise ValueError
    return Joints(tuple(map(str, entry["names"])), lower, upper, places)
