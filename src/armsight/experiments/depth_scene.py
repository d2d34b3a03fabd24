"""Pictures of simple solids by perfect depth cameras, by ray casting: nothing moves, no noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.arrays import DepthImage, Pose, Vector3
from armsight.experiments.depth_scene_kernels import BOX, CYLINDER, cast
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.geometry.shapes import Solid


def look_at(eye: Vector3, target: Vector3) -> Pose:
    """Optical pose (z ahead, x right, y down) of a camera at ``eye`` that looks at ``target``."""
    ahead = np.asarray(target, float) - eye
    ahead /= np.linalg.norm(ahead)
    up = np.array([0.0, 0.0, 1.0]) if abs(ahead[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    return make_pose(np.stack([right, np.cross(ahead, right), ahead], axis=1), eye)


def depth_image(solids: Sequence[Solid], lens: PinholeCamera, T_base_camera: Pose) -> DepthImage:
    """(h, w) float32 depth along the optical axis [m]; NaN where nothing is."""
    kinds = np.array([BOX if s.kind == "box" else CYLINDER for s in solids], np.int64)
    sizes = np.array([s.size for s in solids], float).reshape(-1, 3)
    poses = [inverse(s.T_frame_solid) @ T_base_camera for s in solids]
    T = np.array(poses, float).reshape(-1, 4, 4)
    rays = np.concatenate([lens.rays, np.ones((lens.height, lens.width, 1))], axis=2)
    out = np.empty((lens.height, lens.width), np.float32)
    cast(kinds, sizes, T, rays, out)
    return out
