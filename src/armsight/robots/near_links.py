"""Where the other links of an arm come close: overshoot there would take them for touching.

Links two joints apart may pass each other at a centimetre in most configurations, as a UR's forearm
and second wrist do. Spheres that bulge into that gap from both sides overlap although the links are
free. So a fit is told which places are nearer to another link than to the link itself, and how
often.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy import ndimage

from armsight.arrays import Floats, JointPath, Points, Poses
from armsight.geometry.pose import inverse
from armsight.robots.kernels import chain_poses
from armsight.robots.solids import VoxelSolid

ROOM = 0.003
"""[m] that the spheres of two links should keep between them where the links are free: planners
keep a little more than contact."""


@dataclass(frozen=True)
class LinkDistanceField:
    """How far it is to a body, around it.

    Attributes:
        origin: (3,) lower corner of the grid [m].
        voxel: edge [m].
        distance: (nx, ny, nz) from each voxel's centre to the body [m]; 0 inside it.
    """

    origin: Floats
    voxel: float
    distance: Floats


def distance_field(solid: VoxelSolid, far: float) -> LinkDistanceField:
    """The field of a body up to ``far`` [m] around it."""
    pad = int(np.ceil(far / solid.voxel))
    inside = np.pad(solid.inside, pad)
    # Centres are measured to centres; the body begins half a voxel earlier.
    steps = np.maximum(ndimage.distance_transform_edt(~inside) - 0.5, 0.0)
    distance = (steps * solid.voxel).astype(np.float64)
    return LinkDistanceField(solid.origin - pad * solid.voxel, solid.voxel, distance)


def crowding(
    points: Points,
    own: Floats,
    skin: Points,
    link: int,
    fields: list[LinkDistanceField | None],
    path: JointPath,
    T_link_joint: Poses,
    axis: Points,
) -> Floats:
    """How often another link is nearer to a place than the link that carries the place.

    Args:
        points: (k, 3) places in the link's frame [m].
        own: (k,) their distances to the link [m].
        skin: (s, 3) points on the link's surface in its frame [m].
        link: index of the link in the chain.
        fields: of every link; None for those without a body.
        path: (c, n) configurations [rad] to try.
        T_link_joint: (n, 4, 4) of the chain.
        axis: (n, 3) of its joints.

    Returns:
        (k,) share, 0 to 1, of the configurations in which some link that is no neighbour comes
        within :data:`ROOM` of being nearer. Configurations in which it touches do not count.
    """
    poses = [chain_poses(q, T_link_joint, axis) for q in path]
    share = np.zeros(len(points))
    for other, field in enumerate(fields):
        if field is None or abs(other - link) < 2:
            continue
        T_other_link = np.stack([inverse(T[other]) @ T[link] for T in poses])
        count, free = _nearer(
            points, own + ROOM, skin, T_other_link, field.origin, field.voxel, field.distance
        )
        share += count / max(free, 1)
    return np.minimum(share, 1.0)


@njit(cache=True, nogil=True)
def _nearer(
    points: Points,
    bound: Floats,
    skin: Points,
    T_other_link: Poses,
    origin: Floats,
    voxel: float,
    distance: Floats,
) -> tuple[Floats, int]:
    """In how many free configurations the other link is nearer than a bound, and how many are."""
    count = np.zeros(points.shape[0])
    free = 0
    for c in range(T_other_link.shape[0]):
        T = T_other_link[c]
        touches = False
        for k in range(skin.shape[0]):
            if _look(skin[k], T, origin, voxel, distance) <= 0.0:
                touches = True
                break
        if touches:
            continue
        free += 1
        for k in range(points.shape[0]):
            if _look(points[k], T, origin, voxel, distance) < bound[k]:
                count[k] += 1.0
    return count, free


@njit(cache=True, nogil=True)
def _look(point: Floats, T: Floats, origin: Floats, voxel: float, distance: Floats) -> float:
    """The field at a point that a pose carries into its frame; infinite beyond it."""
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    i = int(np.floor((x - origin[0]) / voxel))
    j = int(np.floor((y - origin[1]) / voxel))
    m = int(np.floor((z - origin[2]) / voxel))
    nx, ny, nz = distance.shape
    if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
        return distance[i, j, m]
    return np.inf
