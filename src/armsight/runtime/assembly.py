"""The components of a session, made fresh and wired to each other and to their loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from armsight.devices.data import RgbdCameraInfo
from armsight.errors import UsageError
from armsight.motion.perception import Perceiver
from armsight.motion.task import Task
from armsight.runtime.channels import Channels
from armsight.runtime.command_messages import Begin
from armsight.runtime.command_relay import CommandRelay
from armsight.runtime.component import Component
from armsight.runtime.components import GuardComponent, MappingComponent, PlanningComponent
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.latency import Latency
from armsight.runtime.parts import MakeParts, Parts
from armsight.runtime.perceiver_component import PerceiverComponent
from armsight.runtime.picture_orders import PictureOrders
from armsight.runtime.renewed_map import RenewedMap
from armsight.runtime.sensing import SensingComponent, SensorTap
from armsight.runtime.session_devices import SessionDevices
from armsight.runtime.simulated_loop import SimulatedLoop
from armsight.runtime.task_component import TaskComponent
from armsight.runtime.wall_loop import WallLoop

if TYPE_CHECKING:
    from armsight.workcell import Cell

MAP_PATIENCE = 2.0
"""A round of the map that takes longer in real time is given up, and the map with it [s]."""


@dataclass(frozen=True)
class Wanted:
    """What a session is made of.

    Attributes:
        cell: open; task, perceivers, observers: of the caller.
        seed: of the planner's randomness.
        config: periods and latencies; make: builds map, planner and guard.
        supervise: called by a loop in real time, beside its rounds; mode: of the session.
        speed: simulated seconds a second.
    """

    cell: Cell
    task: Task | None
    perceivers: Sequence[Perceiver]
    observers: Sequence[Component]
    seed: int
    config: SessionConfig
    make: MakeParts
    supervise: Callable[[], None]
    mode: SessionMode
    speed: float


@dataclass(frozen=True)
class Assembly:
    """What was made.

    Attributes:
        channels: what the components hand each other.
        parts: map, planner, guard; loop: runs the components.
        sensing, guard, task: those that the session talks to; components: all.
    """

    channels: Channels
    parts: Parts
    loop: SimulatedLoop | WallLoop
    sensing: SensingComponent
    guard: GuardComponent | CommandRelay
    task: TaskComponent | None
    components: tuple[Component, ...]


def assemble(wanted: Wanted, devices: SessionDevices) -> Assembly:
    """Make fresh parts, components and loop.

    Raises:
        UsageError: the task or a perceiver cannot run in this cell.
    """
    config, cell = wanted.config, wanted.cell
    charge: Literal["declared", "measured", "real"] = "real" if devices.wall else config.charge

    def latency(seconds: float) -> Latency:
        return Latency(seconds, charge)

    channels = Channels()
    parts = wanted.make(cell, config)
    if devices.wall and isinstance(parts.workspace, RenewedMap):
        parts.workspace.patience = MAP_PATIENCE
    link = devices.command_link(wanted.mode) if parts.elsewhere is not None else None
    sensing = SensingComponent(
        channels, devices.arm, devices.cameras, devices.sensors, config.sensing_period
    )
    sensing.taps = [o for o in wanted.observers if isinstance(o, SensorTap)]
    mapping = MappingComponent(
        channels, parts.workspace, latency(config.mapping_latency), config.mapping_period
    )
    planning = PlanningComponent(
        channels,
        parts.planner,
        latency(config.planning_latency),
        wanted.seed,
        config.planning_time,
        config.planning_period,
    )
    infos = {c.info.name: c.info for c in devices.cameras}
    perceivers = _perceivers(wanted, infos, channels, latency)
    task = _task(wanted, devices, infos, channels, perceivers, latency)
    guard: GuardComponent | CommandRelay
    if link is not None and parts.elsewhere is not None:
        told = ("", 0.0) if task is None else (task.task.name, task.silent_after)
        order = Begin(parts.elsewhere, config.sensing_period, config.guard_period, *told)
        guard = CommandRelay(channels, link, order, devices.clock.now)
    else:
        guard = GuardComponent(
            channels,
            parts.guard,
            devices.arm,
            task.intent if task is not None else lambda now: None,
            latency(config.guard_latency),
            config.guard_period,
        )
    foreign: list[PerceiverComponent | TaskComponent] = [*perceivers]
    if task is not None:
        foreign.append(task)
    components: tuple[Component, ...] = (
        sensing,
        mapping,
        planning,
        *foreign,
        guard,
        *wanted.observers,
    )
    loop: SimulatedLoop | WallLoop
    if devices.wall:
        urgent = (sensing.name, mapping.name, guard.name) if devices.real else ()
        halt = guard.halt if isinstance(guard, GuardComponent) else devices.arm.stop
        loop = WallLoop(devices.clock, components, wanted.supervise, halt, urgent)
    else:
        assert devices.advance is not None
        loop = SimulatedLoop(cell.clock.now, devices.advance, components, wanted.speed)
        assert isinstance(guard, GuardComponent)
        guard.call_at = loop.call_at
        if charge == "declared":
            mapping.beside = planning.beside = loop.beside
    for part in foreign:
        part.on_seconds = loop.meters[part.name].more
        if not devices.wall:
            part.call_at = loop.call_at
    mapping.judges = tuple(p.newest for p in perceivers)
    mapping.on_placed = lambda info: infos.update({info.name: info})
    made = Assembly(channels, parts, loop, sensing, guard, task, components)
    _wire(made, mapping, planning, perceivers)
    orders = PictureOrders(
        wanted.task, wanted.perceivers, devices.cameras, cell.stereo, devices.lock
    )
    orders.place()
    if task is not None:
        task.on_subscriptions = orders.place
    return made


def _wire(
    made: Assembly,
    mapping: MappingComponent,
    planning: PlanningComponent,
    perceivers: Sequence[PerceiverComponent],
) -> None:
    """Who is woken by whose news, besides the periods."""
    loop, task = made.loop, made.task

    def wake_guard(at: float) -> None:
        # A task that wants the map is asked before.
        if task is not None and task.wanted.snapshot:
            loop.wake(task.name, at)
        loop.wake("guard", at)

    def wake_perceivers(at: float) -> None:
        for perceiver in perceivers:
            if perceiver.frames.waiting:
                loop.wake(perceiver.name, at)

    def tell_doubt(camera: str, excluded: bool) -> None:
        for perceiver in perceivers:
            perceiver.doubted(camera, excluded)

    mapping.on_doubted = tell_doubt
    made.sensing.on_frames = lambda at: loop.wake("mapping", at)
    made.sensing.on_pictures = wake_perceivers
    mapping.on_snapshot = planning.on_plan = wake_guard
    made.guard.on_request = lambda at: loop.wake("planning", at)
    if task is not None:
        name, wanted = task.name, task.task.subscriptions.perceivers
        for perceiver in perceivers:
            if perceiver.perceiver.name in wanted:
                perceiver.on_result = lambda at: loop.wake(name, at)


def _perceivers(
    wanted: Wanted,
    infos: Mapping[str, RgbdCameraInfo],
    channels: Channels,
    latency: Callable[[float], Latency],
) -> list[PerceiverComponent]:
    for p in wanted.perceivers:
        lacks = [part for part in ("name", "period", "cameras", "update") if not hasattr(p, part)]
        if lacks:
            name = getattr(p, "name", type(p).__name__)
            raise UsageError(f"perceiver {name} has no {', '.join(lacks)}")
    names = [p.name for p in wanted.perceivers]
    if len(set(names)) < len(names):
        raise UsageError(f"two perceivers have the same name: {', '.join(sorted(names))}")
    robot, patience = wanted.cell.robot, wanted.config.patience
    pairs = {pair.info.name: pair.info for pair in wanted.cell.stereo}
    made = [
        PerceiverComponent(p, robot, infos, channels.history, latency, patience, pairs)
        for p in wanted.perceivers
    ]
    channels.frames.readers += [p.frames for p in made]
    return made


def _task(
    wanted: Wanted,
    devices: SessionDevices,
    infos: Mapping[str, RgbdCameraInfo],
    channels: Channels,
    perceivers: Sequence[PerceiverComponent],
    latency: Callable[[float], Latency],
) -> TaskComponent | None:
    if wanted.task is None:
        return None
    robot, patience = wanted.cell.robot, wanted.config.patience
    made = TaskComponent(wanted.task, channels, robot, infos, perceivers, latency, patience)
    channels.frames.readers.append(made.frames)
    gripper = wanted.cell.gripper
    if gripper is not None:

        def move(width: float) -> None:
            with devices.lock:
                gripper.move(width)

        made.on_width = move
    return made
