"""From what the network says of a crop to points whose places a solver explains."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats
from armsight.recognition.any_arm.evidence import STRIDE, Surface
from armsight.recognition.any_arm.heat import Places
from armsight.recognition.any_arm.landmarks import Landmarks
from armsight.recognition.any_arm.model import Look
from armsight.recognition.any_arm.solver import Observations
from armsight.recognition.any_arm.views import Crop

LEAST_MASS = 0.08
"""Probability of a peak below which a landmark says nothing."""
FLOOR = 1.0
"""Standard deviation that a landmark has at least [px of the crop]."""
DENSE = 14
"""Points of each link's surface that are used at most."""
STATED = 0.4
"""Variance of a surface point over the one that the network states of it, which is too wide: on
pictures of both renderers the points' mean squared distance in sigmas is 1 with this."""
DISTANCE = 1.6
"""[m]; an arm's usual one over its size, for the error of a surface point in the picture."""


def observe(
    look: Look, crop: Crop, robot: str, marks: Landmarks, dense: bool = True
) -> Observations:
    """Landmarks of a robot in a crop, and points of its links' surfaces.

    Args:
        look: at the crop.
        crop: itself.
        robot: name of the robot that it is taken to be.
        marks: its landmarks.
        dense: take surface points, too.
    """
    places = look.places[robot]
    at, covariance = _in_rays(places, crop)
    far = np.where(places.mass > LEAST_MASS, np.minimum(places.mass * 2, 1.0), 0.0)
    # What says nothing is kept in its place, far from sure: the search counts landmarks in order.
    covariance = covariance / np.clip(far, 1e-4, 1.0)[:, None, None]
    link, point = marks.link, marks.point
    if dense:
        extra = _surface(look, look.surface_of(robot), crop, marks)
        link = np.concatenate([link, extra.link])
        point = np.concatenate([point, extra.point])
        at = np.concatenate([at, extra.at])
        covariance = np.concatenate([covariance, extra.covariance])
        far = np.concatenate([far, np.full(len(extra.link), -1.0)])
    return Observations(
        link.astype(np.int64),
        np.ascontiguousarray(point),
        np.ascontiguousarray(at),
        covariance,
        far,
    )


def _in_rays(places: Places, crop: Crop) -> tuple[Floats, Floats]:
    pixels = places.mean * STRIDE + 0.5 * (STRIDE - 1)
    covariance = places.covariance * STRIDE**2 + FLOOR**2 * np.eye(2)
    return crop.rays(pixels), covariance / crop.f**2


def _surface(look: Look, seen: Surface, crop: Crop, marks: Landmarks) -> Observations:
    best = seen.links[1:].argmax(axis=0)
    sure = (look.arm > 0.7) & (np.take_along_axis(seen.links[1:], best[None], 0)[0] > 0.6)
    rng = np.random.default_rng(0)
    link: list[int] = []
    point: list[Floats] = []
    pixels: list[Floats] = []
    sigma: list[float] = []
    for k in range(len(marks.middle)):
        rows, columns = np.nonzero(sure & (best == k))
        if len(rows) < 2:
            continue
        order = rng.permutation(len(rows))[:DENSE]
        for i in order:
            r, c = rows[i], columns[i]
            # The spread is of each coordinate in halves of the box; Laplace's deviation is sqrt 2.
            error = np.sqrt(2.0) * seen.spread[r, c] * marks.half[k].max()
            link.append(k)
            point.append(marks.middle[k] + seen.coordinates[r, c] * marks.half[k])
            pixels.append(np.array([c, r]) * STRIDE + 0.5 * (STRIDE - 1))
            sigma.append(float(np.hypot(2.0 / crop.f, error / DISTANCE)))
    if not link:
        empty = np.empty((0, 2))
        return Observations(
            np.empty(0, np.int64), np.empty((0, 3)), empty, np.empty((0, 2, 2)), empty[:, 0]
        )
    variance = STATED * np.array(sigma) ** 2
    return Observations(
        np.array(link, np.int64),
        np.array(point),
        crop.rays(np.array(pixels)),
        variance[:, None, None] * np.eye(2),
        np.full(len(link), -1.0),
    )
