"""Where a camera really sits: its declared pose, refined once and again when it has moved."""

from __future__ import annotations

import numpy as np

from armsight.arrays import DepthImage, Floats, Points, Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.pose import inverse, transform
from armsight.mapping.alignment import (
    DECLARED,
    MODELLED_SCALE,
    Alignment,
    AlignmentView,
    align_camera,
    mismatch,
)
from armsight.mapping.config import MappingConfig
from armsight.mapping.lens import DepthLens
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.static_geometry import StaticGeometry

POINTS = 5000
"""Points used for an alignment, about."""
ATTEMPTS = 10
"""Frames tried at the start before the declared pose is taken as it is."""
CHECK_PERIOD = 0.06
"""Time between looks whether the camera still sits where it did [s]."""
MOVED = 0.012
"""A camera has moved when known surfaces at arm's length seem displaced by this much [m] ..."""
APART = 0.006
"""... or when its points lie farther from them than when it was aligned, by this much [m], ..."""
CHECKS = 3
"""... in this many looks in a row."""
EXPLAINS = 0.8
"""A camera that moved explains at least this share of the points that it did when it was aligned:
else the picture is of another place, and lies, or it was aligned to the wrong surfaces. In the
packaged cell neighbours' pictures explain 0.27 to 0.68; of bumps by 30 mm and 3 deg those that are
found explain 0.90 to 1.08, the others 0.55 to 0.71 (tuning seed 3)."""
LOST = "seems moved, and no place of it explains what it sees: calibrate it"
BUMPED = 0.02
"""A calibrated camera is excluded when an alignment that believes nothing finds points at arm's
length displaced by this much [m]; less may be the map's own doubt."""
DOUBT_PERIOD = 1.0
"""Time between attempts to explain by another pose what a picture contradicts [s]."""
TOLD = 3.0
"""So long it is told that a camera was moved and aligned again [s]."""
ARM_S_LENGTH = np.array([[0.0, 0.0, 1.5]])
"""A point that far ahead [m]."""
IN_VIEW = np.array([[x, y, 1.5] for x in (-0.75, 0.75) for y in (-0.75, 0.75)])
"""Points at the corners of what is seen there: a camera that rolls moves nothing straight ahead."""
STILL = 0.003
"""The arm helps to align only if its stamp error moves it less than this [m]."""


class Mounting:
    """Keeps the correction of one camera's pose and depth scale.

    Attributes:
        T_old_new: corrected camera in the declared camera's frame.
        gain: factor on measured depth.
        error: believed error that is left (m, rad).
        alignment: the last alignment that was taken over, or None.
        problem: why the camera cannot be used, or empty.
        lost: it does not sit where it did, and where it does was not found (yet).
        excluded: why nothing that it says counts until it has been calibrated again, or empty.
    """

    def __init__(
        self,
        info: RgbdCameraInfo,
        lens: DepthLens,
        filter_: SelfFilter,
        solids: StaticGeometry,
        config: MappingConfig,
    ) -> None:
        self._name = info.name
        self._lens = lens
        self._filter = filter_
        self._solids = solids
        self._config = config
        self.T_old_new: Pose = np.eye(4)
        self.gain = 1.0
        self.error = (config.calibration_m, config.calibration_rad)
        self.alignment: Alignment | None = None
        self.problem = ""
        self.lost = False
        self.excluded = ""
        self._told, self._told_until = "", -np.inf
        self._doubted = -np.inf
        self._believed = _believed(info)
        ends = filter_.reach * np.array(
            [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], float
        )
        self._reached = np.clip(ends, config.lower, config.upper)
        self._attempts = ATTEMPTS if config.align else 0
        self._fits = np.inf
        self._next_check = np.inf
        self._moved = 0

    def due(self, stamp: float) -> bool:
        """Whether it is time to :meth:`look`."""
        return self._attempts > 0 or stamp >= self._next_check

    @property
    def settled(self) -> bool:
        """Whether its first alignment is over."""
        return self._attempts == 0

    def warning(self, stamp: float) -> str:
        """What became of the camera a moment ago, or nothing."""
        return self._told if stamp <= self._told_until else ""

    def restart(self) -> None:
        """The clock was turned back: if its place is checked at all, the next picture is due."""
        if self._next_check < np.inf:
            self._next_check = -np.inf
        self._doubted = self._told_until = -np.inf

    def look(self, depth: DepthImage, T_base_camera: Pose, body: BodyPose, stamp: float) -> None:
        """Align or check.

        Args:
            depth: (h, w) as measured [m]; NaN where there is no usable return.
            T_base_camera: the declared camera pose at the exposure.
            body: the arm at the exposure.
            stamp: the exposure [s].
        """
        if self._attempts > 0:
            self._attempts -= 1
            self._align(depth, T_base_camera, body, stamp)
        else:
            self._next_check = stamp + CHECK_PERIOD
            view = self._view(depth, body, POINTS // 8)
            shift, apart = mismatch(
                view, T_base_camera @ self.T_old_new, self._filter.fields, self._solids, self.gain
            )
            odd = shift > MOVED or apart > self._fits + APART
            self._moved = self._moved + 1 if odd else 0
            if not odd:
                self.lost = False
            elif self._moved >= CHECKS and self._doubts(stamp):
                self.lost = not self.moved(depth, T_base_camera, body, stamp)

    def other_pose(
        self, depth: DepthImage, T_base_camera: Pose, body: BodyPose, stamp: float
    ) -> Pose | None:
        """A picture contradicts the pose: another in ``base`` that may explain it, or None.

        Tried once a second. The picture may lie: whoever asks looks whether the new pose explains
        it, and only then calls :meth:`moved`. Arguments as in :meth:`look`.
        """
        if not self._doubts(stamp):
            return None
        start = T_base_camera @ self.T_old_new
        view = self._view(depth, body, POINTS)
        found = align_camera([view], [start], self._filter.fields, self._solids, self.gain)
        return np.asarray(start @ found.T_old_new) if found.good else None

    def _doubts(self, stamp: float) -> bool:
        """Whether it is time to seek another pose of a camera that does not sit where it did."""
        if stamp < self._doubted + DOUBT_PERIOD:
            return False
        self._doubted = stamp
        return True

    def moved(self, depth: DepthImage, T_base_camera: Pose, body: BodyPose, stamp: float) -> bool:
        """It seems to have been moved: align a declared camera anew, exclude a calibrated one.

        Returns whether it is known where it sits now.
        """
        if self._believed is None:
            before = self.T_old_new
            if not self._align(depth, T_base_camera, body, stamp):
                return False
            moved = _off(inverse(before) @ self.T_old_new, IN_VIEW)
            if moved > MOVED:
                self._told_until = stamp + TOLD
                self._told = f"was moved by about {1e3 * moved:.0f} mm, and was aligned again"
            return True
        view = self._view(depth, body, POINTS)
        start = T_base_camera @ self.T_old_new
        found = align_camera([view], [start], self._filter.fields, self._solids, self.gain)
        off = _off(found.T_old_new)
        if found.good and off > BUMPED:
            self.excluded = (
                f"was moved since it was calibrated: it sees the cell {1e3 * off:.0f} mm off; "
                "calibrate it again"
            )
        return found.good

    def _align(self, depth: DepthImage, T_base_camera: Pose, body: BodyPose, stamp: float) -> bool:
        """Take over where it is found to be; whether there is such a place."""
        view = self._view(depth, body, POINTS)
        start = T_base_camera @ self.T_old_new
        found = align_camera(
            [view], [start], self._filter.fields, self._solids, self.gain, self._believed
        )
        usual = 0 if self.alignment is None else self.alignment.points
        far = _off(found.T_old_new, IN_VIEW) > BUMPED
        if not found.good or (far and found.points < EXPLAINS * usual):
            return False
        self._attempts = 0
        self._next_check = stamp + CHECK_PERIOD
        self.T_old_new = self.T_old_new @ found.T_old_new
        self.gain = found.gain
        self.alignment = found
        self._fits = found.after
        self.error = self._error_left(found, inverse(start @ found.T_old_new))
        limit = self._config
        shift, turn = _size(self.T_old_new)
        if shift > limit.greatest_shift or turn > limit.greatest_turn:
            where, again = (
                ("where it is declared", "calibrate it")
                if self._believed is None
                else ("its calibration", "calibrate it again")
            )
            self.problem = (
                f"sits {1e3 * shift:.0f} mm and {np.rad2deg(turn):.1f} deg from {where}; {again}"
            )
        else:
            self.problem = ""
        return True

    def _error_left(self, found: Alignment, T_camera_base: Pose) -> tuple[float, float]:
        """Twice the standard deviation where the arm can be, unless calibration claims less."""
        c = self._config
        around = transform(T_camera_base, self._reached)
        far = float(np.linalg.norm(around, axis=1).max())
        meters = c.aligned_m + 2.0 * float(found.error_at(around).max())
        if meters + c.aligned_rad * far < c.calibration_m + c.calibration_rad * far:
            return meters, c.aligned_rad
        return c.calibration_m, c.calibration_rad

    def _view(self, depth: DepthImage, body: BodyPose, points: int) -> AlignmentView:
        """About as many points, evenly over the image; the arm only if it is (nearly) at rest."""
        step = max(int(np.sqrt(depth.size / points)), 1)
        z = depth[step // 2 :: step, step // 2 :: step]
        rays = self._lens.rays[step // 2 :: step, step // 2 :: step]
        known = np.isfinite(z)
        z = z[known].astype(float)
        flat = np.column_stack([rays[known].astype(float) * z[:, None], z])
        moving = float(body.speed.max(initial=0.0)) * self._config.stamp_error > STILL
        return AlignmentView(flat, None if moving else body.T_cells_base)


def _off(T: Pose, points: Points = ARM_S_LENGTH) -> float:
    """How far a correction moves points at arm's length, at most [m]."""
    return float(np.linalg.norm(transform(T, points) - points, axis=1).max())


def _believed(info: RgbdCameraInfo) -> Floats | None:
    """(7, 7) covariance of a calibrated camera's pose and depth scale; None for a declared one."""
    if info.covariance is None:
        return None
    out = np.zeros((7, 7))
    out[:6, :6] = info.covariance
    out[6, 6] = (DECLARED[6] if info.depth_model is None else MODELLED_SCALE) ** 2
    return out


def _size(T: Pose) -> tuple[float, float]:
    """Length [m] and angle [rad] of a transform."""
    cosine = np.clip(0.5 * (np.trace(T[:3, :3]) - 1.0), -1.0, 1.0)
    return float(np.linalg.norm(T[:3, 3])), float(np.arccos(cosine))
