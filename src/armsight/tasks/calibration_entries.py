"""A solved calibration as entries of the cell's calibration file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armsight.arrays import Floats
from armsight.calibration import se3
from armsight.calibration.calibrate import Calibration
from armsight.calibration.robot_errors import RobotErrors
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.depth_model import DepthModel
from armsight.errors import CalibrationError
from armsight.geometry.pose import inverse, make_pose
from armsight.workcell.beliefs import camera_info_of
from armsight.workcell.board import board_of
from armsight.workcell.calibration_file.schema import (
    CalibratedArm,
    CalibratedBoard,
    CalibratedCamera,
)
from armsight.workcell.calibration_file.writing import arm_entry, board_entry, camera_entry
from armsight.workcell.schema import Workcell
from armsight.workcell.schema_devices import CameraSection

LEAST_VIEWS = 3
"""A camera that saw the board less often was not calibrated."""


def camera_entries(
    workcell: Workcell,
    answer: Calibration,
    depth: Sequence[DepthModel | None],
    source: str,
    camera: str | None = None,
    infos: Mapping[str, RgbdCameraInfo] | None = None,
) -> tuple[CalibratedCamera, ...]:
    """Entries of all cameras that saw enough.

    Args:
        workcell: the cell; its cameras are found by the rigs' names.
        answer: solved, its rigs mounted as the cell's cameras are.
        depth: model of each rig's depth, or None.
        source: from what, for people.
        camera: the cell's camera that a set of one rig is of; None: rigs are named as they are.
        infos: what is declared of the cameras, where the cell is open: a driver says what its
            camera is; None for what the cell's file and the catalogue say.

    Raises:
        CalibrationError: a camera is none of the cell's, or its lens is of another resolution.
    """
    sections = {c.name: c for c in workcell.camera}
    out = []
    for index, rig in enumerate(answer.problem.rigs):
        name = rig.name if camera is None else camera
        section = sections.get(name)
        if section is None:
            raise CalibrationError(
                f'{workcell.file or workcell.name}: has no camera "{name}" '
                f"(it has: {', '.join(sections) or 'none'})"
            )
        mount = "base" if section.mounted_on == "world" else "flange"
        if rig.mount != mount:
            raise CalibrationError(
                f'camera "{name}" is mounted on the {section.mounted_on}, and it was calibrated in '
                f"{rig.mount}: check --hand, or the cell's file"
            )
        lenses = [k for k, lens in enumerate(answer.problem.lenses) if lens.rig == index]
        views = {s.view for s in answer.problem.sightings if s.lens in lenses}
        if len(views) >= LEAST_VIEWS:
            model = depth[index] if index < len(depth) else None
            info = infos[name] if infos is not None else camera_info_of(workcell, section)
            out.append(_entry(workcell, section, info, answer, index, lenses, model, source))
    return tuple(out)


def _entry(
    workcell: Workcell,
    section: CameraSection,
    info: RgbdCameraInfo,
    answer: Calibration,
    rig: int,
    lenses: list[int],
    depth_model: DepthModel | None,
    source: str,
) -> CalibratedCamera:
    """The rig's frame is its first lens: the infrared one, or the colour lens where it is alone."""
    by_kind = {_kind_of(section, info, answer, k): k for k in lenses}
    sigma = max(answer.target_sigma(k) for k in lenses)
    depth_lens, color, T_depth_color = info.depth, info.color, info.T_depth_color
    T_mount_depth = answer.camera_pose(rig)
    C = answer.covariance.camera_pose(rig)
    if "depth" in by_kind:
        depth_lens = answer.lens(by_kind["depth"])
        depth_lens = depth_lens.scaled(info.depth.width / depth_lens.width)
        if "color" in by_kind:
            color, T_depth_color = answer.lens(by_kind["color"]), answer.lens_pose(by_kind["color"])
    else:
        color = answer.lens(by_kind["color"])
        T_mount_depth = T_mount_depth @ inverse(T_depth_color)
        C = se3.carried(T_depth_color, C)  # an error d of the colour lens moves the other by Ad d
    return camera_entry(
        workcell,
        section,
        T_mount_depth,
        C,
        depth_lens,
        color,
        T_depth_color,
        depth_model,
        source=source,
        target_error=sigma,
        model=info.model,
    )


def _kind_of(section: CameraSection, info: RgbdCameraInfo, answer: Calibration, lens: int) -> str:
    """Which of the camera's lenses a solved one is: by its name, else by its resolution."""
    found = answer.problem.lenses[lens]
    if found.name.endswith(" infrared"):
        return "depth"
    if found.name.endswith(" color"):
        return "color"
    size = (found.camera.width, found.camera.height)
    if info.color is not None and size == (info.color.width, info.color.height):
        return "color"
    scale = info.infrared_scale or 1
    if size == (info.depth.width * scale, info.depth.height * scale):
        return "depth"
    sizes = f"{info.depth.width}x{info.depth.height}"
    if info.color is not None:
        sizes += f" (depth) and {info.color.width}x{info.color.height} (colour)"
    raise CalibrationError(
        f'camera "{section.name}": the pictures are {size[0]}x{size[1]} px, and its lenses have '
        f"{sizes}: take them in the mode that the cell uses"
    )


def arm_of(answer: Calibration, source: str) -> CalibratedArm | None:
    """The arm's errors as found; None where the arm's joints were not known.

    Sag under load is left out: the cell's kinematics are those of a stiff arm.
    """
    errors = answer.problem.robot
    if not isinstance(errors, RobotErrors) or not answer.freedom.robot:
        return None
    return arm_of_errors(errors, answer.solution.state.theta, source)


def arm_of_errors(errors: RobotErrors, theta: Floats, source: str) -> CalibratedArm:
    """The arm's entry: (size,) errors as found."""
    n = errors.robot.n
    offset, shift = np.zeros(n), np.zeros((n, 3))
    offset[list(errors.offset_joints)] = theta[: len(errors.offset_joints)]
    lengths = theta[len(errors.offset_joints) :]
    for (joint, axis), value in zip(errors.length_axes, lengths):
        shift[joint, axis] = value
    return arm_entry(offset, shift, source=source)


def board_of_cell(workcell: Workcell, answer: Calibration, source: str) -> CalibratedBoard | None:
    """Where the cell's board hangs by a live calibration; None for a cell that declares none.

    A board that stands in world is solved in the arm's base.
    """
    section = workcell.board
    if section is None:
        return None
    points = board_of(workcell).points
    middle = make_pose(None, 0.5 * (points.max(0) + points.min(0)))
    T = answer.board_pose() @ middle
    if section.mounted_on == "world":
        T = workcell.robot.T_world_base @ T
    return board_entry(section, T, source=source)
