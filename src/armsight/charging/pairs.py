"""Ports that both pictures of a pair show, judged together.

A port's size in one picture says how far it is, and so where on one line of the other picture it
must be, and how large. Clutter that looks like a port in one picture seldom does in the other, and
its size seldom agrees with where the two rays meet; so much less has to be asked of each picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Bytes, Pose
from armsight.charging.find import Detection, FindOptions, check_picture, find_ports, search
from armsight.charging.matches import Match, match, mirrored, refined
from armsight.charging.ports.table import PORTS
from armsight.charging.pyramid import Level, pyramid
from armsight.charging.windows import dark_windows
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse
from armsight.geometry.stereo import StereoPair

FIRST = 0.4
"""What a picture alone scores less is not looked for in the other."""
PARTNERS = 3
"""How many of the fits in the other picture go on."""
EVIDENCE = 1.3
"""Evidence below which no score is enough: a wheel's nuts may have half of a port's edges by their
number, but not rim by rim. On tuning seeds (3401 and 3402) the most that a wrong place had in 800
empty pairs is 1.04; of 300 ports one (in the dark) has less, the others 1.59 or more."""
LENIENT = 0.08
"""How much less than is asked a pair with so much evidence may score."""
SURELY, LARGE = 0.7, 32.0
"""Score that a port has which is seen as large (radius of its mouth [px]), if it is of this type
and at this place; what has less is searched once more, more closely."""
WEAKER = 0.3
"""The picture that shows it worse scores this at least."""
MISS, STRETCH = 0.25, 0.12
"""Rays that pass each other by more than this share of the mouth's radius see two things; so do
pictures in which its size and the rays tell distances that differ by more than this share."""
FARTHER = np.geomspace(0.87, 1.15, 9)
"""How much farther or nearer than its size says a port may be: it is tilted, and makes differ."""
BY_ONE, CLEAR = 0.75, 3.0
"""Score and evidence of what one picture shows so clearly that the other may have it hidden, by
dirt or a lamp's reflection. A vent's slats had 0.63 and 1.53, the most in 200 empty pairs of a
tuning seed (3101), searched closely."""


@dataclass(frozen=True, eq=False)
class PairDetection:
    """A port in both pictures, or in one where the other does not look there or has it hidden.

    Attributes:
        port: its type.
        score: mean of the pictures' shares of edges that were seen, 0..1.
        T_left_port: its pose; place by triangulation, attitude by the picture that fits better.
        matches: one a picture that shows it, left before right.
    """

    port: str
    score: float
    T_left_port: Pose
    matches: tuple[Match, ...]

    @property
    def evidence(self) -> float:
        """How much more was found than chance would find, in edges."""
        return sum(m.evidence for m in self.matches)


def find_in_pair(
    images: tuple[Bytes, Bytes],
    pair: StereoPair,
    options: FindOptions | None = None,
    windows: bool = False,
) -> tuple[PairDetection, ...]:
    """Ports that a pair sees, the surest first.

    Args:
        images: left and right, grey.
        pair: that took them.
        options: what to look for.
        windows: look first at the darker-than-average regions only.

    Raises:
        UsageError: a picture is not as it has to be.
    """
    options = options or FindOptions()
    lenses = (pair.left, pair.right)
    for image, lens in zip(images, lenses):
        check_picture(image, lens)
    levels = [pyramid(image) for image in images]
    parts = [dark_windows(image) if windows else None for image in images]
    found = _seen(levels, pair, options, _alone(images, levels, pair, options, parts))
    if found and all(_surely(d, pair) for d in found):
        return found
    # a port that stands slanted, with bright pins or in the dark, needs a closer search, and so
    # does one that fits badly: it may be another type, or taken for something beside it
    closer = options.thorough()
    alone = _alone(images, levels, pair, closer, parts)
    return _best([*found, *_seen(levels, pair, closer, alone)]) or _by_one(alone, pair, closer)


def _alone(
    images: tuple[Bytes, Bytes],
    levels: Sequence[Sequence[Level]],
    pair: StereoPair,
    options: FindOptions,
    windows: Sequence[list[tuple[int, int, int, int]] | None],
) -> list[tuple[Detection, ...]]:
    """What each picture may show by itself."""
    first = replace(options, least_score=min(FIRST, options.least_score), least_evidence=-np.inf)
    return [
        search(sizes, lens, first) if where is None else find_ports(image, lens, first, where)
        for image, sizes, lens, where in zip(images, levels, (pair.left, pair.right), windows)
    ]


def _seen(
    levels: Sequence[Sequence[Level]],
    pair: StereoPair,
    options: FindOptions,
    alone: Sequence[tuple[Detection, ...]],
) -> tuple[PairDetection, ...]:
    """What both pictures show, and what one does where the other does not look."""
    lenses = (pair.left, pair.right)
    found: list[PairDetection] = []
    for side in (0, 1):
        other = 1 - side
        T_other_this = pair.T_left_right if side else inverse(pair.T_left_right)
        for seen in alone[side]:
            partners = _partners(levels[other], lenses[other], seen, T_other_this)
            both = [(p, seen.match) if side else (seen.match, p) for p in partners]
            together = [joined for b in both if (joined := _joined(b, pair)) is not None]
            found += [d for d in together if _enough(d, options)]
            if not partners and _shows(seen, options.least_score, options.least_evidence):
                found.append(_single(seen, side, pair))
    return _best([_whole(d, levels, pair, options) for d in found])


def _whole(
    d: PairDetection, levels: Sequence[Sequence[Level]], pair: StereoPair, options: FindOptions
) -> PairDetection:
    """A port, or the one that it is a part of, where more of that is seen.

    Compared one size coarser than it was fitted: makes of large ports differ too much for the finer
    one, and it would be taken for its part.
    """
    lenses, poses = (pair.left, pair.right), (np.eye(4), inverse(pair.T_left_right))
    views = tuple(zip(levels, lenses, poses))
    for name in options.ports:
        if PORTS[name].contains == d.port and len(d.matches) == 2:
            part, whole = (
                [match(seen, lens, kind, T @ d.T_left_port) for seen, lens, T in views]
                for kind in (d.port, name)
            )
            if sum(m.evidence for m in whole) > sum(m.evidence for m in part):
                left, right = (refined(*view[:2], m) for view, m in zip(views, whole))
                return _joined((left, right), pair) or d
    return d


def _by_one(
    alone: Sequence[tuple[Detection, ...]], pair: StereoPair, options: FindOptions
) -> tuple[PairDetection, ...]:
    """What one picture shows clearly, though the other looks there and hardly shows it.

    Nothing where the other shows something of its own: one of them errs, or they are exchanged.
    """
    least, evidence = options.least_score, options.least_evidence
    shows = [any(_shows(d, least, evidence) for d in side) for side in alone]
    if all(shows):
        return ()
    return _best(
        [
            _single(d, side, pair)
            for side in (0, 1)
            for d in alone[side]
            if _shows(d, max(least, BY_ONE), max(evidence, CLEAR))
        ]
    )


def _shows(seen: Detection, score: float, evidence: float) -> bool:
    return seen.score >= score and seen.match.evidence >= evidence


def _single(seen: Detection, side: int, pair: StereoPair) -> PairDetection:
    """What one picture alone says."""
    T_left_this = pair.T_left_right if side else np.eye(4)
    T = np.asarray(T_left_this @ seen.T_camera_port)
    return PairDetection(seen.port, seen.score, T, (seen.match,))


def _surely(d: PairDetection, pair: StereoPair) -> bool:
    """Whether no closer search is needed."""
    radius = pair.left.fx * PORTS[d.port].radius / d.T_left_port[2, 3]
    fits = d.score >= SURELY or radius < LARGE
    return fits and all(m.score >= FIRST for m in d.matches)


def _enough(d: PairDetection, options: FindOptions) -> bool:
    """Whether both pictures together show enough of a port."""
    return d.score >= options.least_together - LENIENT and d.evidence > EVIDENCE


def _partners(
    levels: Sequence[Level], lens: PinholeCamera, seen: Detection, T_other_this: Pose
) -> list[Match]:
    """What may be the same port in the other picture; nothing where that does not look there."""
    if not _in_view(lens, T_other_this @ seen.T_camera_port, PORTS[seen.port].radius):
        return []
    tried = []
    for attitude in (seen.T_camera_port, mirrored(seen.T_camera_port)):
        for farther in FARTHER:
            T = attitude.copy()
            T[:3, 3] *= farther
            tried.append(match(levels, lens, seen.port, T_other_this @ T))
    tried.sort(key=lambda m: -m.evidence)
    return [refined(levels, lens, m) for m in tried[:PARTNERS]]


def _in_view(lens: PinholeCamera, T: Pose, radius: float) -> bool:
    """Whether a lens sees at least most of what has a radius [m] about a pose."""
    if T[2, 3] < 0.05:
        return False
    (u, v), margin = lens.project(T[None, :3, 3])[0], 0.5 * lens.fx * radius / T[2, 3]
    return bool(margin <= u <= lens.width - margin and margin <= v <= lens.height - margin)


def _joined(matches: tuple[Match, Match], pair: StereoPair) -> PairDetection | None:
    """Both pictures' matches as one port; None where they cannot be the same."""
    if min(m.score for m in matches) < WEAKER:
        return None
    name, T = matches[0].port, [m.T_camera_port for m in matches]
    lenses = (pair.left, pair.right)
    left, right = (lens.project(pose[None, :3, 3]) for lens, pose in zip(lenses, T))
    place = pair.triangulate(left, right)[0]
    deep = (float(place[2]), float((inverse(pair.T_left_right) @ np.append(place, 1.0))[2]))
    if min(deep) < 0.05:
        return None
    radius = pair.left.fx * PORTS[name].radius / deep[0]
    miss = float(np.linalg.norm(pair.left.project(place[None])[0] - left[0])) / radius
    stretch = max(abs(float(np.log(z / pose[2, 3]))) for z, pose in zip(deep, T))
    if miss > MISS or stretch > STRETCH:
        return None
    by_left = matches[0].score >= matches[1].score
    T_left_port = np.array(T[0] if by_left else pair.T_left_right @ T[1])
    T_left_port[:3, 3] = place
    score = 0.5 * (matches[0].score + matches[1].score)
    return PairDetection(name, score, T_left_port, matches)


def _best(found: Sequence[PairDetection]) -> tuple[PairDetection, ...]:
    """One detection a place in the left view: the type for which there is most evidence."""
    out: list[PairDetection] = []
    for d in sorted(found, key=lambda d: -d.evidence):
        if not any(_same_place(d, k) for k in out):
            out.append(d)
    return tuple(sorted(out, key=lambda d: -d.score))


def _same_place(a: PairDetection, b: PairDetection) -> bool:
    """Whether one stands before or in the other: what a picture shows there is one thing."""
    place = a.T_left_port[:3, 3]
    ray = b.T_left_port[:3, 3] / np.linalg.norm(b.T_left_port[:3, 3])
    aside = place - (place @ ray) * ray
    return bool(np.linalg.norm(aside) <= PORTS[a.port].radius)
