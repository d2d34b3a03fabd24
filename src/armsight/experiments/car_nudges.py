"""How a parked car moves that somebody pushes, leans on or draws away: its port's way over time.

A car stands on springs: what a person does to it is some millimetres to two centimetres, in some
tenths of a second, and it says nothing of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import exp, make_pose

Kind = Literal["pushed", "leaned on", "drawn away"]
KINDS: tuple[Kind, ...] = ("pushed", "leaned on", "drawn away")


@dataclass(frozen=True, eq=False)
class Nudge:
    """One of them.

    Attributes:
        shift: (3,) of the port in world, at most [m]; tilt: (3,) likewise, a rotation vector [rad].
        seconds: for the way there; times: how often there and back; 0: it stays there.
    """

    shift: Vector3
    tilt: Vector3
    seconds: float
    times: int = 0

    def at(self, seconds: float, T_world_port: Pose) -> Pose:
        """Where a port that stood at a pose is, so long after it began [s]."""
        way = min(max(seconds / self.seconds, 0.0), float(max(1, 2 * self.times)))
        share = 0.5 - 0.5 * np.cos(np.pi * way)
        turn = exp(np.concatenate([np.zeros(3), share * self.tilt]))[:3, :3]
        return make_pose(turn @ T_world_port[:3, :3], T_world_port[:3, 3] + share * self.shift)

    @property
    def lasts(self) -> float:
        """It is over after so long [s]."""
        return self.seconds * max(1, 2 * self.times)


def drawn(kind: Kind, T_world_port: Pose, rng: np.random.Generator) -> Nudge:
    """A nudge of a kind.

    Pushed: 5 to 20 mm along the ground, anywhere, at 0.02 to 0.1 m/s in the mean, and it stays.
    Leaned on: 3 to 10 mm down and 0.3 to 1 deg about a level axis, one to three times, 0.4 to 1.2 s
    each way. Drawn away: 5 to 20 mm from who looks at the port, at 0.01 to 0.05 m/s, and it stays.
    """
    level = rng.uniform(0.0, 2.0 * np.pi)
    across = np.array([np.cos(level), np.sin(level), 0.0])
    still = np.zeros(3)
    if kind == "leaned on":
        down = np.array([0.0, 0.0, -rng.uniform(0.003, 0.010)])
        tilt = across * np.deg2rad(rng.uniform(0.3, 1.0))
        return Nudge(down, tilt, float(rng.uniform(0.4, 1.2)), int(rng.integers(1, 4)))
    far = float(rng.uniform(0.005, 0.020))
    if kind == "pushed":
        return Nudge(far * across, still, far / float(rng.uniform(0.02, 0.10)))
    return Nudge(-far * T_world_port[:3, 2], still, far / float(rng.uniform(0.01, 0.05)))
