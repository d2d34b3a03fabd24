"""T2's own map, kept as the baseline: an octomap of 5 cm voxels, by ray casting."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import octomap

from armsight.arrays import Bytes, Points, Pose, Vector3
from armsight.geometry.pose import transform
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN

from .clouds import within_sphere
from .merged_clouds import CloudMerger


class OctomapBaseline:
    """OctoMap (Hornung et al. 2013) as T2 uses it, through octomap-python.

    Args:
        voxel: edge of a voxel [m]; T2 takes 5 cm.
        crop: points farther than this from the base are dropped [m]; T2 takes 1.5 m.
    """

    def __init__(self, voxel: float = 0.05, crop: float = 1.5) -> None:
        self.voxel = voxel
        self._crop = crop
        self._tree = octomap.OcTree(voxel)
        self._merger: CloudMerger | None = None

    def insert(self, points_camera: Points, T_base_camera: Pose) -> None:
        """Take in one camera's cloud as it is, but for the crop.

        Args:
            points_camera: (n, 3) in the camera frame [m]; those not finite are left out.
            T_base_camera: the camera in ``base``.
        """
        p = np.asarray(points_camera, float).reshape(-1, 3)
        p = transform(T_base_camera, p[np.isfinite(p).all(axis=1)])
        self._cast(p[within_sphere(p, np.zeros(3), self._crop)], T_base_camera)

    def insert_merged(self, clouds: Sequence[Points], T_base_camera: Sequence[Pose]) -> None:
        """Take in the clouds of all cameras as T2 does: cleaned, merged and finely aligned.

        Args:
            clouds: (n, 3) in each camera's frame [m], always of the same cameras.
            T_base_camera: the cameras in ``base`` by their calibration.
        """
        if self._merger is None:
            self._merger = CloudMerger(len(clouds), self._crop, self.voxel)
        for cloud, T, correction in zip(
            self._merger.merge(clouds, T_base_camera), T_base_camera, self._merger.corrections
        ):
            self._cast(cloud, correction @ T)

    def _cast(self, points: Points, T_base_camera: Pose) -> None:
        """Rays from a camera to points in ``base``."""
        if len(points):
            self._tree.insertPointCloud(
                np.ascontiguousarray(points, np.float64),
                np.ascontiguousarray(T_base_camera[:3, 3], np.float64),
            )

    def state(self, points: Points) -> Bytes:
        """(n,) UNKNOWN, FREE or OCCUPIED of the voxel that holds each of (n, 3) points [m]."""
        labels = self._tree.getLabels(np.ascontiguousarray(points, np.float64))
        out = np.full(len(labels), UNKNOWN, np.uint8)
        out[labels == 0] = FREE
        out[labels == 1] = OCCUPIED
        return out

    def occupied(self) -> tuple[Points, np.ndarray]:
        """(n, 3) centres of the occupied leaves [m] and their (n,) edges [m]."""
        centers, edges = [], []
        for leaf in self._tree.begin_leafs():
            if self._tree.isNodeOccupied(leaf):
                centers.append(np.asarray(leaf.getCoordinate()))
                edges.append(leaf.getSize())
        return np.array(centers).reshape(-1, 3), np.array(edges)

    def clear(self, origin: Vector3 | None = None) -> None:
        """Forget everything."""
        self._tree.clear()

    def write(self, path: Path) -> None:
        """Write a ``.bt`` file by OctoMap itself."""
        self._tree.writeBinary(str(path).encode())
