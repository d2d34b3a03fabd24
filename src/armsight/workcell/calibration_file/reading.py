"""Reads a cell's calibration file, and refuses one that is not this cell's."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from armsight.arrays import Pose
from armsight.devices.data import RgbdCameraInfo, StereoInfo
from armsight.errors import WorkcellError
from armsight.geometry.pose import exp, inverse, log
from armsight.robots.robot import Robot
from armsight.robots.tools import BOARD_TOOL
from armsight.workcell.calibration_file.schema import (
    CalibratedCamera,
    CalibratedStereo,
    CellCalibration,
)
from armsight.workcell.checks import robot_of
from armsight.workcell.problems import Problem, WorkcellFileError, from_validation, nearest
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import CameraSection, MountedSection, StereoSection

LARGEST = 1_000_000
"""A calibration file is never larger [bytes]."""
BOARD_ON_FLANGE = (BOARD_TOOL, "flange")
"""Only this tool is the board itself; another one merely holds it, if that."""
BY_PLUG = "armsight calibrate --plug"
"""Where an entry comes from that the plug has told."""
FARTHEST_OFF, MOST_TURNED = 0.5, np.deg2rad(45.0)
"""A camera that was found farther than this from where the workcell file puts it is another [m],
[rad]."""


def mount_pose(workcell: Workcell, section: MountedSection) -> Pose:
    """Where the workcell file puts a camera's depth lens: in ``base``, or in ``flange``."""
    T = section.T_mount_camera
    if section.mounted_on == "flange":
        return T
    return np.asarray(inverse(workcell.robot.T_world_base) @ T)


def calibration_of(workcell: Workcell, by_plug: bool = True) -> CellCalibration | None:
    """The calibration that belongs to a cell; None for a cell that was never calibrated.

    Args:
        workcell: the cell.
        by_plug: with what ``calibrate --plug`` has found; False where it is to be found anew.

    Raises:
        WorkcellError: it is named and not there, broken, or not this cell's; one line a problem.
    """
    file = workcell.calibration_file
    if file is None or not file.is_file():
        if workcell.cell.calibration is not None:
            raise WorkcellError(
                f"{workcell.file or workcell.name}: cell.calibration names {file}, which is not "
                "there: 'armsight calibrate' writes it; or take the key out"
            )
        return None
    calibration = read_calibration(file)
    if not by_plug:
        arm = calibration.arm
        own = arm is not None and arm.source.startswith(BY_PLUG)
        changes = {"stereo": (), "plug": None, "arm": None if own else arm}
        calibration = calibration.model_copy(update=changes)
    problems = list(mismatches(calibration, workcell))
    if problems:
        raise WorkcellFileError(str(file), problems)
    return calibration


def read_calibration(file: Path) -> CellCalibration:
    """Read and check a calibration file by itself.

    Raises:
        WorkcellError: it cannot be read or has problems; one line a problem.
    """
    try:
        if file.stat().st_size > LARGEST:
            raise WorkcellError(f"{file}: larger than 1 MB, expected a calibration file")
        text = file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise WorkcellError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise WorkcellError(f"{file}: not UTF-8 text (byte {error.start})") from None
    return parse_calibration(text, str(file))


def parse_calibration(text: str, file: str = "cell.calibration.toml") -> CellCalibration:
    """Check the text of a calibration file.

    Raises:
        WorkcellError: it has problems.
    """
    if not text.strip():
        raise WorkcellError(f"{file}: empty, expected a calibration; calibrate again")
    try:
        raw = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise WorkcellError(
            f"{file}: not valid TOML: {error}; half written or edited: restore it, or delete it "
            "and calibrate again"
        ) from None
    try:
        calibration = CellCalibration.model_validate(raw)
    except ValidationError as error:
        raise WorkcellFileError(file, from_validation(error, raw, CellCalibration)) from None
    for what, entries in (("camera", calibration.camera), ("stereo", calibration.stereo)):
        names = [c.name for c in entries]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise WorkcellFileError(file, [Problem(what, f'"{twice[0]}" is there more than once')])
    return calibration


def mismatches(calibration: CellCalibration, workcell: Workcell) -> Iterator[Problem]:
    """Why a calibration does not belong to a cell as its file is now."""
    if calibration.cell.name != workcell.name:
        yield Problem(
            "cell.name",
            f'is of cell "{calibration.cell.name}", and this is "{workcell.name}": name its own '
            "file under [cell] calibration, or calibrate this cell",
        )
        return
    if calibration.cell.robot != workcell.robot.model:
        yield Problem(
            "cell.robot",
            f"was made with a {calibration.cell.robot}, and the cell has a {workcell.robot.model}: "
            "calibrate again",
        )
        return
    board, declared = calibration.board, workcell.board
    if board is not None and declared is not None:
        step = log(inverse(board.declared.pose) @ declared.pose)
        if board.mounted_on != declared.mounted_on or np.abs(step).max() > 1e-4:
            yield Problem(
                "board.declared",
                f"older than the cell's file: the board has been declared elsewhere since "
                f"{board.calibrated:%Y-%m-%d %H:%M}; calibrate again, or take [board] out here",
            )
    sections = {c.name: c for c in workcell.camera}
    for camera in calibration.camera:
        where = f'camera "{camera.name}"'
        section = sections.get(camera.name)
        if section is None:
            yield Problem(where, f"the cell has no such camera; {nearest(camera.name, sections)}")
            continue
        yield from _another(where, camera, workcell, section)
    pairs = {c.name: c for c in workcell.stereo}
    for pair in calibration.stereo:
        where = f'stereo "{pair.name}"'
        if pair.name not in pairs:
            yield Problem(where, f"the cell has no such pair; {nearest(pair.name, pairs)}")
            continue
        yield from _another(where, pair, workcell, pairs[pair.name])
    yield from _another_plug(calibration, workcell)


def _another_plug(calibration: CellCalibration, workcell: Workcell) -> Iterator[Problem]:
    """Whether another plug hangs there than the one that was calibrated, or elsewhere."""
    found, section = calibration.plug, workcell.plug
    if found is None or section is None:
        return
    if found.kind != section.kind:
        yield Problem(
            "plug.kind",
            f"is of a {found.kind}, and the cell has a {section.kind}: the plug was exchanged; "
            f"calibrate again: '{BY_PLUG.replace('--', workcell.name + ' --')}'",
        )
        return
    tool = robot_of(workcell.robot, workcell.held).tool
    if tool is not None and found.moved(tool.T_flange_tcp):
        yield Problem(
            "plug.declared",
            f"older than the cell's tool: its tip has been declared elsewhere since "
            f"{found.calibrated:%Y-%m-%d %H:%M}; calibrate again, or take [plug] out here",
        )


def _another(
    where: str,
    camera: CalibratedCamera | CalibratedStereo,
    workcell: Workcell,
    section: CameraSection | StereoSection,
) -> Iterator[Problem]:
    if section.model is not None and camera.model != section.model:
        yield Problem(
            f"{where}.model",
            f"was a {camera.model} when it was calibrated, and the cell has a {section.model}: "
            "calibrate again",
        )
        return
    mount = "base" if section.mounted_on == "world" else "flange"
    if camera.mount != mount:
        yield Problem(
            f"{where}.mount",
            f"was calibrated in {camera.mount}, and the cell mounts it on the "
            f"{section.mounted_on}: calibrate again",
        )
        return
    T = mount_pose(workcell, section)
    if camera.moved(T):
        yield Problem(
            f"{where}.declared",
            f"older than the cell's file: the camera has been declared elsewhere since "
            f"{camera.calibrated:%Y-%m-%d %H:%M}; calibrate again, or put the old declaration back",
        )
        return
    step = log(inverse(T) @ camera.pose)
    off, turned = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
    if off > FARTHEST_OFF or turned > MOST_TURNED:
        yield Problem(
            where,
            f"stands {off:.2f} m and {np.rad2deg(turned):.0f} deg from where the cell's file puts "
            "it: is it another camera's? Correct its declaration, then calibrate again",
        )


def calibrated_info(declared: RgbdCameraInfo, found: CalibratedCamera) -> RgbdCameraInfo:
    """What is believed of a camera that was calibrated.

    Raises:
        WorkcellError: the calibration is of a lens with another resolution than the camera has.
    """
    color = declared.color
    lenses = [("depth_lens", declared.depth, found.depth_lens)]
    if color is not None and found.color_lens is not None:
        lenses.append(("color_lens", color, found.color_lens))
    for name, lens, section in lenses:
        if (lens.width, lens.height) != (section.width, section.height):
            raise WorkcellError(
                f'calibration: camera "{found.name}".{name}: is of a picture of {section.width}x'
                f"{section.height} px, and the camera has {lens.width}x{lens.height}: it was "
                "calibrated in another mode, or is another camera; calibrate again"
            )
    T_depth_color = declared.T_depth_color
    if color is not None and found.color_lens is not None:
        color, T_depth_color = found.color_lens.lens, found.color_lens.pose
    return replace(
        declared,
        depth=found.depth_lens.lens,
        color=color,
        T_depth_color=T_depth_color,
        T_mount_camera=found.pose,
        covariance=found.C,
        depth_model=None if found.depth_model is None else found.depth_model.model,
    )


def calibrated_pair(declared: StereoInfo, calibration: CellCalibration | None) -> StereoInfo:
    """What is believed of a stereo pair: as declared, or where it was calibrated."""
    found = None if calibration is None else calibration.of_pair(declared.name)
    if found is None:
        return declared
    return replace(declared, T_mount_camera=found.pose, covariance=found.C)


def calibrated_robot(robot: Robot, calibration: CellCalibration | None) -> Robot:
    """The arm with the errors that calibration has found in its geometry, the board where it hangs.

    Raises:
        WorkcellError: they are of an arm with another number of joints.
    """
    if calibration is None:
        return robot
    board, tool = calibration.board, robot.tool
    if board is not None and tool is not None and (tool.name, board.mounted_on) == BOARD_ON_FLANGE:
        off = board.pose @ inverse(board.declared.pose)
        robot = robot.without_tool().with_tool(tool.moved(off))
    plug, tool = calibration.plug, robot.tool
    if plug is not None and tool is not None and not plug.moved(tool.T_flange_tcp):
        off = plug.pose @ inverse(plug.declared.pose)
        robot = robot.without_tool().with_tool(tool.moved(off))
    if calibration.arm is None:
        return robot
    arm = calibration.arm
    if len(arm.joint_offset_deg) != robot.n:
        raise WorkcellError(
            f"calibration of {calibration.cell.name}: arm.joint_offset_deg has "
            f"{len(arm.joint_offset_deg)} values, and {robot.name} has {robot.n} joints: calibrate "
            "again"
        )
    T = np.array(robot.T_link_joint)
    for i, (offset, shift) in enumerate(zip(np.deg2rad(arm.joint_offset_deg), arm.origin_shift)):
        T[i, :3, 3] += shift
        T[i] = T[i] @ exp(np.concatenate([np.zeros(3), robot.axis[i] * offset]))
    return replace(robot, T_link_joint=T)
