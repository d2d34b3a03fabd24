"""How well spheres and capsules fit a link: what they miss, and by how much they overshoot."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from armsight.arrays import Floats, Points
from armsight.robots.covering import Axes
from armsight.robots.covering_kernels import axis_distances
from armsight.robots.link_body import LinkBody
from armsight.robots.shapes import FitReport


def measure(
    body: LinkBody, axes: Axes, radius: Floats, spacing: float = 0.004
) -> tuple[Floats, Floats]:
    """How far surface points lie outside the shapes, and the shapes' surface outside the body.

    Returns:
        (n,) signed distance of each checked point to the union, positive outside [m];
        (k,) distance of points spread on the union's surface to the body [m]; 0 inside it or
        where a neighbour is at every joint angle. What lies in the mount of a base is left out.
    """
    miss = (axis_distances(body.check, axes.start, axes.end) - radius[:, None]).min(axis=0)
    shell = union_surface(axes, radius, spacing)
    if body.mount is not None:
        shell = shell[shell[:, 2] >= body.mount]
    over = np.asarray(cKDTree(body.check).query(shell)[0])
    over[body.solid.contains(shell)] = 0.0
    over[body.fellows.always(shell)] = 0.0
    return miss, over


def union_surface(axes: Axes, radius: Floats, spacing: float) -> Points:
    """Points spread evenly on the surface of the union of capsules [m]."""
    points = []
    for k, (a, b, r) in enumerate(zip(axes.start, axes.end, radius)):
        skin = _capsule_surface(a, b, float(r), spacing)
        buried = axis_distances(skin, axes.start, axes.end) < radius[:, None]
        buried[k] = False
        points.append(skin[~buried.any(axis=0)])
    return np.concatenate(points)


def _capsule_surface(a: Points, b: Points, radius: float, spacing: float) -> Points:
    count = max(12, int(4.0 * np.pi * radius**2 / spacing**2))
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    ball = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)
    length = float(np.linalg.norm(b - a))
    if length < 1e-9:
        return np.asarray(a + radius * ball)
    u = (b - a) / length
    side = ball @ u
    caps = np.where((side > 0)[:, None], b, a) + radius * ball
    helper = np.eye(3)[int(np.argmin(np.abs(u)))]
    v = np.cross(u, helper)
    v /= np.linalg.norm(v)
    w = np.cross(u, v)
    rows, around = max(2, int(length / spacing)), max(12, int(2 * np.pi * radius / spacing))
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = radius * (np.cos(angle)[:, None] * v + np.sin(angle)[:, None] * w)
    at = a + ((np.arange(rows) + 0.5) / rows * length)[:, None] * u
    return np.concatenate([caps, (at[:, None] + ring[None]).reshape(-1, 3)])


def report(parts: list[tuple[Floats, Floats]]) -> FitReport:
    """One report of many links' :func:`measure`."""
    miss = np.concatenate([m for m, _ in parts])
    over = np.concatenate([o for _, o in parts])
    median, p95 = (float(v) for v in np.percentile(over, [50, 95]))
    return FitReport(
        samples=len(miss),
        coverage=float((miss <= 0.0).mean()),
        deepest_miss=max(0.0, float(miss.max())),
        overshoot_median=round(median, 5),
        overshoot_p95=round(p95, 5),
        overshoot_max=round(float(over.max()), 5),
    )
