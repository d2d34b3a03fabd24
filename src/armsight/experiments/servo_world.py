"""Servoing without pictures: an arm with its true errors before a ball, and what comes of it.

The task, the guard with its permits and the drives are the real ones; what the perceivers would
find is drawn from a model (:mod:`.servo_eyes`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Points, Pose, Vector3
from armsight.devices.data import JointState
from armsight.experiments.quick_cell import VOXEL, Ball, QuickCell, felt
from armsight.experiments.servo_eyes import RADIUS, Errors, Eyes, ModelCamera, ModelPair, Path
from armsight.experiments.servo_nudges import Nudges
from armsight.geometry.pose import exp, inverse, unit
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import OCCUPIED
from armsight.mapping.static_geometry import rasterise
from armsight.motion.guard_config import GuardConfig
from armsight.motion.task import Observation
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.robot import Robot
from armsight.robots.sprung_tip import pressing_force
from armsight.runtime.config import SessionConfig
from armsight.runtime.configure import guard_config
from armsight.simulation.arm_errors import true_geometry
from armsight.workcell import load_workcell, robot_in
from armsight.workcell.build import solids_in_base
from armsight.workcell.packaged import packaged
from armsight.workcell.schema import Workcell

CELL = "ur10_servoing"
FAR = 0.3
"""A declared solid farther from a voxel than this counts as this far from it [m]."""
STAND = 2e3
"""Stiffness of what holds the ball [N/m], that of a simulated one."""


@dataclass(frozen=True)
class Setup:
    """The cell that all trials share: its file, arm and guard's configuration."""

    workcell: Workcell
    robot: Robot
    guard: GuardConfig


def set_up(
    speed: float | None = None, acceleration: float | None = None, cell: str = CELL
) -> Setup:
    """A packaged cell, with other shares of speed and acceleration if wanted."""
    workcell = load_workcell(packaged()[cell])
    if speed is not None or acceleration is not None:
        section = workcell.robot.model_copy(
            update={
                "speed": speed or workcell.robot.speed,
                "acceleration": acceleration or workcell.robot.acceleration,
            }
        )
        workcell = workcell.model_copy(update={"robot": section})
    return Setup(workcell, robot_in(workcell), guard_config(workcell, SessionConfig()))


def make_eyes(setup: Setup, errors: Errors, rng: np.random.Generator) -> Eyes:
    """The cell's cameras with errors drawn."""
    T_base_world = inverse(setup.workcell.robot.T_world_base)

    def off(mm: float, deg: float) -> Pose:
        return exp(rng.normal(0, 1, 6) * np.repeat([mm / 1e3, math.radians(deg)], 3))

    fixed = []
    for i, section in enumerate(setup.workcell.camera):
        believed = np.asarray(T_base_world @ section.T_mount_camera)
        true = np.asarray(believed @ off(errors.fixed_mm, errors.fixed_deg))
        depth = float(rng.normal(0, errors.depth_mm / 1e3))
        fixed.append(ModelCamera(section.name, believed, true, depth, 0.05 * i))
    mount = setup.workcell.stereo[0].T_mount_camera
    pair = ModelPair(mount, np.asarray(mount @ off(errors.wrist_mm, errors.wrist_deg)))
    geometry = true_geometry(setup.robot, errors.arm, rng)
    return Eyes(fixed, pair, setup.robot, replace(setup.robot, T_link_joint=geometry), errors, rng)


@dataclass
class Course:
    """What happened in one trial, a row a tick.

    Attributes:
        times: [s]; gap: tip to surface, truly [m]; believed: the same as the task has it.
        error: of the task's place of the target [m], NaN without one; wrist: the pair leads.
        commands: (k, n) [rad/s]; ball_speed: [m/s].
        permits: states of the permit that were seen.
        nudges: what the tip did to the ball.
    """

    times: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    believed: list[float] = field(default_factory=list)
    error: list[float] = field(default_factory=list)
    wrist: list[bool] = field(default_factory=list)
    commands: list[JointVector] = field(default_factory=list)
    places: list[Vector3] = field(default_factory=list)
    tips: list[Vector3] = field(default_factory=list)
    permits: set[str] = field(default_factory=set)
    nudges: Nudges = field(default_factory=Nudges)


class Trial:
    """One task before one ball, guarded, without pictures.

    Args:
        setup: the cell; eyes: its cameras; task: a servo task.
        ball: (3,) in ``base`` at a time; start: (n,) joints [rad].
        seed: of the planner; people: whether the ball is in the map at all.
    """

    def __init__(
        self,
        setup: Setup,
        eyes: Eyes,
        task: Any,
        ball: Path,
        start: JointVector,
        seed: int = 0,
        mapped: bool = True,
    ) -> None:
        self.eyes, self.task, self.ball = eyes, task, ball
        balls = [Ball(ball, RADIUS)] if mapped else []
        self.cell = QuickCell(
            balls,
            robot=setup.robot,
            config=setup.guard,
            seed=seed,
            rate=60.0,
            box=mapped_box(setup),
        )
        declare(self.cell, setup)
        self.cell.q = np.array(start, float)
        self.course = Course()
        self.tip = None if setup.robot.tool is None else setup.robot.tool.tip
        self._status: Any = None

    @property
    def now(self) -> float:
        """Time [s]."""
        return self.cell.now

    def step(self) -> None:
        """One period of the guard."""
        cell, now = self.cell, self.cell.now
        push = self._push()
        self.eyes.aside = self._aside(push)
        self.eyes.expose(now, cell.q, self.ball)
        joints = JointState(now, cell.q.copy(), cell.v.copy())
        observation = Observation(
            now, cell.robot, joints, self._status, perceived=self.eyes.arrived(now)
        )
        intent = self.task.update(observation)
        cell.guard.feel(felt(cell, push))
        decision = cell.tick(goal=intent)
        self._status = decision.status
        self._note(decision.command)

    def run(self, seconds: float, until: Callable[[Course], bool] | None = None) -> Course:
        """Go on for a time [s], or until something is so."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.step()
            if until is not None and until(self.course):
                break
        return self.course

    def _push(self) -> Vector3:
        """(3,) how the ball on its stand pushes the tip back [N]; the tip gives way if it may.

        Tip and ball are round, and the springs are the same to every side: the tip goes straight
        away from the ball's middle.
        """
        away = tcp_pose(self.eyes.true_robot, self.cell.q)[:3, 3] - self.ball(self.now)
        length = float(np.linalg.norm(away))
        force = pressing_force(RADIUS - length, STAND, self.tip)
        return np.asarray(force * away / max(length, 1e-6))

    def _aside(self, push: Vector3) -> Vector3:
        """(3,) how far a push [N] moves the tip out of its seat [m]."""
        force = float(np.linalg.norm(push))
        moved = 0.0 if self.tip is None else self.tip.moved(force)
        return np.asarray(moved * push / max(force, 1e-9))

    def _note(self, command: JointVector) -> None:
        course, cell = self.course, self.cell
        ball = self.ball(cell.now)
        tip = tcp_pose(self.eyes.true_robot, cell.q)[:3, 3]
        course.times.append(cell.now)
        course.gap.append(float(np.linalg.norm(tip - ball)) - RADIUS)
        course.believed.append(self.task.chase.distance)
        place = self.task.chase.place
        course.error.append(math.nan if place is None else float(np.linalg.norm(place - ball)))
        course.wrist.append(self.task.chase.source_number == 3.0)
        course.commands.append(command.copy())
        course.places.append(np.full(3, np.nan) if place is None else place.copy())
        course.tips.append(tip)
        permit = self._status.permit
        if permit is not None:
            course.permits.add(permit.state.value)
        course.nudges.look(
            pushes=self._pushes(ball, tip) if course.gap[-1] < 0.0 else 0.0,
            force=pressing_force(-course.gap[-1], STAND, self.tip),
            held=permit is not None and permit.holds,
            most=self.task.dock.force,
        )

    def _pushes(self, ball: Vector3, tip: Vector3) -> float:
        """How fast the tip comes into the ball by its own motion [m/s].

        A ball that runs into a tip that stands or leaves is not pushed by it, nor is one that goes
        as fast before it.
        """
        cell, way = self.cell, unit(ball - tip)
        own = (tcp_jacobian(self.eyes.true_robot, cell.q) @ cell.v)[:3]
        moves = (ball - self.ball(cell.now - cell.config.period)) / cell.config.period
        return min(float(own @ way), float((own - moves) @ way))


def make_task(
    setup: Setup, mode: str, standoff: float = 0.0, dock: str = "ball", **chase: Any
) -> Any:
    """The servo task of a mode, without perceivers."""
    from armsight.servoing.docking import docking
    from armsight.servoing.modes import make_chase
    from armsight.tasks.handover import HandoverTask
    from armsight.tasks.servo import chase_config
    from armsight.tasks.servo_task import ServoTask

    chosen = docking(dock, RADIUS)
    config = chase_config(setup.workcell, setup.workcell.robot.T_world_base, chosen, standoff)
    config = replace(config, **chase)
    names = [c.name for c in setup.workcell.camera]
    wrist = "" if mode == "fixed" else "wrist"
    cameras = [*names, *([wrist] if wrist else [])]
    made = make_chase(mode, setup.robot, cameras, wrist, config)  # type: ignore[arg-type]
    make = HandoverTask if dock == "hand" else ServoTask
    return make(chosen, mode, made, [], config, standoff)  # type: ignore[arg-type]


def mapped_box(setup: Setup) -> tuple[Vector3, Vector3] | None:
    """Corners (3,) of what the cell's cameras map, upright in ``base`` [m]; None: not declared."""
    mapping = setup.workcell.mapping
    if mapping.lower is None or mapping.upper is None:
        return None
    corners = world_to_base(setup, [mapping.lower, mapping.upper])
    return corners.min(axis=0), corners.max(axis=0)


def declare(cell: QuickCell, setup: Setup) -> None:
    """Put what the cell's file declares into a trial's map, as the cell's own map has it."""
    filled = rasterise(solids_in_base(setup.workcell), cell.grid, 0.0).filled
    cell.state[filled != 0] = OCCUPIED
    cell.field = bounded_distance(filled, VOXEL, FAR)


def start_below(setup: Setup, start: JointVector) -> JointVector:
    """(n,) a start [rad], or home if some part is above what the cell maps: it would be stuck."""
    from armsight.servoing.docking import docking
    from armsight.tasks.servo import chase_config

    config = chase_config(setup.workcell, setup.workcell.robot.T_world_base, docking("ball"))
    ceiling, robot = config.law.ceiling, setup.robot
    if ceiling is None or ceiling.above(robot).under(robot, start) >= 0.0:
        return start
    return robot.home


def world_to_base(setup: Setup, points: Sequence[Sequence[float]] | Points) -> Floats:
    """(k, 3) points of the world in ``base`` [m]."""
    T = inverse(setup.workcell.robot.T_world_base)
    p = np.asarray(points, float)
    return np.asarray(p @ T[:3, :3].T + T[:3, 3])
