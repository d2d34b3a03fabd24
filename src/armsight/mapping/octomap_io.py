"""OctoMap's binary maps (``.bt``): read and write, without OctoMap.

The format (Hornung et al. 2013, and OctoMap 1.10's ``OcTree::writeBinary``): a text header, then
the tree depth first. Each inner node is two bytes, two bits a child from the lowest: 00 unknown,
01 free leaf, 10 occupied leaf, 11 inner node, whose own two bytes follow after its parent's, in
order. Child i lies up in x, y, z where bits 0, 1, 2 of i are set. The root is a cube of 2^16 voxels
about the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armsight.arrays import Bytes, Ints, Points
from armsight.errors import ArmsightError
from armsight.mapping.snapshot import FREE, OCCUPIED, UNKNOWN, VoxelGrid
from armsight.writing import write_atomically

DEPTH = 16
"""Levels below the root; OctoMap's files always have these."""
HALF = 1 << (DEPTH - 1)
"""Key of the voxel whose lower corner is the origin."""
MAGIC = b"# Octomap OcTree binary file"
_FREE_LEAF, _OCCUPIED_LEAF, _INNER = 1, 2, 3


@dataclass(frozen=True)
class BinaryOctree:
    """An occupancy octree with two states, as leaves.

    Attributes:
        resolution: edge of a voxel [m].
        key: (n, 3) lowest voxel of each leaf, counted from the origin (may be negative).
        size: (n,) edge of each leaf in voxels, a power of two.
        occupied: (n,) true where occupied, false where free.
    """

    resolution: float
    key: Ints
    size: Ints
    occupied: np.ndarray

    def centers(self) -> Points:
        """(n, 3) centres of the leaves [m]."""
        return np.asarray((self.key + 0.5 * self.size[:, None]) * self.resolution)

    def lookup(self, points: Points) -> Bytes:
        """(n,) state of the voxel that holds each of (n, 3) points: UNKNOWN, FREE or OCCUPIED."""
        grid = self.voxels()
        at = np.floor(np.asarray(points, float) / self.resolution).astype(np.int64)
        out = np.full(len(at), UNKNOWN, np.uint8)
        for i, key in enumerate(map(tuple, at.tolist())):
            state = grid.get(key)
            if state is not None:
                out[i] = OCCUPIED if state else FREE
        return out

    def voxels(self) -> dict[tuple[int, int, int], bool]:
        """Every known voxel of the finest level and whether it is occupied; may be very large."""
        out: dict[tuple[int, int, int], bool] = {}
        for key, size, occupied in zip(self.key.tolist(), self.size.tolist(), self.occupied):
            for i in range(size):
                for j in range(size):
                    for k in range(size):
                        out[(key[0] + i, key[1] + j, key[2] + k)] = bool(occupied)
        return out

    def to_state(self, grid: VoxelGrid) -> Bytes:
        """State of each voxel of a dense grid, by the octree's voxel at its centre.

        The leaves are painted as boxes, so the grid may be finer or coarser than the octree.
        """
        state = np.full(grid.shape, UNKNOWN, np.uint8)
        low = (self.key * self.resolution - grid.origin) / grid.voxel
        high = ((self.key + self.size[:, None]) * self.resolution - grid.origin) / grid.voxel
        first = np.maximum(np.ceil(low - 0.5 - 1e-9), 0).astype(np.int64)
        stop = np.minimum(np.ceil(high - 0.5 - 1e-9), grid.shape).astype(np.int64)
        for a, b, occupied in zip(first, stop, self.occupied):
            if (a < b).all():
                state[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = OCCUPIED if occupied else FREE
        return state


def from_state(state: Bytes, grid: VoxelGrid) -> BinaryOctree:
    """An octree of a dense grid's free and occupied voxels, merged where eight are alike.

    Raises:
        ValueError: the grid's corner does not lie on a whole voxel, or it is too large.
    """
    start = np.asarray(grid.origin) / grid.voxel
    if np.abs(start - np.round(start)).max() > 1e-6:
        raise ValueError(
            f"the grid begins at {np.asarray(grid.origin)} m, between voxels of {grid.voxel} m; "
            "an octree's voxels begin at the origin"
        )
    base = np.round(start).astype(np.int64)
    if (base < -HALF).any() or (base + grid.shape > HALF).any():
        raise ValueError("the grid does not fit into an octree of 2^16 voxels about the origin")
    known = (state == FREE) | (state == OCCUPIED)
    key = np.argwhere(known) + base
    occupied = state[known] == OCCUPIED
    size = 1
    keys, sizes, values = [], [], []
    while len(key):
        parent = key >> int(np.log2(2 * size)) << int(np.log2(2 * size))
        order = np.lexsort((parent[:, 2], parent[:, 1], parent[:, 0]))
        key, occupied, parent = key[order], occupied[order], parent[order]
        new = np.ones(len(key), bool)
        new[1:] = (parent[1:] != parent[:-1]).any(axis=1)
        group = np.cumsum(new) - 1
        count = np.bincount(group)
        filled = np.bincount(group, occupied)
        full = (count == 8) & ((filled == 0) | (filled == 8))
        if not full.any() or 2 * size > HALF:
            keys.append(key)
            sizes.append(np.full(len(key), size))
            values.append(occupied)
            break
        alone = ~full[group]
        keys.append(key[alone])
        sizes.append(np.full(alone.sum(), size))
        values.append(occupied[alone])
        heads = np.flatnonzero(new)[full]
        key, occupied = parent[heads], occupied[heads]
        size *= 2
    if not keys:
        return BinaryOctree(grid.voxel, np.zeros((0, 3), int), np.zeros(0, int), np.zeros(0, bool))
    return BinaryOctree(
        grid.voxel, np.concatenate(keys), np.concatenate(sizes), np.concatenate(values)
    )


def write_bt(path: Path, tree: BinaryOctree) -> None:
    """Write a ``.bt`` file; it appears whole or not at all.

    Raises:
        ArmsightError: the file cannot be written.
    """
    words, nodes = _encode(tree)
    header = MAGIC + b"\n# (feel free to add / change comments, but leave the first line as it is!)"
    header += f"\n#\nid OcTree\nsize {nodes}\nres {tree.resolution:.12g}\ndata\n".encode()
    write_atomically(path, header, words)


def _encode(tree: BinaryOctree) -> tuple[bytes, int]:
    """The two bytes of every inner node, depth first, and the number of all nodes."""
    if len(tree.key) == 0:
        return b"", 0
    key = tree.key + HALF
    level = DEPTH - np.round(np.log2(tree.size)).astype(int)  # depth of each leaf
    # Inner nodes of every depth: two bits a child.
    codes: list[dict[tuple[int, int, int], int]] = [{} for _ in range(DEPTH)]
    leaves = np.where(tree.occupied, _OCCUPIED_LEAF, _FREE_LEAF)
    for k, depth, leaf in zip(key.tolist(), level.tolist(), leaves.tolist()):
        code = leaf
        for d in range(depth - 1, -1, -1):
            shift = DEPTH - 1 - d
            child = sum(((k[axis] >> shift) & 1) << axis for axis in range(3))
            node = (k[0] >> (shift + 1), k[1] >> (shift + 1), k[2] >> (shift + 1))
            known = codes[d].get(node)
            codes[d][node] = (known or 0) | (code << (2 * child))
            if known is not None and code == _INNER:
                break
            code = _INNER
    out = bytearray()
    stack = [(0, (0, 0, 0))]
    while stack:
        d, node = stack.pop()
        bits = codes[d][node]
        out += bits.to_bytes(2, "little")
        for child in range(7, -1, -1):
            if (bits >> (2 * child)) & 3 == _INNER:
                down = tuple(2 * node[axis] + ((child >> axis) & 1) for axis in range(3))
                stack.append((d + 1, (down[0], down[1], down[2])))
    return bytes(out), len(tree.key) + sum(len(c) for c in codes)


def read_bt(path: Path) -> BinaryOctree:
    """Read a ``.bt`` file.

    Raises:
        ArmsightError: the file is missing, of another kind, or cut short.
    """
    target = Path(path)
    try:
        data = target.read_bytes()
    except OSError as error:
        raise ArmsightError(f"cannot read {target}: {error.strerror}") from None
    if not data.startswith(MAGIC):
        raise ArmsightError(
            f"{target} is no binary OctoMap: its first line is not '{MAGIC.decode()}'"
        )
    end = data.find(b"\ndata")
    if end < 0:
        raise ArmsightError(f"{target} has no data")
    fields = {}
    for line in data[:end].decode("ascii", "replace").split("\n"):
        if line and not line.startswith("#"):
            name, _, value = line.partition(" ")
            fields[name] = value.strip()
    if fields.get("id") != "OcTree":
        raise ArmsightError(f"{target} holds a '{fields.get('id')}'; expected an OcTree")
    try:
        resolution, count = float(fields["res"]), int(fields["size"])
    except (KeyError, ValueError):
        raise ArmsightError(f"{target} does not say its resolution and size") from None
    if not 0 < resolution < 1e3:
        raise ArmsightError(f"{target} has a resolution of {resolution} m")
    body = data[data.find(b"\n", end + 1) + 1 :]
    return _decode(body, resolution, count, target)


def _decode(body: bytes, resolution: float, count: int, target: Path) -> BinaryOctree:
    key: list[tuple[int, int, int]] = []
    size: list[int] = []
    occupied: list[bool] = []
    at = 0
    stack = [(0, 0, 0, DEPTH)] if count else []  # lower corner and level above the finest
    while stack:
        x, y, z, level = stack.pop()
        if at + 2 > len(body):
            raise ArmsightError(f"{target} is cut short at byte {at} of its data")
        bits = body[at] | (body[at + 1] << 8)
        at += 2
        edge = 1 << (level - 1)
        inner = []
        for child in range(8):
            code = (bits >> (2 * child)) & 3
            if code == 0:
                continue
            low = (
                x + edge * (child & 1),
                y + edge * ((child >> 1) & 1),
                z + edge * ((child >> 2) & 1),
            )
            if code == _INNER:
                if level == 1:
                    raise ArmsightError(f"{target} is broken: an inner node below the last level")
                inner.append((*low, level - 1))
            else:
                key.append((low[0] - HALF, low[1] - HALF, low[2] - HALF))
                size.append(edge)
                occupied.append(code == _OCCUPIED_LEAF)
        stack += inner[::-1]
    return BinaryOctree(
        resolution,
        np.array(key, np.int64).reshape(-1, 3),
        np.array(size, np.int64),
        np.array(occupied, bool),
    )
