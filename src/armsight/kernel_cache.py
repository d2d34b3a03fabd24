"""Where compiled kernels are kept when neither the package nor the user's cache can be written."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import MutableMapping
from pathlib import Path

KEY = "NUMBA_CACHE_DIR"


def find_place(
    environment: MutableMapping[str, str], package: Path, temporary: Path | None = None
) -> None:
    """Name a folder for numba, which refuses to begin where it finds none.

    It looks beside the source and in the user's cache. An administrator's installation used by a
    service without a home has neither; there it is a folder of this user's among the temporary
    ones. Compiled kernels are code, so one that somebody else could have filled is not taken.

    Args:
        environment: of the process; :data:`KEY` is set in it where that is needed.
        package: folder of the sources.
        temporary: where temporary files lie, if not where the system says.
    """
    if environment.get(KEY) or os.access(package, os.W_OK):
        return
    home = environment.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if _can_be_made(Path(home) / "numba"):
        return
    above = Path(temporary or tempfile.gettempdir())
    mine = above / f"armsight-kernels-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    try:
        mine.mkdir(mode=0o700, exist_ok=True)
        environment[KEY] = str(mine if _is_ours(mine) else tempfile.mkdtemp(dir=above))
    except OSError:
        return  # nothing can be written at all; numba says so


def _can_be_made(folder: Path) -> bool:
    """Whether a folder can be written; it is made, as numba would."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _is_ours(folder: Path) -> bool:
    """Whether nobody else can have put anything there."""
    seen = folder.lstat()
    others = stat.S_IWGRP | stat.S_IWOTH
    return stat.S_ISDIR(seen.st_mode) and seen.st_uid == os.getuid() and not seen.st_mode & others
