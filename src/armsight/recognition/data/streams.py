"""Random generators of a sample: one for every topic, so that a change in one leaves the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

TOPICS = (
    "room",
    "stand",
    "furniture",
    "table",
    "person",
    "light",
    "paint",
    "tool",
    "cable",
    "foreign",
    "pose",
    "view",
    "occluder",
    "ledge",
    "sensor",
    "noise",
    "arm",
    "jitter",
    "emphasis",
    "sweep",
    "grey",
    "decoy",
)
Stream = Callable[[str], np.random.Generator]


@dataclass(frozen=True)
class Streams:
    """Random generators of a sample, by topic.

    Attributes:
        seed: of the set.
        robot: number of the robot's type. scene: within the robot. index: of the sample.
        attempt: counts the tries of a sample whose scene could not be set up.
        shared: whether samples of a scene share what ``of_scene`` draws.
        take: counts the tries of a recording that the room did not allow.
    """

    seed: int
    robot: int
    scene: int
    index: int
    attempt: int
    shared: bool
    take: int = 0

    def of_scene(self, topic: str) -> np.random.Generator:
        """For what samples of a scene have in common."""
        if not self.shared:
            return self.of_sample(topic)
        key = [self.seed, 1, self.robot, self.scene, TOPICS.index(topic), self.take]
        return np.random.default_rng(key)

    def of_sample(self, topic: str) -> np.random.Generator:
        """For what each sample has of its own."""
        key = [self.seed, 2, self.index, self.attempt, TOPICS.index(topic)]
        return np.random.default_rng(key)
