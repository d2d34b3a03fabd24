"""A port of one's own as a file: the measures of its drawing, in millimetres.

The table's entries are written in the same words, to start from.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from armsight.charging.ports.outline import Outline, inside_any
from armsight.charging.ports.table import MM, PORTS, Pin, Port, Rim
from armsight.charging.toml_file import read_toml
from armsight.errors import UsageError

RINGS = (0.6, 0.9)
"""Radius of the inner of the two rings that a search begins with, over that of the outer one."""
Place = Annotated[float, Field(ge=-150.0, le=150.0, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0.5, le=150.0, allow_inf_nan=False)]
Spread = Annotated[float, Field(ge=0.0, le=150.0, allow_inf_nan=False)]
Tolerance = Annotated[float, Field(gt=0.0, le=5.0, allow_inf_nan=False)]
Word = Annotated[str, Field(min_length=1, max_length=40)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Shape(_Table):
    """A circle, a slot with round ends along x (``spread``), either cut at ``flat``."""

    x: Place = 0.0
    y: Place = 0.0
    radius: Size
    spread: Spread = 0.0
    flat: Place | None = None

    @model_validator(mode="after")
    def _cut(self) -> _Shape:
        if self.flat is not None and not abs(self.flat - self.y) < self.radius:
            raise ValueError(f"flat is {self.flat:g}, which does not cut it")
        return self

    def outline(self) -> Outline:
        flat = None if self.flat is None else self.flat * MM
        return Outline(self.x * MM, self.y * MM, self.radius * MM, self.spread * MM, flat)


class _Edge(_Shape):
    """An edge to see, at one depth."""

    name: Word
    kind: Literal["mouth", "pedestal", "recess"]
    z: Place = 0.0
    size_tolerance: Tolerance = 0.3
    place_tolerance: Tolerance = 0.2
    depth_tolerance: Tolerance = 0.3
    fit: bool = True

    def rim(self) -> Rim:
        radius, place, depth = (
            tolerance * MM
            for tolerance in (self.size_tolerance, self.place_tolerance, self.depth_tolerance)
        )
        return Rim(
            self.name, self.kind, self.outline(), self.z * MM, radius, place, self.fit, depth
        )


class _Pin(_Table):
    name: Word
    x: Place
    y: Place
    diameter: Size
    z: Place = 0.0

    def pin(self) -> Pin:
        return Pin(self.name, self.x * MM, self.y * MM, self.diameter * MM, self.z * MM)


class _Drawing(_Table):
    """See docs/charging.md."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    title: Annotated[str, Field(min_length=1, max_length=80)]
    plug: bool = False
    depth: Size
    chamfer: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] = 1.0
    turns: Annotated[int, Field(ge=1, le=12)] = 1
    contains: str = ""
    plate: _Shape
    plate_z: Place = 0.0
    edge: Annotated[tuple[_Edge, ...], Field(min_length=3, max_length=60)]
    pin: Annotated[tuple[_Pin, ...], Field(max_length=40)] = ()

    @model_validator(mode="after")
    def _possible(self) -> _Drawing:
        names = [edge.name for edge in self.edge]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"two edges are called {twice!r}")
        if self.contains and self.contains not in PORTS:
            raise ValueError(f"contains {self.contains!r}: no such type; there are {_types()}")
        kinds = {
            kind: [edge for edge in self.edge if edge.kind == kind]
            for kind in ("mouth", "pedestal", "recess")
        }
        for kind, least in (("mouth", 1), ("recess", 2)):
            if len(kinds[kind]) < least:
                what = "a mouth" if kind == "mouth" else "two recesses: else no roll can be told"
                raise ValueError(f"it needs {what}")
        self._has_rings(kinds["mouth"][0], kinds["pedestal"])
        mouths = [edge.outline() for edge in kinds["mouth"]]
        for edge in () if self.plug else kinds["recess"]:
            if not inside_any(mouths, np.array([[edge.x * MM, edge.y * MM]])).all():
                raise ValueError(f"the recess {edge.name!r} lies outside of every mouth")
        return self

    def _has_rings(self, mouth: _Edge, pedestals: list[_Edge]) -> None:
        """A search begins with two rings about the origin."""
        low, high = RINGS
        if (mouth.x, mouth.y, mouth.spread) != (0.0, 0.0, 0.0):
            raise ValueError(f"the first mouth, {mouth.name!r}, has to be round about the origin")
        if self.plug:
            inner, outer, pair = mouth.radius, self.plate.radius, "its mouth and its plate"
        else:
            about = [p.radius for p in pedestals if (p.x, p.y, p.spread) == (0.0, 0.0, 0.0)]
            inner, outer = max(about, default=0.0), mouth.radius
            pair = "a pedestal about the origin and the mouth"
        if not low <= inner / outer <= high:
            raise ValueError(
                f"{pair} have radii of {inner:g} and {outer:g}: {inner / outer:.2f}; only rings of "
                f"{low:g} to {high:g} are found"
            )

    def port(self) -> Port:
        return Port(
            self.name,
            self.title,
            self.plug,
            tuple(edge.rim() for edge in self.edge),
            tuple(pin.pin() for pin in self.pin),
            self.plate.outline(),
            self.plate_z * MM,
            self.depth * MM,
            self.chamfer * MM,
            self.turns,
            self.contains,
        )


def read_drawing(file: Path) -> Port:
    """The port that a drawing's file says.

    Raises:
        UsageError: it cannot be read, or says what cannot be.
    """
    return read_toml("drawing", file, _Drawing).port()


def add_drawing(file: Path) -> Port:
    """The port of a file, known by its name to whoever searches from now on.

    Raises:
        UsageError: as :func:`read_drawing`, or another port has its name.
    """
    entry = read_drawing(file)
    if PORTS.get(entry.name, entry) != entry:
        raise UsageError(
            f"drawing {file}: name: another port is called {entry.name}; there are {_types()}"
        )
    PORTS[entry.name] = entry
    return entry


def written(port: Port, name: str) -> str:
    """The drawing of a port as TOML, under a name."""

    def mm(value: float) -> float:
        return round(value / MM, 6)

    def shape(outline: Outline) -> dict[str, Any]:
        words = {"x": outline.x, "y": outline.y, "radius": outline.radius, "spread": outline.spread}
        if outline.flat is not None:
            words["flat"] = outline.flat
        return {key: mm(value) for key, value in words.items()}

    lines = [
        "# Measures in mm, from the middle of the contacts: x right, y up for who looks at it, z",
        "# towards them. Tolerances are standard deviations between makes. See docs/charging.md.",
        f"name = {_text(name)}",
        f"title = {_text(port.title)}",
        f"plug = {_text(port.plug)}",
        f"depth = {mm(port.depth)}",
        f"chamfer = {mm(port.chamfer)}",
        f"turns = {port.turns}",
        f"contains = {_text(port.contains)}",
        f"plate = {{ {', '.join(f'{k} = {v}' for k, v in shape(port.plate).items())} }}",
        f"plate_z = {mm(port.plate_z)}",
    ]
    for rim in port.rims:
        row = {"name": rim.name, "kind": rim.kind, **shape(rim.outline), "z": mm(rim.z)}
        row["size_tolerance"] = mm(rim.radius_tolerance)
        row["place_tolerance"] = mm(rim.place_tolerance)
        row["depth_tolerance"] = mm(rim.depth_tolerance)
        row["fit"] = rim.fit
        lines += ["", "[[edge]]", *(f"{key} = {_text(value)}" for key, value in row.items())]
    for pin in port.pins:
        place = {"x": pin.x, "y": pin.y, "diameter": pin.diameter, "z": pin.z}
        lines += ["", "[[pin]]", f"name = {_text(pin.name)}"]
        lines += [f"{key} = {mm(value)}" for key, value in place.items()]
    return "\n".join(lines) + "\n"


def _text(value: object) -> str:
    """A value as TOML has it: JSON, for words, numbers and truth."""
    return json.dumps(value)


def _types() -> str:
    return ", ".join(PORTS)
