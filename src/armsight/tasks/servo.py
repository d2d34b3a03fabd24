"""V's tasks: follow a target that moves, and touch it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, transform
from armsight.robots.robot import Robot
from armsight.servoing.approach import Funnel
from armsight.servoing.ceiling import BELOW, Ceiling
from armsight.servoing.docking import Docking, docking
from armsight.servoing.eyes import Eye, Target, WristEye
from armsight.servoing.law import LawConfig
from armsight.servoing.modes import ChaseConfig, make_chase
from armsight.servoing.patience import STATED
from armsight.servoing.segments import SegmentConfig
from armsight.servoing.targets.ball import Ball
from armsight.servoing.targets.straw_end import StrawEnd
from armsight.tasks.fetch import fetch_in, with_item
from armsight.tasks.handover import HandoverTask
from armsight.tasks.servo_task import Mode, ServoTask
from armsight.workcell.beliefs import tip_of

if TYPE_CHECKING:
    from armsight.workcell import Cell
    from armsight.workcell.schema import Workcell

Triple = tuple[float, float, float]
BALL_ENDS = {"pen": (0.005, (0.0, 0.0, -0.005))}
"""Balls on tools that the pair can see: radius [m], and place in the TCP's frame [m]."""
STRAWS = {"straw_cup": (0.003, (0.0, -0.0007, -0.0029), 0.2507)}
"""Straws on tools: radius [m], middle of the round end [m], and how far from the tool's z the straw
leans to its y [rad], in the TCP's frame."""


@dataclass(frozen=True)
class ServoOptions:
    """Follow a target that moves until the tool touches it, or docks with it (V).

    Attributes:
        target: what to follow: the ball, on a stand or as a `held_ball` in a gloved hand, the
            bulls-eye, a mouth with a `straw`, or a `hand`.
        mode: `ours`; `paper`: V's Master and its stop-and-go segments; `fixed`: those without the
            pair on the wrist.
        standoff: how far before the surface the tip stays [m]; 0 touches.
        ball_radius: of the red ball [m].
        patience: the arm gives up, with the reason, after a permit to touch was refused for so long
            [s], until the target has moved by 0.1 m; `inf` waits for ever.
        fetch: the gripper takes the item from where the cell's file says that items lie, before a
            hand-over; without, it holds it already.
    """

    target: Literal["ball", "held_ball", "bullseye", "straw", "hand"] = "ball"
    mode: Mode = "ours"
    standoff: float = 0.0
    ball_radius: float = 0.04
    patience: float = STATED
    fetch: bool = False

    def make(self, cell: Cell) -> ServoTask:
        """The task for a cell.

        Raises:
            UsageError: an option cannot be, or the cell has no camera with colour, no pair for the
                paper's mode, or no gripper for a hand-over.
        """
        if not 0.0 <= self.standoff < math.inf or not 0.0 < self.ball_radius < math.inf:
            raise UsageError(
                f"a standoff of {self.standoff:g} m and a ball_radius of {self.ball_radius:g} m; "
                "expected 0 or more, and above 0"
            )
        if not self.patience > 0.0:
            raise UsageError(f"a patience of {self.patience:g} s; expected above 0, or inf")
        dock = docking(self.target, self.ball_radius)
        fetch = None
        if self.fetch:
            if self.target != "hand" or self.standoff > 0.0 or cell.gripper is None:
                raise UsageError(
                    "only what is handed over is fetched: fetch goes with a hand, without a "
                    "standoff, and a gripper"
                )
            fetch = fetch_in(cell.workcell, cell.gripper.opening, cell.T_world_base)
            cell.robot = with_item(cell.robot, fetch.size)  # of all that is made for it from now on
        task = servo_task(cell, dock, self.mode, self.standoff, self.patience)
        if isinstance(task, HandoverTask):
            task.fetch = fetch
        return task


def _mark_of(robot: Robot, target: Target) -> tuple[Target | None, Vector3]:
    """What of the tool the pair can see, and where that is in the TCP's frame (3,) [m]."""
    tool = robot.tool.name if robot.tool is not None else ""
    if tool in BALL_ENDS:
        radius, at = BALL_ENDS[tool]
        beside = target if isinstance(target, Ball) else None
        return Ball(radius, "mark", beside=beside), np.array(at)
    if tool in STRAWS:
        radius, at, leans = STRAWS[tool]
        axis = np.array([0.0, math.sin(leans), math.cos(leans)])
        return StrawEnd(robot, np.array(at), axis, radius), np.array(at)
    return None, np.zeros(3)


def servo_task(
    cell: Cell,
    dock: Docking,
    mode: Mode = "ours",
    standoff: float = 0.0,
    patience: float = STATED,
) -> ServoTask:
    """The task of a docking, one of V's or of your own, for a cell.

    Args:
        cell: open.
        dock: the target, the way to it, and what may be touched.
        mode: see :class:`ServoOptions`.
        standoff: how far before the surface the tip stays [m]; 0 for what the docking says.
        patience: a permit that stays refused for so long is given up [s].

    Raises:
        UsageError: the cell has no camera with colour, no pair for the paper's mode, or no gripper
            for a hand-over.
    """
    cameras = [c.info.name for c in cell.cameras if c.info.color is not None]
    if not cameras:
        raise UsageError(
            f"{cell.workcell.name}: no camera with a colour lens; a target is found by colour"
        )
    pairs = [p.info.name for p in cell.stereo if p.info.mounted_on == "flange"]
    pair = pairs[0] if pairs and mode != "fixed" else ""
    if mode == "paper" and not pair:
        raise UsageError(
            f"{cell.workcell.name}: no stereo pair on the flange, which the mode paper needs; "
            "fixed is the same without"
        )
    target = dock.detector()
    eyes: list[Eye | WristEye] = [Eye(name, target, scale=dock.scale) for name in cameras]
    if pair:
        mark, at = _mark_of(cell.robot, target)
        eyes.append(WristEye(pair, target, cell.robot, mark, at, mode == "paper"))
    config = chase_config(cell.workcell, cell.T_world_base, dock, standoff)
    names = [*cameras, *([pair] if pair else [])]
    chase = make_chase(mode, cell.robot, names, pair, config)
    if dock.name == "hand" and standoff == 0.0:
        if cell.gripper is None:
            raise UsageError(
                f"{cell.workcell.name}: no [gripper] that could let anything go; with a "
                "standoff a hand is followed without one"
            )
        task = HandoverTask(dock, mode, chase, eyes, config, patience=patience)
        task.opening = cell.gripper.opening
        task.reset()
        return task
    return ServoTask(dock, mode, chase, eyes, config, standoff, patience)


def chase_config(
    workcell: Workcell, T_world_base: Pose, dock: Docking, standoff: float = 0.0
) -> ChaseConfig:
    """What a chase has to know of a cell.

    Args:
        workcell: the cell.
        T_world_base: where its robot stands.
        dock: what is servoed to.
        standoff: how far before it the tip stays [m]; 0 for what the docking says.
    """
    section = workcell.robot
    T_base_world = inverse(T_world_base)
    lower, upper = _box(workcell.mapping.lower, workcell.mapping.upper, T_base_world)
    speed = section.speed * workcell.guard.speed
    tip = tip_of(workcell)
    return ChaseConfig(
        vertical=T_base_world[:3, 2],
        front=T_base_world[:3, 0],
        radius=dock.radius,
        direction=dock.direction,
        turned=dock.turned,
        funnel=Funnel(gap=standoff if standoff > 0.0 else dock.gap),
        gentle=dock.gentle,
        reserve=dock.reserve(tip),
        tip=tip,
        law=LawConfig(
            delay=section.start_delay_ms / 1e3 + 0.002,
            speed=speed,
            acceleration=section.acceleration,
            ceiling=_ceiling(workcell, T_base_world),
        ),
        segments=SegmentConfig(
            speed=speed, acceleration=section.acceleration, lower=lower, upper=upper
        ),
    )


def _ceiling(workcell: Workcell, T_base_world: Pose) -> Ceiling | None:
    """Below the top of the mapped box; None where the cell declares none."""
    if workcell.mapping.upper is None:
        return None
    up = T_base_world[:3, 2]
    top = T_base_world[:3, 3] + workcell.mapping.upper[2] * up
    return Ceiling(up, float(up @ top) - BELOW)


def _box(lower: Triple | None, upper: Triple | None, T_base_world: Pose) -> tuple[Triple, Triple]:
    """The mapped box as an upright box of ``base``; endless where the cell declares none."""
    if lower is None or upper is None:
        return (-math.inf,) * 3, (math.inf,) * 3
    corners = transform(T_base_world, np.array([lower, upper]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


__all__ = ["Mode", "ServoOptions", "ServoTask", "chase_config", "servo_task"]
