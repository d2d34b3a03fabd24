"""Where the camera stands, what lens it has, and how the arm lies in its picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, make_pose, transform
from armsight.recognition.data.recipe import KINECT_V2_FOV_DEG, Recipe
from armsight.recognition.data.things import cross

TRIES = 120
WALL_GAP = 0.15
"""Between lens and wall, floor or ceiling [m]."""
LEAST_EXTENT = 0.2
"""Longer side of the arm in the picture, share of the picture's height."""
LEAST_GAP = 0.25
"""Between lens and arm [m]."""


@dataclass(frozen=True)
class View:
    """A lens in the room. ``cut``: the frame is meant to cut the arm."""

    lens: PinholeCamera
    T_world_camera: Pose
    cut: bool


def draw_view(
    recipe: Recipe,
    size: tuple[int, int],
    centers: Points,
    radii: Floats,
    base: Vector3,
    room: Floats,
    rng: np.random.Generator,
) -> View | None:
    """A camera that sees the arm as the recipe wants it, or None if none was found.

    Args:
        recipe: ranges.
        size: width, height of the picture [px].
        centers: (m, 3) spheres of the arm in world [m].
        radii: (m,) of the spheres [m].
        base: (3,) the robot's base in world.
        room: (2, 3) least and greatest corner of where the camera may be [m].
        rng: source of randomness.
    """
    cut = rng.random() < recipe.cut
    for _ in range(TRIES):
        lens = draw_lens(recipe, size, rng)
        T = _draw_pose(recipe, lens, centers, base, room, cut, rng)
        if T is None or np.linalg.norm(centers - T[:3, 3], axis=1).min() < LEAST_GAP:
            continue
        inside, extent = framed(lens, T, centers, radii)
        if extent < LEAST_EXTENT:
            continue
        if (0.35 <= inside <= 0.95) if cut else inside == 1.0:
            return View(lens, T, cut)
    return None


CROP_MARGINS = (0.75, 1.3, 2.4)
"""Least, middle and greatest width of a crop, arms' widths."""


def draw_crop(
    recipe: Recipe,
    size: tuple[int, int],
    centers: Points,
    radii: Floats,
    base: Vector3,
    room: Floats,
    rng: np.random.Generator,
) -> View | None:
    """A camera somewhere in the room, turned to the arm and cut to it; None if none was found.

    What a virtual camera sees that is turned on the spot until the arm lies in its middle: no lens
    error, square pixels, the principal point in the middle. Arguments as of :func:`draw_view`.
    """
    if rng.random() < recipe.whole:
        return draw_view(recipe, size, centers, radii, base, room, rng)
    for _ in range(TRIES):
        T = _draw_pose(recipe, _square(size[0], size), centers, base, room, False, rng)
        if T is None or np.linalg.norm(centers - T[:3, 3], axis=1).min() < LEAST_GAP:
            continue
        sight = transform(inverse(T), centers)
        rays = sight / np.linalg.norm(sight, axis=1, keepdims=True)
        middle = 0.5 * (rays.min(axis=0) + rays.max(axis=0))
        T = np.asarray(T @ make_pose(_turn(_FORWARD, middle / np.linalg.norm(middle))))
        p = transform(inverse(T), centers)
        if np.any(p[:, 2] < 0.1):
            continue
        edge = np.abs(p[:, :2]) / p[:, 2:] + (radii / p[:, 2])[:, None]
        least, usual, most = CROP_MARGINS
        margin = float(rng.triangular(least, usual, most))
        half = 0.5 * min(size)
        fx = half / (margin * float(edge.max()))
        if fx > 12.0 * half:
            continue  # a lens of 10 deg or less
        slack = max(margin - 1.0, 0.15) * float(edge.max())
        x, y = slack * rng.uniform(-0.7, 0.7, 2)
        aside = np.array([x, y, 1.0])
        T = np.asarray(T @ make_pose(_turn(_FORWARD, aside / np.linalg.norm(aside)).T))
        return View(_square(fx, size), T, margin < 1.0)
    return None


_FORWARD = np.array([0.0, 0.0, 1.0])


def _square(fx: float, size: tuple[int, int]) -> PinholeCamera:
    """A lens without faults."""
    w, h = size
    return PinholeCamera(w, h, fx, fx, 0.5 * (w - 1), 0.5 * (h - 1))


def draw_views(
    recipe: Recipe,
    size: tuple[int, int],
    centers: Points,
    radii: Floats,
    base: Vector3,
    room: Floats,
    rng: np.random.Generator,
    count: int,
    inside: float,
) -> list[View]:
    """At most ``count`` places of a camera that watches all that an arm does in a recording.

    Args:
        recipe: ranges.
        size: width, height of the picture [px].
        centers: (m, 3) spheres of the arm in many configurations, in world [m].
        radii: (m,) of the spheres [m].
        base: (3,) the robot's base in world.
        room: (2, 3) least and greatest corner of where the camera may be [m].
        rng: source of randomness.
        count: of the places.
        inside: least share of the spheres in the frame.
    """
    found: list[View] = []
    for _ in range(4 * TRIES):
        lens = draw_lens(recipe, size, rng)
        T = _draw_pose(recipe, lens, centers, base, room, False, rng)
        if T is not None and framed(lens, T, centers, radii)[0] >= inside:
            found.append(View(lens, T, False))
            if len(found) == count:
                break
    return found


def draw_lens(recipe: Recipe, size: tuple[int, int], rng: np.random.Generator) -> PinholeCamera:
    """A lens of the recipe."""
    w, h = size
    if recipe.fov_deg[0] == recipe.fov_deg[1]:
        return PinholeCamera.from_fov(w, h, *np.deg2rad(KINECT_V2_FOV_DEG))
    fx = 0.5 * w / np.tan(0.5 * np.deg2rad(rng.uniform(*recipe.fov_deg)))
    shift = recipe.center_shift * w * rng.uniform(-1.0, 1.0, 2)
    # Small: a picture that its user has rectified, though not perfectly.
    k1 = float(np.clip(rng.normal(0.0, recipe.distortion), -0.02, 0.02))
    return PinholeCamera(
        w,
        h,
        float(fx),
        float(fx * rng.uniform(0.99, 1.01)),
        0.5 * (w - 1) + float(shift[0]),
        0.5 * (h - 1) + float(shift[1]),
        (k1, 0.0, 0.0, 0.0, 0.0),
    )


def _draw_pose(
    recipe: Recipe,
    lens: PinholeCamera,
    centers: Points,
    base: Vector3,
    room: Floats,
    cut: bool,
    rng: np.random.Generator,
) -> Pose | None:
    middle = 0.5 * (centers.min(axis=0) + centers.max(axis=0))
    azimuth, elevation = (
        rng.uniform(-np.pi, np.pi),
        np.deg2rad(rng.uniform(*recipe.elevation_deg)),
    )
    direction = np.array(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    # Near ones more often: far from the lens, a metre changes little in the picture.
    near, far = recipe.distance
    distance = near * (far / near) ** rng.random()
    eye = base + _along(direction, middle - base, distance)
    if np.any(eye < room[0] + WALL_GAP) or np.any(eye > room[1] - WALL_GAP):
        return None
    T = look_at(eye, middle)
    roll = np.deg2rad(recipe.roll_deg) * rng.uniform(-1.0, 1.0)
    c, s = np.cos(roll), np.sin(roll)
    T = T @ make_pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    # Turn the camera so that the arm's middle lies elsewhere than in the picture's.
    reach = 1.1 if cut else recipe.aim
    x, y = (
        reach
        * rng.uniform(-1.0, 1.0, 2)
        * [0.5 * lens.width / lens.fx, 0.5 * lens.height / lens.fy]
    )
    seen = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
    return np.asarray(T @ make_pose(_turn(np.array([0.0, 0.0, 1.0]), seen).T))


def _along(direction: Vector3, offset: Vector3, distance: float) -> Vector3:
    """From the base to the eye: ``distance`` away from it, in a direction from the arm's middle."""
    # |offset + t direction| = distance
    b = float(offset @ direction)
    inside = b * b - float(offset @ offset) + distance**2
    return np.asarray(offset + (-b + np.sqrt(max(inside, 0.0))) * direction)


def _turn(a: Vector3, b: Vector3) -> Floats:
    """(3, 3) shortest rotation from unit vector a to unit vector b."""
    axis = cross(a, b)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + float(a @ b)))


def framed(lens: PinholeCamera, T: Pose, centers: Points, radii: Floats) -> tuple[float, float]:
    """Share of the arm's spheres wholly in the picture; its longer side against the height."""
    p = transform(inverse(T), centers)
    if np.any(p[:, 2] < 0.1):
        return 0.0, 0.0
    u = lens.fx * p[:, 0] / p[:, 2] + lens.cx
    v = lens.fy * p[:, 1] / p[:, 2] + lens.cy
    r = lens.fx * radii / p[:, 2]
    inside = (u > r) & (u < lens.width - 1 - r) & (v > r) & (v < lens.height - 1 - r)
    extent = max(np.ptp(u), np.ptp(v)) / lens.height
    return float(inside.mean()), float(extent)
