"""The mouth of a smiley (V: 20 cm, on a box): its middle, and the way the face looks.

From afar the yellow disc gives centre and normal, and the print's dark lines which way is down.
From near the disc is larger than the picture: then the mouth's own arc is fitted in both pictures
of the pair, as much of it as they show. Where one of its ends is in a picture, that says which way
is down; else it is remembered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Pose, Vector3
from armsight.devices.data import RgbdFrame, StereoFrame
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.disc_fit import Circle, DiscFit, across, fit_disc
from armsight.servoing.segment import LabColor, lab_of
from armsight.servoing.sighting import Sighting
from armsight.servoing.sphere_fit import Outline
from armsight.servoing.targets.discs import Discs, Part, SeenDisc, between
from armsight.servoing.targets.rehearsal import Disc, rehearse
from armsight.servoing.targets.seen import half_size_mask, rays_of

YELLOW = LabColor(hue_deg=88.0, width_deg=20.0, chroma=25.0, purity=0.55)
FACE = Part(0.10, 0.9)
BELOW = 0.045
"""The mouth's middle lies so far from the face's [m]."""
EYES = ((-0.033, 0.030), (0.033, 0.030))
"""Of the face [m]."""
ARC, HALF_WIDTH, HALF_ANGLE = 0.062, 0.006, np.deg2rad(64.0)
"""The mouth is an arc about a point 62 mm above its middle, 12 mm wide [m], [rad]."""
THICK = HALF_WIDTH / ARC
DARK = 0.5
"""Less light than this share of the yellow's is mouth or eyes."""
TURN_SIGMA, END_SIGMA, KEPT_SIGMA = 0.03, 0.01, 0.1
"""Standard deviation of which way is down [rad]: by the lines, by an end of the arc, remembered."""
EDGE_SIGMA = 0.6
"""Of a point of the arc's edge in a picture [px]."""
APART = 0.03
"""The rays to the middles of what both lenses see of an arc miss each other by less [m]."""
ALONG, MISFIT, SURE = 0.65, 1.4, 1.0
"""Of an arc's edges such a share is along its circle, with such a misfit: there is a second, worse
way to lay a circle through them. A misfit below the last one is not that."""
LONG, SHORT = 100.0, 30.0
"""A mouth's longest dark part is so long, and others that count, in a picture of the pair [px]."""
STEPS, LINE, BARE, AGREE = 720, 40, 12, 0.15
"""Round the arc's circle so many places are looked at. At one of its ends so many of them in a row
are dark on the one side, and yellow on the other; what all ends say agrees so well [rad]."""
WHOLE, HIDDEN_SIGMA = 0.9, 0.02
"""A face of which a smaller share is shown, because the arm hides some, does not say which way is
down, and its middle is less sure by this, in all pictures that are alike [m]."""
KEPT = 1.0
"""For this long [s] after the pair has seen which way is down the others are not asked."""
STEADY = 0.4
"""What the others say of it is averaged over this time [s]: where the arm hides half a face from
them they are 0.15 rad off."""
TURNS = 120
"""Ways to turn the face that are compared."""


class Mouth:
    """Finds the mouth of a smiley whose face measures 20 cm."""

    name = "mouth"

    def __init__(self) -> None:
        self._discs = Discs(YELLOW, (FACE,))
        self._down: _Down | None = None

    def reset(self) -> None:
        """Which way is down has not been seen."""
        self._down = None

    def warm_up(self) -> None:
        """Compile what finds it."""
        rehearsed()

    def in_frame(self, view: PosedFrame) -> list[Sighting]:
        """In the colour and depth of one camera, the most believable first."""
        lens, T = view.color_lens, view.T_base_color
        if view.frame.color is None or lens is None or T is None:
            return []
        found = []
        for seen in self._discs.in_frame(view):
            known, hidden = self._down, _hidden(lens, T, seen)
            if known is None or not hidden:
                down = _down_of(view.frame.color, lens, T, seen)
                if down is None:
                    continue
                known, hidden = _remembered(known, down, view.frame.stamp), False
                self._down = known
            placed = _placed(view.frame, seen.fit, BELOW, known.way, False)
            found.append(replace(placed, lasting=HIDDEN_SIGMA) if hidden else placed)
        return found

    def in_pair(self, view: PosedPair, surface: bool = False) -> list[Sighting]:
        """In both pictures of a pair, the most believable first."""
        T, frame, info = view.T_base_camera, view.frame, view.info
        if T is None:
            return []
        right = np.asarray(T @ info.T_left_right)
        near = [_near(frame.left, info.left, T), _near(frame.right, info.right, right)]
        lines = [line for line in near if line is not None]
        fit = _fit_arcs(lines[0], lines[1]) if len(lines) == 2 else None
        ends = None if fit is None else _down_by_ends(fit, lines)
        if ends is not None:
            self._down = _Down(ends, frame.stamp, True)
        for seen in self._discs.in_pair(view):
            down = _down_of(frame.left, info.left, T, seen) if ends is None else ends
            if down is not None:
                self._down = _Down(down, frame.stamp, True)
                turned = TURN_SIGMA if ends is None else END_SIGMA
                return [_placed(frame, seen.fit, BELOW, down, True, turned)]
        if self._down is None or fit is None:
            return []
        # The arc says where the mouth is better than which way it looks.
        if self._down.near:  # it goes on to be seen from near, if not all of it
            self._down = replace(self._down, stamp=frame.stamp)
        placed = _placed(frame, fit, ARC, self._down.way, True, END_SIGMA)
        lasting = ARC * KEPT_SIGMA if ends is None else 0.0
        return [replace(placed, normal=None, lasting=lasting)]


@dataclass(frozen=True)
class _Down:
    """Which way is down (3,) in ``base``, seen when [s], and whether by the pair."""

    way: Vector3
    stamp: float
    near: bool


def _remembered(known: _Down | None, way: Vector3, stamp: float) -> _Down:
    """What is known of it once a fixed camera has seen it so."""
    if known is None or (known.near and stamp > known.stamp + KEPT):
        return _Down(way, stamp, False)
    if known.near:
        return known
    share = float(np.clip((stamp - known.stamp) / STEADY, 0.1, 1.0))
    mean = known.way + share * (way - known.way)
    return _Down(np.asarray(mean / np.linalg.norm(mean)), max(stamp, known.stamp), False)


def _placed(
    frame: RgbdFrame | StereoFrame,
    fit: DiscFit,
    below: float,
    down: Vector3,
    wrist: bool,
    turned: float = TURN_SIGMA,
) -> Sighting:
    """The mouth so far below a fitted centre [m]; which way is down is known to so much [rad]."""
    down = down - fit.normal * (fit.normal @ down)
    down = down / np.linalg.norm(down)
    place = np.asarray(fit.center + below * down)
    covariance = fit.covariance + (below * turned) ** 2 * np.eye(3)
    return Sighting(
        Mouth.name, frame.camera, frame.stamp, place, covariance, place, fit.normal, wrist, fit.tilt
    )


def _hidden(lens: PinholeCamera, T: Pose, seen: SeenDisc) -> bool:
    """Whether something hides a part of the face, by its outline and its size in the picture."""
    way = seen.fit.center - T[:3, 3]
    away = float(np.linalg.norm(way))
    turned = abs(float(seen.fit.normal @ way)) / away
    whole = np.pi * (FACE.radius * lens.fx / away) ** 2 * turned
    return seen.fit.share < WHOLE or seen.region.area < WHOLE * whole


def _down_of(image: ColorImage, lens: PinholeCamera, T: Pose, seen: SeenDisc) -> Vector3 | None:
    """(3,) unit, from the face's middle to its mouth: where its lines are dark; None without any.

    Eyes and mouth are turned about the face's middle to where the picture is darkest under them.
    """
    fit, into = seen.fit, inverse(T)
    x, y = across(fit.normal)
    turns = np.linspace(0.0, 2.0 * np.pi, TURNS, endpoint=False)
    s = np.stack([np.sin(turns), -np.cos(turns)], axis=1)  # the mouth's side
    side = np.stack([-s[:, 1], s[:, 0]], axis=1)
    along = _LINES[:, 0, None, None] * side - _LINES[:, 1, None, None] * s  # (points, turns, 2)
    places = fit.center + along[..., :1] * x + along[..., 1:] * y
    pixels = lens.project(transform(into, places.reshape(-1, 3))).astype(np.float32)
    at = pixels.reshape(len(_LINES), TURNS, 2)
    shown = (at >= 0).all(axis=-1) & (at < (lens.width - 1, lens.height - 1)).all(axis=-1)
    (u0, v0), (h, w) = seen.region.corner, seen.region.mask.shape
    part = np.ascontiguousarray(image[v0 : v0 + h, u0 : u0 + w])
    light = np.ascontiguousarray(lab_of(part)[..., 0])
    found = cv2.remap(
        light, at[..., 0] - np.float32(u0), at[..., 1] - np.float32(v0), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    count = shown.sum(axis=0)
    if count.max() < 0.6 * len(_LINES):
        return None
    mean = np.where(
        count > 0.5 * len(_LINES), (found * shown).sum(axis=0) / np.maximum(count, 1), np.inf
    )
    best = int(np.argmin(mean))
    if not mean[best] < 0.65 * float(np.median(light[seen.region.mask > 0])):
        return None
    # The lines are wide and the arc is nearly round: what counts is the middle of all dark turns.
    level = 0.5 * (mean[best] + float(np.median(mean[np.isfinite(mean)])))
    weight = np.maximum(level - mean, 0.0) * (np.cos(turns - turns[best]) > 0.7)
    down = (weight @ np.sin(turns)) * x - (weight @ np.cos(turns)) * y
    return np.asarray(down / np.linalg.norm(down))


@dataclass(frozen=True)
class _Near:
    """What one lens of the pair sees of a mouth from near.

    Attributes:
        lens, T: which, and where it is.
        arc: the inner and outer edge of the mouth.
        middle: (3,) about their centre, in ``base`` [m].
        dark, yellow: (height, width) where the picture is.
    """

    lens: PinholeCamera
    T: Pose
    arc: tuple[Circle, Circle]
    middle: Vector3
    dark: Bytes
    yellow: Bytes


def _near(image: ColorImage, lens: PinholeCamera, T: Pose) -> _Near | None:
    """A mouth that is seen from near; None without one."""
    yellow = half_size_mask(image, YELLOW)
    if np.count_nonzero(yellow) < 0.1 * yellow.size:
        return None
    light = lab_of(image)[..., 0]
    dark = (light < DARK * float(np.median(light[yellow > 0]))).astype(np.uint8)
    edge = _mouth_edge(dark, yellow)
    if edge is None:
        return None
    pixels, out, middle, radius = edge
    circles = []
    for side in (-1.0, 1.0):
        own = np.abs(out - 1.0 - side * THICK) < 0.6 * THICK
        if own.sum() < 12:
            return None
        rays = rays_of(lens, pixels[own][:: max(int(own.sum()) // 60, 1)]) @ T[:3, :3].T
        outline = Outline(T[:3, 3], rays, EDGE_SIGMA / lens.fx)
        circles.append(Circle(outline, ARC + side * HALF_WIDTH))
    ray = T[:3, :3] @ rays_of(lens, middle[None])[0]
    place = np.asarray(T[:3, 3] + lens.fx * ARC / radius * ray)
    return _Near(lens, T, (circles[0], circles[1]), place, dark, yellow)


def _fit_arcs(one: _Near, other: _Near) -> DiscFit | None:
    """The arc's own centre and normal, from both lenses."""
    left, right = one.arc[0].outline, other.arc[0].outline
    starts = [one.middle, other.middle]
    # Where little of it is seen: the same part by both, about.
    part = between(left, right, APART)
    if part is not None:
        x, y = across(_towards(left.origin, part))
        turns = np.linspace(0.0, 2.0 * np.pi, 4, endpoint=False)
        starts += [part + ARC * (np.cos(turn) * x + np.sin(turn) * y) for turn in turns]
    best, least = None, MISFIT
    for start in starts:
        fit = fit_disc(start, _towards(left.origin, start), (*one.arc, *other.arc))
        if fit is not None and fit.share > ALONG and fit.misfit < least:
            best, least = fit, fit.misfit
        if least < SURE:
            break
    return best if best is not None and best.tilt < 0.1 else None


def _towards(eye: Vector3, place: Vector3) -> Vector3:
    """(3,) unit, from a place to an eye."""
    return np.asarray((eye - place) / np.linalg.norm(eye - place))


def _down_by_ends(fit: DiscFit, lines: Sequence[_Near]) -> Vector3 | None:
    """(3,) unit, from the arc's centre to the mouth's middle; None where no end is in a picture."""
    x, y = across(fit.normal)
    turns = np.linspace(0.0, 2.0 * np.pi, STEPS, endpoint=False)
    places = fit.center + ARC * (np.cos(turns)[:, None] * x + np.sin(turns)[:, None] * y)
    found = []
    for line in lines:
        lens = line.lens
        pixels = lens.project(transform(inverse(line.T), places))
        shown = (pixels > 1) & (pixels < (lens.width - 2, lens.height - 2))
        inside = np.asarray(shown.all(axis=1))
        u, v = np.where(inside[:, None], pixels, 0.0).round().astype(int).T
        dark = inside & (line.dark[v, u] > 0)
        bare = inside & (line.yellow[v, u] > 0) & ~dark
        for way in (1, -1):  # dark before a place and yellow after it, round either way
            ahead = np.logical_and.reduce([np.roll(bare, -way * k) for k in range(2, BARE)], axis=0)
            behind = np.logical_and.reduce([np.roll(dark, way * k) for k in range(LINE)], axis=0)
            ends = np.flatnonzero(np.logical_and(ahead, behind))
            found += [turns[k] - way * HALF_ANGLE for k in ends]
    if not found:
        return None
    ways = np.exp(1j * np.array(found))
    mean = ways.mean() / max(abs(ways.mean()), 1e-9)
    if np.abs(np.angle(ways / mean)).max() > AGREE:
        return None
    return np.asarray(mean.real * x + mean.imag * y)


def _mouth_edge(dark: Bytes, yellow: Bytes) -> tuple[Floats, Floats, Floats, float] | None:
    """(k, 2) pixels on a mouth's edge, (k,) how far out, of its circle's radius; centre and radius.

    The longest dark part before the yellow, and what goes on along its circle: a straw cuts a mouth
    into pieces. None without one.
    """
    near = cv2.dilate(yellow, np.ones((9, 9), np.uint8)) > 0
    count, labels, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=8)
    parts, (h, w) = [], yellow.shape
    for i in range(1, count):
        u, v, du, dv, area = (int(n) for n in stats[i])
        length = float(np.hypot(du, dv))
        if length < SHORT:
            continue
        own = (labels[v : v + dv, u : u + du] == i).astype(np.uint8)
        contours, _ = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        edge = np.concatenate([c[:, 0] for c in contours]) + np.array([u, v])
        inside = ((edge > 2) & (edge < (w - 3, h - 3))).all(axis=1)
        edge = edge[inside]
        if len(edge) > SHORT and near[edge[:, 1], edge[:, 0]].mean() > 0.8:
            parts.append((area <= 0.35 * length * length, length, edge.astype(float)))
    thin, length, edge = max(parts, key=lambda part: part[:2], default=(False, 0.0, np.empty(0)))
    if not thin or length < LONG or len(edge) <= 60:
        return None
    A = np.column_stack([2.0 * edge, np.ones(len(edge))])
    solved = np.linalg.lstsq(A, (edge**2).sum(axis=1), rcond=None)[0]
    radius = float(np.median(np.linalg.norm(edge - solved[:2], axis=1)))
    outs = [(part, np.linalg.norm(part - solved[:2], axis=1) / radius) for *_, part in parts]
    along = [(p, out) for p, out in outs if p is edge or np.abs(out - 1.0).max() < 2.0 * THICK]
    pixels, out = (np.concatenate([pair[k] for pair in along]) for k in (0, 1))
    return pixels, out, np.asarray(solved[:2]), radius


_ANGLES = np.linspace(-0.85 * HALF_ANGLE, 0.85 * HALF_ANGLE, 25)
_LINES = np.array(
    [*EYES, *[(ARC * np.sin(a), ARC - BELOW - ARC * np.cos(a)) for a in _ANGLES]], float
)
"""(k, 2) points of the print that are dark, right and up of the face's middle [m]."""


@cache
def rehearsed() -> tuple[Sighting, ...]:
    """A painted face, looked for once."""
    lines = [Disc(HALF_WIDTH, (15, 15, 18), (float(x), -float(y))) for x, y in _LINES]
    return tuple(rehearse(Mouth(), [Disc(FACE.radius, (242, 204, 26)), *lines]))
