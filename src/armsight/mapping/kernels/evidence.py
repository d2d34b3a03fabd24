"""Compiled bookkeeping of evidence: what is occupied, by whose word, since when."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Ints, Ints32, Pose, Shorts
from armsight.mapping.kernels.body import MIDDLE, WHOLE
from armsight.mapping.kernels.solids import solid_distance
from armsight.mapping.snapshot import OCCUPIED, UNKNOWN

SKIN = 2.0
"""A look at a voxel whose middle the arm fills ends this many voxels before it: on the arm."""


@njit(cache=True, nogil=True)
def add_hits(
    hits: Ints32,
    strong: Bytes,
    n: int,
    stamp: float,
    bit: int,
    window: float,
    occupied: Bytes,
    seen_by: Bytes,
    last: Floats,
    weak: Floats,
    looks: Bytes,
    listed: Ints32,
    count: int,
) -> int:
    """Let one frame's hits occupy voxels.

    Of the arguments:
        hits, strong, n: flat voxel indices, 1 where sighting is strong, and how many.
        stamp: exposure of the frame [s]; bit: the camera's bit in ``seen_by``.
        window: a weak sighting counts when another came no longer ago than this [s].
        occupied, seen_by: uint8 per voxel, in and out; last, weak: float64 per voxel, times of the
            last sighting that counts and of the last weak one [s], in and out.
        looks: uint8 per voxel, in and out: looks since that found nothing, see :func:`add_looks`.
        listed: (capacity,) int32 list of occupied voxels; count: its length.

    Returns:
        The new length of the list.
    """
    for a in range(n):
        v = hits[a]
        if occupied[v] == 0:
            if strong[a] == 0 and not (stamp - weak[v] <= window):
                weak[v] = stamp
                continue
            occupied[v] = 1
            seen_by[v] = 0
            listed[count] = v
            count += 1
        seen_by[v] |= bit
        last[v] = max(last[v], stamp)  # cameras differ in latency: an older picture may come later
        looks[v] = 0
    return count


@njit(cache=True, nogil=True)
def add_looks(
    image: Shorts,
    units: float,
    lens: Floats,
    T: Pose,
    near: float,
    noise: Floats,
    tolerance: Any,
    inside: Bytes,
    solids: Any,
    origin: Floats,
    voxel: float,
    shape: Ints,
    body: Bytes,
    stamp: float,
    last: Floats,
    looks: Bytes,
    listed: Ints32,
    count: int,
) -> None:
    """Count the looks that reached the middle of an occupied voxel and did not hit it.

    No look reaches the middle of one that the arm fills, where the arm was taken for something else
    while its joints lied, say; there one that ends right before it, on the arm, found nothing. Nor
    does one reach what is inside of a declared solid; there one that ends on that solid's surface
    found nothing: nobody sees what is behind it.

    Of the arguments:
        image: (h, w) uint16 depth through an ideal lens, ``units`` a metre, 0 for no return.
        lens: (4,) fx fy cx cy of it; T: camera in base; near: its least depth [m].
        noise: (3,) a b c of sigma(z) = a + b z + c z^2 [m]; tolerance: as in
            :func:`~armsight.mapping.kernels.hits.collect_hits`.
        inside: uint8 per voxel, 1 + index of the declared solid that its middle is in, or 0.
        solids: of :attr:`StaticGeometry.table`.
        origin, voxel, shape: of the grid; body: uint8 per voxel, what the arm fills of each.
        stamp: exposure of the frame [s]; last: of each voxel's last sighting [s].
        looks: uint8 per voxel, in and out.
    """
    h, w = image.shape
    ny, nz = shape[1], shape[2]
    kinds, sizes, T_solid_base, coarse = solids
    margin, angle, sigmas = tolerance
    for a in range(count):
        v = listed[a]
        if last[v] >= stamp:
            continue
        x = origin[0] + (v // (nz * ny) + 0.5) * voxel - T[0, 3]
        y = origin[1] + ((v // nz) % ny + 0.5) * voxel - T[1, 3]
        z = origin[2] + (v % nz + 0.5) * voxel - T[2, 3]
        depth = T[0, 2] * x + T[1, 2] * y + T[2, 2] * z
        if depth <= near:
            continue
        column = lens[0] * (T[0, 0] * x + T[1, 0] * y + T[2, 0] * z) / depth + lens[2] + 0.5
        row = lens[1] * (T[0, 1] * x + T[1, 1] * y + T[2, 1] * z) / depth + lens[3] + 0.5
        if not (0.0 <= column < w and 0.0 <= row < h):
            continue
        if body[v] == MIDDLE:
            depth -= SKIN * voxel
        seen = image[int(row), int(column)] / units
        found_nothing = seen > depth
        if inside[v] != 0 and near < seen <= depth:
            s = inside[v] - 1
            far = seen / depth
            px, py, pz = T[0, 3] + far * x, T[1, 3] + far * y, T[2, 3] + far * z
            sigma = noise[0] + seen * (noise[1] + seen * noise[2])
            limit = margin + angle * seen + sigmas * sigma
            at = solid_distance(kinds[s], sizes[s], T_solid_base[s], px, py, pz)
            found_nothing = -limit - coarse[s] <= at <= limit
        if found_nothing and looks[v] < 255:
            looks[v] += 1


@njit(cache=True, nogil=True)
def clear_seen_through(
    free: Bytes,
    body: Bytes,
    stamp: float,
    bit: int,
    hold: float,
    occupied: Bytes,
    seen_by: Bytes,
    last: Floats,
    looks: Bytes,
    enough: int,
    forget: float,
    listed: Ints32,
    count: int,
) -> int:
    """Free the occupied voxels that one frame saw through, and withdraw what was not confirmed.

    The camera that hit a voxel clears its own word at once; another camera's word stands for
    ``hold`` [s] after its last sighting, so that two cameras that disagree about a voxel at an
    edge leave it occupied.

    Some voxels can never be seen through: those that a declared solid's surface crosses the view
    of, say. A stray sighting there would stand for ever. It is withdrawn when, for ``forget`` [s],
    nobody hit the voxel though ``enough`` looks reached its middle; the voxel is then unknown.

    Of the arguments:
        free: uint8 per voxel, 1 where this frame saw through the whole voxel.
        body: uint8 per voxel, what the arm fills of each: what it fills wholly holds nothing else.

    Returns:
        The new length of the list; the order of the rest is kept.
    """
    kept = 0
    for a in range(count):
        v = listed[a]
        gone = body[v] == WHOLE
        if (free[v] != 0 or gone) and last[v] < stamp:
            seen_by[v] &= ~bit
            if seen_by[v] == 0 or stamp - last[v] >= hold or gone:
                occupied[v] = 0
                seen_by[v] = 0
                continue
        elif looks[v] >= enough and stamp - last[v] >= forget:
            occupied[v] = 0
            seen_by[v] = 0
            continue
        listed[kept] = v
        kept += 1
    return kept


@njit(cache=True, nogil=True)
def _fill(value: int, out: Bytes) -> None:
    for v in range(out.shape[0]):
        out[v] = np.uint8(value)


@njit(cache=True, nogil=True)
def _join(more: Bytes, out: Bytes) -> None:
    for v in range(out.shape[0]):
        out[v] = np.uint8(out[v] | more[v])


@njit(cache=True, nogil=True)
def _occupy(a: Bytes, b: Bytes, out: Bytes) -> None:
    for v in range(out.shape[0]):
        out[v] = np.uint8(OCCUPIED) if (a[v] | b[v]) != 0 else out[v]


@njit(cache=True, nogil=True)
def compose_state(free: Any, alive: Bytes, occupied: Bytes, static: Bytes, state: Bytes) -> None:
    """State of every voxel from the newest frame of each living camera.

    Of the arguments:
        free: (cameras, n) uint8, 1 (that is FREE) where a camera sees through the voxel.
        alive: (cameras,) uint8; occupied, static: (n,) uint8; state: (n,) uint8 out.
    """
    n = state.shape[0]
    block = 8192
    for start in range(0, n, block):
        stop = min(start + block, n)
        out = state[start:stop]
        _fill(UNKNOWN, out)
        for c in range(free.shape[0]):
            if alive[c] != 0:
                _join(free[c, start:stop], out)
        _occupy(occupied[start:stop], static[start:stop], out)


@njit(cache=True, nogil=True)
def keep_clusters(
    listed: Ints32, count: int, occupied: Bytes, shape: Ints, neighbors: int, kept: Ints32
) -> int:
    """Those occupied voxels that have at least so many occupied ones among their 26 neighbours.

    Returns:
        Their number; their indices are in ``kept``, in the order of ``listed``.
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    n = 0
    for a in range(count):
        v = listed[a]
        k = v % nz
        j = (v // nz) % ny
        i = v // (nz * ny)
        found = -1  # itself
        for x in range(max(i - 1, 0), min(i + 2, nx)):
            for y in range(max(j - 1, 0), min(j + 2, ny)):
                for z in range(max(k - 1, 0), min(k + 2, nz)):
                    found += occupied[(x * ny + y) * nz + z]
        if found >= neighbors:
            kept[n] = v
            n += 1
    return n
