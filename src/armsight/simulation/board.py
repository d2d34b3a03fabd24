"""A printed board in the cell: where it truly hangs, and how it was really printed.

Drawn once from the seed, as everything that is true: the bracket by a centimetre and three degrees,
the print by two parts in a thousand, its sheet bent by a third of a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armsight.arrays import Floats, Pose
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp
from armsight.simulation.spec import BoardSpec, Print

BRACKET = np.array([0.012, 0.012, 0.012, 0.05, 0.05, 0.05])
"""Standard deviations of where a board hangs [m], [rad]."""
SCALE, BEND = 0.002, 3e-4
"""Of the print's size [1] and of the sheet's bending at its edge [m]."""
THICK = 0.004
"""Of the plate behind the sheet [m]."""
NEAREST = 0.1
"""Nearer to a lens than this the board is not drawn [m]."""


@dataclass(frozen=True)
class BoardUnit:
    """The truth about a board.

    Attributes:
        print: with its errors.
        mounted_on: ``flange`` or ``world``.
        T_mount_board: where it truly hangs.
        glare: brightness of a lamp's reflection on it, 0..1.
    """

    print: Print
    mounted_on: str
    T_mount_board: Pose
    glare: float

    @property
    def sheet(self) -> Floats:
        """(10,) the print's measures as ``print_kernels.cast_print`` takes them."""
        p = self.print
        return np.array([p.x0, p.y0, p.per_meter, p.scale, *p.center, *p.half, *p.bend], float)

    @property
    def plate(self) -> tuple[Floats, Floats]:
        """(3,) centre in the board's frame and (3,) half edges of the plate [m]."""
        p = self.print
        size = np.array(p.image.shape[::-1]) / p.per_meter * (1.0 + p.scale)
        first = np.array([p.x0, p.y0]) * (1.0 + p.scale)
        center = np.append(first + 0.5 * size, 0.5 * THICK)
        return center, np.append(0.5 * size, 0.5 * THICK)


def draw_board(spec: BoardSpec, seed: int) -> BoardUnit:
    """The board that the seed puts there."""
    rng, s = np.random.default_rng((seed, 77)), spec.error
    printed = replace(
        spec.print,
        scale=s * float(rng.normal(0, SCALE)),
        bend=(s * float(rng.normal(0, BEND)), s * float(rng.normal(0, BEND))),
    )
    off = s * rng.normal(0, 1, 6) * BRACKET
    return BoardUnit(printed, spec.mounted_on, spec.T_mount_board @ exp(off), spec.glare)


def board_window(
    printed: Print, lens: PinholeCamera, T_lens_board: Pose
) -> tuple[int, int, int, int] | None:
    """Pixels that the print may touch: u0, v0, u1, v1; None where the lens cannot see its face."""
    h, w = printed.image.shape
    x = printed.x0 + np.array([0, w, w, 0, w / 2, w, w / 2, 0]) / printed.per_meter
    y = printed.y0 + np.array([0, 0, h, h, 0, h / 2, h, h / 2]) / printed.per_meter
    corners = np.column_stack([x, y, np.zeros(8)]) @ T_lens_board[:3, :3].T + T_lens_board[:3, 3]
    if corners[:, 2].min() < NEAREST or T_lens_board[:3, 2] @ T_lens_board[:3, 3] <= 0.0:
        return None
    around = np.hypot(corners[:, 0], corners[:, 1]) / corners[:, 2]
    if around.max() > 1.3 * np.hypot(lens.width, lens.height) / (2 * lens.fx):
        return None
    uv = lens.project(corners)
    u0, v0 = np.floor(uv.min(0)).astype(int) - 6
    u1, v1 = np.ceil(uv.max(0)).astype(int) + 7
    u0, v0, u1, v1 = max(u0, 0), max(v0, 0), min(u1, lens.width), min(v1, lens.height)
    return (u0, v0, u1, v1) if u1 - u0 > 4 and v1 - v0 > 4 else None
