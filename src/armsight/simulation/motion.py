"""A person's motion as samples: every script and clip becomes one of these before the start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.simulation.skeleton import INDEX, MIRRORED

RATE = 100.0
"""Samples a second [Hz]."""


@dataclass(frozen=True)
class Motion:
    """Joint positions over time, repeated for ever.

    Attributes:
        times: (k,) ascending from 0 [s].
        joints: (k, 19, 3) positions in world [m], order of :data:`skeleton.JOINTS`.
        left: (k, 3) the person's left, unit and horizontal.
        start: when the motion begins; before, the first pose is held [s].
        there_and_back: play backwards after the end, for motions whose end is not their start.
    """

    times: Floats
    joints: Floats
    left: Floats
    start: float = 0.0
    there_and_back: bool = False

    @property
    def duration(self) -> float:
        """Seconds of one round."""
        return float(self.times[-1]) * (2.0 if self.there_and_back else 1.0)

    def place(self, now: float) -> tuple[int, float]:
        """Index of the sample before time ``now`` [s] and the fraction of the way to the next."""
        t = max(now - self.start, 0.0)
        if self.duration <= 0.0:
            return 0, 0.0
        t %= self.duration
        if t > self.times[-1]:
            t = self.duration - t
        i = int(np.searchsorted(self.times, t, side="right")) - 1
        i = min(max(i, 0), len(self.times) - 2)
        span = self.times[i + 1] - self.times[i]
        return i, float((t - self.times[i]) / span) if span > 0 else 0.0


def finish(
    joints: Floats,
    T_world: Pose,
    *,
    scale: float = 1.0,
    hand_speed: float = np.inf,
    mirror: bool = False,
    start: float = 0.0,
    there_and_back: bool = False,
    rate: float = RATE,
) -> Motion:
    """Sampled joints in the motion's own frame, made a motion in the cell.

    Args:
        joints: (k, 19, 3) at ``rate``, in the motion's frame [m].
        T_world: the motion's frame in world; turned about the vertical only.
        scale: of time; 2 is twice as fast.
        hand_speed: where a hand would be faster, time passes more slowly [m/s].
        mirror: exchange left and right (the y axis of the motion's frame).
        start: when it begins [s].
        there_and_back: see :class:`Motion`.
        rate: of ``joints`` [Hz].
    """
    if mirror:
        joints = joints[:, MIRRORED] * np.array([1.0, -1.0, 1.0])
    joints = joints @ T_world[:3, :3].T + T_world[:3, 3]
    step = np.full(len(joints) - 1, 1.0 / (rate * scale))
    fastest = np.maximum(*(hand_speeds(joints, step, side) for side in ("left", "right")))
    # A frame's slowing spreads to its neighbours, so that time does not pass in jerks.
    slow = np.maximum(fastest / hand_speed, 1.0)
    slow = np.maximum(_widened(slow), slow)
    times = np.concatenate([[0.0], np.cumsum(step * slow)])
    across = joints[:, INDEX["left_shoulder"]] - joints[:, INDEX["right_shoulder"]]
    across[:, 2] = 0.0
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return Motion(times, np.ascontiguousarray(joints), across, start, there_and_back)


def hand_speeds(joints: Floats, step: Floats, side: str) -> Floats:
    """(k - 1,) speed of a hand between samples [m/s]."""
    moved = np.diff(joints[:, INDEX[f"{side}_hand"]], axis=0)
    return np.asarray(np.linalg.norm(moved, axis=1) / step)


def smooth_step(x: Floats | float) -> Floats:
    """Minimum-jerk transition from 0 to 1 for x from 0 to 1, held outside (Flash, Hogan 1985)."""
    s = np.clip(x, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)))


def _widened(slow: Floats, frames: int = 10) -> Floats:
    kernel = np.hanning(2 * frames + 3)[1:-1]
    padded = np.pad(slow, frames, mode="edge")
    return np.asarray(np.convolve(padded, kernel / kernel.sum(), mode="valid"))
