"""A running cell: devices, map, planner, guard and a task on one clock."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.arrays import Vector3
from armsight.devices.data import DeclaredSolids, EmptyCell
from armsight.devices.world import MovingSolid, MovingSurfaces
from armsight.errors import ArmsightError, DeviceError, LoopError, UsageError
from armsight.geometry.pose import inverse
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.motion.data import GuardStatus
from armsight.motion.perception import Perceiver
from armsight.motion.task import Task, perceivers_of
from armsight.runtime.assembly import Wanted, assemble
from armsight.runtime.command_relay import CommandRelay
from armsight.runtime.component import Component
from armsight.runtime.components import GuardComponent
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.empty_switch import EmptySwitch
from armsight.runtime.parts import MakeParts, make_parts
from armsight.runtime.priority import favoured
from armsight.runtime.session_devices import SessionDevices
from armsight.runtime.signals import orderly_signals
from armsight.runtime.simulated_loop import SimulatedLoop
from armsight.runtime.view import ComponentHealth, SessionView
from armsight.runtime.wall_loop import WallLoop, watch_heart
from armsight.runtime.warm_up import Progress

if TYPE_CHECKING:
    from armsight.workcell import Cell


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
        observers: further components (page, recorder, experiment) that read :meth:`view`. One
            with ``attach(session)`` is given the session; a :class:`SensorTap` (the recorder) also
            sees every reading as it comes in.
        config: periods, latencies, configuration of the parts.
        mode: real time or not, alone or not, looking only or not.
        make: builds map, planner and guard; ``replay_parts`` for a recording, doubles in tests.
    """

    def __init__(
        self,
        cell: Cell,
        task: Task | None,
        *,
        perceivers: Sequence[Perceiver] = (),
        seed: int = 0,
        observers: Sequence[Component] = (),
        config: SessionConfig | None = None,
        mode: SessionMode | None = None,
        make: MakeParts = make_parts,
    ) -> None:
        self.cell = cell
        self.task = task
        self.perceivers = (*perceivers, *perceivers_of(task))
        self.seed = seed
        self.config = config or SessionConfig()
        self.ended_by = ""
        self.recording_failure = ""
        self._make = make
        self._mode = mode or SessionMode()
        self._observers = list(observers)
        self._devices = SessionDevices(cell, self._mode)
        self._held = False
        self._speed = math.inf
        self._movers: tuple[MovingSolid, ...] = ()
        self._bodies: tuple[MovingSurfaces, ...] = ()
        self._loop_thread: int | None = None
        self._warm = self._begun = False
        self._loop: SimulatedLoop | WallLoop
        self._reset_wanted = False
        self._build()

    # -- outside view ---------------------------------------------------------------------------

    @property
    def wall(self) -> bool:
        """Whether components run in threads under the wall clock."""
        return self._devices.wall

    def now(self) -> float:
        """The session's time [s]."""
        return self._devices.clock.now()

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
            self._movers, self._bodies = self._devices.movers()
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
            robots=channels.robots.read(now) or (),
        )

    def health(self) -> tuple[ComponentHealth, ...]:
        """Health of every component."""
        reports = []
        for component in self._components:
            report = self._loop.meters[component.name].report()
            if isinstance(component, CommandRelay):  # of the guard itself, not of who passes it on
                report = component.report() or report
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
        if self._devices.real:
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
            with self._devices.lock:
                world.drag(name, target)

        self.post(move)

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell; ``snapshot().emptiness`` has the answer."""
        self.post(self._declare_empty)

    def declare_solids(self, name: str, solids: Sequence[Solid]) -> None:
        """Somebody says that solids (in world) stand in the cell from now on: a parked car.

        The cameras look first; ``snapshot().declared`` has the answer. In a real cell call it from
        a thread that may wait a moment, not from one of the loop's.

        Raises:
            UsageError: the name is taken, or a solid cannot be.
        """
        T_base_world = inverse(self.cell.T_world_base)
        placed = tuple(replace(s, T_frame_solid=T_base_world @ s.T_frame_solid) for s in solids)
        self._tell_solids(DeclaredSolids(self.now(), name, placed))

    def withdraw_solids(self, name: str) -> None:
        """They do not stand there any more: whatever does may be a person.

        Raises:
            UsageError: nothing was declared by this name.
        """
        self._tell_solids(DeclaredSolids(self.now(), name))

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
        if self._devices.real:
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

        Raises:
            LoopError: a perceiver or the task cannot be prepared.
        """
        if not self._warm:
            remote = self._guard if isinstance(self._guard, CommandRelay) else None
            if remote is not None:
                remote.begin()
            self._parts.warm_up(lambda stage, done: progress(stage, 0.9 * done))
            for part in (*self.perceivers, *([] if self.task is None else [self.task])):
                if hasattr(part, "warm_up"):
                    progress(f"preparing {part.name}", 0.95)
                    _prepare(part)
            if remote is not None:
                progress("preparing the guard's process", 0.98)
                remote.wait_ready()
            self._warm = True
        progress("ready", 1.0)

    def run(self, seconds: float | None = None) -> None:
        """Run for a time on the session's clock [s], or until stopped.

        Raises:
            LoopError: a component failed; the arm was stopped.
            CellBusyError: another process runs this arm.
        """
        self.ended_by = ""
        self._begun = True
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._devices.alone(self._mode.exclusive))
            if self._devices.wall:
                self.warm_up()
            stack.callback(setattr, self, "_loop_thread", None)
            self._loop_thread = threading.get_ident()
            stack.enter_context(orderly_signals(self.stop))
            if self._devices.real:
                stack.enter_context(favoured())
            stack.push(self._stop_at_end)  # on the way out, whatever the way
            stack.enter_context(self._devices.running(self._held))
            if isinstance(self._guard, CommandRelay):
                stack.enter_context(self._guard.running())
            self._say_empty()
            if isinstance(self._guard, GuardComponent):
                self._guard.ended = False
            if not self.ended_by:  # while it was warmed up
                self._loop.run(None if seconds is None else self.now() + seconds)
            while self._reset_wanted and not self.ended_by:
                self._devices.arm.stop()
                self._reset()
                self._say_empty()
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

    def _build(self) -> None:
        """Make fresh parts, components and loop."""
        for observer in self._observers:
            if hasattr(observer, "attach"):
                observer.attach(self)
        wanted = Wanted(
            self.cell,
            self.task,
            self.perceivers,
            self._observers,
            self.seed,
            self.config,
            self._make,
            self._supervise,
            self._mode,
            self._speed,
        )
        made = assemble(wanted, self._devices)
        self._channels, self._parts, self._loop = made.channels, made.parts, made.loop
        self._sensing, self._guard, self._task = made.sensing, made.guard, made.task
        self._components = made.components
        if self.cell.empty_switch is not None:
            self._sensing.taps.append(EmptySwitch(self.declare_empty))
        if self._task is not None:
            self._task.on_standing = lambda name, solids: self._tell_solids(
                DeclaredSolids(self.now(), name, tuple(solids))
            )
        self._empty_unsaid = self._mode.cell_is_empty
        self._hold(self._held and self._devices.real)
        if self._held and not self._devices.real:
            self._loop.pause(True)

    def _say_empty(self) -> None:
        """Before the first round: the word that the session was given."""
        if self._empty_unsaid:
            self._empty_unsaid = False
            self._declare_empty()

    def _declare_empty(self) -> None:
        self._parts.workspace.declare_empty()
        self._sensing.tell(EmptyCell(self.now()), self.now())

    def _tell_solids(self, word: DeclaredSolids) -> None:
        self._parts.workspace.told(word)
        self.post(lambda: self._sensing.tell(word, word.stamp))

    def _hold(self, held: bool) -> None:
        """Real time: the arm holds still and the task is not asked."""
        self._guard.held = held
        if self._task is not None:
            self._task.held = held

    def _reset(self) -> None:
        self._reset_wanted = False
        self._devices.turn_back()
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
            self._devices.arm.stop()
        except DeviceError as second:
            if error is None:
                raise
            if str(second) not in str(error):
                raise LoopError(f"{error}; moreover {second}") from error

    def _supervise(self) -> None:
        """Under the wall clock: move a simulated world along, and watch the guard's heart."""
        now = self.now()
        devices = self._devices
        if self.ended_by:  # said before the loop began to listen
            self._loop.stop()
        if devices.advance is not None:
            joints = self._channels.joints.read(now)
            with devices.lock:
                if self.cell.show_joints is not None and joints is not None:
                    self.cell.show_joints(joints.position)
                devices.advance(now)
        if isinstance(self._guard, GuardComponent):
            watch_heart(self._loop, now, self._devices.arm.stop)


def _prepare(part: Any) -> None:
    """Let somebody else's task or perceiver compile what it will need.

    Raises:
        LoopError: it raised.
    """
    try:
        part.warm_up()
    except ArmsightError:
        raise
    except Exception as error:
        raise LoopError(
            f"{part.name} cannot be prepared ({type(error).__name__}: {error}); nothing has moved"
        ) from error
