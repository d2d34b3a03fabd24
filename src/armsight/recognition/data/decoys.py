"""What stands where an arm might and is none: lamps, pipes, hoists, tripods, fans, people.

Pictures without a robot are mostly easy; these are the ones in which a network sees an arm.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from armsight.arrays import Pose, Vector3
from armsight.geometry.pose import make_pose, transform
from armsight.recognition.data.clutter import Group, draw_person, draw_surface, triple
from armsight.recognition.data.room import Room
from armsight.recognition.data.things import Surface, Thing, rod, turned_box, yaw_pose


def draw_decoy(room: Room, T_world_base: Pose, rng: np.random.Generator) -> Group:
    """One such thing at the place of a base.

    Args:
        room: around it.
        T_world_base: where the arm would stand, z up or down.
        rng: source of randomness.
    """
    T = T_world_base @ yaw_pose(rng.uniform(-np.pi, np.pi), (0.0, 0.0, 0.0))
    kind = int(rng.integers(len(_KINDS) + 1))
    if kind == len(_KINDS):
        return draw_person(room, rng, T[:2, 3])
    return _KINDS[kind](T, rng)


def _lamp(T: Pose, rng: np.random.Generator) -> Group:
    """A desk lamp: thin limbs, springs beside them, a shade or a magnifier at the end."""
    surface, shade = draw_surface(rng, -1), draw_surface(rng, -1)
    radius = rng.uniform(0.005, 0.016)
    points = [np.zeros(3)]
    for _ in range(int(rng.integers(2, 4))):
        step = rng.uniform(0.2, 0.45) * _upward(rng, 0.4)
        points.append(points[-1] + step)
    group = [_plate(T, rng, surface)]
    for a, b in pairwise(points):
        group.append(_limb(T, a, b, radius, surface))
        if rng.random() < 0.5:
            aside = np.array([0.0, rng.uniform(0.02, 0.05), 0.0])
            group.append(_limb(T, a + aside, b + aside, 0.6 * radius, surface))
        group.append(_ball(T, b, rng.uniform(1.0, 2.5) * radius, surface))
    size = rng.uniform([0.05, 0.03], [0.13, 0.12])
    T_end = T @ make_pose(None, points[-1])
    group.append(Thing("cylinder", (float(size[0]), float(size[0]), float(size[1])), T_end, shade))
    return group


def _pipe(T: Pose, rng: np.random.Generator) -> Group:
    """A pipe or a handle: one radius, right angles, flanges at some bends."""
    surface, radius = draw_surface(rng), rng.uniform(0.01, 0.06)
    point, along = np.zeros(3), np.array([0.0, 0.0, 1.0])
    group = [_plate(T, rng, surface)]
    for _ in range(int(rng.integers(2, 6))):
        end = point + rng.uniform(0.12, 0.5) * along
        group.append(_limb(T, point, end, radius, surface))
        group.append(_ball(T, end, radius * rng.choice([1.0, 1.0, 1.6]), surface))
        point = end
        axes = [v for v in np.vstack([np.eye(3), -np.eye(3)[:2]]) if abs(v @ along) < 0.5]
        along = axes[int(rng.integers(len(axes)))]
    return group


def _hoist(T: Pose, rng: np.random.Generator) -> Group:
    """A column with a boom, a strut and something that hangs."""
    surface, other = draw_surface(rng), draw_surface(rng)
    tall, far = rng.uniform(0.5, 1.1), rng.uniform(0.3, 0.7)
    thick = rng.uniform(0.02, 0.07)
    column = T @ make_pose(None, (0, 0, 0.5 * tall))
    boom = T @ make_pose(None, (0.5 * far, 0, tall))
    group = [
        _plate(T, rng, surface),
        turned_box(column, (thick, thick, 0.5 * tall), surface),
        turned_box(boom, (0.5 * far, 0.8 * thick, thick), surface),
    ]
    if rng.random() < 0.6:
        low = np.array([0.0, 0.0, 0.6 * tall])
        group.append(_limb(T, low, np.array([0.6 * far, 0.0, tall]), 0.5 * thick, other))
    if rng.random() < 0.6:
        hook = np.array([far, 0.0, tall - rng.uniform(0.1, 0.4)])
        group.append(_limb(T, np.array([far, 0.0, tall]), hook, 0.006, other))
        size = rng.uniform(0.03, 0.1, 3)
        at = T @ make_pose(None, hook - np.array([0.0, 0.0, size[2]]))
        group.append(turned_box(at, triple(size), other))
    return group


def _tripod(T: Pose, rng: np.random.Generator) -> Group:
    """Three legs, a column, a camera or a sign on top."""
    surface, top = draw_surface(rng, -1), draw_surface(rng)
    crown = np.array([0.0, 0.0, rng.uniform(0.3, 0.9)])
    spread, radius = rng.uniform(0.12, 0.35), rng.uniform(0.006, 0.02)
    group = []
    for angle in np.arange(3) * 2.0 * np.pi / 3.0:
        foot = spread * np.array([np.cos(angle), np.sin(angle), 0.0])
        group.append(_limb(T, foot, crown, radius, surface))
    end = crown + np.array([0.0, 0.0, rng.uniform(0.05, 0.4)])
    group.append(_limb(T, crown, end, 1.3 * radius, surface))
    size = rng.uniform([0.03, 0.02, 0.02], [0.25, 0.08, 0.2])
    at = T @ make_pose(None, end + np.array([0.0, 0.0, size[2]]))
    group.append(turned_box(at, triple(size), top))
    return group


def _fan(T: Pose, rng: np.random.Generator) -> Group:
    """A pole with a disc, a ball or a screen on an arm of one limb."""
    surface, head = draw_surface(rng, -1), draw_surface(rng)
    tall, radius = rng.uniform(0.3, 0.9), rng.uniform(0.01, 0.035)
    top, end = np.array([0.0, 0.0, tall]), np.array([rng.uniform(0.02, 0.3), 0.0, tall])
    group = [_plate(T, rng, surface), _limb(T, np.zeros(3), top, radius, surface)]
    group.append(_limb(T, top, end, radius, surface))
    size = rng.uniform(0.08, 0.22)
    R = np.array([[0.0, 0, 1.0], [0, 1.0, 0], [-1.0, 0, 0]])
    T_end = T @ make_pose(R, end)
    if rng.random() < 0.5:
        group.append(Thing("cylinder", (size, size, rng.uniform(0.02, 0.08)), T_end, head))
    else:
        group.append(turned_box(T_end, (size, 1.5 * size, 0.02), head))
    return group


_KINDS = (_lamp, _lamp, _pipe, _pipe, _hoist, _tripod, _fan)


def _plate(T: Pose, rng: np.random.Generator, surface: Surface) -> Thing:
    r = rng.uniform(0.05, 0.15)
    return Thing("cylinder", (r, r, 0.015), T @ make_pose(None, (0, 0, 0.015)), surface)


def _limb(T: Pose, a: Vector3, b: Vector3, radius: float, surface: Surface) -> Thing:
    start, end = transform(T, np.stack([a, b]))
    return rod(start, end, radius, surface)


def _ball(T: Pose, at: Vector3, radius: float, surface: Surface) -> Thing:
    r = float(radius)
    return Thing("ellipsoid", (r, r, r), T @ make_pose(None, at), surface)


def _upward(rng: np.random.Generator, least: float) -> Vector3:
    """A direction, mostly up."""
    v = rng.standard_normal(3)
    v[2] = abs(v[2]) + least
    return np.asarray(v / np.linalg.norm(v))
