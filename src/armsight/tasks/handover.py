"""V's hand-over: fetch the item, wait above a palm that moves, come down, let go, and leave."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armsight.devices.data import JointState
from armsight.motion.data import GuardStatus
from armsight.motion.face import Face
from armsight.motion.intents import Intent, PoseIntent, Rest, VelocityIntent
from armsight.motion.permits import PermitRequest
from armsight.motion.task import Observation
from armsight.robots.kinematics import tcp_pose
from armsight.tasks.fetch import Fetch
from armsight.tasks.servo_task import ServoTask

WAITS, LETS_GO, LEAVES = 0.07, 0.035, 0.20
"""Height of the TCP above the palm [m]: while it waits, when it lets go (an item of 5 cm is then
1 cm above the palm), and when it has left."""
ABOVE, LANDS, SLACK = 0.020, 0.015, 0.018
"""So far beside the palm it may begin to come down, and let go; so far from a height it counts as
there [m]."""
SETTLED = 0.15
"""It comes down when it has been above the palm for so long [s] ..."""
CALM = 0.25
"""... and the palm is slower than this [m/s]."""
LIVELY, FORGETS = 0.5, 1.2
"""A palm that was seen to be faster than this [m/s] is restless until it has been calm: how fast it
was is forgotten within about so long [s]. From 2 m/s, as hands are swung, that takes 2.5 s:
who swings pauses, too."""
BEGINS = 0.3
"""The first looks at a palm say little of its speed: cameras differ by more than it moves [s]."""
OPENS = 0.5
"""What the gripper is given to open [s]."""
JAMMED, OPEN = 2.0, 0.8
"""A gripper that has not opened to this share of its width after this time [s] is jammed: the arm
leaves with the item, rather than wait on somebody's palm."""
STAYS = 1.5
"""What leaving is given [s]."""


class HandoverTask(ServoTask):
    """Brings what the gripper holds to a palm, lets it go there, and leaves.

    Attributes:
        opening: width of the open gripper [m].
        fetch: takes the item into the gripper first; None where that holds it already.
        phase: wait, lower, let go, leave or done; since: when it began [s].
        restless: the palm is faster than is come to, or was lately: no permit is asked for, and the
            arm stands, farther away, until it is calm.
        released: when the gripper was told to open [s]; inf before.
        failed: why nothing was handed over, in words; empty while that is not so.
        unsure: what speaks against that something was, in words; empty where nothing does.
    """

    opening: float = 0.085
    fetch: Fetch | None = None

    def reset(self) -> None:
        """Nothing has been seen; the item is held, or has to be fetched."""
        super().reset()
        if self.fetch is not None:
            self.fetch.reset()
        self.phase, self.since, self.released = "wait", -math.inf, math.inf
        self.failed, self.unsure, self._held = "", "", False
        self._above = math.inf
        self.restless, self._fastest, self._told = False, 0.0, -math.inf
        self._known = math.inf
        self._width = self.opening
        self._height(WAITS)

    def update(self, observation: Observation) -> Intent:
        """See :class:`~armsight.motion.task.Task`."""
        now = observation.now
        if self.phase == "done":
            return Rest(self._ended)
        self._watch(now)
        intent = super().update(observation)
        if self._fetches:
            return self._fetched(observation, now)
        self._go_on(observation, now)
        if self.restless and self.phase == "wait":
            return intent if isinstance(intent, Rest) else Rest(self._waits)
        if self.phase in ("let go", "leave") and isinstance(
            intent, VelocityIntent | PoseIntent | Rest
        ):
            return replace(intent, width=self._width)
        return intent

    @property
    def _fetches(self) -> bool:
        """Whether the item is not in the gripper yet."""
        return self.fetch is not None and not self.fetch.done

    def _fetched(self, observation: Observation, now: float) -> Intent:
        """One round of fetching; the palm is looked at meanwhile, and nothing is asked of it."""
        assert self.fetch is not None
        intent = self.fetch.update(observation)
        self.chase.led()
        self.patience.reset()
        self.hindrance.reset()
        self.detour.reset()
        if self.fetch.phase == "failed":
            self.failed = self.fetch.words
            self._begin("done", WAITS, now)
        return intent

    def face(self) -> Face:
        """What the page shows."""
        face = super().face()
        if self.fetch is not None and self._fetches:
            return replace(face, state=f"fetch: {self.fetch.phase}", reason=self.fetch.words)
        if self.phase == "wait":
            return replace(face, reason=self._waits) if self.restless else face
        reason = self._ended if self.phase == "done" else self.failed or face.reason
        return replace(face, state=self.phase, reason=reason)

    @property
    def _ended(self) -> str:
        """What became of the item, in words."""
        return self.failed or self.unsure or "the item has been handed over"

    @property
    def _waits(self) -> str:
        """What a restless palm is waited for, in words."""
        return f"waits for a calm palm: it moved at {self._fastest:.1f} m/s lately"

    def _watch(self, now: float) -> None:
        """Whether the palm is restless: by what is surely seen of its speed."""
        passed, self._told = now - self._told, now
        estimate = self.chase.estimate
        if estimate is None:
            self._known = math.inf
            return
        self._known = min(self._known, now)
        if now < self._known + BEGINS:
            return
        unsure = math.sqrt(max(float(np.linalg.eigvalsh(estimate.covariance[3:, 3:])[-1]), 0.0))
        speed = float(np.linalg.norm(estimate.velocity)) - 2.0 * unsure
        self._fastest = max(speed, self._fastest * math.exp(-passed / FORGETS))
        self.restless = self._fastest > (CALM if self.restless else LIVELY)

    def _permit(self, observation: Observation) -> PermitRequest | None:
        """None to a restless palm: the arm keeps its whole distance from who moves so."""
        if self._fetches or (self.restless and self.phase in ("wait", "lower")):
            return None
        return super()._permit(observation)

    def _hindered(self, now: float, joints: JointState, guard: GuardStatus | None) -> str:
        """Nothing: a restless palm is waited for, and what is let go is not come to any more."""
        if self._fetches or self.restless or self.phase not in ("wait", "lower"):
            return ""
        return super()._hindered(now, joints, guard)

    def _go_on(self, observation: Observation, now: float) -> None:
        """The next phase, if this one is over."""
        if self.phase in ("wait", "lower") and self._slipped(observation):
            self.failed = "the item has slipped out of the gripper; give it another one, start anew"
            self._begin("done", WAITS, now)
        elif self.restless and self.phase in ("wait", "lower"):
            self._begin("wait", WAITS, now)
        elif self.phase == "wait":
            if not self._over_palm(observation, WAITS):
                self._above = math.inf
            self._above = min(self._above, now)
            estimate = self.chase.estimate
            speed = 0.0 if estimate is None else float(np.linalg.norm(estimate.velocity))
            if self._over_palm(observation, WAITS) and now > self._above + SETTLED and speed < CALM:
                self._begin("lower", LETS_GO, now)
        elif self.phase == "lower":
            if self._over_palm(observation, LETS_GO, LANDS):
                self.released, self._width = now, self.opening
                gripper = observation.gripper
                if gripper is None:
                    self.unsure = "told to open, but no gripper says that it did"
                elif gripper.holding is False:
                    self.unsure = "the gripper has opened; it did not feel that it held anything"
                self._begin("let go", LETS_GO, now)
            elif not self._over_palm(observation, 0.5 * (WAITS + LETS_GO), 2.0 * ABOVE, 3.0):
                self._begin("wait", WAITS, now)  # the palm has gone on
        elif self.phase == "let go" and now > self.since + OPENS:
            gripper = observation.gripper
            shut = gripper is not None and gripper.width < OPEN * self.opening
            if shut and gripper is not None and now > self.since + JAMMED:
                self.failed = f"the gripper did not open: {1e3 * gripper.width:.0f} mm"
                self._width = min(max(gripper.width, 0.0), self.opening)  # nor on the way
            if not shut or self.failed:
                self._begin("leave", LEAVES, now)
        elif self.phase == "leave" and now > self.since + STAYS:
            self._begin("done", LEAVES, now)

    def _slipped(self, observation: Observation) -> bool:
        """Whether the gripper has held something, and says that it no longer does.

        Fingers that move say nothing: they give a little where the arm swings what they hold.
        """
        gripper = observation.gripper
        if gripper is None or gripper.holding is None or gripper.moving:
            return False
        held, self._held = self._held, gripper.holding
        return held and not gripper.holding

    def _begin(self, phase: str, height: float, now: float) -> None:
        self.phase, self.since, self._above = phase, now, math.inf
        self._height(height)

    def _height(self, height: float) -> None:
        """Stay so far above the palm from now on [m]."""
        config = self.chase.config
        self.chase.config = replace(config, funnel=replace(config.funnel, gap=height))

    def _over_palm(
        self, observation: Observation, height: float, aside: float = ABOVE, wider: float = 1.0
    ) -> bool:
        """Whether the TCP is above the palm, so far aside at most, and about so high [m]."""
        place, joints = self.chase.place, observation.joints
        if place is None or joints is None:
            return False
        way = tcp_pose(observation.robot, joints.position)[:3, 3] - place
        up = float(way @ self.config.vertical)
        beside = float(np.linalg.norm(way - up * self.config.vertical))
        return beside < aside and abs(up - height) < wider * SLACK
