"""The procedure: find, tilt, then look where it teaches most, until the goal is reached.

It knows neither the arm nor the cameras: it yields what it wants (:class:`MoveTo`, :class:`LookAt`)
and is sent what came of it, so that a simulator, the guard or a person with a teach pendant can
carry it out, and it can stop and go on at any view. T1's stages are kept (``paper``); ours adds the
choice by information (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

import numpy as np

from armsight.calibration.live.find import find_boards
from armsight.calibration.live.learn import learn
from armsight.calibration.live.log import Log, ProcedureOptions, report, solve_now
from armsight.calibration.live.paper import cover
from armsight.calibration.live.result import LiveResult, finish
from armsight.calibration.live.seen import Looked, Request, SeenView
from armsight.calibration.live.setup import Setup
from armsight.calibration.live.tilt import tilt
from armsight.calibration.live.watcher import Silent, Watcher

Procedure = Generator[Request, "bool | Looked", LiveResult]


def procedure(
    setup: Setup,
    options: ProcedureOptions,
    rng: np.random.Generator,
    watcher: Watcher | None = None,
    clock: Callable[[], float] = lambda: 0.0,
    done: Sequence[SeenView] = (),
) -> Procedure:
    """Calibrate everything from cold; yields requests and is sent their replies.

    Args:
        setup: what is there.
        options: how thorough.
        rng: of candidates and samples.
        watcher: told what happens.
        clock: the cell's time [s].
        done: views of an earlier run that was stopped: it goes on from them.

    Raises:
        CalibrationError: no camera ever sees the board, or too little to solve.
    """
    log = Log(setup, options, watcher or Silent(), clock, list(done))
    began = clock()
    # A stage that was cut short is begun anew; what it saw before is kept.
    stages = {view.stage for view in log.views}
    if not stages & {"learn", "cover"}:
        if "tilt" not in stages:
            yield from find_boards(log)
        yield from tilt(log)
    answer = solve_now(log, rng)
    report(log, "first estimate", answer)
    stopped = ""
    if options.paper:
        yield from cover(log, answer)
        stopped = "T1's trajectory is done"
    else:
        stopped = yield from learn(log, answer, rng, began)
    return finish(setup, log.views, rng, stopped)
