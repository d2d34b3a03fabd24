"""Messages between the session and the process of its command path, over two pipes.

They are pickled: both ends are ours, the pipes are inherited, and nobody else can write into them.
Whatever a stranger wrote (a task's intent) is checked for its type before it is sent.
"""

from __future__ import annotations

import contextlib
import io
import logging
import pickle
import struct
import threading
from collections import deque
from collections.abc import Callable
from typing import IO, Any

log = logging.getLogger(__name__)

LENGTH = struct.Struct("<Q")


class Wire:
    """One end. Sending never waits: a thread of its own writes, in order.

    Args:
        incoming, outgoing: the pipes.

    Attributes:
        on_unsent: told, in that thread, of a message that cannot be sent, and why not.
    """

    def __init__(self, incoming: IO[bytes], outgoing: IO[bytes]) -> None:
        self._incoming, self._outgoing = incoming, outgoing
        self._waiting: deque[Any] = deque()
        self._news = threading.Condition()
        self._closed = False
        self.on_unsent: Callable[[Any, str], None] = lambda message, why: None
        self._writer = threading.Thread(target=self._write, name="armsight-wire", daemon=True)
        self._writer.start()

    def send(self, message: Any) -> None:
        """Leave a message of :mod:`armsight.runtime.command_messages` for the other end."""
        with self._news:
            self._waiting.append(message)
            self._news.notify()

    def waiting(self, kind: type) -> bool:
        """Whether a message of this type has not been written yet: the other end is slow."""
        with self._news:
            return any(type(m) is kind for m in self._waiting)

    def receive(self) -> Any:
        """The next message; waits for it.

        Raises:
            EOFError: the other end is gone.
        """
        head = self._incoming.read(LENGTH.size)
        if len(head) < LENGTH.size:
            raise EOFError
        (length,) = LENGTH.unpack(head)
        body = self._incoming.read(length)
        if len(body) < length:
            raise EOFError
        return pickle.loads(body)  # noqa: S301 - from our own other end alone

    def close(self) -> None:
        """Send what waits, then nothing more."""
        with self._news:
            self._closed = True
            self._news.notify()
        self._writer.join(0.5)
        with contextlib.suppress(OSError):
            self._outgoing.close()

    def _write(self) -> None:
        while True:
            with self._news:
                while not self._waiting and not self._closed:
                    self._news.wait()
                if not self._waiting:
                    return
                message = self._waiting.popleft()
            try:
                body = pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
            except Exception as error:  # what cannot be said is not said, and the next thing is
                log.exception("a %s cannot be sent", type(message).__name__)
                self.on_unsent(message, f"{type(error).__name__}: {error}")
                continue
            try:
                self._outgoing.write(LENGTH.pack(len(body)) + body)
                self._outgoing.flush()
            except (OSError, ValueError):  # it is gone; whoever reads notices
                return


class _Known(pickle.Unpickler):
    """Makes nothing but what armsight and NumPy define."""

    def find_class(self, module: str, name: str) -> Any:
        """The class of this name."""
        if module.partition(".")[0] not in ("armsight", "numpy"):
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


def understood(value: Any) -> bool:
    """Whether the other end would understand a value: it holds nothing that a stranger defined."""
    try:
        _Known(io.BytesIO(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))).load()
    except Exception:  # whatever a stranger's object does when it is looked at
        return False
    return True
