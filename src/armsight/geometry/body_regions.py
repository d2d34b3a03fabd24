"""What is known of the regions of a human body for contact: one table, with its source.

ISO/TS 15066:2016, annex A: greatest quasi-static force before it hurts (table A.2; a passing blow
may be twice as strong, but on head and face not at all), effective mass and spring constant of the
region's surface (table A.3). As printed there and in the literature that quotes it; not checked
against the standard's own sheets.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BodyRegion:
    """One region.

    Attributes:
        name: as in the standard, shortened.
        force: greatest quasi-static force [N].
        transient: factor on it for a passing blow; 1 where the standard allows none.
        stiffness: of its surface [N/m]; mass: what a blow has to move [kg].
    """

    name: str
    force: float
    transient: float
    stiffness: float
    mass: float


_ROWS = (
    ("skull", 130.0, 1.0, 150e3, 4.4),
    ("face", 65.0, 1.0, 75e3, 4.4),
    ("neck", 150.0, 2.0, 50e3, 1.2),
    ("back", 210.0, 2.0, 35e3, 40.0),
    ("chest", 140.0, 2.0, 25e3, 40.0),
    ("abdomen", 110.0, 2.0, 10e3, 40.0),
    ("pelvis", 180.0, 2.0, 25e3, 40.0),
    ("upper_arm", 150.0, 2.0, 30e3, 3.0),
    ("lower_arm", 160.0, 2.0, 40e3, 2.0),
    ("hand", 140.0, 2.0, 75e3, 0.6),
    ("thigh", 220.0, 2.0, 50e3, 75.0),
    ("lower_leg", 130.0, 2.0, 60e3, 75.0),
)
BODY_REGIONS: dict[str, BodyRegion] = {row[0]: BodyRegion(*row) for row in _ROWS}
"""By name."""
