"""The moving body as arrays for compiled code: aligned chain, spheres, levers, self-pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Floats, Ints, Points
from armsight.robots.robot import Robot

RIM_SAMPLES = 720
"""Points on a rim when a lever is bounded; their spacing is added to the bound."""
STILL = 0.003
"""What lies no farther from the first joint's axis stays where it is, whatever the arm does [m]."""


class Body(NamedTuple):
    """A robot made ready for the kernels.

    Link frames are turned so that every joint turns about its z axis; positions do not change.
    Spheres are sorted by link. Spheres that no joint can move (the base, and what lies on the
    first joint's axis, to ``STILL``) are left out: no motion can make them touch anything, and
    none could leave what they touch.

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
        fixed_center: (f, 3) spheres that never move, in ``base`` [m].
        fixed_radius: (f,) [m]; they hold what turns a little wherever it is.
        fixed_link: (f,) link of each.
        pairs: (p, 2) spheres a, b of different links that may touch, link(a) < link(b), b moves;
            numbers from m on are the fixed spheres.
        pair_radius: (p,) sum of their radii [m].
        groups: (g, 6) pairs by links: link a (0 where a's spheres are fixed), link b, a sphere in
            the middle of each, first and last + 1 pair.
        group_reach: (g,) links whose middles are farther apart than this cannot touch [m].
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
    fixed_link: Ints
    pairs: Ints
    pair_radius: Floats
    groups: Ints
    group_reach: Floats
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
    rotation, offset, turns = aligned_chain(robot)

    order = np.argsort(robot.spheres.link, kind="stable")
    link = np.asarray(robot.spheres.link)[order].astype(np.int64)
    center = np.array(
        [turns[int(k)].T @ c for k, c in zip(link, np.asarray(robot.spheres.center)[order])]
    )
    radius = np.asarray(robot.spheres.radius, float)[order] + inflate
    lever = np.array([levers(k, c, rotation, offset) for k, c in zip(link, center)])

    turns_by = lever.max(axis=1)
    fixed = turns_by <= STILL
    radius[fixed] += 2.0 * turns_by[fixed]
    zero = _centers_at_zero(rotation, offset, link, center)
    moving = ~fixed
    pairs, groups, reach = _self_groups(robot.self_pairs, link, fixed, center, radius)
    both = np.concatenate([radius[moving], radius[fixed]])
    return Body(
        rotation=rotation,
        offset=offset,
        first=np.searchsorted(link[moving], np.arange(robot.n + 2)).astype(np.int64),
        center=np.ascontiguousarray(center[moving]),
        radius=np.ascontiguousarray(radius[moving]),
        lever=np.ascontiguousarray(lever[moving]),
        link=link[moving],
        original=order[moving].astype(np.int64),
        fixed_center=np.ascontiguousarray(zero[fixed]),
        fixed_radius=np.ascontiguousarray(radius[fixed]),
        fixed_link=link[fixed],
        pairs=pairs,
        pair_radius=both[pairs].sum(axis=1),
        groups=groups,
        group_reach=reach,
        lower=np.asarray(robot.limits.lower, float).copy(),
        upper=np.asarray(robot.limits.upper, float).copy(),
    )


def aligned_chain(robot: Robot) -> tuple[Floats, Floats, list[Floats]]:
    """The chain with link frames turned so that every joint turns about its z axis.

    Returns:
        (n, 3, 3) rotations and (n, 3) offsets of joint frames in the turned link frames before
        them, and the n + 1 turns: ``R_link_turned`` of every link.
    """
    turns = [np.eye(3)] + [_z_to(a) for a in robot.axis]
    n = robot.n
    rotation = np.empty((n, 3, 3))
    offset = np.empty((n, 3))
    for i in range(n):
        rotation[i] = turns[i].T @ robot.T_link_joint[i, :3, :3] @ turns[i + 1]
        offset[i] = turns[i].T @ robot.T_link_joint[i, :3, 3]
    return rotation, offset, turns


def _z_to(axis: Floats) -> Floats:
    """A rotation that takes z to a unit vector."""
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    helper = np.array([1.0, 0.0, 0.0]) if abs(a[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, a)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(a, x), a])


def levers(link: int, center: Floats, rotation: Floats, offset: Floats) -> Floats:
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


def _self_groups(
    link_pairs: Ints, link: Ints, fixed: NDArray[np.bool_], center: Points, radius: Floats
) -> tuple[Ints, Ints, Floats]:
    """Pairs of spheres that may touch, in groups of two links, and how far each group reaches."""
    moving = int((~fixed).sum())
    number = np.where(fixed, moving + np.cumsum(fixed) - 1, np.cumsum(~fixed) - 1)
    pairs: list[tuple[int, int]] = []
    groups: list[tuple[int, ...]] = []
    reaches: list[float] = []
    for a, b in np.sort(np.asarray(link_pairs, np.int64).reshape(-1, 2), axis=1):
        second = np.flatnonzero((link == b) & ~fixed)
        for still in (True, False):
            first = np.flatnonzero((link == a) & (fixed == still))
            if len(first) == 0 or len(second) == 0:
                continue
            hub_a, reach_a = _hub(center[first], radius[first])
            hub_b, reach_b = _hub(center[second], radius[second])
            begin = len(pairs)
            pairs += [(int(number[i]), int(number[k])) for i in first for k in second]
            groups.append(
                (
                    0 if still else int(a),
                    int(b),
                    int(number[first[hub_a]]),
                    int(number[second[hub_b]]),
                    begin,
                    len(pairs),
                )
            )
            reaches.append(reach_a + reach_b)
    return (
        np.array(pairs, np.int64).reshape(-1, 2),
        np.array(groups, np.int64).reshape(-1, 6),
        np.array(reaches, float),
    )


def _hub(center: Points, radius: Floats) -> tuple[int, float]:
    """The sphere about which the smallest ball holds all others, and that ball's radius [m]."""
    reach = (np.linalg.norm(center[:, None] - center[None], axis=2) + radius[None]).max(axis=1)
    best = int(np.argmin(reach))
    return best, float(reach[best])
