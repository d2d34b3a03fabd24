"""What colour pictures of a moving arm show, ready to be compared with poses of it.

The median of the pictures is the room; what differs from it moved: the arm, people, their shadows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from armsight.arrays import (
    ColorImage,
    Floats,
    Floats32,
    Ints,
    JointVector,
    Points,
    Poses,
    Vector3,
)
from armsight.geometry.camera import PinholeCamera
from armsight.recognition.own_arm.answer import ColorView
from armsight.recognition.own_arm.arm_errors import TYPICAL, ArmErrors
from armsight.recognition.own_arm.color_kernels import silhouette_agreement
from armsight.recognition.own_arm.search import need_views
from armsight.recognition.own_arm.surface import SPACING, ArmSurface

Masks = NDArray[np.bool_]


@dataclass(frozen=True)
class ColorOptions:
    """How the registration works.

    Attributes:
        shift, turn: how far an old pose may be off at the arm [m] and in direction [rad].
        starts: poses that are tried about an old one; followed: of these, to the end.
        width: of the pictures that are worked on [px].
        cell: edge of the cells in which what moved is compared, the coarse and the fine ones [px].
        moved: least difference from the median picture, grey levels.
        edge: least strength of an edge, grey levels.
        reaches: how far edges are looked for, one an iteration [px].
        arm: how far the arm is from what it says.
        middle: standard deviation of the principal point, and of what light does to all edges
            alike [px]; focal: of the focal length, share.
        least_score, least_seen, most_apart, most_sigma: what an answer must reach to be believed:
            share of what moved that it explains, share of the outline that lies on edges,
            disagreement of the two halves of the views [m], standard deviation [m].
    """

    shift: float = 0.16
    turn: float = 0.14
    starts: int = 2500
    followed: int = 4
    width: int = 640
    cell: tuple[int, int] = (8, 4)
    moved: float = 14.0
    edge: float = 24.0
    reaches: tuple[int, ...] = (16, 14, 12, 10, 8, 7, 6, 5, 4, 4, 3, 3, 3)
    arm: ArmErrors = TYPICAL
    middle: float = 0.3
    focal: float = 0.001
    least_score: float = 0.3
    least_seen: float = 0.75
    most_apart: float = 0.03
    most_sigma: float = 0.015


@dataclass(frozen=True)
class Patches:
    """What moved, in cells.

    Attributes:
        cells: (f, h, w) number of the patch, 0 for none. areas: (f, p) cells of each that are no
            shadow.
        lens: of the cells: fx, fy, cx, cy.
    """

    cells: Ints
    areas: Ints
    lens: Floats


@dataclass
class ColorScene:
    """Colour views of the arm by one standing camera, ready to be compared with poses of it.

    Attributes:
        surface: of the arm. options: how.
        lens: straight, of the pictures that are worked on.
        images: (f, h, w, 4) red, green, blue, and how far it differs from the median picture.
        coarse, fine: what moved.
        joints: of each view.
        corners: of each, the arm's triangles in ``base``.
        points: (f, m, 3) of the arm's surface in ``base``.
        pivot: (3,) the middle of the arm in ``base``.
    """

    surface: ArmSurface
    options: ColorOptions
    lens: PinholeCamera
    images: Floats32
    coarse: Patches
    fine: Patches
    joints: list[JointVector]
    corners: list[Points]
    points: Points
    pivot: Vector3 = field(init=False)

    def __post_init__(self) -> None:
        self.pivot = self.points.reshape(-1, 3).mean(axis=0)

    def agreement(self, poses: Poses, fine: bool, points: int) -> Floats:
        """(k,) how well (k, 4, 4) poses explain what moved, by about so many points a view."""
        patches = self.fine if fine else self.coarse
        step = max(self.points.shape[1] // points, 1)
        spacing = SPACING * float(np.sqrt(step))
        some = np.ascontiguousarray(self.points[:, ::step], np.float64)
        return silhouette_agreement(
            np.ascontiguousarray(poses), some, patches.cells, patches.areas, patches.lens, spacing
        )


def color_scene(
    surface: ArmSurface,
    lens: PinholeCamera,
    views: Sequence[ColorView],
    options: ColorOptions | None = None,
) -> ColorScene:
    """Rectify the pictures and see what moved in them.

    Args:
        surface: of the arm.
        lens: of the pictures.
        views: of one standing camera, the arm in different poses.
        options: how.

    Raises:
        ValueError: there are fewer than three views.
    """
    need_views(views, "colour views")
    o = options or ColorOptions()
    straight = PinholeCamera(lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy)
    small = straight.scaled(o.width / lens.width)
    colors = np.stack([_rectified(v.color, lens, small) for v in views])
    median = np.median(colors, axis=0).astype(np.float32)
    moved = np.abs(colors - median).max(axis=-1)
    images = np.concatenate([colors, np.minimum(2.0 * moved, 255.0)[..., None]], axis=-1)
    noise = 1.48 * float(np.median(moved))
    mask = moved > max(o.moved, 5.0 * noise)
    solid = mask & ~_shadowed(colors, median)
    coarse, fine = (_patches(mask, solid, small, cell) for cell in o.cell)
    posed = np.stack([surface.posed_points(v.joints)[0] for v in views])
    corners = [surface.posed(v.joints) for v in views]
    images = np.ascontiguousarray(images, np.float32)
    joints = [v.joints for v in views]
    return ColorScene(surface, o, small, images, coarse, fine, joints, corners, posed)


def _rectified(color: ColorImage, lens: PinholeCamera, small: PinholeCamera) -> Floats32:
    """(h, w, 3) the picture through a straight lens of the working size."""
    K, distortion = lens.K, np.array(lens.distortion)
    picture = color if lens.is_ideal else cv2.undistort(color, K, distortion, None, K)
    size = (small.width, small.height)
    how = cv2.INTER_AREA if small.width < lens.width else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, size, interpolation=how), np.float32)


def _shadowed(colors: Floats32, median: Floats32) -> Masks:
    """(f, h, w) where a picture is as the median one, only darker: an arm's shadow, most likely."""
    ratio = (colors + 4.0) / (median + 4.0)
    middle = ratio.mean(axis=-1)
    return np.asarray((np.ptp(ratio, axis=-1) < 0.08) & (middle < 0.95) & (middle > 0.35))


def _patches(mask: Masks, solid: Masks, lens: PinholeCamera, cell: int) -> Patches:
    """What moved, in cells of so many pixels; patches of a cell or two are noise.

    Shadows may be the arm or not: their cells need not be explained, so areas are of the rest.
    """
    h, w = -(-lens.height // cell), -(-lens.width // cell)
    cells = np.zeros((len(mask), h, w), np.int64)
    tables: list[Ints] = []
    for k, moved in enumerate(mask):
        padded = np.zeros((h * cell, w * cell), np.float32)
        padded[: lens.height, : lens.width] = moved
        share = padded.reshape(h, cell, w, cell).mean(axis=(1, 3))
        count, label = cv2.connectedComponents((share > 0.35).astype(np.uint8))
        padded[: lens.height, : lens.width] = solid[k]
        asked = padded.reshape(h, cell, w, cell).mean(axis=(1, 3)) > 0.35
        area = np.bincount(label[asked], minlength=count).astype(np.int64)
        small = np.flatnonzero(area < 3)
        label[np.isin(label, small)] = 0
        area[small] = 0
        cells[k] = label
        tables.append(area)
    areas = np.zeros((len(mask), max(len(t) for t in tables)), np.int64)
    for k, table in enumerate(tables):
        areas[k, : len(table)] = table
    middle = (cell - 1) / 2.0
    straight = np.array(
        [lens.fx / cell, lens.fy / cell, (lens.cx - middle) / cell, (lens.cy - middle) / cell]
    )
    return Patches(cells, areas, straight)
