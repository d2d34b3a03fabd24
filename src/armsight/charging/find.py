"""Finds charging ports and plugs in one grey picture, and says which type each is.

Shape-based matching of edge directions (as in the charging paper), from coarse to fine:

1. *Seeds.* Every edge votes, across its direction, for the middle of the rings that it may belong
   to, at a few tilts and sizes: ports are rings within rings.
2. *Rings.* About each seed a double ring is tried at all sizes and tilts.
3. *Types.* The best rings are compared with the template of every type at every roll; a few steps
   of hill-climbing in place, size, tilt and roll.
4. *Fit.* The known edges are fitted in space (:mod:`armsight.charging.fit`); the score is the
   share of them that is really there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from armsight.arrays import Bytes, Floats, Floats32, Ints, Pose
from armsight.charging.fit import Fit, FitOptions, fit
from armsight.charging.kernels import best_rings, best_roll, climb, fit_rigid, vote_centers
from armsight.charging.looks import look, window_about
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import PORTS, Port, port
from armsight.charging.pyramid import Level, pyramid
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import make_pose

VOTE_RADII = np.array([4, 5, 6, 7, 8, 9, 10], np.int64)
RING_RADII = np.geomspace(9.0, 21.0, 11).astype(np.float32)
"""Rings that are voted for, at every size of the picture [px]."""
RING_SHARE = 0.76
"""Inner rim over outer rim: 0.73 (Type 2), 0.78 (Type 1), 0.76 (Type 2 plug)."""
ROLLS = 36
LEAST_ROUGH = 0.55
PLUG_TRIES = tuple((side, size) for side in (1.0, -1.0) for size in (0.9, 1.0, 1.12))
LEAST_RING = 0.7
QUICK_REACHES = np.array([5.0, 5.0, 4.0, 3.5, 3.0, 2.5, 2.5])
KIN = {
    "type1": ("ccs1",),
    "type2": ("ccs2", "type2_plug"),
    "ccs1": ("type1",),
    "ccs2": ("type2",),
    "type2_plug": ("type2", "ccs2_plug"),
    "ccs2_plug": ("type2_plug",),
}
"""Types that look alike, or hold one another: where one fits, the others are tried."""
INLETS = ("type1", "type2", "ccs1", "ccs2")
PLUGS = ("type1_plug", "type2_plug", "ccs2_plug")


@dataclass(frozen=True)
class FindOptions:
    """What to look for, and how hard.

    Attributes:
        ports: names of the types.
        distance: nearest and farthest [m].
        least_score: what is below is not reported.
        seeds: per size of the picture; rings, quick_fits, fits: how many go on to each stage.
    """

    ports: tuple[str, ...] = (*INLETS, "type2_plug")
    distance: tuple[float, float] = (0.25, 2.8)
    least_score: float = 0.6
    seeds: int = 60
    rings: int = 24
    quick_fits: int = 14
    fits: int = 3


@dataclass(frozen=True, eq=False)
class Detection:
    """A port that was found.

    Attributes:
        port: its type.
        score: share of its edges that were seen where they should be, 0..1.
        T_camera_port: its pose by this picture alone; from far the tilt is weak.
        covariance: (6, 6) of that, as a twist in the port's frame.
        pixel: (2,) of its origin.
        scale: of the picture there [px/m].
        fit: all of the fit.
        margin: score less that of the best other type at the same place.
    """

    port: str
    score: float
    T_camera_port: Pose
    covariance: Floats
    pixel: Floats
    scale: float
    fit: Fit
    margin: float


@dataclass(frozen=True)
class _Guess:
    """A type at a place, as a flat picture of it."""

    port: str
    score: float
    u: float
    v: float
    scale: float  # px/m in the whole picture
    tilt: float
    axis: float
    roll: float


def find_ports(
    image: Bytes,
    lens: PinholeCamera,
    options: FindOptions | None = None,
    windows: Sequence[tuple[int, int, int, int]] | None = None,
) -> tuple[Detection, ...]:
    """Ports in a picture, the surest first.

    Args:
        image: (h, w) grey, uint8.
        lens: that took it.
        options: what to look for.
        windows: (top, bottom, left, right) parts to search [px]; the whole picture if absent.

    Raises:
        UsageError: the picture is no grey picture of the lens's size.
    """
    options = options or FindOptions()
    check_picture(image, lens)
    if windows is None:
        return _merge(_find(image, lens, options))
    found: list[Detection] = []
    for top, bottom, left, right in windows:
        part = np.ascontiguousarray(image[top:bottom, left:right])
        own = replace(
            lens, width=right - left, height=bottom - top, cx=lens.cx - left, cy=lens.cy - top
        )
        for d in _find(part, own, options):
            found.append(replace(d, pixel=d.pixel + np.array([left, top])))
    return _merge(found)


def check_picture(image: Bytes, lens: PinholeCamera) -> None:
    """Refuse what cannot be searched.

    Raises:
        UsageError: says what is wrong.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise UsageError(
            f"find: the picture has shape {image.shape} and type {image.dtype}; "
            "give a grey picture (h, w) of uint8"
        )
    if image.shape != (lens.height, lens.width):
        h, w = image.shape
        raise UsageError(
            f"find: the picture has {w}x{h} pixels, its lens {lens.width}x{lens.height}; "
            "give the lens of this picture"
        )
    if min(image.shape) < 48:
        raise UsageError(
            f"find: a picture of {image.shape[1]}x{image.shape[0]} pixels is too small"
        )


def dark_windows(image: Bytes, margin: int = 40, most: int = 4) -> list[tuple[int, int, int, int]]:
    """Windows about the darker-than-average regions, where black plastic may be; largest first."""
    small = cv2.resize(image, None, fx=0.125, fy=0.125, interpolation=cv2.INTER_AREA)
    dark = (small < 0.7 * float(small.mean())).astype(np.uint8)
    count, _, stats, _ = cv2.connectedComponentsWithStats(dark)
    h, w = image.shape
    out = []
    for i in np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:most] + 1:
        x, y, dx, dy, area = (int(v) for v in stats[i])
        if area >= 4:
            out.append(
                (
                    max(0, 8 * y - margin),
                    min(h, 8 * (y + dy) + margin),
                    max(0, 8 * x - margin),
                    min(w, 8 * (x + dx) + margin),
                )
            )
    return out


def _find(image: Bytes, lens: PinholeCamera, options: FindOptions) -> list[Detection]:
    levels = pyramid(image)
    rings = _rings(levels, lens, options)
    guesses = _types(levels, lens, rings, options)
    return _fits(image, lens, levels, guesses, options)


def _rings(levels: Sequence[Level], lens: PinholeCamera, options: FindOptions) -> Floats:
    """(n, 6) score, u, v, leans, radius [px of the whole picture] of the best double rings."""
    largest = lens.fx * 0.050 / options.distance[0]
    rows = []
    for i in range(1, len(levels)):
        if VOTE_RADII[0] / levels[i].scale > largest:
            break
        seeds = _seeds(levels[i], options.seeds)
        if len(seeds):
            rows.append(_rings_about(levels[i - 1], 2.0 * seeds))
    if not rows:
        return np.zeros((0, 6))
    every = np.concatenate(rows)
    return _apart(every[np.argsort(-every[:, 0])], options.rings)


def _rings_about(level: Level, seeds: Floats32) -> Floats:
    """Rings about seeds of one size of the picture: tried roughly, the better ones climbed."""
    shapes, leans = _tilts()
    found = best_rings(level.bits, seeds, shapes, RING_RADII, _double_ring(), _grid(2.0, 3))
    crest = found[:, :, 0] >= np.maximum(
        np.pad(found[:, :-1, 0], ((0, 0), (1, 0))), np.pad(found[:, 1:, 0], ((0, 0), (0, 1)))
    )
    s, r = np.nonzero(crest & (found[:, :, 0] >= LEAST_RING))
    model = _double_ring()
    points = np.column_stack([model[:, :2], np.zeros(len(model), np.float32)])
    normals = np.stack([np.cos(model[:, 2]), np.sin(model[:, 2])], 1).astype(np.float32)
    rows = np.zeros((len(s), 6))
    for k, (i, j) in enumerate(zip(s, r)):
        _, u, v, t = found[i, j]
        start = np.array([u, v, RING_RADII[j], *leans[int(t)], 0.0])
        score, end = climb(level.gx, level.gy, 0.7 * level.least, points, normals, start, 1.5)
        at = (end[:2] + 0.5) / level.scale - 0.5
        rows[k] = (score, *at, end[3], end[4], end[2] / level.scale)
    return rows


def _apart(rows: Floats, most: int) -> Floats:
    """The first rings that differ in place or size."""
    kept: list[Floats] = []
    for row in rows:
        same = any(
            np.hypot(*(row[1:3] - k[1:3])) < 0.2 * k[5] and 0.88 < row[5] / k[5] < 1.13
            for k in kept
        )
        if not same:
            kept.append(row)
        if len(kept) == most:
            break
    return np.array(kept).reshape(-1, 6)


def _seeds(level: Level, most: int) -> Floats32:
    """(n, 2) places with many votes."""
    votes = vote_centers(level.size, level.angle, level.least, _vote_shifts(), VOTE_RADII)
    best: Floats32 = np.zeros(level.gx.shape, np.float32)
    for layer in votes:
        best = np.maximum(
            best, cv2.boxFilter(layer.astype(np.float32), -1, (3, 3), normalize=False)
        )
    crest = best == cv2.dilate(best, np.ones((3, 3), np.uint8))
    v, u = np.nonzero(crest & (best >= 8))
    order = np.argsort(-best[v, u], kind="stable")[:most]
    return np.stack([u[order], v[order]], 1).astype(np.float32)


@lru_cache(maxsize=1)
def _vote_shifts() -> Floats32:
    """(classes, directions, 2); see :func:`vote_centers`."""
    directions = 64
    angle = 2 * np.pi * np.arange(directions) / directions
    normal = np.stack([np.cos(angle), np.sin(angle)], 1)
    shapes = [np.eye(2)] + [_squeeze(np.deg2rad(38), k * np.pi / 4) for k in range(4)]
    out = []
    for A in shapes:
        m = normal @ A  # A^T n: the circle's own normal
        out.append((m / np.linalg.norm(m, axis=1, keepdims=True)) @ A.T)
    return np.array(out, np.float32)


def _squeeze(tilt: float, axis: float) -> Floats:
    """(2, 2) a circle tilted about an axis in the picture, as seen from far."""
    a = np.array([np.cos(axis), np.sin(axis)])
    b = np.array([-np.sin(axis), np.cos(axis)])
    return np.asarray(np.outer(a, a) + np.cos(tilt) * np.outer(b, b))


@lru_cache(maxsize=1)
def _tilts() -> tuple[Floats32, Floats]:
    """(t, 2, 2) shapes and (t, 2) leans along x and y of the picture [rad] that are tried."""
    pairs = [(0.0, 0.0)]
    pairs += [(np.deg2rad(27), k * np.pi / 4) for k in range(4)]
    pairs += [(np.deg2rad(42), k * np.pi / 6) for k in range(6)]
    shapes = np.array([_squeeze(t, a) for t, a in pairs], np.float32)
    return shapes, np.array([(t * np.cos(a), t * np.sin(a)) for t, a in pairs])


@lru_cache(maxsize=1)
def _double_ring() -> Floats32:
    """(p, 3) points and normal angles, scattered so that a few of them tell early."""
    angle = 2 * np.pi * np.arange(20) / 20
    rows = [(r * np.cos(a), r * np.sin(a), a) for r in (1.0, RING_SHARE) for a in angle]
    order = np.random.default_rng(0).permutation(len(rows))
    return np.array(rows, np.float32)[order]


def _grid(step: float, n: int) -> Floats32:
    at = step * (np.arange(n) - 0.5 * (n - 1))
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2).astype(np.float32)


@lru_cache(maxsize=32)
def template(name: str) -> tuple[Floats32, Floats32]:
    """A type's edges: (n, 3) points [m] and (n, 2) normals, small ones as dense as large ones."""
    model = curves(port(name), 0.002, fit_only=True)
    keep = np.zeros(len(model.points), bool)
    for k, rim in enumerate(model.rims):
        mine = np.flatnonzero(model.rim == k)
        most = 12 if rim.kind == "recess" else 26
        keep[mine[:: max(1, len(mine) // most)]] = True
    return model.points[keep].astype(np.float32), model.normals[keep, :2].astype(np.float32)


def _types(
    levels: Sequence[Level], lens: PinholeCamera, rings: Floats, options: FindOptions
) -> list[_Guess]:
    """The best roll and shape of every type at each ring, the best first."""
    guesses = []
    nearest, farthest = 0.8 * options.distance[0], 1.2 * options.distance[1]
    for _, u, v, lean_x, lean_y, radius in rings:
        level = _level_for(levels, radius)
        soft = 0.7 * level.least
        at = (np.array([u, v]) + 0.5) * level.scale - 0.5
        for name in options.ports:
            size_m = _ring_radius(name)
            if not nearest < lens.fx * size_m / radius < farthest:
                continue
            points, normals = template(name)
            # a tilt and its mirror image look alike, but not where parts lie at other depths;
            # and the body behind a plug's mouth moves its outer ring
            plug = PORTS[name].plug
            for side, size in PLUG_TRIES if plug else ((1.0, 1.0),):
                lean = (side * lean_x, side * lean_y)
                start = np.array([*at, size * radius / size_m * level.scale, *lean, 0.0])
                rough, best = best_roll(level.bits, points, normals, start, ROLLS)
                if rough < LEAST_ROUGH:
                    continue
                score, best = climb(level.gx, level.gy, soft, points, normals, best, 1.5)
                guesses.append(_guess(name, score, best, level))
    guesses.sort(key=_promise)
    return guesses


def _promise(guess: _Guess) -> float:
    """A small template fits clutter more easily than a large one: scores weighed by size."""
    return -(guess.score - 0.5) * float(len(template(guess.port)[0])) ** 0.25


@lru_cache(maxsize=32)
def _ring_radius(name: str) -> float:
    """Radius of the outer of the two rims that a double ring stands for [m]."""
    entry = port(name)
    rim = entry.of_kind("mouth")[0].outline.radius
    return entry.plate.radius if entry.plug else rim


def _guess(name: str, score: float, best: Floats, level: Level) -> _Guess:
    u, v = ((best[:2] + 0.5) / level.scale - 0.5).tolist()
    tilt, axis = float(np.hypot(best[3], best[4])), float(np.arctan2(best[4], best[3]))
    return _Guess(name, score, u, v, float(best[2]) / level.scale, tilt, axis, float(best[5]))


def _level_for(levels: Sequence[Level], radius: float) -> Level:
    """The size of the picture at which a mouth has a radius of 14 to 28 px, or the finest."""
    i = int(np.clip(np.floor(np.log2(max(radius, 1.0) / 14.0)), 0, len(levels) - 1))
    return levels[i]


def _pose(guess: _Guess, lens: PinholeCamera, sign: float) -> Pose:
    """The pose in space of a flat guess; a tilt and its mirror image look alike from far."""
    ray = np.append(lens.normalise(np.array([[guess.u, guess.v]]))[0], 1.0)
    center = ray * lens.fx / guess.scale
    facing = np.diag([1.0, -1.0, -1.0])
    rolled = Rotation.from_rotvec([0.0, 0.0, guess.roll]).as_matrix() @ facing
    a = guess.axis
    tilted = Rotation.from_rotvec(sign * guess.tilt * np.array([np.cos(a), np.sin(a), 0.0]))
    R = tilted.as_matrix() @ rolled
    # seen off the middle of the picture, the port is turned with the ray
    toward = np.cross([0.0, 0.0, 1.0], ray / np.linalg.norm(ray))
    angle = np.arcsin(min(float(np.linalg.norm(toward)), 1.0))
    if angle > 1e-9:
        R = Rotation.from_rotvec(toward / np.linalg.norm(toward) * angle).as_matrix() @ R
    return make_pose(R, center)


def _fits(
    image: Bytes,
    lens: PinholeCamera,
    levels: Sequence[Level],
    guesses: Sequence[_Guess],
    options: FindOptions,
) -> list[Detection]:
    """Guesses fitted in space: many quickly, the best with all that is known of them."""
    tried: list[tuple[float, Pose, str]] = []
    for guess in _best_apart(guesses, options.quick_fits):
        for sign in (1.0, -1.0) if guess.tilt > 0.2 else (1.0,):
            T = _pose(guess, lens, sign)
            tried.append((*_quick_fit(levels, lens, guess.port, T), guess.port))
    tried.sort(key=_rank)
    tried = [t for t in tried[:8] if t[0] > 0.5 * options.least_score]
    for _, T, name in tuple(tried[:4]):
        for other in KIN.get(name, ()):
            if other in options.ports:
                tried.append((*_quick_fit(levels, lens, other, T), other))
    tried = [(*_quick_fit(levels, lens, name, T, finer=1), name) for _, T, name in tried]
    tried.sort(key=_rank)
    out: list[Detection] = []
    for score, T, name in tried:
        if len(out) == options.fits or score < 0.8 * options.least_score:
            break
        pixel = lens.project(T[None, :3, 3])[0]
        size = PORTS[name].radius * float(lens.fx / T[2, 3])
        if any(d.port == name and np.hypot(*(d.pixel - pixel)) < 0.5 * size for d in out):
            continue
        found = fit_coarse_to_fine([image], [lens], [np.eye(4)], PORTS[name], T, levels=0)
        pixel = lens.project(found.T_ref_port[None, :3, 3])[0]
        if found.score < options.least_score or not np.isfinite(pixel).all():
            continue
        scale = float(lens.fx / found.T_ref_port[2, 3])
        out.append(
            Detection(
                name, found.score, found.T_ref_port, found.covariance, pixel, scale, found, 1.0
            )
        )
    return out


def _rank(tried: tuple[float, Pose, str]) -> float:
    """Types with more to see come first where they score nearly the same."""
    return -tried[0] - (0.05 if PORTS[tried[2]].contains else 0.0)


def _quick_fit(
    levels: Sequence[Level], lens: PinholeCamera, name: str, T: Pose, finer: int = 0
) -> tuple[float, Pose]:
    """Share of a type's edges found, and the pose, where a mouth has 16 to 32 px, or finer."""
    radius = lens.fx * PORTS[name].radius / max(T[2, 3], 0.05)
    i = int(np.clip(np.floor(np.log2(max(radius, 1.0) / 16.0)), 0, len(levels) - 1))
    level = levels[max(i - finer, 0)]
    own = lens.scaled(level.scale)
    model = curves(PORTS[name], _quick_step(own.fx / max(T[2, 3], 0.05)))
    numbers = np.array([own.fx, own.fy, own.cx, own.cy, *own.distortion])
    reaches = QUICK_REACHES[3:] if finer else QUICK_REACHES
    least = max(0.8 * level.least, 0.25)
    score, T = fit_rigid(
        level.gx, level.gy, numbers, model.points, model.normals, T, reaches, least
    )
    return float(score), T


def _quick_step(scale: float) -> float:
    """Spacing of edge points for 3 px at a scale [px/m], in coarse steps so that it is kept."""
    return float(2.0 ** np.round(np.log2(np.clip(3.0 / scale, 0.0008, 0.004))))


def _best_apart(guesses: Sequence[_Guess], most: int) -> list[_Guess]:
    """The best guesses, but none twice: of another type, or at another place, size or roll."""
    kept: list[_Guess] = []
    for g in guesses:
        r = PORTS[g.port].radius * g.scale
        same = any(
            k.port == g.port
            and np.hypot(g.u - k.u, g.v - k.v) < 0.15 * r
            and 0.9 < g.scale / k.scale < 1.11
            and np.cos(g.roll - k.roll) > 0.95
            for k in kept
        )
        if not same and sum(k.port == g.port for k in kept) < 0.4 * most:
            kept.append(g)
        if len(kept) == most:
            break
    return kept


def fit_coarse_to_fine(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    entry: Port,
    T_ref_port: Pose,
    makes: bool = True,
    reach: float = 5.0,
    levels: int = 3,
    coarse_only: bool = False,
) -> Fit:
    """Fit a port to pictures, first made small so that a mouth is about 24 px in radius.

    Args:
        images: grey pictures.
        lenses: of each.
        T_lens_ref: reference frame in each lens's.
        entry: the type.
        T_ref_port: start.
        makes: see :class:`FitOptions`.
        reach: of the search at the smallest size [px].
        levels: most halvings.
        coarse_only: stop after the smallest size: to compare starts.
    """
    extent = max(
        float(np.abs(rim.outline.y) + rim.outline.radius + rim.outline.spread) for rim in entry.rims
    )
    T = T_ref_port
    result: Fit | None = None
    corners: list[Floats] = []
    radius = max(
        lens.fx * entry.radius / max((T_l @ T)[2, 3], 0.05) for lens, T_l in zip(lenses, T_lens_ref)
    )
    halvings = int(np.clip(np.round(np.log2(radius / 24.0)), 0, levels))
    for k in range(halvings, -1, -1):
        scale = 0.5**k
        looks, corners = [], []
        for image, lens, T_l in zip(images, lenses, T_lens_ref):
            window = window_about(lens, T_l @ T, 1.25 * extent)
            if window is None:
                continue
            top, bottom, left, right = window
            part = image[top:bottom, left:right]
            own = replace(
                lens, width=right - left, height=bottom - top, cx=lens.cx - left, cy=lens.cy - top
            )
            if k:
                h, w = int(part.shape[0] * scale), int(part.shape[1] * scale)
                part = np.asarray(cv2.resize(part, (w, h), interpolation=cv2.INTER_AREA), np.uint8)
                own = _resized(own, w, h)
            looks.append(look(part, own, T_l))
            corners.append(np.array([left, top], float))
        if not looks:
            break
        last = k == 0 and not coarse_only
        options = FitOptions(
            reach=reach if k == halvings else 3.5,
            iterations=9 if last else 6,
            makes=makes and last,
            spacing=2.5 if last else 2.0,
        )
        result = fit(looks, entry, T, options)
        T = result.T_ref_port
        if coarse_only:
            break
        if not 0.05 < (T_lens_ref[0] @ T)[2, 3] < 10.0:
            break
    if result is None:
        return _nothing(entry, T_ref_port)
    return replace(result, corners=tuple(corners))


def _resized(lens: PinholeCamera, w: int, h: int) -> PinholeCamera:
    sx, sy = w / lens.width, h / lens.height
    return replace(
        lens,
        width=w,
        height=h,
        fx=lens.fx * sx,
        fy=lens.fy * sy,
        cx=(lens.cx + 0.5) * sx - 0.5,
        cy=(lens.cy + 0.5) * sy - 0.5,
    )


def _nothing(entry: Port, T: Pose) -> Fit:
    model = curves(entry, 0.002)
    none: Ints = np.zeros(0, np.int64)
    return Fit(
        T,
        np.eye(6),
        0.0,
        np.inf,
        0,
        np.zeros((len(model.rims), 4)),
        (),
        none.astype(bool),
        model,
        np.nan,
        np.zeros(len(model.rims)),
    )


def _merge(found: Sequence[Detection]) -> tuple[Detection, ...]:
    """One detection a place: the type with the best score, the larger one where it is all there."""
    out: list[Detection] = []
    for d in sorted(found, key=lambda d: -_worth(d)):
        if not any(_same_place(d, k) for k in out):
            others = [o.score for o in found if o.port != d.port and _same_place(o, d)]
            out.append(replace(d, margin=d.score - max(others, default=0.0)))
    return tuple(sorted(out, key=lambda d: -d.score))


def _same_place(a: Detection, b: Detection) -> bool:
    """Whether two detections are views of one thing: nearer than a mouth's radius."""
    size = min(PORTS[d.port].radius * d.scale for d in (a, b))
    return float(np.linalg.norm(a.pixel - b.pixel)) < size


def _worth(d: Detection) -> float:
    """Score, with a bonus for a type with more to see than another when that is really there."""
    extra = [
        share
        for rim, share in zip(d.fit.curves.rims, d.fit.rim_scores)
        if rim.name.startswith("DC")
    ]
    if not extra:
        return d.score
    return d.score + (0.25 if np.mean(extra) > 0.55 else -0.3)
