"""The moving body as arrays for compiled code: aligned chain, spheres, levers, self-pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats, Ints
from armsight.robots.robot import Robot

RIM_SAMPLES = 720
"""Points on a rim when a lever is bounded; their spacing is added to the bound."""


class Body(NamedTuple):
    """A robot made ready for the kernels.

    Link frames are turned so that every joint turns about its z axis; positions do not change.
    Spheres are sorted by link. Spheres that no joint can move (the base, and what lies on the
    first joint's axis) are left out: no motion can make them touch anything.

    Attributes:
        rotation: (n, 3, 3) of joint i's frame at zero in the frame of link i.
        offset: (n, 3) its origin [m].
        first: (n + 2,) spheres ``first[l]:first[l + 1]`` belong to link l.
        center: (m, 3) in the turned link frames [m].
        radius: (m,) [m].
        lever: (m, n) proven bound of the distance from joint j's axis to the centre [m], 0 where
            the joint does not move the sphere.
        link: (m,) link of each sphere.
        original: (m,) index of each sphere in ``Robot.spheres``.
        fixed_center: (f, 3) spheres of the base that never move, in ``base`` [m].
        fixed_radius: (f,) [m].
        pairs: (p, 2) spheres a, b of different links that may touch, link(a) < link(b).
        pairs_fixed: (k, 2) fixed sphere a, moving sphere b that may touch.
        lower, upper: (n,) joint limits [rad].
    """

    rotation: Floats
    offset: Floats
    first: Ints
    center: Floats
    radius: Floats
    lever: Floats
    link: Ints
    original: Ints
    fixed_center: Floats
    fixed_radius: Floats
    pairs: Ints
    pairs_fixed: Ints
    lower: Floats
    upper: Floats


def make_body(robot: Robot, inflate: float = 0.0) -> Body:
    """Arrays of a robot; every sphere larger by ``inflate`` [m].

    Raises:
        ValueError: the robot has no spheres, so nothing of it could be protected.
    """
    if len(robot.spheres.radius) == 0:
        raise ValueError(
            f"{robot.name} has no link spheres: collisions cannot be checked; "
            "convert it with shapes (scripts/convert_robots.py) or use a robot of the catalogue"
        )
    turns = [np.eye(3)] + [_z_to(a) for a in robot.axis]
    n = robot.n
    rotation = np.empty((n, 3, 3))
    offset = np.empty((n, 3))
    for i in range(n):
        rotation[i] = turns[i].T @ robot.T_link_joint[i, :3, :3] @ turns[i + 1]
        offset[i] = turns[i].T @ robot.T_link_joint[i, :3, 3]

    order = np.argsort(robot.spheres.link, kind="stable")
    link = np.asarray(robot.spheres.link)[order].astype(np.int64)
    center = np.array(
        [turns[k].T @ c for k, c in zip(link, np.asarray(robot.spheres.center)[order])]
    )
    radius = np.asarray(robot.spheres.radius, float)[order] + inflate
    lever = np.array([_levers(k, c, rotation, offset) for k, c in zip(link, center)])

    fixed = lever.max(axis=1) < 1e-6
    zero = _centers_at_zero(rotation, offset, link, center)
    moving = ~fixed
    pairs, pairs_fixed = _sphere_pairs(robot.self_pairs, link, fixed)
    return Body(
        rotation=rotation,
        offset=offset,
        first=np.searchsorted(link[moving], np.arange(n + 2)).astype(np.int64),
        center=np.ascontiguousarray(center[moving]),
        radius=np.ascontiguousarray(radius[moving]),
        lever=np.ascontiguousarray(lever[moving]),
        link=link[moving],
        original=order[moving].astype(np.int64),
        fixed_center=np.ascontiguousarray(zero[fixed]),
        fixed_radius=np.ascontiguousarray(radius[fixed]),
        pairs=pairs,
        pairs_fixed=pairs_fixed,
        lower=np.asarray(robot.limits.lower, float).copy(),
        upper=np.asarray(robot.limits.upper, float).copy(),
    )


def _z_to(axis: Floats) -> Floats:
    """A rotation that takes z to a unit vector."""
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    helper = np.array([1.0, 0.0, 0.0]) if abs(a[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, a)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(a, x), a])


def _levers(link: int, center: Floats, rotation: Floats, offset: Floats) -> Floats:
    """(n,) greatest distance of a point from each joint's axis, over all configurations.

    Turning a point about an axis makes a circle; we carry outwards the cylinder ring
    (greatest radius, range along the axis) that holds all places the point can be in the frame of
    each joint. Radial distance is convex, so over the ring's hull it is greatest on a rim.
    """
    lever = np.zeros(len(rotation))
    radius, low, high = float(np.hypot(center[0], center[1])), float(center[2]), float(center[2])
    angle = np.linspace(0.0, 2.0 * np.pi, RIM_SAMPLES, endpoint=False)
    for j in range(link - 1, -1, -1):
        lever[j] = radius
        rim = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        slack = radius * np.pi / RIM_SAMPLES
        reach, ends = 0.0, []
        for z in (low, high):
            p = np.column_stack([rim, np.full(len(rim), z)]) @ rotation[j].T + offset[j]
            reach = max(reach, float(np.hypot(p[:, 0], p[:, 1]).max()) + slack)
            ends += [float(p[:, 2].min()) - slack, float(p[:, 2].max()) + slack]
        radius, low, high = reach, min(ends), max(ends)
    return lever


def _centers_at_zero(rotation: Floats, offset: Floats, link: Ints, center: Floats) -> Floats:
    """(m, 3) centres in base at zero configuration, in plain numpy."""
    R, p = [np.eye(3)], [np.zeros(3)]
    for R_i, p_i in zip(rotation, offset):
        p.append(R[-1] @ p_i + p[-1])
        R.append(R[-1] @ R_i)
    return np.array([R[k] @ c + p[k] for k, c in zip(link, center)])


def _sphere_pairs(link_pairs: Ints, link: Ints, fixed: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Pairs of moving spheres, and of a fixed with a moving one, whose links may touch."""
    number = np.where(fixed, np.cumsum(fixed) - 1, np.cumsum(~fixed) - 1)
    moving_pairs: list[tuple[int, int]] = []
    fixed_pairs: list[tuple[int, int]] = []
    for a, b in np.sort(np.asarray(link_pairs, np.int64).reshape(-1, 2), axis=1):
        for i in np.flatnonzero(link == a):
            for k in np.flatnonzero((link == b) & ~fixed):
                (fixed_pairs if fixed[i] else moving_pairs).append((int(number[i]), int(number[k])))
    return (
        np.array(moving_pairs, np.int64).reshape(-1, 2),
        np.array(fixed_pairs, np.int64).reshape(-1, 2),
    )
