"""Plain-numpy twins of the map, slow and written from its definitions, not from its code.

Arithmetic on measured numbers has borders (a point on a voxel's face, a count at its threshold).
So each twin answers twice: what *must* be so however borders are rounded, and what *may* be so.
The map has to lie between the two. A check returns the flat indices of the voxels that do not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from armsight.devices.data import RgbdCameraInfo
from armsight.geometry.pose import inverse, transform
from armsight.geometry.shapes import Solid
from armsight.mapping.config import MappingConfig
from armsight.mapping.snapshot import FREE, OCCUPIED, VoxelGrid, WorkspaceSnapshot

EPS = 2e-5
"""Rounding that is allowed to coordinates [m]."""
DEPTH_EPS = 2e-4
"""Rounding that is allowed to depths: the map keeps them as 16-bit numbers [m]."""


@dataclass(frozen=True)
class View:
    """One frame: (h, w) depth [m] through a camera at a place, exposed at a time [s]."""

    info: RgbdCameraInfo
    depth: np.ndarray
    T_base_camera: np.ndarray
    stamp: float = 0.0

    def usable(self) -> np.ndarray:
        near, far = self.info.range
        with np.errstate(invalid="ignore"):
            return (self.depth >= np.float32(near)) & (self.depth <= np.float32(far))


def all_voxels(grid: VoxelGrid) -> np.ndarray:
    return np.argwhere(np.ones(grid.shape, bool))


def corners_of(grid: VoxelGrid, index: np.ndarray) -> np.ndarray:
    """(n, 8, 3) corners in base [m]."""
    unit = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    return grid.origin + (np.asarray(index)[:, None] + unit) * grid.voxel


def free_bounds(
    view: View, grid: VoxelGrid, index: np.ndarray, pad: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(n,) must be seen through by this view, (n,) may be.

    May: the voxel's corners lie inside the image, each behind a pixel that measured something
    farther; and so does every pixel's ray that meets the voxel, where it leaves it. Must: all
    pixels of the box around the corners' projections, wider by ``pad`` pixels and a fifth, measured
    something behind the voxel's farthest corner by one standard deviation.
    """
    lens = view.info.depth
    last = np.array([lens.width, lens.height]) - 1
    depth = np.where(view.usable(), view.depth, 0.0).astype(float)
    T_camera_base = inverse(view.T_base_camera)
    corners = corners_of(grid, index)
    must = np.zeros(len(index), bool)
    may = np.zeros(len(index), bool)
    R, origin = view.T_base_camera[:3, :3], view.T_base_camera[:3, 3]
    for n, box in enumerate(corners):
        local = transform(T_camera_base, box)
        z = local[:, 2]
        if z.min() <= view.info.range[0] - EPS:
            continue
        pixel = lens.project(local)
        if not np.isfinite(pixel).all():
            continue
        low, high = pixel.min(axis=0), pixel.max(axis=0)
        if (low < -0.5 - 1e-6).any() or (high > last + 0.5 + 1e-6).any():
            continue
        u, v = np.clip(np.round(pixel), 0, last).astype(int).T
        u0, v0 = np.maximum(np.floor(low).astype(int), 0)
        u1, v1 = np.minimum(np.ceil(high).astype(int), last)
        rays = lens.rays[v0 : v1 + 1, u0 : u1 + 1].reshape(-1, 2)
        ways = np.column_stack([rays, np.ones(len(rays))]) @ R.T
        with np.errstate(divide="ignore", invalid="ignore"):
            a = (box[0] + EPS - origin) / ways
            b = (box[-1] - EPS - origin) / ways
        enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        window = depth[v0 : v1 + 1, u0 : u1 + 1].reshape(-1)
        meets = enter < leave
        beyond = window[meets] >= leave[meets] - DEPTH_EPS
        between_pixels = np.abs(pixel - np.round(pixel)).max(axis=1) > 0.499
        behind = depth[v, u] >= z - DEPTH_EPS
        may[n] = beyond.all() and (behind | between_pixels).all()
        spare = pad + 0.2 * (high - low)
        a0, b0 = np.floor(low - spare).astype(int)
        a1, b1 = np.ceil(high + spare).astype(int)
        if a0 < 0 or b0 < 0 or a1 >= lens.width or b1 >= lens.height:
            continue
        far = z.max()
        least = depth[b0 : b1 + 1, a0 : a1 + 1].min()
        inside = z.min() > view.info.range[0] + DEPTH_EPS
        must[n] = inside and least > far + view.info.noise.sigma(far) + DEPTH_EPS
    return must, may


def hit_bounds(
    view: View, grid: VoxelGrid, solids: list[Solid], config: MappingConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grids of truth values: must be strongly hit, may be strongly hit, may be hit at all."""
    lens, noise = view.info.depth, view.info.noise
    depth, ok = view.depth.astype(float), view.usable()
    h, w = depth.shape
    sigma = noise.sigma(np.where(ok, depth, 1.0))
    like = 0.01 + 0.01 * np.where(ok, depth, 1.0) + 4.0 * sigma
    surely, maybe = (ok & _surface(view.depth, like + eps, config.support) for eps in (-EPS, EPS))
    points = np.concatenate([lens.rays, np.ones((h, w, 1))], -1) * depth[..., None]
    base = np.full((h * w, 3), np.nan)
    flat = ok.reshape(-1)
    base[flat] = transform(view.T_base_camera, points.reshape(-1, 3)[flat])
    limit = (
        config.static_margin
        + config.calibration_m
        + config.calibration_rad * depth
        + config.sigmas * sigma
    ).reshape(-1)
    if solids:
        gaps = np.full((len(solids), h * w), np.inf)
        gaps[:, flat] = [solid.distance(base[flat]) for solid in solids]
        nearest, gap = gaps.argmin(axis=0), gaps.min(axis=0)
        deep = -limit - np.array([solid.coarse for solid in solids])[nearest]
        other = ((gap > limit + EPS) | (gap < deep - EPS)).reshape(h, w)
        perhaps = ((gap > limit - EPS) | (gap < deep + EPS)).reshape(h, w)
        in_map = (base >= grid.origin) & (base < grid.origin + grid.voxel * np.array(grid.shape))
        perhaps_witness = perhaps | ~in_map.all(axis=1).reshape(h, w)
        surely &= other & _by_themselves(view.depth, like, -EPS, other)
        maybe &= perhaps & _by_themselves(view.depth, like, EPS, perhaps_witness)
    sure_count, may_count = np.zeros(grid.shape), np.zeros(grid.shape)
    low, high = (grid.index(np.nan_to_num(base + e, nan=-1e6)) for e in (-EPS, EPS))
    whole = (low == high).all(axis=1) & surely.reshape(-1)
    _count(sure_count, low[whole])
    # A point near a face may count on either side of it.
    unclear = np.flatnonzero(maybe.reshape(-1))
    for choice in np.ndindex(2, 2, 2):
        pick = np.asarray(choice) == 1
        cells = np.where(pick, high[unclear], low[unclear])
        new = ~((low[unclear] == high[unclear]) & pick).any(axis=1)
        _count(may_count, cells[new])
    center = grid.center(all_voxels(grid)) - view.T_base_camera[:3, 3]
    z = np.maximum(center @ view.T_base_camera[:3, 2], 0.05).reshape(grid.shape)
    face = lens.fx * lens.fy * (grid.voxel / z) ** 2
    need = np.maximum(config.strong_share * face, np.minimum(2.0, 0.5 * face))
    strong = sure_count >= need * (1 + 1e-6)
    return (
        strong & (sure_count > 0),
        (may_count >= need * (1 - 1e-6)) & (may_count > 0),
        may_count > 0,
    )


def _count(counts: np.ndarray, cells: np.ndarray) -> None:
    inside = ((cells >= 0) & (cells < counts.shape)).all(axis=1)
    np.add.at(counts, tuple(cells[inside].T), 1)


def _by_themselves(
    depth: np.ndarray, like: np.ndarray, eps: float, witness: np.ndarray
) -> np.ndarray:
    """Pixels with nothing nearer beside them, or two neighbours of their depth that count."""
    h, w = depth.shape
    padded = np.pad(depth.astype(float), 1, constant_values=np.nan)
    counts = np.pad(witness, 1)
    found, nearer = np.zeros((h, w), int), np.zeros((h, w), bool)
    with np.errstate(invalid="ignore"):
        for dv, du in np.ndindex(3, 3):
            if dv == du == 1:
                continue
            there = padded[dv : dv + h, du : du + w]
            found += (np.abs(there - depth) <= like + eps) & counts[dv : dv + h, du : du + w]
            nearer |= (there > 0.0) & (there - depth < -like - eps)
    return ~nearer | (found >= 2)


def _surface(depth: np.ndarray, like: np.ndarray, support: int) -> np.ndarray:
    """Pixels that show a surface: enough like neighbours, and not between a near and a far one."""
    h, w = depth.shape
    padded = np.pad(depth.astype(float), 1, constant_values=np.nan)
    found = np.zeros((h, w), int)
    nearer, farther = np.zeros((h, w), bool), np.zeros((h, w), bool)
    with np.errstate(invalid="ignore"):
        for dv in (0, 1, 2):
            for du in (0, 1, 2):
                if dv == du == 1:
                    continue
                d = padded[dv : dv + h, du : du + w] - depth
                found += np.abs(d) <= like
                farther |= d > like
                nearer |= d < -like
    return (found >= support) & ~(nearer & farther)


@dataclass
class MapTwin:
    """The evidence of several views over time, as the least and the most that the map may hold.

    Attributes:
        must, may: occupied by something undeclared.
    """

    grid: VoxelGrid
    solids: list[Solid]
    config: MappingConfig
    pad: float = 1.0
    must: np.ndarray = field(init=False)
    may: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.must = np.zeros(self.grid.shape, bool)
        self.may = np.zeros(self.grid.shape, bool)
        self._last = np.full(self.grid.shape, -np.inf)  # may have been seen so late
        self._by = {}  # camera: where its word may stand
        self._newest: dict[str, View] = {}
        self._bounds: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def take(self, view: View) -> None:
        """Take in one view; in the order of their stamps."""
        name = view.info.name
        must_free, may_free = (
            m.reshape(self.grid.shape)
            for m in free_bounds(view, self.grid, all_voxels(self.grid), self.pad)
        )
        strong, may_strong, touched = hit_bounds(view, self.grid, self.solids, self.config)
        again = view.stamp - self._last <= self.config.weak_window + 1e-9
        word = self._by.setdefault(name, np.zeros(self.grid.shape, bool))
        self.must &= ~may_free
        self.must |= strong
        self.may |= may_strong | (touched & again)
        word |= touched
        self._last[touched] = view.stamp
        others = np.zeros(self.grid.shape, bool)
        for other, where in self._by.items():
            others |= where & (other != name)
        old = view.stamp - self._last >= self.config.hold + 1e-9
        gone = must_free & ~touched & (~others | old)
        word[must_free & ~touched] = False
        for where in self._by.values():
            where[gone] = False
        self.may &= ~gone
        self._bounds[name] = (must_free, may_free)

    def wrong(self, snapshot: WorkspaceSnapshot) -> dict[str, np.ndarray]:
        """Flat indices of voxels whose state is none that they may have, by what is wrong."""
        state = snapshot.state
        solid_must, solid_may = static_bounds(self.solids, self.grid)
        any_must = np.zeros(self.grid.shape, bool)
        any_may = np.zeros(self.grid.shape, bool)
        for must, may in self._bounds.values():
            any_must |= must
            any_may |= may
        occupied = state == OCCUPIED
        return {
            "not occupied": np.flatnonzero((self.must | solid_must) & ~occupied),
            "occupied": np.flatnonzero(occupied & ~(self.may | solid_may)),
            "free": np.flatnonzero((state == FREE) & ~any_may),
            "not free": np.flatnonzero(any_must & ~(state == FREE) & ~(self.may | solid_may)),
        }


def static_bounds(solids: list[Solid], grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """Voxels that a solid must fill (it holds the centre), and may (it comes near enough)."""
    must, may = np.zeros(grid.shape, bool), np.zeros(grid.shape, bool)
    for solid in solids:
        d = solid.distance(grid.center(all_voxels(grid))).reshape(grid.shape)
        must |= d < -EPS
        may |= d <= 0.5 * np.sqrt(3.0) * grid.voxel + EPS
    return must, may


def field_twin(solid: np.ndarray, voxel: float, cap: float) -> np.ndarray:
    """(nx, ny, nz) distance between each voxel's cube and the nearest solid one, capped, by force.

    Two cubes k voxels apart along an axis leave a gap of max(|k| - 1, 0) voxels along it.
    """
    cells = np.argwhere(solid).astype(np.int32)
    out = np.full(solid.shape, np.inf)
    at = np.argwhere(np.ones(solid.shape, bool)).astype(np.int32)
    for start in range(0, len(cells), 32):
        gap = np.abs(at[:, None] - cells[None, start : start + 32])
        squares = (np.maximum(gap - 1, 0) ** 2).sum(axis=2).min(axis=1)
        out = np.minimum(out, np.sqrt(squares).reshape(solid.shape) * voxel)
    return np.minimum(out, cap)


def wrong_field(distance: np.ndarray, solid: np.ndarray, voxel: float, cap: float) -> np.ndarray:
    """Flat indices where a field exceeds the true distance, or falls short by over a micrometre."""
    true = field_twin(solid, voxel, cap)
    return np.flatnonzero((distance > true) | (distance < true - 1e-6))


class PeopleTwin:
    """Where someone unseen could be, by definition: arrays of truth values and scipy's dilation."""

    def __init__(self, grid: VoxelGrid, static: np.ndarray, config: MappingConfig) -> None:
        self.grid, self.static = grid, static.astype(bool)
        self.edge = int(np.ceil(config.hand / grid.voxel - 1e-6))
        self.speed = config.person_speed
        self.rim = np.pad(np.zeros(grid.shape, bool), self.edge, constant_values=True)
        self.possible = np.zeros_like(self.rim)
        self.owed: float | None = None

    def _inner(self, padded: np.ndarray) -> np.ndarray:
        e = self.edge
        return padded[e:-e, e:-e, e:-e]

    def update(self, free: np.ndarray, seen: np.ndarray, elapsed: float) -> None:
        """Free voxels, seen parts of people, and the time since the last update [s]."""
        everywhere = np.ones((3, 3, 3), bool)
        room = self.rim.copy()
        self._inner(room)[:] = ~free & ~self.static
        room = ndimage.binary_opening(room, np.ones((self.edge,) * 3, bool))
        source = self.rim.copy()
        self._inner(source)[:] |= seen
        possible = (self.possible & room) | source
        if self.owed is None:
            self.owed, steps = 0.0, sum(self.grid.shape)
        else:
            self.owed += self.speed * elapsed / self.grid.voxel
            steps = int(self.owed)
            self.owed -= steps
        if steps:
            possible = ndimage.binary_dilation(possible, everywhere, iterations=steps, mask=room)
        parts, _ = ndimage.label(possible, everywhere)
        self.possible = possible & np.isin(parts, np.unique(parts[source & possible]))

    def hidden(self) -> np.ndarray:
        """(nx, ny, nz) where someone could be."""
        return self._inner(self.possible)

    def outermost(self) -> np.ndarray:
        """(nx, ny, nz) those with a face towards what is neither possible nor declared solid."""
        solid = np.pad(self.static, self.edge)
        closed = self.possible | solid
        open_ = np.zeros_like(closed)
        for axis in range(3):
            for step in (-1, 1):
                open_ |= ~np.roll(closed, step, axis)
        return self._inner(self.possible & open_)
