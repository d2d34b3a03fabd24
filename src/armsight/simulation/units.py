"""The camera that truly stands there: where, with which lenses, reading depth how wrongly.

Drawn once from ``[simulation]`` and the seed, around what the cell's file *declares*. What the cell
believes (its calibration file) has no say in it, so that calibrating lowers the error. The same
for every command, and read by nothing but the simulation and the scoring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp
from armsight.simulation.sensor_errors import DEPTH_ERRORS, UnitErrors, draw_unit
from armsight.simulation.spec import CameraSpec

FOCAL, ASPECT = 0.01, 0.0015
"""Standard deviations of a unit's focal length, and of its two against each other [1]."""
CENTER = 0.006
"""Of its principal point, as a share of the image's width."""
DISTORTION = np.array([0.01, 0.02, 0.0005, 0.0005, 0.01])
"""Of its k1, k2, p1, p2, k3."""
OFFSET = np.repeat([0.001, 0.003], 3)
"""Of the colour lens's place on the depth lens [m], [rad]."""


@dataclass(frozen=True)
class CameraUnit:
    """The truth about one camera.

    Attributes:
        depth: true depth lens; color: true colour lens, or None.
        T_depth_color: colour lens in the depth lens's frame.
        T_mount_camera: where the depth lens truly is: in world when fixed, else in the flange.
        errors: systematic error of its depth; None for an ideal sensor.
    """

    depth: PinholeCamera
    color: PinholeCamera | None
    T_depth_color: Pose
    T_mount_camera: Pose
    errors: UnitErrors | None

    def infrared(self, scale: int) -> PinholeCamera:
        """The depth lens at the resolution of the infrared picture."""
        return self.depth if scale == 1 else self.depth.scaled(scale)


def draw_camera(spec: CameraSpec, seed: tuple[int, ...]) -> CameraUnit:
    """The unit that the seed puts there."""
    declared = spec.declared if spec.declared is not None else spec.info
    rng = np.random.default_rng((*seed, 4))
    depth = _lens(declared.depth, spec.lens_error, rng)
    color = None if declared.color is None else _lens(declared.color, spec.lens_error, rng)
    T_depth_color = declared.T_depth_color
    if spec.lens_error > 0.0:
        T_depth_color = T_depth_color @ exp(spec.lens_error * rng.standard_normal(6) * OFFSET)
    errors = None
    if spec.errors:
        unit = np.random.default_rng((*seed, 3, 0))
        errors = draw_unit(DEPTH_ERRORS[declared.model], unit, spec.systematic)
    return CameraUnit(
        depth,
        color,
        np.asarray(T_depth_color),
        misplaced(spec, np.random.default_rng((*seed, 2))),
        errors,
    )


def misplaced(spec: CameraSpec, rng: np.random.Generator) -> Pose:
    """The true pose: the declared one, off by an error drawn from ``rng``."""
    meters, radians = spec.pose_error
    twist = rng.standard_normal(6) * np.repeat([meters, radians], 3)
    return np.asarray(spec.T_mount_camera_declared @ exp(twist))


def _lens(lens: PinholeCamera, scale: float, rng: np.random.Generator) -> PinholeCamera:
    """A unit of a lens: focal length to 1 %, centre to 0.6 % of the width, distortion likewise."""
    common, aspect = rng.normal(0, FOCAL), rng.normal(0, ASPECT)
    shift = rng.normal(0, CENTER * lens.width, 2)
    distortion = rng.normal(0, 1, 5) * DISTORTION
    if scale == 0.0:
        return lens
    k1, k2, p1, p2, k3 = np.asarray(lens.distortion) + scale * distortion
    return replace(
        lens,
        fx=lens.fx * (1 + scale * (common + aspect)),
        fy=lens.fy * (1 + scale * (common - aspect)),
        cx=lens.cx + scale * float(shift[0]),
        cy=lens.cy + scale * float(shift[1]),
        distortion=(float(k1), float(k2), float(p1), float(p2), float(k3)),
    )
