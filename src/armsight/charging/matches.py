"""Guesses fitted in space: which of a type's edges are really there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, Ints, Points, Pose
from armsight.charging.kernels.edges import project_lens
from armsight.charging.kernels.rigid import fit_rigid, rim_shares
from armsight.charging.kernels.spots import spots
from armsight.charging.ports.curves import Curves, curves
from armsight.charging.ports.table import PORTS
from armsight.charging.pyramid import Level, edges_of
from armsight.geometry.camera import PinholeCamera

CHANCE = 0.45
"""Share of a wrong type's edges that clutter and kin fill (chosen on the tuning seed)."""
FOUND = 1.5
"""An edge this near to where it should be counts as found [px]."""
FIRST = np.array([5.0, 4.5, 3.5, 3.0, 2.5])
NEAR = np.array([3.0, 2.6, 2.3, 2.0])
THEN = np.array([3.5, 3.0, 2.5])
"""Reaches of the search along the normals, one an iteration [px]."""
CROWDED = 24.0
"""Of a mouth with a smaller radius a plug's pins are 3 px apart, and one takes the next one's edge
for its own: it is fitted one size finer as well [px]."""
LEAST_ALIKE = 0.2
"""Cosine of the greatest angle between normals of points that are looked at together."""
SPOT = 5.5
"""A recess of a smaller radius may be seen as a spot alone: its rim and its pin are one [px]."""
BEYOND = 1.3
"""Where that is compared with what is around it: between it and the next [radii]."""
DIFFERENT, LEAST_DIFFERENT = 3.0, 48.0
"""Least that it differs by: in noise of gradients there, and in levels (16 to a grey level at 100):
a picture that seems to be without noise may hide it in its steps."""
POINTS = 110
"""About as many points are looked for on a type's edges."""


@dataclass(frozen=True, eq=False)
class Match:
    """A type fitted to one picture.

    Attributes:
        port: its type.
        T_camera_port: the pose.
        score: share of its edges that were found, dark where a cavity should be; the contacts'
            recesses and the larger edges count half each. A contact that is too small for its rim
            counts where it is seen as a spot.
        evidence: how much more was found than chance would find, in edges: compares types.
        rim_shares: share found of each edge; rims: their names.
        information: (6, 6) about the pose as a twist in the port's frame, for edges known to 1 px
            of the size of the picture that was used.
    """

    port: str
    T_camera_port: Pose
    score: float
    evidence: float
    rim_shares: Floats
    rims: tuple[str, ...]
    information: Floats

    @property
    def covariance(self) -> Floats:
        """(6, 6) of the pose as a twist in the port's frame."""
        return np.asarray(np.linalg.pinv(self.information + 1e-9 * np.eye(6)), np.float64)


def match(
    levels: Sequence[Level], lens: PinholeCamera, name: str, T: Pose, near: bool = False
) -> Match:
    """Fit a type where its mouth has a radius of 16 to 32 px; a small one larger as well.

    Args:
        levels: of the picture.
        lens: that took it.
        name: of the type.
        T: start.
        near: the start is good to a pixel or two: what is farther is another edge.
    """
    i, reaches = size_for(lens, name, T), NEAR if near else FIRST
    crowded = i == 0 or (i > 0 and mouth_radius(lens, name, T) < CROWDED * 2.0**i)
    return _clearest(levels, lens, name, T, {i, i - crowded}, reaches)


def refined(levels: Sequence[Level], lens: PinholeCamera, m: Match) -> Match:
    """A match fitted again, one size finer.

    A small port is looked at larger than it was taken, and as it was taken, too: less is seen
    of it, but through less noise. What shows more of it stays.
    """
    i = max(size_for(lens, m.port, m.T_camera_port) - 1, -1)
    return _clearest(levels, lens, m.port, m.T_camera_port, {i, max(i, 0)}, THEN)


def size_for(lens: PinholeCamera, name: str, T: Pose) -> int:
    """The size of a picture in which a mouth has a radius of 16 to 32 px; -1 is made larger."""
    return max(int(np.floor(np.log2(max(mouth_radius(lens, name, T), 1.0) / 16.0))), -1)


def mouth_radius(lens: PinholeCamera, name: str, T: Pose) -> float:
    """Radius of a type's mouth in a picture [px]."""
    return float(lens.fx * PORTS[name].radius / max(T[2, 3], 0.05))


def _clearest(
    levels: Sequence[Level],
    lens: PinholeCamera,
    name: str,
    T: Pose,
    sizes: set[int],
    reaches: Floats,
) -> Match:
    """Of the fits at these sizes of the picture the one that shows most."""
    tried = [_match(levels, lens, name, T, i, reaches) for i in sizes]
    return max(tried, key=lambda t: t.evidence)


def _match(
    levels: Sequence[Level], lens: PinholeCamera, name: str, T: Pose, i: int, reaches: Floats
) -> Match:
    model, beside, darker, tolerance, weights, extent = _model(name)
    z = max(T[2, 3], 0.05)
    u, v = project_lens(_numbers(lens), *T[:3, 3].tolist()) if T[2, 3] > 0.0 else (0.0, 0.0)
    seen = edges_of(levels, lens, min(i, len(levels) - 1), u, v, 1.3 * extent * lens.fx / z)
    own = seen.lens
    T, d, rise, H = fit_rigid(
        seen.gx,
        seen.gy,
        _numbers(own),
        model.points,
        model.normals,
        beside,
        T,
        reaches,
        0.8 * seen.least,
        seen.local,
    )
    # makes differ: an edge may be off by its tolerance
    reach = FOUND + own.fx / max(T[2, 3], 0.05) * tolerance
    # an edge that is light where a cavity should be dark counts nothing
    shares = rim_shares(d, rise, model.rim, darker, reach)
    shares = _with_spots(shares, levels, lens, name, T)
    score = float(shares @ weights)
    return Match(
        name,
        T,
        score,
        float(np.sum(shares - CHANCE)),
        shares,
        tuple(rim.name for rim in model.rims),
        H * min(seen.scale, 1.0) ** 2 / max(seen.scale, 1.0) ** 2,
    )


def _with_spots(
    shares: Floats, levels: Sequence[Level], lens: PinholeCamera, name: str, T: Pose
) -> Floats:
    """(rims,) shares, where a contact that is too small for its rim counts if it is seen as a spot.

    Dirt is full of spots: none counts more than the larger edges that it would lie within.
    """
    which, others, middles, radii = _contacts(name)
    within = float(shares[others].mean())
    if T[2, 3] < 0.05 or within < CHANCE:
        return shares
    small = radii * lens.fx / T[2, 3] < SPOT
    if not small.any():
        return shares
    numbers = _numbers(lens)
    u, v = project_lens(numbers, *T[:3, 3].tolist())
    noise = edges_of(levels, lens, 0, u, v, mouth_radius(lens, name, T)).local
    least = max(DIFFERENT * noise, LEAST_DIFFERENT)
    seen = spots(levels[0].soft, numbers, T, middles[small], BEYOND * radii[small], least)
    # of one port either the pins are lighter than what is around them, or the holes are darker
    alike = seen[np.argmax(seen.sum(axis=1))]
    out = shares.copy()
    out[which[small]] = np.maximum(out[which[small]], np.where(alike, within, 0.0))
    return out


@lru_cache(maxsize=32)
def _contacts(name: str) -> tuple[Ints, Ints, Points, Floats]:
    """(m,) which edges are contacts' recesses, which are not; (m, 3) middles, (m,) radii [m]."""
    rims = _model(name)[0].rims
    recess = np.array([rim.kind == "recess" for rim in rims])
    which, others = np.flatnonzero(recess), np.flatnonzero(~recess)
    middles = np.array([(rims[k].outline.x, rims[k].outline.y, rims[k].z) for k in which])
    return which, others, middles, np.array([rims[k].outline.radius for k in which])


def mirrored(T: Pose) -> Pose:
    """The pose with the port's axis mirrored at the line of sight."""
    sight = -T[:3, 3] / np.linalg.norm(T[:3, 3])
    axis = T[:3, 2]
    turn = np.cross(axis, sight)
    angle = float(np.arctan2(np.linalg.norm(turn), axis @ sight))
    out = T.copy()
    if angle > 1e-6:
        about = Rotation.from_rotvec(2 * angle * turn / np.linalg.norm(turn)).as_matrix()
        out[:3, :3] = about @ T[:3, :3]
    return out


def _numbers(lens: PinholeCamera) -> Floats:
    """A lens as the kernels take it, see :func:`project_lens`."""
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion])


@lru_cache(maxsize=32)
def _model(name: str) -> tuple[Curves, Ints, Ints, Floats, Floats, float]:
    """What a type looks like.

    Returns:
        Points along its edges; those beside each, see :func:`neighbours`; of each edge whether it
        grows darker inwards (-1), how makes differ [m] and what it counts in the score; the
        farthest point [m].
    """
    step = 0.004
    while len(curves(PORTS[name], step).points) < POINTS and step > 0.0008:
        step *= 0.9
    model = curves(PORTS[name], step)
    darker = np.array([1 if rim.kind == "pedestal" else -1 for rim in model.rims])
    tolerance = np.array([rim.radius_tolerance + rim.place_tolerance for rim in model.rims])
    small = np.array([rim.kind == "recess" for rim in model.rims])
    weights = 0.5 * np.where(small, 1.0 / small.sum(), 1.0 / (~small).sum())
    return (
        model,
        neighbours(model, step),
        darker,
        tolerance,
        weights,
        float(np.abs(model.points[:, :2]).max()),
    )


def neighbours(model: Curves, step: float) -> Ints:
    """(n, 2) the points before and behind each on its edge, where it does not turn much; else -1.

    Args:
        model: the edges.
        step: between points, about [m].
    """
    gap = model.points[None, :, :2] - model.points[:, None, :2]
    n = model.normals[:, :2]
    along = gap[..., 1] * n[:, None, 0] - gap[..., 0] * n[:, None, 1]
    far = np.linalg.norm(gap, axis=-1)
    beside = (model.rim[:, None] == model.rim) & (far < 2.0 * step) & (n @ n.T > LEAST_ALIKE)
    out = np.full((len(n), 2), -1)
    for k, side in enumerate((-1.0, 1.0)):
        there = np.where(beside & (side * along > 1e-6), far, np.inf)
        nearest = there.argmin(axis=1)
        found = np.isfinite(there.min(axis=1))
        out[found, k] = nearest[found]
    return out
