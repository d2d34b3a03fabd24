"""The lab's task: nod with the wrist, and say how often."""

from dataclasses import dataclass

import numpy as np

from armsight.motion.intents import Rest, VelocityIntent
from armsight.motion.task import Observation, Subscriptions


@dataclass
class Nod:
    """Nod with the last joint but one.

    Attributes:
        joint_speed: of the joint [rad/s].
        beat: time of one way [s].
    """

    joint_speed: float = 0.2
    beat: float = 0.5

    name, period, subscriptions = "nod", 0.02, Subscriptions()

    def update(self, observation: Observation) -> Rest | VelocityIntent:
        """Up and down by the clock."""
        if observation.joints is None:
            return Rest("no joints yet")
        velocity = np.zeros(observation.robot.n)
        velocity[-2] = (
            self.joint_speed if int(observation.now / self.beat) % 2 else -self.joint_speed
        )
        now = observation.now
        return VelocityIntent("nod", velocity, "joint", now, now + 0.3)
