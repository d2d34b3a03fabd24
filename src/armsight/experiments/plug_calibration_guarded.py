"""A plug calibration from cold in the guarded cell, its moves made by itself: how long it takes."""

from __future__ import annotations

from typing import Any

import numpy as np

from armsight.charging.plug_procedure import PlugNews
from armsight.geometry.pose import angle_between, inverse
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.configure import mapping_config
from armsight.runtime.session import Session
from armsight.tasks.calibrate_plug import CalibratePlugTask, plug_setup, without_car
from armsight.workcell import open_cell, simulated_world
from armsight.workcell.packaged import load

CELL = "ur10_charging"
SECONDS = 400.0
"""At most [s]."""
PATIENCE = 120.0
"""A look may take this long to be searched on a slow machine [s]."""


class _Ends:
    """Ends the session with the task."""

    name, period = "ends", 0.02

    def __init__(self, task: CalibratePlugTask) -> None:
        self._task = task
        self._session: Session | None = None

    def attach(self, session: Session) -> None:
        """The session to end."""
        self._session = session

    def update(self, now: float) -> None:
        """Look whether it is done."""
        if self._task.done and self._session is not None:
            self._session.stop("calibrated")


def guarded_run(seed: int, i: int, looks: int = 26) -> dict[str, Any]:
    """One run, as by ``armsight calibrate ur10_charging --plug --headless --cell-is-empty``.

    Args:
        seed: of the experiment; with the run it draws the cell's true errors.
        i: number of the run.
        looks: how many.
    """
    number = 1000 * seed + i
    workcell = without_car(load(CELL))
    with open_cell(workcell, number, by_plug=False) as cell:
        mapping = mapping_config(workcell, cell.T_world_base, cell.robot.reach)
        setup = plug_setup(cell, mapping, looks=looks)
        problems: list[str] = []

        def told(news: PlugNews) -> None:
            problems.extend([news.problem] if news.problem else [])

        task = CalibratePlugTask(setup, np.random.default_rng((number, 0)), told)
        config = SessionConfig(mapping=mapping, patience=PATIENCE)
        mode = SessionMode(cell_is_empty=True)
        session = Session(cell, task, seed=number, mode=mode, config=config)
        session.observe(_Ends(task))
        session.warm_up()
        session.run(SECONDS)
        found: dict[str, Any] = {
            "seconds": session.now(),
            "problems": problems,
            "failure": str(task.error or session.task_failure or ""),
            "used": 0,
            "pair_mm": float("nan"),
            "pair_deg": float("nan"),
        }
        if task.result is not None:
            answer = task.result.answer
            pair = next(
                p for p in simulated_world(cell).stereo_cameras if p.info.name == setup.pair.name
            )
            T_true = np.asarray(inverse(cell.T_world_base) @ pair.T_mount_camera)
            off = inverse(T_true) @ answer.T_base_camera
            found |= {
                "used": int(answer.used.sum()),
                "pair_mm": 1e3 * float(np.linalg.norm(off[:3, 3])),
                "pair_deg": float(np.rad2deg(angle_between(T_true, answer.T_base_camera))),
            }
        return found
