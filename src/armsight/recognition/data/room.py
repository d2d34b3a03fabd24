"""A room with an arm's stand in it: walls, windows, table or pedestal."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armsight.arrays import Bytes, Floats, Pose
from armsight.geometry.pose import from_rpy, make_pose
from armsight.recognition.data.recipe import Recipe
from armsight.recognition.data.textures import draw_texture
from armsight.recognition.data.things import (
    Color,
    Surface,
    Thing,
    box,
    cross,
    rod,
    turned_box,
    yaw_pose,
)

FLOOR, WALL, TABLE, PICTURE, CLOTH, PAINT = range(6)
"""What each texture of a scene is for."""


@dataclass(frozen=True)
class Stand:
    """What an arm stands on or hangs from.

    Attributes:
        kind: for the statistics.
        T_world_base: the arm's base.
        things: what is seen.
        blocked: boxes that the arm must not touch.
        top: (2, 3) corners of a table's top in world, where things can lie; None without one.
    """

    kind: str
    T_world_base: Pose
    things: list[Thing]
    blocked: list[Thing]
    top: Floats | None = None


@dataclass(frozen=True)
class Room:
    """Walls, and what hangs on them.

    Attributes:
        corners: (2, 3) least and greatest corner of the air in it [m]; the floor is z = 0.
        things: the shell.
        textures: of the scene, in the order of FLOOR, WALL ...
    """

    corners: Floats
    things: list[Thing] = field(default_factory=list)
    textures: list[Bytes] = field(default_factory=list)


def draw_room(recipe: Recipe, rng: np.random.Generator) -> Room:
    """A closed room around the origin."""
    calm = recipe.calm_light
    far = recipe.distance[1]
    low = -rng.uniform(0.75 * far, far + 2.5, 2)
    high = rng.uniform(0.75 * far, far + 2.5, 2)
    corners = np.array([[*low, 0.0], [*high, rng.uniform(2.4, 4.2)]])
    textures = [
        draw_texture(rng, calm=rng.random() < (0.7 if calm else 0.5)),
        draw_texture(rng, calm=rng.random() < (0.8 if calm else 0.6)),
        draw_texture(rng, calm=rng.random() < 0.5),
        draw_texture(rng),
        draw_texture(rng),
        draw_texture(rng),
    ]
    room = Room(corners, [], textures)
    _shell(room, recipe, rng)
    for _ in range(int(rng.integers(0, 9))):
        _on_wall(room, rng)
    return room


def _shell(room: Room, recipe: Recipe, rng: np.random.Generator) -> None:
    (x0, y0, _), (x1, y1, h) = room.corners
    mirror = float(rng.uniform(0.05, 0.3)) if rng.random() < 0.08 else 0.0
    floor = Surface(
        _pale(rng, 0.3, 1.0),
        specular=float(rng.uniform(0, 0.4)),
        reflectance=mirror,
        texture=FLOOR if rng.random() < 0.85 else -1,
        repeat=float(rng.uniform(0.3, 3.0)),
    )
    things = room.things
    middle, wide = 0.5 * (room.corners[0] + room.corners[1]), 0.5 * (x1 - x0)
    deep = 0.5 * (y1 - y0)
    things.append(box((middle[0], middle[1], -0.05), (wide, deep, 0.05), floor))
    ceiling = Surface(_pale(rng, 0.6, 1.0), emission=float(rng.uniform(0, 0.3)))
    things.append(box((middle[0], middle[1], h + 0.05), (wide, deep, 0.05), ceiling))
    # White walls behind white arms are the hard case, and common.
    color = (0.95, 0.95, 0.94) if rng.random() < 0.35 else _pale(rng, 0.25, 1.0)
    repeat = float(rng.uniform(0.3, 3.0))
    for k, (center, half) in enumerate(
        [
            ((x0, middle[1]), deep),
            ((x1, middle[1]), deep),
            ((middle[0], y0), wide),
            ((middle[0], y1), wide),
        ]
    ):
        mine = color if rng.random() < 0.8 else _pale(rng, 0.2, 1.0)
        textured = rng.random() < (0.5 if recipe.calm_light else 0.8)
        glow = float(rng.uniform(0.0, 0.25)) if rng.random() < 0.3 else 0.0
        surface = Surface(
            mine,
            specular=float(rng.uniform(0, 0.3)),
            emission=glow,
            texture=WALL if textured else -1,
            repeat=repeat,
        )
        T = _wall_pose(k, np.array([*center, 0.5 * h]))
        things.append(turned_box(T, (half, 0.5 * h, 0.04), surface))


def _wall_pose(side: int, center: Floats) -> Pose:
    """The pose with z into the room and y up; pushed back by the wall's half thickness."""
    inward = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])[side]
    up = np.array([0.0, 0.0, 1.0])
    R = np.column_stack([cross(up, inward), up, inward])
    return make_pose(R, center - 0.04 * inward)


def _on_wall(room: Room, rng: np.random.Generator) -> None:
    """A window, a screen, a notice, a door or a pipe."""
    (x0, y0, _), (x1, y1, h) = room.corners
    side = int(rng.integers(0, 4))
    along = rng.uniform(y0 + 0.6, y1 - 0.6) if side < 2 else rng.uniform(x0 + 0.6, x1 - 0.6)
    height = rng.uniform(0.6, h - 0.5)
    center = (
        np.array([(x0, x1)[side], along, height])
        if side < 2
        else np.array([along, (y0, y1)[side - 2], height])
    )
    T = _wall_pose(side, center)
    half = (rng.uniform(0.15, 0.9), rng.uniform(0.15, 0.6), 0.05)
    kind = rng.integers(0, 4)
    if kind == 0:
        light = float(rng.uniform(0.5, 1.0))
        surface = Surface((1.0, 1.0, 1.0), emission=light)
    elif kind == 1:
        surface = Surface(
            (1.0, 1.0, 1.0),
            emission=float(rng.uniform(0, 0.8)),
            texture=PICTURE,
            repeat=float(rng.uniform(0.7, 2)),
        )
    elif kind == 2:
        half = (0.45, 1.0, 0.05)
        T[2, 3] = 1.0
        surface = Surface(_pale(rng, 0.1, 0.9), texture=TABLE)
    else:
        half = (float(rng.uniform(0.02, 0.08)), 0.5 * h, 0.08)
        T[2, 3] = 0.5 * h
        surface = Surface(_pale(rng, 0.2, 0.9), specular=0.6)
    room.things.append(turned_box(T, half, surface))


def draw_stand(recipe: Recipe, room: Room, rng: np.random.Generator) -> Stand:
    """What the arm stands on, near the room's middle."""
    spot = rng.uniform(-0.4, 0.4, 2)
    yaw = rng.uniform(-np.pi, np.pi)
    if rng.random() < recipe.inverted:
        return _gantry(room, spot, yaw, rng)
    kind = rng.choice(["table", "pedestal", "column", "trolley", "plate"], p=_STANDS)
    if kind == "table":
        return _table(spot, yaw, rng)
    if kind == "plate":
        height, half = rng.uniform(0.01, 0.06), rng.uniform(0.15, 0.5)
    elif kind == "trolley":
        height, half = rng.uniform(0.5, 0.9), rng.uniform(0.22, 0.4)
    else:
        height, half = rng.uniform(0.3, 1.1), rng.uniform(0.09, 0.22)
    T = yaw_pose(yaw, (*spot, height))
    surface = _stand_surface(rng)
    middle = T @ make_pose(None, (0, 0, -0.5 * height))
    solid = turned_box(middle, (half, half, 0.5 * height), surface)
    if kind == "column":
        seen: list[Thing] = [Thing("cylinder", (half, half, 0.5 * height), middle, surface)]
        foot = T @ make_pose(None, (0, 0, 0.01 - height))
        seen.append(turned_box(foot, (half + 0.12, half + 0.12, 0.01), surface))
    elif kind == "trolley":
        seen = _trolley(T, half, height, surface, rng)
    else:
        seen = [solid]
    return Stand(str(kind), T, seen, [solid])


_STANDS = (0.5, 0.15, 0.15, 0.12, 0.08)


def _table(spot: Floats, yaw: float, rng: np.random.Generator) -> Stand:
    """A table; the arm stands anywhere on it, often near an edge."""
    height = rng.uniform(0.5, 1.0)
    half = rng.uniform([0.35, 0.35], [1.1, 0.7])
    place = rng.uniform(-1.0, 1.0, 2) * np.maximum(half - 0.15, 0.0)
    thick = rng.uniform(0.015, 0.05)
    T = yaw_pose(yaw, (*spot, height))
    T_top = T @ make_pose(None, (-place[0], -place[1], -thick))
    surface = _stand_surface(rng)
    top = turned_box(T_top, (half[0], half[1], thick), surface)
    things = [top]
    metal = Surface(_pale(rng, 0.1, 0.8), specular=0.5)
    if rng.random() < 0.7:
        for sx in (-1, 1):
            for sy in (-1, 1):
                foot = T_top @ [sx * (half[0] - 0.05), sy * (half[1] - 0.05), 0.0, 1.0]
                start = np.array([foot[0], foot[1], 0.0])
                things.append(rod(start, foot[:3], rng.uniform(0.015, 0.04), metal, "cylinder"))
    else:
        body = T_top @ make_pose(None, (0, 0, -0.5 * (height - 2 * thick) - thick))
        things.append(
            turned_box(body, (0.9 * half[0], 0.9 * half[1], 0.5 * (height - 2 * thick)), metal)
        )
    # Below the top counts as blocked too: no arm reaches through a table.
    below = turned_box(
        T @ make_pose(None, (-place[0], -place[1], -0.5 * height)),
        (half[0], half[1], 0.5 * height),
        surface,
    )
    corner = T_top @ np.array([[-half[0], -half[1], thick, 1.0], [half[0], half[1], thick, 1.0]]).T
    return Stand("table", T, things, [below], corner[:3].T)


def _trolley(
    T: Pose, half: float, height: float, surface: Surface, rng: np.random.Generator
) -> list[Thing]:
    """A box on wheels, with shelves or closed."""
    things = []
    wheel = Surface((0.08, 0.08, 0.09))
    low = 0.12
    if rng.random() < 0.5:
        body = T @ make_pose(None, (0, 0, -0.5 * (height - low)))
        things.append(turned_box(body, (half, half, 0.5 * (height - low)), surface))
    else:
        for z in (0.02, 0.5 * height, height - low):
            shelf = T @ make_pose(None, (0, 0, -z))
            things.append(turned_box(shelf, (half, half, 0.02), surface))
        for sx in (-1, 1):
            for sy in (-1, 1):
                a = (T @ [sx * (half - 0.03), sy * (half - 0.03), -0.02, 1.0])[:3]
                b = (T @ [sx * (half - 0.03), sy * (half - 0.03), low - height, 1.0])[:3]
                things.append(rod(a, b, 0.02, surface, "cylinder"))
    for sx in (-1, 1):
        for sy in (-1, 1):
            center = T @ make_pose(None, (sx * (half - 0.05), sy * (half - 0.05), 0.06 - height))
            things.append(Thing("ellipsoid", (0.06, 0.06, 0.06), center, wheel))
    return things


def _gantry(room: Room, spot: Floats, yaw: float, rng: np.random.Generator) -> Stand:
    """A beam under the ceiling from which the arm hangs."""
    height = min(rng.uniform(1.7, 2.3), room.corners[1, 2] - 0.3)
    T = yaw_pose(yaw, (*spot, height)) @ from_rpy((np.pi, 0.0, 0.0))
    surface = _stand_surface(rng)
    half = rng.uniform(0.06, 0.25)
    beam = box((*spot, height + half), (half, 3.0, half), surface)
    plate = box((*spot, height + 0.01), (half + 0.08, half + 0.08, 0.01), surface)
    ceiling = box((*spot, height + 1.0), (3.0, 3.0, 1.0), surface)
    return Stand("gantry", T, [beam, plate], [ceiling])


def _stand_surface(rng: np.random.Generator) -> Surface:
    return Surface(
        _pale(rng, 0.1, 1.0),
        specular=float(rng.uniform(0.05, 0.6)),
        texture=TABLE if rng.random() < 0.5 else -1,
        repeat=float(rng.uniform(0.5, 3.0)),
    )


def _pale(rng: np.random.Generator, low: float, high: float) -> Color:
    """A grey with a little colour, now and then with much."""
    strong = 0.3 if rng.random() < 0.12 else 0.06
    r, g, b = np.clip(rng.uniform(low, high) + strong * rng.uniform(-1, 1, 3), 0.0, 1.0)
    return float(r), float(g), float(b)
