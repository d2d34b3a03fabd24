"""Where the other links of an arm come close: overshoot there would take them for touching.

Links two joints apart may pass each other at a centimetre in most configurations, as a UR's forearm
and second wrist do. Spheres that bulge into that gap from both sides overlap although the links are
free. So a fit is told which places are nearer to another link than to the link itself, and how
often.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from armsight.arrays import Floats, JointPath, Points, Poses
from armsight.geometry.pose import inverse
from armsight.robots.fit_kernels import nearer
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
        count, free = nearer(
            points, own + ROOM, skin, T_other_link, field.origin, field.voxel, field.distance
        )
        share += count / max(free, 1)
    return np.minimum(share, 1.0)
