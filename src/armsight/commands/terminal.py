"""What a command speaks through: streams that last, and signals that end it in order."""

from __future__ import annotations

import _thread
import contextlib
import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING

from armsight.runtime.signals import heeded

if TYPE_CHECKING:
    from rich.console import Console

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a disk that takes no more."""
_GONE = (errno.EIO,)
_WIDE = 220
"""Columns of a table that no terminal shows."""
_LATER = 0.05
"""After which a lost interrupt is sent once more [s]: the callback has returned by then."""


class _Lasting(io.TextIOWrapper):
    """Text to whom it may concern; what cannot be told any more is dropped.

    A terminal that has gone away must not take the run with it, whose files are still to be
    written; and what a run says of itself on stderr is never worth the run.
    """

    dispensable = False

    def write(self, text: str, /) -> int:
        """Write it, if anybody is there."""
        try:
            return super().write(text)
        except OSError as error:
            self._drop(error)
            return len(text)

    def flush(self) -> None:
        """Hand on what waits, if anybody is there."""
        try:
            super().flush()
        except OSError as error:
            self._drop(error)

    def _drop(self, error: OSError) -> None:
        if not (self.dispensable or error.errno in _GONE):
            raise error
        with contextlib.suppress(OSError, ValueError):
            # What waits goes the same way, and nothing fails again.
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())


def make_lasting() -> None:
    """Make stdout and stderr outlive their terminal, and take every character.

    What an encoding lacks (a terminal of another language, a file's name that is no text) is
    written as its code.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if type(stream) is not io.TextIOWrapper:  # closed, or somebody else's
            continue
        encoding, lines, through = stream.encoding, stream.line_buffering, stream.write_through
        # Names that are no text come out as they are where Python lets them.
        whole = stream.errors == "surrogateescape" and encoding.lower() in ("utf-8", "utf8")
        lasting = _Lasting(
            stream.detach(),
            encoding=encoding,
            errors="surrogateescape" if whole else "backslashreplace",
            line_buffering=lines,
            write_through=through,
        )
        lasting.dispensable = name == "stderr"
        setattr(sys, name, lasting)


def results() -> Console:
    """Where tables and lists go: stdout, whole where no terminal says how wide it is."""
    from rich.console import Console

    # Named, so that rich asks this stream which characters it knows.
    console = Console(file=sys.stdout, highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, _WIDE)
    return console


def _interrupt_main() -> None:
    """The main thread's interrupt, out of whatever it waits for; SIGINT where that is heeded."""
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    number = signal.SIGTERM if ignored else signal.SIGINT
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, number)
    else:
        _thread.interrupt_main(number)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM and SIGHUP interrupt as Ctrl-C does: half-written files go, the cursor comes back.

    An interrupt that falls into a callback out of compiled code is lost there: numba's compiler
    makes one right after each long wait, so most of them do. It is sent once more then.

    A session's own handlers (`runtime/signals.py`) stand above these while it runs.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, _frame: FrameType | None) -> None:
        # The shell and the system both tell of a terminal that goes; the second word is no news.
        if number == getattr(signal, "SIGHUP", None):
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    def say_unraised(lost: sys.UnraisableHookArgs) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            once_more = threading.Timer(_LATER, _interrupt_main)
            once_more.daemon = True
            once_more.start()
        else:
            said_before(lost)

    said_before, sys.unraisablehook = sys.unraisablehook, say_unraised
    before = {n: signal.signal(n, interrupt) for n in heeded() if n != signal.SIGINT}
    try:
        yield
    finally:
        sys.unraisablehook = said_before
        for number, handler in before.items():
            signal.signal(number, handler)
