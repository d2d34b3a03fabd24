"""Errors of depth sensors: random, systematic and missing returns, one parameter set a model.

Sources, as collected in the project's calibration notes; what none of them gives is an assumption
and says so. z is depth [m], th the angle of incidence, g = th^2 / (pi/2 - th)^2.

========== ==================================================== ===================================
model      random error of depth, standard deviation            source
========== ==================================================== ===================================
kinect_v1  1.2 + 1.9 (z - 0.4)^2 + 0.1 g / sqrt(z) mm,          Nguyen, Izadi, Lovell 2012;
           lateral 0.8 + 0.035 th / (pi/2 - th) px;             disparity in steps of 1/8 px of the
           disparity steps 2.85e-3 / m                          640 px image: Khoshelham 2012
kinect_v2  1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 g mm               Fankhauser et al. 2015
r200       2.42 + 6.63 (z - 0.772)^2 mm, lateral 2.2 z mm       elevation_mapping (ZR300's module)
f200       0.5 + 4 z^2 mm                                       assumption: 1-2 mm at 0.5 m
d435       0.3 + 3.5 z^2 mm, steps of 1/32 px of disparity      Intel's depth quality guide, 0.08 px
d455       0.3 + 1.8 z^2 mm, likewise                           of disparity; floor: assumption
microsoft  as kinect_v2                                         Kurillo et al. 2022: alike to 2.5 m
stereo     30 planes of disparity from 0.2 to 0.4 m             the paper on hybrid servoing
========== ==================================================== ===================================

Systematic error of a Kinect v2 out of the box, drawn once a unit: offset 20 mm (13 and 24 seen on
real ones), scale 0.3 %, 3 mm sine of 0.9 m period, 4 mm at the corners, 5 mm warm-up (sizes:
assumption). Microsoft's megapixel sensor (Azure Kinect, Femto Bolt and Mega): half the makers'
bound of 11 mm + 0.1 % as standard deviations. D400: a third of Intel's bound of 2 %. A calibrated
camera keeps the share that ``CameraSpec.systematic`` states.

Missing and wrong: out of range; grazing incidence; matt black plastic (no infrared comes back);
mirrors in shiny things; edges (mixed "flying" pixels with time of flight, ragged borders and the
projector's shadow with the others); interference where two structured-light cameras light the
same surface. Not modelled: multipath in corners, sunlight, motion blur.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from armsight.arrays import Bytes, DepthImage, Floats, Floats32, Mask, Pose
from armsight.devices.camera_models import camera_model
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.simulation.noise_kernels import disturb_depth, interfered
from armsight.simulation.rendering import DepthPicture

TABLE_STEP, TABLE_END = 0.001, 8.0
"""Depths at which errors are tabled: spacing and end [m]."""
INTERFERENCE = 0.25
"""Share of pixels lost where two patterns overlap (assumption; it depends on the angle between
the cameras: Maimone and Fuchs 2012 report up to a fifth without countermeasures)."""


@dataclass(frozen=True)
class DepthErrors:
    """Parameters of a sensor's errors.

    Attributes:
        a, b, c: random error a + b z + c z^2 [m].
        grazing: its growth with incidence, times g z^grazing_power [m].
        grazing_power: exponent of z there.
        lateral, lateral_grazing: border raggedness l + m th / (pi/2 - th) [px].
        quantum: step of 1/z [1/m]; 0 for none.
        baseline: to the projector, along +x of the camera [m]; what it cannot light gives nothing.
        fly, fly_lost: shares of edge pixels that mix both depths, and that give nothing.
        lost_from, lost_at: incidence from which returns fail, and at which all do [rad].
        infrared: whether matt black plastic gives nothing.
        shiny_lost: share of pixels lost on shiny things.
        offset, scale, wiggle, radial, warm_up: sizes of the systematic error: standard deviations
            of offset [m] and scale, amplitude of the sine [m], error at the corners [m], drift [m].
    """

    a: float
    b: float
    c: float
    grazing: float = 0.0
    grazing_power: float = 0.0
    lateral: float = 0.0
    lateral_grazing: float = 0.0
    quantum: float = 0.0
    baseline: float = 0.0
    fly: float = 0.0
    fly_lost: float = 0.0
    lost_from: float = np.deg2rad(76.0)
    lost_at: float = np.deg2rad(87.0)
    infrared: bool = True
    shiny_lost: float = 0.3
    offset: float = 0.0
    scale: float = 0.0
    wiggle: float = 0.0
    radial: float = 0.0
    warm_up: float = 0.0


def _d400(baseline: float) -> DepthErrors:
    """Of an active stereo pair of 848 px and 87 deg whose disparity comes in steps of 1/32 px."""
    focal = 424.0 / np.tan(np.deg2rad(43.5))
    return DepthErrors(
        0.3e-3,
        0.0,
        0.08 / (focal * baseline),
        lateral=0.7,
        quantum=1.0 / (32.0 * focal * baseline),
        baseline=baseline,
        fly_lost=0.3,
        shiny_lost=0.4,
        scale=0.007,
    )


_MICROSOFT_TOF = DepthErrors(
    1.5e-3,
    -0.5e-3,
    0.3e-3,
    grazing=0.1e-3,
    grazing_power=1.5,
    fly=0.45,
    fly_lost=0.25,
    offset=0.0055,
    scale=0.0005,
    wiggle=0.002,
    radial=0.003,
    warm_up=0.002,
)

DEPTH_ERRORS: dict[str, DepthErrors] = {
    "kinect_v1": DepthErrors(
        # 1.2 + 1.9 (z - 0.4)^2 = 1.504 - 1.52 z + 1.9 z^2 mm
        1.504e-3,
        -1.52e-3,
        1.9e-3,
        grazing=0.1e-3,
        grazing_power=-0.5,
        lateral=0.8,
        lateral_grazing=0.035,
        quantum=2.85e-3,
        baseline=0.075,
        fly_lost=0.3,
        lost_from=np.deg2rad(68.0),
        lost_at=np.deg2rad(84.0),
        offset=0.002,
        scale=0.006,
        radial=0.008,
    ),
    "kinect_v2": DepthErrors(
        1.5e-3,
        -0.5e-3,
        0.3e-3,
        grazing=0.1e-3,
        grazing_power=1.5,
        fly=0.45,
        fly_lost=0.25,
        offset=0.020,
        scale=0.003,
        wiggle=0.003,
        radial=0.004,
        warm_up=0.005,
    ),
    "r200": DepthErrors(
        6.37e-3,
        -10.24e-3,
        6.63e-3,
        lateral=0.95,  # 2.2 z mm is 2.2e-3 f px at every distance
        baseline=0.070,
        fly_lost=0.3,
        shiny_lost=0.5,
        scale=0.004,
    ),
    "f200": DepthErrors(
        0.5e-3,
        0.0,
        4.0e-3,
        grazing=0.1e-3,
        lateral=0.6,
        baseline=0.047,
        fly_lost=0.3,
        offset=0.002,
        scale=0.004,
    ),
    "d435": _d400(0.050),
    "d455": _d400(0.095),
    "azure_kinect": _MICROSOFT_TOF,
    "femto_bolt": _MICROSOFT_TOF,
    "femto_mega": _MICROSOFT_TOF,
    "wrist_stereo": DepthErrors(
        0.3e-3,
        0.0,
        0.0,
        lateral=1.5,
        quantum=2.5 / 29,
        infrared=False,
        shiny_lost=0.5,
    ),
    # Z^2 sqrt(2) 0.15 px / (f b), as camera_models has it for the charging robot's pairs.
    "converging_pair": DepthErrors(0.0, 0.0, 0.9e-3, lateral=1.5, infrared=False, shiny_lost=0.5),
    "flange_pair": DepthErrors(0.0, 0.0, 4.7e-3, lateral=1.5, infrared=False, shiny_lost=0.5),
}
"""By camera model."""


@dataclass(frozen=True)
class UnitErrors:
    """Systematic error of one physical camera, drawn once.

    Attributes:
        offset, scale: added [m], factor minus one.
        wiggle, phase: amplitude [m] and phase [rad] of the time-of-flight sine.
        radial: at the image's corners [m]; drift: after warm-up [m].
    """

    offset: float = 0.0
    scale: float = 0.0
    wiggle: float = 0.0
    phase: float = 0.0
    radial: float = 0.0
    drift: float = 0.0


WIGGLE_PERIOD = 0.9
"""Of the time-of-flight sine [m]."""
WARM_UP = 600.0
"""Time constant of the drift [s]: 95 % after 30 min."""


def draw_unit(errors: DepthErrors, rng: np.random.Generator, share: float = 1.0) -> UnitErrors:
    """The systematic error of one unit, or the share of it that a calibration has left."""
    offset, scale, radial = rng.standard_normal(3)
    phase = float(rng.uniform(0.0, 2.0 * np.pi))
    return UnitErrors(
        share * errors.offset * float(np.clip(offset, -2.0, 2.0)),
        share * errors.scale * float(np.clip(scale, -2.5, 2.5)),
        share * errors.wiggle,
        phase,
        share * errors.radial * float(np.clip(radial, -2.0, 2.0)),
        share * errors.warm_up,
    )


class DepthSensor:
    """Turns what an ideal camera sees into what a real one says.

    The result depends only on the picture, the seed and the exposure's number: the same run gives
    the same bits, in whatever order frames are made.
    """

    def __init__(
        self,
        info: RgbdCameraInfo,
        materials: Bytes,
        seed: tuple[int, ...],
        errors: DepthErrors | None = None,
        unit: UnitErrors | None = None,
        systematic: float = 1.0,
    ) -> None:
        """Prepare a sensor.

        Args:
            info: the camera.
            materials: code of each geom's material, see :data:`model.MATERIALS`.
            seed: of everything random.
            errors: instead of the model's.
            unit: systematic error instead of one drawn from the seed.
            systematic: share of the drawn one that is left.
        """
        self.info = info
        self._errors = DEPTH_ERRORS[info.model] if errors is None else errors
        rng = np.random.default_rng((*seed, 0))
        self.unit = draw_unit(self._errors, rng, systematic) if unit is None else unit
        self._seed = seed
        self._materials = materials
        self._rays = ray_planes(info.depth)
        self._corner = float(np.max(np.sum(self._rays.astype(float) ** 2, axis=0)))
        self._tables: tuple[float, Floats32] | None = None

    def measure(
        self, picture: DepthPicture, sequence: int, now: float, interference: Mask | None = None
    ) -> DepthImage:
        """(h, w) float32 depth [m] as the sensor gives it, NaN for no return.

        Args:
            picture: what an ideal camera sees.
            sequence: number of the exposure.
            now: time of the exposure [s]: the sensor warms up.
            interference: (h, w) pixels that another camera's pattern lights as well.
        """
        e = self._errors
        word = np.random.default_rng((*self._seed, 1, sequence)).integers(1, 2**63, dtype=np.int64)
        depth = np.empty_like(picture.depth)
        disturb_depth(
            picture.depth,
            picture.geom,
            self._materials,
            self._rays,
            np.zeros((1, 1), bool) if interference is None else interference,
            np.array(
                [
                    *self.info.range,
                    e.grazing,
                    e.lateral,
                    e.lateral_grazing,
                    e.quantum,
                    e.baseline,
                    e.fly,
                    e.fly_lost,
                    np.cos(e.lost_from),
                    np.cos(e.lost_at),
                    1.0 if e.infrared else 0.0,
                    e.shiny_lost,
                    self.unit.radial / self._corner,
                    INTERFERENCE,
                    TABLE_STEP,
                ],
                np.float32,
            ),
            *self._depth_tables(now),
            _normals(),
            _incidence(),
            np.uint64(word),
            depth,
        )
        return depth

    def _depth_tables(self, now: float) -> tuple[Floats32, Floats32, Floats32]:
        """Systematic error, sigma and growth with incidence over depth."""
        minute = np.floor(now / 60.0)
        if self._tables is None or self._tables[0] != minute:
            z = np.arange(0.0, TABLE_END, TABLE_STEP)
            e, unit = self._errors, self.unit
            drift = unit.drift * (1.0 - np.exp(-60.0 * minute / WARM_UP))
            wiggle = unit.wiggle * np.sin(2.0 * np.pi * z / WIGGLE_PERIOD + unit.phase)
            shift = unit.offset + unit.scale * z + wiggle + drift
            sigma = np.maximum(e.a + e.b * z + e.c * z * z, 0.0)
            growth = e.grazing * np.maximum(z, 0.05) ** e.grazing_power
            self._tables = (minute, np.stack([shift, sigma, growth]).astype(np.float32))
        shift, sigma, growth = self._tables[1]
        return shift, sigma, growth


def interference_mask(
    depth: DepthImage,
    lens: PinholeCamera,
    T_world_camera: Pose,
    other_depth: DepthImage,
    other_lens: PinholeCamera,
    T_world_other: Pose,
) -> Mask:
    """(h, w) pixels whose surface another structured-light camera lights as well.

    The other's projector is taken to sit at its camera. Its depth says what it reaches.
    """
    mask = np.zeros(depth.shape, bool)
    interfered(
        depth,
        ray_planes(lens),
        np.ascontiguousarray(inverse(T_world_other) @ T_world_camera),
        other_depth,
        np.array([other_lens.fx, other_lens.fy, other_lens.cx, other_lens.cy]),
        mask,
    )
    return mask


@lru_cache(maxsize=64)
def ray_planes(lens: PinholeCamera) -> Floats32:
    """(2, h, w) normalised coordinates of each pixel, a plane each: the compiler likes it so."""
    return np.ascontiguousarray(np.moveaxis(lens.rays, 2, 0), np.float32)


def structured(info: RgbdCameraInfo) -> bool:
    """Whether the camera lights the scene with a pattern that disturbs its like."""
    return camera_model(info.model).principle in ("structured_light", "coded_light")


@lru_cache(maxsize=1)
def _normals() -> Floats32:
    """(65536,) normal deviates at equal steps of probability: a 16-bit draw looks one up."""
    table = ndtri((np.arange(65536) + 0.5) / 65536)
    return np.asarray(table, np.float32)


@lru_cache(maxsize=1)
def _incidence() -> Floats32:
    """(2, 1024) g and th / (pi/2 - th) over the cosine of incidence."""
    th = np.arccos(np.clip((np.arange(1024) + 0.5) / 1024, 0.0, 1.0))
    ratio = th / np.maximum(np.pi / 2 - th, 0.02)
    return np.asarray(np.stack([ratio**2, ratio]), np.float32)


def noise_sigma(errors: DepthErrors, z: Floats) -> Floats:
    """Stated random error [m] at depth z [m], seen head-on."""
    return np.asarray(np.maximum(errors.a + errors.b * z + errors.c * z * z, 0.0))
