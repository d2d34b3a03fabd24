"""A block of memory that several processes see, gone with the process that made it."""

from __future__ import annotations

import contextlib
import sys
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from unittest import mock


class SharedBlock:
    """Memory shared by name.

    Args:
        name: of a block that another process made; None makes one, filled with zeros.
        size: of a new block [bytes].

    Attributes:
        name: for those who attach; memory: the bytes.

    Raises:
        OSError: there is no such block, or no room for one.
    """

    def __init__(self, name: str | None = None, size: int = 0) -> None:
        self._owner = name is None
        self._block = SharedMemory(create=True, size=size) if name is None else _attached(name)
        self.name: str = self._block.name
        assert self._block.buf is not None
        self.memory: memoryview = self._block.buf

    @property
    def size(self) -> int:
        """Bytes; a system may round up what was asked for."""
        return self._block.size

    def close(self) -> None:
        """Let go of it; whoever made it takes it out of the system. May be repeated.

        The arrays that look into it must be gone, or it is only forgotten with the process.
        """
        with contextlib.suppress(BufferError):
            self._block.close()
        if self._owner:
            self._owner = False
            with contextlib.suppress(OSError):
                self._block.unlink()


def _attached(name: str) -> SharedMemory:
    """A block of another process, which alone takes it out of the system.

    Before 3.13 Python notes it down as ours, too, and would take it from its maker when we end
    (https://github.com/python/cpython/issues/82300).
    """
    if sys.version_info >= (3, 13):
        return SharedMemory(name, track=False)
    with mock.patch.object(resource_tracker, "register"):
        return SharedMemory(name)
