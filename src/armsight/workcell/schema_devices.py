"""What drives, looks and feels in ``workcell.toml``: arm, cameras, sensor, gripper, plug."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import model_validator

from armsight.arrays import Pose
from armsight.geometry.pose import from_quaternion, from_rpy, look_at
from armsight.workcell.fields import (
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
from armsight.workcell.port_pose import port_pose


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
        0.0, "First exposure after the start; cameras one after another spread the work.", "ms"
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


class EmptySwitchSection(Section):
    """A switch, or the reset button of a door: turned on, nobody is in the cell.

    Only being turned on counts, and only while nobody is seen. A simulated cell has its page's
    button instead.
    """

    driver: DriverName = key(..., "The name of a driver, or its `module:Class`.")
    rate_hz: Positive = key(20.0, "Readings a second.", "Hz", ge=5.0, le=1000.0)
    connection: Connection = key({}, "What the driver needs; its page says what.")


class ItemsSection(Section):
    """Where the items lie that the gripper fetches, upright boxes, one at a time."""

    position: Triple = key(..., "Middle of an item that lies there.", "m")
    size: Extent = key((0.04, 0.04, 0.05), "Its edges along its x, its y and upwards.", "m")
    yaw_deg: Number = key(0.0, "How it is turned about the vertical.", "deg")


class TipSection(Section):
    """The tool's tip floats in its holder on springs, as a touch probe's does, and gives way."""

    spring_n_per_mm: Positive = key(
        ..., "With which it gives way, to whatever side.", "N/mm", le=100.0
    )
    travel_mm: Positive = key(..., "By how much, until it meets a stop.", "mm", le=100.0)
    seat_n: NotNegative = key(
        1.0,
        "What pushes less does not move it out of its seat.",
        "N",
        le=20.0,
    )
    length_mm: Positive = key(
        100.0, "So much of the tool, from its tip, floats; the rest is stiff.", "mm", le=500.0
    )


class ParkingSection(Section):
    """About where the port of a parked car is: where none is clear it is looked for there again."""

    position: Triple = key(..., "Middle of its AC contacts.", "m")
    yaw_deg: Number = key(180.0, "Where it looks: 0 is along world x, 90 along y.", "deg")
    lean_deg: Number = key(10.0, "How much it looks up.", "deg", ge=-60.0, le=60.0)
    within_m: Positive = key(0.2, "No car is parked farther from there.", "m", le=1.0)

    @property
    def pose(self) -> Pose:
        """See :func:`~armsight.workcell.port_pose.port_pose`."""
        return port_pose(self.position, self.yaw_deg, self.lean_deg)


class PlugSection(Section):
    """The charging plug that the flange carries, and the mount that lets it give way."""

    kind: Name = key("type2_plug", "A plug of the table: `type1_plug`, `type2_plug`, `ccs2_plug`.")
    mount_n_per_mm: Positive = key(5.0, "Stiffness of the mount.", "N/mm", le=1000.0)
    mount_nm_per_rad: Positive = key(30.0, "Likewise in turning.", "N m/rad", le=10_000.0)
    cable_n: NotNegative = key(15.0, "Weight of the cable that hangs on it.", "N", le=200.0)
    hanger: Triple | None = key(
        None,
        "Where the cable is hung up: then it is the arm's own body in the pictures, wherever it "
        "swings; a simulated one is seen, and pulls as what hangs there does, and `cable_n` is "
        "what is expected of it before the port. Without the key it is a weight that nobody sees.",
        "m",
    )
    cable_m: Positive = key(1.9, "Its length between plug and hanger.", "m", le=10.0)
    cable_mm: Positive = key(32.0, "How thick it is.", "mm", le=100.0)
    cable_kg_per_m: Positive = key(2.26, "What a metre of it weighs.", "kg/m", le=20.0)
    cable_nm2: NotNegative = key(
        0.3, "What resists bending it: how far it swings depends on it.", "N m²", le=10.0
    )
    finger_mm: Triple | None = key(
        None,
        "Tip of the finger that opens lids when it is out, in the flange's frame, with a pin of "
        "15 mm that points away from the plug; the cell's gripper draws it back by its `opening`. "
        "Its shape belongs among the `[[held]]`. Without the key the plug has none.",
        "mm",
    )
    vehicle: Text = key(
        "",
        "What is parked here: a packaged vehicle (`hatchback`, `hatchback_lid`, "
        "`hatchback_catch`, `crossover`, `city_car`) or a "
        "vehicle file. Its body is declared where its port is found; without the key the car's "
        "side has to be among the cell's solids.",
    )
    parking: ParkingSection | None = key(
        None, "About where ports of parked cars are, if that is known."
    )
    car: Text = key(
        "",
        "Who speaks for the parked car: `module:Class`, or a name of the entry points "
        "`armsight.vehicles`; called with `connection`. Without the key a simulated car speaks, "
        "which no real arm is led by.",
    )
    connection: Connection = key({}, "What who speaks for the car needs.")
