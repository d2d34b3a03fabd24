"""Maps handed from one process to another through shared memory, two places in turn.

The writer fills the place that was not written last; a short message announces it (the *ticket*:
where everything lies, and all of the map that is small). Whoever got a ticket copies the arrays
out and then looks whether the place still holds what was announced. If the writer has come round
meanwhile, the copy may be half of this map and half of another: it is dropped, and a newer ticket
is on its way.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armsight.mapping.snapshot import WorkspaceSnapshot
from armsight.runtime.shared_block import SharedBlock

ARRAYS = ("state", "distance", "last_occupied", "hazards", "hazard_unknown", "things")
"""What lies in shared memory. The cloud is for the page alone and stays where it is."""
EMPTY_CLOUD = np.empty((0, 3), np.float32)
EMPTY_CLOUD.flags.writeable = False
ALIGN = 64
"""Arrays begin at multiples of so many bytes."""
ROOM = 1.5
"""Places are made so many times as large as the map that first needed them: hazards vary."""
BEGUN, ENDED = 0, 1
"""Words of a place's head: number of the map that is being written, and of the one that was."""
HEAD = ALIGN


@dataclass(frozen=True)
class Ticket:
    """Announces a map.

    Attributes:
        number: counts the maps of one writer, from 1.
        block, offset: name of the memory, and where in it the place begins [bytes].
        stamp: of the map [s]; it is looked at once more after copying.
        arrays: name, type, shape and offset in the place of each array.
        small: the map itself without what lies in the memory.
    """

    number: int
    block: str
    offset: int
    stamp: float
    arrays: tuple[tuple[str, str, tuple[int, ...], int], ...]
    small: WorkspaceSnapshot


class SnapshotWriter:
    """Puts maps into shared memory; used by one thread."""

    def __init__(self) -> None:
        self._block: SharedBlock | None = None
        self._before: SharedBlock | None = None
        self._place = 0
        self._number = 0

    def write(self, snapshot: WorkspaceSnapshot) -> Ticket:
        """Put a map into the place that was not used last.

        Raises:
            OSError: the system has no room for it.
        """
        layout, needed = [], HEAD
        for name in ARRAYS:
            array = np.ascontiguousarray(getattr(snapshot, name))
            layout.append((name, array, needed))
            needed += -(-array.nbytes // ALIGN) * ALIGN
        block = self._with_room(needed)
        self._number += 1
        self._place = 1 - self._place
        offset = self._place * (block.size // 2 // ALIGN * ALIGN)
        head = _head(block, offset)
        head[BEGUN] = self._number
        for _, array, at in layout:
            _look(block, array.dtype.str, array.shape, offset + at)[...] = array
        head.view(np.float64)[2] = snapshot.stamp
        head[ENDED] = self._number
        nothing: dict[str, Any] = dict.fromkeys((*ARRAYS, "cloud"), EMPTY_CLOUD)
        return Ticket(
            self._number,
            block.name,
            offset,
            snapshot.stamp,
            tuple((name, array.dtype.str, array.shape, at) for name, array, at in layout),
            replace(snapshot, **nothing),
        )

    def close(self) -> None:
        """Take the memory out of the system."""
        for block in (self._before, self._block):
            if block is not None:
                block.close()
        self._before = self._block = None

    def _with_room(self, needed: int) -> SharedBlock:
        """Memory with two places of at least this size [bytes]."""
        if self._block is None or self._block.size // 2 - ALIGN < needed:
            if self._before is not None:
                self._before.close()
            # A reader may be copying from the one that was in use until now.
            self._before, self._block = self._block, SharedBlock(size=2 * int(ROOM * needed))
        return self._block


class SnapshotReader:
    """Takes maps out of shared memory; used by one thread."""

    def __init__(self) -> None:
        self._block: SharedBlock | None = None

    def read(self, ticket: Ticket) -> WorkspaceSnapshot | None:
        """The announced map, its arrays our own; None if it was overwritten meanwhile."""
        block = self._attached(ticket.block)
        if block is None:
            return None
        head = _head(block, ticket.offset)
        if int(head[ENDED]) != ticket.number:
            return None
        arrays: dict[str, NDArray[np.generic]] = {}
        for name, kind, shape, at in ticket.arrays:
            array = _look(block, kind, shape, ticket.offset + at).copy()
            array.flags.writeable = False
            arrays[name] = array
        whole = int(head[BEGUN]) == int(head[ENDED]) == ticket.number
        if not whole or float(head.view(np.float64)[2]) != ticket.stamp:
            return None
        return replace(ticket.small, **arrays)  # type: ignore[arg-type]

    def close(self) -> None:
        """Let go of the memory."""
        if self._block is not None:
            self._block.close()
        self._block = None

    def _attached(self, name: str) -> SharedBlock | None:
        if self._block is None or self._block.name != name:
            self.close()
            with contextlib.suppress(OSError):  # gone: a newer ticket has another
                self._block = SharedBlock(name)
        return self._block


def _head(block: SharedBlock, offset: int) -> NDArray[np.uint64]:
    return np.frombuffer(block.memory, np.uint64, 4, offset)


def _look(
    block: SharedBlock, kind: str, shape: tuple[int, ...], offset: int
) -> NDArray[np.generic]:
    return np.ndarray(shape, np.dtype(kind), block.memory, offset)


assert set(ARRAYS) <= {field.name for field in fields(WorkspaceSnapshot)}
