"""A perceiver in the loop: frames in, one immutable observation out, computed beside the loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from numbers import Real
from types import MappingProxyType
from typing import Any

import numpy as np

from armsight.devices.data import RgbdCameraInfo, RgbdFrame, StereoFrame, StereoInfo
from armsight.devices.history import JointHistory
from armsight.errors import UsageError
from armsight.motion.perception import Evidence, Perceiver, Posed, SeenRobot
from armsight.robots.robot import Robot
from armsight.runtime.foreign import ForeignThread, Outcome
from armsight.runtime.latency import Latency
from armsight.runtime.posing import NewestFrames, posed, posed_pair
from armsight.runtime.slot import Slot

LATENCY = 0.02
"""What a round is charged if the perceiver does not say [s]."""


class PerceiverComponent:
    """Runs one perceiver whenever a frame has come and its period has passed.

    Attributes:
        problem: why its last round gave nothing, in words; empty when all is well.
        newest: what it published.
        on_result: told when a new observation is visible [s].
        on_seconds: told how long a round computed beside the loop [s].
        call_at: the simulated loop's; None under the wall clock, where a round takes its time.

    Args:
        perceiver: somebody else's; it may raise and hang.
        robot: whose joints the frames are posed with; cameras: of the cell, by name.
        history: joints of the last seconds.
        charge: how compute time is charged, see :class:`Latency`.
        patience: a call that takes longer on the wall clock [s] is given up.
        pairs: stereo pairs of the cell, by name.

    Raises:
        UsageError: its period, its latency or a camera's name is not possible.
    """

    def __init__(
        self,
        perceiver: Perceiver,
        robot: Robot,
        cameras: Mapping[str, RgbdCameraInfo],
        history: JointHistory,
        charge: Callable[[float], Latency],
        patience: float,
        pairs: Mapping[str, StereoInfo] = MappingProxyType({}),
    ) -> None:
        self.name = f"perceiver/{perceiver.name}"
        self.period = checked_period(f"perceiver {perceiver.name}", perceiver)
        self.charge = 0.0
        self.problem = ""
        self.newest: Slot[Evidence] = Slot()
        self.stereo: tuple[str, ...] = tuple(getattr(perceiver, "stereo", ()))
        self.frames = NewestFrames(perceiver.cameras, self.stereo)
        self.on_result: Callable[[float], None] = lambda at: None
        self.on_seconds: Callable[[float], None] = lambda seconds: None
        self.call_at: Callable[[float, Callable[[], None]], None] | None = None
        self.perceiver = perceiver
        self._robot, self._cameras, self._history = robot, cameras, history
        self._pairs = pairs
        self._latency = charge(checked_latency(f"perceiver {perceiver.name}", perceiver, LATENCY))
        self._thread = ForeignThread(self.name, patience)
        self._began = -math.inf
        for use in perceiver.cameras:
            if use.camera and use.camera not in cameras:
                known = ", ".join(sorted(cameras)) or "none"
                raise UsageError(
                    f"perceiver {perceiver.name}: no camera '{use.camera}' in this cell; "
                    f"there are: {known}"
                )
        for name in self.stereo:
            if name not in pairs:
                known = ", ".join(sorted(pairs)) or "none"
                raise UsageError(
                    f"perceiver {perceiver.name}: no stereo pair '{name}' in this cell; there "
                    f"are: {known}"
                )

    def update(self, now: float) -> None:
        """Begin a round if there is a frame for it."""
        self.charge = 0.0
        if self._thread.hung or not self.frames.waiting or now < self._began + self.period - 1e-9:
            return
        self._began = now
        frames = [self._posed(f) for f in self.frames.take() if self._known(f)]
        wait = self._thread.begin(lambda: self.perceiver.update(frames))
        if self.call_at is not None and self._latency.charge == "declared":
            self.charge = self._latency.declared
            at = now + self.charge

            def finish() -> None:
                outcome = wait()
                self.on_seconds(outcome.seconds)
                self._finish(outcome, at)

            self.call_at(at, finish)
            return
        outcome = wait()
        self.charge = self._latency.of(outcome.seconds)
        self._finish(outcome, now + self.charge)

    def doubted(self, camera: str, excluded: bool) -> None:
        """A camera does not count any more; the perceiver is told if it wants to know."""
        tell = getattr(self.perceiver, "doubted", None)
        if tell is None:
            return
        try:
            tell(camera, excluded)
        except Exception as error:  # the map is told of no stranger's mistakes
            self.problem = f"doubted() failed: {type(error).__name__}: {error}"

    def _known(self, frame: RgbdFrame | StereoFrame) -> bool:
        return frame.camera in (self._pairs if isinstance(frame, StereoFrame) else self._cameras)

    def _posed(self, frame: RgbdFrame | StereoFrame) -> Posed:
        if isinstance(frame, StereoFrame):
            return posed_pair(frame, self._pairs[frame.camera], self._robot, self._history)
        return posed(frame, self._cameras[frame.camera], self._robot, self._history)

    def _finish(self, outcome: Outcome[Any], at: float) -> None:
        self.problem = outcome.fault
        evidence = outcome.value
        if evidence is None:
            return
        self.problem = evidence_fault(evidence)
        if self.problem:
            return
        self.problem = str(getattr(evidence, "warning", "") or "")
        self.newest.publish(evidence, at)
        self.on_result(at)


def evidence_fault(evidence: Any) -> str:
    """What is wrong with what a perceiver published, in words; empty when nothing is."""
    kind = type(evidence).__name__
    try:
        stamp = getattr(evidence, "stamp", None)
        if not isinstance(stamp, Real) or not math.isfinite(stamp):
            return f"its {kind} has no finite stamp"
        for pair in getattr(evidence, "excluded", ()):
            camera, reason = pair
            if not (isinstance(camera, str) and isinstance(reason, str)):
                return f"its {kind} excludes {pair!r}; expected a camera's name and a reason"
        for info in getattr(evidence, "placed", ()):
            if not isinstance(info, RgbdCameraInfo):
                return f"its {kind} has placed a {type(info).__name__}; expected RgbdCameraInfo"
        for seen in getattr(evidence, "robots", ()):
            if not isinstance(seen, SeenRobot):
                return f"its {kind} has seen a {type(seen).__name__}; expected SeenRobot"
            for what in (seen.points, seen.joints):
                if np.ndim(what) != 2 or np.shape(what)[1] != 3 or not np.isfinite(what).all():
                    return (
                        f"its {kind} has seen a robot at {np.shape(what)}; expected (k, 3) metres"
                    )
    except Exception as error:  # whatever a stranger's record does when it is looked at
        return f"its {kind} cannot be read: {type(error).__name__}: {error}"
    return ""


def checked_period(what: str, part: Any) -> float:
    """The period of a task or a perceiver [s].

    Raises:
        UsageError: it is no time between 1 ms and 10 s.
    """
    period = getattr(part, "period", None)
    if not isinstance(period, (int, float)) or not 0.001 <= period <= 10.0:
        raise UsageError(f"{what}: period is {period}; expected 0.001 to 10 seconds")
    return float(period)


def checked_latency(what: str, part: Any, default: float) -> float:
    """The declared latency of a task or a perceiver [s].

    Raises:
        UsageError: it is no time between 0 and 10 s.
    """
    latency = getattr(part, "latency", default)
    if not isinstance(latency, (int, float)) or not 0.0 <= latency <= 10.0:
        raise UsageError(f"{what}: latency is {latency}; expected 0 to 10 seconds")
    return float(latency)
