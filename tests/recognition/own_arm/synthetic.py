"""An arm before a camera, drawn triangle by triangle in plain numpy: nothing of the tested code."""

from __future__ import annotations

import numpy as np

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, transform
from armsight.robots import load_robot
from armsight.robots.kinematics import link_poses
from armsight.robots.meshes import read_mesh
from armsight.robots.robot import Robot

LENS = PinholeCamera(256, 212, 184.0, 184.0, 127.5, 105.5, (0.05, -0.04, 0.0, 0.0, 0.0))
T_BASE_CAMERA = look_at((1.3, 0.5, 0.9), (0.1, 0.0, 0.35))


def robot() -> Robot:
    return load_robot("ur5")


def corners(arm: Robot, q: np.ndarray) -> np.ndarray:
    """(f, 3, 3) triangles of the arm in ``base``."""
    T = link_poses(arm, q)
    parts = [(m.link, *read_mesh(m)) for m in arm.meshes]
    return np.concatenate([transform(T[k], v)[f] for k, v, f in parts])


def splatted_depth(
    triangles: np.ndarray, T_base_camera: np.ndarray, lens: PinholeCamera, seed: int
) -> np.ndarray:
    """(h, w) depth of random points on the triangles, before a wall and beside a person's board.

    What a pixel reads is where its own ray meets the plane of the triangle that has the point
    nearest to the ray: the nearest depth within a pixel would be millimetres too short on slopes.
    """
    rng = np.random.default_rng(seed)
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(edge1, edge2)
    area = np.linalg.norm(normal, axis=1)
    pick = rng.choice(len(area), 400_000, p=area / area.sum())
    a, b = rng.random((2, len(pick), 1))
    flip = (a + b) > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    points = triangles[pick, 0] + a * edge1[pick] + b * edge2[pick]
    board = np.array([0.75, 0.55, 0.0]) + rng.random((60_000, 3)) * [0.02, 0.3, 0.9]
    T = inverse(T_base_camera)
    seen = transform(T, np.concatenate([points, board]))
    across = np.concatenate([normal[pick], np.tile([0.0, 0.0, 0.0], (len(board), 1))]) @ T[:3, :3].T
    exact = lens.project(seen)
    u, v = np.round(exact).astype(int).T
    ok = (u >= 0) & (v >= 0) & (u < lens.width) & (v < lens.height)
    u, v, seen, across, exact = u[ok], v[ok], seen[ok], across[ok], exact[ok]
    depth = np.full((lens.height, lens.width), 2.6)
    np.minimum.at(depth, (v, u), seen[:, 2])
    ray = np.column_stack([lens.rays[v, u], np.ones(len(u))])
    along = np.einsum("ij,ij->i", across, ray)
    with np.errstate(divide="ignore", invalid="ignore"):
        met = np.einsum("ij,ij->i", across, seen) / along
    met = np.where(np.abs(met - seen[:, 2]) < 0.01, met, seen[:, 2])
    front = np.flatnonzero(seen[:, 2] < depth[v, u] + 0.02)
    far = np.linalg.norm(exact - np.stack([u, v], 1), axis=1)
    # The last that is written stays: the nearest to the ray.
    front = front[np.argsort(-far[front])]
    depth[v[front], u[front]] = met[front]
    return depth.astype(np.float32)
