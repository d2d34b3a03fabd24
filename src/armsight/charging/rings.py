"""Double rings in a picture: every port is rings within rings, seen tilted.

Edges vote, across their direction, for the middles of the rings that they may belong to
(*seeds*); about each seed a double ring is tried at all sizes and tilts, and the best climb.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from armsight.arrays import Floats, Floats32, Ints, Pose
from armsight.charging.kernels.rigid import flat_pose
from armsight.charging.kernels.rings import best_rings
from armsight.charging.kernels.templates import distinct
from armsight.charging.kernels.votes import vote_centers, vote_crests
from armsight.charging.pyramid import Level
from armsight.geometry.camera import PinholeCamera

VOTE_RADII = np.array([4.0, 5.0, 6.5, 8.0, 10.0], np.float32)
RING_RADII = np.geomspace(8.5, 21.0, 10)
"""Rings that are voted for, and then tried, at every size of the picture [px]."""
RING_SHARE = 0.76
"""Inner rim over outer rim: 0.73 (Type 2), 0.78 (Type 1), 0.76 (Type 2 plug)."""
BESIDE = np.array([[0, 0], [2, 0], [-2, 0], [0, 2], [0, -2]], np.float32)
"""Where else about a seed a close search looks: lit from one side a slanted port draws the votes
aside, by up to a third of its radius [px of the size that was voted in]."""
GRID, STEP = 0.2, 0.12
"""Rings that are tried everywhere lie so far apart, and are so much larger each than the next, as
shares of their size."""
LEANS = np.deg2rad([[12.0, 0.0], [-12.0, 0.0], [0.0, 12.0], [0.0, -12.0]])
"""They lean as is expected, or by so much more or less."""
LEAST_VOTES = 80
LEAST_RING = 0.2
CROWD = 12
"""A place may hold this part of all rings that are kept: of other sizes and tilts."""


def find_rings(
    levels: Sequence[Level],
    largest: float,
    seeds: int,
    most: int,
    tilts: tuple[tuple[float, int], ...],
    beside: bool = False,
) -> Floats:
    """The best double rings of a picture.

    Args:
        levels: of the picture.
        largest: radius of an outer ring [px].
        seeds: most places that are tried at half the picture's size; fewer at smaller sizes.
        most: rings to return.
        tilts: that are tried [deg], and about how many axes.
        beside: whether rings are tried beside the seeds, too.

    Returns:
        (n, 6) score, u, v [px], tilt along x and y [rad], radius of the outer ring [px].
    """
    rows = [np.zeros((0, 6))]
    for i in range(1, len(levels)):
        if VOTE_RADII[0] / levels[i].scale > largest:
            break
        about = _seeds(levels[i], max(seeds // i, 8))
        if beside:
            about = np.concatenate([about + off for off in BESIDE])
        rows.append(_rings_about(about, levels[i - 1], _leans(tilts)))
    every = np.concatenate(rows)
    every = every[np.argsort(-every[:, 0], kind="stable")]
    return np.asarray(every[distinct(every, most, max(most // CROWD, 1))])


def rings_everywhere(
    lens: PinholeCamera, T_lens_port: Pose, within: float, radii: tuple[float, float]
) -> Floats:
    """Rings at every place of a picture, as a port would show that is about as far and so turned.

    Args:
        lens: that took the picture.
        T_lens_port: about where a port is.
        within: of that place [m].
        radii: the smallest and the largest of outer rings [m].

    Returns:
        Rows as of :func:`find_rings`.
    """
    z = float(T_lens_port[2, 3])
    least, most = lens.fx * radii[0] / (z + within), lens.fx * radii[1] / (z - within)
    sizes = np.geomspace(least, most, max(int(np.ceil(np.log(most / least) / STEP)), 2))
    lean = _lean_of(T_lens_port)
    leans = np.array([lean, *(lean + off for off in LEANS)])
    rows = []
    for size in sizes:
        u, v = np.arange(0.0, lens.width, GRID * size), np.arange(0.0, lens.height, GRID * size)
        at = np.stack(np.meshgrid(u, v, indexing="ij"), -1).reshape(-1, 2)
        place = np.repeat(at, len(leans), axis=0)
        tilt = np.tile(leans, (len(at), 1))
        ones = np.ones((len(place), 1))
        rows.append(np.hstack([ones, place, tilt, size * ones]))
    return np.concatenate(rows)


def _lean_of(T: Pose) -> Floats:
    """(2,) lean about the picture's x and y [rad] of a port, seen along the ray to it."""
    straight = flat_pose(float(T[0, 3]), float(T[1, 3]), float(T[2, 3]), 0.0, 0.0, 0.0)
    along_ray = straight[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    x, y, z = along_ray.T @ T[:3, 2]  # leaning by 0 it is (0, 0, -1)
    aside = float(np.hypot(x, y))
    if aside < 1e-9:
        return np.zeros(2)
    return np.array([y, -x]) / aside * float(np.arctan2(aside, -z))


def level_for(radius: Floats, levels: int) -> Ints:
    """The size of the picture at which a mouth has a radius of 14 to 28 px, or the finest."""
    return np.clip(np.floor(np.log2(np.maximum(radius, 1.0) / 14.0)), 0, levels - 1).astype(int)


def _rings_about(seeds: Floats32, finer: Level, leans: Floats) -> Floats:
    """Rings about seeds, in the next finer size of the picture; rows as in :func:`find_rings`."""
    found = best_rings(
        finer.field,
        2.0 * seeds,
        leans,
        RING_RADII,
        _double_ring(),
        2.0,
        LEAST_RING,
    )
    s, r, t = np.nonzero(found[..., 0] > LEAST_RING)
    score, u, v = found[s, r, t].T
    at = (np.stack([u, v], 1) + 0.5) / finer.scale - 0.5
    return np.column_stack([score, at, leans[t], RING_RADII[r] / finer.scale])


def _seeds(level: Level, most: int) -> Floats32:
    """(n, 2) places with many votes [px of this size]."""
    votes = vote_centers(level.gx, level.gy, level.least, _vote_shapes(), VOTE_RADII)
    crests = vote_crests(votes, LEAST_VOTES)
    order = np.argsort(-crests[:, 0], kind="stable")[:most]
    return (2.0 * crests[order, 1:] + 0.5).astype(np.float32)


@lru_cache(maxsize=1)
def _vote_shapes() -> Floats32:
    """(classes, 2, 2) circles seen head-on and tilted by 38 deg about four axes."""
    shapes = [np.eye(2)] + [_squeeze(np.deg2rad(38), k * np.pi / 4) for k in range(4)]
    return np.array(shapes, np.float32)


def _squeeze(tilt: float, axis: float) -> Floats:
    """(2, 2) a circle tilted about an axis in the picture, as seen from far."""
    a = np.array([np.cos(axis), np.sin(axis)])
    b = np.array([-np.sin(axis), np.cos(axis)])
    return np.asarray(np.outer(a, a) + np.cos(tilt) * np.outer(b, b))


@lru_cache(maxsize=4)
def _leans(tilts: tuple[tuple[float, int], ...]) -> Floats:
    """(t, 2) tilts along x and y of the picture that are tried [rad]."""
    pairs = [(0.0, 0.0)]
    pairs += [(np.deg2rad(t), k * np.pi / axes) for t, axes in tilts for k in range(axes)]
    return np.array([(t * np.cos(a), t * np.sin(a)) for t, a in pairs])


@lru_cache(maxsize=1)
def _double_ring() -> Floats32:
    """(p, 3) points and normal angles, scattered so that a few of them tell early."""
    angle = 2 * np.pi * np.arange(20) / 20
    rows = [(r * np.cos(a), r * np.sin(a), a) for r in (1.0, RING_SHARE) for a in angle]
    order = np.random.default_rng(0).permutation(len(rows))
    return np.array(rows, np.float32)[order]
