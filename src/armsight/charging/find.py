"""Finds charging ports and plugs in one grey picture, and says which type each is.

Shape-based matching of edge directions (as in the charging paper), from coarse to fine:

1. *Rings* (:mod:`armsight.charging.rings`): edges vote for the middles of rings, and double rings
   are tried there: ports are rings within rings.
2. *Types* (:mod:`armsight.charging.guesses`): the best rings are compared with the template of
   every type at every roll; a few steps of hill-climbing in place, size, tilt and roll.
3. *Matches* (:mod:`armsight.charging.matches`): the known edges are fitted in space; the score is
   the share of them that is really there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.charging.guesses import Climbs, Guess, guess_types, pose_of
from armsight.charging.matches import Match, match, mouth_radius, refined
from armsight.charging.ports.table import PORTS
from armsight.charging.pyramid import Level, pyramid
from armsight.charging.rings import find_rings
from armsight.errors import UsageError
from armsight.geometry.camera import PinholeCamera

KIN = {
    "type1": ("ccs1",),
    "type2": ("ccs2", "type2_plug"),
    "ccs1": ("type1",),
    "ccs2": ("type2",),
    "type2_plug": ("type2", "ccs2_plug"),
    "ccs2_plug": ("type2_plug",),
}
"""Types that look alike, or hold one another: where one fits, the others are tried."""
SETTLED = 0.8
"""A guess that scores as much is the port at its place, or holds it."""
HOPELESS = 0.25
"""A guess that scores less is no port, nor is its mirror image."""
SMALLEST = 48
"""Of a picture, the shorter side [px]."""
WHOLE = 1280 * 960
"""Pixels of a picture for which the options' numbers are meant."""
ALONE = 0.95
"""Nothing that one picture shows scores more: how makes differ in size it takes for distance."""
INLETS = ("type1", "type2", "ccs1", "ccs2")
PLUGS = ("type1_plug", "type2_plug", "ccs2_plug")


@dataclass(frozen=True)
class FindOptions:
    """What to look for, and how hard.

    Attributes:
        ports: names of the types.
        distance: nearest and farthest [m].
        least_score: what is below is not reported; least_evidence: nor what has less of it by one
            picture alone; least_together: mean score of both pictures of a pair that agree on it
            (:mod:`armsight.charging.pairs`).
        seeds: per size of the picture; rings, climbs (of each type), guesses, fits: how many go
            on to each stage.
        tilts: at which rings are tried [deg], and about how many axes; beside: and beside the
            places that were voted for, too.
        least_rough: what a type scores less at a ring does not climb; behind: nor what promises
            less than this share of the best of all types.
    """

    ports: tuple[str, ...] = (*INLETS, "type2_plug")
    distance: tuple[float, float] = (0.25, 2.8)
    least_score: float = 0.55
    least_evidence: float = 0.8
    least_together: float = 0.5
    seeds: int = 60
    rings: int = 480
    climbs: int = 24
    guesses: int = 10
    fits: int = 3
    tilts: tuple[tuple[float, int], ...] = ((27.0, 4), (42.0, 6))
    beside: bool = False
    least_rough: float = 0.1
    behind: float = 0.35

    def thorough(self) -> FindOptions:
        """The same, searched about four times as long: for where there seems to be nothing."""
        return replace(
            self,
            rings=3 * self.rings,
            climbs=3 * self.climbs,
            guesses=2 * self.guesses,
            fits=2 * self.fits,
            tilts=((20.0, 4), (32.0, 6), (44.0, 8)),
            beside=True,
            least_rough=0.0,
            behind=0.0,
        )


@dataclass(frozen=True, eq=False)
class Detection:
    """A port that was found.

    Attributes:
        port: its type.
        score: share of its edges that were seen where they should be, 0..1, but at most
            :data:`ALONE`; see :class:`armsight.charging.matches.Match`.
        T_camera_port: its pose by this picture alone; from far the tilt is weak.
        covariance: (6, 6) of that, as a twist in the port's frame.
        pixel: (2,) of its origin.
        scale: of the picture there [px/m].
        match: all of the fit.
        margin: score less that of the best other type at the same place.
    """

    port: str
    score: float
    T_camera_port: Pose
    covariance: Floats
    pixel: Floats
    scale: float
    match: Match
    margin: float


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
        return search(pyramid(image), lens, options)
    found: list[Detection] = []
    for top, bottom, left, right in windows:
        part = np.ascontiguousarray(image[top:bottom, left:right])
        own = lens.window(top, bottom, left, right)
        for d in _found(pyramid(part), own, options):
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
    if min(image.shape) < SMALLEST:
        raise UsageError(
            f"find: a picture of {image.shape[1]}x{image.shape[0]} pixels is too small"
        )


def search(
    levels: Sequence[Level],
    lens: PinholeCamera,
    options: FindOptions,
    rings: Floats | None = None,
) -> tuple[Detection, ...]:
    """As :func:`find_ports`, of a picture whose sizes are there already.

    Args:
        levels: of the picture.
        lens: that took it.
        options: what to look for.
        rings: to try, see :func:`armsight.charging.rings.find_rings`; without them the picture's.
    """
    return _merge(_found(levels, lens, options, rings))


def _found(
    levels: Sequence[Level],
    lens: PinholeCamera,
    options: FindOptions,
    rings: Floats | None = None,
) -> list[Detection]:
    largest = lens.fx * 0.050 / options.distance[0]
    # a window holds fewer things that are no port
    share = float(np.clip(3.0 * levels[0].gx.size / WHOLE, 0.3, 1.0))
    seeds, most = round(share * options.seeds), round(share * options.rings)
    if rings is None:
        rings = find_rings(levels, largest, seeds, most, options.tilts, options.beside)
    climbs = Climbs(
        round(share * options.climbs),
        round(share * options.guesses),
        options.least_rough,
        options.behind,
    )
    guesses = guess_types(levels, lens, rings, options.ports, options.distance, climbs)
    tried = _fitted(levels, lens, guesses)
    tried.sort(key=lambda m: -m.evidence)
    tried = tried[: options.fits]
    best = tried[: options.fits - 1]
    for k, m in enumerate(best):
        if any(m.port == b.port and _near(lens, m, b) for b in best[:k]):
            continue  # its mirror image: what is like it has been tried
        others = (other for other in KIN.get(m.port, ()) if other in options.ports)
        tried += [match(levels, lens, other, m.T_camera_port) for other in others]
    tried.sort(key=lambda m: -m.evidence)
    tried = [refined(levels, lens, m) for m in tried[: options.fits]]
    least, evidence = options.least_score, options.least_evidence
    return [_detection(m, lens) for m in tried if m.score >= least and m.evidence >= evidence]


def _near(lens: PinholeCamera, a: Match, b: Match) -> bool:
    """Whether two fits are at one place: nearer than a fifth of a mouth's radius."""
    pixels = lens.project(np.stack([a.T_camera_port[:3, 3], b.T_camera_port[:3, 3]]))
    size = mouth_radius(lens, a.port, a.T_camera_port)
    return float(np.linalg.norm(pixels[0] - pixels[1])) < 0.2 * size


def _fitted(levels: Sequence[Level], lens: PinholeCamera, guesses: Sequence[Guess]) -> list[Match]:
    """Guesses fitted; where one fits well, no other is tried: its kin are compared later."""
    tried: list[Match] = []
    settled: list[tuple[Floats, float]] = []
    for guess in guesses:
        at = np.array([guess.u, guess.v])
        if any(np.linalg.norm(at - pixel) < size for pixel, size in settled):
            continue
        new = _matches(levels, lens, guess)
        tried += new
        best = max(new, key=lambda m: m.score)
        if best.score >= SETTLED:
            pixel = lens.project(best.T_camera_port[None, :3, 3])[0]
            settled.append((pixel, mouth_radius(lens, best.port, best.T_camera_port)))
    return tried


def _matches(levels: Sequence[Level], lens: PinholeCamera, guess: Guess) -> list[Match]:
    """A guess fitted, and from its mirror image, too, where it is tilted."""
    found = [match(levels, lens, guess.port, pose_of(guess, lens, 1.0), True)]
    if guess.tilt > 0.2 and found[0].score > HOPELESS:
        found.append(match(levels, lens, guess.port, pose_of(guess, lens, -1.0), True))
    return found


def _detection(m: Match, lens: PinholeCamera) -> Detection:
    pixel = lens.project(m.T_camera_port[None, :3, 3])[0]
    scale = float(lens.fx / m.T_camera_port[2, 3])
    score = min(m.score, ALONE)
    return Detection(m.port, score, m.T_camera_port, m.covariance, pixel, scale, m, 1.0)


def _merge(found: Sequence[Detection]) -> tuple[Detection, ...]:
    """One detection a place: the type for which there is most evidence."""
    out: list[Detection] = []
    for d in sorted(found, key=lambda d: -d.match.evidence):
        if not any(_same_place(d, k) for k in out):
            others = [o.score for o in found if o.port != d.port and _same_place(o, d)]
            out.append(replace(d, margin=d.score - max(others, default=0.0)))
    return tuple(sorted(out, key=lambda d: -d.match.score))


def _same_place(a: Detection, b: Detection) -> bool:
    """Whether two detections are views of one thing: nearer than a mouth's radius."""
    size = min(PORTS[d.port].radius * d.scale for d in (a, b))
    return float(np.linalg.norm(a.pixel - b.pixel)) < size
