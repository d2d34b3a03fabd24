"""Which pairs of links are worth checking against each other, found by sampling.

Neighbours in the chain touch by construction. Of the others, a pair is worth checking when its
meshes come together in some of the sampled configurations but not in all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from armsight.arrays import Floats, Ints, JointVector, Points, Poses
from armsight.robots.fit_kernels import mesh_touches, sphere_gaps
from armsight.robots.near_links import ROOM
from armsight.robots.robot import Spheres
from armsight.robots.solids import VoxelSolid


@dataclass(frozen=True)
class PairStatistics:
    """How links met in sampled configurations.

    Attributes:
        pairs: (p, 2) links that are not neighbours, the nearer to the base first.
        spheres_touch: (p,) share of configurations in which their spheres leave less room than
            planners keep (:data:`~armsight.robots.near_links.ROOM`).
        least_gap: (p,) least gap between their spheres [m].
        meshes_touch: (p,) share in which their meshes come within a few millimetres.
        false_alarm: (p,) share in which they do although the meshes do not meet.
    """

    pairs: Ints
    spheres_touch: Floats
    least_gap: Floats
    meshes_touch: Floats
    false_alarm: Floats

    def worth_checking(self, near: float = 0.02) -> Ints:
        """(k, 2) pairs that can touch: not those that never do, nor those that always do."""
        may = (self.least_gap < near) & (self.meshes_touch < 0.99)
        # Between links two apart there are two joints: the samples leave no gap in what they can
        # do. Of others a pair that hardly ever overlaps stays, however few samples spoke.
        apart = self.pairs[:, 1] - self.pairs[:, 0]
        seen = (self.meshes_touch > 0.0) | ((apart > 2) & (self.spheres_touch < 0.02))
        # Spheres that meet while the meshes do not would forbid what the arm can well do.
        honest = self.false_alarm < 0.15
        return np.asarray(self.pairs[may & seen & honest])

    def worth_checking_with_tool(self, last: int) -> Ints:
        """(k, 2) further pairs of the last link, for a tool that sticks out of it."""
        bare = {tuple(pair) for pair in self.worth_checking().tolist()}
        mine = (self.pairs[:, 1] == last) & (self.spheres_touch < 0.001)
        rows = [pair for pair in self.pairs[mine].tolist() if tuple(pair) not in bare]
        return np.array(rows, np.int64).reshape(-1, 2)


def pair_statistics(
    T_link_joint: Poses,
    axis: Points,
    lower: JointVector,
    upper: JointVector,
    spheres: Spheres,
    bodies: list[tuple[Points, VoxelSolid] | None] | None,
    rng: np.random.Generator,
    samples: int = 20_000,
    mesh_samples: int = 4_000,
) -> PairStatistics:
    """Sample configurations and see which links meet.

    Args:
        T_link_joint: (n, 4, 4) of the chain.
        axis: (n, 3) of its joints.
        lower: (n,) least joint positions [rad].
        upper: (n,) greatest joint positions [rad].
        spheres: of the body.
        bodies: per link, (k, 3) points on its surface in its frame [m] and its inside, or None;
            None for all where only spheres are known, which then stand for the meshes.
        rng: draws the configurations.
        samples: configurations tried with spheres.
        mesh_samples: of them, how many are tried with meshes.
    """
    n = len(axis)
    pairs = np.array([(i, j) for i in range(n + 1) for j in range(i + 2, n + 1)], np.int64)
    pairs = pairs.reshape(-1, 2)
    path = rng.uniform(lower, upper, (samples, n))
    gap = sphere_gaps(path, T_link_joint, axis, spheres.link, spheres.center, spheres.radius, pairs)
    touching = gap < ROOM
    met = touching[:mesh_samples].copy()
    if bodies is not None:
        met[:] = False
        # Two voxels more, so that near misses count.
        grown = [
            None if b is None else ndimage.binary_dilation(b[1].inside, iterations=2)
            for b in bodies
        ]
        for p, (i, j) in enumerate(pairs):
            for a, b in ((i, j), (j, i)):
                mover, still, inside = bodies[a], bodies[b], grown[b]
                if mover is None or still is None or inside is None:
                    continue
                rows = np.flatnonzero((gap[:mesh_samples, p] < 0.01) & ~met[:, p])
                met[rows, p] |= mesh_touches(
                    path[rows],
                    T_link_joint,
                    axis,
                    a,
                    b,
                    mover[0],
                    still[1].origin,
                    still[1].voxel,
                    inside,
                )
    return PairStatistics(
        pairs,
        touching.mean(axis=0),
        gap.min(axis=0),
        met.mean(axis=0),
        (touching[:mesh_samples] & ~met).mean(axis=0),
    )
