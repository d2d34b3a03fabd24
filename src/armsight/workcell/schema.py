"""What may stand in ``workcell.toml``: one file for simulation and hardware.

The descriptions here are the documentation: ``docs/workcell.md`` is generated from them, and the
errors quote them. Poses are in ``world`` (z up, floor at z = 0) unless a key says otherwise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import PrivateAttr, model_validator

from armsight.arrays import JointVector
from armsight.workcell.fields import (
    Joints,
    Name,
    NotNegative,
    Positive,
    Section,
    Share,
    Switch,
    Text,
    Triple,
    key,
)
from armsight.workcell.schema_devices import (
    CameraSection,
    EmptySwitchSection,
    GripperSection,
    ItemsSection,
    PlugSection,
    RobotSection,
    StereoSection,
    TipSection,
    WrenchSection,
)
from armsight.workcell.schema_simulation import SimulationSection
from armsight.workcell.schema_things import BoardSection, HeldSection, SolidSection

CALIBRATION = ".calibration.toml"
"""How the names of calibration files end."""


class CellSection(Section):
    """The cell as a whole."""

    name: Name = key(..., "Short name of the cell, for the page, recordings and logs.")
    description: Text = key("", "One sentence for people.")
    calibration: Text | None = key(
        None,
        "Calibration file, relative to this file; without the key NAME.calibration.toml beside "
        "this file NAME.toml, where there is one.",
    )


class MappingSection(Section):
    """The workspace map."""

    lower: Triple | None = key(
        None, "Lower corner of the mapped box; the robot's reach and a margin if left out.", "m"
    )
    upper: Triple | None = key(
        None,
        "Upper corner of the mapped box; likewise. Somebody may be in what no camera sees of it: "
        "at a wall it ends in the wall.",
        "m",
    )
    voxel: Positive = key(0.02, "Edge of a voxel.", "m", ge=0.005, le=0.1)
    crop: Positive = key(
        1.5, "Points farther from the base are left out of the shown cloud.", "m", le=10.0
    )
    stale_after_ms: Positive = key(
        100.0, "A camera older than this is not trusted: slow down, then stop.", "ms", le=2000.0
    )
    calibration_mm: NotNegative = key(
        5.0, "Greatest believable error of a camera's position.", "mm", le=200.0
    )
    calibration_deg: NotNegative = key(
        0.5, "Greatest believable error of a camera's rotation.", "deg", le=10.0
    )
    align: Switch = key(
        True, "Refine the cameras' poses against the arm and the declared solids at the start."
    )

    @model_validator(mode="after")
    def _box(self) -> MappingSection:
        if (self.lower is None) != (self.upper is None):
            raise ValueError("found one of lower and upper, expected both or none")
        if self.lower and self.upper and not np.all(np.subtract(self.upper, self.lower) > 0.0):
            raise ValueError(f"upper {list(self.upper)} is not above lower {list(self.lower)}")
        return self


class GuardSection(Section):
    """How the guard protects people. What is left out keeps its documented default."""

    speed: Share = key(
        1.0, "Share of the robot's allowed speed (`robot.speed`) that tasks may use."
    )
    brake: Share = key(1.0, "Share of the joints' acceleration limits with which the arm stops.")
    reaching_speed: Positive = key(
        2.0,
        "Nothing of a person comes nearer faster than this (ISO 13855: a hand).",
        "m/s",
        le=20.0,
    )
    intrusion_mm: NotNegative = key(
        20.0, "How far a limb can be inside before a camera sees it.", "mm", le=1000.0
    )
    reflex_distance_mm: NotNegative = key(
        150.0, "Nearer than this, the arm leaves if it can instead of standing.", "mm", le=1000.0
    )
    head_height: Positive = key(
        1.2, "Hands may be touched by permit below this height; heads are above.", "m", le=2.0
    )
    thing_force_n: Positive = key(
        10.0,
        "No permit to touch a thing grants more force: more (a plug takes 125) for what stands it.",
        "N",
        le=150.0,
    )
    hand_force_n: Positive = key(
        30.0,
        "No permit to touch a hand grants more force; ISO/TS 15066 lets 140 pinch one.",
        "N",
        le=140.0,
    )
    soft_tip_n_per_mm: NotNegative = key(
        0.0,
        "Stiffness of what the tool's tip is covered with; 0: it is not soft.",
        "N/mm",
        le=100.0,
    )


class PatrolSection(Section):
    """The goals of `armsight patrol`: visited in the order of the file, again and again."""

    goals_deg: dict[Name, Joints] = key(
        {}, "A table of named joint positions, such as `A` and `B`.", "deg"
    )
    dwell_s: NotNegative = key(0.5, "Rest at each goal.", "s", le=3600.0)


class Workcell(Section):
    """A whole cell, as read from its file."""

    cell: CellSection = key(..., "The cell as a whole.")
    robot: RobotSection = key(..., "The arm.")
    camera: tuple[CameraSection, ...] = key((), "Depth cameras.")
    stereo: tuple[StereoSection, ...] = key((), "Stereo pairs.")
    wrench: WrenchSection | None = key(None, "The force sensor at the flange, if there is one.")
    gripper: GripperSection | None = key(None, "The gripper, if there is one.")
    empty_switch: EmptySwitchSection | None = key(
        None, "What says that nobody is in the cell, if there is such a switch."
    )
    items: ItemsSection | None = key(None, "Where items lie that the gripper fetches.")
    tip: TipSection | None = key(None, "How the tool's tip gives way, if it does.")
    plug: PlugSection | None = key(None, "The charging plug, if the flange carries one.")
    solid: tuple[SolidSection, ...] = key((), "What stands still and is known: table, walls.")
    held: tuple[HeldSection, ...] = key((), "What the arm holds, or what hangs from its flange.")
    mapping: MappingSection = key(MappingSection(), "The workspace map.")
    guard: GuardSection = key(GuardSection(), "The guard.")
    patrol: PatrolSection = key(PatrolSection(), "Goals of the patrol.")
    board: BoardSection | None = key(None, "A calibration board.")
    simulation: SimulationSection = key(SimulationSection(), "What only the simulator knows.")

    _file: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")
    _calibration_file: Path | None = PrivateAttr(default=None)

    @property
    def name(self) -> str:
        """The cell's name."""
        return self.cell.name

    @property
    def file(self) -> Path | None:
        """The file it was read from, or None; clips are named relative to its folder."""
        return self._file

    @property
    def calibration_file(self) -> Path | None:
        """Where the cell's calibration stands or would be written; None for a cell without file.

        Beside the cell's file, as ``[cell] calibration`` says, or where whoever loaded it wants it.
        """
        if self._calibration_file is not None:
            return self._calibration_file
        if self._file is None:
            return None
        name = self.cell.calibration or f"{self._file.stem}{CALIBRATION}"
        return self._file.parent / name

    @property
    def text(self) -> str:
        """The file's own text (comments and all), for recordings; empty if made by hand."""
        return self._text

    @property
    def goals(self) -> dict[str, JointVector]:
        """Patrol goals by name [rad]."""
        return {name: np.deg2rad(values) for name, values in self.patrol.goals_deg.items()}
