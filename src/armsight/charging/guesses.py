"""Types, rolls and tilts at the rings of a picture: flat templates, by similarity of directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from armsight.arrays import Floats, Floats32, Pose
from armsight.charging.kernels.rigid import flat_pose
from armsight.charging.kernels.templates import best_rolls, climb_all
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import PORTS, port
from armsight.charging.pyramid import Level
from armsight.charging.rings import level_for
from armsight.geometry.camera import PinholeCamera

ROLLS = np.deg2rad(  # what is likeliest first: the others are given up earlier
    [0.0, -10.0, 10.0, -20.0, 20.0, -30.0, 30.0, -40.0, 40.0, -50.0, 50.0]
)
FINER = 3
"""Of so many that climbed one climbs on, one size finer."""
OTHER_WAY = 0.2
"""What an edge counts that is light where a cavity should be dark."""


T = TypeVar("T", float, Floats)


@dataclass(frozen=True)
class Climbs:
    """How many guesses go on.

    Attributes:
        of_each: climbs of each type.
        most: guesses to return.
        least: what a type scores less at a ring does not climb;
        behind: nor what promises less than this share of the best of all types.
    """

    of_each: int
    most: int
    least: float
    behind: float


@dataclass(frozen=True)
class Guess:
    """A type at a place, as a flat picture of it.

    Attributes:
        port: its type.
        score: see :func:`armsight.charging.kernels.templates.template_score`.
        u, v: of its origin [px].
        scale: [px/m].
        lean: (2,) tilt along x and y of the picture [rad].
        roll: [rad].
    """

    port: str
    score: float
    u: float
    v: float
    scale: float
    lean: tuple[float, float]
    roll: float

    @property
    def tilt(self) -> float:
        """Angle between the port's axis and the line of sight [rad]."""
        return float(np.hypot(*self.lean))


def guess_types(
    levels: Sequence[Level],
    lens: PinholeCamera,
    rings: Floats,
    ports: Sequence[str],
    distance: tuple[float, float],
    climbs: Climbs,
) -> list[Guess]:
    """The best roll and shape of every type at each ring, the best first.

    Args:
        levels: of the picture.
        lens: that took it.
        rings: of :func:`armsight.charging.rings.find_rings`.
        ports: names of the types.
        distance: nearest and farthest [m].
        climbs: how many.
    """
    guesses, rough = [], {}
    everywhere = _by_size(levels, rings)
    fitting: dict[str, list[tuple[int, Floats]]] = {}
    # a type that holds another is looked for where that may be
    for name in sorted(ports, key=lambda name: bool(PORTS[name].contains)):
        groups = fitting.get(PORTS[name].contains, everywhere)
        every, fitting[name] = _rough(levels, lens, groups, name, distance, climbs.least)
        rough[name] = every[: climbs.of_each]
    tops = [_promise(name, float(best[0, 0])) for name, best in rough.items() if len(best)]
    leader = max(tops, default=0.0)
    for name, best in rough.items():
        promising = best[_promise(name, best[:, 0]) > climbs.behind * leader]
        for k in np.unique(promising[:, 7]).astype(int):
            mine = promising[promising[:, 7] == k, 1:7]
            found = climb_all(levels[k].field, *template(name), mine, 1.5, OTHER_WAY)
            if k:  # edges that ran together part one size finer
                k -= 1
                found = found[np.argsort(-found[:, 0])][: -(-len(found) // FINER), 1:]
                found[:, :2] = 2.0 * found[:, :2] + 0.5
                found[:, 2] *= 2.0
                found = climb_all(levels[k].field, *template(name), found, 2.0, OTHER_WAY)
            scale = levels[k].scale
            for score, u, v, size, x, y, roll in found.tolist():
                at = (u + 0.5) / scale - 0.5, (v + 0.5) / scale - 0.5
                guesses.append(Guess(name, score, *at, size / scale, (x, y), roll))
    guesses.sort(key=lambda g: -_promise(g.port, g.score))
    return _apart(guesses, climbs.most)


def _by_size(levels: Sequence[Level], rings: Floats) -> list[tuple[int, Floats]]:
    """Rings by the size of the picture at which they are compared with templates.

    What lies side by side is looked at one after the other: it is in the cache then.
    """
    near = rings[np.lexsort((rings[:, 1] // 16, rings[:, 2] // 16))]
    size = level_for(near[:, 5], len(levels))
    return [(int(k), near[size == k]) for k in np.unique(size)]


def _rough(
    levels: Sequence[Level],
    lens: PinholeCamera,
    groups: list[tuple[int, Floats]],
    name: str,
    distance: tuple[float, float],
    least: float,
) -> tuple[Floats, list[tuple[int, Floats]]]:
    """(n, 8) the promising places of a type, the best first; those of the rings that they are.

    Score; u, v, scale, tilt along x and y, roll, as at the level that the last column names.
    """
    size_m = ring_radius(name)
    nearest, farthest = (lens.fx * size_m / d for d in (0.8 * distance[0], 1.2 * distance[1]))
    rows, fitting = [np.zeros((0, 8))], []
    for k, rings in groups:
        level = levels[k]
        own = rings[(rings[:, 5] < nearest) & (rings[:, 5] > farthest)]
        if not len(own):
            continue
        at = (own[:, 1:3] + 0.5) * level.scale - 0.5
        scale = own[:, 5] / size_m * level.scale
        promising = np.zeros(len(own), bool)
        # a tilt and its mirror image look alike, but not where parts lie at other depths
        for side in (1.0, -1.0) if PORTS[name].plug else (1.0,):
            starts = np.column_stack([at, scale, side * own[:, 3:5], np.zeros(len(own))])
            scores = best_rolls(level.field, *template(name), starts, ROLLS, OTHER_WAY, least)
            good = scores > least
            promising |= good
            rows.append(np.column_stack([scores, starts, np.full(len(own), k)])[good])
        fitting.append((k, own[promising]))
    every = np.concatenate(rows)
    return every[np.argsort(-every[:, 0], kind="stable")], fitting


def _promise(name: str, score: T) -> T:
    """A small template fits clutter more easily than a large one: scores weighed by size."""
    return score * float(len(template(name)[0])) ** 0.25


def _apart(guesses: Sequence[Guess], most: int) -> list[Guess]:
    """The best guesses, but none twice: of another type, or at another place, size or roll."""
    kept: list[Guess] = []
    for g in guesses:
        r = PORTS[g.port].radius * g.scale
        same = any(
            k.port == g.port
            and np.hypot(g.u - k.u, g.v - k.v) < 0.15 * r
            and 0.8 < g.scale / k.scale < 1.25
            for k in kept
        )
        if not same and sum(k.port == g.port for k in kept) < 0.4 * most and g.score > 0.22:
            kept.append(g)
        if len(kept) == most:
            break
    return kept


@lru_cache(maxsize=32)
def template(name: str) -> tuple[Floats32, Floats32]:
    """A type's edges, scattered: (n, 3) points [m], (n, 2) normals towards the lighter side."""
    model = curves(port(name), 0.002, fit_only=True)
    keep = np.zeros(len(model.points), bool)
    for k, rim in enumerate(model.rims):
        mine = np.flatnonzero(model.rim == k)
        most = 10 if rim.kind == "recess" else 24
        keep[mine[:: max(1, len(mine) // most)]] = True
    order = np.random.default_rng(0).permutation(int(keep.sum()))
    points = model.points[keep].astype(np.float32)[order]
    lighter = np.array([-1.0 if rim.kind == "pedestal" else 1.0 for rim in model.rims])
    normals = model.normals[:, :2] * lighter[model.rim, None]
    return points, normals[keep].astype(np.float32)[order]


@lru_cache(maxsize=32)
def ring_radius(name: str) -> float:
    """Radius of the outer of the two rims that a double ring stands for [m]."""
    entry = port(name)
    rim = entry.of_kind("mouth")[0].outline.radius
    return entry.plate.radius if entry.plug else rim


def pose_of(guess: Guess, lens: PinholeCamera, sign: float) -> Pose:
    """The pose in space of a flat guess, or (sign -1) of its mirror image: from far alike."""
    x, y = lens.normalise(np.array([[guess.u, guess.v]]))[0]
    z = lens.fx / guess.scale
    lean_x, lean_y = guess.lean
    return np.asarray(flat_pose(x * z, y * z, z, sign * lean_x, sign * lean_y, guess.roll))
