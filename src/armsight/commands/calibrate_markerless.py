"""``armsight calibrate WORKCELL --markerless``: cameras placed by their view of the arm at work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armsight.commands.serving import Page

if TYPE_CHECKING:
    from armsight.recognition.own_arm import OwnArmPose

ENOUGH = "enough views"
SECONDS = 60.0
"""After this, the views that there are must do [s]."""


def calibrate_markerless(
    workcell_name: str,
    camera: str | None,
    seed: int,
    write: bool,
    seconds: float = SECONDS,
    *,
    page: Page | None = None,
    cell_is_empty: bool = False,
    force: bool = False,
) -> int:
    """Watch the guarded arm, place the cameras, write the calibration file; the exit code.

    Args:
        workcell_name: a workcell file, or the name of a packaged cell.
        camera: its name, or None for all fixed cameras.
        seed: of everything random.
        write: whether the calibration file is changed.
        seconds: how long is watched at most.
        page: where the live page is served, or None.
        cell_is_empty: nobody was in the cell when it started.
        force: overwrite better entries of the calibration file.

    Raises:
        UsageError: the cell has no such camera, or none that is fixed, or its arm has no shape.
        TaskError: the patrol failed.
        CalibrationError: no camera could be placed.
    """
    from armsight.commands.calibrating import refuse_worse
    from armsight.commands.ending import EndsWhen
    from armsight.commands.running import INTERRUPTED, RunOptions, run_session
    from armsight.errors import CalibrationError, TaskError, UsageError
    from armsight.geometry.pose import angle_between
    from armsight.tasks.markerless import MarkerlessTask, entry_of, find_camera
    from armsight.workcell import open_cell
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.packaged import load

    workcell = load(workcell_name)
    fixed = [c.name for c in workcell.camera if c.mounted_on == "world"]
    names = fixed if camera is None else [camera]
    if camera is not None and camera not in fixed:
        raise UsageError(
            f'{workcell_name}: no fixed camera "{camera}"; it has {", ".join(fixed) or "none"}'
        )
    if not names:
        raise UsageError(f"{workcell_name}: has no fixed camera to place by its view of the arm")
    with open_cell(workcell, seed) as cell:
        if not cell.robot.meshes:
            raise UsageError(
                f"{workcell_name}: its arm has no meshes to compare with what the cameras see; "
                "give its links visual meshes in the URDF, or calibrate with a board"
            )
        task = MarkerlessTask(workcell.goals, names)
        ends = EndsWhen(lambda: task.arm_views.complete, ENOUGH)
        speed = float("inf") if cell.simulated else 1.0
        wanted = RunOptions(
            seconds,
            page=page,
            seed=seed,
            speed=speed,
            observers=(ends,),
            cell_is_empty=cell_is_empty,
        )
        session = run_session(cell, task, wanted)
        if session.task_failure:
            raise TaskError(session.task_failure)
        if session.ended_by not in ("time", ENOUGH):
            print("stopped; nothing was changed")
            return INTERRUPTED
        found: dict[str, OwnArmPose] = {}
        infos = {c.info.name: c.info for c in cell.cameras}
        for name in names:
            views = task.arm_views.views[name]
            if not views:
                print(f"{name}: not placed: no view with the arm's joints came in {seconds:.0f} s")
                continue
            answer = find_camera(cell.robot, infos[name], views, seed)
            if not answer.believed:
                print(f"{name}: not placed: {answer.problem} ({answer.frames} views)")
                continue
            found[name] = answer
            old = infos[name].T_mount_camera
            shift = 1e3 * np.linalg.norm(answer.T_base_camera[:3, 3] - old[:3, 3])
            turn = np.rad2deg(angle_between(old, answer.T_base_camera))
            print(
                f"{name}: {answer.frames} views, {100 * answer.seen:.0f} % of the arm confirmed, "
                f"points on it to {1e3 * answer.sigma:.1f} mm; moved by {shift:.1f} mm, "
                f"{turn:.2f} deg; depth reads {1e3 * answer.bias:+.1f} mm"
            )
        if not found:
            raise CalibrationError(
                f"{workcell_name}: no camera could be placed; let the arm move more in their view"
            )
        if write:
            entries = [entry_of(workcell, infos[n], cell.robot, a) for n, a in found.items()]
            refuse_worse(workcell, entries, force)
            print(f"{store(workcell, entries)}: {', '.join(found)} calibrated")
    return 0 if len(found) == len(names) else 1
