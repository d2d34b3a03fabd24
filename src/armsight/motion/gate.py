"""The law between what is wanted and what is commanded: no part closes in faster than allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import RgbdCameraInfo
from armsight.motion.arm_model import ArmState
from armsight.motion.guard_config import ContactZone, GuardConfig
from armsight.motion.guard_kernels import Law, project, protective
from armsight.motion.nearest import Hazards, MovingBody, View
from armsight.robots.kernels import chain_poses, jacobian
from armsight.robots.robot import Robot

ROWS = 12
"""Most constraints that a motion is projected on."""


@dataclass(frozen=True)
class Passage:
    """What the gate says of one motion.

    Attributes:
        share: of the motion that may be commanded, 0 or more (may exceed 1).
        now: the view at the present pose; ahead: at the pose where the command begins to act.
    """

    share: float
    now: View
    ahead: View

    @property
    def distance(self) -> float:
        """Least distance of any part to any hazard, at the present pose [m]."""
        return self.now.least


class Gate:
    """Applies separation to motions of one robot.

    Every motion is judged twice: at the present pose with the whole of T_r, as the standard says,
    and at the pose where the command begins to act, so that motion already under way is counted
    exactly and not by the new command's speed. The stricter answer holds.
    """

    def __init__(self, robot: Robot, config: GuardConfig, brake: JointVector) -> None:
        self.body = MovingBody(robot, brake)
        self._robot = robot
        self._config = config
        self._tool = self.body.link == robot.n
        self._law = self._make_law(0.2, 0.2, 0.0)
        self._law_ahead = self._law

    def set_reaction(self, T_r: float, hazard_radius: float) -> None:
        """Use a reaction time [s] from now on."""
        # Between two commands the arm does what it was told: a tick late is not unusual.
        between = 2.0 * self._config.period
        self._law = self._make_law(T_r, T_r, hazard_radius)
        self._law_ahead = self._make_law(T_r, between, hazard_radius)

    @property
    def law(self) -> Law:
        """Numbers of the law at the present pose."""
        return self._law

    def judge(
        self, now: JointVector, ahead: ArmState, motion: JointVector, hazards: Hazards
    ) -> Passage:
        """Share of a motion (n,) [rad/s] that is allowed."""
        first = self._view(now, motion, hazards, self._law)
        second = self._view(ahead.position, motion, hazards, self._law_ahead)
        return Passage(min(first.allowed, second.allowed), first, second)

    def at_rest(self, q: JointVector, hazards: Hazards) -> Passage:
        """How far hazards are from the body at (n,) [rad]; nothing moves, so nothing is limited."""
        view = self.body.view(q, np.zeros(len(q)), hazards, self._law)
        return Passage(np.inf, view, view)

    def protective_distance(self, view: View, state: ArmState, hazards: Hazards) -> float:
        """S_p of the part nearest to a hazard at the arm's present velocity [m]; 0 without one."""
        sphere = view.closest
        if view.nearest[sphere] < 0:
            return 0.0
        velocity = self.body.motion(state.position, state.velocity)[1][sphere]
        if float(np.linalg.norm(velocity)) < 1e-3:
            velocity = np.zeros(3)
        towards = hazards.blocks.points[view.nearest[sphere]] - view.center[sphere]
        closing = float(velocity @ towards) / max(float(np.linalg.norm(towards)), 1e-9)
        moving = int(self.body.link[sphere])
        stopping = np.abs(state.velocity[:moving]) / self.body.brake[:moving]
        return float(
            protective(
                float(view.distance[sphere]), closing, float(stopping.max(initial=0.0)), self._law
            )
        )

    def conform(self, wanted: JointVector, q: JointVector, hazards: Hazards) -> JointVector:
        """The motion nearest to a wanted one that closes in on no limiting hazard too fast.

        Only the most limiting hazard of each part is projected on; :meth:`judge` has the last word.
        """
        view = self._view(q, wanted, hazards, self._law)
        tight = np.flatnonzero(view.share < 1.0)
        if len(tight) == 0:
            return wanted
        tight = tight[np.argsort(view.share[tight], kind="stable")][:ROWS]
        robot = self._robot
        poses = chain_poses(np.ascontiguousarray(q, float), robot.T_link_joint, robot.axis)
        rows, bounds = [], []
        for i in tight:
            hazard = hazards.blocks.points[view.limiting[i]].astype(float)
            away = hazard - view.center[i]
            unit = away / max(float(np.linalg.norm(away)), 1e-9)
            closing = float(view.velocity[i] @ unit)
            if closing <= 0.0:
                continue
            J = jacobian(poses, robot.axis, int(self.body.link[i]), view.center[i].copy())[:3]
            rows.append(unit @ J)
            bounds.append(float(view.share[i]) * closing)
        if not rows:
            return wanted
        return np.asarray(project(np.asarray(wanted, float), np.array(rows), np.array(bounds), 50))

    def away(self, passage: Passage, q: JointVector, hazards: Hazards, speed: float) -> JointVector:
        """(n,) joint velocity that moves the nearest part away from its hazard at a speed [m/s]."""
        view = passage.now
        sphere = view.closest
        hazard = hazards.blocks.points[view.nearest[sphere]].astype(float)
        inverted = view.center[sphere] - hazard
        inverted /= max(float(np.linalg.norm(inverted)), 1e-9)
        robot = self._robot
        poses = chain_poses(np.ascontiguousarray(q, float), robot.T_link_joint, robot.axis)
        J = jacobian(poses, robot.axis, int(self.body.link[sphere]), view.center[sphere].copy())
        J = J[:3]
        damped = J @ J.T + 0.01 * np.eye(3)
        return np.asarray(J.T @ np.linalg.solve(damped, speed * inverted))

    def _view(self, q: JointVector, motion: JointVector, hazards: Hazards, law: Law) -> View:
        if not self._config.zones:
            return self.body.view(q, motion, hazards, law)
        return self._view_in_zones(q, motion, hazards, law)

    def _view_in_zones(
        self, q: JointVector, motion: JointVector, hazards: Hazards, law: Law
    ) -> View:
        """Tool inside a declared zone: hazards inside it do not count, the zone's speed does."""
        view = self.body.view(q, motion, hazards, law)
        inside = {
            zone: self._tool
            & (np.linalg.norm(view.center - np.asarray(zone.center), axis=1) <= zone.radius)
            for zone in self._config.zones
        }
        share, distance = view.share.copy(), view.distance.copy()
        limiting, nearest = view.limiting.copy(), view.nearest.copy()
        for zone, parts in inside.items():
            if not parts.any():
                continue
            rest = self.body.view(q, motion, _outside(hazards, zone), law, parts)
            speed = np.linalg.norm(view.velocity[parts], axis=1)
            with np.errstate(divide="ignore"):
                share[parts] = np.minimum(rest.share[parts], zone.speed / speed)
            distance[parts] = rest.distance[parts]
            limiting[parts], nearest[parts] = -1, -1
        return View(view.center, view.velocity, view.stopping, distance, nearest, share, limiting)

    def _make_law(self, T_person: float, T_arm: float, hazard_radius: float) -> Law:
        s = self._config.separation
        return Law(
            s.walking, s.reaching, s.close, s.K, T_person, T_arm, hazard_radius,
            self._config.retreat_speed,
        )  # fmt: skip


def declared_reaction(cameras: Sequence[RgbdCameraInfo], config: GuardConfig) -> float:
    """T_r as declared [s]: picture, wait for the next, computing, one tick, the drives' delay."""
    image = max((c.latency + 1.0 / c.rate for c in cameras), default=0.0)
    return image + config.compute_latency + config.period + config.start_delay


def _outside(hazards: Hazards, zone: ContactZone) -> Hazards:
    points = hazards.blocks.points
    far = np.linalg.norm(points - np.asarray(zone.center, np.float32), axis=1) > zone.radius
    return Hazards.at(points[far], hazards.radius)
