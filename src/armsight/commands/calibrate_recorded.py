"""``armsight calibrate --from FOLDER``: a recorded set, read, solved and written."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from armsight.calibration.boards import Board
    from armsight.calibration.calibrate import Calibration
    from armsight.calibration.recorded_set import RecordedSet
    from armsight.calibration.recorded_solve import RecordedAnswer
    from armsight.commands.calibrate import Calibrate
    from armsight.robots.robot import Robot
    from armsight.workcell.schema import Workcell
    from armsight.workcell.schema_devices import CameraSection


def calibrate_recorded(asked: Calibrate) -> int:
    """Read the folder, solve it, write what it tells; the exit code.

    Raises:
        UsageError: options that exclude each other, or a camera that the cell has not.
        CalibrationError: it cannot be solved, or something better would be overwritten.
    """
    from armsight.calibration import report
    from armsight.calibration.export import write_results
    from armsight.calibration.recorded_set import load
    from armsight.commands.calibrating import say
    from armsight.errors import UsageError
    from armsight.robots import load_robot
    from armsight.tasks.calibration_arm import corrected
    from armsight.workcell.packaged import load as load_cell
    from armsight.writing import write_text

    assert asked.from_ is not None
    if asked.hand and asked.beside:
        raise UsageError("calibrate: --hand and --beside exclude each other")
    mount: Literal["base", "flange"] | None = None
    if asked.hand or asked.beside:
        mount = "flange" if asked.hand else "base"
    robot = load_robot(asked.robot) if asked.robot is not None else None
    workcell = None if asked.workcell is None else load_cell(asked.workcell)
    if robot is not None and workcell is not None and workcell.robot.model == asked.robot:
        robot = corrected(robot, workcell)
    section = _kept_camera(asked, workcell)
    kept = None if section is None else section.name
    if section is not None and mount is None:  # the cell's file says so
        mount = "base" if section.mounted_on == "world" else "flange"
    recorded = load(asked.from_, _board(asked), asked.lens, say, mount, robot)
    if kept is not None and len(recorded.cameras) > 1:
        names = ", ".join(c.name for c in recorded.cameras)
        raise UsageError(
            f"calibrate: --camera {kept} goes with a set of one camera; {asked.from_} has "
            f"{names}: call their folders or pictures as the cell calls its cameras"
        )
    answer = _solved(asked, recorded, robot)
    if answer.lenses:
        return _lenses(asked, recorded, answer)
    if answer.calibration is None:
        for finding in answer.findings:
            print(finding)
        print("nothing was written: mend what is wrong first", file=sys.stderr)
        return 1
    for line in report.lines(answer.calibration, (), answer.findings, recorded.names):
        print(line)
    if asked.compare:
        from armsight.calibration.peers import compare, peer_lines

        for line in peer_lines(compare(answer.calibration)):
            print(line)
    wrong = any(f.severity == "error" for f in answer.findings)
    if wrong and not asked.force:
        print("nothing was written: mend what is wrong first, or use --force", file=sys.stderr)
        return 1
    # Drawn first: whoever interrupts the drawing must not leave results without their report.
    page = report.page(answer.calibration, (), answer.findings, f"Calibration of {asked.from_}")
    write_results(asked.out, answer.calibration, (), answer.findings, asked.force)
    write_text(asked.out / "report.html", page)
    if asked.workcell is not None and asked.write:
        if wrong:
            print("the cell's calibration file was not changed: see the errors above")
        else:
            _keep(asked, answer.calibration)
    print(f"written to {asked.out}; open {asked.out / 'report.html'}")
    if asked.second_arm is not None:
        return _second(asked, answer.calibration, mount, robot)
    return 0


def _solved(asked: Calibrate, recorded: RecordedSet, robot: Robot | None) -> RecordedAnswer:
    from armsight.calibration import report
    from armsight.calibration.recorded_solve import solve_set
    from armsight.commands.calibrating import say

    say("")
    for line in report.read_lines(recorded):
        print(line)
    answer = solve_set(recorded, robot, asked.seed, say, asked.keep_lenses)
    say("")
    return answer


def _second(
    asked: Calibrate,
    first: Calibration,
    mount: Literal["base", "flange"] | None,
    robot: Robot | None,
) -> int:
    """Solve the second arm's set, and say where it stands in the first's base."""
    import yaml

    from armsight.calibration.export import transform_entry, write_results
    from armsight.calibration.recorded_set import load
    from armsight.calibration.two_arms import two_arms
    from armsight.commands.calibrating import say
    from armsight.writing import write_text

    assert asked.second_arm is not None
    print(f"second arm, {asked.second_arm}:")
    recorded = load(asked.second_arm, _board(asked), asked.lens, say, mount, robot)
    answer = _solved(asked, recorded, robot)
    for finding in answer.findings:
        print(finding)
    wrong = any(f.severity == "error" for f in answer.findings)
    if answer.calibration is None or (wrong and not asked.force):
        print("nothing was written of the second arm", file=sys.stderr)
        return 1
    found = two_arms(first, answer.calibration)
    print(found.words())
    folder = asked.out / "second_arm"
    write_results(folder, answer.calibration, (), answer.findings, asked.force)
    entry = transform_entry("base", "second_base", found.T_first_second)
    write_text(folder / "bases.yaml", yaml.safe_dump({"transforms": [entry]}, sort_keys=False))
    print(f"written to {folder}")
    return 0


def _kept_camera(asked: Calibrate, workcell: Workcell | None) -> CameraSection | None:
    """The cell's camera that the set is of, where it is named.

    Raises:
        UsageError: the cell has none of this name; better said before the solve.
    """
    from armsight.errors import UsageError

    if workcell is None:
        return None
    cameras = {c.name: c for c in workcell.camera}
    if asked.camera is not None and asked.camera not in cameras:
        raise UsageError(
            f'{asked.workcell}: has no camera "{asked.camera}" (it has: {", ".join(cameras)})'
        )
    return None if asked.camera is None else cameras[asked.camera]


def _keep(asked: Calibrate, answer: Calibration) -> None:
    """Put what a recorded set has told into the cell's calibration file."""
    from armsight.commands.calibrating import refuse_worse
    from armsight.tasks.calibration_arm import arm_found, with_doubt_of_arm
    from armsight.tasks.calibration_entries import camera_entries
    from armsight.workcell.calibration_file.store import store
    from armsight.workcell.packaged import load

    assert asked.workcell is not None
    workcell = load(asked.workcell)
    name = asked.camera
    if name is None and len(workcell.camera) == len(answer.problem.rigs) == 1:
        name = workcell.camera[0].name
    source = f"armsight calibrate --from {asked.from_}"
    entries = camera_entries(workcell, answer, (), source, name)
    arm = None
    if answer.problem.robot is not None and workcell.robot.model == asked.robot:
        arm = arm_found(workcell, answer, source)
    else:
        entries, off = with_doubt_of_arm(entries, workcell)
        if off > 0.0:
            print(
                f"{workcell.calibration_file}: corrects the arm by {1e3 * off:.1f} mm, which the "
                "controller's poses may not know of: the cameras are taken for so much less sure; "
                f"joint angles beside the poses and --robot {workcell.robot.model} settle it"
            )
    refuse_worse(workcell, entries, asked.force)
    file = store(workcell, entries, arm)
    names = ", ".join(e.name for e in entries) or "no camera"
    print(f"{file}: {names}{', arm' if arm is not None else ''} calibrated")


def _lenses(asked: Calibrate, recorded: RecordedSet, answer: RecordedAnswer) -> int:
    """Write the lenses of pictures without poses.

    Raises:
        CalibrationError: the folder holds a calibration with poses, of which they are no part.
    """
    import numpy as np

    from armsight.calibration.export import (
        SUMMARY,
        camera_info_yaml,
        file_names,
        opencv_yaml,
    )
    from armsight.errors import CalibrationError
    from armsight.writing import write_text

    names = file_names([c.name for c in recorded.cameras])
    for camera, lens in zip(recorded.cameras, answer.lenses):
        c = lens.camera
        d = " ".join(f"{v:.4f}" for v in c.distortion)
        sigma = np.sqrt(np.maximum(np.diagonal(lens.covariance), 0.0))
        print(f"lens of {camera.name} from {lens.frames} frames, to {lens.rms_px:.2f} px:")
        print(
            f"  f {c.fx:.2f} {c.fy:.2f} (sigma {sigma[:2].max():.2f}), centre {c.cx:.2f} "
            f"{c.cy:.2f} (sigma {sigma[2:4].max():.2f}), k1 k2 p1 p2 k3 {d}"
        )
    for finding in answer.findings:
        print(finding)
    if any(f.severity == "error" for f in answer.findings) and not asked.force:
        print("nothing was written: mend what is wrong first, or use --force", file=sys.stderr)
        return 1
    if (asked.out / SUMMARY).exists() and not asked.force:
        raise CalibrationError(
            f"{asked.out}: holds a calibration of cameras and arm, whose lenses would be "
            "overwritten; write elsewhere (--out), or use --force"
        )
    for name, lens in zip(names, answer.lenses):
        text = camera_info_yaml(name, lens.camera)
        write_text(asked.out / f"{name}.camera_info.yaml", text)
        write_text(asked.out / f"{name}.opencv.yaml", opencv_yaml(lens.camera))
    if asked.workcell is not None:
        print("no poses, so the cell's calibration file was not changed")
    print(f"written to {asked.out}")
    return 0


def _board(asked: Calibrate) -> Board | None:
    from armsight.calibration.boards import parse_board

    return parse_board(asked.board) if asked.board is not None else None
