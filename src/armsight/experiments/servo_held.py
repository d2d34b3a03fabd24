"""A ball that somebody holds, in the guarded cell: who stands behind it, contact that pushes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from armsight.arrays import Floats, JointVector, Points, Vector3
from armsight.experiments.forecast_clips import RADII
from armsight.experiments.quick_cell import VOXEL
from armsight.experiments.recorded_hands import HAND, recorded_hand
from armsight.experiments.servo_apart import apart
from armsight.experiments.servo_cell import PushedCell
from armsight.experiments.servo_eyes import RADIUS, Errors
from armsight.experiments.servo_presses import LOOKS, STAYS, Presses, led_speed
from armsight.experiments.servo_trials import tick
from armsight.experiments.servo_world import Setup, make_eyes, make_task
from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import from_rpy, inverse, make_pose, transform, unit
from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.robots.kinematics import tcp_pose
from armsight.simulation.skeleton import INDEX, PARTS, Proportions, bend, standing
from armsight.simulation.targets import TargetSpec, target_object

HEADS = 1.8
"""``[guard] head_height`` of these trials [m]: a ball of V's box is held up to 1.57 m, which is the
height of heads; at the 1.2 m of the cell's file the guard lets no hand be touched there."""
FRONT, TOP = 1.95, 2.6
"""The map reaches to here on the operator's side, where they stand, and up [m]; the cell's to 1.46
and 1.95 m, under which the arm's elbow has no room before V's upper places."""
BEYOND = RADIUS + 0.01
"""The ball's centre lies this far beyond the knuckles, on the fingertips [m]."""
STRETCHED = (0.90, 0.98)
"""Who holds it stands as far behind it as so much of the arm's length reaches."""
TURNED = math.radians(20.0)
"""... on the operator's side, aside by up to this much [rad]."""
HEIGHTS = (1.55, 1.90)
"""Of who holds it [m]."""
IN_MAP = tuple(part for part in PARTS if part[0].split("_")[-1] not in ("shin", "foot"))
"""What of a person the map shows, above the bench."""


@dataclass(frozen=True)
class Holder:
    """Somebody with a ball in the right hand.

    Attributes:
        joints: (19, 3) in ``base`` at a time [s]; still: they do not move.
        name: of the clip, empty without one.
    """

    joints: Callable[[float], Points]
    still: bool = False
    name: str = ""

    def ball(self, time: float) -> Vector3:
        """(3,) centre of the ball at a time [s]."""
        joints = self.joints(time)
        return np.asarray(joints[INDEX[HAND]] - BEYOND * self.along(time))

    def along(self, time: float) -> Vector3:
        """(3,) unit from the ball along the hand, at a time [s]."""
        joints = self.joints(time)
        return unit(joints[INDEX["right_wrist"]] - joints[INDEX[HAND]])

    def skin(self, time: float) -> Points:
        """(k, 3) points of the person's skin at a time [s], a voxel apart."""
        joints = self.joints(time)
        return np.concatenate(
            [
                _capsule(joints[INDEX[a]], joints[INDEX[b]], _radius(name))
                for name, a, b, _ in IN_MAP
            ]
        )

    def screens(self, time: float) -> tuple[Points, Floats]:
        """(k, 3) middles and (k,) radii of balls that hide what is behind them [m]."""
        joints = self.joints(time)
        middles, radii = [], []
        for name, start, end, _ in IN_MAP:
            a, b = joints[INDEX[start]], joints[INDEX[end]]
            middles.append(a + np.linspace(0.0, 1.0, 6)[:, None] * (b - a))
            radii.append(np.full(6, _radius(name)))
        return np.concatenate(middles), np.concatenate(radii)


def demonstrator(ball: Vector3, setup: Setup, rng: np.random.Generator) -> Holder:
    """Somebody who stands on the operator's side and holds a ball still at (3,) in ``base`` [m]."""
    p = Proportions(float(rng.uniform(*HEIGHTS)))
    base = setup.workcell.robot.T_world_base
    place = transform(base, ball[None])[0]
    turn, stretched = rng.uniform(-TURNED, TURNED), rng.uniform(*STRETCHED)
    looks = np.array([-math.cos(turn), -math.sin(turn), 0.0])
    pose = standing(p) @ from_rpy((0.0, 0.0, math.pi + turn))[:3, :3].T
    rises = float(place[2] - pose[INDEX["right_shoulder"], 2])
    reach = stretched * (p.upper_arm + p.forearm + p.hand + BEYOND)
    away = math.sqrt(max(reach**2 - rises**2, 0.0))
    pose[:, :2] += (place - away * looks - pose[INDEX["right_shoulder"]])[:2]
    shoulder = pose[INDEX["right_shoulder"]]
    wrist = place - (BEYOND + p.hand) * unit(place - shoulder)
    down = np.array([0.0, 0.0, -1.0])
    elbow, wrist = bend(shoulder, wrist, p.upper_arm, p.forearm, down)
    pose[INDEX["right_elbow"]], pose[INDEX["right_wrist"]] = elbow, wrist
    pose[INDEX[HAND]] = wrist + p.hand * unit(place - wrist)
    joints = transform(inverse(base), pose)
    return Holder(lambda time: joints, still=True)


def recorded_holder(middle: Vector3, setup: Setup, rng: np.random.Generator) -> Holder:
    """A recorded person who stands and moves the ball about (3,) in ``base`` [m]."""
    found = recorded_hand(rng, TURNED)
    base = setup.workcell.robot.T_world_base
    place = transform(base, middle[None])[0]
    T = np.asarray(inverse(base))
    return Holder(lambda time: transform(T, found.at(time) + place), name=found.name)


class HeldCell(PushedCell):
    """The guarded cell before somebody who holds a ball: the map shows the whole of them."""

    def __init__(self, setup: Setup, holder: Holder, start: JointVector, seed: int = 0) -> None:
        self.holder = holder
        self._skin: Points | None = None
        region = BODY_REGIONS["hand"]
        T = np.asarray(setup.workcell.robot.T_world_base @ make_pose(None, holder.ball(0.0)))
        ball = replace(
            target_object(TargetSpec("ball", "ball", T)),
            mass=region.mass, surface=region.stiffness, hold=500.0, max_speed=10.0,
        )  # fmt: skip
        super().__init__(setup, np.empty((0, 3)), holder.ball, start, ball, np.eye(4), seed)

    def snapshot_at(self, stamp: float) -> WorkspaceSnapshot:
        """What a perfect map says of who holds the ball, and of the ball."""
        ball = self.place(stamp)
        self.surface = np.concatenate([self.skin(stamp) - ball, RADIUS * _sphere(VOXEL / RADIUS)])
        return super().snapshot_at(stamp)

    def skin(self, time: float) -> Points:
        """See :meth:`Holder.skin`."""
        if self._skin is None or not self.holder.still:
            self._skin = self.holder.skin(time)
        return self._skin


def held_setup(setup: Setup) -> Setup:
    """A cell's set-up for these trials, see ``HEADS`` and ``FRONT``."""
    mapping = setup.workcell.mapping
    assert mapping.upper is not None
    wider = mapping.model_copy(update={"upper": (FRONT, mapping.upper[1], TOP)})
    guard = replace(setup.guard, head_height=HEADS)
    return replace(
        setup, workcell=setup.workcell.model_copy(update={"mapping": wider}), guard=guard
    )


def touch_held(
    setup: Setup,
    mode: str,
    errors: Errors,
    holder: Holder,
    start: JointVector,
    seed: int,
    rng: np.random.Generator,
    limit: float,
    near: float,
) -> dict[str, Any]:
    """One trial until the tip is this near the ball [m], for so long at most [s]; JSON values.

    Harm is what presses more than was granted, and who is touched by an arm that moves, but by what
    may touch them.
    """
    eyes = make_eyes(setup, errors, rng)
    eyes.marked = False
    task = make_task(setup, mode, dock="held_ball")
    cell = HeldCell(setup, holder, start, seed)
    status: Any = None
    presses, gap, nearest, heads, reached, rounds = Presses(), math.inf, math.inf, 0, math.inf, 0
    try:
        while cell.now < min(limit, reached + STAYS):
            eyes.along, eyes.screens = holder.along(cell.now), holder.screens(cell.now)
            status = tick(cell, eyes, task, status)
            permit = status.permit
            presses.look(cell, permit, led_speed(cell.path, cell.now))
            may = permit is not None and permit.holds
            tip = tcp_pose(cell.robot, cell.q)[:3, 3]
            gap = min(gap, float(np.linalg.norm(tip - cell.place(cell.now))) - RADIUS)
            if gap < near:
                reached = min(reached, cell.now)
            rounds += 1
            if rounds % LOOKS == 0:
                if presses.moves:
                    reach = task.dock.reach if may else 0.0
                    nearest = min(nearest, apart(setup.robot, cell.q, cell.skin(cell.now), reach))
                if may and permit.region is not None:
                    head = holder.joints(cell.now)[[INDEX["head"]]]
                    heads += bool(permit.region.distance(head, cell.now)[0] < RADII["head"])
    finally:
        cell.close()
    return {
        "reached": math.isfinite(reached),
        "seconds": reached if math.isfinite(reached) else limit,
        "iterations": int(task.chase.iterations),
        "away": gap,
        "force": float(presses.force),
        "apart": nearest,
        "heads": int(heads),
        "harm": bool(presses.harm or nearest < 0.0),
        "clip": holder.name,
        "last": cell.log[-1].reason,
        "permit": str(status.permit or ""),
    }


def _radius(name: str) -> float:
    return RADII[name.removeprefix("left_").removeprefix("right_")]


@cache
def _sphere(step: float) -> Points:
    """(k, 3) points of the unit sphere, so far from each other."""
    count = math.ceil(4.0 * math.pi / step**2)
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, k * math.pi * (3.0 - math.sqrt(5.0))
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def _capsule(a: Vector3, b: Vector3, radius: float) -> Points:
    """(k, 3) points of a capsule's surface, a voxel apart [m]."""
    ball = radius * _sphere(VOXEL / radius)
    axis = unit(b - a)
    x = unit(np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))]))
    around = np.arange(0.0, 2.0 * math.pi, VOXEL / radius)[:, None]
    ring = radius * (np.cos(around) * x + np.sin(around) * np.cross(axis, x))
    steps = np.arange(0.0, float(np.linalg.norm(b - a)), VOXEL)
    tube = (a + steps[:, None] * axis)[:, None] + ring[None]
    ends = [a + ball[ball @ axis <= 0.0], b + ball[ball @ axis >= 0.0]]
    return np.concatenate([tube.reshape(-1, 3), *ends])
