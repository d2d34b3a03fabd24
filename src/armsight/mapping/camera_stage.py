"""One camera's share of the work: from a depth image to evidence about voxels."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, Floats32, Ints32, Pose, Shorts
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.depth_model import TABLE_STEP, DepthCorrection
from armsight.mapping.backdrop import Backdrop
from armsight.mapping.carving import Carver
from armsight.mapping.config import MappingConfig
from armsight.mapping.declared import Looker
from armsight.mapping.kernels.depth import correct_depth
from armsight.mapping.kernels.hits import collect_hits, grade_hits
from armsight.mapping.kernels.pixels import keep_valid, label_valid
from armsight.mapping.lens import DepthLens
from armsight.mapping.mounting import LOST, Mounting
from armsight.mapping.occupancy import Sight
from armsight.mapping.plausibility import Plausibility
from armsight.mapping.self_filter import BodyPose, SelfFilter
from armsight.mapping.snapshot import Declared
from armsight.mapping.static_geometry import StaticGeometry


@dataclass(frozen=True)
class Hits:
    """Voxels of one layer that a frame hit.

    Attributes:
        index: (m,) int32 flat indices; strong: (m,) uint8, 1 where enough pixels hit.
    """

    index: Ints32
    strong: Bytes


@dataclass(frozen=True)
class Evidence:
    """What one frame says; the voxels seen free are written to the caller's arrays.

    Attributes:
        hits: one entry a layer: something undeclared that is not the arm.
        returns: share of pixels with a usable return.
        body: number of pixels that are the arm.
        sight: the image, until the camera's next one; None when it was refused.
        problem: why it was refused, where the picture itself says so.
        warning: what is odd about it although it is believed.
        through: which of the solids that were declared while the cell runs it sees through.
    """

    hits: tuple[Hits, ...]
    returns: float
    body: int
    sight: Sight | None = None
    problem: str = ""
    warning: str = ""
    through: tuple[str, ...] = ()


class _Layer:
    """A camera's buffers for one layer of voxels."""

    def __init__(self, static: StaticGeometry, pixels: int) -> None:
        grid = static.grid
        size = int(np.prod(grid.shape))
        self.origin = np.asarray(grid.origin, float)
        self.voxel = float(grid.voxel)
        self.shape = np.asarray(grid.shape, np.int64)
        self.count: Shorts = np.zeros(size, np.uint16)
        self.hits: Ints32 = np.zeros(min(size, pixels), np.int32)
        self.strong: Bytes = np.zeros(len(self.hits), np.uint8)
        self.declare(static)

    def declare(self, static: StaticGeometry) -> None:
        """These solids explain hits from now on."""
        self.table = (
            self.origin.astype(np.float32),
            self.voxel,
            self.shape,
            static.nearest.reshape(-1),
            static.bound.reshape(-1),
        )


class CameraStage:
    """Buffers and constants of one camera. Used by one thread at a time."""

    def __init__(
        self,
        info: RgbdCameraInfo,
        static: tuple[StaticGeometry, StaticGeometry],
        filter_: SelfFilter,
        config: MappingConfig,
    ) -> None:
        self.info = info
        self.lens = DepthLens(info.depth, 1.1 * info.range[1])
        self.noise = np.array([info.noise.a, info.noise.b, info.noise.c], float)
        self.label: Bytes = np.zeros((info.depth.height, info.depth.width), np.uint8)
        self._filter = filter_
        self._config = config
        pixels = self.label.size
        self._layers = (_Layer(static[0], pixels), _Layer(static[1], pixels))
        self._carvers = tuple(
            Carver(self.lens, layer.grid, info.range[0], self.noise) for layer in static
        )
        self.redeclare(static)
        self._looker = Looker(self.lens.rays, info.range, self.noise)
        self.mounting = Mounting(info, self.lens, filter_, static[0], config)
        self._plausibility = Plausibility(info, static[0], filter_.fields, self.noise)
        self._scaled: Floats32 = np.zeros(self.label.shape, np.float32)
        self._returns: Floats32 = np.zeros(self.label.shape, np.float32)
        model = info.depth_model
        self._correction = None if model is None else DepthCorrection(model, info.depth)

    def redeclare(self, static: tuple[StaticGeometry, StaticGeometry]) -> None:
        """These solids, fine and coarse, explain returns from now on.

        Where the camera sits and whether it lies is still judged by those of the cell's file:
        others are declared less exactly, and may drive away.
        """
        self._solids = static[0].table
        outermost = static[1] if self._config.has_far_layer else static[0]
        self.backdrop = Backdrop(self.lens, self.info.range, self.noise, outermost)
        for layer, declared in zip(self._layers, static):
            layer.declare(declared)

    def process(
        self,
        depth: Floats32,
        T_base_camera: Pose,
        body: BodyPose,
        free: tuple[Bytes, ...],
        stamp: float,
        beside: Executor | None = None,
        watched: Sequence[Declared] = (),
    ) -> Evidence:
        """Judge one depth image.

        Args:
            depth: (h, w) float32 [m].
            T_base_camera: where the camera was at exposure.
            body: where the arm was at exposure.
            free: one (voxels,) uint8 array a layer, overwritten: 1 where the image saw through
                the whole voxel.
            stamp: the exposure [s].
            beside: takes a part of the work, if there is nothing else for it to do.
            watched: solids that were declared while the cell runs.
        """
        config = self._config
        depth = self._corrected(np.ascontiguousarray(depth))
        near, far = self.info.range
        returns = label_valid(depth, near, far, self.label) / depth.size
        if returns < config.min_returns:
            return Evidence((), returns, 0)
        mounting = self.mounting
        lie = self._lie(depth, T_base_camera, body, stamp) if mounting.settled else ""
        if lie:
            return Evidence((), returns, 0, problem=lie)
        if mounting.due(stamp):
            mounting.look(self._known(depth), T_base_camera, body, stamp)
        if mounting.problem or mounting.excluded:
            return Evidence((), returns, 0)
        if mounting.lost:
            return Evidence((), returns, 0, problem=LOST)
        T = np.ascontiguousarray(T_base_camera @ mounting.T_old_new, float)
        depth = np.multiply(depth, np.float32(mounting.gain), out=self._scaled)
        error_m, error_rad = mounting.error
        warning = self._plausibility.warning(self.label) or mounting.warning(stamp)
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
        through = self._looker.through(depth, self.label, T, watched)
        self.lens.tabulate(depth, self.label)
        fine, far_layer = self._carvers
        carved = None if beside is None else beside.submit(fine.carve, T, free[0])
        tolerance = (config.static_margin + error_m, error_rad, config.sigmas)
        hits = self._hits(depth, T, tolerance)
        far_layer.carve(T, free[1])
        if carved is None:
            fine.carve(T, free[0])
        else:
            carved.result()
        image = self.lens.least[0], self.lens.units, self.lens.ideal
        sight = Sight(*image, T, near, self.noise, tolerance)
        return Evidence(hits, returns, found, sight, warning=warning, through=through)

    def _known(self, depth: Floats32) -> Floats32:
        """The usable returns, NaN elsewhere; valid until the next picture."""
        keep_valid(depth, self.label, self._returns)
        return self._returns

    def _lie(self, depth: Floats32, T_base_camera: Pose, body: BodyPose, stamp: float) -> str:
        """Why a picture cannot be true, or nothing; a camera that was moved tells the truth."""
        mounting, look = self.mounting, self._plausibility
        repeats = look.repeats(depth, self.label, T_base_camera)
        if repeats:
            return repeats
        scaled = np.multiply(depth, np.float32(mounting.gain), out=self._scaled)
        margins = (mounting.error, self._config.stamp_error)
        here = np.ascontiguousarray(T_base_camera @ mounting.T_old_new, float)
        lie = look.contradiction(scaled, self.label, here, body, *margins)
        if not lie:
            return ""
        known = self._known(depth)
        there = mounting.other_pose(known, T_base_camera, body, stamp)
        if there is None or look.contradiction(scaled, self.label, there, body, *margins):
            return lie
        return "" if mounting.moved(known, T_base_camera, body, stamp) else lie

    def _corrected(self, depth: Floats32) -> Floats32:
        """Without the systematic error that calibration has found."""
        found = self._correction
        if found is None:
            return depth
        out = np.empty_like(depth)
        correct_depth(depth, found.surface, found.true, found.first, TABLE_STEP, out)
        return out

    def _hits(
        self, depth: Floats32, T: Pose, tolerance: tuple[float, float, float]
    ) -> tuple[Hits, ...]:
        config = self._config
        fine, far = self._layers
        todo = self.backdrop.unexplained(depth, self.label, T, tolerance)
        focal2 = self.info.depth.fx * self.info.depth.fy
        counts = collect_hits(
            depth,
            self.label,
            todo,
            self.lens.rays,
            T.astype(np.float32),
            self.noise,
            fine.table,
            far.table,
            self._solids,
            tolerance,
            config.support,
            config.strong_share * focal2,
            fine.count,
            fine.hits,
            far.count,
            far.hits,
        )
        for layer, count in zip(self._layers, counts):
            grade_hits(
                layer.hits,
                count,
                layer.count,
                T,
                layer.origin,
                layer.voxel,
                layer.shape,
                focal2,
                config.strong_share,
                layer.strong,
            )
        return tuple(
            Hits(layer.hits[:n], layer.strong[:n]) for layer, n in zip(self._layers, counts)
        )
