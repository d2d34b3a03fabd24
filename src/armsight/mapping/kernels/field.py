"""Compiled bounded distance transform, incremental by columns.

Distances between whole cubes: along one axis two voxels k apart leave a gap of max(|k| - 1, 0)
voxels, so the squared distance of the nearest points of two cubes is a sum over axes and the exact
transform is three separable passes of "minimum over a window plus cost(k)". All is uint8: with a
cap of at most 15 voxels every square fits, and the passes run 32 or 64 voxels an instruction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats32


@njit(cache=True, nogil=True)
def changed_columns(new: Bytes, old: Bytes, counts_unknown: bool, changed: Bytes) -> int:
    """Take over the solid voxels of a state grid; marks the (x, y) columns that differ.

    Of the arguments:
        new: (nx, ny, nz) uint8 state of voxels; old: uint8 solid mask, in and out.
        counts_unknown: whether unknown voxels (0) are solid beside occupied ones (2).
        changed: (nx, ny) uint8 out.

    Returns:
        Number of columns that differ.
    """
    total = 0
    extra = np.uint8(0) if counts_unknown else np.uint8(2)
    nx, ny, nz = new.shape
    for x in range(nx):
        for y in range(ny):
            a = new[x, y]
            b = old[x, y]
            differ: Any = np.uint8(0)
            for z in range(nz):
                s: Any = np.uint8((a[z] == 2) | (a[z] == extra))
                differ |= s ^ b[z]
                b[z] = s
            changed[x, y] = differ
            total += differ
    return total


@njit(cache=True, nogil=True)
def widen(flags: Bytes, reach: int, axis: int, out: Bytes) -> None:
    """Spread (nx, ny) flags by ``reach`` cells along one axis."""
    nx, ny = flags.shape
    for x in range(nx):
        for y in range(ny):
            out[x, y] = 0
    for x in range(nx):
        for y in range(ny):
            if flags[x, y] != 0:
                if axis == 0:
                    for a in range(max(x - reach, 0), min(x + reach + 1, nx)):
                        out[a, y] = 1
                else:
                    for b in range(max(y - reach, 0), min(y + reach + 1, ny)):
                        out[x, b] = 1


@njit(cache=True, nogil=True)
def pass_z(solid: Bytes, todo: Bytes, radius: int, out: Bytes, busy: Bytes) -> None:
    """Squared gap to the nearest solid voxel of the same column, capped at radius^2.

    ``busy`` (nx, ny) tells which columns hold anything below the cap.
    """
    nx, ny, nz = solid.shape
    cap = np.uint8(radius * radius)
    for x in range(nx):
        for y in range(ny):
            if todo[x, y] == 0:
                continue
            s = solid[x, y]
            o = out[x, y]
            any_solid = np.uint8(0)
            for z in range(nz):
                any_solid |= s[z]
                o[z] = cap
            busy[x, y] = any_solid
            if any_solid == 0:
                continue
            run = radius + 1
            for z in range(nz):
                run = 0 if s[z] != 0 else min(run + 1, radius + 1)
                gap = max(run - 1, 0)
                o[z] = np.uint8(gap * gap)
            run = radius + 1
            for z in range(nz - 1, -1, -1):
                run = 0 if s[z] != 0 else min(run + 1, radius + 1)
                gap = max(run - 1, 0)
                o[z] = min(o[z], np.uint8(gap * gap))


@njit(cache=True, nogil=True)
def pass_row(src: Bytes, dst: Bytes, cap: np.uint8, cost: np.uint8) -> None:
    """Dst = min(dst, src + cost), saturating at cap; one column of voxels."""
    limit = np.uint8(cap - cost)
    for z in range(dst.shape[0]):
        a = np.uint8(min(src[z], limit))
        s = np.uint8(a + cost)
        dst[z] = np.uint8(min(dst[z], s))


@njit(cache=True, nogil=True)
def pass_xy(
    g: Bytes, busy_in: Bytes, todo: Bytes, radius: int, axis: int, out: Bytes, busy: Bytes
) -> None:
    """One separable pass along x (axis 0) or y (axis 1); see the module."""
    nx, ny, nz = g.shape
    cap = np.uint8(radius * radius)
    for x in range(nx):
        for y in range(ny):
            if todo[x, y] == 0:
                continue
            o = out[x, y]
            for z in range(nz):
                o[z] = cap
            here = x if axis == 0 else y
            end = nx if axis == 0 else ny
            touched = np.uint8(0)
            for k in range(max(-radius, -here), min(radius + 1, end - here)):
                a = x + k if axis == 0 else x
                b = y if axis == 0 else y + k
                if busy_in[a, b] == 0:
                    continue
                touched = np.uint8(1)
                gap = max(abs(k) - 1, 0)
                pass_row(g[a, b], o, cap, np.uint8(gap * gap))
            busy[x, y] = touched


@njit(cache=True, nogil=True)
def to_metres(squares: Bytes, todo: Bytes, table: Floats32, out: Floats32) -> None:
    """Metric distances of the columns to do; ``table`` (256,) float32 maps squared voxels to m."""
    nx, ny, nz = squares.shape
    for x in range(nx):
        for y in range(ny):
            if todo[x, y] != 0:
                s = squares[x, y]
                o = out[x, y]
                for z in range(nz):
                    o[z] = table[s[z]]
