"""What mapping hands to motion and the page: one immutable picture of the workspace."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armsight.arrays import Bytes, Floats32, Ints, Points, Pose, Vector3
from armsight.geometry.shapes import Solid

UNKNOWN, FREE, OCCUPIED, ENCLOSED = 0, 1, 2, 3
"""States of a voxel. ENCLOSED: unseen, but so surrounded by what is seen that nobody is there."""


@dataclass(frozen=True)
class VoxelGrid:
    """Where the voxels of a dense box lie.

    Attributes:
        origin: (3,) lower corner of voxel (0, 0, 0) in ``base`` [m].
        voxel: edge of a voxel [m].
        shape: number of voxels along x, y, z.
    """

    origin: Vector3
    voxel: float
    shape: tuple[int, int, int]

    def index(self, points: Points) -> Ints:
        """(n, 3) voxel indices of (n, 3) points in ``base``; may lie outside the shape."""
        return np.floor((np.asarray(points, float) - self.origin) / self.voxel).astype(np.int64)

    def center(self, index: Ints) -> Points:
        """(n, 3) centres in ``base`` [m] of (n, 3) voxel indices."""
        return np.asarray((np.asarray(index) + 0.5) * self.voxel + self.origin)

    def around(self, center: Vector3, reach: Vector3 | float) -> tuple[Ints, tuple[slice, ...]]:
        """The box of voxels within ``reach`` [m] of (3,) a place, along each axis.

        Returns:
            (3,) its lowest index, and its slices; what is outside of the grid is not in it.
        """
        low = np.clip(self.index((center - reach)[None])[0], 0, self.shape)
        high = np.clip(self.index((center + reach)[None])[0] + 1, 0, self.shape)
        return low, tuple(slice(int(a), int(b)) for a, b in zip(low, high))


@dataclass(frozen=True)
class CameraStatus:
    """Health of one camera as the map sees it.

    Attributes:
        name: the camera.
        stamp: exposure of its newest frame used [s]; -inf before the first.
        alive: frames come and are no older than allowed.
        frames: used so far.
        dropped: refused or lost so far.
        reason: why it is not alive, or why the last frame was refused; empty when all is well.
        excluded: it is known to stand elsewhere than believed: nothing of what it says counts, and
            the cell goes on without it.
    """

    name: str
    stamp: float
    alive: bool
    frames: int
    dropped: int
    reason: str = ""
    excluded: bool = False


@dataclass(frozen=True, eq=False)
class CameraCorrection:
    """What the map corrects of a camera, found against the arm and the declared solids.

    Attributes:
        name: the camera.
        T_believed_corrected: the corrected depth lens in the believed one's frame.
        gain: factor on the measured depth.
    """

    name: str
    T_believed_corrected: Pose
    gain: float


@dataclass(frozen=True)
class Emptiness:
    """What became of the word that nobody is in the cell.

    Attributes:
        said: it was said and holds: things are told from people.
        waiting: it was said, and is not taken yet.
        reason: why it is not taken, or was refused; empty when all is well.
    """

    said: bool = False
    waiting: bool = False
    reason: str = ""


@dataclass(frozen=True)
class Declared:
    """What became of solids that were declared while the cell runs.

    Attributes:
        name: by which they were declared; solids: in ``base``.
        taken: they count as standing there.
        waiting: cameras are looking whether they do.
        reason: why they do not, or not yet; empty when they are taken.
    """

    name: str
    solids: tuple[Solid, ...]
    taken: bool = False
    waiting: bool = False
    reason: str = ""

    @property
    def held(self) -> bool:
        """Whether they count, or may soon."""
        return self.taken or self.waiting


@dataclass(frozen=True)
class SeenInside:
    """Something that is seen inside of a declared solid: a hazard.

    Attributes:
        solid: in ``base``; depth: how deep inside [m]; place: (3,) where it is deepest [m].
    """

    solid: Solid
    depth: float
    place: Vector3

    def __str__(self) -> str:
        x, y, z = self.place
        coarse = np.ceil(100.0 * self.depth + 0.5) / 100.0
        return (
            f"something is seen {self.depth:.2f} m inside of '{self.solid.name}', near ({x:.2f}, "
            f"{y:.2f}, {z:.2f}) m: it counts as a person; if that solid is declared larger than it "
            f"is, mend its shape, or set its coarse to {coarse:.2f} m"
        )


@dataclass(frozen=True)
class WorkspaceSnapshot:
    """The workspace as known at one time. Arrays are read-only and never change after publishing.

    Attributes:
        sequence: counts snapshots.
        stamp: exposure of the newest frame in it [s].
        oldest: exposure of the newest frame of the *stalest* camera that matters [s].
        grid: where the fine voxels lie.
        state: (nx, ny, nz) uint8, UNKNOWN, FREE, OCCUPIED (declared static geometry included) or
            ENCLOSED.
        distance: (nx, ny, nz) float32 [m]: a proven lower bound of the distance from any point of
            the voxel to any occupied cube or (by policy) unknown cube; capped at ``distance_cap``.
            Enclosed cubes are not solid.
        distance_cap: where ``distance`` saturates [m].
        last_occupied: (nx, ny, nz) float32 [s] when each voxel was last seen occupied by something
            that moves or may move; -inf never. Danger is a closed form of the age (design 5.5).
        hazards: (m, 3) float32 centres in ``base`` [m] of every voxel where a person could be:
            occupied ones that declared geometry does not explain, and unknown space that could
            hide someone. Separation counts the distance to these, less ``hazard_radius``.
        hazard_radius: half diagonal of a hazard's cube [m].
        hazard_unknown: (m,) bool, true where the hazard is unseen rather than seen.
        things: (t, 3) float32 centres in ``base`` [m] of occupied voxels that are known to be no
            person: solid, but no hazards.
        emptiness: what became of the word that nobody is in the cell.
        declared: what became of solids that were declared while the cell runs.
        inside: what has been seen inside of declared solids for a second.
        corrections: of the cameras' poses and depths, one entry a camera.
        cloud: (k, 3) float32 newest merged, cleaned cloud in ``base``, for the page.
        cameras: health, one entry a camera.
        timings: (stage, seconds) of the last update, in order.
        distance_counts_unknown: whether ``distance`` treats unknown voxels as occupied; where it
            does not, a planner that avoids unknown space makes a field of its own.
    """

    sequence: int
    stamp: float
    oldest: float
    grid: VoxelGrid
    state: Bytes
    distance: Floats32
    distance_cap: float
    last_occupied: Floats32
    hazards: Floats32
    hazard_radius: float
    hazard_unknown: NDArray[np.bool_]
    cloud: Floats32
    cameras: tuple[CameraStatus, ...]
    timings: tuple[tuple[str, float], ...] = field(default=())
    distance_counts_unknown: bool = False
    things: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))
    emptiness: Emptiness = Emptiness()
    corrections: tuple[CameraCorrection, ...] = ()
    declared: tuple[Declared, ...] = ()
    inside: tuple[SeenInside, ...] = ()
