"""Compiled set operations on voxel sets packed to bits along z, 64 voxels a word.

A set is (nx + 2 p, ny + 2 p, words) uint64 with a rim of p voxels on every side that stands for
the world outside: voxel (x, y, z) of the grid is bit (z + p) % 64 of word (z + p) // 64 in row
(x + p, y + p). ``depth`` is the number of bits in use, nz + 2 p; bits beyond it are zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from armsight.arrays import Bytes, Floats, Floats32, Ints, Ints32, Words

ONE = np.uint64(1)


@njit(inline="always")
def _gathered(eight: Any) -> Any:
    """Eight bytes of 0 or 1, read as one word, to eight bits."""
    return ((np.uint64(eight) * np.uint64(0x0102040810204080)) >> np.uint64(56)) & np.uint64(0xFF)


@njit(cache=True, nogil=True)
def pack_room(state: Bytes, static: Bytes, body: Bytes, rim: int, bits: Words) -> None:
    """The set of voxels where someone unseen could be: not free, not solid; the rim is too.

    Of the arguments:
        state: (nx, ny, nz) uint8 (1 is free).
        static, body: uint8, 1 where declared solids and the arm itself are.
    """
    nx, ny, nz = state.shape
    words = bits.shape[2]
    depth = nz + 2 * rim
    padded = np.zeros((nz + 7) // 8 * 8, np.uint8)
    eights = padded.view(np.uint64)
    full = ~np.uint64(0)
    rims = np.zeros(words, np.uint64)
    for p in range(depth):
        if p < rim or p >= depth - rim:
            rims[p >> 6] |= ONE << np.uint64(p & 63)
    for x in range(bits.shape[0]):
        for y in range(bits.shape[1]):
            row = bits[x, y]
            inner = rim <= x < nx + rim and rim <= y < ny + rim
            for w in range(words):
                row[w] = full >> np.uint64(64 - min(64, depth - 64 * w))
                if inner:  # all but the rim is decided below
                    row[w] &= rims[w]
            if not inner:
                continue
            i, j = x - rim, y - rim
            for z in range(nz):  # indexed, as slicing three arrays takes longer than the row
                taken = (state[i, j, z] == 1) | (static[i, j, z] != 0) | (body[i, j, z] != 0)
                padded[z] = np.uint8(not taken)
            for e in range(eights.shape[0]):
                eight = eights[e]
                if eight == 0:
                    continue
                byte = _gathered(eight)
                p = 8 * e + rim
                w = p >> 6
                shift = np.uint64(p & 63)
                row[w] |= byte << shift
                if shift > 56 and w + 1 < words:
                    row[w + 1] |= byte >> (np.uint64(64) - shift)


@njit(cache=True, nogil=True)
def pack(mask: Bytes, rim: int, bits: Words) -> None:
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
def unpack(bits: Words, rim: int, mask: Bytes) -> None:
    """Bits to (nx, ny, nz) uint8 truth values, the rim left out."""
    nx, ny, nz = mask.shape
    for x in range(nx):
        for y in range(ny):
            row = bits[x + rim, y + rim]
            for z in range(nz):
                p = z + rim
                mask[x, y, z] = (row[p >> 6] >> np.uint64(p & 63)) & ONE


@njit(cache=True, nogil=True)
def replace_outside(bits: Words, rim: int, old: int, new: int, state: Bytes) -> None:
    """Turn the voxels of state ``old`` that are not in the set to ``new``, in place."""
    nx, ny, nz = state.shape
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                if state[x, y, z] == old:
                    p = z + rim
                    word = bits[x + rim, y + rim, p >> 6]
                    if not (word >> np.uint64(p & 63)) & ONE:
                        state[x, y, z] = new


@njit(cache=True, nogil=True)
def add_voxels(indices: Ints32, count: int, ny: int, nz: int, rim: int, bits: Words) -> None:
    """Add voxels by their flat index in the (nx, ny, nz) grid."""
    for a in range(count):
        v = indices[a]
        p = v % nz + rim
        bits[v // (nz * ny) + rim, (v // nz) % ny + rim, p >> 6] |= ONE << np.uint64(p & 63)


@njit(cache=True, nogil=True)
def remove_voxels(indices: Ints32, count: int, ny: int, nz: int, rim: int, bits: Words) -> None:
    """Take voxels out by their flat index in the (nx, ny, nz) grid."""
    for a in range(count):
        v = indices[a]
        p = v % nz + rim
        bits[v // (nz * ny) + rim, (v // nz) % ny + rim, p >> 6] &= ~(ONE << np.uint64(p & 63))


@njit(cache=True, nogil=True)
def count_voxels(indices: Ints32, count: int, ny: int, nz: int, rim: int, bits: Words) -> int:
    """How many voxels, by their flat index in the (nx, ny, nz) grid, are in the set."""
    found = 0
    for a in range(count):
        v = indices[a]
        p = v % nz + rim
        word = bits[v // (nz * ny) + rim, (v // nz) % ny + rim, p >> 6]
        found += (word >> np.uint64(p & 63)) & ONE != 0
    return found


@njit(cache=True, nogil=True)
def fill_rim(rim: int, depth: int, bits: Words) -> None:
    """Put the whole rim into the set."""
    X, Y = bits.shape[:2]
    for x in range(X):
        for y in range(Y):
            inner = rim <= x < X - rim and rim <= y < Y - rim
            for p in range(depth):
                if not inner or p < rim or p >= depth - rim:
                    bits[x, y, p >> 6] |= ONE << np.uint64(p & 63)


@njit(cache=True, nogil=True)
def _join(more: Words, out: Words) -> None:
    for i in range(out.shape[0]):
        out[i] |= more[i]


@njit(cache=True, nogil=True)
def _meet(other: Words, out: Words) -> None:
    for i in range(out.shape[0]):
        out[i] &= other[i]


@njit(cache=True, nogil=True)
def _thicken(plane: Words, words: int, along_z: Words, out: Words) -> None:
    """One step of growth within a plane of equal x, rows of ``words`` one after the other."""
    n = plane.shape[0]
    for i in range(n):
        along_z[i] = plane[i] | (plane[i] << ONE) | (plane[i] >> ONE)
    for w in range(words - 1):
        for i in range(w, n, words):
            along_z[i + 1] |= plane[i] >> np.uint64(63)
            along_z[i] |= plane[i + 1] << np.uint64(63)
    for i in range(n):
        out[i] = along_z[i]
    _join(along_z[words:], out[: n - words])
    _join(along_z[: n - words], out[words:])


@njit(cache=True, nogil=True)
def grow(bits: Words, room: Words, a: Words, b: Words) -> bool:
    """One step of growth to all 26 neighbours within ``room``, in place.

    Of the arguments:
        a, b: scratch sets of the same shape.

    Returns:
        Whether anything was added.
    """
    X, _, words = bits.shape
    lit = np.zeros(X + 2, np.bool_)  # planes with anything in them; one more on each side
    for x in range(X):
        plane = bits[x].reshape(-1)
        some = np.uint64(0)
        for i in range(plane.shape[0]):
            some |= plane[i]
        if some != 0:
            lit[x + 1] = True
            _thicken(plane, words, b[x].reshape(-1), a[x].reshape(-1))
    added = np.uint64(0)
    for x in range(X):
        if not (lit[x] or lit[x + 1] or lit[x + 2]):
            continue
        more = b[x].reshape(-1)
        more[:] = np.uint64(0)
        for beside in range(x - 1, x + 2):
            if lit[beside + 1]:
                _join(a[beside].reshape(-1), more)
        plane, inside = bits[x].reshape(-1), room[x].reshape(-1)
        for i in range(plane.shape[0]):
            word = (more[i] & inside[i]) | plane[i]
            added |= word ^ plane[i]
            plane[i] = word
    return added != 0


@njit(cache=True, nogil=True)
def spread(bits: Words, within: Words) -> None:
    """Grow a set, in place, to all of ``within`` that it is connected with by 26 neighbours.

    Sweeps forth and back use what they have just found, so that a few of them do; planes beside
    which nothing has changed since they were looked at are left out.
    """
    X, Y, words = bits.shape
    forth = True
    last_change = np.zeros(X + 2, np.int64)  # sweep in which a plane did; one more on each side
    sweep = 0
    while sweep == 0 or last_change.max() == sweep:
        sweep += 1
        for k in range(X * Y):
            row = k if forth else X * Y - 1 - k
            x, y = row // Y, row % Y
            beside = max(last_change[x], last_change[x + 1], last_change[x + 2])
            if beside < sweep - 1:
                continue
            for w in range(words):
                if within[x, y, w] == bits[x, y, w]:
                    continue
                word = bits[x, y, w]
                for p in range(max(x - 1, 0), min(x + 2, X)):
                    for q in range(max(y - 1, 0), min(y + 2, Y)):
                        other = bits[p, q, w]
                        word |= other | (other << ONE) | (other >> ONE)
                        if w > 0:
                            word |= bits[p, q, w - 1] >> np.uint64(63)
                        if w < words - 1:
                            word |= bits[p, q, w + 1] << np.uint64(63)
                word &= within[x, y, w]
                last = word ^ ONE
                while word != last:
                    last = word
                    word = (word | (word << ONE) | (word >> ONE)) & within[x, y, w]
                if word != bits[x, y, w]:
                    bits[x, y, w] |= word
                    last_change[x + 1] = sweep
        forth = not forth


@njit(cache=True, nogil=True)
def intersect(bits: Words, other: Words) -> None:
    """Keep only what is in ``other`` too, in place."""
    X, Y, words = bits.shape
    for x in range(X):
        for y in range(Y):
            for w in range(words):
                bits[x, y, w] &= other[x, y, w]


@njit(cache=True, nogil=True)
def open_by_cube(bits: Words, edge: int, depth: int) -> None:
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
    n = Y * words
    for x in range(X):
        plane = bits[x].reshape(-1)
        for _ in range(edge - 1):
            for i in range(n - words):
                plane[i] &= plane[i + words]
            plane[n - words :] = np.uint64(0)
    for _ in range(edge - 1):
        for x in range(X - 1):
            _meet(bits[x + 1].reshape(-1), bits[x].reshape(-1))
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
        plane = bits[x].reshape(-1)
        for _ in range(edge - 1):
            for i in range(n - 1, words - 1, -1):
                plane[i] |= plane[i - words]
    for _ in range(edge - 1):
        for x in range(X - 1, 0, -1):
            _join(bits[x - 1].reshape(-1), bits[x].reshape(-1))


@njit(inline="always")
def _bit_number(single: Any) -> int:
    """Position of the only bit of a word."""
    n = 0
    for step in (32, 16, 8, 4, 2, 1):
        if single >> np.uint64(step):
            single >>= np.uint64(step)
            n += step
    return n


@njit(cache=True, nogil=True)
def frontier(
    bits: Words, blocked: Words, rim: int, ny: int, nz: int, indices: Ints32, faces: Bytes
) -> int:
    """Voxels of the set with a face neighbour that is neither in the set nor blocked.

    Of the arguments:
        bits: the set.
        blocked: a set behind whose voxels nobody steps out (declared solids).
        indices: (m,) out: flat indices in the (nx, ny, nz) grid; rim voxels are left out.
        faces: (m,) out: which faces are open: bits 0.. for -x, +x, -y, +y, -z, +z.

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
                west = bits[x - 1, y, w] | blocked[x - 1, y, w]
                east = bits[x + 1, y, w] | blocked[x + 1, y, w]
                south = bits[x, y - 1, w] | blocked[x, y - 1, w]
                north = bits[x, y + 1, w] | blocked[x, y + 1, w]
                edge = here & ~(up & down & west & east & south & north)
                while edge != 0:
                    low = edge & (~edge + ONE)
                    edge ^= low
                    z = 64 * w + _bit_number(low) - rim
                    if z < 0 or z >= nz or n >= indices.shape[0]:
                        continue
                    indices[n] = ((x - rim) * ny + y - rim) * nz + z
                    faces[n] = (
                        (1 if west & low == 0 else 0)
                        | (2 if east & low == 0 else 0)
                        | (4 if south & low == 0 else 0)
                        | (8 if north & low == 0 else 0)
                        | (16 if up & low == 0 else 0)
                        | (32 if down & low == 0 else 0)
                    )
                    n += 1
    return n


@njit(cache=True, nogil=True)
def clear_rim(rim: int, depth: int, bits: Words) -> None:
    """Take the whole rim out of the set."""
    X, Y, words = bits.shape
    inside = np.zeros(words, np.uint64)
    for p in range(rim, depth - rim):
        inside[p >> 6] |= ONE << np.uint64(p & 63)
    for x in range(X):
        for y in range(Y):
            inner = rim <= x < X - rim and rim <= y < Y - rim
            for w in range(words):
                bits[x, y, w] = bits[x, y, w] & inside[w] if inner else np.uint64(0)


@njit(cache=True, nogil=True)
def copy_shell(far: Words, far_rim: int, cells: Ints32, shell: Ints32, bits: Words) -> None:
    """Add to the set those voxels of its rim whose cell in a coarser set is in that set.

    Of the arguments:
        far: the coarser set.
        cells: (m, 3) cell x, y, z in the coarser grid of each shell voxel.
        shell: (m, 3) row, column and bit position of the voxel in ``bits``.
    """
    for a in range(cells.shape[0]):
        p = cells[a, 2] + far_rim
        word = far[cells[a, 0] + far_rim, cells[a, 1] + far_rim, p >> 6]
        if (word >> np.uint64(p & 63)) & ONE:
            q = shell[a, 2]
            bits[shell[a, 0], shell[a, 1], q >> 6] |= ONE << np.uint64(q & 63)


def surface_parts(parts: int) -> tuple[Ints, Bytes]:
    """The small cubes on the open faces of a big cell, for :func:`face_points`.

    Returns:
        (65,) where each of the 64 sets of faces begins in the list, and the list: (m, 3) uint8
        x, y, z of a cube, counted along the cell's edges.
    """
    cubes = np.indices((parts, parts, parts)).reshape(3, -1).T
    ends = np.stack([cubes == 0, cubes == parts - 1], axis=2).reshape(-1, 6)  # -x +x -y +y -z +z
    open_ = np.arange(64)[:, None] >> np.arange(6) & 1 != 0
    listed = (ends[None] & open_[:, None]).any(axis=2)
    first = np.concatenate([[0], np.cumsum(listed.sum(axis=1))])
    return first, cubes[np.nonzero(listed)[1]].astype(np.uint8)


@njit(cache=True, nogil=True)
def face_points(
    indices: Ints32,
    faces: Bytes,
    surface: tuple[Ints, Bytes],
    origin: Floats,
    cell: float,
    shape: Ints,
    parts: int,
    lower: Floats,
    upper: Floats,
) -> Floats32:
    """Centres of the small cubes that make up the open faces of big cells, outside a box.

    Of the arguments:
        indices, faces: (m,) see :func:`frontier`.
        surface: of :func:`surface_parts`.
        cell: edge of a big cell [m]; parts: small cubes along it.
        lower, upper: (3,) corners of the box [m].

    Returns:
        (n, 3) [m], a new array.
    """
    first, cubes = surface
    ny, nz = shape[1], shape[2]
    most = 0
    for a in range(indices.shape[0]):
        most += first[faces[a] + 1] - first[faces[a]]
    out = np.empty((most, 3), np.float32)
    at, inside = np.empty((3, parts), np.float32), np.empty((3, parts), np.bool_)
    part = cell / parts
    n = 0
    for a in range(indices.shape[0]):
        index = indices[a]
        row = index // nz
        place = (row // ny, row % ny, index % nz)
        within = True
        for d in range(3):
            begin = origin[d] + place[d] * cell
            some = False
            for i in range(parts):
                x = begin + (i + 0.5) * part
                at[d, i] = x
                inside[d, i] = lower[d] <= x < upper[d]
                some |= inside[d, i]
            within &= some
        for b in range(first[faces[a]], first[faces[a] + 1]):
            i, j, k = cubes[b, 0], cubes[b, 1], cubes[b, 2]
            if within and inside[0, i] and inside[1, j] and inside[2, k]:
                continue
            out[n, 0] = at[0, i]
            out[n, 1] = at[1, j]
            out[n, 2] = at[2, k]
            n += 1
    return out[:n]


@njit(cache=True, nogil=True)
def voxel_centers(indices: Ints32, shape: Ints, origin: Floats, voxel: float) -> Floats32:
    """(m, 3) centres [m] of (m,) voxels by their flat index in the (nx, ny, nz) grid."""
    ny, nz = shape[1], shape[2]
    out = np.empty((indices.shape[0], 3), np.float32)
    for a in range(indices.shape[0]):
        index = indices[a]
        row = index // nz
        out[a, 0] = (row // ny + 0.5) * voxel + origin[0]
        out[a, 1] = (row % ny + 0.5) * voxel + origin[1]
        out[a, 2] = (index % nz + 0.5) * voxel + origin[2]
    return out
