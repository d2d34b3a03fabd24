"""One camera's share of the work: from a depth image to evidence about voxels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, Floats32, Ints32, Pose
from armsight.devices.data import RgbdCameraInfo
from armsight.mapping.config import MappingConfig
from armsight.mapping.kernels.image import (
    LEVELS,
    TILE,
    build_pyramid,
    carve,
    collect_hits,
    grade_hits,
    label_valid,
)
from armsight.mapping.lens import Lens
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.snapshot import VoxelGrid
from armsight.mapping.static_geometry import StaticGeometry


@dataclass(frozen=True)
class Evidence:
    """What one frame says; the voxels seen free are written to the caller's array.

    Attributes:
        hits: (m,) int32 flat indices of voxels hit by something undeclared that is not the arm.
        strong: (m,) uint8, 1 where enough pixels hit; count: m.
        returns: share of pixels with a usable return; body: number of pixels that are the arm.
    """

    hits: Ints32
    strong: Bytes
    count: int
    returns: float
    body: int


class CameraStage:
    """Buffers and constants of one camera. Used by one thread at a time."""

    def __init__(
        self,
        info: RgbdCameraInfo,
        grid: VoxelGrid,
        static: StaticGeometry,
        filter_: SelfFilter,
        config: MappingConfig,
    ) -> None:
        self.info = info
        self.lens = Lens(info.depth)
        self._grid = grid
        self._origin = np.asarray(grid.origin, float)
        self._shape = np.asarray(grid.shape, np.int64)
        self._static = static
        self._nearest = static.nearest.reshape(-1)
        self._filter = filter_
        self._config = config
        self.noise = np.array([info.noise.a, info.noise.b, info.noise.c], float)
        h, w = info.depth.height, info.depth.width
        self.label = np.zeros((h, w), np.uint8)
        self._least: Floats32 = np.zeros((LEVELS, h, w), np.float32)
        self._greatest: Floats32 = np.zeros((-(-h // TILE), -(-w // TILE)), np.float32)
        size = int(np.prod(grid.shape))
        self._count = np.zeros(size, np.uint16)
        self._hits = np.zeros(min(size, h * w), np.int32)
        self._strong = np.zeros(len(self._hits), np.uint8)
        self.pose_error = (config.calibration_m, config.calibration_rad)

    def process(
        self, depth: Floats32, T_base_camera: Pose, body: BodyPose, free: Bytes
    ) -> Evidence:
        """Judge one depth image.

        Args:
            depth: (h, w) float32 [m].
            T_base_camera: where the camera was at exposure.
            body: where the arm was at exposure.
            free: (voxels,) uint8, overwritten: 1 where the image saw through the whole voxel.
        """
        config = self._config
        depth = np.ascontiguousarray(depth)
        T = np.ascontiguousarray(T_base_camera)
        near, far = self.info.range
        returns = label_valid(depth, near, far, self.label) / depth.size
        if returns < config.min_returns:
            return Evidence(self._hits[:0], self._strong[:0], 0, returns, 0)
        error_m, error_rad = self.pose_error
        found = self._filter.label(
            depth,
            self.label,
            self.lens,
            T,
            body,
            (config.self_margin + error_m, error_rad),
            config.stamp_error,
            self.noise,
            config.sigmas,
        )
        count = collect_hits(
            depth,
            self.label,
            self.lens.rays,
            T,
            self._origin,
            self._grid.voxel,
            self._shape,
            self.noise,
            self._nearest,
            self._static.kinds,
            self._static.sizes,
            self._static.T_solid_base,
            config.static_margin + error_m,
            error_rad,
            config.sigmas,
            config.support,
            self._count,
            self._hits,
        )
        lens = self.info.depth
        grade_hits(
            self._hits,
            count,
            self._count,
            T,
            self._origin,
            self._grid.voxel,
            self._shape,
            lens.fx * lens.fy,
            config.strong_share,
            self._strong,
        )
        build_pyramid(depth, self.label, self._least, self._greatest)
        free[:] = 0
        carve(
            self._least,
            self._greatest,
            self.lens.vector,
            T,
            self._origin,
            self._grid.voxel,
            self._shape,
            near,
            self.noise,
            0.0,
            1.0,
            free.reshape(self._grid.shape),
        )
        return Evidence(self._hits, self._strong, count, returns, found)
