"""A mouth from near: its arc, in both pictures of a pair, and which way is down by its ends.

A face may be larger than the picture then, and a straw lies over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from armsight.arrays import Bytes, ColorImage, Floats, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform, unit
from armsight.motion.perception import PosedPair
from armsight.servoing.disc_fit import Circle, DiscFit, across, fit_disc
from armsight.servoing.segment import LabColor, lab_of
from armsight.servoing.sphere_fit import Outline
from armsight.servoing.targets.discs import between
from armsight.servoing.targets.seen import half_size_mask, rays_of

YELLOW = LabColor(hue_deg=88.0, width_deg=20.0, chroma=25.0, purity=0.55)
ARC, HALF_WIDTH, HALF_ANGLE = 0.062, 0.006, np.deg2rad(64.0)
"""The mouth is an arc about a point 62 mm above its middle, 12 mm wide [m], [rad]."""
THICK = HALF_WIDTH / ARC
DARK = 0.5
"""Less light than this share of the yellow's is mouth or eyes."""
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


def near_arc(view: PosedPair) -> tuple[DiscFit, Vector3 | None] | None:
    """The arc's own centre and normal, and which way (3,) is down by its ends, from both lenses.

    None where they do not tell the arc; no way where no end of it is in a picture.
    """
    T, frame, info = view.T_base_camera, view.frame, view.info
    if T is None:
        return None
    one = _in_one(frame.left, info.left, T)
    other = _in_one(frame.right, info.right, np.asarray(T @ info.T_left_right))
    fit = None if one is None or other is None else _fit(one, other)
    if one is None or other is None or fit is None:
        return None
    return fit, _down_by_ends(fit, (one, other))


@dataclass(frozen=True)
class _Lens:
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


def _in_one(image: ColorImage, lens: PinholeCamera, T: Pose) -> _Lens | None:
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
    return _Lens(lens, T, (circles[0], circles[1]), place, dark, yellow)


def _fit(one: _Lens, other: _Lens) -> DiscFit | None:
    """The arc's own centre and normal, from both lenses; None where it cannot be told."""
    left, right = one.arc[0].outline, other.arc[0].outline
    starts = [one.middle, other.middle]
    # Where little of it is seen: the same part by both, about.
    part = between(left, right, APART)
    if part is not None:
        x, y = across(unit(left.origin - part))
        turns = np.linspace(0.0, 2.0 * np.pi, 4, endpoint=False)
        starts += [part + ARC * (np.cos(turn) * x + np.sin(turn) * y) for turn in turns]
    best, least = None, MISFIT
    for start in starts:
        fit = fit_disc(start, unit(left.origin - start), (*one.arc, *other.arc))
        if fit is not None and fit.share > ALONG and fit.misfit < least:
            best, least = fit, fit.misfit
        if least < SURE:
            break
    return best if best is not None and best.tilt < 0.1 else None


def _down_by_ends(fit: DiscFit, lines: Sequence[_Lens]) -> Vector3 | None:
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
