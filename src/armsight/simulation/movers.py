"""What moves in the cell besides the arm: people, lone hands, objects; each one a mocap body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.errors import UsageError
from armsight.geometry.shapes import Solid, Surface
from armsight.simulation.carrier import CarriedThing, Carrier
from armsight.simulation.clips import load_clip
from armsight.simulation.kernels import part_poses
from armsight.simulation.motion import Motion, finish
from armsight.simulation.people import PersonBody, hand_body, person_body
from armsight.simulation.scripts import ScriptOptions, reach, script_joints
from armsight.simulation.skeleton import (
    INDEX,
    JOINTS,
    PART_END,
    PART_START,
    PART_TURN,
    PARTS,
    Proportions,
)
from armsight.simulation.spec import MovingObjectSpec, PersonSpec

Trajectory = Callable[[float], Vector3]
"""Position in world [m] at a time [s]."""

DEFAULT_TARGET = (0.62, -0.10, 1.02)
"""Where a script's hand goes unless told otherwise: an arm's length ahead, at bench height."""


class Mover(Protocol):
    """Something that moves by itself or is dragged."""

    name: str

    def reset(self) -> None:
        """Back to its state at time 0."""
        ...

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """Write the poses of its bodies at ``now`` [s]: (p, 3) [m] and (p, 4) wxyz."""
        ...

    def drag(self, target: Vector3 | None) -> None:
        """Move towards a point of the world, or back to its own ways with None."""
        ...


class Person:
    """A person who follows a script or a clip; the page may take the right hand."""

    def __init__(self, spec: PersonSpec) -> None:
        self.name = spec.name
        self._spec = spec
        if spec.motion == "clip":
            if spec.clip is None:
                raise UsageError(f"person '{spec.name}': motion is 'clip' but no clip is given")
            clip = load_clip(spec.clip)
            self.proportions, joints, rate = clip.proportions, clip.joints, clip.rate
        else:
            self.proportions = Proportions(spec.height)
            target = DEFAULT_TARGET if spec.target is None else spec.target
            options = ScriptOptions(
                spec.period, np.asarray(target, float), spec.distance, self.proportions
            )
            joints, rate = script_joints(spec.script, options), 100.0
        self.motion: Motion = finish(
            joints,
            spec.T_world_person,
            scale=spec.speed_scale,
            hand_speed=spec.max_hand_speed,
            mirror=spec.mirror,
            start=spec.start,
            there_and_back=spec.motion == "clip",
            rate=rate,
        )
        self.body: PersonBody = person_body(spec.name, self.proportions)
        self.reset()

    def reset(self) -> None:
        """Hands off."""
        self._target: Vector3 | None = None
        self._hand: Vector3 | None = None
        self._last = 0.0
        self.joints = self.motion.joints[0].copy()

    def drag(self, target: Vector3 | None) -> None:
        """Lead the right hand to a point of the world [m], or let it go."""
        self._target = None if target is None else np.asarray(target, float)

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`Mover`."""
        i, w = self.motion.place(now)
        joints = (1.0 - w) * self.motion.joints[i] + w * self.motion.joints[i + 1]
        left = (1.0 - w) * self.motion.left[i] + w * self.motion.left[i + 1]
        left /= max(float(np.linalg.norm(left)), 1e-9)
        self._lead(joints, now)
        self.joints = joints
        part_poses(joints, PART_START, PART_END, PART_TURN, left, position, quaternion)

    def _lead(self, joints: Floats, now: float) -> None:
        """Let the dragged hand go on at most at its speed, and the arm follow."""
        own = joints[INDEX["right_hand"]]
        goal = own if self._target is None else self._target
        if self._hand is None:
            if self._target is None:
                self._last = now
                return
            self._hand = own.copy()
        room = self._spec.max_hand_speed * (now - self._last)
        self._last = now
        self._hand = towards(self._hand, goal, room)
        if self._target is None and np.linalg.norm(self._hand - own) < 1e-3:
            self._hand = None
            return
        batch = joints[None]
        reach(batch, "right", self._hand[None], self.proportions)
        joints[:] = batch[0]


class Hand:
    """A lone forearm and hand, led by the page or by a trajectory."""

    def __init__(self, spec: PersonSpec) -> None:
        self.name = spec.name
        self._spec = spec
        self.proportions = Proportions(spec.height)
        self.body = hand_body(spec.name, self.proportions)
        self._trajectory: Trajectory | None = None
        chosen = [i for i, part in enumerate(PARTS) if part[0] in ("right_forearm", "right_hand")]
        self._start, self._end = PART_START[chosen], PART_END[chosen]
        self._turn = PART_TURN[chosen]
        self.joints = np.zeros((len(JOINTS), 3))
        self.reset()

    def reset(self) -> None:
        """Back to where the hand started; a trajectory stays."""
        self.position = np.array(self._spec.T_world_person[:3, 3])
        self._target: Vector3 | None = None
        self._last = 0.0

    def drag(self, target: Vector3 | None) -> None:
        """Lead the hand to a point of the world [m] at most at its speed; None: stay."""
        self._target = None if target is None else np.asarray(target, float)

    def follow(self, trajectory: Trajectory | None) -> None:
        """Let the hand follow a function of time from now on; its speed is not capped."""
        self._trajectory = trajectory

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`Mover`."""
        if self._trajectory is not None:
            self.position = np.asarray(self._trajectory(now), float)
        elif self._target is not None:
            room = self._spec.max_hand_speed * (now - self._last)
            self.position = towards(self.position, self._target, room)
        self._last = now
        along = self._spec.T_world_person[:3, 0]
        p = self.proportions
        self.joints[INDEX["right_hand"]] = self.position
        self.joints[INDEX["right_wrist"]] = self.position - p.hand * along
        self.joints[INDEX["right_elbow"]] = self.position - (p.hand + p.forearm) * along
        left = self._spec.T_world_person[:3, 1]
        part_poses(self.joints, self._start, self._end, self._turn, left, position, quaternion)


class MovingObject:
    """A thing on a circle, on a line, or dragged."""

    def __init__(self, spec: MovingObjectSpec, seed: tuple[int, ...] = (0,)) -> None:
        self.name = spec.solid.name
        drawn = spec.follow
        self._drawn = None if drawn is None else drawn(np.random.default_rng(seed))
        self._spec = spec
        self._T_start = spec.solid.T_frame_solid
        self.reset()

    def reset(self) -> None:
        """Back to its start."""
        self.position = np.array(self._T_start[:3, 3])
        self._follow = self._drawn
        self._target: Vector3 | None = None
        self._dragged = False
        self._last = 0.0

    def follow(self, trajectory: Trajectory | None) -> None:
        """Let it follow a function of time from now on, at any speed; None: its own path again."""
        self._follow = self._drawn if trajectory is None else trajectory
        self._target, self._dragged = None, False

    def drag(self, target: Vector3 | None) -> None:
        """Move towards a point of the world [m]; None: go back to its own path, or stay."""
        self._target = None if target is None else np.asarray(target, float)
        self._dragged = True

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`Mover`."""
        own = self._own(now)
        room = self._spec.max_speed * (now - self._last)
        self._last = now
        if self._target is not None:
            self.position = towards(self.position, self._target, room)
        elif not self._dragged:
            self.position = own
        elif self._spec.path != "free" or self._follow is not None:
            self.position = towards(self.position, own, room)
            self._dragged = bool(np.linalg.norm(self.position - own) > 1e-6)
        position[0] = self.position

    def _own(self, now: float) -> Vector3:
        if self._follow is not None:
            return self._follow(now)
        start, center = self._T_start[:3, 3], np.asarray(self._spec.center, float)
        turn = 2.0 * np.pi * now / self._spec.period
        if self._spec.path == "circle":
            c, s = np.cos(turn), np.sin(turn)
            arm = start - center
            return center + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1], arm[2]])
        if self._spec.path == "line":
            return np.asarray(start + 0.5 * (1.0 - np.cos(turn)) * (center - start))
        return np.asarray(start)


def make_people(
    people: Sequence[PersonSpec], objects: Sequence[MovingObjectSpec], static: Sequence[Solid]
) -> tuple[Person | Hand | Carrier, ...]:
    """The people of a cell's description, among its things and what stands there."""
    return tuple(
        Hand(spec)
        if spec.motion == "hand"
        else Carrier(spec, [o for o in objects if o.carried_by == spec.name], static)
        if spec.motion == "carry"
        else Person(spec)
        for spec in people
    )


def make_objects(
    objects: Sequence[MovingObjectSpec], people: Sequence[Person | Hand | Carrier], seed: int
) -> tuple[MovingObject | CarriedThing, ...]:
    """What of a cell's things is led along a path or brought by somebody.

    Raises:
        UsageError: who is to bring a thing does not carry.
    """
    carriers = {p.name: p for p in people if isinstance(p, Carrier)}
    out: list[MovingObject | CarriedThing] = []
    for i, item in enumerate(objects):
        if item.carried_by and item.carried_by not in carriers:
            known = ", ".join(sorted(carriers)) or "nobody"
            raise UsageError(
                f"{item.solid.name} is carried by '{item.carried_by}'; who carries "
                f"(motion = 'carry') in this cell: {known}"
            )
        if item.carried_by:
            out.append(CarriedThing(item.solid.name, carriers[item.carried_by]))
        elif not item.held_by and item.path != "loose":
            out.append(MovingObject(item, (seed, 60, i)))
    return tuple(out)


def towards(position: Vector3, goal: Vector3, room: float) -> Vector3:
    """A position moved towards a goal by no more than some room [m]."""
    away = goal - position
    distance = float(np.linalg.norm(away))
    return np.asarray(goal if distance <= room else position + away * (room / distance))


def drawn_solids(
    body: PersonBody, colors: dict[str, tuple[float, float, float]]
) -> list[tuple[int, Solid]]:
    """Simple solids of a person: (index of the part, solid with its pose in the part's frame)."""
    return [
        (index, solid)
        for index, part in enumerate(body.parts)
        for piece in part.lofts
        if piece.pieces > 0
        for solid in piece.solids(f"{body.name}/{part.name}/{piece.name}", colors[piece.look])
    ]


def drawn_bodies(
    body: PersonBody, colors: dict[str, tuple[float, float, float]]
) -> list[tuple[str, tuple[Surface, ...]]]:
    """What each part of a person looks like: its name and its surfaces in the part's frame."""
    return [
        (
            f"{body.name}/{part.name}",
            tuple(
                Surface(piece.name, vertices.astype(np.float32), faces, colors[piece.look])
                for piece in part.lofts
                for vertices, faces in (piece.mesh(),)
            ),
        )
        for part in body.parts
    ]


__all__ = [
    "Hand",
    "Mover",
    "MovingObject",
    "Person",
    "drawn_bodies",
    "drawn_solids",
    "make_objects",
    "make_people",
]
