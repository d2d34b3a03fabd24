"""The catalogue of depth cameras: makers' data sheets as data, and what else a model of each needs.

Sizes, fields of view, rates and ranges are the makers'. Lens distortion and the offsets between
lenses are typical values of calibrated units, latencies are assumptions inside the usual 20-60 ms;
random errors have their source beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armsight.arrays import Pose
from armsight.devices.data import DepthNoise, RgbdCameraInfo
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.stereo import StereoPair, converging_pair

Principle = Literal["structured_light", "time_of_flight", "active_stereo", "coded_light", "stereo"]


@dataclass(frozen=True)
class CameraModel:
    """What the maker's sheet, and calibrations of other people's units, say of a camera.

    Attributes:
        name: key of the catalogue.
        title: for people.
        principle: how it measures depth; decides its failures.
        depth: depth (infrared) lens, or the left lens of a stereo pair.
        color: colour lens; the right lens of a stereo pair.
        T_depth_color: colour lens in the depth lens's frame.
        rate: exposures a second as used [Hz]; max_rate: as sold [Hz].
        latency: exposure to arrival [s].
        range: least and greatest depth [m].
        noise: random error to assume of depth.
        baseline: between projector (or second lens) and depth lens [m]; 0 for time of flight.
        planes: disparity planes of a stereo matcher, 0 for all else.
        infrared_scale: pixels of the infrared picture a depth pixel; 0 for a camera without one.
    """

    name: str
    title: str
    principle: Principle
    depth: PinholeCamera
    color: PinholeCamera
    T_depth_color: Pose
    rate: float
    max_rate: float
    latency: float
    range: tuple[float, float]
    noise: DepthNoise
    baseline: float = 0.0
    planes: int = 0
    infrared_scale: int = 1


def camera_model(name: str) -> CameraModel:
    """The catalogue's entry.

    Raises:
        UsageError: there is no such model; names those that there are.
    """
    try:
        return CAMERA_MODELS[name]
    except KeyError:
        known = ", ".join(sorted(CAMERA_MODELS))
        raise UsageError(f"no camera model '{name}'; choose one of {known}") from None


def camera_info(
    name: str,
    model: str,
    mounted_on: str = "base",
    T_mount_camera: Pose | None = None,
    *,
    rate: float | None = None,
    latency: float | None = None,
    ideal_lens: bool = False,
    color_scale: float = 1.0,
) -> RgbdCameraInfo:
    """A camera of the cell from its catalogue entry.

    Args:
        name: unique in the cell.
        model: key of :data:`CAMERA_MODELS`.
        mounted_on: ``base`` or ``flange``.
        T_mount_camera: depth lens in base or flange; identity if absent.
        rate: exposures a second [Hz] instead of the model's.
        latency: exposure to arrival [s] instead of the model's.
        ideal_lens: drop the lens distortion.
        color_scale: share of the colour resolution; 1920x1080 is slow to render without a GPU.

    Raises:
        UsageError: unknown model or mount, or a rate that the camera cannot do.
    """
    entry = camera_model(model)
    if mounted_on not in ("base", "flange"):
        raise UsageError(f"camera '{name}': mounted_on is '{mounted_on}', not 'base' or 'flange'")
    rate = entry.rate if rate is None else rate
    if not 0.0 < rate <= entry.max_rate:
        raise UsageError(
            f"camera '{name}': {model} runs at up to {entry.max_rate:g} Hz, not at {rate:g} Hz"
        )
    depth, color = entry.depth, entry.color
    if ideal_lens:
        depth, color = replace(depth, distortion=_IDEAL), replace(color, distortion=_IDEAL)
    return RgbdCameraInfo(
        name=name,
        model=model,
        depth=depth,
        color=color if color_scale == 1.0 else color.scaled(color_scale),
        T_depth_color=entry.T_depth_color,
        mounted_on=mounted_on,
        T_mount_camera=np.eye(4) if T_mount_camera is None else T_mount_camera,
        rate=rate,
        latency=entry.latency if latency is None else latency,
        range=entry.range,
        noise=entry.noise,
        infrared_scale=entry.infrared_scale,
    )


def stereo_pair(
    name: str = "converging_pair",
    *,
    baseline: float | None = None,
    toe_in: float | None = None,
    focal: float | None = None,
) -> StereoPair:
    """The two lenses of a stereo model.

    Args:
        name: key of :data:`CAMERA_MODELS`.
        baseline: distance of the lenses [m] instead of the model's.
        toe_in: angle between their axes [rad] instead of the model's.
        focal: focal length of both [px] instead of the model's.

    Raises:
        UsageError: unknown model, or none of two lenses that measure together.
    """
    entry = camera_model(name)
    if entry.principle != "stereo":
        raise UsageError(f"camera model '{name}' is no stereo pair")
    left, right = entry.depth, entry.color
    if focal is not None:
        left, right = replace(left, fx=focal, fy=focal), replace(right, fx=focal, fy=focal)
    as_sold = StereoPair(left, right, entry.T_depth_color)
    return converging_pair(
        left,
        as_sold.baseline if baseline is None else baseline,
        as_sold.toe_in if toe_in is None else toe_in,
        right,
    )


_IDEAL = (0.0, 0.0, 0.0, 0.0, 0.0)


def _lens(
    width: int,
    height: int,
    fov_deg: tuple[float, float],
    distortion: tuple[float, float, float, float, float] = _IDEAL,
    center: tuple[float, float] = (0.0, 0.0),
) -> PinholeCamera:
    """Lens from its fields of view [deg] and the principal point's offset from the middle [px]."""
    lens = PinholeCamera.from_fov(width, height, *np.deg2rad(fov_deg))
    return replace(lens, cx=lens.cx + center[0], cy=lens.cy + center[1], distortion=distortion)


_D435_COLOR = (1920, 1080, (69.4, 42.5))
_D455_COLOR = (1280, 800, (90.0, 65.0))
"""Colour lenses: width, height [px], fields of view [deg]."""


def _realsense_d400(
    name: str,
    title: str,
    baseline: float,
    reach: tuple[float, float],
    color: tuple[int, int, tuple[float, float]],
    color_x: float,
) -> CameraModel:
    """A D400 at 848x480, the size that Intel recommends for it; its depth lens is the left one.

    Random error: Intel's depth quality guide has RMS = z^2 subpixel / (f baseline); 0.08 px is its
    typical subpixel figure on a textured wall.
    """
    depth = _lens(848, 480, (87.0, 58.0))  # rectified in the camera
    width, height, fov_deg = color
    return CameraModel(
        name=name,
        title=title,
        principle="active_stereo",
        depth=depth,
        color=_lens(width, height, fov_deg, (-0.055, 0.065, 0.0, 0.0, -0.021), (3.0, 2.0)),
        T_depth_color=make_pose(None, (color_x, 0.0, 0.0)),
        rate=30.0,
        max_rate=90.0,
        latency=0.035,
        range=reach,
        noise=DepthNoise(0.3e-3, 0.0, 0.08 / (depth.fx * baseline)),
        baseline=baseline,
    )


def _microsoft_tof(name: str, title: str, color_fov_deg: tuple[float, float]) -> CameraModel:
    """A camera with Microsoft's megapixel time-of-flight sensor: narrow field, unbinned.

    The depth lens looks 6 deg farther down than the colour lens, which is 32 mm beside it. Random
    error: as a Kinect v2's (Fankhauser et al. 2015); Kurillo et al. 2022 found the two alike up to
    2.5 m and the newer one better beyond.
    """
    return CameraModel(
        name=name,
        title=title,
        principle="time_of_flight",
        depth=_lens(640, 576, (75.0, 65.0), (0.04, -0.02, 0.0, 0.0, 0.0), (1.5, 7.0)),
        color=_lens(1920, 1080, color_fov_deg, (0.07, -0.09, 0.0, 0.0, 0.03), (-2.0, 9.0)),
        T_depth_color=from_rpy((np.deg2rad(6.0), 0.0, 0.0), (0.032, 0.002, -0.004)),
        rate=15.0,
        max_rate=30.0,
        latency=0.045,
        range=(0.5, 3.86),
        noise=DepthNoise(1.5e-3, -0.5e-3, 0.3e-3),
    )


_PAIR_LENS = PinholeCamera(1280, 960, 1200.0, 1200.0, 642.0, 478.0, (-0.06, 0.04, 0.0, 0.0, 0.0))

_NEAR_LENS = PinholeCamera(800, 600, 760.0, 760.0, 402.0, 298.0, (-0.05, 0.03, 0.0, 0.0, 0.0))


CAMERA_MODELS: dict[str, CameraModel] = {
    model.name: model
    for model in (
        CameraModel(
            name="kinect_v1",
            title="Microsoft Kinect v1",
            principle="structured_light",
            depth=_lens(320, 240, (57.0, 43.0), (-0.026, 0.09, 0.0, 0.0, 0.0), (-0.9, 1.4)),
            color=_lens(640, 480, (62.0, 48.6), (0.11, -0.23, 0.0, 0.0, 0.0), (2.1, -3.0)),
            T_depth_color=from_rpy((0.001, -0.002, 0.001), (0.025, 0.0, 0.0)),
            rate=15.0,
            max_rate=30.0,
            latency=0.04,
            range=(0.4, 4.5),
            # Nguyen, Izadi, Lovell 2012: 1.2 + 1.9 (z - 0.4)^2 mm; Khoshelham's 1.425 z^2 mm is
            # about the same beyond 1 m
            noise=DepthNoise(1.504e-3, -1.52e-3, 1.9e-3),
            baseline=0.075,
            infrared_scale=2,
        ),
        CameraModel(
            name="kinect_v2",
            title="Microsoft Kinect v2",
            principle="time_of_flight",
            depth=_lens(512, 424, (70.0, 60.0), (0.09, -0.27, 0.0, 0.0, 0.10), (2.3, -3.5)),
            color=_lens(1920, 1080, (84.1, 53.8), (0.05, -0.07, 0.0, 0.0, 0.01), (-3.0, 8.0)),
            T_depth_color=from_rpy((0.002, -0.001, 0.003), (0.052, 0.0, 0.0)),
            rate=15.0,
            max_rate=30.0,
            latency=0.04,
            range=(0.5, 4.5),
            # Fankhauser et al. 2015, at normal incidence: 1.5 - 0.5 z + 0.3 z^2 mm
            noise=DepthNoise(1.5e-3, -0.5e-3, 0.3e-3),
        ),
        CameraModel(
            name="r200",
            title="Intel RealSense R200",
            principle="active_stereo",
            depth=_lens(480, 360, (59.0, 46.0)),  # rectified in the camera
            color=_lens(1920, 1080, (70.0, 43.0), (-0.08, 0.05, 0.0, 0.0, 0.0), (6.0, -2.0)),
            T_depth_color=make_pose(None, (0.058, 0.0, 0.0)),
            rate=30.0,
            max_rate=60.0,
            latency=0.03,
            range=(0.5, 3.5),
            # elevation_mapping's ZR300: 2.42 + 6.63 (z - 0.772)^2 mm
            noise=DepthNoise(6.37e-3, -10.24e-3, 6.63e-3),
            baseline=0.070,
        ),
        CameraModel(
            name="f200",
            title="Intel RealSense F200",
            principle="coded_light",
            depth=_lens(640, 480, (73.0, 59.0), (-0.14, 0.05, 0.0, 0.0, 0.0), (-3.0, 1.5)),
            color=_lens(1920, 1080, (77.0, 43.0), (0.03, -0.06, 0.0, 0.0, 0.0), (4.0, 3.0)),
            T_depth_color=make_pose(None, (0.026, 0.0, 0.0)),
            rate=30.0,
            max_rate=30.0,
            latency=0.03,
            range=(0.2, 1.2),
            noise=DepthNoise(0.5e-3, 0.0, 4.0e-3),  # 1.5 mm at 0.5 m (assumption)
            baseline=0.047,
        ),
        CameraModel(
            name="wrist_stereo",
            title="stereo pair on the wrist",
            principle="stereo",
            depth=_lens(720, 480, (45.0, 30.9), (-0.12, 0.08, 0.0, 0.0, 0.0), (2.0, -1.0)),
            color=_lens(720, 480, (45.0, 30.9), (-0.12, 0.07, 0.0, 0.0, 0.0), (-1.5, 2.0)),
            T_depth_color=make_pose(None, (0.060, 0.0, 0.0)),
            rate=10.0,
            max_rate=10.0,
            latency=0.05,
            range=(0.20, 0.40),
            noise=DepthNoise(
                0.0, 0.0, 0.023
            ),  # 30 planes, about 7 mm apart: 7 mm / sqrt(12) at 0.3
            baseline=0.060,
            planes=30,
            infrared_scale=0,
        ),
        _realsense_d400("d435", "Intel RealSense D435", 0.050, (0.3, 3.0), _D435_COLOR, 0.015),
        _realsense_d400("d455", "Intel RealSense D455", 0.095, (0.6, 6.0), _D455_COLOR, -0.059),
        _microsoft_tof("azure_kinect", "Microsoft Azure Kinect DK", (90.0, 59.0)),
        _microsoft_tof("femto_bolt", "Orbbec Femto Bolt", (80.0, 51.0)),
        _microsoft_tof("femto_mega", "Orbbec Femto Mega", (80.0, 51.0)),
        CameraModel(
            name="converging_pair",
            title="two cameras that look slightly inward (the charging paper's)",
            principle="stereo",
            depth=_PAIR_LENS,
            color=replace(_PAIR_LENS, cx=_PAIR_LENS.cx - 5.0, cy=_PAIR_LENS.cy + 2.0),
            # axes that cross at 1.2 m; the paper gives neither angle nor baseline (assumption)
            T_depth_color=from_rpy((0.0, -float(np.arctan(0.2 / 1.2)), 0.0), (0.20, 0.0, 0.0)),
            rate=10.0,
            max_rate=15.0,
            latency=0.06,
            range=(0.25, 3.0),
            noise=DepthNoise(0.0, 0.0, 0.9e-3),  # Z^2 sqrt(2) 0.15 px / (f b)
            baseline=0.20,
        ),
        CameraModel(
            name="flange_pair",
            title="small stereo pair beside a plug (assumption: 800x600, 60 mm apart)",
            principle="stereo",
            depth=_NEAR_LENS,
            color=replace(_NEAR_LENS, cx=_NEAR_LENS.cx + 4.0, cy=_NEAR_LENS.cy - 3.0),
            T_depth_color=make_pose(None, (0.060, 0.0, 0.0)),
            rate=10.0,
            max_rate=15.0,
            latency=0.05,
            range=(0.15, 0.8),
            noise=DepthNoise(0.0, 0.0, 5.0e-3),
            baseline=0.060,
        ),
    )
}
"""All models by key."""
