"""Files that appear whole or not at all: written beside their place, then moved there."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from armsight.errors import ArmsightError


@contextmanager
def replacing(file: Path, error: type[ArmsightError] = ArmsightError) -> Iterator[Path]:
    """A name beside a file, with its ending, that becomes the file when the block ends well.

    Whoever reads sees the old file or the new one, never half; a block that raises leaves the old.
    Folders on the way are made, links are followed, and a file that is replaced keeps its mode.

    Args:
        file: what is to be written.
        error: raised when it cannot be.

    Raises:
        ArmsightError: of that type; the folder cannot be made or written, or the disk is full.
    """
    target = Path(os.path.realpath(file))
    if target.is_char_device() or target.is_fifo():  # /dev/null, a pipe: nothing to move there
        yield target
        return
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            temporary.touch(exist_ok=False)
            if target.exists():
                temporary.chmod(target.stat().st_mode & 0o777)
            yield temporary
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as cause:
        raise error(f"{file}: cannot be written: {cause.strerror or cause}") from None


def write_atomically(
    file: Path, *parts: bytes | memoryview, error: type[ArmsightError] = ArmsightError
) -> None:
    """Write bytes, one part after the other, whole or not at all.

    Raises:
        ArmsightError: of the type ``error``; see :func:`replacing`.
    """
    with replacing(file, error) as temporary, temporary.open("wb") as stream:
        for part in parts:
            stream.write(part)


def write_text(file: Path, text: str, error: type[ArmsightError] = ArmsightError) -> None:
    """Write UTF-8 text whole or not at all.

    Raises:
        ArmsightError: of the type ``error``; see :func:`replacing`.
    """
    write_atomically(file, text.encode(), error=error)
