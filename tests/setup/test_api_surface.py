"""The public names are a list: a name that goes or comes is a decision, with a line in CHANGELOG.

Renew ``api_surface.txt`` with ``python tests/setup/test_api_surface.py``.
"""

import inspect
from importlib import import_module
from pathlib import Path
from typing import Protocol

FILE = Path(__file__).with_name("api_surface.txt")
MODULES = [
    "armsight.devices.data",
    "armsight.devices.protocols",
    "armsight.errors",
    "armsight.experiments",
    "armsight.experiments.cache",
    "armsight.experiments.frame",
    "armsight.experiments.rows",
    "armsight.geometry.camera",
    "armsight.geometry.pose",
    "armsight.geometry.shapes",
    "armsight.mapping.config",
    "armsight.mapping.snapshot",
    "armsight.mapping.workspace_map",
    "armsight.motion.collision",
    "armsight.motion.data",
    "armsight.motion.guard",
    "armsight.motion.guard_config",
    "armsight.tasks.patrol",
    "armsight.motion.plan",
    "armsight.robots",
    "armsight.robots.kinematics",
    "armsight.runtime.component",
    "armsight.runtime.configure",
    "armsight.recording.recorder",
    "armsight.recording.replay",
    "armsight.runtime.session",
    "armsight.runtime.view",
    "armsight.simulation.spec",
    "armsight.simulation.world",
    "armsight.viewer",
    "armsight.workcell",
    "armsight.workcell.drivers",
]


def surface() -> str:
    """One line a public name, with its arguments where it is a function or a class."""
    lines = []
    for name in MODULES:
        module = import_module(name)
        listed = getattr(module, "__all__", None)
        for public in sorted(listed or vars(module)):
            value = getattr(module, public)
            own = listed is not None or getattr(value, "__module__", None) == name
            if public.startswith("_") or not own or not callable(value):
                continue
            lines.append(f"{name}.{public}{arguments(value)}")
    return "\n".join(lines) + "\n"


def arguments(value: object) -> str:
    if inspect.isclass(value) and (issubclass(value, Exception) or Protocol in value.__bases__):
        return ""
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):
        return ""
    return "(" + ", ".join(signature.parameters) + ")"


def test_public_names_are_those_listed():
    known, found = set(FILE.read_text().splitlines()), set(surface().splitlines())
    assert found == known, (
        f"gone: {sorted(known - found)}; new: {sorted(found - known)}; if this is meant: "
        "python tests/setup/test_api_surface.py, and a line in CHANGELOG.md"
    )


if __name__ == "__main__":
    FILE.write_text(surface())
