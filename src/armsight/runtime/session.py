"""A running cell: devices, map, planner, guard and a task on one clock."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Literal

import numpy as np

from armsight.arrays import Vector3
from armsight.devices.clock import WallClock
from armsight.devices.protocols import Arm, Clock, RgbdCamera
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.errors import DeviceError, LoopError, UsageError
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.perception import CameraUse, Perceiver
from armsight.motion.task import Task, perceivers_of
from armsight.runtime.channels import Channels
from armsight.runtime.component import Component
from armsight.runtime.components import (
    GuardComponent,
    MappingComponent,
    PlanningComponent,
)
from armsight.runtime.config import SessionConfig
from armsight.runtime.latency import Latency
from armsight.runtime.lock import cell_lock
from armsight.runtime.parts import MakeParts, make_parts
from armsight.runtime.perceiver_component import PerceiverComponent
from armsight.runtime.sensing import SensingComponent, Sensor, SensorTap
from armsight.runtime.shared_devices import UntouchedArm, shared_arm, shared_camera, shared_sensors
from armsight.runtime.signals import orderly_signals
from armsight.runtime.simulated_loop import SimulatedLoop
from armsight.runtime.task_component import TaskComponent
from armsight.runtime.view import ComponentHealth, SessionView
from armsight.runtime.wall_loop import WallLoop
from armsight.runtime.warm_up import Progress

if TYPE_CHECKING:
    from armsight.workcell import Cell

HEARTBEAT = 0.25
"""The arm is stopped when the guard has been silent for longer under the wall clock [s]."""


class Session:
    """Runs a task on a cell through the guard; a task never sees the arm.

    Under the simulated clock everything happens in the caller's thread, in the same order for the
    same seed. Under the wall clock each component has a thread. Whatever ends a run - its time,
    :meth:`stop`, a signal, an exception - the arm is told to stop before :meth:`run` returns.

    Args:
        cell: from :func:`armsight.workcell.open_cell`; the caller closes it.
        task: what to do, or None to watch only (the arm holds still). A session has one task.
        perceivers: that run beside those which the task brings along.
        seed: of the planner's randomness; the world has its own.
        wall: run a simulated cell under the wall clock, in threads. Real cells always are.
        observers: further components (page, recorder, experiment) that read :meth:`view`. One
            with ``attach(session)`` is given the session; a :class:`SensorTap` (the recorder) also
            sees every reading as it comes in.
        config: periods, latencies, configuration of the parts.
        exclusive: refuse to run while another process runs this cell. None: only for real arms;
            simulated ones do not get in each other's way.
        cell_is_empty: somebody has looked, and nobody is in the cell when it starts: what stands
            there is no person, see ``docs/guard.md``.
        make: builds map, planner and guard; ``replay_parts`` for a recording, doubles in tests.
        look_only: send no command to the arm at all, not even to stop.
    """

    def __init__(
        self,
        cell: Cell,
        task: Task | None,
        *,
        perceivers: Sequence[Perceiver] = (),
        seed: int = 0,
        wall: bool = False,
        observers: Sequence[Component] = (),
        config: SessionConfig | None = None,
        exclusive: bool | None = None,
        cell_is_empty: bool = False,
        make: MakeParts = make_parts,
        look_only: bool = False,
    ) -> None:
        self.cell = cell
        self.task = task
        self.perceivers = (*perceivers, *perceivers_of(task))
        self.seed = seed
        self.config = config or SessionConfig()
        self.ended_by = ""
        self._make = make
        self._colored: set[str] = set()
        self._cell_is_empty = cell_is_empty
        self._observers = list(observers)
        self._advance = _advance_of(cell)
        self._real = self._advance is None or cell.mixed
        self._wall = wall or self._real
        self._exclusive = self._real if exclusive is None else exclusive
        self._lock = threading.RLock()
        self._held = False
        self._speed = math.inf
        self._movers: tuple[MovingSolid, ...] = ()
        self._bodies: tuple[MovingSurfaces, ...] = ()
        self._loop_thread: int | None = None
        self._warm = self._begun = False
        self._loop: SimulatedLoop | WallLoop
        self._reset_wanted = False
        self._clock: Clock = cell.clock
        self._arm: Arm = cell.arm
        self._cameras: Sequence[RgbdCamera] = cell.cameras
        self._sensors: Sequence[Sensor] = cell.sensors
        if self._wall and self._advance is not None:
            # The devices of a mixed cell are dated with its own clock, which can be paused.
            clock = cell.clock if isinstance(cell.clock, WallClock) else WallClock(cell.clock.now())
            clock.pause()
            self._clock = clock
            self._arm = shared_arm(cell.arm, self._lock)
            self._cameras = [shared_camera(c, self._lock) for c in cell.cameras]
            self._sensors = shared_sensors(cell.sensors, self._lock)
        if look_only:
            self._arm = UntouchedArm(self._arm)
        self._build()

    # -- outside view ---------------------------------------------------------------------------

    @property
    def wall(self) -> bool:
        """Whether components run in threads under the wall clock."""
        return self._wall

    def now(self) -> float:
        """The session's time [s]."""
        return self._clock.now()

    @property
    def realtime_factor(self) -> float:
        """Simulated seconds a second over all runs so far; 1 under the wall clock."""
        if isinstance(self._loop, WallLoop):
            return 1.0
        wall = self._loop.wall_seconds
        return self._loop.simulated_seconds / wall if wall > 0 else 0.0

    def status(self) -> GuardStatus | None:
        """The guard's newest word alone: cheaper than :meth:`view`."""
        return self._channels.status.read(self.now())

    def snapshot(self) -> WorkspaceSnapshot | None:
        """The newest map alone."""
        return self._channels.snapshot.read(self.now())

    def view(self) -> SessionView:
        """One consistent look at everything that is published; safe from any thread."""
        now = self.now()
        channels = self._channels
        if threading.get_ident() == self._loop_thread or self._loop_thread is None:
            self._movers, self._bodies = self._read_movers()
        return SessionView(
            now=now,
            running=not self._held,
            speed=self._loop.speed if isinstance(self._loop, SimulatedLoop) else 1.0,
            joints=channels.joints.read(now),
            snapshot=channels.snapshot.read(now),
            guard=channels.status.read(now),
            frames=channels.frames.newest(),
            readings=channels.readings.all(),
            devices=self.cell.health(),
            health=self.health(),
            face=channels.face.read(now),
            movers=self._movers,
            bodies=self._bodies,
        )

    def health(self) -> tuple[ComponentHealth, ...]:
        """Health of every component."""
        reports = []
        for component in self._components:
            report = self._loop.meters[component.name].report()
            problem = report.problem or str(getattr(component, "problem", ""))
            reports.append(replace(report, problem=problem))
        return tuple(reports)

    # -- control, from any thread ---------------------------------------------------------------

    def observe(self, component: Component) -> None:
        """Add an observer before the first run or warm-up.

        Raises:
            UsageError: the session has begun already.
        """
        if self._warm or self._begun:
            raise UsageError("observers must be added before the session runs")
        self._observers.append(component)
        self._build()

    def pause(self) -> None:
        """Simulated: time stands still. Real: the arm stops and holds, the map goes on."""
        self._held = True
        if self._real:
            self._hold(True)
        else:
            self._loop.pause(True)

    def resume(self) -> None:
        """Go on after :meth:`pause`."""
        self._held = False
        self._hold(False)
        self._loop.pause(False)

    def set_speed(self, speed: float) -> None:
        """Simulated seconds a second; inf for as fast as possible. Real time has one speed.

        Raises:
            UsageError: the speed is not above zero, or the clock cannot be hurried.
        """
        if not speed > 0:
            raise UsageError(f"speed must be above 0, not {speed}; use pause() to stand still")
        if isinstance(self._loop, SimulatedLoop):
            self._speed = speed
            self._loop.set_speed(speed)
        elif speed != 1.0:
            raise UsageError("under the wall clock a second takes a second")

    def post(self, action: Callable[[], None]) -> None:
        """Let the loop's thread do something between two rounds (moving a simulated thing)."""
        self._loop.post(action)

    def drag(self, name: str, position_world: Vector3) -> None:
        """Move an object or a person's hand of a simulated cell, soon."""
        world = self.cell.world
        if world is None:
            raise UsageError("only simulated cells have things to drag")
        target = np.asarray(position_world, float).copy()

        def move() -> None:
            with self._lock:
                world.drag(name, target)

        self.post(move)

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell; ``snapshot().emptiness`` has the answer."""
        self.post(self._parts.workspace.declare_empty)

    @property
    def task_failure(self) -> str:
        """Why the task has ended for good, in words; empty while it lives or there is none."""
        return "" if self._task is None else self._task.failure

    def press(self, button: str) -> None:
        """A person pressed a button on the task's face."""
        if self._task is not None:
            self._task.press(button)

    def reset(self) -> None:
        """Back to time 0 with an empty map, soon: the same seed runs the same again.

        Raises:
            UsageError: the cell is real; its time cannot be turned back.
        """
        if self._real:
            raise UsageError("only a simulated cell can be reset")
        if self._loop_thread is None:
            self._reset()
        else:
            self._reset_wanted = True
            self._loop.stop()

    def stop(self, why: str = "stop") -> None:
        """End the run soon, arm stopped; from any thread or signal handler."""
        self.ended_by = self.ended_by or why
        self._loop.stop()

    # -- running --------------------------------------------------------------------------------

    def warm_up(self, progress: Progress = lambda stage, done: None) -> None:
        """Compile and touch everything before the arm may move (several seconds the first time).

        Done by :meth:`run` where time runs by itself. A simulated clock waits for whatever takes
        long, so there it only spares a page or a measurement the slow beginning.

        Args:
            progress: told the stage and the share done, 0..1.
        """
        if not self._warm:
            self._parts.warm_up(progress)
            self._warm = True
        progress("ready", 1.0)

    def run(self, seconds: float | None = None) -> None:
        """Run for a time on the session's clock [s], or until stopped.

        Raises:
            LoopError: a component failed; the arm was stopped.
            CellBusyError: another process runs this cell.
        """
        self.ended_by = ""
        self._begun = True
        with contextlib.ExitStack() as stack:
            if self._exclusive:
                stack.enter_context(cell_lock(self.cell.workcell.name))
            if self._wall:
                self.warm_up()
            stack.callback(setattr, self, "_loop_thread", None)
            self._loop_thread = threading.get_ident()
            stack.enter_context(orderly_signals(self.stop))
            stack.push(self._stop_at_end)  # runs first on the way out, whatever the way
            stack.enter_context(self._clock_running())
            self._loop.run(None if seconds is None else self.now() + seconds)
            while self._reset_wanted and not self.ended_by:
                self._arm.stop()
                self._reset()
                self._loop.run(seconds)
            self.ended_by = self.ended_by or "time"

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop("closed")
        self._stop_at_end(kind, error, trace)

    # -- inside ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _clock_running(self) -> Iterator[None]:
        """A clock of our own (simulated cell, wall clock) stands still between runs."""
        clock = self._clock
        if not isinstance(clock, WallClock) or self._advance is None:
            yield
            return
        if not self._held:
            clock.resume()
        try:
            yield
        finally:
            clock.pause()

    def _build(self) -> None:
        """Make fresh parts, components and loop."""
        config = self.config
        charge: Literal["declared", "measured", "real"] = "real" if self._wall else config.charge
        self._channels = channels = Channels()
        self._parts = parts = self._make(self.cell, config)
        if self._cell_is_empty:
            parts.workspace.declare_empty()
        sensing = SensingComponent(
            channels, self._arm, self._cameras, self._sensors, config.sensing_period
        )
        sensing.taps = [o for o in self._observers if isinstance(o, SensorTap)]
        for observer in self._observers:
            if hasattr(observer, "attach"):
                observer.attach(self)
        mapping = MappingComponent(
            channels,
            parts.workspace,
            Latency(config.mapping_latency, charge),
            config.mapping_period,
        )
        planning = PlanningComponent(
            channels,
            parts.planner,
            Latency(config.planning_latency, charge),
            self.seed,
            config.planning_time,
            config.planning_period,
        )
        perceivers = self._make_perceivers(lambda seconds: Latency(seconds, charge))
        self._task = self._make_task(perceivers, lambda seconds: Latency(seconds, charge))
        self._guard = GuardComponent(
            channels,
            parts.guard,
            self._arm,
            self._task.intent if self._task is not None else lambda now: None,
            Latency(config.guard_latency, charge),
            config.guard_period,
        )
        foreign: list[PerceiverComponent | TaskComponent] = [*perceivers]
        if self._task is not None:
            foreign.append(self._task)
        self._components: list[Component] = [
            sensing,
            mapping,
            planning,
            *foreign,
            self._guard,
            *self._observers,
        ]
        if self._wall:
            self._loop = WallLoop(self._clock, self._components, self._supervise, self._arm.stop)
        else:
            assert self._advance is not None
            self._loop = SimulatedLoop(
                self.cell.clock.now, self._advance, self._components, self._speed
            )
        loop = self._loop
        sensing.on_frames = lambda at: loop.wake("mapping", at)
        sensing.on_pictures = lambda at: self._wake_perceivers(perceivers, at)
        mapping.on_snapshot = planning.on_plan = self._wake_guard
        self._guard.on_request = lambda at: loop.wake("planning", at)
        for part in foreign:
            part.on_seconds = loop.meters[part.name].more
            if not self._wall:
                part.call_at = loop.call_at
        self._want_pictures()
        if self._task is not None:
            self._task.on_subscriptions = self._want_pictures
        if not self._wall:
            self._guard.call_at = loop.call_at
        if isinstance(loop, SimulatedLoop) and charge == "declared":
            mapping.beside = planning.beside = loop.beside
        self._hold(self._held and self._real)
        if self._held and not self._real:
            self._loop.pause(True)

    def _make_perceivers(self, charge: Callable[[float], Latency]) -> list[PerceiverComponent]:
        infos = {c.info.name: c.info for c in self._cameras}
        names = [p.name for p in self.perceivers]
        if len(set(names)) < len(names):
            raise UsageError(f"two perceivers have the same name: {', '.join(sorted(names))}")
        made = [
            PerceiverComponent(
                p, self.cell.robot, infos, self._channels.history, charge, self.config.patience
            )
            for p in self.perceivers
        ]
        self._channels.frames.readers += [p.frames for p in made]
        return made

    def _make_task(
        self, perceivers: Sequence[PerceiverComponent], charge: Callable[[float], Latency]
    ) -> TaskComponent | None:
        if self.task is None:
            return None
        infos = {c.info.name: c.info for c in self._cameras}
        made = TaskComponent(
            self.task,
            self._channels,
            self.cell.robot,
            infos,
            perceivers,
            charge,
            self.config.patience,
        )
        self._channels.frames.readers.append(made.frames)
        wanted = self.task.subscriptions.perceivers
        for perceiver in perceivers:
            if perceiver.perceiver.name in wanted:
                perceiver.on_result = lambda at: self._loop.wake(made.name, at)
        return made

    def _wake_perceivers(self, perceivers: Sequence[PerceiverComponent], at: float) -> None:
        for perceiver in perceivers:
            if perceiver.frames.waiting:
                self._loop.wake(perceiver.name, at)

    def _wake_guard(self, at: float) -> None:
        """A round of the guard beside its period; a task that wants the map is asked before."""
        if self._task is not None and self._task.task.subscriptions.snapshot:
            self._loop.wake(self._task.name, at)
        self._loop.wake("guard", at)

    def _want_pictures(self) -> None:
        """Ask each camera for as much colour as its subscribers want together, and each pair.

        One that is no evidence for the guard, and that nobody looks at, may stand by.

        Raises:
            UsageError: the task wants a pair that is not in the cell.
        """
        if self.task is not None:
            pairs = {pair.info.name: pair for pair in self.cell.stereo}
            for name in self.task.subscriptions.stereo:
                if name not in pairs:
                    known = ", ".join(sorted(pairs)) or "none"
                    raise UsageError(
                        f"task {self.task.name}: no stereo pair '{name}' in this cell; there are: "
                        f"{known}"
                    )
                with self._lock:
                    pairs[name].want_pictures(True)
        uses: list[CameraUse] = [u for p in self.perceivers for u in p.cameras]
        if self.task is not None:
            uses += self.task.subscriptions.cameras
        for camera in self._cameras:
            mine = [u for u in uses if u.camera in ("", camera.info.name)]
            those = [u for u in mine if u.color_rate > 0]
            if those or camera.info.name in self._colored:
                camera.want_color(
                    max((u.color_rate for u in those), default=0.0),
                    max((u.color_scale for u in those), default=1.0),
                )
                self._colored.add(camera.info.name)
            if hasattr(camera, "want_infrared"):
                camera.want_infrared(any(u.infrared for u in those))
            if hasattr(camera, "stand_by"):
                camera.stand_by(not mine and not camera.info.guard)

    def _hold(self, held: bool) -> None:
        """Real time: the arm holds still and the task is not asked."""
        self._guard.held = held
        if self._task is not None:
            self._task.held = held

    def _reset(self) -> None:
        self._reset_wanted = False
        world = self.cell.world
        assert world is not None
        world.reset()
        if isinstance(self._clock, WallClock):
            self._clock.restart()
        for part in (self.task, *self.perceivers):
            if hasattr(part, "reset"):
                part.reset()
        self._build()

    def _stop_at_end(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Tell the arm to stop; an arm that cannot be told is an error beside the run's own."""
        try:
            self._arm.stop()
        except DeviceError as second:
            if error is None:
                raise
            if str(second) not in str(error):
                raise LoopError(f"{error}; moreover {second}") from error

    def _supervise(self) -> None:
        """Under the wall clock: move a simulated world along, and watch the guard's heart."""
        now = self.now()
        if self._advance is not None:
            joints = self._channels.joints.read(now)
            with self._lock:
                if self.cell.show_joints is not None and joints is not None:
                    self.cell.show_joints(joints.position)
                self._advance(now)
        last = self._loop.meters["guard"].report().last
        if math.isfinite(last) and now - last > HEARTBEAT:
            try:
                self._arm.stop()
            except DeviceError:  # it is told again, and heard, when the run has ended
                self._loop.stop()

    def _read_movers(self) -> tuple[tuple[MovingSolid, ...], tuple[MovingSurfaces, ...]]:
        world = self.cell.world
        if world is None:
            return (), ()
        with self._lock:
            return world.movers(), world.bodies()


def _advance_of(cell: Cell) -> Callable[[float], None] | None:
    """What moves the cell's own clock, or None for a cell in real time."""
    if cell.world is not None:
        return cell.world.advance
    advance: Callable[[float], None] | None = getattr(cell.clock, "advance", None)
    return advance
