"""Cameras behind drivers: what they report and deliver is checked before anybody relies on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from armsight.devices.camera_checks import (
    check_lens,
    check_pair,
    check_pose,
    check_range,
    check_rate,
    checked_color,
    checked_infrared,
    clean_depth,
)
from armsight.devices.clock import WallClock
from armsight.devices.data import (
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

SILENT_FRAMES = 10
"""A camera that misses so many frames in a row is lost."""
MOST_INFRARED = 8
"""No infrared picture is finer than so many times its depth picture."""
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


def counted(last: int, given: int | None) -> int:
    """The next sequence number: the device's where it goes on, else one more than the last."""
    return int(given) if given is not None and given > last else last + 1
