"""What every velocity passes before it is commanded, whoever asked for it: path, reflex or task.

Four questions, in this order: how much of the motion does separation allow (:meth:`judge`, and
:meth:`conform` for one that may slide along); is the stop after it proven free
(:meth:`stop_is_free`); does every joint stay within its limits (:meth:`within_limits`,
:meth:`followed`); would a stop after it end before anybody could be there (:meth:`stops_in_time`).
:mod:`armsight.motion.guard` says why that is enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armsight.arrays import JointVector
from armsight.devices.data import RgbdCameraInfo
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.arm_model import commanded_arm
from armsight.motion.collision import CollisionModel
from armsight.motion.escape import SLACK, leaves
from armsight.motion.folding import Unfolded, unfolded
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards, SeparationView
from armsight.motion.separation import ReactionTime
from armsight.motion.separation_monitor import (
    TICKS,
    SeparationMonitor,
    after_decision,
    declared_reaction,
)
from armsight.motion.tick import Tick
from armsight.robots.robot import Robot


class VelocityFilter:
    """Limits, separation and the verified stop of one arm, against the newest map.

    Attributes:
        limits: of commanded motions; arm: its delayed drives; monitor: of separation.
        model: collision checks; hazards: of the newest map; reaction: T_r as measured.

    Args:
        robot: the arm with its tool; cameras: whose pictures are waited for.
        config: settings; model: collision checks.
    """

    def __init__(
        self,
        robot: Robot,
        cameras: Sequence[RgbdCameraInfo],
        config: GuardConfig,
        model: CollisionModel,
    ) -> None:
        self.robot, self.config, self.model = robot, config, model
        self.limits = robot.limits.scaled(config.speed, config.acceleration)
        self.arm = commanded_arm(robot, config)
        self.monitor = SeparationMonitor(robot, config, self.arm.brake)
        self.hazards = Hazards.at(np.empty((0, 3)), 0.0)
        self.reaction = ReactionTime(declared_reaction(cameras, config), config.reaction_window)
        self._after_decision = after_decision(config)
        self._snapshot: WorkspaceSnapshot | None = None
        self._proof: tuple[WorkspaceSnapshot | None, JointVector] | None = None

    def see(self, snapshot: WorkspaceSnapshot) -> None:
        """A new map."""
        self._snapshot = snapshot
        self.hazards = Hazards.of(snapshot)

    def forget_times(self) -> None:
        """The clock jumped: what was sent and measured says nothing any more."""
        self.arm.forget()
        self.reaction.clear()

    def measure(self, now: float, age: float, well: bool) -> None:
        """The oldest picture of the map in use has an age [s] at ``now`` [s]; inf without one.

        While something is not ``well`` the arm comes to rest, so that such an age counts now and
        says nothing about how old a picture will be when it goes on.
        """
        T_r = self._after_decision + (age if math.isfinite(age) else 0.0)
        if well:
            self.reaction.add(now, T_r)
        self.monitor.set_reaction(max(self.reaction.value, T_r), self.hazards.radius)

    def judge(self, tick: Tick, motion: JointVector) -> SeparationView:
        """What separation allows of a motion (n,) [rad/s] from where the arm will be."""
        return self.monitor.judge(tick.ahead.position, motion, self.hazards)

    def ease(self, tick: Tick, wanted: JointVector) -> JointVector:
        """A wish (n,) [rad/s] as a contact permit lets it come to what it touches."""
        contact = self.monitor.contact
        if contact is None:
            return wanted
        law = self.monitor.law
        return contact.ease(self.monitor.body, tick.ahead.position, wanted, law)

    def unfold(self, tick: Tick, wanted: JointVector) -> Unfolded:
        """A wish (n,) [rad/s] as the arm itself leaves it."""
        stops = self.arm.stop_path(tick.ahead)[-1]
        return unfolded(self.model, tick.ahead.position, stops, wanted)

    def conform(self, tick: Tick, wanted: JointVector) -> JointVector:
        """The motion nearest to a wanted one that closes in on no limiting hazard too fast."""
        return self.monitor.conform(wanted, tick.ahead.position, self.hazards)

    def slide(
        self, tick: Tick, wanted: JointVector, view: SeparationView
    ) -> tuple[JointVector, SeparationView]:
        """The motion along what limits a wanted one, seen as ``view``; and what is said of it."""
        return self.monitor.slide(wanted, tick.ahead.position, self.hazards, view)

    def excess(self, tick: Tick, motion: JointVector) -> float:
        """By how much a motion (n,) [rad/s] closes in faster than allowed, at most [m/s]."""
        return self.monitor.excess(self.judge(tick, motion), self.hazards)

    def stop_is_free(self, tick: Tick, rubs: float = SLACK) -> bool:
        """Whether the hard stop after this command is proven free: the stop kept in hand.

        Where the arm touches something already, a speck of noise or what has come to it: whether
        the stop touches nothing more, what the last link carries by ``rubs`` [m] at most.
        """
        if tick.snapshot is None:
            return False
        after = self.arm.after(tick.ahead, tick.command, self.config.period)
        stop = self.arm.stop_path(after)
        pose = self._proof_pose(tick)
        return self.model.path_valid(stop, tick.snapshot, pose) or leaves(
            self.model, stop, tick.snapshot, pose, rubs
        )

    def within_limits(self, tick: Tick) -> JointVector:
        """Slow the whole motion so that no joint is too fast or could not stop at its limit."""
        command = tick.command
        limits, q = self.robot.limits, tick.ahead.position
        room = np.where(command > 0.0, limits.upper - q, q - limits.lower)
        room = np.maximum(room - np.abs(tick.ahead.velocity) * self.config.period, 0.0)
        most = np.minimum(self.limits.velocity, np.sqrt(2.0 * self.arm.acceleration * room))
        excess = float((np.abs(command) / np.maximum(most, 1e-6)).max(initial=0.0))
        return command / excess if excess > 1.0 else command

    def followed(self, tick: Tick) -> JointVector:
        """What the drives make of the command: no joint changes its speed sooner than its ramp can.

        Nothing is allowed by this that the command did not do anyway: whatever it says, the drives
        change their speed by no more, braking included, and that is what every proof plays. But
        what is asked for next goes on from what was commanded, and so from what the arm does. Who
        must be slower sooner has to stop (:meth:`.Tick.stop_hard`).

        Where every joint goes as far as it can, the tool goes elsewhere than either motion: beside
        what may be touched it can be faster than both. There the joints go on together, for no
        relative speed between two motions is greater than at the faster of them; unless anybody
        else is so near that the arm has to slow.
        """
        before = self.arm.told
        if before is None:
            before = tick.ahead.velocity
        wanted = tick.command - before
        change = self.arm.acceleration * tick.elapsed
        soonest = np.asarray(before + np.clip(wanted, -change, change))
        share = float((change / np.maximum(np.abs(wanted), 1e-9)).min())
        if share >= 1.0 or self.monitor.contact is None:
            return soonest
        straight = np.asarray(before + share * wanted)
        return straight if self.excess(tick, straight) <= 0.0 else soonest

    def stops_in_time(self, tick: Tick, leaves: bool = False) -> bool:
        """Whether the arm would stand before anybody is there if it brakes after this command.

        ``leaves``: as in :meth:`.SeparationMonitor.stops_in_time`.
        """
        held = TICKS * self.config.period
        after = self.arm.after(tick.ahead, tick.command, held)
        T_r = tick.verdict.age + held + self.config.start_delay
        return self.monitor.stops_in_time(after, T_r, self.hazards, leaves)

    def unseen(self, index: int) -> bool:
        """Whether a hazard, by its place in the blocks, is unseen space."""
        if self._snapshot is None:
            return False
        return bool(self._snapshot.hazard_unknown[self.hazards.blocks.order[index]])

    def who(self, view: SeparationView) -> str:
        """What limits a motion, in words."""
        sphere = int(np.argmin(view.share)) if np.isfinite(view.share).any() else view.closest
        if view.cable < view.share.min() and view.cable_hazard >= 0:
            kind = "unseen space" if self.unseen(view.cable_hazard) else "something"
            x, y, z = self.hazards.blocks.points[view.cable_hazard]
            return f"{kind} near the cable, at ({x:.2f}, {y:.2f}, {z:.2f})"
        index = int(view.limiting[sphere])
        contact = self.monitor.contact
        if index < 0 and contact is not None and view.share[sphere] < 1.0:
            return contact.words(view, self.monitor.body, sphere)
        if index < 0:
            index = int(view.nearest[sphere])
        if index < 0 or self._snapshot is None:
            return "nothing near"
        hazard = self.hazards.blocks.points[index]
        body = self.monitor.body
        away = float(np.linalg.norm(hazard - view.center[sphere])) - float(
            body.shell[sphere] + self.hazards.radius
        )
        link = self.robot.link_names[int(body.link[sphere])]
        kind = "unseen space" if self.unseen(index) else "something"
        for seen in self._snapshot.inside:
            if seen.solid.distance(hazard[None])[0] < 0.0:
                kind = f"something inside of '{seen.solid.name}'"
        x, y, z = hazard
        return f"{kind} {max(away, 0.0):.2f} m from {link}, at ({x:.2f}, {y:.2f}, {z:.2f})"

    def _proof_pose(self, tick: Tick) -> JointVector:
        """Where the body stood when the snapshot was first seen: one set of obstacles for all."""
        if self._proof is None or self._proof[0] is not tick.snapshot:
            self._proof = (tick.snapshot, tick.here.position.copy())
        return self._proof[1]
