"""Reads ``workcell.toml``: all problems at once, one line each."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from armsight.devices.port import Kind
from armsight.errors import WorkcellError
from armsight.robots import tools
from armsight.robots.catalogue import is_path
from armsight.workcell import checks
from armsight.workcell.fields import Section
from armsight.workcell.problems import Problem, WorkcellFileError, from_validation, not_toml, path
from armsight.workcell.schema import MappingSection, PatrolSection, Workcell
from armsight.workcell.schema_devices import CameraSection, RobotSection, StereoSection
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

LARGEST = 1_000_000
"""A workcell file is never larger [bytes]."""

_HAND: dict[str, Kind] = {"wrench": "wrench", "gripper": "gripper", "empty_switch": "switch"}

SectionT = TypeVar("SectionT", bound=Section)


def load_workcell(file: str | Path, calibration: Path | None = None) -> Workcell:
    """Read and check a workcell file.

    Args:
        file: the workcell file.
        calibration: where its calibration file is, if not where the cell itself says.

    Raises:
        WorkcellError: it cannot be read or has problems; one line a problem, each with the file,
            the key, what was found and what is expected.
    """
    location = Path(file)
    try:
        if location.is_dir():
            raise WorkcellError(f"{file}: is a folder, expected a workcell file (.toml)")
        size = location.stat().st_size
        if location.suffix == ".mcap":
            raise WorkcellError(f"{file}: a recording; 'armsight replay {file}' plays it")
        if size > LARGEST:
            raise WorkcellError(
                f"{file}: {size / 1e6:.1f} MB large, expected a workcell file of at most 1 MB"
            )
        data = location.read_bytes()
    except FileNotFoundError:
        raise WorkcellError(
            f"{file}: no such file; 'armsight new {file}' starts one, and workcells/ has examples"
        ) from None
    except OSError as error:
        raise WorkcellError(f"{file}: cannot be read: {error.strerror or error}") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise WorkcellError(
            f"{file}: not UTF-8 text (byte {error.start}), expected a TOML file"
        ) from None
    workcell = parse_workcell(text, str(file), location.resolve().parent)
    workcell._calibration_file = calibration
    return workcell


def parse_workcell(text: str, file: str = "workcell.toml", folder: Path | None = None) -> Workcell:
    """Check the text of a workcell file.

    Args:
        text: TOML.
        file: how errors name it.
        folder: where relative files (arms, motion clips) lie; None: the working folder.

    Raises:
        WorkcellError: it has problems.
    """
    if not text.strip():
        raise WorkcellError(f"{file}: empty, expected a workcell; 'armsight new FILE' starts one")
    try:
        raw = tomllib.loads(text)
    except ValueError as error:  # also a number of more digits than Python takes
        raise WorkcellError(f"{file}: {not_toml(error, Workcell)}") from None
    except RecursionError:
        raise WorkcellError(f"{file}: nested too deeply, expected a plain workcell file") from None
    _find_own(raw, folder)
    workcell, problems = None, []
    try:
        workcell = Workcell.model_validate(raw)
    except ValidationError as error:
        problems = from_validation(error, raw, Workcell)
    problems += list(_insane(raw, folder))
    if problems or workcell is None:
        raise WorkcellFileError(file, problems)
    workcell._file = folder / Path(file).name if folder is not None else None
    workcell._text = text
    return workcell


def _find_own(raw: Mapping[str, Any], folder: Path | None) -> None:
    """Make paths of a user's own arm and tool absolute; names of the catalogue stay as they are."""
    robot = raw.get("robot")
    if not isinstance(robot, dict):
        return
    for kind, own in (("model", is_path), ("tool", tools.is_path)):
        name = robot.get(kind)
        if isinstance(name, str) and own(name):
            robot[kind] = str((folder or Path.cwd()) / Path(name))


def _insane(raw: Mapping[str, Any], folder: Path | None) -> Iterator[Problem]:
    """Sanity problems of every table that is valid by itself."""
    robot = _one(RobotSection, raw.get("robot"))
    simulation = raw.get("simulation")
    simulation = simulation if isinstance(simulation, Mapping) else {}
    if robot is not None:
        yield from checks.check_robot(robot)
    for where, camera in _each(CameraSection, raw, "camera"):
        yield from checks.check_camera(where, camera, robot)
    for where, stereo in _each(StereoSection, raw, "stereo"):
        yield from checks.check_stereo(where, stereo)
    for table, kind in _HAND.items():
        name = raw.get(table, {}).get("driver") if isinstance(raw.get(table), Mapping) else None
        if isinstance(name, str):
            yield from checks.check_driver(f"{table}.driver", kind, name)
    solids = list(_each(SolidSection, raw, "solid"))
    undeclared = list(_each(ShapeSection, simulation, "undeclared", "simulation."))
    objects = list(_each(ObjectSection, simulation, "object", "simulation."))
    for where, solid in (*solids, *undeclared, *objects):
        yield from checks.check_solid(where, solid)
    for where, arm in _each(StandingArmSection, simulation, "arm", "simulation."):
        yield from checks.check_standing_arm(where, arm)
    for where, held in _each(HeldSection, raw, "held"):
        yield from checks.check_held(where, held)
    for where, target in _each(TargetSection, simulation, "target", "simulation."):
        yield from checks.check_target(where, target)
    board = _one(BoardSection, raw.get("board"))
    if board is not None:
        yield from checks.check_board(board)
    for where, person in _each(PersonSection, simulation, "person", "simulation."):
        yield from checks.check_person(where, person, folder)
    settings = _one(SimulationSection, simulation)
    if settings is not None:
        yield from checks.check_simulation(settings)
    mapping = _one(MappingSection, raw.get("mapping", {}))
    if mapping is not None:
        yield from checks.check_mapping(mapping, robot)
    patrol = _one(PatrolSection, raw.get("patrol", {}))
    if patrol is not None:
        yield from checks.check_patrol(patrol, robot)
    yield from checks.check_names([*_names(raw, "camera"), *_names(raw, "stereo")])
    # The page and the truth know solids, people and things by name alone.
    yield from checks.check_names(
        [
            *_names(raw, "solid"),
            *_names(raw, "held"),
            *_names(simulation, "undeclared", "simulation."),
            *_names(simulation, "arm", "simulation."),
            *_names(simulation, "person", "simulation."),
            *_names(simulation, "object", "simulation."),
            *_names(simulation, "target", "simulation."),
        ]
    )
    floor = settings is None or settings.floor
    yield from _in_collision(robot, [s for _, s in solids], patrol, floor)


def _in_collision(
    robot: RobotSection | None,
    solids: list[SolidSection],
    patrol: PatrolSection | None,
    floor: bool,
) -> Iterator[Problem]:
    if robot is None or any(checks.check_robot(robot)):
        return
    if robot.home_deg is not None:
        yield from checks.check_clear("robot.home_deg", robot.home_deg, robot, solids, floor)
    for name, goal in (patrol.goals_deg if patrol is not None else {}).items():
        yield from checks.check_clear(f"patrol.goals_deg.{name}", goal, robot, solids, floor)


def _one(model: type[SectionT], raw: Any) -> SectionT | None:
    try:
        return model.model_validate(raw)
    except ValidationError:
        return None


def _each(
    model: type[SectionT], raw: Mapping[str, Any], key: str, prefix: str = ""
) -> Iterator[tuple[str, SectionT]]:
    entries = raw.get(key, [])
    for i, entry in enumerate(entries if isinstance(entries, list) else []):
        section = _one(model, entry)
        if section is not None:
            yield prefix + path((key, i), raw), section


def _names(raw: Mapping[str, Any], key: str, prefix: str = "") -> Iterator[tuple[str, str]]:
    entries = raw.get(key, [])
    for i, entry in enumerate(entries if isinstance(entries, list) else []):
        name = entry.get("name") if isinstance(entry, Mapping) else None
        if isinstance(name, str):
            yield prefix + path((key, i), raw), name
