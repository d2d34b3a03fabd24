"""How wrong a cell is about its cameras: belief against truth, for scoring only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.depth_model import DepthCorrection
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import transform
from armsight.simulation.sensor_errors import WIGGLE_PERIOD, UnitErrors
from armsight.simulation.units import CameraUnit

DEPTHS = (1.0, 1.25, 1.5)
"""Where accuracy is asked for [m]."""


@dataclass(frozen=True)
class CameraError:
    """Root mean square error of points over the image, 1.0-1.5 m from a camera [m].

    Attributes:
        pose: of pose and lens alone, their depth taken as true.
        depth: with the systematic error of the depth as well, as far as it is not corrected.
    """

    pose: float
    depth: float


def camera_error(
    info: RgbdCameraInfo, T_believed: Pose, gain: float, unit: CameraUnit, T_true: Pose
) -> CameraError:
    """Where points are thought to be against where they are.

    Args:
        info: what is believed of the camera.
        T_believed: its believed pose, with every correction, in any frame.
        gain: factor on measured depth that is in use.
        unit: the truth about it.
        T_true: its true pose, in the same frame.
    """
    u = np.linspace(0.1, 0.9, 5) * (unit.depth.width - 1)
    v = np.linspace(0.1, 0.9, 4) * (unit.depth.height - 1)
    grid = np.array([(a, b, d) for d in DEPTHS for b in v for a in u])
    pixel, z = grid[:, :2], grid[:, 2]
    true = transform(T_true, _points(unit.depth, pixel, z))
    pose = transform(T_believed, _points(info.depth, pixel, z))
    measured = z + (0.0 if unit.errors is None else systematic(unit.errors, unit.depth, pixel, z))
    if info.depth_model is not None:
        image = np.full((info.depth.height, info.depth.width), np.nan, np.float32)
        corrected = np.empty_like(measured)
        correction = DepthCorrection(info.depth_model, info.depth)
        at = np.rint(pixel).astype(int)
        for depth in DEPTHS:  # one image a distance: the grid's pixels recur
            chosen = z == depth
            image[at[chosen, 1], at[chosen, 0]] = measured[chosen]
            corrected[chosen] = correction.apply(image)[at[chosen, 1], at[chosen, 0]]
        measured = corrected
    seen = transform(T_believed, _points(info.depth, pixel, gain * measured))
    return CameraError(_rms(pose - true), _rms(seen - true))


def systematic(errors: UnitErrors, lens: PinholeCamera, pixel: Floats, z: Floats) -> Floats:
    """(m,) error of a cold unit's depth at true depths [m] and pixels, as the sensor makes it."""
    rays = lens.normalise(pixel)
    corner = float(np.max(np.sum(lens.rays**2, axis=2)))
    ripple = errors.wiggle * np.sin(2.0 * np.pi * z / WIGGLE_PERIOD + errors.phase)
    place = errors.radial * np.sum(rays**2, axis=1) / corner
    return np.asarray(errors.offset + errors.scale * z + ripple + place)


def _points(lens: PinholeCamera, pixel: Floats, z: Floats) -> Floats:
    rays = np.column_stack([lens.normalise(pixel), np.ones(len(z))])
    return np.asarray(rays * z[:, None])


def _rms(d: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
