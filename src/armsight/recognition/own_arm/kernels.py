"""Compiled loops of the registration; plain-numpy twins are in the tests.

A lens is nine numbers: fx, fy, cx, cy, k1, k2, p1, p2, k3. Poses are ``T_camera_base``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import DepthImage, Floats, Floats32, Ints, Ints32, Points, Pose, Poses
from armsight.geometry.camera import PinholeCamera

FACING = 0.25
"""Cosine between a normal and the line of sight below which a surface says little."""


def lens_array(lens: PinholeCamera) -> Floats:
    """The nine numbers of a lens."""
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion])


@njit(cache=True, nogil=True)
def project(x: float, y: float, lens: Floats) -> tuple[float, float]:
    """Pixel of a normalised point, Brown and Conrady's distortion included."""
    k1, k2, p1, p2, k3 = lens[4], lens[5], lens[6], lens[7], lens[8]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return lens[0] * u + lens[2], lens[1] * v + lens[3]


@njit(cache=True, nogil=True)
def rasterise(
    vertices: Points, faces: Ints, lens: Floats, near: float, depth: DepthImage, face: Ints32
) -> None:
    """Draw triangles in the camera's frame through a straight lens, the nearest one wins.

    Args:
        vertices: (n, 3) [m].
        faces: (m, 3).
        lens: of no distortion.
        near: triangles with a corner nearer than this are left out [m].
        depth: (h, w) [m], written; begin with infinity.
        face: (h, w) index of the triangle seen, written; begin with -1.
    """
    h, w = depth.shape
    # Pixel and one over the depth, which is linear over a triangle in the picture.
    seen = np.zeros((vertices.shape[0], 3))
    for i in range(vertices.shape[0]):
        if vertices[i, 2] >= near:
            nearness = 1.0 / vertices[i, 2]
            seen[i, 0] = lens[0] * vertices[i, 0] * nearness + lens[2]
            seen[i, 1] = lens[1] * vertices[i, 1] * nearness + lens[3]
            seen[i, 2] = nearness
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ia, ib, ic = seen[a, 2], seen[b, 2], seen[c, 2]
        if ia == 0.0 or ib == 0.0 or ic == 0.0:
            continue
        ua, va, ub, vb, uc, vc = (
            seen[a, 0], seen[a, 1], seen[b, 0], seen[b, 1], seen[c, 0], seen[c, 1],
        )  # fmt: skip
        area = (ub - ua) * (vc - va) - (vb - va) * (uc - ua)
        # v runs down: a triangle that faces the camera turns the other way round.
        if area >= 0.0:
            continue
        u0, u1 = max(int(np.ceil(min(ua, ub, uc))), 0), min(int(max(ua, ub, uc)), w - 1)
        v0, v1 = max(int(np.ceil(min(va, vb, vc))), 0), min(int(max(va, vb, vc)), h - 1)
        for v in range(v0, v1 + 1):
            for u in range(u0, u1 + 1):
                wa = (ub - u) * (vc - v) - (vb - v) * (uc - u)
                wb = (uc - u) * (va - v) - (vc - v) * (ua - u)
                wc = area - wa - wb
                if wa > 0.0 or wb > 0.0 or wc > 0.0:
                    continue
                z = area / (wa * ia + wb * ib + wc * ic)
                if z < depth[v, u]:
                    depth[v, u] = z
                    face[v, u] = f


@njit(cache=True, nogil=True)
def agreement(
    poses: Poses,
    points: Floats,
    normals: Floats,
    depths: Floats32,
    credit: Floats32,
    lens: Floats,
    tolerance: float,
) -> Floats:
    """(k,) how well depth images agree with an arm at (k, 4, 4) poses, at most 1.

    A point of the surface that faces the camera counts as much as the pixel is worth where the
    depth there is its own, 0 where something stands before it or nothing is read, -1 where the
    camera sees through it.

    Args:
        poses: ``T_camera_base``.
        points: (f, m, 3) of the surface in ``base``, one row a frame.
        normals: (f, m, 3) there.
        depths: (f, h, w) [m], NaN where nothing is read.
        credit: (f, h, w) what a pixel is worth.
        lens: of the depth images.
        tolerance: of a reading [m].
    """
    frames, count = points.shape[0], points.shape[1]
    h, w = depths.shape[1], depths.shape[2]
    out = np.zeros(poses.shape[0])
    for k in range(poses.shape[0]):
        T = poses[k]
        total = 0.0
        for f in range(frames):
            facing, sum_ = 0, 0.0
            for i in range(count):
                p, n = points[f, i], normals[f, i]
                x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
                y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
                z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
                nx = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
                ny = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
                nz = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
                if nx * x + ny * y + nz * z > -FACING * np.sqrt(x * x + y * y + z * z):
                    continue
                facing += 1
                if z < 0.2:
                    continue
                u, v = project(x / z, y / z, lens)
                column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
                if column < 0 or row < 0 or column >= w or row >= h:
                    continue
                d = depths[f, row, column] - z
                if not np.isfinite(d):
                    continue
                if d > 3.0 * tolerance:
                    sum_ -= 1.0
                elif d > -3.0 * tolerance:
                    sum_ += credit[f, row, column] * np.exp(-0.5 * (d / tolerance) ** 2)
            total += sum_ / max(facing, count // 5, 1)
        out[k] = total / frames
    return out


@njit(cache=True, nogil=True)
def normal_equations(
    T: Pose,
    bias: float,
    points: Points,
    normals: Points,
    group: Ints,
    depth: DepthImage,
    rays: Floats,
    lens: Floats,
    window: float,
    sigma: Floats,
    H: Floats,
    g: Floats,
) -> tuple[float, int]:
    """Add a frame's point-to-plane residuals to the normal equations of the pose and the bias.

    Unknown are a twist (translation, rotation) in the camera's frame, applied on the left, and what
    the camera reads too much. Cauchy's weights, of the residual over its standard deviation.

    Args:
        T: ``T_camera_base``.
        bias: of the readings [m].
        points: (m, 3) of the visible surface in ``base``.
        normals: (m, 3) there.
        group: (m,) which of the clusters of residuals each belongs to.
        depth: (h, w) [m].
        rays: (h, w, 2) normalised coordinates of its pixels.
        lens: its own.
        window: readings farther than this from their point belong to something else [m].
        sigma: (3,) of a + b z + c z^2, standard deviation of a reading [m].
        H: (clusters, 7, 7), added to.
        g: (clusters, 7), added to: the gradient of each cluster.

    Returns:
        Weighted sum of squared residuals, and how many there were.
    """
    h, w = depth.shape
    J = np.empty(7)
    cost, used = 0.0, 0
    for i in range(points.shape[0]):
        p, n = points[i], normals[i]
        x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
        y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
        z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
        if z < 0.2:
            continue
        u, v = project(x / z, y / z, lens)
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        if column < 0 or row < 0 or column >= w or row >= h:
            continue
        read = depth[row, column]
        if not np.isfinite(read):
            continue
        nx = T[0, 0] * n[0] + T[0, 1] * n[1] + T[0, 2] * n[2]
        ny = T[1, 0] * n[0] + T[1, 1] * n[1] + T[1, 2] * n[2]
        nz = T[2, 0] * n[0] + T[2, 1] * n[1] + T[2, 2] * n[2]
        if nx * x + ny * y + nz * z > -FACING * np.sqrt(x * x + y * y + z * z):
            continue
        zs = read - bias
        rx, ry = rays[row, column, 0], rays[row, column, 1]
        dx, dy, dz = x - rx * zs, y - ry * zs, z - zs
        if abs(dz) > window or dx * dx + dy * dy + dz * dz > window * window:
            continue
        r = nx * dx + ny * dy + nz * dz
        along = nx * rx + ny * ry + nz
        s = (sigma[0] + sigma[1] * read + sigma[2] * read * read) * abs(along) + 1e-3
        weight = 1.0 / (s * s * (1.0 + (r / (2.0 * s)) ** 2))
        # d(point)/d(rotation) = -[point]x
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
        J[6] = along
        for a in range(7):
            g[group[i], a] += weight * J[a] * r
            for b in range(7):
                H[group[i], a, b] += weight * J[a] * J[b]
        cost += weight * r * r
        used += 1
    return cost, used
