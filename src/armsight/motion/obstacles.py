"""What of a snapshot the body must not touch: the policy for unknown space and for the box's edge.

* Occupied voxels are solid, always.
* Unknown voxels are solid too (``CollisionConfig.avoid_unknown``), save those close to where the
  body is *now*: the arm hides its own surroundings from the cameras, and a start inside its own
  shadow must not forbid every motion. Only unknown voxels are excused, never occupied ones;
  whoever might hide in that thin shell is counted by separation (``WorkspaceSnapshot.hazards``).
* Outside the mapped box nothing is known, so the body must stay inside; the box is widened where
  the body already reaches out of it now, and no farther.
* Declared things that the shoulder turns in, such as the table that the arm is bolted to, are
  excused where they are within the shoulder's own spheres (they cover it with some overshoot): the
  arm is mounted there. The shoulder is the first moving link and what of the second lies on the
  second joint's axis. Nothing that was ever seen to move or may move is excused, and no other part
  gets there without touching the shoulder.
* In the region of a contact permit what is solid is solid for all but the parts that may touch
  (:mod:`armsight.motion.permitted`).
* What cannot move (the base, and what lies on the first joint's axis to 3 mm) is not checked: no
  plan can make it touch anything, and none could leave what it touches.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from armsight.arrays import Floats, Ints, JointVector, Points
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid, WorkspaceSnapshot
from armsight.motion.body import Body
from armsight.motion.detail import NO_DETAIL, DetailedSnapshot
from armsight.motion.field import distance_to_solid
from armsight.motion.kernels import PERMITTED, Obstacles, body_centers
from armsight.motion.permitted import PermittedSnapshot, voxels_within

Scalar = TypeVar("Scalar", bound=np.generic)

NOBODY = np.zeros(0, bool)
"""No part may touch anything."""
TURNS = 48
"""Angles at which the shoulder is placed to find what it is mounted in."""
ON_AXIS = 0.02
"""Spheres this close to the second joint's axis belong to the shoulder [m]."""


@dataclass(frozen=True)
class CollisionConfig:
    """How careful collision checks are.

    Attributes:
        margin: added to every sphere against the surroundings and the body itself [m].
        floor: least clearance that counts as free; a proof needs some room to advance [m].
        avoid_unknown: treat unseen voxels as solid.
        excuse: unknown voxels up to this far from the body's present surface are excused [m].
    """

    margin: float = 0.0
    floor: float = 0.0005
    avoid_unknown: bool = True
    excuse: float = 0.06


def obstacles_of(
    snapshot: WorkspaceSnapshot, body: Body, config: CollisionConfig, at: JointVector | None = None
) -> Obstacles:
    """What the kernels see of a snapshot, for a body that is at ``at`` (n,) [rad] now."""
    grid = snapshot.grid
    origin = np.asarray(grid.origin, float)
    lower, upper = origin.copy(), origin + np.asarray(grid.shape) * grid.voxel
    state, distance = snapshot.state, snapshot.distance
    if config.avoid_unknown and not snapshot.distance_counts_unknown:
        distance = distance_to_solid(snapshot)
        if isinstance(snapshot, DetailedSnapshot):  # its points are in no voxel's state
            distance = np.minimum(distance, snapshot.distance)
    state = state.copy()  # the only one: it is written in three times
    mount = _mount(body, grid)
    held = mount[state.take(mount) == OCCUPIED]
    state.ravel()[held[snapshot.last_occupied.take(held) == -np.inf]] = FREE
    if at is not None:
        centers = np.empty_like(body.center)
        body_centers(body, np.asarray(at, float), centers)
        reach = (body.radius + config.floor + 1e-6)[:, None]
        if len(centers):
            lower = np.minimum(lower, (centers - reach).min(axis=0))
            upper = np.maximum(upper, (centers + reach).max(axis=0))
        if config.avoid_unknown:
            _excuse(state, origin, grid.voxel, centers, body.radius + config.excuse, FREE)
    touching = NOBODY
    if isinstance(snapshot, PermittedSnapshot):
        _open(state, voxels_within(snapshot, snapshot.grant.region), config)
        touching = np.ascontiguousarray(snapshot.grant.touching[body.original])
    return Obstacles(
        origin,
        float(grid.voxel),
        frozen(state),
        frozen(distance),
        lower,
        upper,
        config.avoid_unknown,
        config.floor,
        *(snapshot.detail if isinstance(snapshot, DetailedSnapshot) else NO_DETAIL),
        touching,
    )


def _open(state: NDArray[np.uint8], within: tuple[Ints, ...], config: CollisionConfig) -> None:
    """Make what is solid of some voxels PERMITTED."""
    there = state[within]
    solid = there == OCCUPIED
    if config.avoid_unknown:
        solid |= there == UNKNOWN
    state[within] = np.where(solid, np.uint8(PERMITTED), there)


def frozen(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """A read-only, contiguous view: compiled code takes writable arrays for another type.

    Without it the kernels would be compiled anew the first time a snapshot is excused, in motion.
    """
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True)
class _Mount:
    """Key of a cache: a robot's body on a grid; bodies and grids are few and never change."""

    body: Body
    origin: tuple[float, ...]
    voxel: float
    shape: tuple[int, int, int]

    def __hash__(self) -> int:
        return hash((id(self.body.center), self.origin, self.voxel, self.shape))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, _Mount)
            and other.body.center is self.body.center
            and (other.origin, other.voxel, other.shape) == (self.origin, self.voxel, self.shape)
        )


def _mount(body: Body, grid: VoxelGrid) -> Ints:
    """Places in the flat grid of the voxels that the shoulder's spheres reach."""
    origin = tuple(float(x) for x in grid.origin)
    return _mount_cached(_Mount(body, origin, float(grid.voxel), grid.shape))


@lru_cache(maxsize=16)
def _mount_cached(key: _Mount) -> Ints:
    body = key.body
    shoulder = np.flatnonzero((body.lever[:, 1:] <= ON_AXIS).all(axis=1))
    marks = np.zeros(key.shape, np.uint8)
    q = np.zeros(len(body.lower))
    centers = np.empty_like(body.center)
    for angle in np.linspace(0.0, 2.0 * np.pi, TURNS, endpoint=False):
        q[0] = angle
        body_centers(body, q, centers)
        reach = body.radius + body.lever[:, 0] * np.pi / TURNS + body.lever[:, 1:].sum(axis=1)
        _excuse(
            marks, np.asarray(key.origin), key.voxel, centers[shoulder], reach[shoulder], OCCUPIED
        )
    return np.flatnonzero(marks)


@njit(cache=True, nogil=True)
def _excuse(
    state: np.ndarray, origin: Floats, voxel: float, centers: Points, reach: Floats, write: int
) -> None:
    """Write a state to the unknown voxels whose cube meets a sphere."""
    nx, ny, nz = state.shape
    for k in range(centers.shape[0]):
        gx = (centers[k, 0] - origin[0]) / voxel
        gy = (centers[k, 1] - origin[1]) / voxel
        gz = (centers[k, 2] - origin[2]) / voxel
        r = reach[k] / voxel
        for ix in range(max(0, int(gx - r)), min(nx - 1, int(gx + r)) + 1):
            dx = max(ix - gx, gx - ix - 1.0, 0.0)
            for iy in range(max(0, int(gy - r)), min(ny - 1, int(gy + r)) + 1):
                dy = max(iy - gy, gy - iy - 1.0, 0.0)
                if dx * dx + dy * dy > r * r:
                    continue
                for iz in range(max(0, int(gz - r)), min(nz - 1, int(gz + r)) + 1):
                    if state[ix, iy, iz] != UNKNOWN:
                        continue
                    dz = max(iz - gz, gz - iz - 1.0, 0.0)
                    if dx * dx + dy * dy + dz * dz <= r * r:
                        state[ix, iy, iz] = write
