"""Short TOML files of what a user describes (a vehicle, a port): read, and refused in one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from armsight.errors import UsageError

MOST = 100_000
"""A longer file is none of ours [bytes]."""
M = TypeVar("M", bound=BaseModel)


def read_toml(what: str, file: Path, model: type[M], hint: str = "") -> M:
    """What a file says.

    Args:
        what: it describes, in words.
        file: to read.
        model: of what may stand in it.
        hint: what to do about a file that cannot be read.

    Raises:
        UsageError: it cannot be read, or says what cannot be.
    """
    try:
        data = file.read_bytes()
    except (OSError, ValueError) as error:  # a name may hold what no file's name can
        why = getattr(error, "strerror", None) or error
        raise UsageError(f"{what} {str(file)!r}: cannot be read ({why}){hint}") from None
    if len(data) > MOST:
        raise UsageError(f"{what} {file}: {len(data)} bytes; a {what}'s file is short")
    try:
        raw: dict[str, Any] = tomllib.loads(data.decode())
    except (ValueError, RecursionError) as error:  # also a number of more digits than Python takes
        raise UsageError(f"{what} {file}: not TOML: {error}") from None
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(step) for step in first["loc"])
        said = str(first["msg"]).removeprefix("Value error, ")
        raise UsageError(f"{what} {file}: {where + ': ' if where else ''}{said}") from None
