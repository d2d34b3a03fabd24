"""Snapshots made from solids by plain numpy, robots made by hand, and oracles of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid, WorkspaceSnapshot
from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "motion" / "motionbenchmaker"


def shared_motion() -> Path:
    """Folder of the MotionBenchMaker data, or skip the test."""
    if not SHARED.exists():
        pytest.skip("needs ../shared/data/motion/motionbenchmaker beside the repository")
    return SHARED


def box(center: Sequence[float], size: Sequence[float], name: str = "box") -> Solid:
    return Solid(name, "box", tuple(size), make_pose(None, center))


def ball(center: Sequence[float], radius: float, name: str = "ball") -> Solid:
    return Solid(name, "sphere", (radius, 0.0, 0.0), make_pose(None, center))


def make_snapshot(
    solids: Sequence[Solid] = (),
    *,
    lower: Sequence[float] = (-1.2, -1.2, -0.3),
    upper: Sequence[float] = (1.2, 1.2, 1.3),
    voxel: float = 0.02,
    cap: float = 0.3,
    unknown: Sequence[Solid] = (),
    was_there: Sequence[tuple[Solid, float]] = (),
    counts_unknown: bool = True,
    stamp: float = 100.0,
    sequence: int = 1,
) -> WorkspaceSnapshot:
    """A snapshot in which every voxel whose cube may meet a solid is occupied.

    ``was_there`` are solids seen this many seconds ago and gone: they leave danger only.
    """
    shape = tuple(int(np.ceil((b - a) / voxel - 1e-9)) for a, b in zip(lower, upper))
    grid = VoxelGrid(np.asarray(lower, float), voxel, shape)
    state = np.full(shape, FREE, np.uint8)
    last = np.full(shape, -np.inf, np.float32)
    for solid in unknown:
        mark(state, grid, solid, UNKNOWN)
    for solid, age in was_there:
        mark(last, grid, solid, stamp - age)
    for solid in solids:
        mark(state, grid, solid, OCCUPIED)
    solid_voxels = state != FREE if counts_unknown else state == OCCUPIED
    return WorkspaceSnapshot(
        sequence,
        stamp,
        stamp,
        grid,
        state,
        bounded_field(solid_voxels, voxel, cap),
        cap,
        last,
        np.zeros((0, 3), np.float32),
        0.5 * np.sqrt(3.0) * voxel,
        np.zeros(0, bool),
        np.zeros((0, 3), np.float32),
        (),
        (),
        counts_unknown,
    )


def mark(array: np.ndarray, grid: VoxelGrid, solid: Solid, value: float) -> None:
    """Set every voxel whose cube may meet a solid: centre within half a diagonal of it."""
    reach = 0.5 * np.sqrt(3.0) * grid.voxel
    half = {
        "box": 0.5 * np.asarray(solid.size),
        "sphere": np.full(3, solid.size[0]),
        "cylinder": np.array([solid.size[0], solid.size[0], 0.5 * solid.size[1]]),
    }[solid.kind]
    T = solid.T_frame_solid
    extent = np.abs(T[:3, :3]) @ half + reach
    low = np.maximum(grid.index(T[:3, 3] - extent), 0)
    high = np.minimum(grid.index(T[:3, 3] + extent) + 1, grid.shape)
    if (high <= low).any():
        return
    index = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), -1).reshape(-1, 3)
    index = index[solid.distance(grid.center(index)) <= reach]
    array[tuple(index.T)] = value


def bounded_field(solid: np.ndarray, voxel: float, cap: float) -> np.ndarray:
    """Least distance between the cubes of each voxel and of any solid one, capped."""
    if not solid.any():
        return np.full(solid.shape, cap, np.float32)
    near = np.zeros_like(solid)
    padded = np.pad(solid, 1)
    nx, ny, nz = solid.shape
    for i in range(3):
        for j in range(3):
            for k in range(3):
                near |= padded[i : i + nx, j : j + ny, k : k + nz]
    return np.minimum(distance_transform_edt(~near) * voxel, cap).astype(np.float32)


class CubeOracle:
    """Exact distances to the solid cubes of a snapshot by brute force in plain numpy.

    Only cubes with a free neighbour are measured: inner ones are never nearest to a point outside,
    and a point inside is found by its own voxel.
    """

    def __init__(self, snapshot: WorkspaceSnapshot, unknown: bool = True) -> None:
        state = snapshot.state
        self.grid = snapshot.grid
        self.mask = np.pad(state != FREE if unknown else state == OCCUPIED, 1)
        inner = self.mask.copy()
        for axis in range(3):
            for shift in (-1, 1):
                inner &= np.roll(self.mask, shift, axis)
        self.low = self.grid.origin + (np.argwhere(self.mask & ~inner) - 1) * self.grid.voxel

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) distances [m] of (n, 3) points; 0 inside."""
        out = np.full(len(points), np.inf)
        parts = max(1, len(points) * len(self.low) // 500_000)
        for chunk in np.array_split(np.arange(len(points)), parts):
            d2 = np.zeros((len(chunk), len(self.low)))
            for axis in range(3):
                gap = self.low[None, :, axis] - points[chunk, None, axis]
                gap = np.maximum(gap, -gap - self.grid.voxel)
                d2 += np.maximum(gap, 0.0) ** 2
            out[chunk] = np.sqrt(d2.min(axis=1, initial=np.inf))
        own = self.grid.index(points) + 1
        known = ((own >= 0) & (own < self.mask.shape)).all(axis=1)
        out[known] = np.where(self.mask[tuple(own[known].T)], 0.0, out[known])
        return out

    def walls(self, points: np.ndarray) -> np.ndarray:
        """(n,) room [m] between points and the walls of the mapped box."""
        top = self.grid.origin + np.array(self.grid.shape) * self.grid.voxel
        return np.minimum(points - self.grid.origin, top - points).min(axis=1)


def oracle_clearance(robot: Robot, q: np.ndarray, oracle: CubeOracle) -> float:
    """Oracle: least clearance of the moving body from solid cubes, the box and itself."""
    centers, radius, link = oracle_centers(robot, q), robot.spheres.radius, robot.spheres.link
    m = link > 0
    room = np.minimum(oracle.walls(centers[m]), oracle.distance(centers[m]))
    best = (room - radius[m]).min()
    for a, b in robot.self_pairs:
        gap = np.linalg.norm(centers[link == a][:, None] - centers[link == b][None], axis=2)
        gap = gap - radius[link == a][:, None] - radius[link == b][None]
        best = min(best, gap.min(initial=np.inf))
    return float(best)


def oracle_centers(robot: Robot, q: np.ndarray) -> np.ndarray:
    """(m, 3) sphere centres in base: plain numpy with Rodrigues' formula."""
    T = [np.eye(4)]
    for i in range(robot.n):
        a = robot.axis[i] / np.linalg.norm(robot.axis[i])
        K = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        R = np.eye(3) + np.sin(q[i]) * K + (1 - np.cos(q[i])) * K @ K
        T.append(T[-1] @ robot.T_link_joint[i] @ make_pose(R))
    return np.array(
        [T[k][:3, :3] @ c + T[k][:3, 3] for k, c in zip(robot.spheres.link, robot.spheres.center)]
    )


def arm6(sphere: float = 0.05) -> Robot:
    """A made-up 6-axis arm of a UR5's size, so that tests need no file."""
    lengths = [
        ((0.0, 0.0, 0.1), (0, 0, 1), (0.0, 0.0, 0.0)),
        ((0.0, 0.12, 0.0), (0, 1, 0), (0.0, 0.0, 0.0)),
        ((0.0, -0.1, 0.42), (0, 1, 0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.39), (0, 1, 0), (0.3, 0.0, 0.0)),
        ((0.0, 0.09, 0.0), (0, 0, 1), (0.0, 0.0, 0.2)),
        ((0.0, 0.0, 0.09), (0, 1, 0), (0.0, 0.0, 0.0)),
    ]
    T = np.array([from_rpy(rpy, p) for p, _, rpy in lengths])
    axis = np.array([a for _, a, _ in lengths], float)
    links, centers = [0, 1], [(0.0, 0.0, 0.02), (0.0, 0.06, 0.0)]
    for z in np.linspace(0.0, 0.42, 6):
        links.append(2)
        centers.append((0.0, 0.0, z))
    for z in np.linspace(0.06, 0.39, 5):
        links.append(3)
        centers.append((0.0, 0.0, z))
    links += [4, 5, 6, 6]
    centers += [(0.0, 0.05, 0.0), (0.0, 0.0, 0.04), (0.0, 0.03, 0.0), (0.0, 0.09, 0.0)]
    n = 6
    return Robot(
        name="arm6",
        joint_names=tuple(f"joint_{i}" for i in range(n)),
        link_names=tuple(f"link_{i}" for i in range(n + 1)),
        T_link_joint=T,
        axis=axis,
        T_last_flange=make_pose(None, (0.0, 0.09, 0.0)),
        limits=JointLimits(
            np.full(n, -np.pi),
            np.full(n, np.pi),
            np.full(n, np.pi),
            np.full(n, 12.0),
            np.full(n, 120.0),
        ),
        spheres=Spheres(np.array(links), np.array(centers), np.full(len(links), sphere)),
        capsules=Capsules(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)),
        self_pairs=np.array(
            [(0, 3), (0, 4), (0, 5), (0, 6), (1, 4), (1, 5), (1, 6), (2, 5), (2, 6)]
        ),
        meshes=(),
        link_mass=np.ones(n + 1),
        link_com=np.zeros((n + 1, 3)),
        link_inertia=np.tile(np.eye(3) * 0.01, (n + 1, 1, 1)),
        home=np.array([0.0, -0.5, 1.0, -0.5, 0.0, 0.0]),
        reach=0.95,
    )
