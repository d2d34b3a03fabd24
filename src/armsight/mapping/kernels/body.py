"""Compiled loops over the arm's own body: link distance fields against images and voxels.

A link's field is a small grid, in the link's frame, of the signed distance to its surface; all
fields of a body lie one after the other in one flat array.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Points, Poses, Vector3
from armsight.mapping.kernels.pixels import ROBOT, VALID

MIDDLE, WHOLE = 1, 2
"""What the arm fills of a voxel."""


@njit(cache=True, nogil=True)
def triangle_distance2(
    px: float, py: float, pz: float, a: Vector3, b: Vector3, c: Vector3
) -> float:
    """Squared distance [m^2] of a point to a triangle (Ericson, Real-Time Collision Detection)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = px - a[0], py - a[1], pz - a[2]
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return apx * apx + apy * apy + apz * apz
    bpx, bpy, bpz = px - b[0], py - b[1], pz - b[2]
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return bpx * bpx + bpy * bpy + bpz * bpz
    cpx, cpy, cpz = px - c[0], py - c[1], pz - c[2]
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return cpx * cpx + cpy * cpy + cpz * cpz
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3) if d1 != d3 else 0.0
        x, y, z = apx - s * abx, apy - s * aby, apz - s * abz
        return x * x + y * y + z * z
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / (d2 - d6) if d2 != d6 else 0.0
        x, y, z = apx - s * acx, apy - s * acy, apz - s * acz
        return x * x + y * y + z * z
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) + (d5 - d6)
        s = (d4 - d3) / t if t != 0.0 else 0.0
        x = bpx - s * (c[0] - b[0])
        y = bpy - s * (c[1] - b[1])
        z = bpz - s * (c[2] - b[2])
        return x * x + y * y + z * z
    t = va + vb + vc
    if t == 0.0:
        return apx * apx + apy * apy + apz * apz
    v, q = vb / t, vc / t
    x = apx - v * abx - q * acx
    y = apy - v * aby - q * acy
    z = apz - v * abz - q * acz
    return x * x + y * y + z * z


@njit(cache=True, nogil=True)
def mesh_distance(
    vertices: Points,
    faces: Ints,
    origin: Vector3,
    cell: float,
    band: float,
    field: Floats32,
    nearest: Ints32,
) -> None:
    """Lower the nodes of a field to their distance from a mesh, within a band of each triangle.

    Of the arguments:
        vertices: (n, 3) float64 [m]; faces: (m, 3) int64.
        origin: (3,) position of node (0, 0, 0) [m]; cell: node spacing [m].
        band: nodes no farther than this from the mesh become exact [m].
        field: (nx, ny, nz) float32, in and out.
        nearest: (nx, ny, nz) int32, in and out: the triangle nearest to each node touched.
    """
    for f in range(faces.shape[0]):
        a = vertices[faces[f, 0]]
        b = vertices[faces[f, 1]]
        c = vertices[faces[f, 2]]
        low = np.empty(3, np.int64)
        high = np.empty(3, np.int64)
        for d in range(3):
            lo = min(a[d], min(b[d], c[d])) - band
            hi = max(a[d], max(b[d], c[d])) + band
            low[d] = max(int(np.ceil((lo - origin[d]) / cell)), 0)
            high[d] = min(int(np.floor((hi - origin[d]) / cell)), field.shape[d] - 1)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                for k in range(low[2], high[2] + 1):
                    d2 = triangle_distance2(
                        origin[0] + i * cell, origin[1] + j * cell, origin[2] + k * cell, a, b, c
                    )
                    old = field[i, j, k]
                    if d2 < old * old:
                        field[i, j, k] = np.sqrt(d2)
                        nearest[i, j, k] = f


@njit(cache=True, nogil=True)
def spread_distance(
    vertices: Points,
    faces: Ints,
    origin: Vector3,
    cell: float,
    seed: Ints32,
    nearest: Ints32,
    field: Floats32,
) -> None:
    """Distances of the nodes that no triangle touched: to the triangle of the nearest one that was.

    Of the arguments:
        seed: (3, nx, ny, nz) int32 index of that node.
    """
    nx, ny, nz = field.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if nearest[i, j, k] >= 0:
                    continue
                f = nearest[seed[0, i, j, k], seed[1, i, j, k], seed[2, i, j, k]]
                d2 = triangle_distance2(
                    origin[0] + i * cell,
                    origin[1] + j * cell,
                    origin[2] + k * cell,
                    vertices[faces[f, 0]],
                    vertices[faces[f, 1]],
                    vertices[faces[f, 2]],
                )
                field[i, j, k] = np.sqrt(d2)


@njit(cache=True, nogil=True)
def winding(vertices: Points, faces: Ints, points: Points, inside: Bytes) -> None:
    """Tell which points a mesh encloses: those with a generalised winding number over 1/2.

    Works for meshes with gaps and overlaps (Jacobson, Kavan, Sorkine-Hornung 2013). Far triangles
    count as dipoles, near ones by their exact solid angle (Van Oosterom and Strackee 1983).

    Of the arguments:
        points: (n, 3) [m]; inside: (n,) uint8 out.
    """
    m = faces.shape[0]
    center = np.empty((m, 3))
    area = np.empty((m, 3))
    reach2 = np.empty(m)
    for f in range(m):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        area[f, 0] = 0.5 * (u1 * v2 - u2 * v1)
        area[f, 1] = 0.5 * (u2 * v0 - u0 * v2)
        area[f, 2] = 0.5 * (u0 * v1 - u1 * v0)
        longest = 0.0
        for d in range(3):
            center[f, d] = (a[d] + b[d] + c[d]) / 3.0
        for corner in (a, b, c):
            r = 0.0
            for d in range(3):
                r += (corner[d] - center[f, d]) ** 2
            longest = max(longest, r)
        reach2[f] = 9.0 * longest
    for p in range(points.shape[0]):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        total = 0.0
        for f in range(m):
            dx, dy, dz = center[f, 0] - x, center[f, 1] - y, center[f, 2] - z
            r2 = dx * dx + dy * dy + dz * dz
            if r2 > reach2[f]:
                s = area[f, 0] * dx + area[f, 1] * dy + area[f, 2] * dz
                total += s / (r2 * np.sqrt(r2))
            else:
                total += _solid_angle(
                    vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]], x, y, z
                )
        inside[p] = 1 if total > 2.0 * np.pi else 0


@njit(cache=True, nogil=True)
def _solid_angle(a: Vector3, b: Vector3, c: Vector3, x: float, y: float, z: float) -> float:
    """Signed solid angle of a triangle seen from a point [sr]."""
    ax, ay, az = a[0] - x, a[1] - y, a[2] - z
    bx, by, bz = b[0] - x, b[1] - y, b[2] - z
    cx, cy, cz = c[0] - x, c[1] - y, c[2] - z
    la = np.sqrt(ax * ax + ay * ay + az * az)
    lb = np.sqrt(bx * bx + by * by + bz * bz)
    lc = np.sqrt(cx * cx + cy * cy + cz * cz)
    triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    below = la * lb * lc
    below += (ax * bx + ay * by + az * bz) * lc
    below += (bx * cx + by * cy + bz * cz) * la
    below += (cx * ax + cy * ay + cz * az) * lb
    return 2.0 * np.arctan2(triple, below)


@njit(cache=True, nogil=True)
def capsule_distance(
    start: Vector3, end: Vector3, radius: float, origin: Vector3, cell: float, field: Floats32
) -> None:
    """Lower the nodes of a field to their signed distance from a capsule; see mesh_distance."""
    nx, ny, nz = field.shape
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    length2 = dx * dx + dy * dy + dz * dz
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                x = origin[0] + i * cell - start[0]
                y = origin[1] + j * cell - start[1]
                z = origin[2] + k * cell - start[2]
                s = 0.0
                if length2 > 0.0:
                    s = min(max((x * dx + y * dy + z * dz) / length2, 0.0), 1.0)
                x -= s * dx
                y -= s * dy
                z -= s * dz
                d = np.sqrt(x * x + y * y + z * z) - radius
                if d < field[i, j, k]:
                    field[i, j, k] = d


@njit(cache=True, nogil=True)
def interpolate(
    values: Floats32, offset: int, nx: int, ny: int, nz: int, gx: float, gy: float, gz: float
) -> float:
    """Trilinear value at grid coordinates that lie inside the field."""
    i = int(gx)
    j = int(gy)
    k = int(gz)
    if i > nx - 2:
        i = nx - 2
    if j > ny - 2:
        j = ny - 2
    if k > nz - 2:
        k = nz - 2
    a = np.float32(gx - i)
    b = np.float32(gy - j)
    c = np.float32(gz - k)
    p = offset + (i * ny + j) * nz + k
    q = p + ny * nz
    one = np.float32(1.0)
    v00 = values[p] * (one - c) + values[p + 1] * c
    v01 = values[p + nz] * (one - c) + values[p + nz + 1] * c
    v10 = values[q] * (one - c) + values[q + 1] * c
    v11 = values[q + nz] * (one - c) + values[q + nz + 1] * c
    v0 = v00 * (one - b) + v01 * b
    v1 = v10 * (one - b) + v11 * b
    return v0 * (one - a) + v1 * a


@njit(cache=True, nogil=True)
def label_body(
    depth: Floats32,
    label: Bytes,
    rays: Floats32,
    rect: Ints,
    T_field_camera: Poses,
    values: Floats32,
    offset: Ints,
    shape: Ints,
    cell: float,
    tolerance: Floats,
    noise: Floats,
    sigmas: float,
) -> int:
    """Label as ROBOT the valid pixels whose point lies on or in a body's link.

    Of the arguments:
        rect: (m, 4) int64 first and last column, first and last row that can see each field.
        T_field_camera: (m, 4, 4) camera in each field's grid frame, lengths in cells.
        values, offset, shape: the fields: flat float32 [m], (m,) starts, (m, 3) nodes.
        tolerance: (m, 2) a point is the link within t0 [m] + t1 [rad] x depth + sigmas x sigma.

    Returns:
        Number of pixels labelled.
    """
    found = 0
    for f in range(offset.shape[0]):
        T = T_field_camera[f]
        nx, ny, nz = shape[f, 0], shape[f, 1], shape[f, 2]
        ox, oy, oz = T[0, 3], T[1, 3], T[2, 3]
        for v in range(rect[f, 2], rect[f, 3] + 1):
            for u in range(rect[f, 0], rect[f, 1] + 1):
                if label[v, u] != VALID:
                    continue
                z = depth[v, u]
                rx = rays[v, u, 0]
                ry = rays[v, u, 1]
                gx = z * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + ox
                if not (gx >= 0.0 and gx <= nx - 1):
                    continue
                gy = z * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + oy
                if not (gy >= 0.0 and gy <= ny - 1):
                    continue
                gz = z * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + oz
                if not (gz >= 0.0 and gz <= nz - 1):
                    continue
                d = interpolate(values, offset[f], nx, ny, nz, gx, gy, gz)
                limit = tolerance[f, 0] + tolerance[f, 1] * z
                limit += sigmas * (noise[0] + noise[1] * z + noise[2] * z * z)
                if d <= limit:
                    label[v, u] = ROBOT
                    found += 1
    return found


@njit(cache=True, nogil=True)
def mark_body(
    T_field_base: Poses,
    box: Ints,
    values: Floats32,
    offset: Ints,
    shape: Ints,
    origin: Vector3,
    voxel: float,
    limits: tuple[float, float, float],
    near: Bytes,
    filled: Bytes,
    listed: Ints32,
) -> int:
    """Mark the voxels that are close to a link, and those that it fills.

    Of the arguments:
        limits: a voxel is near, its middle or all of it is filled, where its centre is within these
            of a link [m], negative inside; from large to small.
        near: (nx, ny, nz) uint8, set to 1; filled: the same, set to MIDDLE or WHOLE.
        listed: (nx ny nz,) out: flat indices of the voxels that were not near before.
        T_field_base: (m, 4, 4) base in each field's grid frame, lengths in cells.
        box: (m, 6) int64 voxel ranges i0 i1 j0 j1 k0 k1 (inclusive, inside the grid).

    Returns:
        How many are listed.
    """
    count = 0
    near_limit, middle_limit, whole_limit = limits
    for f in range(offset.shape[0]):
        T = T_field_base[f]
        nx, ny, nz = shape[f, 0], shape[f, 1], shape[f, 2]
        for i in range(box[f, 0], box[f, 1] + 1):
            x = origin[0] + (i + 0.5) * voxel
            for j in range(box[f, 2], box[f, 3] + 1):
                y = origin[1] + (j + 0.5) * voxel
                for k in range(box[f, 4], box[f, 5] + 1):
                    z = origin[2] + (k + 0.5) * voxel
                    gx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
                    gy = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
                    gz = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
                    if gx < 0.0 or gy < 0.0 or gz < 0.0:
                        continue
                    if gx > nx - 1 or gy > ny - 1 or gz > nz - 1:
                        continue
                    d = interpolate(values, offset[f], nx, ny, nz, gx, gy, gz)
                    if d > near_limit:
                        continue
                    if d <= middle_limit:
                        fills = WHOLE if d <= whole_limit else MIDDLE
                        filled[i, j, k] = max(filled[i, j, k], np.uint8(fills))
                    if near[i, j, k] == 0:
                        near[i, j, k] = 1
                        listed[count] = (i * near.shape[1] + j) * near.shape[2] + k
                        count += 1
    return count
