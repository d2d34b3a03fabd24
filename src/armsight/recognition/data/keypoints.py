"""Key points of the catalogue's arms: where they are and what they are called.

28 a robot, in this order: the base's origin, the joint origins and the flange; both ends of every
joint's axis, where it leaves the two links that it joins; then points on the surface, each the
farthest from all before it, which fall on the long links. None depends on a tool. They lie in
``keypoints.json``, since weights that were learnt with them must find them again; ``python -m
armsight.recognition.data.keypoints`` writes that file anew from the meshes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from armsight.arrays import Bytes, Floats, Ints, Mask, Points, Poses, Vector3
from armsight.errors import DatasetError
from armsight.geometry.pose import inverse, transform
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.robots.catalogue import load_robot
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import Triangles, join_triangles, read_mesh
from armsight.robots.robot import Robot
from armsight.robots.solids import sample_surface

COUNT = 28
"""Key points of each robot."""
FILE = Path(__file__).parent / "keypoints.json"


@dataclass(frozen=True)
class KeyPoints:
    """Points that move with an arm.

    Attributes:
        names: (p,) what each is.
        link: (p,) index of the link that carries each.
        other: (p,) a second link on whose surface each may be seen; the same one otherwise.
        point: (p, 3) in the carrying link's frame [m].
    """

    names: tuple[str, ...]
    link: Ints
    other: Ints
    point: Points


@cache
def robot_keypoints(name: str) -> KeyPoints:
    """Key points of an arm of the catalogue; none for any other name.

    Raises:
        DatasetError: the file of the key points is broken.
    """
    if name not in KNOWN_ROBOTS:
        return KeyPoints((), np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)))
    try:
        rows = json.loads(FILE.read_text(encoding="utf-8"))[name]
        return KeyPoints(
            tuple(row["name"] for row in rows),
            np.array([row["link"] for row in rows], np.int64),
            np.array([row["other"] for row in rows], np.int64),
            np.array([row["point"] for row in rows], np.float64),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{FILE}: is broken ({error!r}); install armsight again") from None


def placed_keypoints(points: KeyPoints, T_x_link: Poses) -> Points:
    """(p, 3) key points in a frame x [m], of (n + 1, 4, 4) poses of the links in it."""
    T = T_x_link[points.link]
    return np.asarray((T[:, :3, :3] @ points.point[:, :, None])[..., 0] + T[:, :3, 3])


def visible_keypoints(keypoints: KeyPoints, pixels: Floats, links: Bytes) -> Mask:
    """(p,) whether a link that a key point belongs to is seen within a pixel of it."""
    h, w = links.shape
    visible = np.zeros(len(pixels), bool)
    for i, (u, v) in enumerate(pixels):
        if not (np.isfinite(u) and -0.5 <= u < w - 0.5 and -0.5 <= v < h - 0.5):
            continue
        x, y = round(u), round(v)
        window = links[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        visible[i] = bool(np.isin(window, (keypoints.link[i] + 1, keypoints.other[i] + 1)).any())
    return visible


def find_keypoints(robot: Robot) -> KeyPoints:
    """Key points of an arm from its meshes; the same ones every time."""
    surfaces = link_surfaces(robot)
    names = ["base"]
    link: list[int] = [0]
    other: list[int] = [0]
    point: list[Vector3] = [np.zeros(3)]
    for i, joint in enumerate(robot.joint_names):
        names.append(joint)
        link.append(i + 1)
        other.append(i)
        point.append(np.zeros(3))
    names.append("flange")
    link.append(robot.n)
    other.append(robot.n)
    point.append(robot.T_last_flange[:3, 3].copy())
    for i, joint in enumerate(robot.joint_names):
        for end, t in zip(("start", "end"), _axis_ends(robot, surfaces, i)):
            names.append(f"{joint} axis {end}")
            link.append(i + 1)
            other.append(i)
            point.append(robot.axis[i] * t)
    _spread(robot, surfaces, names, link, other, point)
    return KeyPoints(tuple(names), np.array(link), np.array(other), np.round(np.array(point), 4))


def link_surfaces(robot: Robot) -> list[Triangles]:
    """Triangles of each link, base first, in the link's frame."""
    return [
        join_triangles([read_mesh(m) for m in robot.meshes if m.link == i])
        for i in range(robot.n + 1)
    ]


def _axis_ends(robot: Robot, surfaces: list[Triangles], joint: int) -> tuple[float, float]:
    """Where a joint's axis leaves the two links that it joins [m], from the joint's origin."""
    axis = robot.axis[joint]
    T_joint_before = inverse(robot.T_link_joint[joint])
    before, faces = surfaces[joint]
    hits = np.concatenate(
        [
            _line_hits(axis, transform(T_joint_before, before), faces),
            _line_hits(axis, *surfaces[joint + 1]),
        ]
    )
    # A link that is long along the axis (a forearm's end) is left where the joint's housing ends.
    near = hits[np.abs(hits) < 0.25]
    if len(near) == 0:
        return -0.05, 0.05
    return float(near.min()), float(near.max())


def _line_hits(axis: Vector3, vertices: Points, faces: Ints) -> Floats:
    """Places along a line through the origin where it meets triangles (Moeller and Trumbore)."""
    if len(faces) == 0:
        return np.empty(0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(axis, e2)
    det = (e1 * p).sum(1)
    ok = np.abs(det) > 1e-14
    a, e1, e2, p, det = a[ok], e1[ok], e2[ok], p[ok], det[ok]
    u = (-a * p).sum(1) / det
    q = np.cross(-a, e1)
    v = (q * axis).sum(1) / det
    t = (e2 * q).sum(1) / det
    return np.asarray(t[(u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6)])


def _spread(
    robot: Robot,
    surfaces: list[Triangles],
    names: list[str],
    link: list[int],
    other: list[int],
    point: list[Vector3],
) -> None:
    """Fill up with surface points, each the farthest from all before it, at the home pose."""
    T = link_poses(robot, robot.home)
    skins = [sample_surface(surface, 0.01) for surface in surfaces]
    owner = np.concatenate([np.full(len(v), i) for i, v in enumerate(skins)])
    local = np.concatenate(skins)
    placed = np.concatenate([transform(T[i], v) for i, v in enumerate(skins)])
    chosen = placed_keypoints(
        KeyPoints(tuple(names), np.array(link), np.array(other), np.array(point)), T
    )
    distance = np.min(np.linalg.norm(placed[:, None] - chosen[None], axis=2), axis=1)
    while len(names) < COUNT:
        k = int(np.argmax(np.round(distance, 6)))
        names.append(f"{robot.link_names[owner[k]]} surface {len(names)}")
        link.append(int(owner[k]))
        other.append(int(owner[k]))
        point.append(local[k])
        distance = np.minimum(distance, np.linalg.norm(placed - placed[k], axis=1))


def _write() -> None:
    data = {}
    for name in KNOWN_ROBOTS:
        found = find_keypoints(load_robot(name))
        data[name] = [
            {"name": n, "link": int(i), "other": int(o), "point": [float(x) + 0.0 for x in p]}
            for n, i, o, p in zip(found.names, found.link, found.other, found.point)
        ]
    rows = [
        f' "{name}": [\n' + ",\n".join(f"  {json.dumps(row)}" for row in rows) + "\n ]"
        for name, rows in data.items()
    ]
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    _write()
