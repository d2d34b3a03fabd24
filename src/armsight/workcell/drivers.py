"""Finds drivers: by an entry point of their kind, or named in the cell file as ``module:Class``.

A driver package declares, in its ``pyproject.toml``::

    [project.entry-points."armsight.cameras"]
    realsense = "armsight_realsense:Camera"

and the cell file then says ``driver = "realsense"``. A class in a module that Python finds needs no
package: ``driver = "my_camera:Camera"``; the present folder is looked into as well. What a driver
is stands in :mod:`armsight.devices.port`.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import re
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from armsight.devices.port import GROUPS, Kind
from armsight.errors import DeviceError

SIMULATED = "simulated"


@cache
def _plugged_in(kind: Kind) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUPS[kind])}


def driver_names(kind: Kind) -> tuple[str, ...]:
    """Every driver of a kind that is installed, and ``simulated``, which no switch is."""
    made_up = () if kind == "switch" else (SIMULATED,)
    return (*made_up, *sorted(_plugged_in(kind)))


def is_known(kind: Kind, name: str) -> bool:
    """Whether there is such a driver, without running any of its code."""
    if ":" not in name:
        return name in driver_names(kind)
    top = name.partition(":")[0].partition(".")[0]
    if Path(f"{top}.py").is_file() or Path(top, "__init__.py").is_file():
        return True
    try:
        return importlib.util.find_spec(top) is not None
    except (ImportError, ValueError):
        return False


def unknown(kind: Kind, name: str) -> str:
    """What is wrong with the name of a driver that :func:`is_known` does not know."""
    if ":" in name:
        module = name.partition(":")[0]
        return (
            f'no module "{module.partition(".")[0]}" for driver "{name}"; install its package, or '
            "put its folder into PYTHONPATH"
        )
    names = driver_names(kind)
    close = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.55)
    hint = f'did you mean "{close[0]}"? ' if close else ""
    return f'unknown driver "{name}"; {hint}known: {", ".join(names)}'


def find_driver(kind: Kind, name: str) -> Callable[[Any], Any]:
    """The class of a driver; it is called with the settings of its kind.

    Raises:
        DeviceError: there is none, its package is broken, or a maker's package is missing: then it
            says what to install.
    """
    entry = _plugged_in(kind).get(name)
    if entry is None and ":" not in name:
        raise DeviceError(
            f"{unknown(kind, name)} (drivers plug in through the entry points {GROUPS[kind]})"
        )
    try:
        found: Any = _named(name) if entry is None else entry.load()
    except ImportError as error:
        raise DeviceError(
            f'driver "{name}" cannot be loaded: {error}; {_to_install(error, entry)}'
        ) from error
    except Exception as error:  # somebody else's package may fail in any way
        raise DeviceError(
            f'driver "{name}" cannot be loaded: {type(error).__name__}: {error}'
        ) from error
    if not callable(found):
        raise DeviceError(f'driver "{name}" is a {type(found).__name__}, expected a class')
    opener: Callable[[Any], Any] = found
    return opener


def _named(name: str) -> Any:
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())  # a driver beside the cell file needs no package
    added = here not in sys.path
    if added:
        sys.path.append(here)
    try:
        found: Any = importlib.import_module(module)
    finally:
        if added and here in sys.path:
            sys.path.remove(here)
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise ImportError(f"module {module} has no {attribute}")
        found = getattr(found, part)
    return found


def _to_install(error: ImportError, entry: EntryPoint | None) -> str:
    """What to give to pip, as exactly as it can be known."""
    missing = (error.name or "").partition(".")[0]
    if entry is not None and entry.dist is not None:
        package = entry.dist.name
        for line in entry.dist.requires or ():
            requirement, _, marker = line.partition(";")
            extra = re.search(r"extra\s*==\s*[\"']([^\"']+)[\"']", marker)
            word = re.match(r"[A-Za-z0-9_.-]+", requirement.strip())
            if extra and word and missing and _plain(word.group()) == _plain(missing):
                return f"install its extra: pip install '{package}[{extra.group(1)}]'"
        return f"install {package} with what its page asks for"
    return f"install the package that has it: {missing}" if missing else "see the driver's page"


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
