"""A trial of V's experiments in the whole rendered cell: its target led along the trial's path.

A target that is a part of somebody is not there yet when somebody says that nobody is in the cell:
it waits outside of what is mapped, and is there when it is wanted, at once. It has nobody behind
it, and coming in across the border it would be told to have been left behind as soon as it rests.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from armsight.arrays import JointVector, Pose, Vector3
from armsight.experiments.servo_eyes import Path
from armsight.experiments.servo_world import Setup
from armsight.geometry.pose import inverse, transform
from armsight.motion.intents import Intent, Rest
from armsight.motion.permits import Permit
from armsight.motion.task import Observation
from armsight.robots.robot import Robot

if TYPE_CHECKING:
    from armsight.runtime.session import Session
    from armsight.simulation.truth import Contact
    from armsight.simulation.world import SimulatedWorld
    from armsight.tasks.servo import ServoOptions
    from armsight.tasks.servo_task import ServoTask
    from armsight.workcell.schema import Workcell


class Seen(Protocol):
    """An arm and its target as they truly are, in the rendered cell or in one without pictures.

    Attributes:
        robot: the arm; q: (n,) [rad] and v: (n,) [rad/s] at ``now`` [s].
        begins: when the trial does [s].
        contacts: of the arm so far.
    """

    robot: Robot
    q: JointVector
    v: JointVector
    now: float
    begins: float

    @property
    def contacts(self) -> list[Contact]:
        """See above."""
        ...

    def path(self, time: float) -> Vector3:
        """(3,) where the target is led at a time [s], in ``base`` [m]."""
        ...

    def place(self, time: float) -> Vector3:
        """(3,) where the target is, in ``base``: it may have been pushed away [m]."""
        ...

    def tip(self) -> Vector3:
        """(3,) where the tip is, in ``base`` [m]."""
        ...


class Judge(Protocol):
    """Tells what came of a trial.

    Attributes:
        over: whether it is.
    """

    over: bool

    def look(self, seen: Seen, permit: Permit | None) -> None:
        """At the end of a round."""
        ...


EMPTY = 1.8
"""The cell has been said to be empty, and seen to be, after so long [s]."""
OUTSIDE = 1.75
"""A target waits at this x of the cell's world: between what is mapped and the wall [m]."""
COMES = 1.0
"""It is where its path begins for so long before the trial does [s]."""
LONGEST = 60.0
"""A trial is given up after so long in any case [s]."""


def said_empty(task: object, now: float) -> bool:
    """Whether a target that is a part of somebody may come, where the task is no reason to wait."""
    return now > EMPTY


class Onlooker:
    """Leads the target along its path, and has the trial judged by the truth.

    Args:
        world: the simulation; setup: of the cell.
        target: its name; T_world_target: its pose now.
        path: (3,) of it in ``base``, so long after it has come [m], [s].
        judge: of the trial.
        wanted: whether the target shall come, at a time [s]; None: it is there from the start.

    Attributes:
        begins: when the target is where its path begins [s]; inf before that is known.
    """

    name = "onlooker"
    period = 0.008

    def __init__(
        self,
        world: SimulatedWorld,
        setup: Setup,
        target: str,
        T_world_target: Pose,
        path: Path,
        judge: Judge,
        wanted: Callable[[float], bool] | None = None,
    ) -> None:
        self.world, self.robot, self.judge = world, setup.robot, judge
        self.begins = 0.0 if wanted is None else np.inf
        self._path, self._wanted = path, wanted
        self.now, self.q = 0.0, np.array(setup.robot.home)
        self.v = np.zeros_like(self.q)
        self._target, self._base = target, setup.workcell.robot.T_world_base
        item = self._pose(target)
        self._T_item_target = inverse(item) @ T_world_target
        # Of the item its own origin is led: it does not turn.
        self._off = item[:3, 3] - T_world_target[:3, 3]
        self._session: Session | None = None
        self._led = False

    @property
    def contacts(self) -> list[Contact]:
        """What the arm really touched."""
        return self.world.truth.contacts

    def path(self, time: float) -> Vector3:
        """(3,) where the target is led at a time, in ``base`` [m]."""
        since = time - self.begins
        if since >= 0.0:
            return self._path(since)
        first = self._path(0.0)
        return first if since >= -COMES else outside(self._base, first)

    def place(self, time: float) -> Vector3:
        """(3,) where the target is now, in ``base`` [m]."""
        return np.asarray(
            (inverse(self._base) @ self._pose(self._target) @ self._T_item_target)[:3, 3]
        )

    def tip(self) -> Vector3:
        """(3,) where the tip truly is, in ``base`` [m]."""
        return transform(inverse(self._base), self.world.truth.tip_position()[None])[0]

    def item(self, name: str) -> Vector3:
        """(3,) where a thing of the cell is, in ``base`` [m]."""
        return transform(inverse(self._base), self._pose(name)[:3, 3][None])[0]

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """One round."""
        assert self._session is not None
        if not self._led:
            self._led = True
            self.world.follow(self._target, self._place_of_item)
        if not np.isfinite(self.begins) and self._wanted is not None and self._wanted(now):
            self.begins = now + COMES
        view = self._session.view()
        if view.joints is None:
            return
        self.now = now
        self.q, self.v = np.array(view.joints.position), np.array(view.joints.velocity)
        self.judge.look(self, None if view.guard is None else view.guard.permit)
        if self.judge.over:
            self._session.stop("the trial is over")

    def _place_of_item(self, time: float) -> Vector3:
        return np.asarray(transform(self._base, self.path(time)[None])[0] + self._off)

    def _pose(self, name: str) -> Pose:
        return next(m for m in self.world.movers() if m.name == name).T_world_solid


def outside(T_world_base: Pose, place: Vector3) -> Vector3:
    """(3,) where a target waits that is to come to (3,), in ``base`` [m]."""
    world = transform(T_world_base, place[None])[0]
    world[0] = OUTSIDE
    return transform(inverse(T_world_base), world[None])[0]


def watched(
    workcell: Workcell,
    setup: Setup,
    options: ServoOptions,
    path: Path,
    make_judge: Any,
    seed: int,
    limit: float,
    wanted: Callable[[Any, float], bool] | None = None,
    waits: bool = True,
) -> tuple[Any, dict[str, Any]]:
    """One trial in a rendered cell; its judge, and what guard and session said, as JSON values.

    Args:
        workcell: with the arm at its start.
        setup: of the cell.
        options: of the task.
        path: (3,) of the target in ``base`` at a time [s].
        make_judge: of the task.
        seed: of the cell's errors.
        limit: given up so long after the target has come [s].
        wanted: whether the target shall come, by task and time [s]; None: it is there at once.
        waits: the task does nothing until it has.
    """
    from armsight.runtime.config import SessionMode
    from armsight.runtime.session import Session
    from armsight.workcell import open_cell, simulated_world

    base = setup.workcell.robot.T_world_base
    target = workcell.simulation.target[0]
    begins = path(0.0) if wanted is None else outside(base, path(0.0))
    world_place = transform(base, begins[None])[0]
    target = target.model_copy(update={"position": tuple(world_place.tolist())})
    simulation = workcell.simulation.model_copy(update={"target": (target,)})
    workcell = workcell.model_copy(update={"simulation": simulation})
    with open_cell(workcell, seed) as cell:
        task: ServoTask = options.make(cell)
        judge = make_judge(task)
        world = simulated_world(cell)
        comes = None if wanted is None else partial(wanted, task)
        looks = Onlooker(world, setup, target.name, target.pose, path, judge, comes)
        if waits:
            task.update = partial(_in_time, looks, task.update)  # type: ignore[method-assign]
        mode = SessionMode(cell_is_empty=True)
        session = Session(cell, task, seed=seed, observers=(looks,), mode=mode)
        session.warm_up()
        while session.now() < looks.begins + limit and session.now() < LONGEST and not judge.over:
            session.run(1.0)
        guard = session.status()
        return judge, {
            "last": "" if guard is None else guard.reason,
            "permit": "" if guard is None else str(guard.permit or ""),
            "factor": float(session.realtime_factor),
        }


def _in_time(
    looks: Onlooker, update: Callable[[Observation], Intent], observation: Observation
) -> Intent:
    """What a task wants once the target has come."""
    if observation.now < looks.begins:
        return Rest("the trial has not begun")
    return update(observation)


def begun(setup: Setup, target: dict[str, Any], start: JointVector) -> Workcell:
    """The cell's file with the arm at (n,) joints and its target so, which pushes back."""
    workcell = setup.workcell
    item = workcell.simulation.target[0].model_copy(update={"path": "free", **target})
    simulation = workcell.simulation.model_copy(update={"target": (item,), "contact_pushes": True})
    robot = workcell.robot.model_copy(update={"home_deg": tuple(np.rad2deg(start).tolist())})
    return workcell.model_copy(update={"robot": robot, "simulation": simulation})


def posed(T_world_target: Pose) -> dict[str, Any]:
    """Where a target stands, as its section has it."""
    from scipy.spatial.transform import Rotation

    rpy = Rotation.from_matrix(T_world_target[:3, :3]).as_euler("xyz", degrees=True)
    return {"position": tuple(T_world_target[:3, 3].tolist()), "rpy_deg": tuple(rpy.tolist())}
