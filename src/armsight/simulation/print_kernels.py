"""Compiled ray casting onto a printed board; plain-numpy twin in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Pose

BLACK, WHITE = 20.0, 245.0
"""Grey levels of ink and paper in full light."""


@njit(cache=True, nogil=True)
def cast_print(
    rays: Floats,
    T_lens_board: Pose,
    image: Bytes,
    sheet: Floats,
    samples: int,
    mean: Floats32,
    cover: Floats32,
) -> None:
    """Brightness of a printed board as each pixel averages it, many rays a pixel.

    Of the arguments:
        rays: (h + 2, w + 2, 2) normalised coordinates of pixel centres, one pixel wider all about,
            so that rays between centres can be interpolated.
        T_lens_board: the board in the lens's frame.
        image: (H, W) the print.
        sheet: (10,) x0, y0 [m], pixels a metre; print error; centre x, y, half extent x, y [m];
            bending along x, y [m] of the board.
        samples: rays along each edge of a pixel.
        mean: (h, w) out: mean grey level of what was hit.
        cover: (h, w) out: share of the rays that hit the print.
    """
    R, t = T_lens_board[:3, :3], T_lens_board[:3, 3]
    ox = -(R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2])
    oy = -(R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2])
    oz = -(R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2])
    x0, y0, per_meter, stretch = sheet[0], sheet[1], sheet[2], 1.0 + sheet[3]
    cx, cy, hx, hy, bx, by = sheet[4], sheet[5], sheet[6], sheet[7], sheet[8], sheet[9]
    rounds = 3 if bx != 0.0 or by != 0.0 else 1
    height, width = image.shape
    for v in range(mean.shape[0]):
        for u in range(mean.shape[1]):
            total, hits = 0.0, 0
            for j in range(samples):
                dv = (j + 0.5) / samples - 0.5
                row = 1 if dv >= 0.0 else -1
                for i in range(samples):
                    du = (i + 0.5) / samples - 0.5
                    side = 1 if du >= 0.0 else -1
                    a, b = abs(du), abs(dv)
                    p = rays[v + 1, u + 1]
                    q = rays[v + 1, u + 1 + side]
                    p2 = rays[v + 1 + row, u + 1]
                    q2 = rays[v + 1 + row, u + 1 + side]
                    rx = (1.0 - b) * (p[0] + a * (q[0] - p[0])) + b * (p2[0] + a * (q2[0] - p2[0]))
                    ry = (1.0 - b) * (p[1] + a * (q[1] - p[1])) + b * (p2[1] + a * (q2[1] - p2[1]))
                    dx = R[0, 0] * rx + R[1, 0] * ry + R[2, 0]
                    dy = R[0, 1] * rx + R[1, 1] * ry + R[2, 1]
                    dz = R[0, 2] * rx + R[1, 2] * ry + R[2, 2]
                    if dz < 1e-6:  # from behind, or along the board
                        continue
                    z = 0.0
                    x = y = 0.0
                    for _ in range(rounds):
                        far = (z - oz) / dz
                        x, y = ox + far * dx, oy + far * dy
                        s, w = (x / stretch - cx) / hx, (y / stretch - cy) / hy
                        z = bx * (s * s - 1.0 / 3.0) + by * (w * w - 1.0 / 3.0)
                    column = (x / stretch - x0) * per_meter
                    line = (y / stretch - y0) * per_meter
                    if 0.0 <= column < width and 0.0 <= line < height:
                        total += image[int(line), int(column)]
                        hits += 1
            share = np.float32(hits) / np.float32(samples * samples)
            cover[v, u] = share
            grey = total / hits if hits > 0 else 0.0
            mean[v, u] = np.float32(BLACK + grey * ((WHITE - BLACK) / 255.0)) if hits > 0 else 0.0
