"""Paths with rounded corners: straight lines joined by parabolas, by length along the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, JointPath, JointVector

LINE_PARTS, BEND_PARTS = 12, 8
"""Intervals that timing makes of a line and of a parabola."""


@dataclass(frozen=True)
class RoundedPath:
    """q(s) of k intervals: start + tangent s + curve s^2 / 2, with s from 0 to ``length`` in each.

    Attributes:
        start: (k, n) [rad]; tangent: (k, n) dq/ds; curve: (k, n) d2q/ds2; length: (k,).
        corner: (k,) waypoint nearest to each interval.
    """

    start: JointPath
    tangent: JointPath
    curve: JointPath
    length: Floats
    corner: Ints

    @property
    def tangent_end(self) -> JointPath:
        """(k, n) dq/ds at the ends of the intervals."""
        return np.asarray(self.tangent + self.curve * self.length[:, None])

    def position(self, where: Ints, place: Floats) -> JointPath:
        """(m, n) joints at places within intervals."""
        s = np.asarray(place)[:, None]
        return np.asarray(
            self.start[where] + s * (self.tangent[where] + 0.5 * s * self.curve[where])
        )


def round_corners(path: JointPath, reach: Floats) -> RoundedPath:
    """Replace corners by parabolas that leave and join the path ``reach`` before and after them.

    Args:
        path: (k, n) waypoints, no two neighbours equal.
        reach: (k,) [rad]; the ends' are not used; those of neighbours must fit on the line
            between them.
    """
    path = np.asarray(path, float)
    step = np.diff(path, axis=0)
    size = np.linalg.norm(step, axis=1)
    way = step / size[:, None]
    reach = np.array(reach, float)
    reach[0] = reach[-1] = 0.0
    parts: list[tuple[JointVector, JointVector, JointVector, float, int]] = []
    zero = np.zeros(path.shape[1])
    for i in range(len(size)):
        a, b = reach[i], size[i] - reach[i + 1]
        if b - a > 1e-9:
            h = (b - a) / LINE_PARTS
            for c in range(LINE_PARTS):
                near = i if 2 * c < LINE_PARTS else i + 1
                parts.append((path[i] + way[i] * (a + c * h), way[i], zero, h, near))
        if i + 1 < len(size) and reach[i + 1] > 1e-9:
            r = reach[i + 1]
            begin = path[i + 1] - r * way[i]
            curve = (way[i + 1] - way[i]) / (2.0 * r)
            h = 2.0 * r / BEND_PARTS
            for c in range(BEND_PARTS):
                s = c * h
                parts.append(
                    (
                        begin + s * (way[i] + 0.5 * s * curve),
                        way[i] + s * curve,
                        curve,
                        h,
                        i + 1,
                    )
                )
    return RoundedPath(
        np.array([p[0] for p in parts]),
        np.array([p[1] for p in parts]),
        np.array([p[2] for p in parts]),
        np.array([p[3] for p in parts]),
        np.array([p[4] for p in parts], np.int64),
    )


def widest_reach(path: JointPath) -> Floats:
    """(k,) reaches that meet in the middle of each line: the roundest corners there can be."""
    size = np.linalg.norm(np.diff(np.asarray(path, float), axis=0), axis=1)
    reach = np.zeros(len(path))
    if len(size) > 1:
        share = np.full(len(size), 0.5)
        # The first and last line have one corner only: it may use nearly all of them.
        share[0] = share[-1] = 0.95
        if len(size) > 1:
            reach[1:-1] = np.minimum(size[:-1] * share[:-1], size[1:] * share[1:])
    return reach
