"""What an arm holds, or what hangs from it, belongs to its body: to the tool that it carries.

The guard's spheres, the planner and the self-filter all take the robot as it is, so a solid that is
joined to its tool is kept clear of people and things, taken out of the pictures, and weighed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, Points
from armsight.geometry.pose import transform
from armsight.geometry.shapes import Solid
from armsight.robots.robot import Capsules, Spheres, Tool

FINEST = 0.03
"""Cells of a solid are no smaller than this [m] ..."""
MOST = 32
"""... and no more than this many, each in a sphere of its own."""
COARSER = 1.15
"""Factor by which the cells grow until there are few enough."""


def holding(tool: Tool | None, solids: Sequence[Solid], mass: Sequence[float] = ()) -> Tool:
    """A tool that holds solids besides.

    Args:
        tool: what the flange carries, or None.
        solids: in the flange's frame.
        mass: of each [kg]; nothing where left out.
    """
    if tool is None:
        none, nowhere = np.zeros(0, np.int64), np.zeros((0, 3))
        tool = Tool(
            "held", np.eye(4), Spheres(none, nowhere, np.zeros(0)),
            Capsules(none, nowhere, nowhere, np.zeros(0)), (), 0.0, np.zeros(3),
        )  # fmt: skip
    masses = [tool.mass, *(mass or np.zeros(len(solids)))]
    middles = [tool.center_of_mass, *(solid.T_frame_solid[:3, 3] for solid in solids)]
    total = float(sum(masses))
    centers, radii = zip(*[(tool.spheres.center, tool.spheres.radius), *map(spheres_of, solids)])
    center, radius = np.concatenate(centers), np.concatenate(radii)
    return replace(
        tool,
        spheres=Spheres(np.zeros(len(radius), np.int64), center, radius),
        mass=total,
        center_of_mass=np.average(middles, axis=0, weights=masses) if total > 0.0 else middles[0],
        held=(*tool.held, *solids),
    )


def spheres_of(solid: Solid) -> tuple[Points, Floats]:
    """Spheres that together hold a solid: (k, 3) centres in its frame's frame and (k,) radii [m].

    A box, or a cylinder's own box, in equal cells, each in the sphere about it: what sticks out is
    less than a cell's diagonal. A slim cylinder is cut along its axis only, and cells at the
    corners that a wide one does not reach are left out.
    """
    if solid.kind == "sphere":
        return solid.T_frame_solid[None, :3, 3].copy(), np.array([solid.size[0]])
    radius, height = solid.size[0], solid.size[1]
    slim = solid.kind == "cylinder" and radius <= FINEST
    size = np.array(solid.size if solid.kind == "box" else (2 * radius, 2 * radius, height))
    edge, counts = FINEST, np.ones(3, np.int64)
    while True:
        counts = np.maximum(np.ceil(size / edge - 1e-9).astype(np.int64), 1)
        if slim:
            counts[:2] = 1
        if counts.prod() <= MOST:
            break
        edge *= COARSER
    cell = size / counts
    index = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1)
    centers = (index.reshape(-1, 3) + 0.5) * cell - 0.5 * size
    around = float(np.hypot(radius, 0.5 * cell[2])) if slim else 0.5 * float(np.linalg.norm(cell))
    if solid.kind == "cylinder":
        nearest = np.maximum(np.abs(centers[:, :2]) - 0.5 * cell[:2], 0.0)
        centers = centers[np.linalg.norm(nearest, axis=1) <= radius]
    return transform(solid.T_frame_solid, centers), np.full(len(centers), around)
