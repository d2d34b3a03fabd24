"""Registering a cell's fixed cameras by a sphere that the arm carries (V's first step)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np

from armsight.arrays import Bytes, DepthImage, Floats, Vector3
from armsight.calibration.arm import flange_poses
from armsight.calibration.live.sphere import (
    SpherePlace,
    SphereResult,
    SphereSetup,
    sphere_procedure,
)
from armsight.errors import CalibrationError
from armsight.geometry.pose import skew
from armsight.mapping.config import MappingConfig
from armsight.motion.face import Face, Figure, Picture, PointsMark
from armsight.motion.perception import CameraUse
from armsight.robots.tools import SPHERE_TOOL
from armsight.tasks.calibration_cell import free_checks, to_calibrate
from armsight.tasks.procedure_task import ProcedureTask
from armsight.workcell.calibration_file.schema import CalibratedCamera
from armsight.workcell.calibration_file.writing import camera_entry
from armsight.workcell.schema import Workcell

if TYPE_CHECKING:
    from armsight.workcell import Cell

RADIUS = 0.075
"""Of the marker [m]: the ball of the tool ``sphere_marker``."""
TARGET = np.array([0.0, 0.0, 1.25])
"""A point this far before a camera is what its expected error is stated for [m]."""
TILE = 280
"""Width of a camera's picture on the page [px]."""
FOUND = (56, 189, 248)


def carrying_sphere(workcell: Workcell) -> Workcell:
    """The cell with the marker on its arm and nothing else, its cameras no evidence for the map."""
    robot = workcell.robot.model_copy(update={"tool": SPHERE_TOOL})
    bare = {"robot": robot, "board": None, "gripper": None, "plug": None, "tip": None, "held": ()}
    return to_calibrate(workcell).model_copy(update=bare)


def sphere_setup(cell: Cell, mapping: MappingConfig) -> SphereSetup:
    """A cell as believed before its cameras are registered.

    Raises:
        CalibrationError: it has no fixed camera.
    """
    fixed = tuple(c.info for c in cell.cameras if c.info.mounted_on == "base")
    if not fixed:
        raise CalibrationError(f"{cell.workcell.name}: has no fixed [[camera]] to register")
    tool = cell.robot.tool
    assert tool is not None
    free, _ = free_checks(cell, mapping)
    hangs = np.asarray(tool.T_flange_tcp[:3, 3], float)
    return SphereSetup(cell.robot, fixed, RADIUS, hangs, free)


class CalibrateSphereTask(ProcedureTask[SphereResult]):
    """Shows the sphere all over the cell while the cameras watch."""

    name = "calibrate by sphere"

    def __init__(self, setup: SphereSetup, rng: np.random.Generator) -> None:
        """Prepare.

        Args:
            setup: what is there to register.
            rng: of places and samples.
        """
        self._face = _SphereFace(setup)
        super().__init__(
            [CameraUse(c.name) for c in setup.cameras],
            lambda clock: sphere_procedure(setup, rng, self._face.told),
            self._face.face,
        )


class _SphereFace:
    """Places so far, and each camera's newest depth picture with what was found in it."""

    def __init__(self, setup: SphereSetup) -> None:
        self._setup = setup
        self._state = "choosing places"
        self._seen = [0] * len(setup.cameras)
        self._places: list[Vector3] = []
        self._pictures: dict[str, Bytes] = {}

    def told(
        self, done: int, of: int, place: SpherePlace, depth: Sequence[DepthImage | None]
    ) -> None:
        """A place was looked at."""
        setup = self._setup
        self._state = f"place {done} of {of}"
        T = flange_poses(setup.robot, place.joints[None])[0]
        self._places.append(T[:3, :3] @ setup.hangs + T[:3, 3])
        for index, (info, picture, center) in enumerate(zip(setup.cameras, depth, place.seen)):
            self._seen[index] += center is not None
            if picture is None:
                continue
            shade = 255.0 * (1.0 - np.nan_to_num(picture / info.range[1], nan=1.0).clip(0.0, 1.0))
            scale = TILE / picture.shape[1]
            small = cv2.resize(shade.astype(np.uint8), None, fx=scale, fy=scale)
            image = np.asarray(cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), np.uint8)
            if center is not None:
                u, v = scale * info.depth.project(center[None])[0]
                size = max(2, round(scale * setup.radius * info.depth.fx / center[2]))
                cv2.circle(image, (round(u), round(v)), size, FOUND, 2)
            self._pictures[info.name] = image

    def face(self) -> Face:
        """As it is now."""
        names = [c.name for c in self._setup.cameras]
        marks = (PointsMark("sphere", np.array(self._places), 0.012, FOUND),)
        return Face(
            state=self._state,
            figures=tuple(Figure(f"seen by {n}", float(k)) for n, k in zip(names, self._seen)),
            pictures=tuple(Picture(f"sphere in {n}", p) for n, p in self._pictures.items()),
            marks=marks if self._places else (),
        )


def sphere_entries(
    workcell: Workcell, setup: SphereSetup, result: SphereResult
) -> tuple[CalibratedCamera, ...]:
    """Entries of the cameras that were registered; their lenses stay."""
    found, out = result.registration, []
    for index, info in enumerate(setup.cameras):
        if found.used[index] == 0:
            continue
        section = next(c for c in workcell.camera if c.name == info.name)
        covariance = found.covariance[index]
        out.append(
            camera_entry(
                workcell,
                section,
                found.T_base_camera[index],
                covariance,
                info.depth,
                info.color,
                info.T_depth_color,
                result.depth[index],
                source=f"armsight calibrate --sphere, {found.used[index]} places",
                target_error=target_error(covariance),
                model=info.model,
            )
        )
    return tuple(out)


def target_error(covariance: Floats) -> float:
    """Expected error of a point 1.25 m before a camera, by its pose's (6, 6) covariance [m]."""
    J = np.hstack([np.eye(3), -skew(TARGET)])
    return float(np.sqrt(np.trace(J @ covariance @ J.T)))
