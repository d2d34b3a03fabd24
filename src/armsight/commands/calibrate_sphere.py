"""``armsight calibrate WORKCELL --sphere``: cameras registered by a sphere that the arm carries."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.calibration.live.sphere import SphereResult, SphereSetup


def calibrate_sphere(
    workcell_name: str,
    seed: int,
    write: bool,
    cell_is_empty: bool,
    page: Page | None,
    force: bool = False,
) -> int:
    """Carry the sphere about, register the cameras, write the calibration file; the exit code.

    Args:
        workcell_name: a workcell file, or the name of a packaged cell.
        seed: of everything random.
        write: whether the calibration file is changed.
        cell_is_empty: somebody has made sure that nobody is in the cell.
        page: where the live page is served, or None.
        force: overwrite better entries of the calibration file.

    Raises:
        CalibrationError: somebody may be in the cell, or no camera could be registered.
    """
    import numpy as np

    from armsight.commands.calibrating import nobody_inside, refuse_worse, result_of
    from armsight.commands.ending import EndsWhen
    from armsight.commands.running import INTERRUPTED, RunOptions, run_session
    from armsight.runtime.config import SessionConfig
    from armsight.runtime.configure import mapping_config
    from armsight.tasks.calibrate_sphere import (
        CalibrateSphereTask,
        carrying_sphere,
        sphere_entries,
        sphere_setup,
    )
    from armsight.tasks.calibration_arm import corrected
    from armsight.tasks.calibration_cell import unseen_is_empty
    from armsight.workcell import open_cell
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.packaged import load

    original = load(workcell_name)
    workcell = carrying_sphere(original)
    with open_cell(workcell, seed, calibrated=False) as cell:
        # The file keeps what it says of the arm, and the cameras will be used with it.
        cell.robot = corrected(cell.robot, original)
        nobody_inside(cell, cell_is_empty)
        mapping = unseen_is_empty(mapping_config(workcell, cell.T_world_base, cell.robot.reach))
        setup = sphere_setup(cell, mapping)
        task = CalibrateSphereTask(setup, np.random.default_rng(seed))
        session = run_session(
            cell,
            task,
            RunOptions(
                page=page,
                seed=seed,
                speed=math.inf,
                observers=(EndsWhen(lambda: task.done),),
                config=SessionConfig(mapping=mapping),
            ),
        )
        seconds = session.now()
    result = result_of(task, session)
    if result is None:
        print("stopped; nothing was changed")
        return INTERRUPTED
    print(f"{len(result.places)} places in {seconds:.0f} s of robot time")
    _say(setup, result)
    entries = sphere_entries(original, setup, result)
    if write:
        refuse_worse(original, entries, force)
        print(f"{store(original, entries)}: {', '.join(e.name for e in entries)} calibrated")
    return 0 if len(entries) == len(setup.cameras) else 1


def _say(setup: SphereSetup, result: SphereResult) -> None:
    """What was found, a line a camera."""
    import numpy as np

    from armsight.geometry.pose import angle_between
    from armsight.tasks.calibrate_sphere import target_error

    found = result.registration
    aside = 1e3 * (found.hangs - setup.hangs)
    print("sphere: {:+.1f} {:+.1f} {:+.1f} mm from where its tool says".format(*aside))
    for index, info in enumerate(setup.cameras):
        if found.used[index] == 0:
            saw = sum(p.seen[index] is not None for p in result.places)
            print(f"{info.name}: not registered: it saw the sphere in {saw} places")
            continue
        T, old = found.T_base_camera[index], info.T_mount_camera
        shift = 1e3 * np.linalg.norm(T[:3, 3] - old[:3, 3])
        turn = np.rad2deg(angle_between(old, T))
        sure = 1e3 * target_error(found.covariance[index])
        print(
            f"{info.name}: {found.used[index]} places, centres to {1e3 * found.rms[index]:.1f} mm; "
            f"moved by {shift:.1f} mm, {turn:.2f} deg; points to {sure:.1f} mm"
        )
