"""Pictures of flat prints by brute force: every pixel's rays against the print's plane."""

from __future__ import annotations

import numpy as np

from armsight.devices.data import (
    DepthNoise,
    RgbdCameraInfo,
    RgbdFrame,
    StereoFrame,
    StereoInfo,
)
from armsight.geometry.pose import inverse, make_pose
from armsight.motion.perception import PosedFrame, PosedPair
from armsight.simulation.targets import (
    BLACK,
    BLUE,
    FACE_RADIUS,
    MOUTH,
    PALM_RADIUS,
    PINK,
    RED,
    RINGS,
    WHITE,
    YELLOW,
)

from .traced import DEPTH, GREY, LENS, WRIST

HD = type(LENS)(960, 540, 685.0, 685.0, 478.0, 272.0, (0.05, -0.07, 0.001, 0.0005, 0.01))


def bullseye(x, y):
    """Rings on a plate of 16 cm: colour (k, 3) 0..1, and what is covered at all (k,)."""
    r = np.hypot(x, y)
    color = np.tile(WHITE, (len(x), 1)).astype(float)
    for i, radius in enumerate(RINGS):
        color[r < radius] = RED if i % 2 == 0 else WHITE
    return color, (abs(x) < 0.08) & (abs(y) < 0.08)


def smiley(x, y):
    """The face, in the mouth's frame: y up."""
    x, y = x + MOUTH[0], y + MOUTH[1]
    color = np.tile((0.62, 0.52, 0.40), (len(x), 1)).astype(float)
    color[np.hypot(x, y) < FACE_RADIUS] = YELLOW
    for side in (-1, 1):
        color[np.hypot(x - side * 0.033, y - 0.030) < 0.011] = BLACK
    # The arc's middle lies in MOUTH, its centre 62 mm above.
    angle = np.arctan2(x, MOUTH[1] + 0.062 - y)
    away = np.hypot(x, MOUTH[1] + 0.062 - y)
    color[(abs(away - 0.062) < 0.006) & (abs(angle) < np.deg2rad(64.0))] = BLACK
    return color, (abs(x) < 0.12) & (abs(y) < 0.12)


def palm(x, y):
    """A pink glove's outline with the disc on it, fingers along x."""
    color = np.tile(PINK, (len(x), 1)).astype(float)
    color[np.hypot(x, y) < PALM_RADIUS] = BLUE
    covered = (abs(x) < 0.0475) & (abs(y) < 0.0425)
    for offset in (-0.033, -0.011, 0.011, 0.033):
        covered |= (x > 0.04) & (x < 0.123) & (abs(y - offset) < 0.009)
    covered |= (x < -0.04) & (x > -0.26) & (abs(y) < 0.031)
    return color, covered


def cast(lens, T_world_lens, T_world_print, paint, samples=3, hidden=()):
    """Colour (h, w, 3) and depth (h, w) of a print; ``hidden``: boxes (u0, v0, u1, v1, rgb)."""
    T = inverse(T_world_lens) @ T_world_print
    h, w = lens.height, lens.width
    image, depth = np.tile(GREY, (h, w, 1)), np.full((h, w), np.nan, np.float32)

    def seen(u, v):
        rays = lens.normalise(np.stack([u, v], -1).reshape(-1, 2))
        rays = np.column_stack([rays, np.ones(len(rays))])
        along = (T[:3, 2] @ T[:3, 3]) / (rays @ T[:3, 2])
        at = (rays * along[:, None] - T[:3, 3]) @ T[:3, :3]
        color, covered = paint(at[:, 0], at[:, 1])
        covered = covered & (along > 0)
        return np.where(covered[:, None], 230.0 * color, GREY), covered, along

    v, u = np.mgrid[0:h, 0:w].astype(float)
    _, covered, along = seen(u, v)
    depth.reshape(-1)[covered] = along[covered]
    rows, columns = np.nonzero(covered.reshape(h, w))
    if len(rows):  # nothing of it is more than a pixel outside of what the pixels' middles see
        window = tuple(slice(max(int(k.min()) - 3, 0), int(k.max()) + 4) for k in (rows, columns))
        u, v = u[window], v[window]
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        total = sum(seen(u + du, v + dv)[0] for du in offsets for dv in offsets)
        image[window] = (total / samples**2).reshape(*u.shape, 3)
    for u0, v0, u1, v1, color in hidden:
        image[v0:v1, u0:u1] = color
    return np.clip(np.rint(image), 0, 255).astype(np.uint8), depth


def frame(T_base_print, paint, T_base_camera, rng, wall=3.2):
    """What a depth camera with colour sees of a print before a wall."""
    T_depth_color = make_pose(None, (0.052, 0.0, 0.0))
    color, _ = cast(HD, T_base_camera @ T_depth_color, T_base_print, paint)
    _, depth = cast(DEPTH, T_base_camera, T_base_print, paint, samples=1)
    depth[np.isnan(depth)] = wall
    depth = depth + rng.normal(0, 0.002, depth.shape).astype(np.float32)
    color = np.clip(color + rng.normal(0, 2, color.shape), 0, 255).astype(np.uint8)
    info = RgbdCameraInfo(
        "cam", "traced", DEPTH, HD, T_depth_color, "base", T_base_camera, 15.0, 0.04,
        (0.5, 4.5), DepthNoise(0.002, 0.0, 0.0),
    )  # fmt: skip
    return PosedFrame(RgbdFrame("cam", 0, 1.0, 1.04, depth, color), info, None, T_base_camera, HD)


def pair(T_base_print, paint, T_base_camera, rng, hidden=()):
    """What a stereo pair sees of a print."""
    T = make_pose(None, (0.06, 0.0, 0.0))
    left, right = (
        np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
        for image in (
            cast(WRIST, T_base_camera, T_base_print, paint, hidden=hidden)[0],
            cast(WRIST, T_base_camera @ T, T_base_print, paint, hidden=hidden)[0],
        )
    )
    info = StereoInfo("wrist", "traced", WRIST, WRIST, T, "flange", np.eye(4), 10.0, 0.05)
    return PosedPair(StereoFrame("wrist", 0, 1.0, 1.05, left, right), info, None, T_base_camera)
