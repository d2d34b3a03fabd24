"""A map that reaches past a wall: no camera looks there, so somebody may be behind it."""

from __future__ import annotations

import numpy as np

from armsight.arrays import Floats, Vector3
from armsight.geometry.shapes import Solid
from armsight.workcell.schema import Workcell

SQUARE = 1e-3
"""A wall stands along the axes of world when its rotation is that near to them."""
WHOLE = 0.8
"""So much of the mapped box's face a solid has to cover to be a wall of it."""


def past_walls(workcell: Workcell, lower: Vector3, upper: Vector3) -> list[str]:
    """What to say of walls that the mapped box reaches past, in words.

    Unseen space counts as a place where somebody may be: the guard keeps the arm half a metre and
    more away from such a strip, through the wall.

    Args:
        workcell: with its solids and cameras.
        lower: (3,) corner of the mapped box in ``world`` [m].
        upper: (3,) the other one.
    """
    arm = np.asarray(workcell.robot.T_world_base)[:3, 3]
    eyes = np.array([camera.position for camera in workcell.camera]).reshape(-1, 3)
    found = []
    for section in workcell.solid:
        box = _box(section.solid)
        if box is None:
            continue
        low, high = box
        for a in (0, 1):
            others = [k for k in range(3) if k != a]
            covered = np.clip(np.minimum(high, upper) - np.maximum(low, lower), 0.0, None)[others]
            if covered.prod() < WHOLE * (np.asarray(upper) - lower)[others].prod():
                continue
            for sign, end, near, far in (
                (1.0, upper[a], low[a], high[a]),
                (-1.0, -lower[a], -high[a], -low[a]),
            ):
                if end <= far + 1e-9 or sign * arm[a] > near or (sign * eyes[:, a] > near).any():
                    continue
                name, between = "xyz"[a], sorted((sign * near, sign * far))
                found.append(
                    f"the map reaches {end - far:.2f} m past {section.name}, where no camera "
                    f"looks: somebody may be there, and the guard keeps away from them; end it in "
                    f"that wall: [mapping] {'upper' if sign > 0 else 'lower'} {name} between "
                    f"{between[0]:.2f} and {between[1]:.2f}"
                )
    return found


def _box(solid: Solid) -> tuple[Floats, Floats] | None:
    """Corners of a box that stands along the axes; None where it does not, or is none."""
    R, middle = np.abs(solid.T_frame_solid[:3, :3]), solid.T_frame_solid[:3, 3]
    if solid.kind != "box" or np.abs(R - np.rint(R)).max() > SQUARE:
        return None
    return middle - solid.half_extent, middle + solid.half_extent
