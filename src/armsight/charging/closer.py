"""A port that no picture shows clearly, looked for as long as nothing moves, where one can be.

In the dark, or where a shadow, dirt or a lamp's glare lies across it, a port has half of its edges
in each picture, and what looks for it anywhere has to pass it over. Where the pair, the car and the
light stand still pictures add up, are made as bright as they can be, and are searched with four
times the patience; and a place counts that both pictures together show (the joint fit), and at
which a port can be: within the arm's reach, at the height and lean of the car that is expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from armsight.arrays import Bytes, Floats32, Pose
from armsight.charging.coarse_to_fine import fit_at_size
from armsight.charging.find import SMALLEST, Detection, FindOptions, search
from armsight.charging.guesses import ring_radius
from armsight.charging.ports.table import PORTS
from armsight.charging.pose import PortPose, fit_pose, likelihood_gain
from armsight.charging.pyramid import pyramid
from armsight.charging.rings import rings_everywhere
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, log
from armsight.geometry.stereo import StereoPair

MOST = 8
"""So many pictures are added up."""
STALE = 2.0
"""After so long without a picture another car may stand there [s]."""
MOVED, FAINT, NOISES, MOVED_SHARE = 0.08, 1.0, 5.0, 0.01
"""Something has moved where more of the picture than this share differs by so much of its brightest
parts, by so many levels at least, and by so many times the median, averaged over 4 x 4 px."""
TOP, BRIGHT, GAIN = 99.5, 200.0, 12.0
"""Pictures are made as bright as brings this percentile to so many levels, at most so much."""
CANDIDATES, FITTED = 12, 4
"""Of each picture so many places are compared in both; of these so many are fitted."""
LEAST = 0.5
"""Share of a port's edges, by the joint fit, that has to be seen ..."""
SURE = 0.75
"""... though roll or tilt cannot be told: a nearer look tells them."""
ASKEW = float(np.deg2rad(40.0))
"""Where it is known how ports of parked cars are turned, none is turned otherwise by so much."""
ROUGH = 0.08
"""What a type scores less at a place is not followed there: true ones had 0.11 and more."""
MARGIN = 0.06
"""Of what is searched about a port [m]."""
APART = 0.03
"""Places nearer to each other are one [m]."""


class Stack:
    """Pictures of a pair added up while nothing moves."""

    def __init__(self) -> None:
        self._sums: list[Floats32] = []
        self._count, self._last = 0, -math.inf

    def add(self, images: tuple[Bytes, Bytes], stamp: float) -> tuple[Bytes, Bytes]:
        """Another pair, exposed at a time [s]; the mean since something moved, made bright."""
        new = [np.asarray(image, np.float32) for image in images]
        fresh = not 0.0 <= stamp - self._last <= STALE
        if fresh or any(_moved(mean, image) for mean, image in zip(self._means, new)):
            self._sums, self._count = [np.zeros_like(image) for image in new], 0
        self._last = stamp
        keep = np.float32(min(self._count, MOST - 1) / max(self._count, 1))
        self._sums = [total * keep + image for total, image in zip(self._sums, new)]
        self._count = min(self._count + 1, MOST)
        left, right = (_bright(mean) for mean in self._means)
        return left, right

    @property
    def _means(self) -> list[Floats32]:
        return [total / np.float32(self._count) for total in self._sums]


def _moved(mean: Floats32, image: Floats32) -> bool:
    if mean.shape != image.shape:
        return True
    off = np.abs(cv2.resize(mean - image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA))
    noise = 1.5 * float(np.median(off))
    return bool((off > max(MOVED * _top(mean), FAINT, NOISES * noise)).mean() > MOVED_SHARE)


def _top(mean: Floats32) -> float:
    return float(np.percentile(mean[::4, ::4], TOP))


def _bright(mean: Floats32) -> Bytes:
    gain = float(np.clip(BRIGHT / max(_top(mean), 1.0), 1.0, GAIN))
    return np.asarray(np.clip(np.rint(mean * np.float32(gain)), 0, 255), np.uint8)


View = tuple[Bytes, PinholeCamera, Pose]
"""A picture, its lens, and the reference frame in that."""


@dataclass(frozen=True)
class Where:
    """Where a port can be.

    Attributes:
        possible: whether it can be at a pose.
        about: where ports of parked cars are; None where nobody has said.
        within: of that place [m].
    """

    possible: Callable[[Pose], bool]
    about: Pose | None = None
    within: float = 0.0

    def seen_from(self, T_base_camera: Pose) -> Where:
        """The same in the frame of a camera, of what is said in ``base``."""
        about = None if self.about is None else np.asarray(inverse(T_base_camera) @ self.about)
        return Where(lambda T: self.possible(T_base_camera @ T), about, self.within)


def find_closer(
    images: tuple[Bytes, Bytes],
    pair: StereoPair,
    ports: Sequence[str],
    distance: tuple[float, float],
    where: Where,
) -> PortPose | None:
    """The port that a pair's pictures show best where one can be; None where there is none.

    Args:
        images: left and right, grey.
        pair: that took them.
        ports: types to look for.
        distance: nearest and farthest [m].
        where: it can be, in the left lens's frame.
    """
    T_lens_ref = (np.eye(4), inverse(pair.T_left_right))
    views = [*zip(images, (pair.left, pair.right), T_lens_ref)]
    if where.about is not None:
        parts = [_part(*view, where.about, where.within) for view in views]
        if any(part is None for part in parts):
            return None
        views = [(*part, T) for part, T in zip(parts, T_lens_ref) if part is not None]
    options = replace(
        FindOptions(tuple(ports), distance).thorough(),
        seeds=180,
        rings=4000,
        climbs=200,
        guesses=60,
        fits=2 * CANDIDATES,
        least_score=0.35,
        least_evidence=-2.0,
        least_rough=ROUGH,
    )
    for view in views:  # what one picture shows clearly enough the other need not
        found = _best(view, views, options, where)
        if found is not None:
            return found
    return None


def _best(
    searched: View, views: Sequence[View], options: FindOptions, where: Where
) -> PortPose | None:
    """The likeliest port in all views, of what one of them shows by itself."""
    images, lenses = [image for image, _, _ in views], [lens for _, lens, _ in views]
    T_lens_ref = [T for _, _, T in views]
    places: list[tuple[float, str, Pose]] = []
    for d in _seen(*searched, options, where)[:CANDIDATES]:
        start = np.asarray(inverse(searched[2]) @ d.T_camera_port)
        coarse = fit_at_size(images, lenses, T_lens_ref, PORTS[d.port], start)
        if where.about is not None or where.possible(coarse.T_ref_port):
            places.append((coarse.score, d.port, coarse.T_ref_port))
    places.sort(key=lambda place: -place[0])
    found: list[PortPose] = []
    for _, name, T in places:
        if len(found) == FITTED:
            break
        if not any(_same(name, T, p) for p in found):
            found.append(fit_pose(images, lenses, T_lens_ref, name, T))
    return max((p for p in found if _good(p, where)), key=likelihood_gain, default=None)


def _seen(
    image: Bytes, lens: PinholeCamera, T_lens_ref: Pose, options: FindOptions, where: Where
) -> list[Detection]:
    """What one picture may show, the likeliest first."""
    rings = None
    if where.about is not None:
        radii = [ring_radius(name) for name in options.ports]
        T = np.asarray(T_lens_ref @ where.about)
        rings = rings_everywhere(lens, T, where.within, (min(radii), max(radii)))
    found = search(pyramid(image), lens, options, rings)
    return sorted(found, key=lambda d: -d.match.evidence)


def _good(p: PortPose, where: Where) -> bool:
    if p.score < LEAST or not where.possible(p.T_ref_port):
        return False
    if where.about is None:
        return p.score >= SURE or not p.doubtful
    return float(np.linalg.norm(log(inverse(where.about) @ p.T_ref_port)[3:])) < ASKEW


def _part(
    image: Bytes, lens: PinholeCamera, T_lens_ref: Pose, about: Pose, within: float
) -> tuple[Bytes, PinholeCamera] | None:
    """What of a picture shows the surroundings of a place; None where it shows nothing of them."""
    place = (T_lens_ref @ about)[:3, 3]
    if place[2] < 2.0 * within:
        return None
    u, v = lens.project(place[None])[0]
    half = lens.fx * (within + MARGIN) / (place[2] - within)
    left, top = max(0, int(u - half)), max(0, int(v - half))
    right, bottom = min(lens.width, int(u + half)), min(lens.height, int(v + half))
    if min(right - left, bottom - top) < SMALLEST:
        return None
    own = lens.window(top, bottom, left, right)
    return np.ascontiguousarray(image[top:bottom, left:right]), own


def _same(name: str, T: Pose, p: PortPose) -> bool:
    return name == p.port and float(np.linalg.norm(T[:3, 3] - p.T_ref_port[:3, 3])) < APART
