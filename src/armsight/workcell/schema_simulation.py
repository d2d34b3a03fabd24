"""What only the simulator reads in ``workcell.toml``."""

from __future__ import annotations

from armsight.workcell.fields import (
    NotNegative,
    Positive,
    Section,
    Share,
    Switch,
    key,
)
from armsight.workcell.schema_things import (
    CarSection,
    ObjectSection,
    PersonSection,
    ShapeSection,
    StandingArmSection,
    TargetSection,
)


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
    undeclared: tuple[ShapeSection, ...] = key(
        (), "Solids that are there but that the cell was not told of."
    )
    arm: tuple[StandingArmSection, ...] = key(
        (), "Other arms that are there, at rest, but that the cell was not told of."
    )
    person: tuple[PersonSection, ...] = key((), "People.")
    object: tuple[ObjectSection, ...] = key((), "Things that move or can be dragged.")
    target: tuple[TargetSection, ...] = key((), "Targets of visual servoing.")
    car: CarSection | None = key(None, "A car's charging port, if one is parked here.")
