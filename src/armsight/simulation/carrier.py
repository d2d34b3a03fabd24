"""Somebody who brings what the mouse moves: they fetch it, put it down there, let go and leave.

A thing that flew through the cell by itself would be nothing that the map has a word for but
"somebody". So what the page drags may belong to a person (``carried_by``): they wait at their place
until something of theirs is to be elsewhere, walk there, take it, carry it and set it on whatever
is below, or as near to that as their arm reaches and it can stand; after a second without another
wish they let go and walk back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from armsight.arrays import Floats, Points, Vector3
from armsight.geometry.shapes import Solid
from armsight.simulation.kernels import part_poses
from armsight.simulation.legs import add_legs
from armsight.simulation.motion import RATE, smooth_step
from armsight.simulation.people import PersonBody, person_body
from armsight.simulation.resting import places
from armsight.simulation.scripts import reach
from armsight.simulation.skeleton import (
    INDEX,
    PART_END,
    PART_START,
    PART_TURN,
    Proportions,
    standing,
)
from armsight.simulation.spec import MovingObjectSpec, PersonSpec

APART = 0.5
"""A carrier stands this far from what they reach for [m], or farther where they must."""
HELD = (0.45, -0.10, 1.05)
"""Where they carry it: ahead, to the left, above the floor [m]."""
WALKS, REACHES, TURNS = 0.7, 0.6, 1.2
"""Mean speeds of walking [m/s], of a hand [m/s], of turning [rad/s]."""
LEAST = 0.6
"""No part of a trip is shorter [s]."""
TAKEN = 0.08
"""What the hand comes this near to, it takes [m]."""
WAITS = 1.0
"""What was put down is held for so long, in case it is to go on [s]."""
EXACT = 0.004
"""A hand that ends this near to a place reaches it [m]."""
AIMS = 12
"""How often it is aimed anew, past a place that a soft elbow or a leaning trunk falls short of."""

Hand: TypeAlias = Literal["down", "held"] | Vector3
"""Where the right hand is: hanging, at the carrying place, or at a point of the world (3,) [m]."""


@dataclass(frozen=True)
class Key:
    """A moment of a trip: (x, y, yaw) on the floor [m], [rad], and the right hand."""

    base: Vector3
    hand: Hand = "down"


class Carrier:
    """The person.

    Args:
        spec: of a person whose motion is ``carry``; they walk ``distance`` at most.
        things: what is theirs.
        static: what stands in the cell, in world.
    """

    def __init__(
        self, spec: PersonSpec, things: Sequence[MovingObjectSpec], static: Sequence[Solid]
    ) -> None:
        self.name = spec.name
        self.proportions = Proportions(spec.height)
        self.body: PersonBody = person_body(spec.name, self.proportions)
        self._distance, self._static = spec.distance, tuple(static)
        self._things = {item.solid.name: item.solid for item in things}
        T = spec.T_world_person
        self._home: Vector3 = np.array([*T[:2, 3], np.arctan2(T[1, 0], T[0, 0])])
        self.reset()

    def reset(self) -> None:
        """At home, with empty hands."""
        self._places = {name: s.T_frame_solid[:3, 3].copy() for name, s in self._things.items()}
        self._wish: tuple[str, Vector3] | None = None
        self._holding = self._fetching = ""
        self._here = Key(self._home)
        self._began = 0.0
        self._trip = self._way([self._here, self._here], None)
        self.joints = self._trip[0]
        self._doing: Literal["wait", "fetch", "carry", "leave"] = "leave"

    def place(self, name: str) -> Vector3:
        """(3,) centre of one of their things in world [m]."""
        return self._places[name]

    def bring(self, name: str, target: Vector3 | None) -> None:
        """Wish that a thing of theirs be at a point of the world [m]."""
        self._wish = None if target is None else (name, np.asarray(target, float))

    def drag(self, target: Vector3 | None) -> None:
        """They go by themselves: only their things can be dragged."""

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`.Mover`."""
        at = max(now - self._began, 0.0) * RATE
        if at >= len(self._trip) - 1 and (self._doing != "leave" or self._wish is not None):
            self._next(now)
            at = 0.0
        i = min(int(at), len(self._trip) - 2)
        share = min(at - i, 1.0)
        self.joints = (1.0 - share) * self._trip[i] + share * self._trip[i + 1]
        left = self.joints[INDEX["left_shoulder"]] - self.joints[INDEX["right_shoulder"]]
        left = left * np.array([1.0, 1.0, 0.0])
        left /= max(float(np.linalg.norm(left)), 1e-9)
        if self._holding:
            self._places[self._holding] = self._in_hand(left)
        part_poses(self.joints, PART_START, PART_END, PART_TURN, left, position, quaternion)

    # -- what they do ---------------------------------------------------------------------------

    def _next(self, now: float) -> None:
        """A trip is over: what comes then."""
        done, here = self._doing, self._here
        if done == "fetch" and self._within_reach(self._fetching):
            self._holding = self._fetching
        if self._wish is not None and self._holding == self._wish[0]:
            (name, wish), self._wish = self._wish, None
            there, put = self._put_down(name, wish)
            base = self._here.base
            keys = [here, Key(base, "held"), Key(there, "held"), Key(there, put)]
            self._begin(now, "carry", keys)
        elif self._wish is not None and done == "fetch":
            self._wish = None  # they cannot reach it
            self._begin(now, "wait", [here, here], WAITS)
        elif self._wish is not None:
            name, self._holding = self._wish[0], ""
            self._fetching, place = name, self._places[name]
            there = self._before(place[None])
            grip = self._aim(self._grip(name, place[None], there), there)[0][0]
            self._begin(now, "fetch", [here, Key(here.base), Key(there[0]), Key(there[0], grip)])
        elif done == "carry":
            self._begin(now, "wait", [here, here], WAITS)
        else:
            self._holding = ""
            keys = [here, Key(here.base), Key(self._home)] if done == "wait" else [here, here]
            self._begin(now, "leave", keys)

    def _begin(
        self,
        now: float,
        doing: Literal["wait", "fetch", "carry", "leave"],
        keys: Sequence[Key],
        seconds: float = 0.0,
    ) -> None:
        self._doing, self._began, self._here = doing, now, keys[-1]
        self._trip = self._way(keys, self._trip[-1], seconds)

    def _before(self, place: Points) -> Floats:
        """(k, 3) x, y, yaw where they stand to reach (k, 3) places."""
        way = place[:, :2] - self._home[:2]
        away = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        walked = np.clip(away - APART, 0.0, self._distance)
        stand = self._home[:2] + (walked / away)[:, None] * way
        return np.column_stack([stand, np.arctan2(way[:, 1], way[:, 0])])

    def _put_down(self, name: str, wish: Vector3) -> tuple[Vector3, Vector3]:
        """Where they stand, and where their hand goes, to set a thing down nearest to a wish.

        What cannot stand anywhere within their reach comes back to where they hold it.
        """
        place = places(wish, self._half(name), self._static)
        there = self._before(place)
        aim, missed = self._aim(self._grip(name, place, there), there)
        good = np.flatnonzero(missed < EXACT)
        if len(good) == 0:
            base = self._here.base
            return base, self._hand(base[None], "held")[0]
        return there[good[0]], aim[good[0]]

    def _grip(self, name: str, place: Points, base: Floats) -> Floats:
        """(k, 3) where the hand is that holds a thing at (k, 3) places, from where they stand."""
        ahead = np.column_stack([np.cos(base[:, 2]), np.sin(base[:, 2]), np.zeros(len(base))])
        return np.asarray(place - self._half(name)[0] * ahead)

    def _aim(self, grip: Floats, base: Floats) -> tuple[Floats, Floats]:
        """What to reach for (k, 3) for a hand to end at (k, 3) points; by how much it misses."""
        aim = grip.copy()
        for _ in range(AIMS):
            short = grip - self._stood(base, aim)[:, INDEX["right_hand"]]
            aim += short
        missed = grip - self._stood(base, aim)[:, INDEX["right_hand"]]
        return aim, np.asarray(np.linalg.norm(missed, axis=1))

    def _within_reach(self, name: str) -> bool:
        hand, base = self.joints[INDEX["right_hand"]], self._here.base
        grip = self._grip(name, self._places[name][None], base[None])[0]
        return float(np.linalg.norm(hand - grip)) < TAKEN

    def _in_hand(self, left: Vector3) -> Vector3:
        """(3,) centre of what is held [m]."""
        ahead = np.array([left[1], -left[0], 0.0])
        return np.asarray(self.joints[INDEX["right_hand"]] + self._half(self._holding)[0] * ahead)

    def _half(self, name: str) -> Vector3:
        """(3,) half a thing's extent along its axes [m]; it is carried as it stands."""
        solid = self._things[name]
        a, b, c = solid.size
        if solid.kind == "box":
            return 0.5 * np.array([a, b, c])
        return np.array([a, a, 0.5 * b if solid.kind == "cylinder" else a])

    # -- how they move --------------------------------------------------------------------------

    def _way(self, keys: Sequence[Key], start: Floats | None, seconds: float = 0.0) -> Floats:
        """(k, 19, 3) joints at :data:`.RATE` in world [m] through some keys, at rest in each."""
        parts = [self._leg(a, b, seconds) for a, b in pairwise(keys)]
        joints = np.concatenate([parts[0][:1], *(part[1:] for part in parts)])
        add_legs(joints, self.proportions, start=start)
        return joints

    def _leg(self, a: Key, b: Key, seconds: float) -> Floats:
        """(k, 19, 3) joints from one key to the next, legs unset."""
        turn = (b.base[2] - a.base[2] + np.pi) % (2.0 * np.pi) - np.pi
        ends = [self._hand(key.base[None], key.hand)[0] for key in (a, b)]
        length = max(
            float(np.linalg.norm(b.base[:2] - a.base[:2])) / WALKS,
            float(np.linalg.norm(ends[1] - ends[0])) / REACHES if a.hand is not b.hand else 0.0,
            abs(turn) / TURNS,
            seconds or LEAST,
        )
        w = smooth_step(np.linspace(0.0, 1.0, max(round(length * RATE), 1) + 1))[:, None]
        step = np.append(b.base[:2] - a.base[:2], turn)
        base = a.base + w * step
        hand = (1.0 - w) * self._hand(base, a.hand) + w * self._hand(base, b.hand)
        return self._stood(base, hand)

    def _stood(self, base: Floats, hand: Floats) -> Floats:
        """(k, 19, 3) joints in world [m] at (k, 3) places of the feet, reaching for (k, 3) points.

        Legs are as they stand upright.
        """
        pose = standing(self.proportions)
        c, s = np.cos(base[:, 2])[:, None], np.sin(base[:, 2])[:, None]
        joints: Floats = np.repeat(np.asarray(pose, float)[None], len(base), axis=0)
        joints[..., 0] = c * pose[:, 0] - s * pose[:, 1] + base[:, :1]
        joints[..., 1] = s * pose[:, 0] + c * pose[:, 1] + base[:, 1:2]
        reach(joints, "right", hand, self.proportions)
        return joints

    def _hand(self, base: Floats, hand: Hand) -> Floats:
        """(k, 3) a hand's place in world [m] for (k, 3) places of the feet."""
        if not isinstance(hand, str):
            return np.repeat(np.asarray(hand, float)[None], len(base), axis=0)
        hanging = standing(self.proportions)[INDEX["right_hand"]]
        x, y, z = hanging if hand == "down" else HELD
        c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
        return np.stack(
            [base[:, 0] + c * x - s * y, base[:, 1] + s * x + c * y, np.full(len(base), z)], axis=1
        )


class CarriedThing:
    """What a carrier brings where it is dragged."""

    def __init__(self, name: str, carrier: Carrier) -> None:
        self.name = name
        self._carrier = carrier

    @property
    def position(self) -> Vector3:
        """(3,) its centre in world [m]."""
        return self._carrier.place(self.name)

    def reset(self) -> None:
        """Its carrier keeps its place."""

    def drag(self, target: Vector3 | None) -> None:
        """Have it brought to a point of the world [m]."""
        self._carrier.bring(self.name, target)

    def update(self, now: float, position: Floats, quaternion: Floats) -> None:
        """See :class:`.Mover`; people have moved before."""
        position[0] = self.position
