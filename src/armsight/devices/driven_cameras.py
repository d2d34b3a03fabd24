"""Cameras behind drivers: what they report and deliver is checked before anybody relies on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from armsight.arrays import Bytes, ColorImage, DepthImage, Pose
from armsight.devices.clock import WallClock
from armsight.devices.data import (
    DepthNoise,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
)
from armsight.devices.driven_sensor import DrivenSensor
from armsight.devices.line import DeviceHealth
from armsight.devices.port import (
    CameraDriver,
    CameraReport,
    CameraSettings,
    DepthReading,
    StereoDriver,
    StereoReading,
    StereoReport,
)
from armsight.errors import DeviceError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import is_rotation

SILENT_FRAMES = 10
"""A camera that misses so many frames in a row is lost."""
MOST_INFRARED = 8
"""No infrared picture is finer than so many times its depth picture."""
LEAST_APART, MOST_APART = 0.001, 2.0
"""The lenses of a pair are so far apart [m]."""
SILENCE = 1.0
"""But none is lost sooner than after this [s]."""


class DrivenCamera:
    """Implements :class:`armsight.devices.protocols.RgbdCamera` over a driver of the port."""

    def __init__(
        self,
        settings: CameraSettings,
        opener: Callable[[CameraSettings], CameraDriver],
        describe: Callable[[CameraReport], RgbdCameraInfo],
        clock: WallClock,
        latency: float | None = None,
    ) -> None:
        """Open the camera.

        Args:
            settings: for the driver.
            opener: the driver's class.
            describe: what the cell makes of the driver's report: its place, its calibration.
            clock: the cell's.
            latency: exposure to arrival [s]; the driver's word if absent.

        Raises:
            DeviceError: it cannot be opened, or reports something that cannot be.
        """
        self._latency = latency
        self._label = settings.name
        self.name = f"camera '{settings.name}'"
        self._wanted = self._told = False
        self._infrared_wanted = self._infrared_told = False
        self._sequence = -1
        self._report: CameraReport | None = None
        self._sensor: DrivenSensor[DepthReading, RgbdFrame] = DrivenSensor(
            self.name,
            lambda: opener(settings),
            self._accept,
            self._frame,
            clock,
            before=self._pass_on_wishes,
        )
        self._info = describe(self._known())
        self._sensor.line.set_silence(max(SILENCE, SILENT_FRAMES / self._info.rate))

    @property
    def info(self) -> RgbdCameraInfo:
        """What is known of it."""
        return self._info

    def read(self) -> RgbdFrame | None:
        """The newest frame that has arrived since the last call, or None.

        Raises:
            DeviceError: the camera is lost; it is being opened again.
        """
        frame, at = self._sensor.take(), self._sensor.clock.at
        return frame and replace(frame, stamp=at(frame.stamp), arrival=at(frame.arrival))

    def want_color(self, rate: float, scale: float = 1.0) -> None:
        """Ask for colour or spare it; the device's thread passes it on.

        A driver gives every picture at its own size, or none: rate and scale are no less.
        """
        self._wanted = rate > 0.0

    def want_infrared(self, wanted: bool) -> None:
        """Ask for the depth lens's own picture or spare it; only drivers that have it give it."""
        self._infrared_wanted = wanted

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._sensor.health()

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self._sensor.close()

    def _known(self) -> CameraReport:
        assert self._report is not None
        return self._report

    def _accept(self, driver: Any) -> float:
        report: CameraReport = driver.report
        check_lens(self.name, "depth", report.depth)
        if report.color is not None:
            check_lens(self.name, "color", report.color)
        check_pose(self.name, "T_depth_color", report.T_depth_color)
        check_range(self.name, report.range, report.noise)
        check_rate(self.name, report.rate, report.latency)
        if report.infrared_scale not in range(MOST_INFRARED + 1):
            raise DeviceError(
                f"{self.name}: its driver reports {report.infrared_scale!r} pixels of infrared a "
                f"depth pixel, expected 0 (none) to {MOST_INFRARED}"
            )
        before = self._report
        if before is not None and (before.depth, before.color) != (report.depth, report.color):
            raise DeviceError(
                f"{self.name}: came back with other intrinsics ({report.model}, before "
                f"{before.model}); if it is another camera, start again and calibrate it"
            )
        self._report, self._told, self._infrared_told = report, False, False
        return report.latency if self._latency is None else self._latency

    def _pass_on_wishes(self, driver: Any) -> None:
        if self._wanted != self._told:
            self._told = self._wanted
            driver.want_color(self._wanted)
        if self._infrared_wanted != self._infrared_told:
            self._infrared_told = self._infrared_wanted
            if hasattr(driver, "want_infrared"):
                driver.want_infrared(self._infrared_wanted)

    def _frame(self, reading: DepthReading, stamp: float, arrival: float) -> RgbdFrame:
        report = self._known()
        depth = clean_depth(self.name, reading.depth, report.depth)
        color = None
        if self._wanted and reading.color is not None:
            if report.color is None:
                raise DeviceError(f"{self.name}: delivers colour but reports no colour lens")
            color = checked_color(self.name, "color", reading.color, report.color)
        infrared = None
        if self._infrared_wanted and reading.infrared is not None:
            infrared = checked_infrared(self.name, reading.infrared, report)
        self._sequence = counted(self._sequence, reading.sequence)
        return RgbdFrame(
            self._label, self._sequence, stamp, arrival, depth, color, infrared=infrared
        )


class DrivenStereo:
    """Implements :class:`armsight.devices.protocols.StereoCamera` over a driver of the port."""

    def __init__(
        self,
        settings: CameraSettings,
        opener: Callable[[CameraSettings], StereoDriver],
        describe: Callable[[StereoReport], StereoInfo],
        clock: WallClock,
        latency: float | None = None,
    ) -> None:
        """Open the pair; arguments and errors as of :class:`DrivenCamera`."""
        self._latency = latency
        self._label = settings.name
        self.name = f"stereo '{settings.name}'"
        self._wanted = False
        self._sequence = -1
        self._report: StereoReport | None = None
        self._sensor: DrivenSensor[StereoReading, StereoFrame] = DrivenSensor(
            self.name, lambda: opener(settings), self._accept, self._frame, clock
        )
        self._info = describe(self._known())
        self._sensor.line.set_silence(max(SILENCE, SILENT_FRAMES / self._info.rate))

    @property
    def info(self) -> StereoInfo:
        """What is known of it."""
        return self._info

    def read(self) -> StereoFrame | None:
        """The newest pair that has arrived since the last call, or None; None while not wanted.

        Raises:
            DeviceError: the pair is lost; it is being opened again.
        """
        frame, at = self._sensor.take(), self._sensor.clock.at
        if frame is None or not self._wanted:
            return None
        return replace(frame, stamp=at(frame.stamp), arrival=at(frame.arrival))

    def want_pictures(self, wanted: bool) -> None:
        """Ask for pairs or spare them."""
        self._wanted = wanted

    def health(self) -> DeviceHealth:
        """How it is."""
        return self._sensor.health()

    def close(self) -> None:
        """Let go of it; may be repeated."""
        self._sensor.close()

    def _known(self) -> StereoReport:
        assert self._report is not None
        return self._report

    def _accept(self, driver: Any) -> float:
        report: StereoReport = driver.report
        check_lens(self.name, "left", report.left)
        check_lens(self.name, "right", report.right)
        check_pair(self.name, report.T_left_right)
        check_rate(self.name, report.rate, report.latency)
        before = self._report
        if before is not None and (
            (before.left, before.right) != (report.left, report.right)
            or not np.allclose(before.T_left_right, report.T_left_right, atol=1e-4)
        ):
            raise DeviceError(
                f"{self.name}: came back with other intrinsics ({report.model}, before "
                f"{before.model}); if it is another pair, start again and calibrate it"
            )
        self._report = report
        return report.latency if self._latency is None else self._latency

    def _frame(self, reading: StereoReading, stamp: float, arrival: float) -> StereoFrame:
        report = self._known()
        left = checked_color(self.name, "left", reading.left, report.left)
        right = checked_color(self.name, "right", reading.right, report.right)
        self._sequence = counted(self._sequence, reading.sequence)
        return StereoFrame(self._label, self._sequence, stamp, arrival, left, right)


def check_lens(name: str, which: str, lens: PinholeCamera) -> None:
    """Intrinsics that a lens can have.

    Raises:
        DeviceError: they cannot be.
    """
    if not (isinstance(lens.distortion, tuple) and len(lens.distortion) == 5):
        raise DeviceError(
            f"{name}: its driver reports a {which} lens with the distortion {lens.distortion!r}, "
            "expected a tuple of 5 numbers: k1, k2, p1, p2, k3"
        )
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    inside = -lens.width < lens.cx < 2 * lens.width and -lens.height < lens.cy < 2 * lens.height
    if not (
        min(lens.width, lens.height) > 0
        and all(math.isfinite(number) for number in numbers)
        and min(lens.fx, lens.fy) > 1.0
        and inside
    ):
        raise DeviceError(
            f"{name}: its driver reports a {which} lens of {lens.width}x{lens.height} px with "
            f"fx {lens.fx:g}, fy {lens.fy:g}, cx {lens.cx:g}, cy {lens.cy:g} px, which cannot be"
        )


def check_range(name: str, reach: tuple[float, float], noise: DepthNoise) -> None:
    """Depths that a camera can measure [m], and how well.

    Raises:
        DeviceError: they cannot be.
    """
    near, far = reach
    if not 0.0 <= near < far < math.inf:
        raise DeviceError(
            f"{name}: its driver reports a range of {near:g} to {far:g} m, expected two growing "
            "distances"
        )
    sigma = noise.sigma(np.array([near, 0.5 * (near + far), far]))
    if not ((sigma >= 0.0) & (sigma < math.inf)).all():
        raise DeviceError(
            f"{name}: its driver reports a noise of {sigma[0]:g}, {sigma[1]:g}, {sigma[2]:g} m at "
            f"{near:g} m, halfway and {far:g} m, expected none below 0"
        )


def check_pose(name: str, what: str, pose: Pose) -> None:
    """A pose that a driver reports.

    Raises:
        DeviceError: it is none.
    """
    T = np.asarray(pose)
    if T.shape != (4, 4) or T.dtype.kind not in "fiu" or not np.isfinite(T).all():
        raise DeviceError(f"{name}: its driver reports a {what} that is no 4 x 4 pose")
    if not is_rotation(T[:3, :3], 1e-4):
        raise DeviceError(f"{name}: its driver reports a {what} whose turn is no rotation")


def check_pair(name: str, T_left_right: Pose) -> None:
    """Where the right lens of a pair can be, in the left one's frame.

    Raises:
        DeviceError: it cannot be there.
    """
    check_pose(name, "T_left_right", T_left_right)
    T = np.asarray(T_left_right)
    x, y, z = T[:3, 3]
    apart = float(np.linalg.norm(T[:3, 3]))
    if not LEAST_APART < apart < MOST_APART:
        raise DeviceError(
            f"{name}: its driver reports lenses {apart:g} m apart; expected metres, between "
            f"{LEAST_APART:g} and {MOST_APART:g}"
        )
    if -x > max(abs(y), abs(z)):
        raise DeviceError(
            f"{name}: its driver reports the right lens to the left of the left one, at "
            f"x = {x:g} m of its frame; are the lenses swapped, or the pose inverted?"
        )


def check_rate(name: str, rate: float, latency: float) -> None:
    """A camera's rate [Hz] and latency [s].

    Raises:
        DeviceError: they cannot be.
    """
    if not 0.0 < rate <= 1000.0 or not 0.0 <= latency <= 2.0:
        raise DeviceError(
            f"{name}: its driver reports {rate:g} Hz and a latency of {latency:g} s, expected "
            "up to 1000 Hz and 2 s"
        )


def clean_depth(name: str, depth: DepthImage, lens: PinholeCamera) -> DepthImage:
    """A copy of depth [m] in which everything that is no distance is NaN.

    Raises:
        DeviceError: wrong shape or type, or numbers that look like millimetres.
    """
    depth = np.asarray(depth)
    if depth.shape != (lens.height, lens.width) or depth.dtype != np.float32:
        raise DeviceError(
            f"{name}: depth is {depth.dtype} of shape {depth.shape}, expected float32 metres of "
            f"shape ({lens.height}, {lens.width}) as its lens says"
        )
    with np.errstate(invalid="ignore"):
        clean = np.where((depth > 0.0) & (depth < np.inf), depth, np.float32(np.nan))
    with np.errstate(all="ignore"):
        if np.any(clean > 100.0) and np.nanmedian(clean) > 100.0:
            raise DeviceError(
                f"{name}: depth has a median of {np.nanmedian(clean):.0f}, expected metres; "
                "looks like millimetres"
            )
    clean.flags.writeable = False
    return clean


def checked_color(name: str, which: str, image: ColorImage, lens: PinholeCamera) -> ColorImage:
    """A copy of a picture.

    Raises:
        DeviceError: wrong shape or type.
    """
    image = np.asarray(image)
    if image.shape != (lens.height, lens.width, 3) or image.dtype != np.uint8:
        raise DeviceError(
            f"{name}: {which} is {image.dtype} of shape {image.shape}, expected uint8 RGB of "
            f"shape ({lens.height}, {lens.width}, 3) as its lens says"
        )
    return image.copy()


def checked_infrared(name: str, image: Bytes, report: CameraReport) -> Bytes:
    """A copy of the depth lens's own picture.

    Raises:
        DeviceError: wrong shape or type, or the driver has reported none.
    """
    image, m = np.asarray(image), report.infrared_scale
    shape = (m * report.depth.height, m * report.depth.width)
    if m == 0:
        raise DeviceError(f"{name}: delivers infrared but reports an infrared_scale of 0")
    if image.shape != shape or image.dtype != np.uint8:
        raise DeviceError(
            f"{name}: infrared is {image.dtype} of shape {image.shape}, expected uint8 of shape "
            f"{shape}: {m} times the depth picture's, as its driver reports"
        )
    return image.copy()


def counted(last: int, given: int | None) -> int:
    """The next sequence number: the device's where it goes on, else one more than the last."""
    return int(given) if given is not None and given > last else last + 1
