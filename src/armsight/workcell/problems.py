"""What is wrong with a workcell file, in words a person can act on: one line a problem."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from armsight.errors import WorkcellError
from armsight.workcell.fields import Connection


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        where: dotted path of the key, such as ``camera[2] "north".rate_hz``; tables of an array
            count from 1.
        what: what was found and what is expected.
    """

    where: str
    what: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}" if self.where else self.what


class WorkcellFileError(WorkcellError):
    """A workcell file is broken; carries every problem that was found.

    Attributes:
        file: as the caller named it.
        problems: in the order of the file's tables.
    """

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.file, self.problems = file, tuple(problems)
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


def nearest(word: str, known: Iterable[str]) -> str:
    """``did you mean "x"? `` or nothing, then the known words."""
    choices = list(known)
    close = difflib.get_close_matches(word.lower(), choices, n=1, cutoff=0.55)
    hint = f'did you mean "{close[0]}"? ' if close else ""
    return f"{hint}known: {', '.join(choices)}" if choices else hint.strip()


def shown(value: object) -> str:
    """A value as the file would write it, shortened."""
    match value:
        case str():
            text = '"' + value + '"'
        case bool():
            text = str(value).lower()
        case Mapping():
            text = "a table"
        case list() | tuple():
            text = "[" + ", ".join(shown(v) for v in value) + "]"
        case float() if math.isfinite(value) and value == round(value):
            text = f"{value:.0f}"
        case _:
            text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def from_validation(error: ValidationError, raw: Any, model: type[BaseModel]) -> list[Problem]:
    """Problems of a pydantic error about ``raw``; unions and tuples named once."""
    problems: dict[str, Problem] = {}
    for details in error.errors(include_url=False, include_context=True):
        entry: dict[str, Any] = dict(details)
        location = _in_file(entry["loc"], raw)
        if entry["type"] == "missing" and isinstance(location[-1], int):
            location = location[:-1]  # a list that is too short
            entry |= {"type": "too_short", "input": _at(raw, location), "ctx": {}}
        where = path(location, raw)
        problems.setdefault(where, Problem(where, _what(entry, location, model)))
    return list(problems.values())


def path(location: Sequence[int | str], raw: Any) -> str:
    """Dotted path of a location; entries of arrays of tables carry their number and name."""
    words, here = "", raw
    for step in location:
        here = _enter(here, step)
        if isinstance(step, int):
            words += f"[{step + 1}]"
            name = here.get("name") if isinstance(here, Mapping) else None
            words += f' "{name}"' if isinstance(name, str) else ""
        else:
            words += f".{step}" if words else step
    return words


def _at(raw: Any, location: Sequence[int | str]) -> Any:
    for step in location:
        raw = _enter(raw, step)
    return raw


def _enter(here: Any, step: int | str) -> Any:
    try:
        return here[step]
    except (KeyError, IndexError, TypeError):
        return None


def _in_file(location: Sequence[int | str], raw: Any) -> tuple[int | str, ...]:
    """The location without pydantic's own steps (union members, ``[key]``)."""
    kept: list[int | str] = []
    here = raw
    for i, step in enumerate(location):
        inside = isinstance(here, Mapping) if isinstance(step, str) else isinstance(here, list)
        if not inside or step == "[key]":
            continue
        present = not isinstance(here, Mapping) or step in here
        if not present and i < len(location) - 1:
            continue
        kept.append(step)
        here = _enter(here, step)
    return tuple(kept)


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a string",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}


def _what(entry: dict[str, Any], location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    kind, context, found = entry["type"], entry.get("ctx", {}), shown(entry["input"])
    owner, info = describe(model, location)
    about = f" ({_about(info)})" if info is not None else ""
    if kind == "extra_forbidden":
        known = owner.model_fields if owner is not None else {}
        return f"unknown key; {nearest(str(location[-1]), known)}"
    if kind == "missing":
        return f"missing{about}"
    if kind == "value_error":
        return str(context.get("error", entry["msg"]))
    expected = _EXPECTED.get(kind)
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        word = {"greater_than": "above", "greater_than_equal": "at least"}
        word |= {"less_than": "below", "less_than_equal": "at most"}
        bound = next(iter(v for k, v in context.items() if k in ("gt", "ge", "lt", "le")))
        expected = f"{word[kind]} {bound:g}"
    elif kind == "literal_error":
        return f"found {found}, expected {context['expected']}{about}"
    elif kind == "string_pattern_mismatch":
        expected = "a letter, then letters, digits, '_', '-' or '.', at most 64"
    elif kind in ("too_short", "too_long"):
        expected = _how_many(info)
    if kind == "tuple_type" and isinstance(entry["input"], Mapping):
        expected = f"a list of tables; write {several(location)}"
    if info is not None and info.annotation == Connection:
        expected = "a string, a number, true or false"
    if expected is None:
        expected = entry["msg"][0].lower() + entry["msg"][1:]
    return f"found {found}, expected {expected}{about}"


def several(location: Sequence[int | str]) -> str:
    """How a table is headed that is given any number of times."""
    return f"[[{'.'.join(str(step) for step in location)}]]"


def not_toml(error: ValueError, model: type[BaseModel]) -> str:
    """What is wrong with a text that is no TOML; a second `[camera]` wants two brackets more."""
    twice = re.match(r"Cannot declare \(([^)]*)\) twice", str(error))
    if twice is None:
        return f"not valid TOML: {error}"
    location = re.findall(r"'([^']*)'", twice[1])
    _, info = describe(model, location)
    listed = info is not None and get_origin(info.annotation) is tuple
    hint = f"; write {several(location)} for each of several" if listed else ""
    return f"not valid TOML: {error}{hint}"


def _how_many(info: FieldInfo | None) -> str:
    """How many values a list key takes: fixed lists say it by their type."""
    annotation = info.annotation if info is not None else None
    for candidate in (annotation, *get_args(annotation)):
        if get_origin(candidate) is tuple and Ellipsis not in get_args(candidate):
            return f"{len(get_args(candidate))} values"
    return "1 to 16 values, one a joint"


def _about(info: FieldInfo) -> str:
    unit = unit_of(info)
    text = re.split(r"[;:.] |[;:.]$", info.description or "")[0]
    return f"{text} [{unit}]" if unit else text


def unit_of(info: FieldInfo) -> str:
    """Unit of a key, or empty."""
    extra = info.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def describe(
    model: type[BaseModel], location: Sequence[int | str]
) -> tuple[type[BaseModel] | None, FieldInfo | None]:
    """The table that owns a location, and the key's description (None for an unknown key)."""
    owner: type[BaseModel] | None = model
    info: FieldInfo | None = None
    for i, step in enumerate(location):
        if isinstance(step, int) or owner is None:
            continue
        info = owner.model_fields.get(step)
        if info is None:
            return owner, None
        inner = table_of(info.annotation)
        if inner is not None and i < len(location) - 1:
            owner = inner
        elif inner is None:
            return owner, info
    return owner, info


def table_of(annotation: Any) -> type[BaseModel] | None:
    """The table that an annotation such as ``tuple[CameraSection, ...]`` holds, or None."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in get_args(annotation):
        found = table_of(inner)
        if found is not None:
            return found
    return None
