"""The session of `armsight charge CELL --headless` as a process that somebody else may kill.

What is true of its world goes to standard output, line by line,
so that the world can go on in the next process where this one left it: as a real one would.
Run as ``python -m armsight.experiments.station_process CELL STATE SEED < WORLD``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from armsight.arrays import JointVector
from armsight.experiments.charging_visits import uncovered
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.tasks.charge import ChargeOptions, ChargeTask
from armsight.workcell import open_cell
from armsight.workcell.packaged import load

SECONDS = 120.0
"""For which it runs at most [s]."""
AT_HOME = 0.05
"""An arm that is so near waits where it should [rad]."""


class Teller:
    """Prints the station's state and the truth of the world.

    Args:
        task: of the session; world: its simulated world; home: (n,) where the arm waits [rad].
    """

    name, period = "teller", 0.04

    def __init__(self, task: ChargeTask, world: Any, home: JointVector) -> None:
        self._task, self._world, self._home = task, world, home

    def update(self, now: float) -> None:
        """Say it."""
        station = self._task.station
        depth, kept = self._world.plugged.depth, self._world.memory.take()
        away = np.abs(np.asarray(kept["joints"][: len(self._home)]) - self._home).max()
        line = {
            "now": round(now, 3),
            "state": station.state.value,
            "busy": station.busy,
            "words": station.words,
            "problems": [o.problem for o in station.outcomes],
            "depth": depth if depth > -1.0 else -1.0,
            "contacts": len(uncovered(self._world.truth.moving_contacts)),
            "home": bool(away < AT_HOME),
            "world": kept,
        }
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


def main(cell_name: str, state: Path, seed: int, kept: Mapping[str, Any] | None) -> None:
    """One visit, or what a killed one has left; until somebody ends the process."""
    with open_cell(load(cell_name), seed) as cell:
        world: Any = cell.world
        if kept:
            world.memory.put(kept)
        task = ChargeOptions(charging=3.0, state=state, visits=0 if kept else 1).make(cell)
        session = Session(cell, task, seed=seed, mode=SessionMode(cell_is_empty=True))
        session.observe(Teller(task, world, cell.robot.home))
        session.warm_up()
        session.run(SECONDS)


if __name__ == "__main__":
    text = sys.stdin.read()
    main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), json.loads(text) if text else None)
