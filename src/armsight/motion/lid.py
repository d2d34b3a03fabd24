"""The top of the mapped box, under which planned paths keep.

Close under it the arm hides what no camera sees from elsewhere, and keeps away from what may be
there: an arm that was led there may not be let away again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import JointVector, Mask, Vector3
from armsight.mapping.overhead import upright
from armsight.mapping.snapshot import OCCUPIED, VoxelGrid, WorkspaceSnapshot
from armsight.motion.nearest import MovingBody

ROOM = 0.03
"""Start and goal keep at least this far from the lid [m]."""
VERTICAL = 0.999
"""Cosine with the vertical of an axis about which nothing rises."""
ACROSS = 1.5
"""Two points of two voxels, seen from above, are nearer than the middles by less than this, in
voxels."""


class Lid:
    """Closes surroundings from above for one arm.

    Args:
        body: its moving parts.
        up: (3,) unit, against gravity, in ``base``: of an arm that hangs the z axis points down.
        depth: how far below the top of the mapped box paths keep, if their ends do [m].
    """

    def __init__(self, body: MovingBody, up: Sequence[float], depth: float) -> None:
        self._body, self._up, self._depth = body, np.asarray(up, float), depth
        self._pillar = Pillar.of(body, self._up)

    def over(self, snapshot: WorkspaceSnapshot, ends: Sequence[JointVector]) -> WorkspaceSnapshot:
        """The surroundings closed by a lid, as high as (n,) ends of a way need it."""
        room = min(self.below_the_top(q, snapshot.grid) for q in ends)
        return with_lid(snapshot, min(self._depth, room - ROOM), self._up, self._pillar)

    def below_the_top(self, q: JointVector, grid: VoxelGrid) -> float:
        """How far below the top of a box what can rise of the arm at (n,) [rad] stays [m]."""
        center = self._body.motion(np.asarray(q, float), np.zeros(len(q)))[0]
        axis, upwards = upright(self._up)
        highest = (center[:, axis] if upwards else -center[:, axis]) + self._body.radius
        return _top(grid, axis, upwards) - float(highest[self._pillar.rises].max())


@dataclass(frozen=True)
class Pillar:
    """What of an arm turns about the vertical only, wherever its joints are: it needs its place.

    Attributes:
        middle: (3,) a point of the vertical that it turns about, in ``base`` [m].
        radius: of the room that it takes about that [m]; 0 where every part can rise.
        height: of its highest point along ``up``, from the origin of ``base`` [m].
        rises: (m,) bool, the parts of the body that are none of it.
    """

    middle: Vector3
    radius: float
    height: float
    rises: Mask

    @classmethod
    def of(cls, body: MovingBody, up: Vector3) -> Pillar:
        """That of a body: its first link, if the first joint's axis is vertical."""
        robot = body.robot
        T = robot.T_link_joint[0]
        rises = body.link > 1
        if abs(float((T[:3, :3] @ robot.axis[0]) @ up)) < VERTICAL or rises.all():
            return cls(T[:3, 3].copy(), 0.0, -np.inf, np.ones(len(rises), bool))
        center = body.motion(np.asarray(robot.home, float), np.zeros(robot.n))[0]
        center, radius = center[~rises], body.radius[~rises]
        beside = np.cross(center - T[:3, 3], up)
        reach = float((np.linalg.norm(beside, axis=1) + radius).max())
        return cls(T[:3, 3].copy(), reach, float((center @ up + radius).max()), rises)


def with_lid(
    snapshot: WorkspaceSnapshot, depth: float, up: Vector3, pillar: Pillar | None = None
) -> WorkspaceSnapshot:
    """The same surroundings, occupied down to at most ``depth`` [m] below the top of the box.

    Args:
        snapshot: the surroundings.
        depth: of the lid [m].
        up: (3,) unit, against gravity, in ``base``: that of an arm that hangs is its z downwards.
        pillar: what stands in the lid wherever it is, and has a hole there.
    """
    grid = snapshot.grid
    layers = int(np.floor(depth / grid.voxel + 1e-6))
    if layers <= 0:
        return snapshot
    axis, upwards = upright(up)
    count = grid.shape[axis]
    under = np.arange(count)[::-1] if upwards else np.arange(count)
    flat = tuple(k for k in range(3) if k != axis)
    # Between any points of two voxels in a column there are the voxels between them.
    bound = np.expand_dims(np.maximum(under - layers, 0) * grid.voxel, flat)
    lid = np.expand_dims(under < layers, flat)
    under_lid = _top(grid, axis, upwards) - layers * grid.voxel
    if pillar is not None and pillar.height > under_lid - ROOM:
        a, b = (grid.origin[k] + (np.arange(grid.shape[k]) + 0.5) * grid.voxel for k in flat)
        away = np.hypot(a[:, None] - pillar.middle[flat[0]], b[None] - pillar.middle[flat[1]])
        away = np.expand_dims(away, axis)
        hole = pillar.radius + ROOM
        lid = lid & (away > hole)
        bound = np.maximum(bound, hole - away - ACROSS * grid.voxel)
    state = np.where(lid, np.uint8(OCCUPIED), snapshot.state)
    return replace(
        snapshot, state=state, distance=np.minimum(snapshot.distance, bound.astype(np.float32))
    )


def _top(grid: VoxelGrid, axis: int, upwards: bool) -> float:
    """Height of the top of a box along the vertical, from the origin of ``base`` [m]."""
    low = float(grid.origin[axis])
    return low + grid.shape[axis] * grid.voxel if upwards else -low
