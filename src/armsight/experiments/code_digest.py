"""Which code this is: a digest of the package's files, code and data alike."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import armsight


@cache
def code_digest() -> str:
    """Of the files of this package, as they were when this was first asked in this process."""
    return digest_of(Path(armsight.__file__).parent)


def digest_of(folder: Path) -> str:
    """Of all files below a folder, their places and their contents; bytecode is left out."""
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        if file.is_file() and "__pycache__" not in file.parts:
            place, content = file.relative_to(folder).as_posix().encode(), file.read_bytes()
            digest.update(b"%d %s %d\n" % (len(place), place, len(content)))
            digest.update(content)
    return digest.hexdigest()
