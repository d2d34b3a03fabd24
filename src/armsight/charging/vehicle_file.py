"""Vehicle files: the side of a car about its charging port, as solids in the port's frame.

Once the port has been found, the car is where its port says. The cell then knows what is no person,
where nobody can be, and what paths have to keep clear of.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from armsight.arrays import Pose
from armsight.charging.ports.table import PORTS
from armsight.charging.toml_file import read_toml
from armsight.geometry.pose import from_rpy, make_pose
from armsight.geometry.shapes import Solid

FOLDER = Path(__file__).parent / "vehicles"
COARSE = 50.0
"""What sides of cars are bent by, where a file does not say [mm]."""
GROUND = 1.3
"""The body goes on for so long below the port, into the ground if need be [m]."""
HINGES = {"left": 0.0, "bottom": 90.0, "right": 180.0, "top": -90.0}
"""How far a lid's frame is turned about the port's axis [deg]."""
LID_HALF, LID_THICK = 0.075, 0.008
"""Half the edge of a lid, and its thickness [m]."""
LID_RECESS = 0.045
"""Width of the recess for fingers beside its free edge [m]."""
FREE_EDGE = {"left": "right", "bottom": "up", "right": "left", "top": "down"}
"""The edge of the opening at which the recess is, by where the hinge is."""
Offset = Annotated[float, Field(ge=-60.0, le=60.0, allow_inf_nan=False)]
Millimetres = Annotated[float, Field(ge=1.0, le=500.0, allow_inf_nan=False)]
Metres = Annotated[float, Field(ge=0.05, le=5.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-60.0, le=60.0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Opening(_Table):
    """Edges of the recess, from the middle of the AC contacts [mm]."""

    left: Millimetres
    right: Millimetres
    up: Millimetres
    down: Millimetres


class Side(_Table):
    """How far the body goes on about the port [m]."""

    left: Metres
    right: Metres
    up: Metres


class LidShape(_Table):
    """A lid over the port, flush with the body: 150 x 150 x 8 mm, a recess for fingers beside it.

    Attributes:
        latch: ``push`` opens when it is pushed in; ``spring`` is pulled over its catch;
            ``unknown``: the station finds out, pushing first.
        hinge: at which of its edges, for who looks at it; the recess is at the other.
        opens_deg: how far it opens.
        middle_mm: of its middle from the AC contacts, to the right and up.
    """

    latch: Literal["push", "spring", "unknown"] = "unknown"
    hinge: Literal["left", "right", "top", "bottom"] = "left"
    opens_deg: Annotated[float, Field(ge=80.0, le=135.0, allow_inf_nan=False)] = 106.0
    middle_mm: tuple[Offset, Offset] = (0.0, 0.0)

    @property
    def room_mm(self) -> dict[str, float]:
        """How far an opening that holds it and its recess goes at least, by edges [mm]."""
        (x, y), half = self.middle_mm, 1e3 * LID_HALF
        room = {"left": half - x, "right": half + x, "up": half + y, "down": half - y}
        room[FREE_EDGE[self.hinge]] += 1e3 * LID_RECESS
        return room


class VehicleShape(_Table):
    """A car's side about its port.

    Attributes:
        inlet: type of the port.
        color: of the body, RGB 0..1.
        opening_mm: of the recess in which the inlet sits.
        front_mm: the body stands so far before the inlet's face.
        behind_mm: something solid begins so far behind it.
        side_m: the body about the port.
        thickness_m: of what counts as the car behind its side.
        coarse_mm: the body may lie so far inside of these boxes, as sides are bent.
        height_m: least and greatest height of the port above the floor.
        lean_deg: least and greatest angle of its axis above the horizontal.
        lid: over the port; None where there is none.
    """

    inlet: str
    color: tuple[Share, Share, Share] = (0.5, 0.5, 0.5)
    opening_mm: Opening
    front_mm: Annotated[float, Field(ge=-50.0, le=200.0, allow_inf_nan=False)] = 10.0
    behind_mm: Annotated[float, Field(ge=50.0, le=500.0, allow_inf_nan=False)] = 90.0
    side_m: Side
    thickness_m: Metres = 0.6
    coarse_mm: Annotated[float, Field(ge=0.0, le=300.0, allow_inf_nan=False)] = COARSE
    height_m: tuple[Metres, Metres]
    lean_deg: tuple[Degrees, Degrees] = (-10.0, 20.0)
    lid: LidShape | None = None

    @model_validator(mode="after")
    def _possible(self) -> VehicleShape:
        if self.inlet not in PORTS or PORTS[self.inlet].plug:
            known = ", ".join(name for name, entry in PORTS.items() if not entry.plug)
            raise ValueError(f"no inlet {self.inlet!r}; there are {known}")
        for name in ("height_m", "lean_deg"):
            low, high = getattr(self, name)
            if low >= high:
                raise ValueError(f"{name} is [{low:g}, {high:g}]; the second has to be greater")
        if 1e-3 * self.behind_mm >= self.thickness_m - 1e-3 * self.front_mm:
            raise ValueError("behind_mm has to be less than thickness_m less front_mm")
        for edge in ("left", "right", "up"):
            if getattr(self.side_m, edge) <= 1e-3 * getattr(self.opening_mm, edge):
                raise ValueError(f"side_m.{edge} ends within the opening")
        for edge, least in () if self.lid is None else self.lid.room_mm.items():
            if getattr(self.opening_mm, edge) < least - 1e-9:
                raise ValueError(f"opening_mm.{edge} ends within the lid, or its recess: {least:g}")
        return self

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What stands there, in the port's frame: the body about the opening, and behind it."""
        return self.within(0.0)

    def within(self, margin: float, inward: float = 0.0) -> tuple[Solid, ...]:
        """Solids in which the body is though its side may lie farther out or in by so much [m]."""
        o, side = self.opening_mm, self.side_m
        left, right, up, down = -1e-3 * o.left, 1e-3 * o.right, 1e-3 * o.up, -1e-3 * o.down
        front = 1e-3 * self.front_mm + margin
        coarse = 1e-3 * self.coarse_mm + margin + inward
        back = 1e-3 * self.front_mm - self.thickness_m
        inside = -1e-3 * self.behind_mm
        boxes = {
            "left": ((-side.left, left), (-GROUND, side.up), (back, front)),
            "right": ((right, side.right), (-GROUND, side.up), (back, front)),
            "over": ((left, right), (up, side.up), (back, front)),
            "under": ((left, right), (-GROUND, down), (back, front)),
            "inside": ((left, right), (down, up), (back, inside)),
        }
        solids = []
        for name, spans in boxes.items():
            low, high = np.array(spans, float).T
            size = (float(high[0] - low[0]), float(high[1] - low[1]), float(high[2] - low[2]))
            dark = name == "inside"
            color = (0.2, 0.2, 0.2) if dark else self.color
            material = "black_plastic" if dark else "plain"
            pose = make_pose(None, 0.5 * (low + high))
            solids.append(Solid(f"car/{name}", "box", size, pose, color, material, coarse))
        return tuple(solids)

    @property
    def T_port_lid(self) -> Pose:
        """The shut lid's frame (see :mod:`armsight.charging.lid`) in the port's."""
        assert self.lid is not None
        turn = from_rpy((0.0, 0.0, float(np.deg2rad(HINGES[self.lid.hinge]))))
        x, y = self.lid.middle_mm
        return make_pose(turn[:3, :3], (1e-3 * x, 1e-3 * y, 1e-3 * self.front_mm))

    @property
    def open_lid(self) -> Solid:
        """The lid as it stands open, in the port's frame."""
        assert self.lid is not None
        angle = float(np.deg2rad(self.lid.opens_deg))
        hinge = make_pose(None, (-LID_HALF, 0.0, -0.5 * LID_THICK)) @ from_rpy((0.0, -angle, 0.0))
        T = self.T_port_lid @ hinge @ make_pose(None, (LID_HALF, 0.0, 0.0))
        size = (2.0 * LID_HALF, 2.0 * LID_HALF, LID_THICK)
        return Solid("car/lid", "box", size, T, self.color)

    def contradiction(self, T_world_port: Pose) -> str:
        """Why this vehicle cannot be what was found, in words; empty when it can.

        Args:
            T_world_port: where its port was found; the floor is at z = 0.
        """
        height = float(T_world_port[2, 3])
        lean = float(np.rad2deg(np.arcsin(np.clip(T_world_port[2, 2], -1.0, 1.0))))
        for what, value, unit, (low, high) in (
            ("above the floor", height, "m", self.height_m),
            ("above the horizontal", lean, "deg", self.lean_deg),
        ):
            if not low <= value <= high:
                return f"the port is {value:.3g} {unit} {what}; expected {low:g} to {high:g} {unit}"
        return ""


def packaged() -> tuple[str, ...]:
    """Names of the vehicles that come with armsight."""
    return tuple(sorted(file.stem for file in FOLDER.glob("*.toml")))


def load_vehicle(given: str | Path) -> VehicleShape:
    """A vehicle's file, or a packaged vehicle by its name.

    Raises:
        UsageError: it cannot be read, or says what cannot be.
    """
    file = Path(given)
    if str(given) in packaged():
        file = FOLDER / f"{given}.toml"
    return read_toml("vehicle", file, VehicleShape, f"; packaged are {', '.join(packaged())}")
