"""Which of the guard's ways of moving an intent is for, and what is refused of it."""

from __future__ import annotations

import math

from armsight.motion.goals import Goals
from armsight.motion.intents import Intent, JointIntent, PoseIntent, Rest, VelocityIntent, refusal
from armsight.motion.steering import Steering
from armsight.robots.robot import Robot

NOTHING = Rest()


class Wishes:
    """Hands the newest intent to goals or to steering.

    Attributes:
        rest: why nothing is pursued, when nothing is.
    """

    def __init__(self, robot: Robot, goals: Goals, steering: Steering) -> None:
        self.rest = NOTHING
        self._robot, self._goals, self._steering = robot, goals, steering

    def take(self, now: float, intent: Intent | None) -> bool:
        """Take over what a task wants; true if a goal begins or ends, or steering begins."""
        if isinstance(intent, JointIntent | PoseIntent):
            self._steering.intent, self.rest = None, NOTHING
            return self._goals.set(intent)
        changed = self._goals.set(None)
        before, self._steering.intent = self._steering.intent, None
        fault = refusal(intent, self._robot, now)
        if fault:
            self.rest = Rest(fault, fault=True)
        elif isinstance(intent, VelocityIntent):
            self._steering.intent, self.rest = intent, NOTHING
            changed = changed or before is None
        else:
            self.rest = NOTHING if intent is None else intent
        return changed

    @property
    def name(self) -> str:
        """Of the intent that is pursued, or empty."""
        pursued = self._goals.goal or self._steering.intent
        return pursued.name if pursued is not None else ""

    def evidence_age(self, now: float) -> float:
        """How old the evidence of the velocity in use is [s]; NaN without one."""
        intent = self._steering.intent
        return math.nan if intent is None else now - intent.exposure
