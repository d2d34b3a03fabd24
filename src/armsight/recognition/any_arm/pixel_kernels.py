"""Compiled loops over pixels: crops, the edges of masks, outlines; numpy twins are in the tests."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import DepthImage, Floats, Floats32, Ints, Ints32, Mask, Poses, Rotation3
from armsight.recognition.own_arm.kernels import project

FRONT = 0.05
"""Depth of a ray of length about one from which it is in front of the camera."""
NOWHERE = -1e4
STEEP = 0.3
"""Slope of the distance from which it tells where the edge is."""


@njit(cache=True, nogil=True)
def crop_map(R: Rotation3, f: float, side: int, lens: Floats) -> tuple[Floats32, Floats32]:
    """Where the pixels of a turned camera lie in a picture.

    Args:
        R: (3, 3) its axes in the picture's camera.
        f: its focal length [px]; the principal point is in the middle.
        side: its width and height [px].
        lens: nine numbers of the picture's.

    Returns:
        (side, side) u and v [px of the picture].
    """
    u, v = np.empty((side, side), np.float32), np.empty((side, side), np.float32)
    middle = 0.5 * (side - 1)
    for row in range(side):
        y = (row - middle) / f
        for column in range(side):
            x = (column - middle) / f
            z = R[2, 0] * x + R[2, 1] * y + R[2, 2]
            a, b = NOWHERE, NOWHERE
            if z > FRONT:
                a, b = project(
                    (R[0, 0] * x + R[0, 1] * y + R[0, 2]) / z,
                    (R[1, 0] * x + R[1, 1] * y + R[1, 2]) / z,
                    lens,
                )
            u[row, column], v[row, column] = a, b
    return u, v


@njit(cache=True, nogil=True)
def guided(
    mean: Floats32,
    mean_p: Floats32,
    pairs: Floats32,
    products: Floats32,
    smooth: float,
    slope: Floats32,
    offset: Floats32,
) -> None:
    """In each window the linear function of the colours that is nearest to a mask.

    Args:
        mean: (h, w, 3) of the colours, over the window about each pixel as all of these are.
        mean_p: (h, w) of the mask.
        pairs: (h, w, 6) of the products of two colours: 00, 01, 02, 11, 12, 22.
        products: (h, w, 3) of those of colour and mask.
        smooth: variance of the picture that counts as none.
        slope: (h, w, 3), written.
        offset: (h, w), written.
    """
    for r in range(mean.shape[0]):
        for k in range(mean.shape[1]):
            x, y, z = mean[r, k, 0], mean[r, k, 1], mean[r, k, 2]
            q = pairs[r, k]
            # Doubles: what is left of two means that are nearly the same is small.
            a, b, c = q[0] - x * x + smooth, float(q[1] - x * y), float(q[2] - x * z)
            d, e, f = q[3] - y * y + smooth, float(q[4] - y * z), q[5] - z * z + smooth
            A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
            D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
            whole = a * A + b * B + c * C
            o = mean_p[r, k]
            i = products[r, k, 0] - x * o
            j = products[r, k, 1] - y * o
            m = products[r, k, 2] - z * o
            s0 = (A * i + B * j + C * m) / whole
            s1 = (B * i + D * j + E * m) / whole
            s2 = (C * i + E * j + F * m) / whole
            slope[r, k, 0], slope[r, k, 1], slope[r, k, 2] = s0, s1, s2
            offset[r, k] = o - s0 * x - s1 * y - s2 * z


@njit(cache=True, nogil=True)
def rim_pulls(
    depth: DepthImage,
    face: Ints32,
    owner: Ints,
    poses: Poses,
    f: float,
    distance: Floats,
    away: Mask,
    reach: float,
    sharp: float,
    along: float,
    every: int,
) -> tuple[int, Ints, Floats, Floats, Floats]:
    """Points of a drawn arm's outline and where on the mask's edge they should be.

    Args:
        depth: (n, n) [m] of the drawn arm.
        face: (n, n) its triangle there, -1 where none is.
        owner: (triangles,) link of each.
        poses: (links, 4, 4) ``T_camera_link``.
        f: focal length [pixels of the drawing]; the principal point is in the middle.
        distance: (n, n) from the mask's edge, above 0 outside [pixels of the drawing].
        away: (n, n) where the picture's own edge is far.
        reach: from within which an edge draws [pixels of the drawing].
        sharp: standard deviation of the edge [x / z].
        along: of the place along it [x / z].
        every: neighbours on an outline err alike: one of so many is kept.

    Returns:
        How many there are; and of the m that are kept the (m,) links, (m, 3) places there [m], and
        (m, 2) where they should be seen, with (m, 2, 2) covariances [x / z].
    """
    side = depth.shape[0]
    middle = 0.5 * (side - 1)
    narrow, wide = sharp * sharp, along * along
    most = side * side // every + 1
    link, point = np.empty(most, np.int64), np.empty((most, 3))
    at, covariance = np.empty((most, 2)), np.empty((most, 2, 2))
    found = 0
    for row in range(1, side - 1):
        for column in range(1, side - 1):
            if face[row, column] < 0 or not away[row, column]:
                continue
            lonely = False
            for r in range(row - 1, row + 2):
                for c in range(column - 1, column + 2):
                    lonely = lonely or face[r, c] < 0
            if not lonely:
                continue
            # A drawn pixel at the rim has its middle half a pixel within the edge.
            off = distance[row, column] + 0.5
            down = 0.5 * (distance[row + 1, column] - distance[row - 1, column])
            right = 0.5 * (distance[row, column + 1] - distance[row, column - 1])
            slope = np.sqrt(down * down + right * right)
            if abs(off) >= reach or slope <= STEEP:
                continue
            y, x = down / slope, right / slope
            edge_row = min(max(int(np.rint(row - off * y)), 0), side - 1)
            edge_column = min(max(int(np.rint(column - off * x)), 0), side - 1)
            if not away[edge_row, edge_column]:
                continue
            if found % every == 0:
                k = found // every
                z = float(depth[row, column])
                u, v = (column - middle) / f, (row - middle) / f
                link[k] = owner[face[row, column]]
                T = poses[link[k]]
                a, b, c = u * z - T[0, 3], v * z - T[1, 3], z - T[2, 3]
                for i in range(3):
                    point[k, i] = T[0, i] * a + T[1, i] * b + T[2, i] * c
                at[k, 0], at[k, 1] = u - off * x / f, v - off * y / f
                covariance[k, 0, 0] = narrow * x * x + wide * y * y
                covariance[k, 1, 1] = narrow * y * y + wide * x * x
                covariance[k, 0, 1] = covariance[k, 1, 0] = (narrow - wide) * x * y
            found += 1
    kept = (found + every - 1) // every
    return found, link[:kept], point[:kept], at[:kept], covariance[:kept]
