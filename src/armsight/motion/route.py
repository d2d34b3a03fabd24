"""Driving along a trajectory by its own phase time, faster or slower, and back into line."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointPath, JointVector
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.collision import CollisionModel
from armsight.motion.escape import leaves
from armsight.motion.trajectory import Trajectory

SAMPLE = 0.04
"""Greatest joint motion between two samples of a trajectory that are proven together [rad]."""
BEND = 0.003
"""The motion is nowhere farther from the line between two samples [rad]."""
LOOK_AHEAD = 0.02
"""The motion's direction is taken over this phase time, so that a start at rest has one [s]."""


@dataclass(frozen=True)
class RouteSetpoint:
    """What a route asks for at one instant.

    Attributes:
        velocity: (n,) of the motion at full speed [rad/s].
        acceleration: (n,) of it at full speed [rad/s^2].
        correction: (n,) rad still to go to be on the route.
    """

    velocity: JointVector
    acceleration: JointVector
    correction: JointVector


class Route:
    """A trajectory being driven.

    Attributes:
        trajectory: where to, and how fast at most.
        phase: where on it the arm is meant to be [s].
        blocked_at: phase of the first place that is not proven free [s]; inf when all is.
        request: sequence of the plan request that it answers; -1 for a reflex.

    Args:
        escape: until this phase it leaves something that the arm touches at its start [s].
    """

    def __init__(self, trajectory: Trajectory, request: int = -1, escape: float = 0.0) -> None:
        self.trajectory = trajectory
        self.request = request
        self.phase = 0.0
        self.blocked_at = math.inf
        self._times = _sample_times(trajectory)
        self._samples = trajectory.sample(self._times)
        self._escape = escape
        self._apart = False  # whether the body is proven not to touch itself on the way

    @property
    def done(self) -> bool:
        """Whether the phase has reached the end."""
        return self.phase >= self.trajectory.duration

    @property
    def remaining(self) -> JointPath:
        """(k, n) places still to be driven, the present one first [rad]."""
        ahead = self._samples[self._times > self.phase]
        return np.vstack([self.trajectory.position(self.phase)[None], ahead])

    def advance(self, seconds: float) -> None:
        """Move the phase on [s of phase time]."""
        self.phase = min(max(self.phase + seconds, 0.0), self.trajectory.duration)

    def rejoin(self, q: JointVector) -> None:
        """Set the phase to the nearest place close to the present one (after a hard stop)."""
        near = np.clip(self.phase + np.linspace(-0.3, 0.3, 61), 0.0, self.trajectory.duration)
        gap = np.linalg.norm(self.trajectory.sample(near) - q, axis=1)
        self.phase = float(near[int(np.argmin(gap))])

    def wanted(self, q: JointVector, lead: float = 0.0) -> RouteSetpoint:
        """What to do at (n,) positions [rad]; velocities are those ``lead`` [s] farther on."""
        t = self.trajectory
        velocity = t.velocity(self.phase + lead)
        acceleration = t.acceleration(self.phase + lead)
        if self.phase < LOOK_AHEAD:
            velocity = (t.position(self.phase + LOOK_AHEAD) - t.position(self.phase)) / LOOK_AHEAD
        return RouteSetpoint(velocity, acceleration, t.position(self.phase) - q)

    def prove(self, model: CollisionModel, snapshot: WorkspaceSnapshot, at: JointVector) -> None:
        """Check what lies ahead against a snapshot, for a body that is at ``at`` now."""
        first = max(int(np.searchsorted(self._times, self.phase, side="right")) - 1, 0)
        if self.phase < self._escape:
            free = int(np.searchsorted(self._times, self._escape))
            way_out = np.vstack([at[None], self._samples[first : free + 1]])
            if leaves(model, way_out, snapshot, at):
                first = free
        ahead = self._samples[first:]
        if len(ahead) < 2:
            self.blocked_at = math.inf
            return
        index = model.first_blocked(ahead, snapshot, at, own=not self._apart)
        self._apart = self._apart or index is None
        self.blocked_at = math.inf if index is None else float(self._times[first + index])


def _sample_times(trajectory: Trajectory) -> Floats:
    """Phase times at which to look, close enough together, ends and joints included [s]."""
    count = max(2, math.ceil(trajectory.duration / 0.02) + 1)
    fine = np.linspace(0.0, trajectory.duration, count)
    path = trajectory.sample(fine)
    length, turn = _steps(path)
    keep = [0]
    way, turned = length[0], 0.0
    for k in range(1, count - 1):
        way, turned = way + length[k], turned + turn[k]
        # A line that turns by so much in all on its way is no farther from its chord than a quarter
        # of the two's product (an arc of a circle: an eighth; one corner: up to a quarter).
        if np.abs(path[k + 1] - path[keep[-1]]).max() > SAMPLE or way * turned > 4.0 * BEND:
            keep.append(k)
            way, turned = length[k], 0.0
    keep.append(count - 1)
    return np.asarray(fine[keep])


def _steps(path: JointPath) -> tuple[list[float], list[float]]:
    """Length of each step of a (k, n) path [rad], and by how much it turns where that begins."""
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1)
    moving = np.flatnonzero(length > 1e-9)
    way = step[moving] / length[moving, None]
    turn = np.zeros(len(step))
    turn[moving[1:]] = np.arccos(np.clip((way[1:] * way[:-1]).sum(axis=1), -1.0, 1.0))
    return length.tolist(), turn.tolist()


class SpeedScale:
    """The share of the planned speed in use: falls as fast as it must, rises smoothly.

    Args:
        rise: greatest rate upwards [1/s]; jerk: greatest change of that rate [1/s^2].
    """

    def __init__(self, rise: float, jerk: float) -> None:
        self._rise, self._jerk = rise, jerk
        self.value = 0.0
        self._rate = 0.0

    def reset(self, value: float = 0.0) -> None:
        """Begin anew from a value."""
        self.value = value
        self._rate = 0.0

    def towards(self, target: float, seconds: float, highest_rate: float) -> float:
        """The scale after a time [s]: at ``target`` if that is lower, else risen towards it.

        Args:
            target: wanted scale.
            seconds: since the last call [s].
            highest_rate: what the drives can follow [1/s].
        """
        if target <= self.value:
            self.reset(max(target, 0.0))
            return self.value
        # Ease in by the jerk, ease out so that the rate is back at zero on arrival.
        ease_out = math.sqrt(2.0 * self._jerk * (target - self.value))
        self._rate = min(
            self._rate + self._jerk * seconds, self._rise, ease_out, max(highest_rate, 0.0)
        )
        self.value = min(target, self.value + self._rate * seconds)
        return self.value


def rate_bounds(
    scale: float, velocity: JointVector, acceleration: JointVector, limit: JointVector
) -> tuple[float, float]:
    """Rates of the speed scale [1/s] at which every joint keeps its acceleration limit.

    The joints accelerate by ``q'' s^2 + q' ds/dt`` on a trajectory q driven at scale s.
    """
    own = acceleration * scale * scale
    moving = np.abs(velocity) > 1e-6
    if not moving.any():
        return -math.inf, math.inf
    v, a, b = np.abs(velocity[moving]), own[moving] * np.sign(velocity[moving]), limit[moving]
    return float(((-b - a) / v).max()), float(((b - a) / v).min())
