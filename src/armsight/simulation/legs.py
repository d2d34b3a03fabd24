"""Legs for a pelvis that moves: feet stay where they stand and step when left behind."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats
from armsight.simulation.motion import RATE
from armsight.simulation.skeleton import INDEX, Proportions, bend

SWING = 0.36
"""Seconds that a foot is in the air [s]."""
LIFT = 0.07
"""Height of a step [m]."""
TOES_OUT = 0.15
"""Feet point outwards by this [rad]."""
STRAY, TURN = 0.14, 0.5
"""A foot steps when it is this far [m], or turned this much [rad], from where it belongs."""


def add_legs(
    joints: Floats, p: Proportions, rate: float = RATE, start: Floats | None = None
) -> None:
    """Fill hips, knees, ankles and toes of (k, 19, 3) ``joints`` in place, from the pelvis.

    The floor is z = 0; the person faces across the line between the hips (or the shoulders). Feet
    begin where they belong, or where they stand in a posture (19, 3) ``start``.
    """
    pelvis = joints[:, INDEX["pelvis"]]
    left = joints[:, INDEX["left_shoulder"]] - joints[:, INDEX["right_shoulder"]]
    heading = _smoothed(np.unwrap(np.arctan2(-left[:, 0], left[:, 1])), rate)
    forward = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=1)
    side = np.stack([-forward[:, 1], forward[:, 0], forward[:, 2]], axis=1)
    ground = pelvis * np.array([1.0, 1.0, 0.0])
    signs = {"left": 1.0, "right": -1.0}
    homes = {s: ground + signs[s] * 1.15 * p.hip_half * side for s in signs}
    feet = _walk(homes, heading, rate, None if start is None else _feet(start))
    for name, sign in signs.items():
        hip = pelvis + sign * p.hip_half * side - np.array([0.0, 0.0, 0.02])
        place, yaw = feet[name]
        toes_out = yaw + sign * TOES_OUT
        along = np.stack([np.cos(toes_out), np.sin(toes_out), np.zeros_like(yaw)], axis=1)
        ankle = place + np.array([0.0, 0.0, p.ankle])
        knee, ankle = bend(hip, ankle, p.thigh, p.shin, along)
        toe = place + along * p.foot + np.array([0.0, 0.0, 0.035])
        toe = ankle + p.foot * _unit(toe - ankle)
        for joint, value in (("hip", hip), ("knee", knee), ("ankle", ankle), ("toe", toe)):
            joints[:, INDEX[f"{name}_{joint}"]] = value


def _feet(posture: Floats) -> dict[str, tuple[Floats, float]]:
    """Place (3,) on the floor and yaw of each foot of (19, 3) joints."""
    out = {}
    for name, sign in (("left", 1.0), ("right", -1.0)):
        ankle, toe = (posture[INDEX[f"{name}_{joint}"]] for joint in ("ankle", "toe"))
        x, y, _ = toe - ankle
        out[name] = (ankle * np.array([1.0, 1.0, 0.0]), float(np.arctan2(y, x)) - sign * TOES_OUT)
    return out


def _walk(
    homes: dict[str, Floats],
    heading: Floats,
    rate: float,
    start: dict[str, tuple[Floats, float]] | None,
) -> dict[str, tuple[Floats, Floats]]:
    """Place (k, 3) and yaw (k,) of each foot; one swings at a time, to where it will belong."""
    k = len(heading)
    swing = max(2, round(SWING * rate))
    place = {s: np.repeat(homes[s][:1], k, axis=0) for s in homes}
    yaw = {s: np.full(k, heading[0]) for s in homes}
    for name, (ankle, turned) in (start or {}).items():
        place[name][:] = ankle
        yaw[name][:] = heading[0] + (turned - heading[0] + np.pi) % (2.0 * np.pi) - np.pi
    i = 0
    while i < k - 1:
        soon = min(i + swing // 2, k - 1)  # a walker steps before the foot is left behind
        stray = {
            s: np.linalg.norm(homes[s][soon] - place[s][i]) / STRAY
            + abs(heading[soon] - yaw[s][i]) / TURN
            for s in homes
        }
        foot = max(stray, key=lambda s: stray[s])
        if stray[foot] < 1.0:
            i += 1
            continue
        end = min(i + swing, k - 1)
        landing = min(end + (2 * swing) // 3, k - 1)
        x = np.arange(i, end + 1)
        w = ((x - i) / max(end - i, 1))[:, None]
        ease = w * w * (3.0 - 2.0 * w)
        start = place[foot][i].copy()
        path = start + ease * (homes[foot][landing] - start)
        path[:, 2] = LIFT * np.sin(np.pi * w[:, 0])
        place[foot][i : end + 1] = path
        place[foot][end:] = homes[foot][landing]
        turn = heading[landing] - yaw[foot][i]
        yaw[foot][i : end + 1] = yaw[foot][i] + ease[:, 0] * turn
        yaw[foot][end:] = heading[landing]
        i = end
    return {s: (place[s], yaw[s]) for s in homes}


def _smoothed(angle: Floats, rate: float) -> Floats:
    width = max(3, round(0.3 * rate)) | 1
    kernel = np.hanning(width + 2)[1:-1]
    padded = np.pad(angle, width // 2, mode="edge")
    return np.asarray(np.convolve(padded, kernel / kernel.sum(), mode="valid"))


def _unit(v: Floats) -> Floats:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9))
