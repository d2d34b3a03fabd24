"""Sanity of a workcell beyond its types: units that cannot be right, unknown names, poses too far.

Every check takes one validated table, so that the good tables of a broken file are checked as well
and all problems come at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from armsight.devices.camera_models import CAMERA_MODELS
from armsight.devices.port import Kind
from armsight.errors import RobotError
from armsight.robots import ROBOT_NAMES, TOOL_NAMES, load_robot, load_tool, tools
from armsight.robots.catalogue import is_path
from armsight.robots.held import holding
from armsight.robots.kinematics import sphere_centers
from armsight.robots.robot import Robot
from armsight.simulation.scripts import SCRIPTS
from armsight.workcell.drivers import SIMULATED, is_known, unknown
from armsight.workcell.problems import Problem, nearest, shown
from armsight.workcell.schema import MappingSection, PatrolSection
from armsight.workcell.schema_devices import (
    CameraSection,
    MountedSection,
    RobotSection,
    StereoSection,
)
from armsight.workcell.schema_simulation import SimulationSection
from armsight.workcell.schema_things import (
    BoardSection,
    HeldSection,
    ObjectSection,
    PersonSection,
    ShapeSection,
    SolidSection,
    StandingArmSection,
    TargetSection,
)

FARTHEST = 10.0
"""Nothing in a cell is farther from the robot's base than this [m]."""
MOST_HELD = 3.0
"""Nothing that an arm holds has its middle farther from the flange [m]."""
SMALLEST = 0.001
"""No edge or radius is smaller [m]."""
ENTERS = 0.01
"""How deep the body's spheres (which overshoot the meshes a little) may enter a solid [m]."""


def robot_of(section: RobotSection, held: Sequence[HeldSection] = ()) -> Robot:
    """The robot that the section describes, with its tool and what it holds.

    Raises:
        ArmsightError: no such robot or tool.
    """
    robot = load_robot(section.model)
    tool = None if section.tool == "none" else load_tool(section.tool)
    if held:
        tool = holding(tool, [it.solid for it in held], [it.mass_kg for it in held])
    return robot if tool is None else robot.with_tool(tool)


def _arm(section: RobotSection) -> Robot | None:
    """The robot without its tool; None where :func:`check_robot` complains of it."""
    try:
        return load_robot(section.model)
    except RobotError:
        return None


def check_robot(section: RobotSection) -> Iterator[Problem]:
    """Model, tool, driver, number and range of joints, units."""
    robot = None
    if section.model not in ROBOT_NAMES and not is_path(section.model):
        yield Problem("robot.model", _unknown("robot", section.model, ROBOT_NAMES))
    else:
        try:
            robot = load_robot(section.model)
        except RobotError as error:
            yield Problem("robot.model", str(error))
    if tools.is_path(section.tool):
        try:
            load_tool(section.tool)
        except RobotError as error:
            yield Problem("robot.tool", str(error))
    elif section.tool != "none" and section.tool not in TOOL_NAMES:
        yield Problem("robot.tool", _unknown("tool", section.tool, ("none", *TOOL_NAMES)))
    yield from check_driver("robot.driver", "arm", section.driver)
    yield from check_metres("robot.position", section.position)
    yield from check_degrees("robot.rpy_deg", section.rpy_deg)
    if robot is None:
        return
    for key in ("joint_lower_deg", "joint_upper_deg"):
        values = getattr(section, key)
        if values is not None:
            yield from check_joints(f"robot.{key}", values, robot)
    if section.home_deg is not None:
        yield from check_joints("robot.home_deg", section.home_deg, robot, section)
    lower, upper = section.joint_lower_deg, section.joint_upper_deg
    if lower and upper and len(lower) == len(upper) == robot.n:
        for i in range(robot.n):
            if lower[i] >= upper[i]:
                yield Problem(
                    "robot.joint_lower_deg",
                    f"joint {robot.joint_names[i]}: found {lower[i]:g}, expected below "
                    f"joint_upper_deg {upper[i]:g}",
                )


def check_joints(
    where: str, values: Sequence[float], robot: Robot, section: RobotSection | None = None
) -> Iterator[Problem]:
    """Joint positions [deg]: as many as the robot has, in its own and the section's range."""
    if len(values) != robot.n:
        yield Problem(
            where,
            f"found {len(values)} values, expected {robot.n}: one a joint of {robot.name} "
            f"({', '.join(robot.joint_names)})",
        )
        return
    if _like_radians(values) and max(map(abs, values)) <= 2.0 * math.pi + 0.01:
        yield Problem(where, f"found {shown(values)}: looks like radians, expected degrees")
        return
    lower, upper = np.rad2deg(robot.limits.lower), np.rad2deg(robot.limits.upper)
    own = (None, None) if section is None else (section.joint_lower_deg, section.joint_upper_deg)
    if own[0] is not None and len(own[0]) == robot.n:
        lower = np.maximum(lower, own[0])
    if own[1] is not None and len(own[1]) == robot.n:
        upper = np.minimum(upper, own[1])
    for i, value in enumerate(values):
        if not lower[i] - 1e-6 <= value <= upper[i] + 1e-6:
            yield Problem(
                where,
                f"joint {robot.joint_names[i]}: found {value:g}, expected {lower[i]:.0f} to "
                f"{upper[i]:.0f} [deg]",
            )


def check_camera(
    where: str, section: CameraSection, robot: RobotSection | None
) -> Iterator[Problem]:
    """Model, driver, units, and whether the robot can be in the camera's range at all."""
    model = CAMERA_MODELS.get(section.model or "")
    yield from _check_mounted(where, section, "camera")
    if model is None or robot is None or section.mounted_on == "flange":
        return
    if not _sane(section.position):
        return
    arm = _arm(robot)
    reach = 1.0 if arm is None else arm.reach
    farthest = model.range[1]
    distance = float(np.linalg.norm(np.subtract(section.position, robot.position)))
    if distance - reach > farthest:
        yield Problem(
            f"{where}.position",
            f"found {shown(section.position)}, {distance:.3g} m from the robot, expected at most "
            f"{farthest + reach:.3g} m: {section.model} sees {farthest:g} m far and the robot "
            f"reaches {reach:g} m",
        )


def check_stereo(where: str, section: StereoSection) -> Iterator[Problem]:
    """Model, driver and units of a stereo pair."""
    yield from _check_mounted(where, section, "stereo")
    model = CAMERA_MODELS.get(section.model or "")
    if model is not None and section.driver == SIMULATED and model.principle != "stereo":
        pairs = [name for name, entry in CAMERA_MODELS.items() if entry.principle == "stereo"]
        yield Problem(
            f"{where}.model",
            f'found "{section.model}", which is no stereo pair; expected one of {", ".join(pairs)}',
        )


def _check_mounted(where: str, section: MountedSection, kind: Kind) -> Iterator[Problem]:
    """What holds for everything with lenses."""
    yield from check_metres(f"{where}.position", section.position)
    if section.rpy_deg is not None:
        yield from check_degrees(f"{where}.rpy_deg", section.rpy_deg)
    if section.look_at is not None:
        yield from check_metres(f"{where}.look_at", section.look_at)
    yield from check_driver(f"{where}.driver", kind, section.driver)
    if section.latency_ms is not None and 0.0 < section.latency_ms < 0.5:
        yield Problem(
            f"{where}.latency_ms",
            f"found {section.latency_ms:g}: looks like seconds, expected milliseconds",
        )
    if section.model is None:
        if section.driver == SIMULATED and kind == "camera":
            yield Problem(
                f"{where}.model",
                "missing (Key of the camera catalogue); a simulated camera needs one; "
                f"known: {', '.join(CAMERA_MODELS)}",
            )
    elif section.model not in CAMERA_MODELS:
        if section.driver == SIMULATED:  # a real camera may be called what its owner likes
            yield Problem(f"{where}.model", _unknown("camera", section.model, CAMERA_MODELS))
    else:
        fastest = CAMERA_MODELS[section.model].max_rate
        if section.rate_hz is not None and section.rate_hz > fastest:
            yield Problem(
                f"{where}.rate_hz",
                f"found {section.rate_hz:g}, expected at most {fastest:g} [Hz] of {section.model}",
            )
    distance = float(np.linalg.norm(section.position))
    if section.mounted_on == "flange" and distance > 1.0 and _sane(section.position):
        yield Problem(
            f"{where}.position",
            f"found {shown(section.position)}, {distance:.3g} m from the flange, expected "
            'at most 1 m (it is in the flange\'s frame; mounted_on = "world" for a fixed one)',
        )


def check_standing_arm(where: str, section: StandingArmSection) -> Iterator[Problem]:
    """Model, joints and units of another arm."""
    yield from check_metres(f"{where}.position", section.position)
    yield from check_degrees(f"{where}.rpy_deg", section.rpy_deg)
    if section.model not in ROBOT_NAMES:
        yield Problem(f"{where}.model", _unknown("robot", section.model, ROBOT_NAMES))
    elif section.joints_deg is not None:
        robot = load_robot(section.model)
        yield from check_joints(f"{where}.joints_deg", section.joints_deg, robot)


def check_solid(where: str, section: ShapeSection) -> Iterator[Problem]:
    """Units of a solid."""
    yield from check_metres(f"{where}.position", section.position)
    yield from check_degrees(f"{where}.rpy_deg", section.rpy_deg)
    for key in ("size", "radius", "height"):
        value = getattr(section, key)
        for length in value if isinstance(value, tuple) else (value,):
            if length is None:
                continue
            if length > 2.0 * FARTHEST:
                yield Problem(
                    f"{where}.{key}",
                    f"found {shown(value)}, expected metres, at most {2 * FARTHEST:g}"
                    + ("; looks like millimetres" if length >= 50.0 else ""),
                )
                break
            if length < SMALLEST:
                yield Problem(
                    f"{where}.{key}",
                    f"found {shown(value)}, expected metres, at least {SMALLEST:g}",
                )
                break
    if isinstance(section, ObjectSection) and section.center is not None:
        yield from check_metres(f"{where}.center", section.center)


def check_held(where: str, section: HeldSection) -> Iterator[Problem]:
    """Units of what the arm holds: the guard takes it for a part of the arm's body."""
    yield from check_solid(where, section)
    if MOST_HELD < (distance := math.hypot(*section.position)) <= FARTHEST:
        yield Problem(
            f"{where}.position",
            f"found {shown(section.position)}, {distance:.3g} m from the flange, expected at most "
            f"{MOST_HELD:g} m (it is in the flange's frame)",
        )


def check_board(section: BoardSection) -> Iterator[Problem]:
    """Units of a board's place."""
    yield from check_metres("board.position", section.position)
    yield from check_degrees("board.rpy_deg", section.rpy_deg)


def check_target(where: str, section: TargetSection) -> Iterator[Problem]:
    """Units of a target."""
    yield from check_metres(f"{where}.position", section.position)
    yield from check_degrees(f"{where}.rpy_deg", section.rpy_deg)
    yield from check_metres(f"{where}.room", section.room)
    if section.center is not None:
        yield from check_metres(f"{where}.center", section.center)


def check_person(where: str, section: PersonSection, folder: Path | None) -> Iterator[Problem]:
    """Clip, units and place of a person."""
    yield from check_metres(f"{where}.position", section.position)
    yield from check_degrees(f"{where}.yaw_deg", (section.yaw_deg,))
    if section.target is not None and math.hypot(*section.target) > 3.0:
        yield Problem(
            f"{where}.target",
            f"found {shown(section.target)}, expected metres from the person, at most 3",
        )
    if section.motion == "script" and section.script not in SCRIPTS:
        yield Problem(f"{where}.script", _unknown("script", section.script, SCRIPTS))
    if section.clip is not None:
        file = (folder or Path()) / section.clip
        if not file.is_file():
            yield Problem(
                f"{where}.clip", f"found {shown(section.clip)}, expected a file at {file}"
            )


def check_simulation(section: SimulationSection) -> Iterator[Problem]:
    """Units of what stands in none of its lists, and what needs contact that pushes."""
    for i, thing in enumerate(section.object, 1):
        if thing.path == "loose" and not section.contact_pushes:
            yield Problem(
                f'simulation.object[{i}] "{thing.name}".path',
                'found "loose", which needs simulation.contact_pushes = true: else nobody can grip '
                "or carry it",
            )
    if 0.0 < section.calibration_error_mm < 0.02:
        yield Problem(
            "simulation.calibration_error_mm",
            f"found {section.calibration_error_mm:g}: looks like metres, expected millimetres",
        )
    if section.car is not None:
        yield from check_metres("simulation.car.position", section.car.position)
        yield from check_degrees("simulation.car.yaw_deg", (section.car.yaw_deg,))


def check_mapping(section: MappingSection, robot: RobotSection | None) -> Iterator[Problem]:
    """Units and size of the mapped box."""
    if section.lower is None or section.upper is None:
        return
    yield from check_metres("mapping.lower", section.lower)
    yield from check_metres("mapping.upper", section.upper)
    if not _sane(section.lower) or not _sane(section.upper):
        return
    voxels = float(np.prod(np.ceil(np.subtract(section.upper, section.lower) / section.voxel)))
    if voxels > 20e6:
        yield Problem(
            "mapping.voxel",
            f"{section.voxel:g} m makes {voxels / 1e6:.0f} million voxels of the box, expected at "
            "most 20 million: a coarser voxel or a smaller box",
        )
    if robot is not None:
        base = np.asarray(robot.position)
        if np.any(base < section.lower) or np.any(base > section.upper):
            yield Problem(
                "mapping.lower",
                f"the robot's base {shown(robot.position)} lies outside the mapped box "
                f"{shown(section.lower)} to {shown(section.upper)}",
            )


def check_patrol(section: PatrolSection, robot: RobotSection | None) -> Iterator[Problem]:
    """Goals against the robot's joints."""
    if len(section.goals_deg) == 1:
        yield Problem("patrol.goals_deg", "found 1 goal, expected none or at least 2")
    model = None if robot is None else _arm(robot)
    if model is None:
        return
    for name, values in section.goals_deg.items():
        yield from check_joints(f"patrol.goals_deg.{name}", values, model, robot)


def check_clear(
    where: str,
    joints_deg: Sequence[float],
    robot: RobotSection,
    solids: Sequence[SolidSection],
    floor: bool,
) -> Iterator[Problem]:
    """No moving link stands inside a declared solid, or in the floor, at these joints."""
    model = robot_of(robot)
    if len(joints_deg) != model.n:
        return
    T, q = robot.T_world_base, np.deg2rad(joints_deg)
    centers = sphere_centers(model, q) @ T[:3, :3].T + T[:3, 3]
    # The base and the first link stand on or hang from something.
    moving = model.spheres.link >= 2
    within = [(f'inside solid "{s.name}"', s.solid.distance(centers)) for s in solids]
    if floor:
        within.append(("below the floor (z = 0)", centers[:, 2]))
    for what, away in within:
        depth = np.where(moving, model.spheres.radius - away, -np.inf)
        worst = int(np.argmax(depth))
        if depth[worst] > ENTERS:
            link = model.link_names[int(model.spheres.link[worst])]
            yield Problem(
                where,
                f"link {link} stands {depth[worst] * 100:.0f} cm {what}, expected a free "
                "configuration",
            )


def check_names(named: Iterable[tuple[str, str]]) -> Iterator[Problem]:
    """No name twice among (where, name) of tables that share one space of names."""
    first: dict[str, str] = {}
    for where, name in named:
        if name in first:
            yield Problem(
                f"{where}.name",
                f'"{name}" is taken by {first[name].partition(" ")[0]}, expected a unique name',
            )
        else:
            first[name] = where


def check_metres(where: str, values: Sequence[float]) -> Iterator[Problem]:
    """A position within a cell's size."""
    worst = max(map(abs, values))
    if worst > FARTHEST:
        hint = "; looks like millimetres" if worst >= 100.0 else ""
        yield Problem(
            where,
            f"found {shown(values)}, expected metres, at most {FARTHEST:g} from the origin{hint}",
        )


def check_degrees(where: str, values: Sequence[float]) -> Iterator[Problem]:
    """Angles that are degrees: within two turns, and no multiples of pi/4."""
    if max(map(abs, values)) > 720.0:
        yield Problem(where, f"found {shown(values)}, expected degrees, at most 720")
    elif _like_radians(values) and any(_multiple_of_pi(v) for v in values):
        yield Problem(where, f"found {shown(values)}: looks like radians, expected degrees")


def _like_radians(values: Sequence[float]) -> bool:
    """Small angles written with decimals."""
    return max(map(abs, values)) <= 2.0 * math.pi + 0.01 and any(v != round(v) for v in values)


def _multiple_of_pi(value: float) -> bool:
    quarters = value / (math.pi / 4.0)
    return round(quarters) != 0 and abs(quarters - round(quarters)) < 0.003


def _sane(position: Sequence[float]) -> bool:
    return max(map(abs, position)) <= FARTHEST


def check_driver(where: str, kind: Kind, name: str) -> Iterator[Problem]:
    """That there is such a driver; none of its code is run."""
    if not is_known(kind, name):
        yield Problem(where, unknown(kind, name))


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    return f'unknown {kind} "{name}"; {nearest(name, known)}'
