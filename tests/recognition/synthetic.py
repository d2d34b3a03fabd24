"""A packed set without a renderer: a fan of coloured lines is the robot."""

import cv2
import numpy as np

from armsight.recognition.networks.architecture import JOINTS
from armsight.recognition.training.packed_set import MOST_JOINTS, PackedSet

COLOURS = {"ur3": (220, 60, 60), "ur5": (60, 220, 60), "ur10": (60, 60, 220),
           "iiwa": (230, 140, 30), "panda": (240, 240, 240)}  # fmt: skip


def synthetic_set(
    count: int,
    width: int = 64,
    height: int = 53,
    robots: tuple[str, ...] = ("ur3", "ur5"),
    seed: int = 0,
) -> PackedSet:
    rng = np.random.default_rng(seed)
    focal = 0.86 * width
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    images = rng.integers(0, 90, (count, height, width, 3), dtype=np.uint8)
    masks = np.zeros((count, height, width), bool)
    joints = np.full((count, MOST_JOINTS, 3), np.nan, np.float32)
    base = np.zeros((count, 3), np.float32)
    robot = np.arange(count) % len(robots)
    for i in range(count):
        name = robots[robot[i]]
        place = np.array([rng.uniform(-0.3, 0.3), 0.3, rng.uniform(1.2, 2.5)])
        base[i] = place
        points = [place]
        for _ in range(JOINTS[name]):
            place = place + np.array([rng.uniform(-0.12, 0.12), -0.1, rng.uniform(-0.05, 0.05)])
            points.append(place)
        joints[i, : JOINTS[name]] = points[1:]
        px = np.array([K @ p / p[2] for p in points])[:, :2]
        drawn = np.zeros((height, width), np.uint8)
        cv2.polylines(drawn, [np.round(px).astype(np.int32)], False, 255, max(2, width // 20))
        masks[i] = drawn > 0
        images[i][masks[i]] = COLOURS[name]
    part = np.array([0, 0, 0, 0, 0, 0, 0, 1, 2, 2], np.uint8)[np.arange(count) // len(robots) % 10]
    return PackedSet(
        images,
        np.packbits(masks.reshape(count, -1), axis=1),
        joints,
        base,
        np.repeat(K[None].astype(np.float32), count, axis=0),
        robot.astype(np.uint8),
        np.arange(count, dtype=np.int32),
        np.zeros(count, np.int32),
        part,
        part,
        robots,
        {"kind": "synthetic", "renderer": "lines", "seed": str(seed)},
    )
