"""Three working parts of every session: mapping, planning, and the guard.

They wrap the pure objects of ``mapping`` and ``motion``; only here do these meet time and threads.
A round's compute time is charged to the simulated clock, either as declared or as measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from armsight.arrays import Points
from armsight.devices.data import DeclaredSolids, JointState, RgbdCameraInfo, RgbdFrame, Wrench
from armsight.devices.history import JointHistory
from armsight.devices.protocols import Arm
from armsight.errors import ArmsightError, DeviceError
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.mapping.tracked import TrackedRegion
from armsight.motion.intents import Intent
from armsight.motion.perception import SeenRobot
from armsight.runtime.channels import Channels
from armsight.runtime.latency import Latency
from armsight.runtime.slot import Slot
from armsight.runtime.wall_loop import HEARTBEAT

if TYPE_CHECKING:
    from armsight.motion.perception import Evidence
    from armsight.motion.permits import Permit
    from armsight.motion.plan import Plan, Planner
    from armsight.motion.tick import GuardDecision


class Maps(Protocol):
    """What :class:`MappingComponent` needs of a map."""

    def update(
        self,
        frames: Sequence[RgbdFrame],
        joints: JointHistory,
        now: float,
        tracked: TrackedRegion | None = None,
    ) -> WorkspaceSnapshot:
        """Take in frames and say what the workspace looks like; ``tracked`` is to be touched."""
        ...

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell."""
        ...

    def exclude(self, camera: str, reason: str) -> None:
        """Somebody knows that a camera was moved: nothing counts any more that it says."""
        ...

    def place(self, info: RgbdCameraInfo) -> None:
        """Somebody has calibrated a camera again: it counts from now on, from its new place."""
        ...

    def animate(self, points: Points) -> None:
        """Somebody knows that what is at (k, 3) points may move by itself, however still it is."""
        ...

    def told(self, word: DeclaredSolids) -> None:
        """Somebody declares or withdraws solids; raises UsageError for what cannot be."""
        ...


class Guards(Protocol):
    """What :class:`GuardComponent` needs of a guard."""

    def step(
        self,
        now: float,
        joints: JointState | None,
        snapshot: WorkspaceSnapshot | None,
        intent: Intent | None,
        plan: Plan | None,
    ) -> GuardDecision:
        """One tick: the command, the state, and perhaps a request to the planner."""
        ...


@runtime_checkable
class Feels(Protocol):
    """A guard that looks at every reading of the force sensor."""

    def feel(self, readings: Sequence[Wrench]) -> None:
        """What came since the last tick, oldest first; judged in the next one."""
        ...


class Beside(Protocol):
    """Computes something beside the loop; see :meth:`SimulatedLoop.beside`."""

    def __call__(
        self, name: str, at: float, job: Callable[[], Any], then: Callable[[Any], None]
    ) -> None:
        """Begin ``job`` now; call ``then`` with its result when the clock says ``at`` [s]."""
        ...


def _compute(
    component: MappingComponent | PlanningComponent,
    now: float,
    latency: Latency,
    job: Callable[[], Any],
    publish: Callable[[Any, float], None],
) -> float:
    """Do a round's computing, beside the loop or at once; returns what it is charged [s]."""
    if component.beside is not None:
        at = now + latency.declared
        component.beside(component.name, at, job, lambda result: publish(result, at))
        return latency.declared
    began = time.perf_counter()
    result = job()
    charge = latency.of(time.perf_counter() - began)
    publish(result, now + charge)
    return charge


REFUSED = 0.8
"""A camera whose pictures have been refused for so long may have been moved [s]."""
ALIVE = 1.0
"""That somebody's hand or face is no thing is said so often while a task asks to touch it [s]."""
AROUND = np.stack(np.meshgrid(*[(-0.02, 0.0, 0.02)] * 3), axis=-1).reshape(-1, 3)
"""(27, 3) points of its middle, from that [m]: of a surface in it four voxels and more."""


def _nothing(_at: float) -> None:
    """Default of the hooks that the session wires."""


def _at_once(_at: float, action: Callable[[], None]) -> None:
    action()


class MappingComponent:
    """Updates the map on every frame, and without frames often enough to notice their absence.

    Attributes:
        beside: computes beside the loop, where the compute time is declared; None in its turn.
        judges: newest observations of the perceivers; a camera that one of them excludes is
            evidence no more (``excluded``, see :class:`~armsight.motion.perception.Perceiver`), one
            that it ``placed`` is so again.
        on_doubted: told of a camera that is evidence no more, and whether it is excluded; if not,
            its pictures have been refused for :data:`REFUSED`. on_placed: of one that was placed.
    """

    name = "mapping"

    def __init__(
        self,
        channels: Channels,
        workspace: Maps,
        latency: Latency,
        period: float = 0.02,
    ) -> None:
        self.period = period
        self.charge = 0.0
        self.problem = ""
        self.on_snapshot: Callable[[float], None] = _nothing
        self.beside: Beside | None = None
        self._channels = channels
        self._workspace = workspace
        self._latency = latency
        self._updated = float("-inf")
        self.judges: tuple[Slot[Evidence], ...] = ()
        self.on_doubted: Callable[[str, bool], None] = lambda camera, excluded: None
        self.on_placed: Callable[[RgbdCameraInfo], None] = lambda info: None
        self._doubted: dict[str, float] = {}
        self._placed: dict[str, RgbdCameraInfo] = {}
        self._answered: set[tuple[str, str]] = set()
        self._robots: tuple[SeenRobot, ...] = ()
        self._animated = -np.inf

    def update(self, now: float) -> None:
        """Take the waiting frames into the map and publish a snapshot."""
        frames = self._channels.frames.take()
        self.charge = 0.0
        self._hear(now)
        if not frames and now < self._updated + self.period:
            return
        self._updated = now
        history: JointHistory = self._channels.history
        self._tell_alive(now)
        tracked = self._tracked(now)
        if not frames:  # it only ages the cameras' health: next to nothing to compute
            found = self._map(frames, history, now, tracked)
            if isinstance(found, str):
                self.problem = found
            else:
                self._channels.snapshot.publish(found, now)
            return
        if self.beside is not None:  # the loop goes on reading joints meanwhile
            history = history.copy()
        self.charge = _compute(
            self,
            now,
            self._latency,
            lambda: self._map(frames, history, now, tracked),
            self._publish,
        )

    def _map(
        self,
        frames: Sequence[RgbdFrame],
        history: JointHistory,
        now: float,
        tracked: TrackedRegion | None,
    ) -> WorkspaceSnapshot | str:
        """What the map finds; what it fails of, in words: the guard stops when no map comes."""
        try:
            return self._workspace.update(frames, history, now, tracked)
        except ArmsightError as error:
            return str(error)

    def _hear(self, now: float) -> None:
        """What the perceivers say of the cameras, and of other arms."""
        said = [word for word in (judge.read(now) for judge in self.judges) if word is not None]
        blamed = [pair for word in said for pair in getattr(word, "excluded", ())]
        for info in (info for word in said for info in getattr(word, "placed", ())):
            if self._placed.get(info.name) is not info:
                self._placed[info.name] = info
                # What was said against its old place is answered; whoever says it goes on saying.
                self._answered |= {pair for pair in blamed if pair[0] == info.name}
                self._workspace.place(info)
                self.on_placed(info)
        robots = tuple(seen for word in said for seen in getattr(word, "robots", ()))
        for seen in robots:
            if seen not in self._robots:
                self._workspace.animate(seen.points)
        if robots != self._robots:
            self._robots = robots
            self._channels.robots.publish(robots, now)
        for camera, reason in blamed:
            if (camera, reason) not in self._answered:
                self._workspace.exclude(camera, reason)

    def _tracked(self, now: float) -> TrackedRegion | None:
        """Where the thing is that a task asks to touch."""
        permit = self._asked(now)
        return None if permit is None or permit.kind != "thing" else permit.region

    def _tell_alive(self, now: float) -> None:
        """What a task asks to touch as a part of somebody is no thing."""
        permit = self._asked(now)
        if permit is None or permit.kind == "thing" or permit.region is None:
            return
        if not self._animated <= now < self._animated + ALIVE:
            self._animated = now
            self._workspace.animate(permit.region.center(now) + AROUND)

    def _asked(self, now: float) -> Permit | None:
        """The guard's newest answer to what a task asks to touch."""
        status = self._channels.status.read(now)
        return None if status is None else status.permit

    def _publish(self, snapshot: WorkspaceSnapshot | str, visible_at: float) -> None:
        if isinstance(snapshot, str):
            self.problem = snapshot
            return
        wrong = [f"camera {c.name} {c.reason}" for c in snapshot.cameras if c.excluded]
        self.problem = "; ".join([*wrong, *map(str, snapshot.inside)])
        self._tell_doubts(snapshot, visible_at)
        self._channels.snapshot.publish(snapshot, visible_at)
        self.on_snapshot(visible_at)

    def _tell_doubts(self, snapshot: WorkspaceSnapshot, now: float) -> None:
        """Tell once of each camera that does not count."""
        since = self._doubted
        doubts = {c.name: c for c in snapshot.cameras if c.excluded or (c.reason and not c.alive)}
        self._doubted = {name: since.get(name, now) for name in doubts}
        for name, camera in doubts.items():
            begun = self._doubted[name]
            if camera.excluded or now - begun >= REFUSED:
                self._doubted[name] = float("inf")
                if np.isfinite(begun):
                    self.on_doubted(name, camera.excluded)


class PlanningComponent:
    """Answers the newest request with a plan, on the newest snapshot.

    Attributes:
        beside: as in :class:`MappingComponent`.
    """

    name = "planning"

    def __init__(
        self,
        channels: Channels,
        planner: Planner,
        latency: Latency,
        seed: int,
        time_limit: float,
        period: float = 0.01,
    ) -> None:
        self.period = period
        self.charge = 0.0
        self.on_plan: Callable[[float], None] = _nothing
        self.beside: Beside | None = None
        self._channels = channels
        self._planner = planner
        self._latency = latency
        self._seed = seed
        self._time_limit = time_limit
        self._answered = -1

    def update(self, now: float) -> None:
        """Plan if there is a request that was not answered yet."""
        self.charge = 0.0
        request = self._channels.request.read(now)
        snapshot = self._channels.snapshot.read(now)
        if request is None or snapshot is None or request.sequence <= self._answered:
            return
        self._answered = request.sequence
        rng = np.random.default_rng((self._seed, request.sequence))
        self.charge = _compute(
            self,
            now,
            self._latency,
            lambda: self._planner.plan(
                request, request.surroundings(snapshot), self._time_limit, rng
            ),
            self._publish,
        )

    def _publish(self, plan: Plan, visible_at: float) -> None:
        self._channels.plan.publish(plan, visible_at)
        self.on_plan(visible_at)


class GuardComponent:
    """Ticks the guard and alone commands the arm.

    Attributes:
        held: nothing is pursued while this is true; the arm comes to rest and holds.
        ended: nothing is commanded any more, see :meth:`halt`.
    """

    name = "guard"

    def __init__(
        self,
        channels: Channels,
        guard: Guards,
        arm: Arm,
        intent: Callable[[float], Intent | None],
        latency: Latency,
        period: float = 0.008,
    ) -> None:
        self.period = period
        self.charge = 0.0
        self.problem = ""
        self.held = self.ended = False
        self.on_request: Callable[[float], None] = _nothing
        self.call_at: Callable[[float, Callable[[], None]], None] = _at_once
        self._channels = channels
        self._guard = guard
        self._arm = arm
        self._intent = intent
        self._latency = latency

    def halt(self) -> None:
        """End commanding, and tell the arm to stop: nothing that is decided later reaches it.

        Raises:
            DeviceError: the arm cannot be told.
        """
        self.ended = True
        self._arm.stop()

    def update(self, now: float) -> None:
        """Read what is wanted, step the guard, command the arm, publish the status."""
        if self.ended:
            return
        began = time.perf_counter()
        channels = self._channels
        felt = channels.readings.take_wrenches()
        if felt and isinstance(self._guard, Feels):
            self._guard.feel(felt)
        decision = self._guard.step(
            now,
            channels.joints.read(now),
            channels.snapshot.read(now),
            None if self.held else self._intent(now),
            channels.plan.read(now),
        )
        seconds = time.perf_counter() - began
        late = ""
        if self._latency.charge == "real" and seconds > HEARTBEAT:  # the arm was stopped meanwhile
            late = f"the guard took {seconds:.2f} s; what it decided is too old to be sent"
        delay = self._latency.of(seconds)
        timings = (*decision.status.timings, ("guard", seconds))
        self.call_at(now + delay, lambda: self._send(decision, late, timings, now + delay))

    def _send(
        self,
        decision: GuardDecision,
        late: str,
        timings: tuple[tuple[str, float], ...],
        at: float,
    ) -> None:
        if self.ended:
            return
        status = replace(decision.status, reason=late) if late else decision.status
        try:
            if decision.brake or late:
                self._arm.stop()
                sent = np.zeros_like(decision.command)
            else:
                sent = self._arm.command_velocity(decision.command)
            self.problem = ""
        except DeviceError as error:
            self.problem = str(error)
            try:
                self._arm.stop()
            except DeviceError as second:
                if str(second) != str(error):
                    raise DeviceError(f"{error}; moreover {second}") from error
                raise
            sent = np.zeros_like(decision.command)
            status = replace(status, reason=self.problem)
        if self._over():  # meanwhile: nobody knows which of the two the arm heard last
            self._arm.stop()
        self._channels.status.publish(replace(status, command=sent, timings=timings), at)
        if decision.request is not None:
            self._channels.request.publish(decision.request, at)
            self.on_request(at)

    def _over(self) -> bool:
        """Another thread may have ended it since we looked."""
        return self.ended
