"""Where a port is, by two or more pictures: the joint fit, and how sure it is.

The roll is decided from what is not symmetric (sizes of the recesses, the flat, the DC contacts):
every roll at which the layout nearly fits is fitted and scored. Where two are nearly as good the
pose says so (``doubtful``), and somebody should look again from nearer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.charging.coarse_to_fine import blurs_for, fit_at_size
from armsight.charging.find import ALONE, FindOptions, check_picture, find_ports
from armsight.charging.fit import MISSING, Fit, turned
from armsight.charging.matches import mirrored
from armsight.charging.pairs import find_in_pair
from armsight.charging.ports.table import PORTS
from armsight.charging.windows import dark_windows
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, log
from armsight.geometry.stereo import StereoPair

INDEPENDENT = 6.0
"""Neighbouring edge points err alike: this many count as one (about the blur of the picture and
the spacing of the points)."""
SURE = 10.0
"""Difference in log-likelihood between the best roll and the next above which it is sure; and
between a tilt and its mirror image."""
ONE = 0.05
"""Tilts that differ by less are one [rad]."""
LEANS = ((0.0, 0.0), (0.13, 0.0), (-0.13, 0.0), (0.0, 0.13), (0.0, -0.13))
"""Tilts about the port's x and y from which a fit is tried [rad]."""
CLEAR, SAME_ROLL = 0.7, float(np.deg2rad(20.0))
"""What is held somewhere is seen there where it scores this, turned by less [rad]."""
RIGHT = (1e-3, float(np.deg2rad(1.0)))
"""A score above ``ALONE`` says that a pose is right to this across [m] and in tilt [rad] ..."""
WRONG = 0.05
"""... or wrong with this probability at most, by its own covariance."""
FINALISTS = 3
"""Rolls that are fitted with all there is."""


@dataclass(frozen=True, eq=False)
class PortPose:
    """Where a port is.

    Attributes:
        port: its type.
        T_ref_port: pose in the reference frame (the left camera's).
        covariance: (6, 6) of it as a twist in the port's frame: metres, radians.
        score: share of its edges found in all pictures, 0..1; at most ``ALONE`` (0.95) by one
            picture, and where the pose may be off by a millimetre or a degree (:func:`wrong`).
        roll_gap: log-likelihood of this roll less that of the next.
        tilt_gap: the same of its tilt and of the mirror image of it; infinite where that is no
            other pose.
        fit: all of the fit.
    """

    port: str
    T_ref_port: Pose
    covariance: Floats
    score: float
    roll_gap: float
    tilt_gap: float
    fit: Fit

    @property
    def doubtful(self) -> bool:
        """Whether roll or tilt cannot be told: look again, from nearer."""
        return min(self.roll_gap, self.tilt_gap) < SURE

    @property
    def sigma(self) -> Floats:
        """(6,) standard deviations along and about the port's axes [m, rad]."""
        return np.sqrt(np.diag(self.covariance))


def locate(
    images: tuple[Bytes, Bytes],
    pair: StereoPair,
    options: FindOptions | None = None,
    windows: bool = False,
    expected: Sequence[tuple[str, Pose]] = (),
) -> tuple[PortPose, ...]:
    """Ports that a pair sees, the surest first.

    Args:
        images: left and right, grey.
        pair: that took them.
        options: what to look for.
        windows: look only at the darker-than-average regions.
        expected: types, and where in the left camera one of them may be, found or not.

    Raises:
        UsageError: a picture is not as it has to be.
    """
    options = options or FindOptions()
    lenses = (pair.left, pair.right)
    T_lens_ref = (np.eye(4), inverse(pair.T_left_right))
    starts = [(d.port, d.T_left_port) for d in find_in_pair(images, pair, options, windows)]
    starts += expected
    return _located(images, lenses, T_lens_ref, starts, options)


def locate_in_one(
    image: Bytes, lens: PinholeCamera, options: FindOptions | None = None, windows: bool = False
) -> tuple[PortPose, ...]:
    """As :func:`locate`, by one picture: from far it cannot tell a tilt from its mirror image.

    Raises:
        UsageError: the picture is not as it has to be.
    """
    options = options or FindOptions()
    check_picture(image, lens)
    found = find_ports(image, lens, options, dark_windows(image) if windows else None)
    starts = [(d.port, d.T_camera_port) for d in found]
    return _located((image,), (lens,), (np.eye(4),), starts, options)


def _located(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    starts: list[tuple[str, Pose]],
    options: FindOptions,
) -> tuple[PortPose, ...]:
    """Ports fitted from (type, pose) at which they were found, one a place, the surest first."""
    # a type may be the upper half of one that holds it; the whole picture of both tells
    holding = [
        (name, T) for held, T in starts for name in options.ports if PORTS[name].contains == held
    ]
    found = [fit_pose(images, lenses, T_lens_ref, name, T) for name, T in (*starts, *holding)]
    found = [p for p in found if p.score >= options.least_together]
    found.sort(key=lambda p: -likelihood_gain(p))
    out: list[PortPose] = []
    for p in found:
        near = (np.linalg.norm(p.T_ref_port[:3, 3] - k.T_ref_port[:3, 3]) for k in out)
        if all(gap > PORTS[p.port].radius for gap in near):
            out.append(p)
    return tuple(sorted(out, key=lambda p: -p.fit.score))


def likelihood_gain(p: PortPose) -> float:
    """How much better a port explains the pictures than clutter would: compares types."""
    return float(0.5 * MISSING * p.fit.points - p.fit.cost)


def fit_pose(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    name: str,
    T_ref_port: Pose,
) -> PortPose:
    """The joint fit of a known type from a start, all rolls scored.

    Args:
        images: grey pictures of any number of lenses.
        lenses: of each.
        T_lens_ref: the reference frame in each lens's.
        name: type of the port.
        T_ref_port: about where it is.
    """
    entry = PORTS[name]

    def fitted(T: Pose, blur: float | None = None) -> Fit:
        return fit_at_size(images, lenses, T_lens_ref, entry, T, blur)

    # both mirror images of the tilt, since one picture from far cannot tell them apart
    tilted = [turned(T_ref_port, *lean) for lean in LEANS]
    starts = (*_mirrors(T_ref_port, T_lens_ref), *tilted)
    first = max((fitted(T) for T in starts), key=_likelihood)
    blurs = blurs_for(lenses, T_lens_ref, entry, first.T_ref_port)
    blur = max(blurs, key=lambda b: fitted(first.T_ref_port, b).score) if blurs[1:] else blurs[0]

    def best_rolls(first: Fit) -> list[Fit]:
        """Fine fits of the rolls that are likeliest by coarse ones: of a coarse first one."""
        rolls = [2 * np.pi * k / entry.turns for k in range(1, entry.turns)]
        if entry.turns % 2:
            rolls.append(np.pi)
        others = [fitted(turned(first.T_ref_port, roll=roll)) for roll in rolls]
        order = sorted([first, *others], key=_likelihood, reverse=True)
        finals = [fitted(near.T_ref_port, blur) for near in order[:FINALISTS]]
        return sorted(finals, key=_likelihood, reverse=True)

    best, rival = best_rolls(first)[:2]
    others = [fitted(T) for T in _mirrors(best.T_ref_port, T_lens_ref)]
    coarse = max(others, key=_likelihood)
    mirror, tilt_gap = fitted(coarse.T_ref_port, blur), np.inf
    if best.T_ref_port[:3, 2] @ mirror.T_ref_port[:3, 2] < np.cos(ONE):
        if _likelihood(mirror) > _likelihood(best):
            mirror, (best, rival) = best, best_rolls(coarse)[:2]
        tilt_gap = _likelihood(best) - _likelihood(mirror)
    roll_gap = _likelihood(best) - _likelihood(rival)
    sure = len(images) > 1 and wrong(best.covariance) <= WRONG
    score = best.score if sure else min(best.score, ALONE)
    return PortPose(name, best.T_ref_port, best.covariance, score, roll_gap, tilt_gap, best)


def fit_held(
    images: Sequence[Bytes],
    lenses: Sequence[PinholeCamera],
    T_lens_ref: Sequence[Pose],
    name: str,
    T_ref_port: Pose,
) -> PortPose | None:
    """The fit of what is held about somewhere: from aside another roll may fit its rims as well.

    A tenth of the time of :func:`fit_pose`, whose arguments these are; None where it is not clear
    there, or in another roll.
    """
    view = images, lenses, T_lens_ref, PORTS[name]
    about = fit_at_size(*view, T_ref_port).T_ref_port
    near = fit_at_size(*view, about, blurs_for(*view[1:], about)[0])
    turn = float(np.linalg.norm(log(inverse(T_ref_port) @ near.T_ref_port)[3:]))
    if near.score < CLEAR or turn > SAME_ROLL:
        return None
    T, six = near.T_ref_port, near.covariance
    return PortPose(name, T, six, near.score, np.inf, np.inf, near)


def which_held(
    images: tuple[Bytes, Bytes], pair: StereoPair, names: Sequence[str], T_left_port: Pose
) -> PortPose | None:
    """Which of some types a pair sees where one is held, and where exactly; None where none is."""
    lenses, T_lens_ref = (pair.left, pair.right), (np.eye(4), inverse(pair.T_left_right))
    held = [fit_held(images, lenses, T_lens_ref, name, T_left_port) for name in names]
    return max((p for p in held if p is not None), key=likelihood_gain, default=None)


def wrong(covariance: Floats) -> float:
    """Probability, at most, that a pose is off by more than ``RIGHT`` across or in tilt.

    Args:
        covariance: (6, 6) of it as a twist in the port's frame [m], [rad].
    """
    spread = (np.linalg.eigvalsh(covariance[k : k + 2, k : k + 2])[-1] for k in (0, 3))
    each = (np.exp(-0.5 * most**2 / max(s, 1e-18)) for most, s in zip(RIGHT, spread))
    return min(1.0, float(sum(each)))


def _mirrors(T_ref_port: Pose, T_lens_ref: Sequence[Pose]) -> list[Pose]:
    """The pose with its tilt mirrored at the line of sight of each lens."""
    return [np.asarray(inverse(T) @ mirrored(T @ T_ref_port)) for T in T_lens_ref]


def _likelihood(found: Fit) -> float:
    """Logarithm of the likelihood, missing edges counted; per picture point that is independent."""
    if found.points == 0:
        return -np.inf
    return -0.5 * found.cost / INDEPENDENT
