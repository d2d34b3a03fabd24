"""Synthetic cells whose truth is known: numpy ray casting, a two-jointed arm, cameras."""

from __future__ import annotations

import numpy as np

from armsight.devices.data import DepthNoise, JointState, RgbdCameraInfo, RgbdFrame
from armsight.devices.history import JointHistory
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.robots.kinematics import link_poses
from armsight.robots.robot import Capsules, JointLimits, Robot, Spheres

NO_NOISE = DepthNoise(0.0, 0.0, 0.0)
FLYING, LOST = 0.45, 0.25
"""Shares of the pixels at a border that report a mixture of both sides, or nothing."""


def two_link_arm() -> Robot:
    """A shoulder that turns about z on a column, and an elbow about y; capsules only."""
    capsules = Capsules(
        np.array([0, 1, 2]),
        np.array([[0.0, 0, 0.05], [0, 0, 0], [0.0, 0, 0]]),
        np.array([[0.0, 0, 0.2], [0.4, 0, 0], [0.35, 0, 0]]),
        np.array([0.07, 0.06, 0.05]),
    )
    axis_points = [c.start + t * (c.end - c.start) for c in [capsules] for t in (0.0, 0.5, 1.0)]
    spheres = Spheres(
        np.tile(capsules.link, 3), np.concatenate(axis_points), np.tile(capsules.radius, 3) + 0.06
    )
    n = 2
    return Robot(
        name="two_link",
        joint_names=("shoulder", "elbow"),
        link_names=("base", "upper", "fore"),
        T_link_joint=np.stack(
            [make_pose(translation=[0, 0, 0.3]), make_pose(translation=[0.4, 0, 0])]
        ),
        axis=np.array([[0.0, 0, 1], [0, 1, 0]]),
        T_last_flange=make_pose(translation=[0.4, 0, 0]),
        limits=JointLimits(*(np.full(n, v) for v in (-3.0, 3.0, 3.0, 10.0, 100.0))),
        spheres=spheres,
        capsules=capsules,
        self_pairs=np.zeros((0, 2), np.int64),
        meshes=(),
        link_mass=np.ones(n + 1),
        link_com=np.zeros((n + 1, 3)),
        link_inertia=np.tile(np.eye(3) * 0.01, (n + 1, 1, 1)),
        home=np.zeros(n),
        reach=0.8,
    )


def arm_solids(robot: Robot, q: np.ndarray) -> list[Solid]:
    """The arm's capsules as cylinders and spheres in base."""
    poses = link_poses(robot, np.asarray(q, float))
    out = []
    for i, (link, a, b, r) in enumerate(
        zip(robot.capsules.link, robot.capsules.start, robot.capsules.end, robot.capsules.radius)
    ):
        T = poses[link]
        a, b = T[:3, :3] @ a + T[:3, 3], T[:3, :3] @ b + T[:3, 3]
        z = (b - a) / np.linalg.norm(b - a)
        x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.9 else [0, 1.0, 0])
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        length = float(np.linalg.norm(b - a))
        out.append(Solid(f"arm{i}", "cylinder", (r, length, 0), make_pose(R, 0.5 * (a + b))))
        out += [
            Solid(f"arm{i}{e}", "sphere", (r, 0, 0), make_pose(translation=p))
            for e, p in (("a", a), ("b", b))
        ]
    return out


def box(name: str, center: tuple, size: tuple) -> Solid:
    return Solid(name, "box", size, make_pose(translation=center))


def sphere(name: str, center: tuple, radius: float) -> Solid:
    return Solid(name, "sphere", (radius, 0, 0), make_pose(translation=center))


def camera_info(
    name: str = "cam",
    position: tuple = (1.2, 0.0, 1.2),
    target: tuple = (0.0, 0.0, 0.2),
    size: tuple = (128, 106),
    fov: tuple = (1.2217, 1.0472),
    noise: DepthNoise = NO_NOISE,
    distortion: tuple = (0.0, 0.0, 0.0, 0.0, 0.0),
    mounted_on: str = "base",
    T_mount_camera: np.ndarray | None = None,
    rate: float = 30.0,
) -> RgbdCameraInfo:
    up = (
        (0, 0, 1)
        if abs(position[0] - target[0]) + abs(position[1] - target[1]) > 1e-6
        else (1, 0, 0)
    )
    lens = PinholeCamera.from_fov(*size, *fov)
    lens = PinholeCamera(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy, distortion)
    T = look_at(position, target, up) if T_mount_camera is None else T_mount_camera
    return RgbdCameraInfo(
        name, "kinect_v2", lens, None, np.eye(4), mounted_on, T, rate, 0.0, (0.3, 4.5), noise
    )


def ray_cast(lens: PinholeCamera, T_base_camera: np.ndarray, solids: list[Solid]) -> np.ndarray:
    """(h, w) float32 depth along the optical axis; NaN where no solid is hit."""
    rays = np.concatenate([lens.rays, np.ones((lens.height, lens.width, 1))], -1).reshape(-1, 3)
    best = np.full(len(rays), np.inf)
    for solid in solids:
        T = inverse(solid.T_frame_solid) @ T_base_camera
        best = np.minimum(best, _hit(solid, T[:3, 3], rays @ T[:3, :3].T))
    best[~np.isfinite(best)] = np.nan
    return best.reshape(lens.height, lens.width).astype(np.float32)


def _hit(solid: Solid, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """First positive ray parameter (= depth, as rays have z = 1) in the solid's own frame."""
    with np.errstate(all="ignore"):
        if solid.kind == "box":
            h = 0.5 * np.asarray(solid.size)
            t0, t1 = (-h - o) / d, (h - o) / d
            near, far = np.minimum(t0, t1).max(axis=1), np.maximum(t0, t1).min(axis=1)
            return np.where((near <= far) & (near > 0), near, np.inf)
        if solid.kind == "sphere":
            return _quadratic((d**2).sum(1), 2 * d @ o, o @ o - solid.size[0] ** 2)[0]
        r, h = solid.size[0], 0.5 * solid.size[1]
        a = (d[:, :2] ** 2).sum(1)
        side, _ = _quadratic(a, 2 * d[:, :2] @ o[:2], o[:2] @ o[:2] - r**2)
        side = np.where(np.abs(o[2] + side * d[:, 2]) <= h, side, np.inf)
        best = side
        for z in (-h, h):
            t = (z - o[2]) / d[:, 2]
            p = o[:2] + t[:, None] * d[:, :2]
            best = np.minimum(best, np.where((t > 0) & ((p**2).sum(1) <= r**2), t, np.inf))
        return best


def _quadratic(a, b, c):
    disc = b * b - 4 * a * c
    root = np.sqrt(np.maximum(disc, 0))
    t0, t1 = (-b - root) / (2 * a), (-b + root) / (2 * a)
    bad = (disc < 0) | (t0 <= 0)
    return np.where(bad, np.inf, t0), np.where(bad, np.inf, t1)


def frame(
    info: RgbdCameraInfo, stamp: float, depth: np.ndarray, sequence: int = 0, delay: float = 0.0
) -> RgbdFrame:
    return RgbdFrame(info.name, sequence, stamp, stamp + delay, depth)


def add_noise(
    depth: np.ndarray, noise: DepthNoise, rng: np.random.Generator, holes: float = 0.0
) -> np.ndarray:
    out = depth + rng.standard_normal(depth.shape) * noise.sigma(depth)
    out[rng.random(depth.shape) < holes] = np.nan
    return out.astype(np.float32)


def with_borders(depth: np.ndarray, noise: DepthNoise, rng: np.random.Generator) -> np.ndarray:
    """A noisy depth image of a time-of-flight camera, with what comes of pixels beside a jump."""
    other = depth.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            beside = np.roll(depth, step, axis)
            other = np.where(np.abs(beside - depth) > 0.05, beside, other)
    border = other != depth
    share = rng.random(depth.shape)
    flying = border & (rng.random(depth.shape) < FLYING)
    out = np.where(flying, share * depth + (1.0 - share) * other, depth)
    out[border & (rng.random(depth.shape) < LOST)] = np.nan
    return add_noise(out, noise, rng)


def resting(q: np.ndarray, until: float = 10.0, step: float = 0.01) -> JointHistory:
    """A history of an arm that does not move."""
    history = JointHistory(seconds=until + 1)
    q = np.asarray(q, float)
    for k in range(int(until / step) + 1):
        history.add(JointState(k * step, q, np.zeros_like(q)))
    return history
