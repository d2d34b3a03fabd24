"""Compiled set operations on voxel sets packed to bits along z, 64 voxels a word.

A set is (nx + 2 p, ny + 2 p, words) uint64 with a rim of p voxels on every side that stands for
the world outside: voxel (x, y, z) of the grid is bit (z + p) % 64 of word (z + p) // 64 in row
(x + p, y + p). ``depth`` is the number of bits in use, nz + 2 p; bits beyond it are zero.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ONE = np.uint64(1)


@njit(cache=True, nogil=True)
def pack_room(state, blocked, rim, bits):
    """The set of voxels where someone unseen could be: neither free nor blocked; the rim is too.

    Of the arguments:
        state: (nx, ny, nz) uint8 (1 is free); blocked: uint8, declared solids and the arm itself.
    """
    nx, ny, nz = state.shape
    words = bits.shape[2]
    depth = nz + 2 * rim
    for x in range(bits.shape[0]):
        for y in range(bits.shape[1]):
            for w in range(words):
                used = min(64, depth - 64 * w)
                bits[x, y, w] = ~np.uint64(0) >> np.uint64(64 - used)
    for x in range(nx):
        for y in range(ny):
            row = bits[x + rim, y + rim]
            s = state[x, y]
            b = blocked[x, y]
            for z in range(nz):
                if s[z] == 1 or b[z] != 0:
                    p = z + rim
                    row[p >> 6] &= ~(ONE << np.uint64(p & 63))


@njit(cache=True, nogil=True)
def pack(mask, rim, bits):
    """(nx, ny, nz) uint8 truth values to bits; the rim is empty."""
    nx, ny, nz = mask.shape
    bits[:] = np.uint64(0)
    for x in range(nx):
        for y in range(ny):
            row = bits[x + rim, y + rim]
            m = mask[x, y]
            for z in range(nz):
                if m[z] != 0:
                    p = z + rim
                    row[p >> 6] |= ONE << np.uint64(p & 63)


@njit(cache=True, nogil=True)
def unpack(bits, rim, mask):
    """Bits to (nx, ny, nz) uint8 truth values, the rim left out."""
    nx, ny, nz = mask.shape
    for x in range(nx):
        for y in range(ny):
            row = bits[x + rim, y + rim]
            for z in range(nz):
                p = z + rim
                mask[x, y, z] = (row[p >> 6] >> np.uint64(p & 63)) & ONE


@njit(cache=True, nogil=True)
def add_voxels(indices, count, ny, nz, rim, bits):
    """Add voxels by their flat index in the (nx, ny, nz) grid."""
    for a in range(count):
        v = indices[a]
        p = v % nz + rim
        bits[v // (nz * ny) + rim, (v // nz) % ny + rim, p >> 6] |= ONE << np.uint64(p & 63)


@njit(cache=True, nogil=True)
def fill_rim(rim, depth, bits):
    """Put the whole rim into the set."""
    X, Y = bits.shape[:2]
    for x in range(X):
        for y in range(Y):
            inner = rim <= x < X - rim and rim <= y < Y - rim
            for p in range(depth):
                if not inner or p < rim or p >= depth - rim:
                    bits[x, y, p >> 6] |= ONE << np.uint64(p & 63)


@njit(cache=True, nogil=True)
def grow(bits, room, a, b):
    """One step of growth to all 26 neighbours within ``room``, in place.

    Of the arguments:
        a, b: scratch sets of the same shape.

    Returns:
        Whether anything was added.
    """
    X, Y, words = bits.shape
    for x in range(X):
        for y in range(Y):
            for w in range(words):
                word = bits[x, y, w]
                more = word | (word << ONE) | (word >> ONE)
                if w > 0:
                    more |= bits[x, y, w - 1] >> np.uint64(63)
                if w < words - 1:
                    more |= bits[x, y, w + 1] << np.uint64(63)
                a[x, y, w] = more
    for x in range(X):
        for y in range(Y):
            for w in range(words):
                word = a[x, y, w]
                if y > 0:
                    word |= a[x, y - 1, w]
                if y < Y - 1:
                    word |= a[x, y + 1, w]
                b[x, y, w] = word
    added = np.uint64(0)
    for x in range(X):
        for y in range(Y):
            for w in range(words):
                word = b[x, y, w]
                if x > 0:
                    word |= b[x - 1, y, w]
                if x < X - 1:
                    word |= b[x + 1, y, w]
                word = (word & room[x, y, w]) | bits[x, y, w]
                added |= word ^ bits[x, y, w]
                bits[x, y, w] = word
    return added != 0


@njit(cache=True, nogil=True)
def intersect(bits, other):
    """Keep only what is in ``other`` too, in place."""
    X, Y, words = bits.shape
    for x in range(X):
        for y in range(Y):
            for w in range(words):
                bits[x, y, w] &= other[x, y, w]


@njit(cache=True, nogil=True)
def open_by_cube(bits, edge, depth):
    """Keep only what a cube of ``edge`` voxels can cover, in place; at most the rim's width."""
    X, Y, words = bits.shape
    last = depth - 64 * (words - 1)
    for _ in range(edge - 1):  # erosion along z: a voxel stays where a cube can begin
        for x in range(X):
            for y in range(Y):
                for w in range(words):
                    above = bits[x, y, w] >> ONE
                    if w < words - 1:
                        above |= bits[x, y, w + 1] << np.uint64(63)
                    bits[x, y, w] &= above
    for x in range(X):
        for _ in range(edge - 1):
            for y in range(Y - 1):
                for w in range(words):
                    bits[x, y, w] &= bits[x, y + 1, w]
            bits[x, Y - 1] = np.uint64(0)
    for _ in range(edge - 1):
        for x in range(X - 1):
            for y in range(Y):
                for w in range(words):
                    bits[x, y, w] &= bits[x + 1, y, w]
        bits[X - 1] = np.uint64(0)
    for _ in range(edge - 1):  # dilation by the same cube
        for x in range(X):
            for y in range(Y):
                for w in range(words - 1, -1, -1):
                    below = bits[x, y, w] << ONE
                    if w > 0:
                        below |= bits[x, y, w - 1] >> np.uint64(63)
                    bits[x, y, w] |= below
                if last < 64:
                    bits[x, y, words - 1] &= ~np.uint64(0) >> np.uint64(64 - last)
    for x in range(X):
        for _ in range(edge - 1):
            for y in range(Y - 1, 0, -1):
                for w in range(words):
                    bits[x, y, w] |= bits[x, y - 1, w]
    for _ in range(edge - 1):
        for x in range(X - 1, 0, -1):
            for y in range(Y):
                for w in range(words):
                    bits[x, y, w] |= bits[x - 1, y, w]


@njit(cache=True, nogil=True)
def frontier(bits, blocked, rim, ny, nz, indices):
    """Voxels of the set with a face neighbour that is neither in the set nor blocked.

    Of the arguments:
        bits: the set; blocked: a set behind whose voxels nobody steps out (declared solids).
        indices: (m,) int32 out: flat indices in the (nx, ny, nz) grid; rim voxels are left out.

    Returns:
        Number of indices (at most m).
    """
    X, Y, words = bits.shape
    n = 0
    for x in range(rim, X - rim):
        for y in range(rim, Y - rim):
            for w in range(words):
                here = bits[x, y, w]
                if here == 0:
                    continue
                closed = here | blocked[x, y, w]
                up = closed << ONE
                down = closed >> ONE
                if w > 0:
                    up |= (bits[x, y, w - 1] | blocked[x, y, w - 1]) >> np.uint64(63)
                if w < words - 1:
                    down |= (bits[x, y, w + 1] | blocked[x, y, w + 1]) << np.uint64(63)
                inner = up & down
                inner &= bits[x - 1, y, w] | blocked[x - 1, y, w]
                inner &= bits[x + 1, y, w] | blocked[x + 1, y, w]
                inner &= bits[x, y - 1, w] | blocked[x, y - 1, w]
                inner &= bits[x, y + 1, w] | blocked[x, y + 1, w]
                edge = here & ~inner
                if edge == 0:
                    continue
                for b in range(64):
                    if (edge >> np.uint64(b)) & ONE:
                        z = 64 * w + b - rim
                        if 0 <= z < nz and n < indices.shape[0]:
                            indices[n] = ((x - rim) * ny + y - rim) * nz + z
                            n += 1
    return n
