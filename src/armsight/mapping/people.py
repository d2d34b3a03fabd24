"""Where people are or could be: fine voxels where the arm reaches, coarse ones around them."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Bytes, Floats32, Ints32, Mask, Points, Vector3
from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import Change, Layers
from armsight.mapping.hazards import Tracked, UnseenPeople
from armsight.mapping.kernels.flood import face_points, surface_parts, voxel_centers
from armsight.mapping.occupancy import Occupancy
from armsight.mapping.overhead import Overhead
from armsight.mapping.snapshot import FREE, UNKNOWN, Emptiness
from armsight.mapping.static_geometry import StaticGeometry
from armsight.mapping.things import PATIENCE, TOUCHES, Things
from armsight.mapping.tracked import TrackedRegion, TrackedThing

CONFIRM = (2.0, 30.0)
"""Whoever says again that the cell is empty has looked where somebody was thought to be: not sooner
than after so long, and not later [s]."""
SAME = 0.5
"""... and the place is the same one within this [m]."""


class Layer:
    """One grid with its evidence and the people who may hide in it."""

    def __init__(
        self, static: StaticGeometry, cameras: int, config: MappingConfig, around: Layer | None
    ) -> None:
        self.grid = static.grid
        self.occupancy = Occupancy(static, cameras, config.hold, config.weak_window)
        self.things = Things(static.grid, TOUCHES if around is not None else 1)
        self.unseen: UnseenPeople = UnseenPeople(
            static.grid,
            static.filled,
            config.person_speed,
            config.hand,
            None if around is None else around.unseen,
        )


class People:
    """Tells where somebody is or could be, seen or unseen, and what is known to be a thing.

    Args:
        static: declared solids, fine and coarse.
        cameras: how many.
        config: settings.

    Attributes:
        fine, far: the two layers.
        emptiness: what became of the word that nobody is in the cell.
        things: (t, 3) float32 centres in ``base`` [m] of what is no person, as of the last update.
    """

    def __init__(self, static: Layers, cameras: int, config: MappingConfig) -> None:
        self._config = config
        self.far = Layer(static[1], cameras, config, None)
        self.fine = Layer(static[0], cameras, config, self.far if config.has_far_layer else None)
        self.grid = self.fine.grid
        self.emptiness = Emptiness()
        self.things: Floats32 = np.empty((0, 3), np.float32)
        self._surface = surface_parts(config.far_parts)
        self._tracked = TrackedThing(self.grid)
        self._overhead = Overhead(self.grid, config)
        self._lid = self._overhead.lid(self.far.unseen)
        self._waiting_until = np.inf
        self._doubted: tuple[Vector3, float] | None = None  # a place, and when [s]

    def declare_empty(self) -> None:
        """Somebody says that nobody is in the cell; looked at by the next updates."""
        self.emptiness = Emptiness(waiting=True, reason="looking whether the cell is at rest")
        self._waiting_until = np.inf

    def animate(self, points: Points, now: float) -> None:
        """What is at (k, 3) points in ``base`` [m] may move by itself: no thing, for a while."""
        for layer in (self.fine, self.far):
            layer.things.animate(points, now)

    def redeclare(self, change: Change) -> None:
        """Other solids are declared."""
        rows = zip((self.fine, self.far), change.layers, change.filled, change.left)
        for layer, static, filled, left in rows:
            layer.occupancy.redeclare(static, filled)
            layer.unseen.redeclare(static.filled, left)

    def turn_back(self, seconds: float) -> None:
        """The clock was turned back by a time [s]: what was seen occupied stays."""
        for layer in (self.fine, self.far):
            layer.occupancy.turn_back(seconds)
            layer.things.end()
        self._doubted = None
        if self.emptiness.said or self.emptiness.waiting:  # else it would wait for very long
            self.emptiness = Emptiness(reason="the clock was turned back; say it again")

    def state(self, layer: Layer, alive: Bytes) -> Bytes:
        """What is free, occupied and unknown by the word of the living cameras."""
        state = layer.occupancy.state(alive)
        if self._config.unseen_is_empty:
            state[state == UNKNOWN] = FREE
        return state

    def update(
        self,
        state: Bytes,
        body: Bytes,
        alive: Bytes,
        times: tuple[float, float, float],
        region: TrackedRegion | None,
    ) -> tuple[Floats32, Mask]:
        """Where people are or could be: centres of fine voxels, and which are unseen.

        Args:
            state: (nx, ny, nz) of the fine layer; voxels that hide nobody become ENCLOSED.
            body: (nx, ny, nz) uint8, 1 where the arm itself is.
            alive: (cameras,) uint8, whose word counts.
            times: now, since the last update, and of the newest picture [s].
            region: where the thing is that a task asks to touch, or None.
        """
        now, elapsed, stamp = times
        fine, far = self.fine, self.far
        if self.emptiness.waiting:
            self._take_word(alive, now)
        parts: list[tuple[Floats32, bool]] = []
        if self._config.has_far_layer:
            parts = self._far_hazards(self.state(far, alive), elapsed, now)
        seen = self._people(fine, state, fine.occupancy.clusters(self._config.cluster), now)
        self.things = self.centers(fine.things.solid(fine.occupancy.dynamic))
        tracked = None
        if self._tracked.follow(region, stamp, now):
            tracked = Tracked(self._tracked, fine.occupancy.occupied)
        unseen, _ = fine.unseen.update(state, seen, body, elapsed, tracked)
        unseen = unseen[fine.occupancy.occupied[unseen] == 0]
        parts.append((self.centers(seen), False))
        parts.append((self.centers(unseen), True))
        points = np.concatenate([p for p, _ in parts])
        unknown = np.concatenate([np.full(len(p), u) for p, u in parts])
        # Space that hides nobody, such as the arm's own, is not solid.
        fine.unseen.mark_enclosed(state)
        fine.things.keep(state)
        return points, unknown

    def _take_word(self, alive: Bytes, now: float) -> None:
        """Whether the word that the cell is empty can be believed."""
        if np.isinf(self._waiting_until):
            self._waiting_until = now + PATIENCE
        why = "" if alive.all() else "not all cameras give pictures"
        for layer in (self.fine, self.far):
            seen = layer.occupancy
            at = -1 if why else layer.things.moving(seen.clusters(2), seen.occupied, now)
            if at >= 0:
                why = f"something moves near {_told(_center(layer, at))}"
        if why:
            over = now > self._waiting_until
            words = f"the cell is not taken for empty: {why}" if over else why
            self.emptiness = Emptiness(waiting=not over, reason=words)
            return
        somebody = self._somebody()
        if somebody is not None and not self._confirmed(somebody, now):
            self._doubted = somebody, now
            self.emptiness = Emptiness(
                reason="the cell is not taken for empty: somebody may have come in and keep still "
                f"near {_told(somebody)}; look there, and say it again if nobody is"
            )
            return
        for layer in (self.fine, self.far):
            layer.things.begin(layer.occupancy.dynamic, layer.occupancy.occupied, now)
            layer.unseen.nobody()
        self.emptiness = Emptiness(said=True)

    def _somebody(self) -> Vector3 | None:
        """A place where somebody came in and is still, in ``base`` [m]."""
        for layer in (self.fine, self.far):
            seen = layer.occupancy
            at = layer.things.came_in(seen.clusters(2), seen.occupied, layer.unseen.sets)
            if at >= 0:
                return _center(layer, at)
        return None

    def _confirmed(self, place: Vector3, now: float) -> bool:
        """Whether somebody was told of this place, and says again that nobody is there."""
        if self._doubted is None:
            return False
        before, when = self._doubted
        near = float(np.linalg.norm(place - before)) <= SAME
        return near and CONFIRM[0] <= now - when <= CONFIRM[1]

    def _people(self, layer: Layer, state: Bytes, clusters: Ints32, now: float) -> Ints32:
        """Those clusters that are not known to be things."""
        seen = layer.occupancy
        may = layer.things.update(
            state, seen.dynamic, clusters, seen.occupied, layer.unseen.sets, now
        )
        return clusters[may]

    def _far_hazards(self, state: Bytes, elapsed: float, now: float) -> list[tuple[Floats32, bool]]:
        """The same of the coarse layer, outside the fine one, as faces of fine voxels; the lid."""
        far = self.far
        shape = np.asarray(far.grid.shape)
        dynamic = self._people(far, state, far.occupancy.clusters(self._config.far_cluster), now)
        index, faces = far.unseen.update(state, dynamic, None, elapsed)
        above = np.empty((0, 3), np.float32)
        if not self._config.unseen_is_empty:
            above = self._overhead.points(far.unseen.reaching(dynamic, self._lid))
        far.unseen.mark_enclosed(state)
        far.things.keep(state)
        seen = far.occupancy.occupied[index] != 0
        whole = np.full(len(dynamic), 63, np.uint8)
        lower = np.asarray(self.grid.origin, float)
        upper = lower + np.asarray(self.grid.shape) * self.grid.voxel
        out = [(above, True)]
        for cells, open_faces, unseen in (
            (dynamic, whole, False),
            (index[~seen], faces[~seen], True),
        ):
            points = face_points(
                cells,
                open_faces,
                self._surface,
                np.asarray(far.grid.origin, float),
                far.grid.voxel,
                shape,
                self._config.far_parts,
                lower,
                upper,
            )
            out.append((points, unseen))
        return out

    def centers(self, flat: Ints32) -> Floats32:
        """(m, 3) centres in ``base`` [m] of fine voxels by their flat indices."""
        grid = self.grid
        origin = np.asarray(grid.origin, float)
        return voxel_centers(flat, np.asarray(grid.shape), origin, grid.voxel)


def _center(layer: Layer, flat: int) -> Vector3:
    return layer.occupancy.center(np.array([flat], np.int32))[0]


def _told(place: Vector3) -> str:
    x, y, z = place
    return f"({x:.2f}, {y:.2f}, {z:.2f}) m"
