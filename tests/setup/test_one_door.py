"""Nothing but the guard's component and the drivers moves an arm: looked for in the source."""

import ast
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2] / "src" / "armsight"
COMMANDS = {"command_velocity"}
DOOR = {
    "runtime/components.py": "the guard's component",
    "runtime/shared_devices.py": "an arm behind a lock, for the guard's component",
    "simulation/arm.py": "the simulated arm",
    "experiments/own_arm_scenes.py": "labelled pictures of a simulated arm alone, without a cell",
    "simulation/studio_mover.py": "calibration's own mover: it goes when calibration is a task",
}
ROOMS_OF_DRIVERS = ("devices/",)


def calls_of(file: Path) -> set[str]:
    """Names of attributes that a file reads, calls or looks up by text."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def test_only_the_guards_component_and_drivers_command_an_arm():
    users = {
        str(file.relative_to(SOURCE)) for file in SOURCE.rglob("*.py") if calls_of(file) & COMMANDS
    }
    outside = {name for name in users if not name.startswith(ROOMS_OF_DRIVERS)}
    assert outside - set(DOOR) == set(), "an arm is commanded outside the guard"
    assert "runtime/components.py" in users


def test_the_search_finds_a_command_however_it_is_written(tmp_path):
    for k, text in enumerate(
        (
            "arm.command_velocity(v)",
            "f = cell.arm.command_velocity",
            'getattr(arm, "command_velocity")',
        )
    ):
        file = tmp_path / f"{k}.py"
        file.write_text(text)
        assert calls_of(file) & COMMANDS
