"""Who goes first on a busy machine, as far as the system grants it.

The command path's process asks for real-time priority. So do, behind it, those of the session's
threads through which evidence comes to it (cameras, sensing, map): a picture that waits for a core
grows old, and the arm slows down. The rest of the session (planner, task, page) asks for a larger
share of the processor than other programs have.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress

LINUX = sys.platform == "linux"
"""Elsewhere a thread's number is none that these calls would understand."""
FIFO = 20
"""Before every ordinary program, behind what the system itself runs at real time (50 and above)."""
EVIDENCE = 10
"""That of the threads through which evidence comes, behind the command path."""
BRINGERS = ("armsight-camera ", "armsight-wrench", "armsight-link", "armsight-wire")
"""How the names of such threads begin, besides those of the loop's components."""
NICE = -10
"""About nine times the share of an ordinary program."""


def raise_priority() -> str:
    """Let all threads of this process go first; says how, or why not.

    Threads that these begin later go first as well. Linux keeps a share of every core for the
    others, so that a thread which never rests cannot lock the machine.
    """
    if not LINUX:
        return "ordinary priority: only Linux knows it by thread"
    try:
        _schedule(os.SCHED_FIFO, FIFO)
    except OSError as error:
        return f"ordinary priority: real time is refused ({error.strerror})"
    return f"real-time priority (SCHED_FIFO {FIFO})"


def go_first() -> None:
    """Let this thread, and those that it begins, go before other programs, where it is granted."""
    if LINUX:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(EVIDENCE))


def lower_priority() -> None:
    """Back to that of every other program."""
    if LINUX and os.sched_getscheduler(0) == os.SCHED_FIFO:
        _schedule(os.SCHED_OTHER, 0)


@contextmanager
def favoured() -> Iterator[None]:
    """The threads of this process, and those that they begin, are favoured where that is granted.

    Those that bring evidence go before other programs. Where it is refused nothing happens.
    """
    if not LINUX:
        yield
        return
    before = {thread: os.getpriority(os.PRIO_PROCESS, thread) for thread in _threads()}
    _nice({thread: min(NICE, nice) for thread, nice in before.items()})
    bringers = [t.native_id for t in threading.enumerate() if t.name.startswith(BRINGERS)]
    _real_time(bringers, os.SCHED_FIFO, EVIDENCE)
    try:
        yield
    finally:
        _real_time(bringers, os.SCHED_OTHER, 0)
        usual = before.get(threading.get_native_id(), 0)
        _nice({thread: before.get(thread, usual) for thread in _threads()})


def offered() -> tuple[str, bool, bool]:
    """What the system grants, tried in a thread of its own that ends at once.

    Returns:
        In words; whether real-time priority is granted, and whether a larger share is.
    """
    granted = [False, False]

    def attempt() -> None:
        if not LINUX:
            return
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
            granted[1] = True
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO))
            granted[0] = True

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    real_time, share = granted
    words = (
        f"real-time priority {'granted' if real_time else 'refused'} to command path and evidence, "
        f"a larger share of the processor {'granted' if share else 'refused'} to the rest"
    )
    return words, real_time, share


def _schedule(policy: int, priority: int) -> None:
    for thread in _threads():
        os.sched_setscheduler(thread, policy, os.sched_param(priority))


def _real_time(threads: Iterable[int | None], policy: int, priority: int) -> None:
    for thread in threads:
        if thread is not None:
            with suppress(OSError):  # refused, or the thread has ended
                os.sched_setscheduler(thread, policy, os.sched_param(priority))


def _nice(wanted: dict[int, int]) -> None:
    for thread, nice in wanted.items():
        with suppress(OSError):  # refused, or the thread has ended
            os.setpriority(os.PRIO_PROCESS, thread, nice)


def _threads() -> list[int]:
    """The system's numbers of this process's threads that Python knows."""
    return [t.native_id for t in threading.enumerate() if t.native_id is not None]
