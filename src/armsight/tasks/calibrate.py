"""Calibration by the board as a task: the live procedure, carried out through the guard."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.calibration.live.log import ProcedureOptions
from armsight.calibration.live.procedure import procedure
from armsight.calibration.live.result import LiveResult
from armsight.calibration.live.seen import SeenView
from armsight.calibration.live.setup import Setup
from armsight.calibration.live.watcher import Silent, Watcher
from armsight.motion.perception import CameraUse
from armsight.tasks.calibration_face import CalibrationFace
from armsight.tasks.procedure_task import ProcedureTask

ALL_COLOR = 1000.0
"""Colour with every exposure [Hz]."""


class CalibrateTask(ProcedureTask[LiveResult]):
    """Calibrates the cameras by the board that the arm carries."""

    def __init__(
        self,
        setup: Setup,
        options: ProcedureOptions,
        rng: np.random.Generator,
        watcher: Watcher | None = None,
        done: Sequence[SeenView] = (),
    ) -> None:
        """Prepare.

        Args:
            setup: what is there to calibrate.
            options: how thorough.
            rng: of candidates and samples.
            watcher: told what happens.
            done: views of an earlier run that was stopped.
        """
        self.setup = setup
        face = CalibrationFace(setup, watcher or Silent(), done)
        super().__init__(
            [CameraUse(c.name, ALL_COLOR, 1.0, infrared=True) for c in setup.cameras],
            lambda clock: procedure(setup, options, rng, face, clock, tuple(done)),
            face.face,
        )
