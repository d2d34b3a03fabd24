"""What stands, hangs and moves in ``workcell.toml``: solids, board, people, targets, cars."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import model_validator

from armsight.arrays import Pose
from armsight.geometry.pose import from_rpy
from armsight.geometry.shapes import Solid
from armsight.workcell.fields import (
    Color,
    Extent,
    Joints,
    Name,
    NotNegative,
    Number,
    Positive,
    Section,
    Switch,
    Text,
    Triple,
    key,
)
from armsight.workcell.port_pose import port_pose


class ShapeSection(Section):
    """A box (`size`), a cylinder along its z (`radius`, `height`) or a sphere (`radius`)."""

    name: Name = key(..., "Unique in the cell.")
    kind: Literal["box", "cylinder", "sphere"] = key("box", "Its shape.")
    size: Extent | None = key(None, "Full edges of a box along its x, y, z.", "m")
    radius: Positive | None = key(None, "Radius of a cylinder or sphere.", "m")
    height: Positive | None = key(None, "Full height of a cylinder.", "m")
    position: Triple = key(..., "Its centre.", "m")
    rpy_deg: Triple = key((0.0, 0.0, 0.0), "Roll, pitch, yaw about the fixed axes.", "deg")
    color: Color = key((0.7, 0.7, 0.7), "Red, green, blue, 0..1.")
    material: Literal["plain", "black_plastic", "shiny"] = key(
        "plain", "What infrared sees of it: `black_plastic` gives no return, `shiny` little."
    )

    @model_validator(mode="after")
    def _right_measures(self) -> ShapeSection:
        wanted = {"box": ["size"], "cylinder": ["radius", "height"], "sphere": ["radius"]}[
            self.kind
        ]
        given = [k for k in ("size", "radius", "height") if getattr(self, k) is not None]
        if given != wanted:
            raise ValueError(
                f"a {self.kind} found {' and '.join(given) if given else 'no measures'}, "
                f"expected {' and '.join(wanted)}"
            )
        return self

    @property
    def solid(self) -> Solid:
        """The solid, posed in world."""
        size = self.size if self.size is not None else (self.radius or 0.0, self.height or 0.0, 0.0)
        pose = from_rpy(np.deg2rad(self.rpy_deg), self.position)
        return Solid(self.name, self.kind, size, pose, self.color, self.material)


class SolidSection(ShapeSection):
    """A box (`size`), a cylinder along its z (`radius`, `height`) or a sphere (`radius`)."""

    coarse: NotNegative = key(
        0.0,
        "Its surface may lie so far inside of its shape, and what is seen there is nobody; what is "
        "seen deeper inside counts as a person.",
        "m",
        le=0.5,
    )

    @property
    def solid(self) -> Solid:
        """The solid, posed in world."""
        return replace(super().solid, coarse=self.coarse)


class HeldSection(ShapeSection):
    """Held by the arm, or hanging from it: a part of its body, in the flange's frame."""

    mass_kg: NotNegative = key(0.0, "Its mass.", "kg", le=100.0)


class BoardSection(Section):
    """A calibration board, on the arm or beside it; `armsight board` prints one."""

    kind: Text = key("checkerboard:7x5:30", "Which, sizes in mm, such as `checkerboard:7x5:30`.")
    mounted_on: Literal["flange", "world"] = key(
        "flange", "`flange` for a board that the arm carries, `world` for one that stands still."
    )
    position: Triple = key(
        (0.0, 0.0, 0.06), "Middle of its corners, in the flange's frame or in world.", "m"
    )
    rpy_deg: Triple = key(
        (180.0, 0.0, 0.0),
        "Roll, pitch, yaw of its frame: x right and y down as it is read, z into the paper.",
        "deg",
    )

    @property
    def pose(self) -> Pose:
        """Frame of the board moved to the middle of its corners, in its mount."""
        return from_rpy(np.deg2rad(self.rpy_deg), self.position)


class PersonSection(Section):
    """Someone in the simulated cell, moved by a script, by a recorded clip, or by the page."""

    name: Name = key(..., "Unique in the cell.")
    motion: Literal["script", "clip", "hand", "carry"] = key(
        "script",
        "`script`, `clip` (a motion clip file), `hand` (a lone forearm for the page), or `carry`: "
        "they wait, and bring what they carry (an object's `carried_by`) where the page drags it.",
    )
    script: Name = key("reach_in", "Name of the built-in script, such as `reach_in`, `walk_by`.")
    clip: Text | None = key(None, "File of a motion clip, relative to this file.")
    position: Triple = key(..., "Where the script or clip has its origin: on the floor.", "m")
    yaw_deg: Number = key(0.0, "Where the person faces: 0 is along world x, 90 along y.", "deg")
    period_s: Positive = key(12.0, "Time between repetitions of a script.", "s")
    start_s: NotNegative = key(2.0, "First time.", "s")
    target: Triple | None = key(
        None,
        "Where a script's hand goes, from the person: ahead, to the left, up from the floor; "
        "a place at bench height if left out.",
        "m",
    )
    distance: Positive = key(
        2.5, "How far a script's walk goes, or one who carries at most.", "m", le=10.0
    )
    speed_scale: Positive = key(1.0, "Time scale of the motion.", le=10.0)
    max_hand_speed: Positive = key(2.0, "Caps the hands' speed.", "m/s", le=20.0)
    mirror: Switch = key(False, "Left and right exchanged.")
    height: Positive = key(1.75, "Body height.", "m", ge=0.5, le=2.5)

    @model_validator(mode="after")
    def _clip_named(self) -> PersonSection:
        if (self.motion == "clip") != (self.clip is not None):
            raise ValueError(
                f'motion is "{self.motion}" and clip is {"set" if self.clip else "missing"}, '
                'expected a clip with motion = "clip", and only then'
            )
        return self

    @property
    def T_world_person(self) -> Pose:
        """Origin of the person's motion in world."""
        return from_rpy((0.0, 0.0, np.deg2rad(self.yaw_deg)), self.position)


class StandingArmSection(Section):
    """Another arm that is there, at rest, but that the cell was not told of."""

    name: Name = key(..., "Unique in the cell.")
    model: Name = key(..., "A robot of the catalogue (`armsight robots` lists them).")
    position: Triple = key(..., "Origin of its base.", "m")
    rpy_deg: Triple = key((0.0, 0.0, 0.0), "Roll, pitch, yaw of its base.", "deg")
    joints_deg: Joints | None = key(None, "Its joints; its home if left out.", "deg")


class ObjectSection(ShapeSection):
    """A moving thing: a solid with a path."""

    path: Literal["circle", "line", "free", "loose"] = key(
        "free",
        "`circle` about `center`, `line` to `center` and back, `free`: the page drags it, or "
        "`loose`: it lies there, falls, and is pushed and gripped (needs `contact_pushes`).",
    )
    center: Triple | None = key(None, "Centre of the circle, or far end of the line.", "m")
    period_s: Positive = key(10.0, "Time of one round.", "s")
    mass_kg: Positive = key(0.2, "Its mass, where contact pushes.", "kg", le=100.0)
    surface_n_per_mm: Positive = key(20.0, "Stiffness of its surface.", "N/mm", le=1000.0)
    hold_n_per_mm: Positive = key(
        2.0, "Stiffness of its stand, or of whatever moves it.", "N/mm", le=100.0
    )
    held_by: Text | None = key(
        None,
        "Who holds it, such as `anna/right_hand`; its position is then in that part's frame: z "
        "from the wrist to the knuckles, x out of the back of the hand.",
    )

    carried_by: Text | None = key(
        None,
        "Who brings it where the page drags it, puts it down and goes: a person with "
        '`motion = "carry"`.',
    )

    @model_validator(mode="after")
    def _center_named(self) -> ObjectSection:
        _check_center(self.path, self.center)
        if self.carried_by is not None and (self.path != "free" or self.held_by is not None):
            raise ValueError(
                f'it is carried by {self.carried_by}: expected path = "free" and no held_by'
            )
        return self


def _check_center(path: str, center: Triple | None) -> None:
    """A path about or to somewhere says where, and no other does."""
    if (path in ("circle", "line")) != (center is not None):
        raise ValueError(
            f'path is "{path}" and center is {"missing" if center is None else "set"}, '
            'expected a center with path "circle" or "line", and only then'
        )


class TargetSection(Section):
    """A target of visual servoing: a ball, a bulls-eye, a smiley on a box, a gloved hand (V)."""

    name: Name = key(..., "Unique in the cell.")
    kind: Literal["ball", "held_ball", "bullseye", "smiley", "hand"] = key("ball", "What it is.")
    position: Triple = key(..., "The ball's centre; middle of the rings, the mouth, the palm.", "m")
    rpy_deg: Triple = key(
        (0.0, 0.0, 0.0),
        "Roll, pitch, yaw of its frame, whose z comes out of rings, mouth or palm.",
        "deg",
    )
    path: Literal["circle", "line", "free", "wander"] = key(
        "free",
        "`free`: the page leads it; `circle` about or `line` to `center` and back; `wander`: a "
        "smooth path drawn from the seed of the cell.",
    )
    center: Triple | None = key(None, "Centre of the circle, or far end of the line.", "m")
    period_s: Positive = key(10.0, "Time of one round.", "s")
    speed: Positive = key(0.2, "Greatest speed of one that wanders.", "m/s", le=2.0)
    room: Extent = key((0.15, 0.25, 0.15), "How far one wanders along x, y, z at most.", "m")
    glossy: Switch = key(False, "Shiny: it mirrors the lamps, and infrared sees little of it.")
    mass_kg: Positive = key(0.2, "Its mass, where contact pushes.", "kg", le=100.0)
    surface_n_per_mm: Positive = key(
        20.0,
        "Stiffness of its surface, in series with a soft tip that meets it.",
        "N/mm",
        le=1000.0,
    )

    @model_validator(mode="after")
    def _center_named(self) -> TargetSection:
        _check_center(self.path, self.center)
        return self

    @property
    def pose(self) -> Pose:
        """Its frame in world at the start."""
        return from_rpy(np.deg2rad(self.rpy_deg), self.position)


class CarSection(Section):
    """A simulated car's charging port, and the car."""

    port: Name = key("type2", "An inlet of the table: `type1`, `type2`, `ccs1`, `ccs2`.")
    vehicle: Text = key(
        "",
        "The car about it: `hatchback`, `crossover`, `city_car`, or a vehicle file; without the "
        "key there is the port alone.",
    )
    position: Triple = key(..., "Middle of its AC contacts, on the face that carries them.", "m")
    yaw_deg: Number = key(180.0, "Where it looks: 0 is along world x, 90 along y.", "deg")
    lean_deg: Number = key(0.0, "How much it looks up.", "deg", ge=-60.0, le=60.0)
    make: int = key(0, "Number of its make: measures within their tolerances; 0: nominal.", ge=0)
    clearance_mm: Positive = key(0.4, "Between the plug's sleeve and the wall.", "mm", le=5.0)
    chamfer_mm: Positive = key(1.75, "Of the mouth.", "mm", le=5.0)
    friction: NotNegative = key(0.25, "Of plug and wall.", le=2.0)
    mated_n: NotNegative = key(25.0, "Friction of the mated contacts.", "N", le=200.0)
    lid: Literal["shut", "stuck", "missing"] = key(
        "shut", "Of a vehicle that has one: `shut`; `stuck`, which nobody opens; or `missing`."
    )
    lid_latch: Literal["push", "spring"] = key(
        "push", "Its latch, where the vehicle's file does not say."
    )
    lid_holds_n: Positive = key(22.0, "Force at its edge that works its latch.", "N", le=100.0)
    blocked_mm: Positive | None = key(
        None, "Ice or a bent pin lets no plug deeper than this; without the key none does.", "mm"
    )

    @property
    def pose(self) -> Pose:
        """See :func:`~armsight.workcell.port_pose.port_pose`."""
        return port_pose(self.position, self.yaw_deg, self.lean_deg)
