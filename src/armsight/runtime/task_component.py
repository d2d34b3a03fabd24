"""The task in the loop: one observation in, one intent out, at its own pace, beside the guard."""

from __future__ import annotations

import math
import queue
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from armsight.devices.data import (
    ArmStatus,
    GripperState,
    JointState,
    RgbdCameraInfo,
    StereoFrame,
    Wrench,
)
from armsight.errors import UsageError
from armsight.geometry.shapes import Solid
from armsight.motion.face import Curve, ShownFace, Trace, face_fault
from armsight.motion.intents import Intent
from armsight.motion.task import Observation, Perceived, Task
from armsight.robots.robot import Robot
from armsight.runtime.channels import Channels, TaskWord, pursued
from armsight.runtime.foreign import ForeignThread, Outcome
from armsight.runtime.latency import Latency
from armsight.runtime.perceiver_component import (
    PerceiverComponent,
    checked_latency,
    checked_period,
)
from armsight.runtime.posing import NewestFrames, posed

Reading = TypeVar("Reading", JointState, Wrench)

LATENCY = 0.002
"""What a round is charged if the task does not say [s]."""
SILENT = 0.25
"""A task is not taken at its word any more when it has said nothing for so long [s] ..."""
ROUNDS = 3.0
"""... and for so many of its periods and latencies, for one that is slow by design."""
GRIP_AGAIN = 0.5
"""A gripper that did not take a width is told it again after this time [s]."""
FACE_PERIOD = 0.05
"""Seconds between two looks at the task's face [s]."""
TRACE_SECONDS = 30.0
"""How long the past of a curve is kept [s]."""


class TaskComponent:
    """Runs one task. It raises nothing: a task that fails ends, and the arm comes to rest.

    Attributes:
        problem: what is wrong, in words; empty when all is well.
        failure: why the task has ended for good, in words; empty while it lives.
        held: the task is not asked while this is true.
        wanted: what it subscribed to in its last round.
        on_seconds: told how long a round computed beside the loop [s].
        on_subscriptions: told when the task wants other cameras than before.
        on_width: moves the gripper to a width [m]; None in a cell without one.
        on_standing: told what the task says stands in the cell (in ``base``); none: no more.
        call_at: the simulated loop's; None under the wall clock, where a round takes its time.

    Args:
        task: somebody else's; it may raise and hang.
        channels: of the session.
        robot: the arm; cameras: of the cell, by name.
        perceivers: of the session.
        charge: how compute time is charged, see :class:`Latency`.
        patience: a call that takes longer on the wall clock [s] is given up.

    Raises:
        UsageError: its period, its latency or what it subscribes to is not possible.
    """

    def __init__(
        self,
        task: Task,
        channels: Channels,
        robot: Robot,
        cameras: Mapping[str, RgbdCameraInfo],
        perceivers: Sequence[PerceiverComponent],
        charge: Callable[[float], Latency],
        patience: float,
    ) -> None:
        self.name = f"task/{task.name}"
        self.period = checked_period(f"task {task.name}", task)
        self.charge = 0.0
        self.problem = ""
        self.failure = ""
        self.held = False
        self.on_seconds: Callable[[float], None] = lambda seconds: None
        self.call_at: Callable[[float, Callable[[], None]], None] | None = None
        self.task = task
        self.wanted = task.subscriptions
        self._uses = task.subscriptions.cameras
        self._pairs = task.subscriptions.stereo
        self.frames = NewestFrames(self._uses)
        self.on_subscriptions: Callable[[], None] = lambda: None
        self.on_width: Callable[[float], None] | None = None
        self.on_standing: Callable[[str, Sequence[Solid]], None] = lambda name, solids: None
        self._channels, self._robot, self._cameras = channels, robot, cameras
        self._perceivers = [
            _of_name(name, task, perceivers) for name in sorted(set(task.subscriptions.perceivers))
        ]
        self._latency = charge(checked_latency(f"task {task.name}", task, LATENCY))
        self._thread = ForeignThread(self.name, patience)
        self._pressed: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._face_due = -math.inf
        self._width: float | None = None
        self._tried, self._grip_due = math.nan, -math.inf
        self._faults: dict[str, str] = {}
        self._standing: dict[str, Sequence[Solid]] = {}
        self._past: dict[tuple[str, str], deque[tuple[float, float]]] = {}
        for use in task.subscriptions.cameras:
            if use.camera and use.camera not in cameras:
                known = ", ".join(sorted(cameras)) or "none"
                raise UsageError(
                    f"task {task.name}: no camera '{use.camera}' in this cell; there are: {known}"
                )

    @property
    def silent_after(self) -> float:
        """When its word has become too old to be taken [s]."""
        return max(SILENT, ROUNDS * (self.period + self._latency.declared))

    def press(self, button: str) -> None:
        """A person pressed a button of the task's face; from any thread."""
        self._pressed.put(button)

    def intent(self, now: float) -> Intent | None:
        """What the guard is to pursue at ``now`` [s]: the task's word, or rest with the reason."""
        if self.held:
            return None
        return pursued(self._channels.word.read(now), now, self.task.name, self.silent_after)

    def update(self, now: float) -> None:
        """Begin a round."""
        self.charge = 0.0
        if self.failure or self.held:
            return
        observation = self._observe(now)
        pressed = self._take_pressed()
        shown = now >= self._face_due - 1e-9
        if shown:
            self._face_due = now + FACE_PERIOD
        wait = self._thread.begin(lambda: self._round(observation, pressed, shown))
        if (
            self.call_at is not None
            and self._latency.charge == "declared"
            and self._latency.declared
        ):
            self.charge = self._latency.declared
            at = now + self.charge

            def finish() -> None:
                outcome = wait()
                self.on_seconds(outcome.seconds)
                self._finish(outcome, now, at)

            self.call_at(at, finish)
            return
        outcome = wait()
        self.charge = self._latency.of(outcome.seconds)
        self._finish(outcome, now, now + self.charge)

    def _round(
        self, observation: Observation, pressed: Sequence[str], shown: bool
    ) -> tuple[Any, Any, Any, Any]:
        """One round in the task's own thread: buttons, what it wants, its face, what it says."""
        for button in pressed:
            self.task.press(button)  # type: ignore[attr-defined]
        wanted = self.task.update(observation)
        face = getattr(self.task, "face", None)
        standing = getattr(self.task, "standing", {})
        shows = face() if shown and face is not None else None
        return wanted, shows, standing, self.task.subscriptions

    def _finish(self, outcome: Outcome[tuple[Any, Any, Any, Any]], began: float, at: float) -> None:
        if outcome.value is None:
            self._end(outcome.fault, began, at)
            return
        wanted, face, standing, subscribed = outcome.value
        try:
            self._subscribe(subscribed)
        except Exception as error:  # whatever a stranger's subscriptions are
            self._end(f"its subscriptions: {error}", began, at)
            return
        self._channels.word.publish(TaskWord(began, wanted), at)
        self._grip(wanted, began)
        self._declare(standing)
        if face is not None:
            self._show(face, began, at)

    def _end(self, fault: str, began: float, at: float) -> None:
        """The task has failed: its last word is why."""
        self.failure = self.problem = f"task {self.task.name} failed: {fault}"
        self._channels.word.publish(TaskWord(began, None, self.failure), at)

    def _subscribe(self, wanted: Any) -> None:
        """Take over what the task wants to see in the next round."""
        uses, pairs, _ = wanted.cameras, wanted.stereo, wanted.snapshot
        self.wanted = wanted
        if uses != self._uses:
            self.frames.use(uses)
        if (uses, pairs) != (self._uses, self._pairs):
            self._uses, self._pairs = uses, pairs
            self.on_subscriptions()

    def _grip(self, wanted: Any, now: float) -> None:
        """Move the gripper to what an intent asks for, once; one that did not take it, again."""
        try:
            width = getattr(wanted, "width", None)
            if width is None or self.on_width is None:
                return
            width = float(width)
            if width == self._width or (width == self._tried and now < self._grip_due):
                return
            self._tried, self._grip_due = width, now + GRIP_AGAIN
            self.on_width(width)
        except Exception as error:  # whatever a stranger's width is
            self._say("gripper", f"gripper: {error}")
        else:
            self._width = width
            self._say("gripper", "")

    def _declare(self, standing: Mapping[str, Sequence[Solid]]) -> None:
        """Pass on what the task says stands in the cell, where that has changed."""
        try:
            gone = [n for n, s in self._standing.items() if standing.get(n) is not s]
            for name in gone:
                del self._standing[name]
                self.on_standing(name, ())
            come = [n for n in standing if n not in self._standing]
            for name in come:
                self._standing[name] = standing[name]
                self.on_standing(name, standing[name])
        except Exception as error:  # whatever a stranger's solids are
            self._say("standing", f"what stands in the cell: {error}")
        else:
            if gone or come:
                self._say("standing", "")

    def _say(self, what: str, words: str) -> None:
        """Note what is wrong of one kind; empty when it is well again."""
        self._faults[what] = words
        self.problem = "; ".join(f"task {self.task.name}: {w}" for w in self._faults.values() if w)

    def _show(self, face: Any, now: float, at: float) -> None:
        fault = face_fault(face)
        self._say("face", fault)
        if not fault:
            traces = tuple(self._trace(curve, now) for curve in face.curves)
            self._channels.face.publish(ShownFace(self.task.name, now, face, traces), at)

    def _trace(self, curve: Curve, now: float) -> Trace:
        past = self._past.setdefault((curve.name, curve.unit), deque())
        past.append((now, float(curve.value)))
        while past[0][0] < now - TRACE_SECONDS:
            past.popleft()
        times, values = np.array(past).T
        return Trace(curve.name, curve.unit, times, values)

    def _observe(self, now: float) -> Observation:
        channels, wanted = self._channels, self.wanted
        pairs = [channels.readings.newest(StereoFrame, name) for name in wanted.stereo]
        frames = [
            posed(f, self._cameras[f.camera], self._robot, channels.history)
            for f in self.frames.newest()
            if f.camera in self._cameras
        ]
        found = [(p.perceiver.name, p.newest.read(now)) for p in self._perceivers]
        return Observation(
            now=now,
            robot=self._robot,
            joints=_own(channels.joints.read(now)),
            guard=channels.status.read(now),
            snapshot=channels.snapshot.read(now) if wanted.snapshot else None,
            wrench=_own(channels.readings.newest(Wrench)),
            gripper=channels.readings.newest(GripperState),
            arm=channels.readings.newest(ArmStatus),
            frames=tuple(frames),
            pairs=tuple(pair for pair in pairs if pair is not None),
            perceived=tuple(Perceived(name, e) for name, e in found if e is not None),
        )

    def _take_pressed(self) -> list[str]:
        names = []
        while not self._pressed.empty():
            names.append(self._pressed.get())
        return names if hasattr(self.task, "press") else []


def _own(reading: Reading | None) -> Reading | None:
    """A reading with arrays of its own: what a task does to them reaches neither map nor guard."""
    if reading is None:
        return None
    found = {f.name: getattr(reading, f.name) for f in fields(reading)}
    arrays: dict[str, Any] = {k: v.copy() for k, v in found.items() if isinstance(v, np.ndarray)}
    return replace(reading, **arrays)


def _of_name(name: str, task: Task, perceivers: Sequence[PerceiverComponent]) -> PerceiverComponent:
    for component in perceivers:
        if component.perceiver.name == name:
            return component
    known = ", ".join(sorted(p.perceiver.name for p in perceivers)) or "none"
    raise UsageError(
        f"task {task.name}: no perceiver '{name}' runs in this session; there are: {known}"
    )
