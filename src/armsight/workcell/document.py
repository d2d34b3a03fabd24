"""Writes the reference of workcell.toml from the schema, so that it cannot be out of date.

``python -m armsight.workcell.document docs/workcell.md`` renews the part between the two marks.
"""

from __future__ import annotations

import sys
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from armsight.workcell.problems import table_of, unit_of
from armsight.workcell.schema import Workcell

BEGIN = "<!-- generated from the schema: python -m armsight.workcell.document docs/workcell.md -->"
END = "<!-- end of the generated part -->"


def reference() -> str:
    """The tables of all keys, in Markdown."""
    lines: list[str] = []
    for name, info in Workcell.model_fields.items():
        lines += _table(name, info)
    return "\n".join(lines).rstrip() + "\n"


def renewed(page: str) -> str:
    """A page with its generated part renewed.

    Raises:
        ValueError: the page lacks the marks.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError("the page lacks the marks of its generated part")
    return f"{before}{BEGIN}\n\n{reference()}\n{END}{after}"


def _table(name: str, info: FieldInfo) -> list[str]:
    section = table_of(info.annotation)
    assert section is not None
    many = get_origin(info.annotation) is tuple
    header = f"[[{name}]]" if many else f"[{name}]"
    count = "any number of times" if many else ("once" if info.is_required() else "optional")
    about = (section.__doc__ or "").strip()
    lines = [f"### `{header}`", "", f"{about} Given {count}." if many else f"{about}", ""]
    lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
    inner: list[tuple[str, FieldInfo]] = []
    for key, field in section.model_fields.items():
        if _is_tables(field):
            inner.append((f"{name}.{key}", field))
            continue
        unit = unit_of(field)
        meaning = f"{field.description or ''}{f' [{unit}]' if unit else ''}"
        default = "**required**" if field.is_required() else _default(field)
        cells = (f"`{key}`", _value(field), default, meaning)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    lines.append("")
    for key, field in inner:
        lines += _table(key, field)
    return lines


def _is_tables(field: FieldInfo) -> bool:
    return table_of(field.annotation) is not None


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True)
    match value:
        case None:
            return ""
        case str():
            return f'`"{value}"`' if value else ""
        case bool():
            return f"`{str(value).lower()}`"
        case tuple():
            return "`[" + ", ".join(f"{v:g}" for v in value) + "]`"
        case dict():
            return ""
        case float() | int():
            return f"`{value:g}`"
        case _:
            return f"`{value}`"


def _value(field: FieldInfo) -> str:
    rules = [*field.metadata, *_inner(field.annotation)]
    return ", ".join([_type(field.annotation), *_bounds(rules)])


def _inner(annotation: Any) -> list[Any]:
    """Rules of ``X | None`` and of a list's members, where X carries them."""
    for member in get_args(annotation):
        if get_origin(member) is typing.Annotated:
            return [m for info in get_args(member)[1:] for m in getattr(info, "metadata", [])]
    return []


def _bounds(rules: list[Any]) -> Iterator[str]:
    """The tightest lower and upper bound."""
    found = {n: [getattr(r, n) for r in rules if getattr(r, n, None) is not None] for n in _SIGNS}
    lowest = [(max(found[n]), sign) for n, sign in _SIGNS.items() if n in ("gt", "ge") and found[n]]
    highest = [
        (min(found[n]), sign) for n, sign in _SIGNS.items() if n in ("lt", "le") and found[n]
    ]
    for bound, sign in (*sorted(lowest)[-1:], *sorted(highest)[:1]):
        yield f"{sign} {bound:g}"


_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def _type(annotation: Any) -> str:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is typing.Annotated:
        return _type(inner[0])
    if origin is Literal:
        return " or ".join(f'`"{value}"`' for value in inner)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(a) for a in inner if a is not type(None)))
    if origin is tuple:
        if Ellipsis in inner:
            return "list of numbers"
        return f"{len(inner)} numbers"
    if origin is dict:
        return "table of lists" if get_origin(_bare(inner[1])) is tuple else "table"
    names = {float: "number", int: "whole number", str: "string", bool: "true or false"}
    return names.get(annotation, "value")


def _bare(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is typing.Annotated else annotation


def main() -> None:
    """Renew the pages named on the command line."""
    for name in sys.argv[1:]:
        page = Path(name)
        page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
