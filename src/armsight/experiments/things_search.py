"""``things-search``: people who try to be taken for a thing, or for nobody."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

from armsight.arrays import Floats, Mask, Vector3
from armsight.experiments.episodes import run_episodes
from armsight.experiments.frame import Experiment, Outcome, Progress
from armsight.experiments.rows import Row, share_row
from armsight.experiments.things_search_kernels import look
from armsight.mapping.hazards import UnseenPeople
from armsight.mapping.snapshot import OCCUPIED, UNKNOWN, VoxelGrid
from armsight.mapping.things import Things

VOXEL = 0.04
GRID = VoxelGrid(np.array([-0.8, -0.8, 0.0]), VOXEL, (40, 40, 40))
STEP = 1.0 / 15
"""Between two pictures [s]."""
SAID, SECONDS = 2.0, 16.0
"""When the cell is said to be empty, and how long an episode is [s]."""
HAND = 0.08
"""The least cube that holds a part of a person [m], as in the packaged cells."""
FASTEST = 2.0
"""Of all that moves [m/s]."""
BESIDE = 2
"""What is this near [voxels] to what counts is counted with it: the map counts cubes of a hand."""
REACHED = 1
"""Whoever is so near [voxels] to the arm, and by BESIDE nearer than 12 cm, has touched it."""
MISSED = 8
"""As many voxels of somebody (half a litre, a fist) that nobody counts are a contact to come."""
EYES = np.array([[1.2, 1.2, 1.9], [-1.2, -1.2, 1.9], [1.2, -1.2, 1.9], [-1.2, 1.2, 1.9]])

ABOUT = f"""
The rule that tells things from people ([guard](../guard.md#things-told-from-people)), the set of
places that could hide somebody beside it, and people who try to get past both: in made-up worlds of
voxels of {1e2 * VOXEL:g} cm, two to four cameras with perfect sight and real shadows, an arm that
turns and hides what is behind it. The cell is empty but for one to three boxes, and is said to be
so after {SAID:g} s. Then somebody (torso, legs, head, an arm; more than 40 litres) comes in from
anywhere at up to {FASTEST:g} m/s, and stands for ten seconds and reaches; crouches behind a box;
lays an arm beside one; carries one to the arm and stays behind it; pushes one before them; comes in
behind a board as large as a door; keeps to where the arm's shadow falls; or throws one and stands
where it came from. They go on at random from there.

Whatever part of somebody is neither seen as a person nor in a place that could hide one would be
touched: `things_contacts` counts the episodes in which {MISSED} voxels or more were so in a
picture, {BESIDE} voxels and more from what is counted, and before they had touched the arm.
"""


@dataclass
class Somebody:
    """A person of boxes and capsules: where they stand, how low, and where a hand is."""

    feet: Vector3
    low: float = 0.0
    hand: Vector3 | None = None

    def shapes(self) -> list[tuple[Vector3, Vector3, float]]:
        """Capsules: (3,) ends [m] and radius [m]."""
        x, y, _ = self.feet
        top = 1.75 - 0.9 * self.low
        hip, neck = 0.5 * top, top - 0.25
        body = [
            (np.array([x - 0.08, y, 0.1]), np.array([x - 0.08, y, hip]), 0.09),
            (np.array([x + 0.08, y, 0.1]), np.array([x + 0.08, y, hip]), 0.09),
            (np.array([x, y, hip]), np.array([x, y, neck - 0.12]), 0.17),
            (np.array([x, y, neck]), np.array([x, y, top - 0.1]), 0.1),
        ]
        shoulder = np.array([x, y, neck - 0.05])
        if self.hand is not None:
            way = self.hand - shoulder
            way *= min(1.0, 0.75 / max(float(np.linalg.norm(way)), 1e-6))
            body.append((shoulder, shoulder + way, 0.06))
        return body


class MadeUp:
    """A world of voxels with the map's rule in it.

    Attributes:
        now: [s]; eyes: (k, 3) places of the cameras [m].
        missed: greatest number of somebody's voxels that nobody counted in a picture; worst: when.
        boxes, board: (3,) middles and half edges [m].
        turning: speed of the arm [rad/s].
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.now = 0.0
        self.missed = 0
        self.worst = 0.0
        self.boxes: list[tuple[Vector3, Vector3]] = []
        self.board: tuple[Vector3, Vector3] | None = None
        self._floor = np.zeros(GRID.shape, np.uint8)
        self._floor[:, :, 0] = 1
        self._rule = Things(GRID)
        self._unseen = UnseenPeople(GRID, self._floor, FASTEST, HAND)
        self.eyes = EYES[rng.permutation(4)[: int(rng.integers(2, 5))]]
        axes = [GRID.origin[a] + (np.arange(GRID.shape[a]) + 0.5) * VOXEL for a in range(3)]
        self._centers = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
        self._turn, self.turning = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(0.0, 0.8))
        self._said = False

    def arm(self) -> list[tuple[Vector3, Vector3, float]]:
        """The arm, which turns about the middle and hides what is behind it."""
        a = self._turn + self.turning * self.now
        elbow = np.array([0.3 * np.cos(a), 0.3 * np.sin(a), 0.75])
        tip = np.array([0.6 * np.cos(a), 0.6 * np.sin(a), 0.35])
        return [(np.zeros(3), np.array([0.0, 0.0, 0.6]), 0.09),
                (np.array([0.0, 0.0, 0.6]), elbow, 0.08), (elbow, tip, 0.07)]  # fmt: skip

    def look(self, who: Somebody | None) -> None:
        """One picture of all cameras, the rule's answer, and what it leaves out."""
        self.now += STEP
        body = self._filled(self.arm())
        person = np.zeros(GRID.shape, bool) if who is None else self._filled(who.shapes())
        person[:, :, 0] = False
        person &= ~body
        matter = body | person | (self._floor != 0)
        for middle, half in (*self.boxes, *([] if self.board is None else [self.board])):
            matter |= (np.abs(self._centers - middle) <= half).all(axis=-1)
        state = np.empty(GRID.shape, np.uint8)
        origin = np.asarray(GRID.origin, float)
        look(matter.astype(np.uint8), origin, VOXEL, self.eyes, state)
        own = body & (self._floor == 0)
        seen = (state == OCCUPIED) & (self._floor == 0) & ~own
        state[own] = UNKNOWN
        listed = np.flatnonzero(seen).astype(np.int32)
        occupied = seen.astype(np.uint8).reshape(-1)
        may = self._rule.update(state, listed, listed, occupied, self._unseen.sets, self.now)
        self._unseen.update(state, listed[may], own.astype(np.uint8), STEP)
        if self._said:
            counted = self._unseen.mask() != 0
            counted.reshape(-1)[listed[may]] = True
            counted |= maximum_filter(body, 2 * REACHED + 1)
            missed = int((person & ~maximum_filter(counted, 2 * BESIDE + 1)).sum())
            if missed > self.missed:
                self.missed, self.worst = missed, self.now
        self._unseen.mark_enclosed(state)
        self._rule.keep(state)
        if not self._said and self.now >= SAID:
            self._said = True
            self._rule.begin(listed, occupied, self.now)
            self._unseen.nobody()

    def _filled(self, capsules: list[tuple[Vector3, Vector3, float]]) -> Mask:
        out = np.zeros(GRID.shape, bool)
        for a, b, radius in capsules:
            low = np.floor((np.minimum(a, b) - radius - GRID.origin) / VOXEL).astype(int)
            high = np.ceil((np.maximum(a, b) + radius - GRID.origin) / VOXEL).astype(int)
            part = tuple(
                slice(max(i, 0), max(j, 0))
                for i, j in zip(low.tolist(), high.tolist(), strict=True)
            )
            off, way = self._centers[part] - a, b - a
            along = np.clip(off @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
            out[part] |= ((off - along[..., None] * way) ** 2).sum(-1) <= radius**2
        return out


def episode(seed: int, run: int) -> dict[str, Any]:
    """One episode; module-level, so that worker processes can import it."""
    rng = np.random.default_rng((seed, 91, run))
    world = MadeUp(rng)
    for _ in range(int(rng.integers(1, 4))):
        half = rng.uniform((0.06, 0.06, 0.06), (0.2, 0.2, 0.3))
        turn, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.65)
        world.boxes.append((np.array([reach * np.cos(turn), reach * np.sin(turn), half[2]]), half))
    while world.now < SAID + rng.uniform(0.1, 1.5):
        world.look(None)
    act = _Act(world, rng)
    TRICKS[_trick(run)](act)
    while world.now < SECONDS:
        act.anything()
    return {
        "cameras": len(world.eyes),
        "missed": world.missed,
        "at": world.worst,
        "contact": bool(world.missed >= MISSED),
    }


class _Act:
    """What somebody does, picture by picture."""

    def __init__(self, world: MadeUp, rng: np.random.Generator) -> None:
        self.world, self.rng = world, rng
        turn = rng.uniform(0, 2 * np.pi)
        self.side = np.array([np.cos(turn), np.sin(turn), 0.0])
        self.who = Somebody(1.4 * self.side)
        self.speed = float(rng.uniform(0.3, FASTEST))
        self._along: Callable[[Vector3], None] | None = None

    def wait(self, seconds: float) -> None:
        """Keep as they are."""
        end = min(self.world.now + seconds, SECONDS)
        while self.world.now < end:
            self.world.look(self.who)

    def walk(self, to: Floats) -> None:
        """Go there, hand and what they hold with them."""
        goal = np.array([to[0], to[1], 0.0])
        while self.world.now < SECONDS:
            way = goal - self.who.feet
            far = float(np.linalg.norm(way))
            if far < 1e-6:
                return
            moved = way * min(1.0, self.speed * STEP / far)
            self.who.feet = self.who.feet + moved
            if self.who.hand is not None:
                self.who.hand = self.who.hand + moved
            if self._along is not None:
                self._along(moved)
            self.world.look(self.who)

    def reach(self, to: Floats, speed: float = FASTEST) -> None:
        """Bring the hand there."""
        if self.who.hand is None:
            self.who.hand = self.who.feet + np.array([0.0, 0.0, 1.2 - 0.6 * self.who.low])
        while self.world.now < SECONDS:
            way = np.asarray(to, float) - self.who.hand
            far = float(np.linalg.norm(way))
            if far < 1e-6:
                return
            self.who.hand = self.who.hand + way * min(1.0, speed * STEP / far)
            self.world.look(self.who)

    def bend(self, low: float) -> None:
        """Crouch, or stand up."""
        while self.world.now < SECONDS and abs(self.who.low - low) > 1e-6:
            self.who.low += float(np.clip(low - self.who.low, -STEP, STEP))
            self.world.look(self.who)

    def box(self) -> tuple[int, Vector3, Vector3]:
        """One of the boxes, and where to stand behind it."""
        k = int(self.rng.integers(len(self.world.boxes)))
        middle, half = self.world.boxes[k]
        away = middle[:2] / max(float(np.linalg.norm(middle[:2])), 1e-6)
        behind = middle[:2] + away * (float(half[:2].max()) + self.rng.uniform(0.2, 0.4))
        return k, middle, np.array([*behind, 0.0])

    def tip(self) -> Vector3:
        """Where the arm's tip is now."""
        return np.asarray(self.world.arm()[-1][1])

    def anything(self) -> None:
        """One of all that they can do, at random."""
        self.speed = float(self.rng.uniform(0.3, FASTEST))
        choice = int(self.rng.integers(5))
        if choice == 0:
            self.reach(self.tip())
        elif choice == 1:
            self.walk(self.rng.uniform(-1.0, 1.0, 2))
        elif choice == 2:
            self.bend(float(self.rng.uniform(0.0, 1.0)))
        elif choice == 3:
            self.wait(float(self.rng.uniform(0.2, 2.0)))
        else:
            self.who.hand = None
            self.world.look(self.who)

    # -- tricks -----------------------------------------------------------------------------------

    def stand(self) -> None:
        self.walk(self.side * self.rng.uniform(0.5, 0.9))
        self.wait(float(self.rng.uniform(5.0, 10.0)))
        self.reach(self.tip())

    def crouch(self) -> None:
        _, middle, behind = self.box()
        self.walk(behind)
        self.bend(1.0)
        self.wait(float(self.rng.uniform(1.0, 4.0)))
        self.reach(middle + np.array([0.0, 0.0, 0.3]))
        self.reach(self.tip())

    def lay(self) -> None:
        _, middle, behind = self.box()
        self.walk(behind)
        self.bend(float(self.rng.uniform(0.4, 1.0)))
        side = self.rng.normal(size=2)
        self.reach(np.array([*(middle[:2] + 0.25 * side / np.linalg.norm(side)), 0.1]), 0.5)
        self.wait(float(self.rng.uniform(2.0, 5.0)))
        self.reach(self.tip())

    def carry(self) -> None:
        k, middle, behind = self.box()
        self.walk(behind)
        self.bend(0.5)
        self.reach(middle)
        self.speed = float(self.rng.uniform(0.2, 1.0))
        self._take(self._box_along(k), self.rng.uniform(-0.5, 0.5, 2))
        self.wait(float(self.rng.uniform(0.5, 4.0)))
        if self.rng.random() < 0.5:
            self.who.hand = None
        self.reach(self.tip())

    def push(self) -> None:
        k, middle, behind = self.box()
        self.walk(behind)
        self.bend(0.5)
        self.reach(np.array([*behind[:2], 0.2]) + 0.5 * (middle - behind))
        self.speed = float(self.rng.uniform(0.1, 1.5))
        self._take(self._box_along(k), -0.3 * middle[:2] + self.rng.uniform(-0.2, 0.2, 2))
        self.wait(float(self.rng.uniform(0.5, 3.0)))

    def trolley(self) -> None:
        across = np.array([abs(self.side[1]), abs(self.side[0]), 0.0])
        half = 0.03 * np.ones(3) + 0.45 * across + np.array([0.0, 0.0, 0.5])
        self.world.board = (1.1 * self.side + np.array([0.0, 0.0, half[2]]), half)

        def along(moved: Vector3) -> None:
            assert self.world.board is not None
            self.world.board = (self.world.board[0] + moved, half)

        self.speed = float(self.rng.uniform(0.2, 1.5))
        self._take(along, self.side * self.rng.uniform(0.5, 0.9))
        self.bend(float(self.rng.uniform(0.0, 1.0)))
        self.wait(float(self.rng.uniform(1.0, 4.0)))
        self.reach(self.tip())

    def shadow(self) -> None:
        self.world.turning = 0.0
        behind = self.tip()[:2] * self.rng.uniform(1.1, 1.4)
        self.walk(behind + self.rng.uniform(-0.2, 0.2, 2))
        self.bend(float(self.rng.uniform(0.0, 1.0)))
        for share in self.rng.uniform(0.0, 1.0, 3):
            _, elbow, _ = self.world.arm()[1]
            self.reach(self.tip() + share * (elbow - self.tip()) - np.array([0.0, 0.0, 0.2]), 1.0)
            self.wait(float(self.rng.uniform(0.2, 1.0)))

    def throw(self) -> None:
        k, middle, behind = self.box()
        self.walk(behind)
        self.reach(middle)
        self.who.hand = None
        way = self.tip() - middle
        for _ in range(int(float(np.linalg.norm(way)) / (FASTEST * STEP))):
            place, half = self.world.boxes[k]
            goes = way / np.linalg.norm(way) * FASTEST * STEP
            self.world.boxes[k] = (place + goes, half)
            self.world.look(self.who)
        place, half = self.world.boxes[k]
        self.world.boxes[k] = (np.array([*place[:2], half[2]]), half)
        self.wait(float(self.rng.uniform(1.0, 4.0)))

    def _box_along(self, k: int) -> Callable[[Vector3], None]:
        def along(moved: Vector3) -> None:
            middle, half = self.world.boxes[k]
            self.world.boxes[k] = (middle + moved, half)

        return along

    def _take(self, along: Callable[[Vector3], None], to: Floats) -> None:
        """Walk there with what moves along, and let go of it."""
        self._along = along
        self.walk(to)
        self._along = None


TRICKS: dict[str, Callable[[_Act], None]] = {
    "stands": _Act.stand,
    "crouches": _Act.crouch,
    "lays an arm down": _Act.lay,
    "carries a box": _Act.carry,
    "pushes a box": _Act.push,
    "comes in behind a board": _Act.trolley,
    "keeps to the arm's shadow": _Act.shadow,
    "throws a box": _Act.throw,
}
"""What somebody does, in turn."""


def _trick(run: int) -> str:
    return list(TRICKS)[run % len(TRICKS)]


def run(runs: int, seed: int, progress: Progress) -> Outcome:
    """``runs`` episodes."""
    found = run_episodes("things-search", episode, range(runs), seed, progress)
    rows: list[Row] = []
    for trick in (None, *TRICKS):
        mine = [e for k, e in enumerate(found) if trick in (None, _trick(k))]
        if not mine:
            continue
        condition = "all episodes" if trick is None else f"somebody who {trick}"
        touched = sum(e["contact"] for e in mine)
        if trick is None:
            rows.append(
                Row(
                    "things_contacts",
                    "episodes in which part of somebody counted as a thing, or as nobody",
                    condition, float(touched), n=len(mine), must=0.0, aim=0.0,
                )
            )  # fmt: skip
        rows.append(
            share_row("missed_share", "share of such episodes", condition, touched, len(mine))
        )
        worst = max(e["missed"] for e in mine)
        rows.append(Row("missed_voxels", "most voxels of 4 cm that were so in a picture", condition,
                        float(worst), n=len(mine)))  # fmt: skip
    by = Counter(_trick(k) for k, e in enumerate(found) if e["contact"])
    notes = [f"{trick}: {n} episodes." for trick, n in by.most_common()]
    return Outcome(tuple(rows), {}, tuple(notes))


EXPERIMENT = Experiment(
    "things-search", "People who try to be taken for a thing, or for nobody", run, 1000, ABOUT
)
