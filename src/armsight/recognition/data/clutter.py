"""Things in the room that are no robot: furniture, tools on the table, people, occluders.

Each is a group of solids that is kept or dropped as a whole. What stands in a room is drawn without
regard to the camera, then whatever would touch the arm or hide it is dropped, so that samples of
one room share their things.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import Floats, Points, Pose, Vector3
from armsight.geometry.pose import make_pose
from armsight.recognition.data.framing import View
from armsight.recognition.data.room import CLOTH, PICTURE, TABLE, Room, Stand
from armsight.recognition.data.things import Surface, Thing, rod, turned_box, yaw_pose
from armsight.simulation.skeleton import INDEX, Proportions, standing

Group = list[Thing]


def draw_furniture(room: Room, count: int, rng: np.random.Generator) -> list[Group]:
    """Groups on the floor, anywhere in the room."""
    (x0, y0, _), (x1, y1, _) = room.corners
    groups = []
    for _ in range(count):
        spot = rng.uniform([x0 + 0.2, y0 + 0.2], [x1 - 0.2, y1 - 0.2])
        T = yaw_pose(rng.uniform(-np.pi, np.pi), (*spot, 0.0))
        groups.append(_FURNITURE[int(rng.integers(len(_FURNITURE)))](T, rng))
    return groups


def draw_table_things(stand: Stand, count: int, rng: np.random.Generator) -> list[Group]:
    """Small things on the stand's table, if it has one."""
    if stand.top is None:
        return []
    groups = []
    low, high = stand.top.min(axis=0), stand.top.max(axis=0)
    for _ in range(count):
        spot = rng.uniform(low, high)
        size = rng.uniform(0.01, 0.08, 3)
        T = yaw_pose(rng.uniform(-np.pi, np.pi), (spot[0], spot[1], spot[2] + size[2]))
        kind = rng.choice(["box", "cylinder", "ellipsoid"])
        if kind == "cylinder":
            size[1] = size[0]
        groups.append([Thing(kind, triple(size), T, draw_surface(rng))])
    return groups


def draw_person(room: Room, rng: np.random.Generator, spot: Floats | None = None) -> Group:
    """Someone made of capsules, arms hanging or raised.

    Args:
        room: to stand in.
        rng: source of randomness.
        spot: (2,) where on the floor [m]; anywhere if None.
    """
    p = Proportions(float(rng.uniform(1.5, 1.95)))
    joints = standing(p)
    for side in ("left", "right"):
        if rng.random() < 0.5:
            shoulder = joints[INDEX[f"{side}_shoulder"]]
            upper, fore = _direction(rng), _direction(rng)
            elbow = shoulder + p.upper_arm * upper
            wrist = elbow + p.forearm * fore
            joints[INDEX[f"{side}_elbow"]], joints[INDEX[f"{side}_wrist"]] = elbow, wrist
            joints[INDEX[f"{side}_hand"]] = wrist + p.hand * fore
    (x0, y0, _), (x1, y1, _) = room.corners
    anywhere = rng.uniform([x0 + 0.4, y0 + 0.4], [x1 - 0.4, y1 - 0.4])
    x, y = anywhere if spot is None else spot
    T = yaw_pose(rng.uniform(-np.pi, np.pi), (x, y, 0.0))
    joints = joints @ T[:3, :3].T + T[:3, 3]
    tone = rng.uniform(0.3, 0.9)
    skin = Surface((float(tone), float(0.78 * tone), float(0.66 * tone)), specular=0.1)
    shirt, trousers = draw_surface(rng, CLOTH), draw_surface(rng, CLOTH)
    parts = []
    for start, end, radius, surface in _BODY:
        looks = {"skin": skin, "shirt": shirt, "trousers": trousers}[surface]
        parts.append(rod(joints[INDEX[start]], joints[INDEX[end]], radius * p.height, looks))
    return parts


_BODY = (
    ("pelvis", "neck", 0.085, "shirt"),
    ("left_shoulder", "right_shoulder", 0.045, "shirt"),
    ("left_hip", "right_hip", 0.07, "trousers"),
    ("neck", "head", 0.055, "skin"),
    ("left_shoulder", "left_elbow", 0.03, "shirt"),
    ("right_shoulder", "right_elbow", 0.03, "shirt"),
    ("left_elbow", "left_wrist", 0.025, "skin"),
    ("right_elbow", "right_wrist", 0.025, "skin"),
    ("left_wrist", "left_hand", 0.024, "skin"),
    ("right_wrist", "right_hand", 0.024, "skin"),
    ("left_hip", "left_knee", 0.05, "trousers"),
    ("right_hip", "right_knee", 0.05, "trousers"),
    ("left_knee", "left_ankle", 0.035, "trousers"),
    ("right_knee", "right_ankle", 0.035, "trousers"),
    ("left_ankle", "left_toe", 0.028, "skin"),
    ("right_ankle", "right_toe", 0.028, "skin"),
)


def draw_occluder(
    view: View, centers: Points, radii: Floats, rng: np.random.Generator
) -> Group | None:
    """Something before the arm that hides up to about 30 % of its box; None if it would touch it.

    Args:
        view: the camera.
        centers: (m, 3) spheres of the arm in world [m].
        radii: (m,) of the spheres [m].
        rng: source of randomness.
    """
    eye = view.T_world_camera[:3, 3]
    target = centers[rng.integers(len(centers))]
    place = eye + (target - eye) * rng.uniform(0.3, 0.85)
    span = float(np.linalg.norm(np.ptp(centers, axis=0)))
    near = np.linalg.norm(place - eye) / np.linalg.norm(target - eye)
    wide = near * span * np.sqrt(rng.uniform(0.01, 0.25)) * 0.5
    tall = wide * rng.uniform(0.3, 3.0)
    R = view.T_world_camera[:3, :3] @ _spin(rng)
    kind = rng.choice(["box", "cylinder", "capsule", "ellipsoid"])
    size = np.array([wide, wide * rng.uniform(0.3, 1.0), tall])
    if kind in ("cylinder", "capsule"):
        size[:2] *= 0.5
        size[1] = size[0]
    thing = Thing(kind, triple(size), make_pose(R, place), draw_surface(rng))
    gap = np.linalg.norm(centers - place, axis=1) - radii
    if gap.min() < _bound(thing) or np.linalg.norm(place - eye) < _bound(thing) + 0.1:
        return None
    return [thing]


def draw_ledge(view: View, stand: Stand, rng: np.random.Generator) -> Group:
    """A board before the base that hides it, as a table's edge or a box on it does."""
    base = stand.T_world_base[:3, 3]
    toward = view.T_world_camera[:2, 3] - base[:2]
    yaw = np.arctan2(toward[1], toward[0])
    away, height = rng.uniform(0.18, 0.35), rng.uniform(0.05, 0.16)
    T = yaw_pose(yaw, base) @ make_pose(None, (away, rng.uniform(-0.1, 0.1), height - 0.05))
    return [turned_box(T, (0.015, rng.uniform(0.15, 0.5), height), draw_surface(rng))]


def fitting(
    groups: Sequence[Group], view: View, centers: Points, radii: Floats, may_hide: bool = False
) -> list[Thing]:
    """The things of those groups that neither touch the arm, nor hold the camera, nor hide the arm.

    Args:
        groups: to choose from.
        view: the camera.
        centers: (m, 3) spheres of the arm in world [m].
        radii: (m,) of the spheres [m].
        may_hide: whether things between camera and arm are kept.
    """
    eye = view.T_world_camera[:3, 3]
    kept: list[Thing] = []
    for group in groups:
        for thing in group:
            middle, bound = thing.T_world_thing[:3, 3], _bound(thing)
            if np.linalg.norm(middle - eye) < bound + 0.2:
                break
            if np.any(np.linalg.norm(centers - middle, axis=1) < radii + 0.75 * bound + 0.01):
                break
            if not may_hide and np.any(_to_segments(middle, eye, centers) < bound):
                break
        else:
            kept += group
    return kept


def draw_surface(rng: np.random.Generator, texture: int = -2) -> Surface:
    """Any paint, cloth, wood or metal; with a texture half the time."""
    value = rng.uniform(0.02, 1.0)
    tint = rng.uniform(-0.5, 0.5, 3) * (rng.random() < 0.6)
    r, g, b = np.clip(value + tint, 0.01, 1.0)
    chosen = int(rng.choice([PICTURE, CLOTH, TABLE])) if texture == -2 else texture
    return Surface(
        (float(r), float(g), float(b)),
        specular=float(rng.uniform(0.0, 0.8)),
        shininess=float(rng.uniform(0.1, 0.9)),
        emission=float(rng.uniform(0.3, 1.0)) if rng.random() < 0.03 else 0.0,
        texture=chosen if rng.random() < 0.5 else -1,
        repeat=float(rng.uniform(0.5, 3.0)),
    )


def _to_segments(point: Vector3, eye: Vector3, centers: Points) -> Floats:
    """(m,) distances of a point from the segments between the eye and the arm's spheres."""
    along = centers - eye
    t = np.clip(((point - eye) @ along.T) / np.maximum((along**2).sum(1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(eye + t[:, None] * along - point, axis=1))


def _bound(thing: Thing) -> float:
    """Radius of a ball around the thing [m]."""
    half = thing.size[2] + (thing.size[0] if thing.kind == "capsule" else 0.0)
    if thing.kind == "ellipsoid":
        return max(thing.size)
    across = np.hypot(thing.size[0], thing.size[1]) if thing.kind == "box" else thing.size[0]
    return float(np.hypot(across, half))


def _cabinet(T: Pose, rng: np.random.Generator) -> Group:
    half = rng.uniform([0.15, 0.15, 0.2], [0.6, 0.35, 1.0])
    body = turned_box(T @ make_pose(None, (0, 0, half[2])), triple(half), draw_surface(rng))
    group = [body]
    if rng.random() < 0.5:
        size = rng.uniform(0.05, 0.15, 3)
        T_top = T @ make_pose(None, (*rng.uniform(-0.1, 0.1, 2), 2 * half[2] + size[2]))
        group.append(turned_box(T_top, triple(size), draw_surface(rng)))
    return group


def _shelf(T: Pose, rng: np.random.Generator) -> Group:
    half, boards = rng.uniform(0.3, 0.7), int(rng.integers(3, 6))
    step, surface = rng.uniform(0.25, 0.45), draw_surface(rng)
    group = []
    for k in range(boards):
        T_board = T @ make_pose(None, (0, 0, 0.05 + k * step))
        group.append(turned_box(T_board, (half, 0.18, 0.012), surface))
        for x in rng.uniform(-half, half, int(rng.integers(0, 4))):
            size = rng.uniform(0.03, 0.11, 3)
            T_thing = T @ make_pose(None, (x, 0, 0.06 + k * step + size[2]))
            group.append(turned_box(T_thing, triple(size), draw_surface(rng)))
    for sx in (-1, 1):
        for sy in (-1, 1):
            a = (T @ [sx * half, sy * 0.17, 0.0, 1.0])[:3]
            b = (T @ [sx * half, sy * 0.17, 0.1 + (boards - 1) * step, 1.0])[:3]
            group.append(rod(a, b, 0.015, surface, "cylinder"))
    return group


def _barrel(T: Pose, rng: np.random.Generator) -> Group:
    radius, half = rng.uniform(0.06, 0.3), rng.uniform(0.1, 0.6)
    T = T @ make_pose(None, (0, 0, half))
    return [Thing("cylinder", (radius, radius, half), T, draw_surface(rng))]


def _lamp_stand(T: Pose, rng: np.random.Generator) -> Group:
    """A pole that bends: not unlike an arm."""
    surface, radius = draw_surface(rng), rng.uniform(0.015, 0.06)
    point = T[:3, 3].copy()
    group = [Thing("cylinder", (0.15, 0.15, 0.02), T @ make_pose(None, (0, 0, 0.02)), surface)]
    direction = np.array([0.0, 0.0, 1.0])
    for _ in range(int(rng.integers(2, 5))):
        end = point + rng.uniform(0.2, 0.6) * direction
        end[2] = max(end[2], 0.1)
        group.append(rod(point, end, radius, surface))
        point = end
        direction = _direction(rng)
    return group


def _chair(T: Pose, rng: np.random.Generator) -> Group:
    surface, metal = draw_surface(rng), draw_surface(rng, -1)
    seat = rng.uniform(0.4, 0.5)
    group = [
        turned_box(T @ make_pose(None, (0, 0, seat)), (0.22, 0.22, 0.03), surface),
        turned_box(T @ make_pose(None, (-0.2, 0, seat + 0.3)), (0.02, 0.2, 0.2), surface),
    ]
    for sx in (-1, 1):
        for sy in (-1, 1):
            a = (T @ [sx * 0.2, sy * 0.2, 0.0, 1.0])[:3]
            b = (T @ [sx * 0.2, sy * 0.2, seat, 1.0])[:3]
            group.append(rod(a, b, 0.012, metal, "cylinder"))
    return group


def _desk(T: Pose, rng: np.random.Generator) -> Group:
    half, height = rng.uniform([0.4, 0.3], [0.9, 0.45]), rng.uniform(0.65, 0.9)
    surface, metal = draw_surface(rng), draw_surface(rng, -1)
    group = [turned_box(T @ make_pose(None, (0, 0, height)), (half[0], half[1], 0.02), surface)]
    for sx in (-1, 1):
        for sy in (-1, 1):
            a = (T @ [sx * (half[0] - 0.04), sy * (half[1] - 0.04), 0.0, 1.0])[:3]
            b = (T @ [sx * (half[0] - 0.04), sy * (half[1] - 0.04), height, 1.0])[:3]
            group.append(rod(a, b, 0.02, metal, "cylinder"))
    screen = T @ make_pose(None, (rng.uniform(-0.2, 0.2), 0.1, height + 0.25))
    turn = make_pose(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    picture = Surface((1.0, 1.0, 1.0), emission=0.4, texture=PICTURE, repeat=1.5)
    group.append(turned_box(screen @ turn, (0.28, 0.17, 0.015), picture))
    return group


def _boxes(T: Pose, rng: np.random.Generator) -> Group:
    group, z = [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform(0.08, 0.3, 3)
        T_box = T @ yaw_pose(rng.uniform(-0.4, 0.4), (*rng.uniform(-0.05, 0.05, 2), z + size[2]))
        group.append(turned_box(T_box, triple(size), draw_surface(rng)))
        z += 2 * size[2]
    return group


_FURNITURE = (_cabinet, _shelf, _barrel, _lamp_stand, _chair, _desk, _boxes)


def _direction(rng: np.random.Generator) -> Vector3:
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def _spin(rng: np.random.Generator) -> Floats:
    a = rng.uniform(-np.pi, np.pi)
    c, s = np.cos(a), np.sin(a)
    # The thing's z lies across the view, so that tall things stand in the picture.
    upright = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ upright


def triple(size: Floats) -> tuple[float, float, float]:
    """The (3,) half sizes of a thing."""
    return float(size[0]), float(size[1]), float(size[2])
