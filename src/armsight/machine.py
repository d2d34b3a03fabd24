"""This machine and its processes: cores, names that figures are told with, children's end."""

from __future__ import annotations

import multiprocessing
import os
import platform
import shutil
import signal
import subprocess
import threading
from functools import cache
from pathlib import Path

from armsight import __version__


def usable_cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_with_parent() -> None:
    """In a worker process: end when its parent does, by whatever signal.

    A pool's workers wait for work at a pipe of which each holds both ends, so the end of a parent
    that was killed (memory ran out) is not told them, and they would keep theirs for ever.
    """
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def begin_worker() -> None:
    """In a pool's worker: Ctrl-C is for the parent, which sends everybody home; so is its end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def processor() -> str:
    """The processor's name as the operating system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def memory_gib() -> float:
    """Physical memory [GiB], 0 where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (ValueError, OSError):
        return 0.0


@cache
def machine() -> str:
    """One line: processor, cores, memory, system, Python. Names no host and no person."""
    return (
        f"{processor()}, {usable_cores()} cores, {memory_gib():.0f} GiB, "
        f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    )


@cache
def commit() -> str:
    """Short commit of the working copy, with ``+`` when it has changes; else the version."""
    git = shutil.which("git")
    root = Path(__file__).resolve().parents[2]
    if git is None or not (root / ".git").exists():
        return f"v{__version__}"

    def ask(*words: str) -> str:
        answer = subprocess.run(  # noqa: S603 - fixed words, no shell
            [git, "-C", str(root), *words], capture_output=True, text=True, timeout=10, check=False
        )
        return answer.stdout.strip()

    try:
        short = ask("rev-parse", "--short=12", "HEAD")
        changed = ask(
            "status", "--porcelain", "--untracked-files=no", "--", "src", "pyproject.toml"
        )
    except (OSError, subprocess.TimeoutExpired):
        return f"v{__version__}"
    return (short + ("+" if changed else "")) if short else f"v{__version__}"
