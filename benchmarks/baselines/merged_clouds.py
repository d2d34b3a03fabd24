"""T2's clouds: cropped, thinned, freed of outliers, merged by calibration, finely aligned by ICP.

T2 maps clouds made this way; ours does not, since its map takes every pixel as evidence and aligns
each camera with what is declared (``alignment.py``). This is what the baseline is fed with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from armsight.arrays import Floats, Points, Pose
from armsight.geometry.pose import transform

from .clouds import icp, statistical_inliers, voxel_centroids, within_sphere

REACH = 0.05
"""Points of two clouds that are farther apart do not belong together [m]."""
PLANE = 8
"""Points that make a piece of surface."""
LEAST_SHARED = 200
"""Points that two clouds must share to be aligned."""
WORSE = 1.5
"""Something moved when shared surfaces lie this many times as far apart as after alignment ..."""
SLACK = 0.003
"""... and this much more [m]."""


def clean(
    points: Points, crop: float = 1.5, voxel: float = 0.02, neighbors: int = 16, ratio: float = 2.0
) -> Points:
    """Crop about the base, drop statistical outliers, keep one centroid a voxel: T2's order.

    Args:
        points: (n, 3) in ``base`` [m]; those not finite are left out.
        crop: farther than this from the base is cut off [m].
        voxel: edge of a voxel [m].
        neighbors: how many are looked at to tell an outlier.
        ratio: standard deviations of their mean distance that are allowed.

    Returns:
        (m, 3) points in ``base`` [m].
    """
    p = np.asarray(points, float).reshape(-1, 3)
    p = p[np.isfinite(p).all(axis=1)]
    p = p[within_sphere(p, np.zeros(3), crop)]
    return voxel_centroids(p[statistical_inliers(p, neighbors, ratio)], voxel)


class CloudMerger:
    """Merges the clouds of several cameras; aligns them once, and again when something moved.

    The first camera's calibration stands; each later one is aligned by ICP with all before it.

    Attributes:
        corrections: one (4, 4) a camera: corrected points in ``base`` from uncorrected ones.
        alignments: how often all cameras have been aligned.
    """

    def __init__(self, cameras: int, crop: float = 1.5, voxel: float = 0.02) -> None:
        self._crop = crop
        self._voxel = voxel
        self.corrections: list[Pose] = [np.eye(4) for _ in range(cameras)]
        self.alignments = 0
        self._apart = np.inf

    def merge(self, clouds: Sequence[Points], T_base_camera: Sequence[Pose]) -> list[Points]:
        """Clean clouds of one instant in ``base``, aligned with each other; one a camera.

        Args:
            clouds: (n, 3) in each camera's frame [m].
            T_base_camera: each camera by its calibration.

        Raises:
            ValueError: there are not as many clouds and poses as cameras.
        """
        if not len(clouds) == len(T_base_camera) == len(self.corrections):
            raise ValueError(
                f"{len(clouds)} clouds and {len(T_base_camera)} poses of "
                f"{len(self.corrections)} cameras"
            )
        cleaned = [
            clean(transform(T, np.asarray(c, float).reshape(-1, 3)), self._crop, self._voxel)
            for c, T in zip(clouds, T_base_camera)
        ]
        placed = self._placed(cleaned)
        apart = _apart(placed)
        if self.alignments == 0 or apart > max(WORSE * self._apart, self._apart + SLACK):
            self._align(cleaned)
            placed = self._placed(cleaned)
            self._apart = _apart(placed)
            self.alignments += 1
        return placed

    def _placed(self, cleaned: Sequence[Points]) -> list[Points]:
        return [transform(T, c) for T, c in zip(self.corrections, cleaned)]

    def _align(self, cleaned: Sequence[Points]) -> None:
        """Each camera's cloud to those before it, if that brings them nearer."""
        merged = self._placed(cleaned)[0] if cleaned else np.empty((0, 3))
        for camera, cloud in enumerate(cleaned[1:], 1):
            start = self.corrections[camera]
            gaps = _gaps(transform(start, cloud), merged)
            if len(gaps) >= LEAST_SHARED:
                found = icp(cloud, merged, start, reach=REACH, voxel=self._voxel).T_target_source
                left = _gaps(transform(found, cloud), merged)
                if len(left) >= LEAST_SHARED and np.median(left) < np.median(gaps):
                    self.corrections[camera] = found
            merged = np.concatenate([merged, transform(self.corrections[camera], cloud)])


def _apart(placed: Sequence[Points]) -> float:
    """The greatest of the cameras' median distances from what those before it saw [m]."""
    gaps = [_gaps(cloud, np.concatenate(placed[:k])) for k, cloud in enumerate(placed) if k]
    return max((float(np.median(g)) for g in gaps if len(g) >= LEAST_SHARED), default=0.0)


def _gaps(cloud: Points, other: Points) -> Floats:
    """(k,) distances [m] of the points within reach of another cloud from its surface there.

    The surface is the plane through the nearest points, so that the spacing of points plays no
    part.
    """
    if len(cloud) == 0 or len(other) < PLANE:
        return np.empty(0)
    tree = cKDTree(other)
    distance, index = (np.asarray(a) for a in tree.query(cloud, PLANE))
    near = distance[:, 0] <= REACH
    patch = other[index[near].astype(np.int64)]
    center = patch.mean(axis=1)
    spread = patch - center[:, None]
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    offset = cloud[near] - center
    return np.asarray(np.abs(np.einsum("ni,ni->n", vectors[:, :, 0], offset)))
