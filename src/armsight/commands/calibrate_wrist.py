"""``armsight calibrate WORKCELL --wrist``: the pair on the flange, by looks at a ball at rest."""

from __future__ import annotations

import math

from armsight.commands.serving import Page


def calibrate_wrist(
    workcell_name: str, seed: int, write: bool, cell_is_empty: bool, page: Page | None
) -> int:
    """Look at the ball from all around, write the pair's entry of the file; the exit code.

    Args:
        workcell_name: a workcell file, or the name of a packaged cell.
        seed: of everything random.
        write: whether the calibration file is changed.
        cell_is_empty: somebody has made sure that nobody is in the cell.
        page: where the live page is served, or None.

    Raises:
        CalibrationError: somebody may be in the cell, or the ball was seen too seldom.
    """
    import numpy as np

    from armsight.commands.calibrating import nobody_inside, result_of
    from armsight.commands.ending import EndsWhen
    from armsight.commands.running import INTERRUPTED, RunOptions, run_session
    from armsight.geometry.pose import angle_between
    from armsight.runtime.config import SessionConfig
    from armsight.runtime.configure import mapping_config
    from armsight.tasks.calibrate_wrist import (
        CalibrateWristTask,
        ball_at_rest,
        wrist_entry,
        wrist_setup,
    )
    from armsight.tasks.calibration_cell import unseen_is_empty
    from armsight.workcell import open_cell
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.packaged import load

    original = load(workcell_name)
    workcell = ball_at_rest(original)
    with open_cell(workcell, seed) as cell:
        nobody_inside(cell, cell_is_empty)
        mapping = unseen_is_empty(mapping_config(workcell, cell.T_world_base, cell.robot.reach))
        setup = wrist_setup(cell, mapping)
        task = CalibrateWristTask(cell, setup, np.random.default_rng(seed))
        session = run_session(
            cell,
            task,
            RunOptions(
                page=page,
                seed=seed,
                speed=math.inf if cell.simulated else 1.0,
                observers=(EndsWhen(lambda: task.done),),
                config=SessionConfig(mapping=mapping),
            ),
        )
        seconds = session.now()
    result = result_of(task, session)
    if result is None:
        print("stopped; nothing was changed")
        return INTERRUPTED
    old = setup.pair.T_mount_camera
    shift = 1e3 * np.linalg.norm(result.T_flange_camera[:3, 3] - old[:3, 3])
    turn = np.rad2deg(angle_between(old, result.T_flange_camera))
    print(
        f"{setup.pair.name}: {result.used} of {len(result.looks)} looks in {seconds:.0f} s of "
        f"robot time, centres to {1e3 * result.rms:.1f} mm; moved by {shift:.1f} mm, "
        f"{turn:.2f} deg; points to {1e3 * result.target_error:.1f} mm, without the "
        "arm's own errors"
    )
    if write:
        entry = wrist_entry(original, setup.pair, result)
        print(f"{store(original, (), stereo=(entry,))}: {entry.name} calibrated")
    return 0
