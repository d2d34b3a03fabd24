"""What may stand in ``workcell.toml``: one file for simulation and hardware.

The descriptions here are the documentation: ``docs/workcell.md`` is generated from them, and the
errors quote them. Poses are in ``world`` (z up, floor at z = 0) unless a key says otherwise.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import PrivateAttr, model_validator

from armsight.arrays import JointVector, Pose
from armsight.geometry.pose import from_quaternion, from_rpy, look_at, make_pose
from armsight.geometry.shapes import Solid
from armsight.workcell.fields import (
    Color,
    Connection,
    DriverName,
    Extent,
    Joints,
    Model,
    Name,
    NotNegative,
    Number,
    Positive,
    Quaternion,
    Section,
    Share,
    Switch,
    Text,
    Triple,
    key,
)

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


class RobotSection(Section):
    """The arm, where it stands, and how fast it may be."""

    model: Model = key(
        ...,
        "A robot of the catalogue (`armsight robots` lists them), or one of your own: the path of "
        "a folder or a URDF, relative to this file, such as `./my_arm.urdf`.",
    )
    driver: DriverName = key(
        "simulated", "What moves it: `simulated`, the name of a driver, or its `module:Class`."
    )
    tool: Model = key(
        "none",
        "What the flange carries: a tool of the catalogue (`armsight robots` lists them), or one "
        "of your own: the path of a folder with a `tool.toml`, such as `./my_gripper`.",
    )
    position: Triple = key((0.0, 0.0, 0.0), "Origin of the robot's base.", "m")
    rpy_deg: Triple = key(
        (0.0, 0.0, 0.0),
        "Roll, pitch, yaw of the base about the fixed x, y, z axes; [180, 0, 0] hangs it inverted.",
        "deg",
    )
    home_deg: Joints | None = key(
        None, "Joint positions at the start; the catalogue's home if left out.", "deg"
    )
    joint_lower_deg: Joints | None = key(
        None, "Narrower lower joint limits of this cell; the maker's if left out.", "deg"
    )
    joint_upper_deg: Joints | None = key(
        None, "Narrower upper joint limits of this cell; the maker's if left out.", "deg"
    )
    speed: Share = key(0.5, "Share of the joints' speed limits that may be used.")
    acceleration: Share = key(0.6, "Share of the joints' acceleration limits that may be used.")
    start_delay_ms: NotNegative = key(
        60.0, "Command to first motion (T2: 50-70 ms). The guard counts with it.", "ms", le=1000.0
    )
    state_latency_ms: NotNegative = key(2.0, "Joint reading to its arrival.", "ms", le=1000.0)
    state_rate_hz: Positive = key(500.0, "Joint readings a second.", "Hz", le=10_000.0)
    watchdog_ms: Positive = key(
        100.0, "The arm stops by itself when no command came for this long.", "ms", le=10_000.0
    )
    connection: Connection = key(
        {}, "What a real driver needs, such as `host`; the driver's page says what."
    )

    @property
    def T_world_base(self) -> Pose:
        """Pose of the base in world."""
        return from_rpy(np.deg2rad(self.rpy_deg), self.position)


class MountedSection(Section):
    """Something with lenses. Give exactly one of `look_at`, `rpy_deg`, `quaternion_xyzw`."""

    name: Name = key(..., "Unique in the cell.")
    model: Name | None = key(
        None,
        "Key of the camera catalogue; `armsight robots` lists it. A real camera needs none: its "
        "driver says what it is.",
    )
    driver: DriverName = key(
        "simulated", "What reads it: `simulated`, the name of a driver, or its `module:Class`."
    )
    mounted_on: Literal["world", "flange"] = key(
        "world", "`world` for a camera that stands still, `flange` for one that the arm carries."
    )
    position: Triple = key(
        ..., "Origin of the depth (or left) lens, in world or in the flange's frame.", "m"
    )
    look_at: Triple | None = key(
        None, "A point in the middle of the image (same frame); the image's top is up.", "m"
    )
    rpy_deg: Triple | None = key(
        None, "Roll, pitch, yaw of the optical frame (z forward, x right, y down).", "deg"
    )
    quaternion_xyzw: Quaternion | None = key(
        None, "Rotation of the optical frame as x, y, z, w (w last)."
    )
    rate_hz: Positive | None = key(
        None, "Frames a second; the catalogue's or the driver's if left out.", "Hz", le=240.0
    )
    latency_ms: NotNegative | None = key(
        None, "Exposure to arrival; the catalogue's or the driver's if left out.", "ms", le=2000.0
    )
    connection: Connection = key(
        {}, "What a real driver needs, such as `serial`; the driver's page says what."
    )

    @model_validator(mode="after")
    def _one_rotation(self) -> MountedSection:
        given = [k for k in ("look_at", "rpy_deg", "quaternion_xyzw") if getattr(self, k)]
        if len(given) != 1:
            raise ValueError(
                f"found {' and '.join(given) if given else 'none'} of look_at, rpy_deg and "
                "quaternion_xyzw, expected exactly one"
            )
        if self.quaternion_xyzw and abs(math.hypot(*self.quaternion_xyzw) - 1.0) > 0.01:
            length = math.hypot(*self.quaternion_xyzw)
            raise ValueError(f"quaternion_xyzw has length {length:.3g}, expected 1")
        if self.look_at and math.dist(self.look_at, self.position) < 1e-6:
            raise ValueError("look_at is the camera's own position, expected another point")
        return self

    @property
    def T_mount_camera(self) -> Pose:
        """Pose of the depth lens in world (fixed cameras) or in the flange's frame."""
        if self.look_at is not None:
            away = np.subtract(self.look_at, self.position)
            straight = np.linalg.norm(away[:2]) < 1e-6 * np.linalg.norm(away)
            # Straight down or up has no "up" in the image: its top is then +y (down) or -y (up).
            up = (0.0, -float(np.sign(away[2])), 0.0) if straight else (0.0, 0.0, 1.0)
            return look_at(self.position, self.look_at, up)
        if self.rpy_deg is not None:
            return from_rpy(np.deg2rad(self.rpy_deg), self.position)
        assert self.quaternion_xyzw is not None
        return from_quaternion(self.quaternion_xyzw, self.position)


class CameraSection(MountedSection):
    """One depth camera. Give exactly one of `look_at`, `rpy_deg`, `quaternion_xyzw`."""

    phase_ms: NotNegative = key(
        0.0, "First exposure after the start; staggered cameras give fresher evidence.", "ms"
    )
    guard: Switch = key(
        True, "Whether its pictures are evidence for the map and the guard; false only shows them."
    )


class StereoSection(MountedSection):
    """One stereo pair. Give exactly one of `look_at`, `rpy_deg`, `quaternion_xyzw`."""


class WrenchSection(Section):
    """The force sensor at the flange."""

    driver: DriverName = key(
        "simulated", "What reads it: `simulated`, the name of a driver, or its `module:Class`."
    )
    rate_hz: Positive = key(100.0, "Readings a second.", "Hz", le=10_000.0)
    connection: Connection = key({}, "What a real driver needs; the driver's page says what.")


class GripperSection(Section):
    """The gripper."""

    driver: DriverName = key(
        "simulated", "What moves it: `simulated`, the name of a driver, or its `module:Class`."
    )
    opening: Positive = key(0.085, "Greatest width between the fingertips.", "m", le=0.5)
    speed: Positive = key(0.1, "Of the fingertips against each other.", "m/s", le=2.0)
    force_n: Positive = key(40.0, "With which a real gripper closes.", "N", le=1000.0)
    connection: Connection = key({}, "What a real driver needs; the driver's page says what.")


class PlugSection(Section):
    """The charging plug that the flange carries, and the mount that lets it give way."""

    kind: Name = key("type2_plug", "A plug of the table: `type1_plug`, `type2_plug`, `ccs2_plug`.")
    mount_n_per_mm: Positive = key(5.0, "Stiffness of the mount.", "N/mm", le=1000.0)
    mount_nm_per_rad: Positive = key(30.0, "Likewise in turning.", "N m/rad", le=10_000.0)
    cable_n: NotNegative = key(15.0, "Weight of the cable that hangs on it.", "N", le=200.0)
    vehicle: Text = key(
        "",
        "What is parked here: a packaged vehicle (`hatchback`, `crossover`, `city_car`) or a "
        "vehicle file. Its body is declared where its port is found; without the key the car's "
        "side has to be among the cell's solids.",
    )


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
    blocked_mm: Positive | None = key(
        None, "Ice or a bent pin lets no plug deeper than this; without the key none does.", "mm"
    )

    @property
    def pose(self) -> Pose:
        """The port's frame in world: x right and y up for who looks at it, z towards who looks."""
        yaw, lean = math.radians(self.yaw_deg), math.radians(self.lean_deg)
        z = np.array(
            [math.cos(yaw) * math.cos(lean), math.sin(yaw) * math.cos(lean), math.sin(lean)]
        )
        x = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
        return make_pose(np.column_stack([x, np.cross(z, x), z]), self.position)


class SolidSection(Section):
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
    def _right_measures(self) -> SolidSection:
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


class HeldSection(SolidSection):
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
    motion: Literal["script", "clip", "hand"] = key(
        "script", "`script`, `clip` (a motion clip file), or `hand` (a lone forearm for the page)."
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
    distance: Positive = key(2.5, "How far a script's walk goes.", "m", le=10.0)
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


class ObjectSection(SolidSection):
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

    @model_validator(mode="after")
    def _center_named(self) -> ObjectSection:
        if (self.path in ("free", "loose")) != (self.center is None):
            raise ValueError(
                f'path is "{self.path}" and center is {"missing" if self.center is None else "set"}'
                ', expected a center with path "circle" or "line", and only then'
            )
        return self


class TargetSection(Section):
    """A target of visual servoing: a ball, a bulls-eye, a smiley on a box, a gloved hand (V)."""

    name: Name = key(..., "Unique in the cell.")
    kind: Literal["ball", "bullseye", "smiley", "hand"] = key("ball", "What it is.")
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
        if (self.path in ("circle", "line")) != (self.center is not None):
            raise ValueError(
                f'path is "{self.path}" and center is {"set" if self.center else "missing"}, '
                'expected a center with path "circle" or "line", and only then'
            )
        return self

    @property
    def pose(self) -> Pose:
        """Its frame in world at the start."""
        return from_rpy(np.deg2rad(self.rpy_deg), self.position)


class WrenchErrorsSection(Section):
    """Errors of the simulated force sensor; the defaults are a usual sensor's of 300 N."""

    noise_n: NotNegative = key(0.1, "Standard deviation of force, after the low-pass.", "N", le=50)
    noise_nm: NotNegative = key(
        0.005, "Standard deviation of torque, after the low-pass.", "N m", le=5
    )
    bias_n: NotNegative = key(
        1.0, "Standard deviation of a constant error of force, drawn from the seed.", "N", le=100
    )
    bias_nm: NotNegative = key(
        0.02, "Standard deviation of a constant error of torque, likewise.", "N m", le=10
    )
    low_pass_hz: Positive = key(
        30.0, "Corner of the sensor's first-order low-pass filter.", "Hz", le=5000
    )
    drift_n: NotNegative = key(
        0.3, "Standard deviation by which the error of force wanders in a minute.", "N", le=100
    )
    drift_nm: NotNegative = key(0.006, "Likewise of torque.", "N m", le=10)
    greatest_n: Positive = key(300.0, "Force along an axis at which it saturates.", "N", le=1e5)
    greatest_nm: Positive = key(20.0, "Torque about an axis likewise.", "N m", le=1e4)
    latency_ms: NotNegative = key(4.0, "Measurement to arrival.", "ms", le=1000)


class SimulationSection(Section):
    """What only the simulator knows. Hardware ignores this table."""

    floor: Switch = key(True, "Whether there is a floor at z = 0.")
    time_step_ms: Positive | None = key(
        None, "Step of the physics; 2 ms if left out, 1 where contact pushes.", "ms", ge=0.1, le=10
    )
    contact_pushes: Switch = key(
        False,
        "Whether people's hands and faces, and things, give way and push back; else they follow "
        "their own motion whatever touches them.",
    )
    sensor_errors: Switch = key(True, "Whether the cameras' error models are on; ideal otherwise.")
    color_scale: Share = key(
        0.5, "Share of the colour lenses' resolution that is rendered, when colour is asked for."
    )
    stamp_jitter_ms: NotNegative = key(
        0.0, "Uniform error of the cameras' stamps, plus or minus.", "ms", le=1000.0
    )
    calibration_error_mm: NotNegative = key(
        0.0,
        "How far the cameras truly are from where they are declared: standard deviation along "
        "each axis.",
        "mm",
        le=500,
    )
    calibration_error_deg: NotNegative = key(
        0.0, "Likewise how far they are turned: standard deviation about each axis.", "deg", le=45.0
    )
    lens_error: NotNegative = key(
        0.0,
        "Scale of the true lenses' deviation from the catalogue's; 0 is none, 1 a typical unit.",
        le=5.0,
    )
    depth_error: NotNegative = key(
        0.15,
        "Share of a unit's systematic depth error that is there: 1 as it comes out of the box, "
        "less where the camera corrects itself.",
        le=5.0,
    )
    board_error: NotNegative = key(
        1.0,
        "Scale of the board's errors: its bracket off by 12 mm and 3 deg, its print by 0.2 %.",
        le=5.0,
    )
    arm_repeatability_mm: NotNegative = key(
        0.1, "Standard deviation of the tip's position.", "mm", le=50.0
    )
    arm_kinematic_error: NotNegative = key(
        0.0, "Scale of the arm's absolute errors; 0 is an exact arm, 1 a typical one.", le=100.0
    )
    wrench: WrenchErrorsSection = key(
        WrenchErrorsSection(), "Errors of the simulated force sensor."
    )
    undeclared: tuple[SolidSection, ...] = key(
        (), "Solids that are there but that the cell was not told of."
    )
    person: tuple[PersonSection, ...] = key((), "People.")
    object: tuple[ObjectSection, ...] = key((), "Things that move or can be dragged.")
    target: tuple[TargetSection, ...] = key((), "Targets of visual servoing.")
    car: CarSection | None = key(None, "A car's charging port, if one is parked here.")


class MappingSection(Section):
    """The workspace map."""

    lower: Triple | None = key(
        None, "Lower corner of the mapped box; the robot's reach and a margin if left out.", "m"
    )
    upper: Triple | None = key(None, "Upper corner of the mapped box; likewise.", "m")
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
