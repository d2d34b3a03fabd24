"""One process an arm: two loops that command the same one would each undo the other's guard."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from armsight.errors import CellBusyError

RUNTIME_DIRECTORY_VARIABLE = "ARMSIGHT_RUNTIME_DIR"
ADDRESS_WORDS = {
    *("host", "hostname", "ip", "address", "addr", "port", "serial", "device", "url", "uri", "tty"),
    *("bus", "channel", "interface", "id"),
}
"""A key of ``connection`` with one of these says where a device is; others, how it is used."""


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


def arm_address(driver: Callable[..., Any], connection: Mapping[str, Any]) -> str:
    """What tells an arm from all others: its driver and where its connection says that it is.

    Two cell files may name one driver by its class and by its entry point, and differ in how they
    use it (``timeout``): it is one arm. Where no key says where it is, all of them tell it.

    Args:
        driver: its class, from :func:`armsight.workcell.drivers.find_driver`.
        connection: the cell file's ``[robot.connection]``.
    """
    where = {k: v for k, v in connection.items() if ADDRESS_WORDS & set(k.lower().split("_"))}
    told = ", ".join(
        f"{k}={str(v).strip().lower()}" for k, v in sorted((where or connection).items())
    )
    name = getattr(driver, "__qualname__", type(driver).__qualname__)
    return f"{driver.__module__}:{name}" + (f" at {told}" if told else "")


def arm_lock(address: str, cell: str) -> AbstractContextManager[None]:
    """Hold a real arm for as long as the context lasts, whatever cell file it stands in.

    Args:
        address: from :func:`arm_address`.
        cell: who holds it, for others.

    Raises:
        CellBusyError: another process (or session) holds it; names its process.
    """
    return _lock(f"arm {address}", f"cell '{cell}': the arm {address}", cell)


def cell_lock(name: str) -> AbstractContextManager[None]:
    """Hold the cell of this name, which has no arm that could be told from others.

    Raises:
        CellBusyError: another process (or session) holds it; names its process.
    """
    return _lock(name, f"cell '{name}'", name)


@contextmanager
def _lock(name: str, what: str, holder: str) -> Iterator[None]:
    """The operating system drops the lock when the process ends, however it ends."""
    safe = re.sub(r"[^A-Za-z0-9_.-]", "_", name)[:60]
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    path = runtime_directory() / f"{safe}-{digest}.lock"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if not _try_lock(descriptor):
            other = os.read(descriptor, 256).decode(errors="replace").strip() or "unknown"
            raise CellBusyError(
                f"{what}: process {other} is working with it already; "
                f"stop that one first (lock: {path})"
            )
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()} (cell '{holder[:60]}')\n".encode(), 0)
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
