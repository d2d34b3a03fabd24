"""What can be wrong with time, joints and pictures, and how hard the arm then stops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import JointState, RgbdCameraInfo
from armsight.mapping.health import silent_after
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import commanded_arm
from armsight.motion.dead_reckoning import DeadReckoning
from armsight.motion.guard_config import GuardConfig
from armsight.motion.obedience import Obedience
from armsight.robots.robot import Robot

OUTSIDE = 0.02
"""Joint positions may exceed their limits by this much before they are absurd [rad]."""
SILENT = 0.06
"""A map that has said nothing for so long is late itself [s]: one comes without pictures, too."""


class Severity(IntEnum):
    """How the arm answers a fault."""

    NONE = 0
    SLOW = 1  # come to rest along the proven path
    BRAKE = 2  # stop as hard as the drives can: the arm's own state or time cannot be trusted


@dataclass(frozen=True)
class Verdict:
    """What is wrong now.

    Attributes:
        severity: how to answer; reason: in words, empty when all is well.
        joints: the reading that may be used, or None.
        snapshot: the snapshot that may be used, or None.
        age: of the stalest picture in it that counts, a living camera's [s]; inf without one. What
            only a dead camera saw is unseen space in the snapshot.
        jumped: time made a jump: forget what was measured before.
    """

    severity: Severity
    reason: str
    joints: JointState | None
    snapshot: WorkspaceSnapshot | None
    age: float
    jumped: bool = False


class FaultWatch:
    """Judges what the guard is given, tick by tick; keeps the last good snapshot.

    Args:
        robot: for the limits; cameras: for latency and rate; config: for the thresholds.
    """

    def __init__(
        self, robot: Robot, cameras: Sequence[RgbdCameraInfo], config: GuardConfig
    ) -> None:
        self._robot = robot
        self._config = config
        self._limit = {
            c.name: silent_after(c, config.stale_after, config.compute_latency) for c in cameras
        }
        arms = [commanded_arm(robot, config, share) for share in (1.0, 0.5, 0.0)]
        reckoning = DeadReckoning(commanded_arm(robot, config), robot.joint_names)
        self._obedience = Obedience(arms, robot.joint_names, reckoning)
        self._now = -math.inf
        self._snapshot: WorkspaceSnapshot | None = None
        self._heard: tuple[WorkspaceSnapshot | None, float] = (None, -math.inf)
        self._well_since = -math.inf
        self._last: Verdict | None = None
        self._cause = ""

    def sent(self, now: float, velocity: JointVector, brake: bool) -> None:
        """A command (or a stop) was sent at ``now`` [s]: the arm should follow it."""
        self._obedience.sent(now, velocity, brake)

    def check(
        self, now: float, joints: JointState | None, snapshot: WorkspaceSnapshot | None
    ) -> Verdict:
        """Judge one tick's input. After a fault all must be well for ``recovery`` first."""
        if not math.isfinite(now):
            return Verdict(Severity.BRAKE, "the clock says no number", None, None, math.inf, True)
        jumped, time_fault = self._time(now)
        if jumped:
            self._snapshot = None
        if time_fault[0] != Severity.NONE:
            self._obedience.forget()
            self._cause = f" (since {time_fault[1]})"
        good_joints, joint_fault = self._judge_joints(now, joints)
        good_snapshot, snapshot_fault = self._judge_snapshot(now, snapshot)
        age = math.inf if good_snapshot is None else _age(good_snapshot, now)
        severity, reason = max(
            (time_fault, joint_fault, snapshot_fault, self._cameras(now, good_snapshot)),
            key=lambda fault: fault[0],
        )
        if severity != Severity.NONE:
            if reason != time_fault[1]:  # time that was lost has made it old, or of the future
                reason += self._cause
            self._well_since = math.inf
            self._last = Verdict(severity, reason, good_joints, good_snapshot, age, jumped)
            return self._last
        if self._well_since > now:
            self._well_since = now
        if self._last is not None:
            if now - self._well_since < self._config.recovery:
                reason = f"recovering: {self._last.reason}"
                return Verdict(Severity.SLOW, reason, good_joints, good_snapshot, age)
            self._last, self._cause = None, ""
        return Verdict(Severity.NONE, "", good_joints, good_snapshot, age)

    def _time(self, now: float) -> tuple[bool, tuple[Severity, str]]:
        before, self._now = self._now, now
        step = now - before
        if not math.isfinite(before):
            return False, (Severity.NONE, "")
        if step < 0.0:
            return True, (Severity.BRAKE, f"the clock jumped back by {-step:.3f} s")
        if step > self._config.clock_jump:
            return True, (Severity.BRAKE, f"the clock jumped ahead by {step:.3f} s")
        if step > self._config.late:
            return False, (Severity.SLOW, f"the guard was {step * 1e3:.0f} ms late")
        return False, (Severity.NONE, "")

    def _judge_joints(
        self, now: float, joints: JointState | None
    ) -> tuple[JointState | None, tuple[Severity, str]]:
        brake = Severity.BRAKE
        if joints is None:
            return None, (brake, "no joint state has come yet; is the arm connected?")
        limits, n = self._robot.limits, self._robot.n
        q, v = np.asarray(joints.position), np.asarray(joints.velocity)
        if q.shape != (n,) or v.shape != (n,):
            return None, (brake, f"joint state has {q.shape} values; {self._robot.name} has {n}")
        if not (np.isfinite(q).all() and np.isfinite(v).all() and math.isfinite(joints.stamp)):
            return None, (brake, "joint state is not finite; check the arm's encoders")
        names = self._robot.joint_names
        outside = np.maximum(limits.lower - q, q - limits.upper)
        if outside.max() > OUTSIDE:
            j = int(np.argmax(outside))
            return None, (
                brake,
                f"{names[j]} at {q[j]:.3f} rad is outside its limits "
                f"{limits.lower[j]:.3f}..{limits.upper[j]:.3f}; move it back by hand",
            )
        fast = np.abs(v) / limits.velocity
        if fast.max() > 1.5:
            j = int(np.argmax(fast))
            return None, (brake, f"{names[j]} says {v[j]:.2f} rad/s, which it cannot")
        if joints.stamp > now + self._config.future:
            return None, (
                brake,
                f"joint state from {joints.stamp - now:.3f} s in the future; check the clocks",
            )
        age = now - joints.stamp
        if age > self._config.joints_stale:
            return None, (brake, f"joint state is {age * 1e3:.0f} ms old")
        disobeys = self._obedience.fault(now, joints)
        return joints, (brake if disobeys else Severity.NONE, disobeys)

    def _judge_snapshot(
        self, now: float, snapshot: WorkspaceSnapshot | None
    ) -> tuple[WorkspaceSnapshot | None, tuple[Severity, str]]:
        slow = Severity.SLOW
        known = self._snapshot
        if snapshot is not self._heard[0]:
            self._heard = snapshot, now
        if snapshot is None:
            return known, (slow, "no map yet")
        if known is not None and snapshot.sequence < known.sequence:
            return known, (
                slow,
                f"map {snapshot.sequence} came after map {known.sequence}: refused as old",
            )
        if snapshot.stamp > now + self._config.future:
            return known, (
                slow,
                f"map from {snapshot.stamp - now:.3f} s in the future; check the cameras' clocks",
            )
        self._snapshot = snapshot
        return snapshot, (Severity.NONE, "")

    def _cameras(self, now: float, snapshot: WorkspaceSnapshot | None) -> tuple[Severity, str]:
        slow = Severity.SLOW
        if snapshot is None:
            return slow, "no map yet"
        seen = {status.name: status for status in snapshot.cameras}
        excluded = [s for s in snapshot.cameras if s.excluded]
        if excluded and len(excluded) == len(snapshot.cameras):
            first = excluded[0]
            return slow, f"no camera can be trusted: {first.name} {first.reason}"
        for name, limit in self._limit.items():
            status = seen.get(name)
            if status is not None and status.excluded:
                continue  # what only it saw is unseen space in the map
            if status is None or not math.isfinite(status.stamp):
                if status is not None and status.dropped:
                    return slow, f"camera {name} has sent nothing usable ({status.reason})"
                return slow, f"camera {name} has sent nothing yet"
            age = now - status.stamp
            if age > limit:
                silent = now - self._heard[1]
                why = f" ({status.reason})" if status.reason else ""
                if silent > SILENT:
                    why = f" (the map has been silent for {silent * 1e3:.0f} ms)"
                return slow, f"camera {name} is {age * 1e3:.0f} ms old{why}"
            if not status.alive:
                return slow, f"camera {name} is not trusted ({status.reason or 'no reason given'})"
        return Severity.NONE, ""


def _age(snapshot: WorkspaceSnapshot, now: float) -> float:
    """Of what a snapshot rests on [s]; a map without cameras rests on no picture."""
    return now - _oldest(snapshot) if snapshot.cameras else 0.0


def _oldest(snapshot: WorkspaceSnapshot) -> float:
    """Exposure of the stalest picture of a living camera [s]; -inf without one."""
    return min((c.stamp for c in snapshot.cameras if c.alive), default=-math.inf)
