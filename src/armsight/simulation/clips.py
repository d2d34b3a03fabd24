"""Recorded people: Vicon clips as joint motions.

The clips (see the data's README) hold nine rigid marker clusters, z up, in metres from the lab's
origin on a work table; ``_info.json`` says where the robot of the recording stood. The clusters sit
on the clothes, not in the joints. Where the joints lie in the clusters' frames was found by least
squares over the liveliest clips (a joint is fixed in both neighbouring clusters: elbow within
10 mm, shoulder within 45 mm, since the shoulder blade moves); see ``OFFSETS``.
"""

from __future__ import annotations

import csv
import gzip
import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter
from scipy.spatial.transform import Rotation, Slerp

from armsight.arrays import Floats, Mask
from armsight.errors import ArmsightError
from armsight.simulation.legs import add_legs
from armsight.simulation.skeleton import INDEX, JOINTS, Proportions

SEGMENTS = (
    "collar",
    "head",
    "left_elbow",
    "left_hand",
    "left_shoulder",
    "right_elbow",
    "right_hand",
    "right_shoulder",
    "hip",
)
FLOOR = -0.72
"""Height of the floor in the clips [m]: the table's top is the origin."""
PERSON = Proportions(
    1.70, shoulder_half=0.185, upper_arm=0.265, forearm=0.245, trunk=0.50, hand=0.085
)
"""The people recorded, as far as the clusters tell."""
OFFSETS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "left_shoulder": ("collar", (-0.172, -0.148, 0.100)),
    "right_shoulder": ("collar", (0.205, -0.148, 0.100)),
    "neck": ("collar", (0.017, -0.140, 0.145)),
    "left_elbow": ("left_elbow", (-0.042, 0.010, -0.033)),
    "right_elbow": ("right_elbow", (0.070, 0.025, -0.015)),
    "pelvis": ("hip", (0.015, -0.185, -0.060)),
    "head": ("head", (0.0, 0.090, -0.060)),
}
"""Joint: cluster, position in the cluster's frame [m] (x right, y forward, z up in a T-pose)."""
JUMP, SPIN = 0.03, 25.0
"""A cluster that leaves its course by this much between two samples [m], or turns this fast
[rad/s], was taken for another or relabelled, not moved."""
FLIP = 1.0
"""What lies between two such breaks within this time is dropped [s]."""
WRIST = 0.045
"""The hand clusters sit on the forearm, this far above the wrist [m]; their rotation is not used:
it flips by half a turn in several clips. The hand is drawn straight on."""
STRETCH = 0.05
"""The length from elbow to hand cluster may differ this much from its median [m]."""


@dataclass(frozen=True)
class Clip:
    """A recorded motion.

    Attributes:
        name: folder and number.
        rate: samples a second [Hz].
        joints: (k, 19, 3) in the clip's frame: the robot of the recording stood at its origin on
            the floor, and the person stands on its positive x, facing it.
        lost: share of the clusters' samples that were missing or jumped and were interpolated.
        proportions: of the person.
    """

    name: str
    rate: float
    joints: Floats
    lost: float
    proportions: Proportions


def load_clip(path: Path) -> Clip:
    """Read a clip and its ``_info.json``.

    Raises:
        ArmsightError: the file is missing or not such a clip; says which line.
    """
    rate, rotation, position = _read(path)
    robot = _robot_place(path)
    missing: Mask = np.isnan(np.concatenate([position, rotation], axis=2)).any(axis=2)
    lost: Mask = missing | _jumped(rotation, position, missing, rate)
    kept = np.sum(~lost, axis=0)
    if len(position) < 3 or kept.min() < 2:
        raise ArmsightError(
            f"{path}: '{SEGMENTS[int(np.argmin(kept))]}' was never seen; the clip is of no use"
        )
    joints = _joints(rotation, position, lost, rate)
    joints[..., :3] -= np.array([robot[0], robot[1], FLOOR])
    # The clip's person stands towards -y of the robot and looks along +y; here +x and -x.
    joints = np.stack([-joints[..., 1], joints[..., 0], joints[..., 2]], axis=-1)
    _raise_sunken(joints)
    add_legs(joints, PERSON, rate)
    name = f"{path.parent.name}/{path.name.split('.')[0]}"
    return Clip(name, rate, joints, float(lost.mean()), PERSON)


def _read(path: Path) -> tuple[float, Floats, Floats]:
    """Rate [Hz], (k, 9, 3) rotation vectors [rad], (k, 9, 3) positions [m] with NaN for lost."""
    try:
        with gzip.open(path, "rt", encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
        rate = float(lines[1][0])
        names = [cell.split(":")[-1] for cell in lines[2] if cell]
        columns = 2 + 6 * len(names)
        if set(names) != set(SEGMENTS):
            raise ValueError(f"line 3 names segments {names}, expected {list(SEGMENTS)}")
        rows = [row for row in lines[5:] if row]
        short = next((i for i, row in enumerate(rows) if len(row) < columns), None)
        if short is not None:
            raise ValueError(f"line {short + 6} has {len(rows[short])} cells, not {columns}")
        values = np.array(
            [[float(cell) if cell else np.nan for cell in row[2:columns]] for row in rows]
        )
    except (OSError, EOFError, ValueError, IndexError) as problem:
        raise ArmsightError(f"{path}: not a motion clip ({problem})") from problem
    if rate <= 0 or values.size == 0:
        raise ArmsightError(f"{path}: not a motion clip (no samples or no rate)")
    order = [names.index(name) for name in SEGMENTS]
    values = values.reshape(len(values), len(names), 6)[:, order]
    return rate, values[..., :3], values[..., 3:] / 1000.0


def _robot_place(path: Path) -> Floats:
    """(3,) where the robot stood in the clip [m]."""
    info = path.with_name(path.name.split(".")[0] + "_info.json")
    try:
        place = np.asarray(json.loads(info.read_text())["position_offset"], float)
        if place.shape != (3,):
            raise ValueError("position_offset is not three numbers")
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise ArmsightError(f"{info}: cannot place the clip ({problem})") from problem
    return place


def _jumped(rotation: Floats, position: Floats, lost: Mask, rate: float) -> Mask:
    """(k, 9) clusters that jumped or flipped away, or whose forearm changed its length."""
    jumped = np.zeros_like(lost)
    for s in range(position.shape[1]):
        seen = np.flatnonzero(~lost[:, s])
        if len(seen) < 12:
            continue
        moved = np.diff(position[seen, s], axis=0)
        course = median_filter(moved, size=(11, 1), mode="nearest")
        gap = np.diff(seen) / rate
        off = np.linalg.norm(moved - course, axis=1) > JUMP
        turned = Rotation.from_rotvec(rotation[seen, s])
        off |= (turned[:-1].inv() * turned[1:]).magnitude() > SPIN * gap
        breaks = np.flatnonzero(off)
        for first, last in pairwise(breaks):
            if seen[last] - seen[first] < FLIP * rate:
                jumped[seen[first + 1] : seen[last] + 1, s] = True
        for each in breaks:
            jumped[max(seen[each] - 4, 0) : seen[each] + 6, s] = True
    for side in ("left", "right"):
        elbow, hand = SEGMENTS.index(f"{side}_elbow"), SEGMENTS.index(f"{side}_hand")
        length = np.linalg.norm(position[:, hand] - position[:, elbow], axis=1)
        if np.all(np.isnan(length)):
            continue
        with np.errstate(invalid="ignore"):
            wrong = np.abs(length - np.nanmedian(length)) > STRETCH
        jumped[:, hand] |= wrong
        jumped[:, elbow] |= wrong
    return jumped


def _joints(rotation: Floats, position: Floats, lost: Mask, rate: float) -> Floats:
    """(k, 19, 3) joints in the lab's frame [m]; legs unset."""
    k = len(position)
    times = np.arange(k, dtype=float)
    joints = np.zeros((k, len(JOINTS), 3))
    turned: dict[str, Rotation] = {}
    placed: dict[str, Floats] = {}
    for s, name in enumerate(SEGMENTS):
        seen = np.flatnonzero(~lost[:, s])
        inside = np.clip(times, seen[0], seen[-1])
        turned[name] = Slerp(times[seen], Rotation.from_rotvec(rotation[seen, s]))(inside)
        track = np.stack(
            [np.interp(inside, times[seen], position[seen, s, a]) for a in range(3)], axis=1
        )
        placed[name] = gaussian_filter1d(track, 0.015 * rate, axis=0, mode="nearest")
    for joint, (cluster, offset) in OFFSETS.items():
        joints[:, INDEX[joint]] = placed[cluster] + turned[cluster].apply(offset)
    _settle_head(joints, turned["head"])
    for side in ("left", "right"):
        elbow, above_wrist = joints[:, INDEX[f"{side}_elbow"]], placed[f"{side}_hand"]
        along = above_wrist - elbow
        length = np.linalg.norm(along, axis=1, keepdims=True)
        along /= np.maximum(length, 1e-6)
        wrist = elbow + along * np.clip(
            length + WRIST, PERSON.forearm - 0.03, PERSON.forearm + 0.03
        )
        joints[:, INDEX[f"{side}_wrist"]] = wrist
        joints[:, INDEX[f"{side}_hand"]] = wrist + PERSON.hand * along
    for side in ("left", "right"):  # constant bones: elbow and wrist are the best known
        shoulder, elbow = joints[:, INDEX[f"{side}_shoulder"]], joints[:, INDEX[f"{side}_elbow"]]
        arm = elbow - shoulder
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        joints[:, INDEX[f"{side}_shoulder"]] = elbow - arm / length * np.clip(
            length, PERSON.upper_arm - 0.03, PERSON.upper_arm + 0.03
        )
    return gaussian_filter1d(joints, 0.01 * rate, axis=0, mode="nearest")


def _settle_head(joints: Floats, turned: Rotation) -> None:
    """The cap sits higher or lower from day to day: move the head along its own up axis."""
    up = turned.apply([0.0, 0.0, 1.0])
    above = np.sum((joints[:, INDEX["head"]] - joints[:, INDEX["neck"]]) * up, axis=1)
    joints[:, INDEX["head"]] -= up * (np.median(above) - PERSON.neck_to_head)


def _raise_sunken(joints: Floats) -> None:
    """Stand on the floor: the upright pelvis of a clip is as high as the legs are long."""
    p = PERSON
    upright = np.percentile(joints[:, INDEX["pelvis"], 2], 90)
    joints[..., 2] += p.ankle + p.shin + p.thigh - 0.01 - upright
