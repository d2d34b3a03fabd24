"""Which frames the map accepts, and which cameras are alive."""

from __future__ import annotations

import numpy as np

from armsight.devices.data import RgbdCameraInfo, RgbdFrame
from armsight.errors import UsageError
from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import CameraStatus

PERIODS = 2.5
"""A camera whose newest picture is its latency and so many periods old is silent: one picture may
be lost, as cables and busy machines do it, and the next one be half a period late."""


def check_camera(info: RgbdCameraInfo) -> None:
    """Refuse what would have a map free what nobody saw: comparisons with NaN are false.

    Raises:
        UsageError: the camera's lens, range, noise, rate, latency or covariance cannot be.
    """
    lens = info.depth
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    if not (min(lens.width, lens.height) > 0 and min(lens.fx, lens.fy) > 0.0):
        raise UsageError(
            f"camera {info.name}: no lens is {lens.width} x {lens.height} px with "
            f"focal lengths of {lens.fx:g} and {lens.fy:g} px"
        )
    if not np.isfinite(numbers).all():
        raise UsageError(f"camera {info.name}: its lens is {numbers}; expected finite numbers")
    fault = info.noise.fault(info.range)
    if fault:
        raise UsageError(f"camera {info.name}: it has {fault}")
    if not (0.0 <= info.rate < np.inf and 0.0 <= info.latency < np.inf):
        raise UsageError(
            f"camera {info.name}: its rate is {info.rate:g} Hz and its latency "
            f"{info.latency:g} s; expected finite numbers, none below 0"
        )
    C = np.eye(6) if info.covariance is None else np.asarray(info.covariance, float)
    if C.shape != (6, 6) or not np.isfinite(C).all() or np.linalg.eigvalsh(C)[0] <= 0.0:
        raise UsageError(
            f"camera {info.name}: the covariance of its pose is no positive definite (6, 6) matrix"
        )


def silent_after(info: RgbdCameraInfo, least: float, computing: float = 0.0) -> float:
    """The age of its newest picture from which a camera is silent [s].

    Args:
        info: of the camera.
        least: it is never less than this [s].
        computing: from a picture's arrival until what it shows is looked at [s].
    """
    period = 1.0 / info.rate if info.rate > 0 else 0.0
    return max(least, info.latency + PERIODS * period + computing)


class CameraHealth:
    """Judges the frames of one camera by their stamps and shape."""

    def __init__(self, info: RgbdCameraInfo, config: MappingConfig) -> None:
        self._info = info
        self._config = config
        self.stamp = -np.inf
        self._sequence = -1
        self._frames = 0
        self._dropped = 0
        self._refusal = self._warning = ""
        self.allowed_age = silent_after(info, config.stale_after)

    def admit(self, frame: RgbdFrame, now: float) -> bool:
        """Whether a frame may be used, by all that can be told without looking at its pixels."""
        problem = self._problem(frame, now)
        if problem:
            self.refuse(problem)
            return False
        return True

    def _problem(self, frame: RgbdFrame, now: float) -> str:
        depth = frame.depth
        want = (self._info.depth.height, self._info.depth.width)
        if not isinstance(depth, np.ndarray) or depth.shape != want:
            shape = getattr(depth, "shape", type(depth).__name__)
            return f"depth image is {shape}, expected {want}"
        if depth.dtype != np.float32:
            return f"depth image holds {depth.dtype}, expected float32 metres"
        if not np.isfinite(frame.stamp):
            return f"stamp is {frame.stamp}"
        if frame.stamp > now + self._config.future:
            return f"stamp is {frame.stamp - now:.3f} s in the future"
        if frame.stamp == self.stamp:
            return "the same frame again"
        if frame.stamp < self.stamp:
            return f"out of order by {self.stamp - frame.stamp:.3f} s"
        return ""

    def refuse(self, reason: str) -> None:
        """Count a frame that was not used."""
        self._dropped += 1
        self._refusal = reason

    def accept(self, frame: RgbdFrame, warning: str = "") -> None:
        """Count a frame that was used; a gap in its sequence counts as lost frames."""
        if 0 <= self._sequence < frame.sequence - 1:
            self._dropped += frame.sequence - 1 - self._sequence
        self._sequence = frame.sequence
        self.stamp = frame.stamp
        self._frames += 1
        self._refusal, self._warning = "", warning

    def restart(self, reason: str) -> None:
        """Forget all stamps; the next frame is the first. ``reason`` is told until it comes."""
        self.stamp = -np.inf
        self._sequence = -1
        self._refusal = reason

    def place(self, info: RgbdCameraInfo) -> None:
        """The camera was calibrated again: the next frame, through this lens, is the first."""
        self._info = info
        self.restart("was calibrated again")

    def alive(self, now: float) -> bool:
        """Whether the newest frame used is young enough, and not of a time yet to come."""
        return -self._config.future <= now - self.stamp <= self.allowed_age

    def status(self, now: float, excluded: str = "") -> CameraStatus:
        """For the snapshot; ``excluded`` says why nothing that the camera says counts."""
        if excluded:
            counts = self._frames, self._dropped
            return CameraStatus(self._info.name, self.stamp, False, *counts, excluded, True)
        alive = self.alive(now)
        reason = self._refusal or self._warning
        if not alive:
            age = now - self.stamp
            reason = f"newest frame is {age:.2f} s old" if np.isfinite(age) else "no frame yet"
            if self._refusal:
                reason += f"; last one refused: {self._refusal}"
        return CameraStatus(self._info.name, self.stamp, alive, self._frames, self._dropped, reason)
