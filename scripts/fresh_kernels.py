"""Forgets compiled kernels whose sources have changed; `./run` calls this when any has.

numba keeps machine code beside the source and notices when a function's own file changes. It does
not notice when another function that was compiled into it changes, nor a constant from another
file. Here a kernel's key is its file, with all kernel files that it imports, directly or not, and
the files that it takes constants from; what has another key than last time is deleted, no more.

    python scripts/fresh_kernels.py SOURCE_FOLDER
"""

from __future__ import annotations

import ast
import hashlib
import json
import sys
from functools import cache
from pathlib import Path

KEPT = Path("armsight/__pycache__/kernels.json")


def main(source: Path) -> None:
    """Delete what is stale under the folder that holds ``armsight/``, and keep the new keys."""
    keys = {
        str(file.relative_to(source)): key_of(file, source)
        for file in sorted((source / "armsight").rglob("*.py"))
        if is_kernel(file)
    }
    kept = source / KEPT
    try:
        before = json.loads(kept.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        before = {}
    for name, key in keys.items():
        if before.get(name) != key:
            file = source / name
            for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.nb[ci]"):
                compiled.unlink(missing_ok=True)
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps(keys, indent=1), encoding="utf-8")


@cache
def is_kernel(file: Path) -> bool:
    """Whether functions of the file are compiled."""
    return b"njit" in file.read_bytes()


def key_of(file: Path, source: Path) -> str:
    """Changes when the file does, or anything that is compiled into it."""
    parts = {file}
    waiting = [file]
    while waiting:
        for other in imported(waiting.pop(), source) - parts:
            parts.add(other)
            if is_kernel(other):  # of others only constants are taken
                waiting.append(other)
    digest = hashlib.sha256()
    for part in sorted(parts):
        digest.update(str(part.relative_to(source)).encode() + b"\0" + part.read_bytes() + b"\0")
    return digest.hexdigest()


@cache
def imported(file: Path, source: Path) -> frozenset[Path]:
    """The files of armsight that a file imports from."""
    found = set()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("armsight"):
            place = source.joinpath(*(node.module or "").split("."))
            names = [place.with_suffix(".py"), place / "__init__.py"]
            names += [place / f"{alias.name}.py" for alias in node.names]
            found |= {name for name in names if name.is_file()}
    return frozenset(found)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
