"""One process a cell: two loops that command the same arm would each undo the other's guard."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from armsight.errors import CellBusyError

RUNTIME_DIRECTORY_VARIABLE = "ARMSIGHT_RUNTIME_DIR"


def runtime_directory() -> Path:
    """The user's folder for locks: private, on this machine, gone after a restart where possible.

    ``ARMSIGHT_RUNTIME_DIR`` overrides it, for tests and containers.
    """
    override = os.environ.get(RUNTIME_DIRECTORY_VARIABLE)
    if override:
        folder = Path(override)
    elif os.environ.get("XDG_RUNTIME_DIR"):
        folder = Path(os.environ["XDG_RUNTIME_DIR"]) / "armsight"
    else:
        user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
        folder = Path(tempfile.gettempdir()) / f"armsight-{user}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


@contextmanager
def cell_lock(name: str) -> Iterator[None]:
    """Hold the cell of this name for as long as the context lasts.

    The operating system drops the lock when the process ends, however it ends.

    Raises:
        CellBusyError: another process (or session) holds it; names its process.
    """
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", name)[:60]
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    path = runtime_directory() / f"{safe}-{digest}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if not _try_lock(descriptor):
            holder = os.read(descriptor, 64).decode(errors="replace").strip() or "unknown"
            raise CellBusyError(
                f"cell '{name}': process {holder} is working with it already; "
                f"stop that one first (lock: {path})"
            )
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)  # drops the lock


def _try_lock(descriptor: int) -> bool:
    try:
        import fcntl
    except ImportError:  # pragma: no cover - Windows
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
