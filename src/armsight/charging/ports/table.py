"""Measures of charging inlets and plugs: the one table that everything else is made from.

Frame ``port``: origin at the middle of the AC contacts on the face that carries them, x right and
y up for who looks at it, z towards who looks. A plug's frame is the same, looked at from its mouth.
Layouts are mirror-symmetric in x, so that both speak of the same pins at the same places.

Sources: Type 1 and Type 2 pins, connector nose and plug outside are published figures; pitch of
the DC contacts from a public measurement by hand (27.0 mm; others say 26); the rest is read off
photographs, the DC recesses of CCS1 (19 mm) off other people's rendered socket. None of it is the
standards' own sheets, hence the tolerances: a fit treats every radius and every place as uncertain
by as much (docs/charging.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armsight.charging.ports.outline import Outline
from armsight.errors import UsageError

RimKind = Literal["mouth", "pedestal", "recess"]
MM = 1e-3


@dataclass(frozen=True)
class Rim:
    """An edge to see: a closed curve at one depth.

    Attributes:
        name: such as ``mouth`` or ``PE``.
        kind: what it borders.
        outline: its shape in the port's x, y.
        z: its depth in the port's frame [m].
        radius_tolerance: standard deviation of its size between makes [m].
        place_tolerance: standard deviation of its place between makes [m].
        depth_tolerance: standard deviation of its z between makes, chamfers included [m].
        fit: whether a pose may lean on it (a latch slot looks different in every make).
    """

    name: str
    kind: RimKind
    outline: Outline
    z: float = 0.0
    radius_tolerance: float = 0.3 * MM
    place_tolerance: float = 0.2 * MM
    fit: bool = True
    depth_tolerance: float = 0.3 * MM


@dataclass(frozen=True)
class Pin:
    """A contact.

    Attributes:
        name: as in IEC 62196.
        x, y: its axis [m].
        diameter: of the pin, or of a plug's hole for it [m].
        z: its tip [m].
    """

    name: str
    x: float
    y: float
    diameter: float
    z: float


@dataclass(frozen=True)
class Port:
    """An inlet, or a plug seen into its mouth.

    Attributes:
        name: key of the table.
        title: for people.
        plug: whether it is a plug.
        rims: what can be seen of it.
        pins: its contacts.
        plate: outline of the part that carries it [m].
        plate_z: depth of the plate's or sleeve's front [m].
        depth: of the cavity below the face [m].
        chamfer: of the mouth [m].
        turns: how many rolls of equal steps look alike, were it not for sizes and the flat.
        contains: name of the type that it contains, seen alone; or empty.
    """

    name: str
    title: str
    plug: bool
    rims: tuple[Rim, ...]
    pins: tuple[Pin, ...]
    plate: Outline
    plate_z: float
    depth: float
    chamfer: float
    turns: int
    contains: str = ""

    def of_kind(self, kind: RimKind) -> tuple[Rim, ...]:
        """Its rims of one kind."""
        return tuple(rim for rim in self.rims if rim.kind == kind)

    @property
    def radius(self) -> float:
        """Radius of the round mouth about the origin [m]: the port's size for who searches it."""
        return self.of_kind("mouth")[0].outline.radius


def port(name: str) -> Port:
    """The table's entry.

    Raises:
        UsageError: there is none; names those that there are.
    """
    try:
        return PORTS[name]
    except KeyError:
        raise UsageError(f"no port or plug '{name}'; choose one of {', '.join(PORTS)}") from None


def drawn(nominal: Port, rng: np.random.Generator) -> Port:
    """A make of the port: every measure drawn within its tolerance (cut at two of them)."""

    def off(sigma: float) -> float:
        return float(np.clip(rng.standard_normal(), -2, 2) * sigma)

    rims = []
    for rim in nominal.rims:
        grown = rim.outline.grown(off(rim.radius_tolerance))
        dx, dy = off(rim.place_tolerance), off(rim.place_tolerance)
        flat = None if grown.flat is None else grown.flat + dy
        moved = replace(grown, x=grown.x + dx, y=grown.y + dy, flat=flat)
        rims.append(replace(rim, outline=moved))
    return replace(nominal, rims=tuple(rims))


def _mm(
    x: float, y: float, radius: float, spread: float = 0.0, flat: float | None = None
) -> Outline:
    return Outline(x * MM, y * MM, radius * MM, spread * MM, None if flat is None else flat * MM)


_RECESS_2 = {"PE": 14.5, "N": 14.5, "L1": 14.5, "L2": 14.5, "L3": 14.5, "CP": 10.0, "PP": 10.0}
_PLACE_2 = {
    "PE": (0.0, 0.0),
    "N": (-16.0, 0.0),
    "L1": (16.0, 0.0),
    "L2": (8.0, -13.9),
    "L3": (-8.0, -13.9),
    "CP": (8.0, 11.2),
    "PP": (-8.0, 11.2),
}
_PLACE_1 = {
    "L1": (7.85, 6.8),
    "L2": (-7.85, 6.8),
    "CP": (10.65, -5.6),
    "CS": (-10.65, -5.6),
    "PE": (0.0, -10.8),
}
_RECESS_1 = {"L1": 9.4, "L2": 9.4, "CP": 7.0, "CS": 7.0, "PE": 8.6}
_PIN_1 = {"L1": 3.6, "L2": 3.6, "CP": 1.5, "CS": 1.5, "PE": 2.8}


def _type2_core() -> tuple[tuple[Rim, ...], tuple[Pin, ...]]:
    rims = [Rim("pedestal", "pedestal", _mm(0, 0, 26.1, flat=18.0), 0, 0.4 * MM, 0.35 * MM)]
    pins = []
    for name, (x, y) in _PLACE_2.items():
        small = name in ("CP", "PP")
        rims.append(Rim(name, "recess", _mm(x, y, 0.5 * _RECESS_2[name]), 0, 0.25 * MM, 0.2 * MM))
        pins.append(
            Pin(name, x * MM, y * MM, (3 if small else 6) * MM, (-12 if small else -9) * MM)
        )
    return tuple(rims), tuple(pins)


def _type1_core() -> tuple[tuple[Rim, ...], tuple[Pin, ...]]:
    rims = [Rim("pedestal", "pedestal", _mm(0, 0, 17.4), 0, 0.4 * MM, 0.35 * MM)]
    pins = []
    for name, (x, y) in _PLACE_1.items():
        rims.append(Rim(name, "recess", _mm(x, y, 0.5 * _RECESS_1[name]), 0, 0.25 * MM, 0.2 * MM))
        pins.append(Pin(name, x * MM, y * MM, _PIN_1[name] * MM, -8 * MM))
    return tuple(rims), tuple(pins)


def _dc(
    x: float, y: float, mouth: Outline, radius: float, radius_tolerance: float
) -> tuple[tuple[Rim, ...], tuple[Pin, ...]]:
    rims = [
        Rim("DC mouth", "mouth", mouth, -0.7 * MM, 0.7 * MM, 0.8 * MM),
        Rim("DC insert", "pedestal", _mm(0, y, 14.0, 12.0), 0, 0.7 * MM, 0.8 * MM),
    ]
    pins = []
    for name, side in (("DC+", 1), ("DC-", -1)):
        recess = _mm(side * x, y, radius)
        rims.append(Rim(name, "recess", recess, 0, radius_tolerance, 0.7 * MM))
        pins.append(Pin(name, side * x * MM, y * MM, 8 * MM, -12 * MM))
    return tuple(rims), tuple(pins)


def _inlets() -> tuple[Port, ...]:
    rims_1, pins_1 = _type1_core()
    rims_2, pins_2 = _type2_core()
    mouth_1 = (
        Rim("mouth", "mouth", _mm(0, 0, 22.4), -0.5 * MM, 0.4 * MM, 0.35 * MM),
        Rim("latch", "mouth", _mm(0, 23.0, 4.0, 4.0), -0.5 * MM, 0.5 * MM, 0.5 * MM, fit=False),
    )
    mouth_2 = Rim("mouth", "mouth", _mm(0, 0, 36.0, flat=29.5), -1.0 * MM, 0.5 * MM, 0.35 * MM)
    dc_1, dc_pins_1 = _dc(13.0, -42.0, _mm(0, -42.0, 18.5, 12.0), 9.5, 1.0 * MM)
    dc_2, dc_pins_2 = _dc(13.5, -49.5, _mm(0, -49.5, 24.0, 13.5), 11.0, 0.5 * MM)
    return (
        Port(
            "type1",
            "Type 1 inlet (SAE J1772)",
            False,
            (*mouth_1, *rims_1),
            pins_1,
            _mm(0, 2, 38),
            0.5 * MM,
            33.5 * MM,
            1.0 * MM,
            5,
        ),
        Port(
            "type2",
            "Type 2 inlet (IEC 62196-2)",
            False,
            (mouth_2, *rims_2),
            pins_2,
            _mm(0, 0, 46),
            0.5 * MM,
            36 * MM,
            1.5 * MM,
            6,
        ),
        Port(
            "ccs1",
            "CCS1 inlet (Combo 1)",
            False,
            (*mouth_1, *rims_1, *dc_1),
            (*pins_1, *dc_pins_1),
            _mm(0, -18, 52, 4),
            0.5 * MM,
            33.5 * MM,
            1.0 * MM,
            5,
            contains="type1",
        ),
        Port(
            "ccs2",
            "CCS2 inlet (Combo 2)",
            False,
            (mouth_2, *rims_2, *dc_2),
            (*pins_2, *dc_pins_2),
            _mm(0, -22, 65, 1),
            0.5 * MM,
            36 * MM,
            1.5 * MM,
            6,
            contains="type2",
        ),
    )


def _tubes(
    places: dict[str, tuple[float, float]], outside: dict[str, float], holes: dict[str, float]
) -> tuple[tuple[Rim, ...], tuple[Pin, ...]]:
    """The contact tubes of a plug: they enter the recesses, 8 mm behind the sleeve's front."""
    rims, pins = [], []
    for name, (x, y) in places.items():
        outer = _mm(x, y, 0.5 * (outside[name] - 1.5))
        rims.append(Rim(name, "pedestal", outer, -8 * MM, 0.2 * MM, 0.1 * MM))
        hole = _mm(x, y, 0.5 * (holes[name] + 0.6))
        rims.append(Rim(f"{name} hole", "recess", hole, -8 * MM, 0.15 * MM, 0.1 * MM))
        pins.append(Pin(name, x * MM, y * MM, (holes[name] + 0.6) * MM, -8 * MM))
    return tuple(rims), tuple(pins)


def _plugs() -> tuple[Port, ...]:
    bore_2 = Rim("bore", "mouth", _mm(0, 0, 26.55, flat=18.45), 0, 0.2 * MM, 0.1 * MM)
    pin_2 = {name: 3.0 if name in ("CP", "PP") else 6.0 for name in _PLACE_2}
    tubes_2, holes_2 = _tubes(_PLACE_2, _RECESS_2, pin_2)
    bore_1 = Rim("bore", "mouth", _mm(0, 0, 17.85), 0, 0.2 * MM, 0.1 * MM)
    tubes_1, holes_1 = _tubes(_PLACE_1, _RECESS_1, _PIN_1)
    dc_places = {"DC+": (13.5, -49.5), "DC-": (-13.5, -49.5)}
    tubes_dc, holes_dc = _tubes(
        dc_places, dict.fromkeys(dc_places, 22.0), dict.fromkeys(dc_places, 8.0)
    )
    bore_dc = Rim("DC bore", "mouth", _mm(0, -49.5, 14.45, 12.0), 0, 0.2 * MM, 0.1 * MM)
    sleeve_2 = _mm(0, 0, 35, flat=28.0)
    return (
        Port(
            "type1_plug",
            "Type 1 plug (SAE J1772 connector)",
            True,
            (bore_1, *tubes_1),
            holes_1,
            _mm(0, 0, 21.9),
            0.0,
            33.5 * MM,
            1.0 * MM,
            5,
        ),
        Port(
            "type2_plug",
            "Type 2 plug (IEC 62196-2 connector)",
            True,
            (bore_2, *tubes_2),
            holes_2,
            sleeve_2,
            0.0,
            35 * MM,
            1.5 * MM,
            6,
        ),
        Port(
            "ccs2_plug",
            "CCS2 plug (Combo 2 connector)",
            True,
            (bore_2, *tubes_2, bore_dc, *tubes_dc),
            (*holes_2, *holes_dc),
            sleeve_2,
            0.0,
            35 * MM,
            1.5 * MM,
            6,
            contains="type2_plug",
        ),
    )


PORTS: dict[str, Port] = {entry.name: entry for entry in (*_inlets(), *_plugs())}
"""Every inlet and plug that is known, by name."""
