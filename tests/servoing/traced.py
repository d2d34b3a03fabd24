"""Pictures of balls by brute force: every pixel's ray against every sphere, many rays a pixel."""

from __future__ import annotations

import numpy as np

from armsight.devices.data import (
    DepthNoise,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
)
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import inverse, make_pose
from armsight.motion.perception import PosedFrame, PosedPair

LENS = PinholeCamera(480, 270, 265.0, 265.0, 238.0, 137.0, (0.05, -0.07, 0.001, 0.0005, 0.01))
DEPTH = PinholeCamera(512, 424, 365.0, 365.0, 257.0, 209.0)
WRIST = PinholeCamera(720, 480, 869.0, 869.0, 361.0, 238.0, (-0.12, 0.08, 0.0, 0.0, 0.0))
LAMP = np.array([0.2, -0.9, -0.4])
GREY = np.array([120.0, 122.0, 118.0])


def cast(lens, T_world_lens, balls, samples=4, gray=GREY, hidden=None):
    """Colour (h, w, 3) and depth (h, w) of spheres (center, radius, rgb), shaded from above.

    ``hidden``: (u0, v0, u1, v1) of the picture that something grey before everything covers.
    """
    h, w = lens.height, lens.width
    image = np.tile(gray, (h, w, 1)).astype(float)
    depth = np.full((h, w), np.nan, np.float32)
    T = inverse(T_world_lens)
    for center, radius, color in balls:
        c = T[:3, :3] @ np.asarray(center, float) + T[:3, 3]
        middle = lens.project(c[None])[0]
        reach = lens.fx * radius / c[2] * 1.3 + 6
        low = np.maximum(np.floor(middle - reach), 0).astype(int)
        high = np.minimum(np.ceil(middle + reach), [w, h]).astype(int)
        if (high <= low).any():
            continue
        v, u = np.mgrid[low[1] : high[1], low[0] : high[0]].astype(float)
        sum_, cover = np.zeros((*u.shape, 3)), np.zeros(u.shape)
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        for du in offsets:
            for dv in offsets:
                rays = lens.normalise(np.stack([u + du, v + dv], -1).reshape(-1, 2))
                rays = np.column_stack([rays, np.ones(len(rays))])
                a, b = (rays**2).sum(1), rays @ c
                inside = b * b - a * (c @ c - radius**2)
                hit = inside > 0
                t = (b - np.sqrt(np.maximum(inside, 0))) / a
                normal = (rays * t[:, None] - c) / radius
                up = normal @ LAMP
                light = (0.42 + 0.5 * np.clip(up, -0.6, 1.0))[:, None]
                sum_ += (np.asarray(color) * light * hit[:, None]).reshape(*u.shape, 3)
                cover += hit.reshape(u.shape)
        share = (cover / samples**2)[..., None]
        part = image[low[1] : high[1], low[0] : high[0]]
        part[:] = part * (1 - share) + sum_ / samples**2
        rays = lens.normalise(np.stack([u, v], -1).reshape(-1, 2))
        rays = np.column_stack([rays, np.ones(len(rays))])
        a, b = (rays**2).sum(1), rays @ c
        inside = b * b - a * (c @ c - radius**2)
        z = np.where(inside > 0, (b - np.sqrt(np.maximum(inside, 0))) / a, np.nan)
        window = depth[low[1] : high[1], low[0] : high[0]]
        window[:] = np.fmin(window, z.reshape(u.shape).astype(np.float32))
    if hidden is not None:
        u0, v0, u1, v1 = hidden
        image[v0:v1, u0:u1] = (60, 70, 60)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), depth


def frame(balls, T_base_camera, rng=None, wall=None):
    """What a depth camera with colour sees of spheres; ``wall``: depth of a plane behind [m]."""
    T_depth_color = make_pose(None, (0.052, 0.0, 0.0))
    color, _ = cast(LENS, T_base_camera @ T_depth_color, balls)
    _, depth = cast(DEPTH, T_base_camera, balls, samples=1)
    if wall is not None:
        depth[np.isnan(depth)] = wall
    if rng is not None:
        depth = depth + rng.normal(0, 0.002, depth.shape).astype(np.float32)
        color = np.clip(color + rng.normal(0, 2, color.shape), 0, 255).astype(np.uint8)
    info = RgbdCameraInfo(
        "cam", "traced", DEPTH, LENS, T_depth_color, "base", T_base_camera, 15.0, 0.04,
        (0.5, 4.5), DepthNoise(0.002, 0.0, 0.0),
    )  # fmt: skip
    return PosedFrame(RgbdFrame("cam", 0, 1.0, 1.04, depth, color), info, None, T_base_camera, LENS)


def pair(balls, T_base_camera, rng=None, hidden=None):
    """What a stereo pair sees of spheres."""
    T = make_pose(None, (0.06, 0.0, 0.0))
    left, _ = cast(WRIST, T_base_camera, balls, hidden=hidden)
    right, _ = cast(WRIST, T_base_camera @ T, balls, hidden=hidden)
    if rng is not None:
        left, right = (
            np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
            for image in (left, right)
        )
    info = StereoInfo("wrist", "traced", WRIST, WRIST, T, "flange", np.eye(4), 10.0, 0.05)
    return PosedPair(StereoFrame("wrist", 0, 1.0, 1.05, left, right), info, None, T_base_camera)
