"""Compiled bounded distance transform, plane by plane.

Distances between whole cubes: along one axis two voxels k apart leave a gap of max(|k| - 1, 0)
voxels, so the squared distance of the nearest points of two cubes is a sum over axes and the exact
transform is three separable passes of "minimum over a window plus cost(k)". All is uint8: with a
cap of at most 15 voxels every square fits. Planes of equal x are kept flat, with as many empty
voxels as the cap behind every row of z, so that a shift along y or z is a shift of the whole plane
and the passes run 32 or 64 voxels an instruction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats32


@njit(cache=True, nogil=True)
def changed_planes(new: Bytes, old: Bytes, counts_unknown: bool, changed: Bytes) -> int:
    """Take over the solid voxels of a state grid; marks the planes of equal x that differ.

    Of the arguments:
        new: (nx, ny, nz) uint8 state of voxels; old: uint8 solid mask, in and out.
        counts_unknown: whether unknown voxels (0) are solid beside occupied ones (2).
        changed: (nx,) uint8 out.

    Returns:
        Number of planes that differ.
    """
    total = 0
    extra = np.uint8(0) if counts_unknown else np.uint8(2)
    for x in range(new.shape[0]):
        a = new[x].reshape(-1)
        b = old[x].reshape(-1)
        differ: Any = np.uint8(0)
        for v in range(a.shape[0]):
            s: Any = np.uint8((a[v] == 2) | (a[v] == extra))
            differ |= s ^ b[v]
            b[v] = s
        changed[x] = differ
        total += differ
    return total


@njit(cache=True, nogil=True)
def _lower(src: Bytes, dst: Bytes, cap: np.uint8, cost: np.uint8) -> None:
    """Dst = min(dst, src + cost), saturating at cap."""
    limit = np.uint8(cap - cost)
    for v in range(dst.shape[0]):
        a = np.uint8(min(src[v], limit))
        s = np.uint8(a + cost)
        dst[v] = np.uint8(min(dst[v], s))


@njit(cache=True, nogil=True)
def _shifts(src: Bytes, stride: int, radius: int, dst: Bytes) -> None:
    """Dst = least of src shifted by up to ``radius`` strides either way, plus the gap's square."""
    size = src.shape[0]
    cap = np.uint8(radius * radius)
    for v in range(size):
        dst[v] = src[v]
    for k in range(1, radius + 1):
        step = k * stride
        if step >= size:
            break
        cost = np.uint8((k - 1) * (k - 1))
        _lower(src[step:], dst[: size - step], cap, cost)
        _lower(src[: size - step], dst[step:], cap, cost)


@njit(cache=True, nogil=True)
def pass_zy(solid: Bytes, changed: Bytes, radius: int, out: Bytes) -> None:
    """Squared gap to the nearest solid voxel of the same plane, for the planes that changed.

    Of the arguments:
        solid: (nx, ny, nz) uint8; changed: (nx,) uint8.
        out: (nx, ny (nz + radius)) uint8 in and out; the last ``radius`` of each row hold nothing
            of the grid.
    """
    nx, ny, nz = solid.shape
    cap = np.uint8(radius * radius)
    row = nz + radius
    marks = np.full(ny * row, cap, np.uint8)
    along_z = np.empty(ny * row, np.uint8)
    for x in range(nx):
        if changed[x] == 0:
            continue
        for y in range(ny):
            s = solid[x, y]
            m = marks[y * row : y * row + nz]
            for z in range(nz):
                m[z] = np.uint8(0) if s[z] != 0 else cap
        _shifts(marks, 1, radius, along_z)
        _shifts(along_z, row, radius, out[x])


@njit(cache=True, nogil=True)
def pass_x(
    planes: Bytes, changed: Bytes, radius: int, table: Floats32, before: Floats32, out: Floats32
) -> None:
    """The last pass, and metres; planes out of reach of every change are taken over.

    Of the arguments:
        planes: of :func:`pass_zy`.
        table: (256,) float32 maps squared voxels to metres.
        before, out: (nx, ny, nz) float32 [m] of the last round and of this one.
    """
    nx, ny, nz = out.shape
    cap = np.uint8(radius * radius)
    row = nz + radius
    best = np.empty(ny * row, np.uint8)
    for x in range(nx):
        low, high = max(x - radius, 0), min(x + radius + 1, nx)
        touched = False
        for a in range(low, high):
            touched |= changed[a] != 0
        if not touched:
            out[x] = before[x]
            continue
        here = planes[x]
        for v in range(best.shape[0]):
            best[v] = here[v]
        for a in range(low, high):
            gap = max(abs(a - x) - 1, 0)
            if a != x:
                _lower(planes[a], best, cap, np.uint8(gap * gap))
        for y in range(ny):
            b = best[y * row : y * row + nz]
            o = out[x, y]
            for z in range(nz):
                o[z] = table[b[z]]
