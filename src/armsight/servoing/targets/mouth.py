"""The mouth of a smiley (V: 20 cm, on a box): its middle, and the way the face looks.

From afar the yellow disc gives centre and normal, and the print's dark lines which way is down.
From near the disc is larger than the picture: then the mouth's own arc is fitted (`mouth_arc`).
Where one of its ends is in a picture, that says which way is down; else it is remembered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np

from armsight.arrays import ColorImage, Pose, Vector3
from armsight.devices.data import RgbdFrame, StereoFrame
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, transform
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.servoing.disc_fit import DiscFit, across
from armsight.servoing.segment import lab_of
from armsight.servoing.sighting import Sighting
from armsight.servoing.targets.discs import Discs, Part, SeenDisc
from armsight.servoing.targets.mouth_arc import (
    ARC,
    HALF_ANGLE,
    HALF_WIDTH,
    YELLOW,
    near_arc,
)
from armsight.servoing.targets.rehearsal import Disc, rehearse

FACE = Part(0.10, 0.9)
BELOW = 0.045
"""The mouth's middle lies so far from the face's [m]."""
EYES = ((-0.033, 0.030), (0.033, 0.030))
"""Of the face [m]."""
TURN_SIGMA, END_SIGMA, KEPT_SIGMA = 0.03, 0.01, 0.1
"""Standard deviation of which way is down [rad]: by the lines, by an end of the arc, remembered."""
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
        fit, ends = near_arc(view) or (None, None)
        if ends is not None:
            self._down = _Down(ends, frame.stamp, True)
        for seen in self._discs.in_pair(view):
            down, turned = ends, END_SIGMA
            if down is None:
                down, turned = _down_of(frame.left, info.left, T, seen), TURN_SIGMA
            if down is not None:
                self._down = _Down(down, frame.stamp, True)
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
