"""The law between what is wanted and what is commanded: no part closes in faster than allowed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Ints, JointVector, Mask, Poses
from armsight.devices.data import RgbdCameraInfo, Wrench
from armsight.motion.arm_model import ArmState
from armsight.motion.contact_speed import ContactSpeed, GentleSpeed
from armsight.motion.drive_kernels import braked
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hazard_kernels import in_reach
from armsight.motion.hung_cable import DraggedCable
from armsight.motion.nearest import Hazards, MovingBody, SeparationView
from armsight.motion.separation_kernels import Law, protective
from armsight.motion.slide_kernels import limiting_rows, project
from armsight.robots.kernels import chain_poses, jacobian
from armsight.robots.robot import Robot

ROWS = 12
"""Most constraints that a motion is projected on."""
SLIDES = 3
"""How often a motion is projected anew on what limits it then."""
RECEDE = 0.002
"""Along something a motion draws away from it by this much [m/s]: rounding would close in."""
TICKS = 2
"""Between two commands the arm does what it was told: a tick late is not unusual."""
PIECES = 4
"""Looks at a stop in its course."""


class SeparationMonitor:
    """Applies separation to motions of one robot, in two ways.

    :meth:`judge` says how much of a motion is allowed, by the closed form and with the longest
    reaction time: what is commanded keeps to it. :meth:`stops_in_time` has the last word: whether
    the hard stop after a command ends before anybody could be there, looked at in its course and
    with the present age of the pictures. Where it does not, the arm brakes at once, as hard as it
    can: :mod:`armsight.motion.guard` says why that is in time.

    Attributes:
        body: the parts that are protected.
        contact: the speed that a contact permit leaves to the parts that may touch, or None.
    """

    def __init__(self, robot: Robot, config: GuardConfig, brake: JointVector) -> None:
        self.body = MovingBody(robot, brake)
        self._cable = DraggedCable.of(robot)
        self._robot = robot
        self._config = config
        self.contact: ContactSpeed | GentleSpeed | None = None
        self._law = self._make_law(0.2, 0.0)

    def set_reaction(self, T_r: float, hazard_radius: float) -> None:
        """Use a reaction time [s] from now on."""
        self._law = self._make_law(T_r, hazard_radius)

    def feel(self, readings: Sequence[Wrench]) -> None:
        """How far a tool in a soft mount is bent now, by the newest reading of the force sensor.

        One that falls silent, or says what is no number, leaves it as it was.
        """
        tool = self._robot.tool
        if tool is None or tool.mount is None or not readings:
            return
        wrench = np.concatenate([readings[-1].force, readings[-1].torque])
        if not np.isfinite(wrench).all():
            return
        load = tool.mount.load(tool.T_flange_tcp, wrench)
        self.body.feel(load)
        if self._cable is not None:
            self._cable.feel(load)

    @property
    def law(self) -> Law:
        """Numbers of the law in use."""
        return self._law

    def judge(self, q: JointVector, motion: JointVector, hazards: Hazards) -> SeparationView:
        """What is allowed of a motion (n,) [rad/s] that begins to act at (n,) [rad]."""
        return self._view(q, motion, hazards, self._law)

    def at_rest(self, q: JointVector, hazards: Hazards) -> SeparationView:
        """How far hazards are from the body at (n,) [rad]; nothing moves, so nothing is limited."""
        return self.body.view(q, np.zeros(len(q)), hazards, self._law)

    def stops_in_time(
        self, state: ArmState, T_r: float, hazards: Hazards, leaves: bool = False
    ) -> bool:
        """Whether an arm that brakes from a state on stands before anybody could be there.

        Args:
            state: where it would be, and how fast, when the brakes take hold.
            T_r: from the exposure of the oldest picture until then [s].
            hazards: as pictured.
            leaves: the arm backs out of what it touches, along with that where it comes: how fast
                the two would meet if it stopped is no reason to stop it.
        """
        center, velocity = self.body.motion(state.position, state.velocity)
        fastest = self.body.fastest(state.position, state.velocity, velocity)
        if fastest <= self._config.retreat_speed:
            return True  # it counts as standing
        brake = self.body.brake
        rates = np.ascontiguousarray(state.velocity)
        times = np.linspace(0.0, float((np.abs(rates) / brake).max()), PIECES + 1)
        stop, _ = braked(state.position, rates, brake, times)
        still = np.zeros(len(brake))
        places = np.stack([center, *(self.body.motion(q, still)[0] for q in stop[1:])])
        until = self.body.stopping(state.velocity)
        law = self._law._replace(T_person=T_r)

        def free(those: Hazards, parts: Mask) -> bool:
            at, radius = np.ascontiguousarray(places[:, parts]), self.body.shell[parts]
            return in_reach(those.blocks, at, radius, times, until[parts], law) < 0

        everything = np.ones(len(self.body.radius), bool)
        if not free(hazards, everything):
            return False
        if self._cable is not None:
            stands = (float(until.max()), times, hazards, law)
            if not self._cable.stops_in_time(np.asarray(stop, np.float64), state.velocity, *stands):
                return False
        if isinstance(self.contact, GentleSpeed) and not leaves:
            return free(self.contact.touchable, ~self._stays_gentle(self.contact, state))
        return True

    def _stays_gentle(self, contact: GentleSpeed, state: ArmState) -> Mask:
        """(m,) which spheres keep a permit's speed until they stand, if the arm brakes from here.

        Joints that cancel each other do not stand at the same time, and without the other one the
        tool is faster than before it braked. Between two joints' ends all joints slow evenly, and
        no speed is greater than at both of them, but for the bend of the way.
        """
        rates = np.ascontiguousarray(state.velocity)
        ends = np.unique(np.abs(rates) / self.body.brake)[:-1]  # at the last one it stands
        kept = contact.gentle(self.body, state.position, rates)
        for q, slower in zip(*braked(state.position, rates, self.body.brake, ends)):
            kept &= contact.gentle(self.body, q, slower)
        return kept

    def protective_distance(self, view: SeparationView, state: ArmState, hazards: Hazards) -> float:
        """S_p of the part nearest to a hazard at the arm's present velocity [m]; 0 without one."""
        sphere = view.closest
        if view.nearest[sphere] < 0:
            return 0.0
        velocity = self.body.motion(state.position, state.velocity)[1][sphere]
        if float(np.linalg.norm(velocity)) < 1e-3:
            velocity = np.zeros(3)
        towards = hazards.blocks.points[view.nearest[sphere]] - view.center[sphere]
        closing = float(velocity @ towards) / max(float(np.linalg.norm(towards)), 1e-9)
        stopping = float(self.body.stopping(state.velocity)[sphere])
        # The distance is the present one: the way until a command acts comes on top.
        law = self._law._replace(T_arm=self._law.T_arm + self._config.start_delay)
        return float(protective(closing, stopping, law))

    def conform(self, wanted: JointVector, q: JointVector, hazards: Hazards) -> JointVector:
        """The motion nearest to a wanted one that closes in on no limiting hazard too fast.

        Only the most limiting hazard of each part is projected on; :meth:`judge` has the last word.
        """
        view = self._view(q, wanted, hazards, self._law)
        tight, poses = self._tight(view, q)
        rows, bounds = [], []
        for i in tight:
            hazard = hazards.blocks.points[view.limiting[i]].astype(float)
            away = hazard - view.center[i]
            unit = away / max(float(np.linalg.norm(away)), 1e-9)
            closing = float(view.velocity[i] @ unit)
            if closing <= 0.0:
                continue
            axis, link = self._robot.axis, int(self.body.link[i])
            rows.append(unit @ jacobian(poses, axis, link, view.center[i].copy())[:3])
            bounds.append(float(view.share[i]) * closing)
        if not rows:
            return wanted
        return np.asarray(project(np.asarray(wanted, float), np.array(rows), np.array(bounds), 50))

    def slide(
        self, wanted: JointVector, q: JointVector, hazards: Hazards, view: SeparationView
    ) -> tuple[JointVector, SeparationView]:
        """The motion along what is near that comes nearest to a wanted one, and its view.

        As :meth:`conform`, again and again: a motion that no longer closes in on the nearest voxel
        of a hand closes in on the next one. Each time what limits it then is projected on as well.

        Args:
            wanted: (n,) [rad/s].
            q: (n,) where it begins [rad].
            hazards: to look at.
            view: what :meth:`judge` says of the wanted motion.
        """
        wanted = np.asarray(wanted, float)
        rows, bounds = np.empty((0, len(wanted))), np.empty(0)
        best, best_view, most = wanted, view, _progress(wanted, wanted, view)
        for _ in range(SLIDES):
            tight, poses = self._tight(view, q)
            more, limits = limiting_rows(
                poses, self._robot.axis, self.body.link, view.center, view.velocity, view.share,
                hazards.blocks.points[view.limiting[tight]].astype(float), tight,
            )  # fmt: skip
            if len(more) == 0:
                break
            rows, bounds = np.concatenate([rows, more]), np.concatenate([bounds, limits - RECEDE])
            motion = np.asarray(project(wanted, rows, bounds, 50))
            view = self._view(q, motion, hazards, self._law)
            progress = _progress(motion, wanted, view)
            if progress > most:
                best, best_view, most = motion, view, progress
            if view.allowed >= 1.0:
                break
        return best, best_view

    def excess(self, view: SeparationView, hazards: Hazards) -> float:
        """By how much some part closes in faster than allowed, at most [m/s]; 0 if none does."""
        tight = np.flatnonzero((view.share < 1.0) & (view.limiting >= 0))
        if len(tight) == 0:
            return view.cable_excess
        away = hazards.blocks.points[view.limiting[tight]] - view.center[tight]
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        closing = np.einsum("ij,ij->i", view.velocity[tight], away) / length
        return float(np.max(closing * (1.0 - view.share[tight]), initial=view.cable_excess))

    def _tight(self, view: SeparationView, q: JointVector) -> tuple[Ints, Poses]:
        """The spheres that limit a motion, the most limiting first, and the links' poses."""
        tight = np.flatnonzero((view.share < 1.0) & (view.limiting >= 0))
        tight = tight[np.argsort(view.share[tight], kind="stable")][:ROWS]
        robot = self._robot
        q = np.ascontiguousarray(q, float)
        return tight, np.asarray(chain_poses(q, robot.T_link_joint, robot.axis))

    def away(
        self, view: SeparationView, q: JointVector, hazards: Hazards, speed: float
    ) -> JointVector:
        """(n,) joint velocity that moves the nearest part away from its hazard at a speed [m/s]."""
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

    def _view(
        self, q: JointVector, motion: JointVector, hazards: Hazards, law: Law
    ) -> SeparationView:
        view = self.body.view(q, motion, hazards, law)
        if self.contact is not None:
            view = self.contact.limit(view, self.body, q, motion, law)
        if self._cable is None:
            return view
        stopping = float(view.stopping.max())
        return self._cable.limit(view, q, motion, stopping, hazards, law)

    def _make_law(self, T_r: float, hazard_radius: float) -> Law:
        s, config = self._config.separation, self._config
        between = TICKS * config.period
        return Law(s.person_speed, s.K, T_r, between, hazard_radius, config.retreat_speed)


def _progress(motion: JointVector, wanted: JointVector, view: SeparationView) -> float:
    """How much of what is wanted remains of a motion after separation has slowed it."""
    return float(motion @ wanted) * min(view.allowed, 1.0)


def declared_reaction(cameras: Sequence[RgbdCameraInfo], config: GuardConfig) -> float:
    """T_r as declared [s]: picture, wait for the next, computing, ticks, the drives' delay."""
    image = max((c.latency + 1.0 / c.rate for c in cameras), default=0.0)
    return image + config.compute_latency + after_decision(config)


def after_decision(config: GuardConfig) -> float:
    """From a decision until the next one, which may come a tick late, has the arm brake [s]."""
    return TICKS * config.period + config.start_delay
