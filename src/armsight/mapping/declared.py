"""Solids that are declared and withdrawn while the cell runs: a parked car, a fixture, a trolley.

Somebody says that something stands somewhere. It is believed once every living camera has looked
and none sees through it; from then on it is what a solid of the cell's file is: it explains returns
from its own surfaces and nothing else (what is seen deeper inside than it is declared coarsely may
be a person), nobody is inside, and paths keep clear of it. A camera that sees through it later
withdraws it: whatever stands there then may be a person, and so may be what was hidden inside.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Mask, Pose
from armsight.errors import UsageError
from armsight.geometry.pose import inverse, is_rotation
from armsight.geometry.shapes import Solid
from armsight.mapping.kernels.pixels import VALID
from armsight.mapping.kernels.solids import trace_solids
from armsight.mapping.snapshot import Declared, VoxelGrid
from armsight.mapping.static_geometry import KINDS, StaticGeometry, rasterise

NEAR_SOLID = 0.1
"""How far from a declared solid a hit may still be explained by it [m]."""
STEP: Final = 4
"""Every so many pixels of a picture are looked at, in both directions."""
BEHIND: Final = (0.06, 0.02, 3.0)
"""A return this far behind a surface was seen through it [m], and so much a metre, and sigmas."""
SHARE: Final = 0.05
"""A camera sees through a solid at more than this share of the pixels that it fills ..."""
LEAST: Final = 30
"""... and at least at so many."""
LOOKS: Final = 3
"""Pictures of each camera that must not contradict."""
WAIT: Final = 2.0
"""Cameras that have not looked after so long [s] leave a declaration refused."""

Layers = tuple[StaticGeometry, StaticGeometry]
"""Fine and coarse."""


@dataclass(frozen=True)
class Change:
    """What the map must take over.

    Attributes:
        layers: the solids from now on.
        filled: by layer, voxels that are newly filled; left: that are no longer (bool).
    """

    layers: Layers
    filled: tuple[Mask, Mask]
    left: tuple[Mask, Mask]


@dataclass(frozen=True)
class _Wish:
    """A declaration (and which fine voxels it fills) or a withdrawal; waits for the next update."""

    name: str
    solids: tuple[Solid, ...]
    own: Bytes | None


class DeclaredSolids:
    """The solids of one map: those of the cell's file, and those that come and go.

    Args:
        static: of the cell's file, in ``base``.
        grids: fine and coarse.

    Attributes:
        layers: all that are believed now.
        told: what became of those that were declared while the cell runs.
    """

    def __init__(self, static: Sequence[Solid], grids: tuple[VoxelGrid, VoxelGrid]) -> None:
        self._static = tuple(static)
        self._grids = grids
        self.layers: Layers = self._rasterised(self._static)
        self._known: dict[frozenset[str], Layers] = {frozenset(): self.layers}
        self.told: tuple[Declared, ...] = ()
        self._wishes: list[_Wish] = []
        self._lock = threading.Lock()
        self._looks: dict[int, int] = {}
        self._until = np.inf

    def declare(self, name: str, solids: Sequence[Solid]) -> None:
        """Say that solids (in ``base``) stand there from now on; from any thread.

        Raises:
            UsageError: the name is taken, a solid cannot be, or none of them is in the fine map.
        """
        with self._lock:
            count = len(self._static) + sum(len(d.solids) for d in self.told if d.held)
            if name in self._standing(self.watched):
                raise UsageError(f"'{name}' is declared already; withdraw it first")
        for solid in solids:
            _check(name, solid)
        if not solids or count + len(solids) > 255:
            raise UsageError(f"'{name}' has {len(solids)} solids; expected 1 to {255 - count}")
        own = rasterise(tuple(solids), self._grids[0], NEAR_SOLID).filled
        if not own.any():
            raise UsageError(f"'{name}' lies outside the mapped space, where it changes nothing")
        # Here and not in the update that takes it: that one must not be late.
        others = {d.name: d.solids for d in self.told if d.taken and d.name != name}
        beside = [s for those in others.values() for s in those]
        layers = self._rasterised((*self._static, *beside, *solids))
        with self._lock:
            self._known[frozenset((*others, name))] = layers
            self._wishes.append(_Wish(name, tuple(solids), own))

    def withdraw(self, name: str) -> None:
        """Say that solids do not stand there any more; from any thread.

        Raises:
            UsageError: nothing was declared by this name.
        """
        with self._lock:
            known = self._standing(self.told)
            if name not in known:
                raise UsageError(
                    f"'{name}' was not declared; declared are {', '.join(known) or 'none'}"
                )
            self._wishes.append(_Wish(name, (), None))

    @property
    def watched(self) -> tuple[Declared, ...]:
        """Those that cameras must look at."""
        return tuple(d for d in self.told if d.held)

    def begin(self, now: float, body: Bytes) -> Change | None:
        """Take the next wish at ``now`` [s]; what changes at once.

        Args:
            now: time [s].
            body: (nx, ny, nz) uint8 of the fine grid, 1 close to the arm.
        """
        with self._lock:
            looking = any(d.waiting for d in self.told)
            wish = self._wishes[0] if self._wishes else None
            if wish is None or (wish.own is not None and looking):
                return None
            self._wishes.pop(0)
            others = tuple(d for d in self.told if d.name != wish.name)
            if wish.own is None:
                gone = next((d for d in self.told if d.name == wish.name), None)
                self.told = others
                return self._change() if gone is not None and gone.taken else None
            new = Declared(wish.name, wish.solids, waiting=True, reason="cameras are looking at it")
            if (wish.own & body).any():
                new = replace(new, waiting=False, reason="refused: the arm itself is there")
            self.told = (*others, new)
            self._looks, self._until = {}, now + WAIT
            return None

    def judge(
        self, now: float, through: Sequence[tuple[int, str, tuple[str, ...]]], living: Sequence[int]
    ) -> Change | None:
        """What the newest pictures say; what changes by it.

        Args:
            now: time [s].
            through: camera, its name, and the solids that its picture sees through.
            living: cameras whose word counts.
        """
        told: list[Declared] = []
        changed = False
        for d in self.told:
            by = next((camera for _, camera, names in through if d.name in names), "")
            if d.held and by:
                words = "refused" if d.waiting else "withdrawn"
                changed |= d.taken
                d = replace(
                    d, taken=False, waiting=False, reason=f"{words}: camera {by} sees through it"
                )
            elif d.waiting:
                for camera, _, _ in through:
                    self._looks[camera] = self._looks.get(camera, 0) + 1
                if all(self._looks.get(camera, 0) >= LOOKS for camera in living):
                    d, changed = replace(d, taken=True, waiting=False, reason=""), True
                elif now > self._until:
                    words = "refused: not all cameras gave pictures"
                    d = replace(d, waiting=False, reason=words)
            told.append(d)
        with self._lock:
            self.told = tuple(told)
        return self._change() if changed else None

    def turn_back(self, seconds: float) -> None:
        """The clock was turned back by a time [s]: cameras are waited for no longer than before."""
        self._until -= seconds

    def _standing(self, told: Sequence[Declared]) -> list[str]:
        """Names of what was declared once all wishes are taken."""
        names = [d.name for d in told]
        for wish in self._wishes:
            names = [n for n in names if n != wish.name]
            if wish.own is not None:
                names.append(wish.name)
        return names

    def _change(self) -> Change:
        taken = [d for d in self.told if d.taken]
        names = frozenset(d.name for d in taken)
        if names not in self._known:
            solids = [s for d in taken for s in d.solids]
            self._known[names] = self._rasterised((*self._static, *solids))
        before, self.layers = self.layers, self._known[names]
        self._known = {key: self._known[key] for key in {frozenset[str](), names}}
        pairs = [(b.filled != 0, a.filled != 0) for b, a in zip(before, self.layers)]
        filled, left = ([(a & ~b) for b, a in pairs], [(b & ~a) for b, a in pairs])
        return Change(self.layers, (filled[0], filled[1]), (left[0], left[1]))

    def _rasterised(self, solids: tuple[Solid, ...]) -> Layers:
        fine, far = (rasterise(solids, grid, NEAR_SOLID) for grid in self._grids)
        return fine, far


def _check(name: str, solid: Solid) -> None:
    """Refuse a solid that cannot be.

    Raises:
        UsageError: its kind, size or pose.
    """
    needed = {"box": 3, "cylinder": 2, "sphere": 1}.get(solid.kind)
    if needed is None:
        raise UsageError(f"'{name}': a solid is a {solid.kind}; expected box, cylinder or sphere")
    size = np.asarray(solid.size, float)
    if size.shape != (3,) or not np.isfinite(size).all() or (size[:needed] <= 0.0).any():
        raise UsageError(f"'{name}': size {tuple(solid.size)} m; expected {needed} above 0")
    if size.max() > 20.0:
        raise UsageError(f"'{name}': size {tuple(solid.size)} m; expected metres, at most 20")
    T = np.asarray(solid.T_frame_solid, float)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise UsageError(f"'{name}': its pose is no finite 4 x 4 matrix")
    if not (is_rotation(T[:3, :3]) and np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0])):
        raise UsageError(f"'{name}': its pose is not a rotation and a translation")
    if not 0.0 <= solid.coarse < np.inf:
        raise UsageError(f"'{name}': coarse is {solid.coarse} m; expected 0 or more")


class Looker:
    """Whether one camera sees through solids that were declared while it runs."""

    def __init__(self, rays: Floats32, range_: tuple[float, float], noise: Floats) -> None:
        self._at = (slice(STEP // 2, None, STEP), slice(STEP // 2, None, STEP))
        self._rays = np.ascontiguousarray(rays[self._at])
        self._range, self._noise = range_, np.asarray(noise, float)
        self._limits: dict[str, tuple[bytes, Floats32]] = {}

    def through(
        self, depth: Floats32, label: Bytes, T: Pose, watched: Sequence[Declared]
    ) -> tuple[str, ...]:
        """Names of the solids that a picture sees through.

        Args:
            depth: (h, w) float32 [m].
            label: (h, w) uint8, VALID where there is a return that is not the arm.
            T: where the camera was, in ``base``.
            watched: what was declared.
        """
        if not watched:
            self._limits.clear()
            return ()
        usable = label[self._at] == VALID
        sample = depth[self._at]
        found = []
        for declared in watched:
            limit = self._limit(declared, T)
            filled = usable & np.isfinite(limit)
            count = int((filled & (sample > limit)).sum())
            if count >= LEAST and count > SHARE * int(filled.sum()):
                found.append(declared.name)
        return tuple(found)

    def _limit(self, declared: Declared, T: Pose) -> Floats32:
        """(h, w) depth behind which a return was seen through it [m]; inf beside it."""
        key = T.tobytes() + b"".join(
            np.asarray(s.T_frame_solid).tobytes() + repr(s.size).encode() for s in declared.solids
        )
        known = self._limits.get(declared.name)
        if known is not None and known[0] == key:
            return known[1]
        first, last = (np.empty(self._rays.shape[:2], np.float32) for _ in range(2))
        everywhere = np.full(3, 1e3)
        solids = declared.solids
        trace_solids(
            self._rays,
            np.ascontiguousarray(T),
            self._noise,
            *self._range,
            -everywhere,
            everywhere,
            (
                np.array([KINDS[s.kind] for s in solids], np.int64),
                np.array([s.size for s in solids], float),
                np.array([inverse(s.T_frame_solid) for s in solids], float),
                np.full(len(solids), np.inf),
            ),
            BEHIND,
            first,
            last,
        )
        self._limits[declared.name] = (key, last)
        return last
