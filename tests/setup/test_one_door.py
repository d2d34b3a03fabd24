"""The guard's component is the one door to the arm: nobody else sends it a velocity."""

import ast
from pathlib import Path

import armsight

ROOT = Path(armsight.__file__).parent
MAY = {
    "runtime/components.py",  # the guard's component
    "runtime/shared_devices.py",  # hands its command through, behind a lock
    "devices/conformance.py",  # asks a driver whether it keeps the port's promises
    "experiments/touch_cell.py",  # the loop of a cell without pictures: what its guard decided
    "experiments/servo_cell.py",  # likewise
    "experiments/station_bench.py",  # contact physics without a guard
    "experiments/faults_devices.py",  # an arm that loses commands: hands the others through
    "experiments/own_arm_scenes.py",  # draws training pictures of a simulated arm, no cell runs
}


def callers():
    """Files of the package that call ``command_velocity``, beside the drivers themselves."""
    for file in sorted(ROOT.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            called = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
            if called and node.func.attr == "command_velocity":
                yield file.relative_to(ROOT).as_posix()


def test_only_the_guards_component_commands_the_arm():
    assert "runtime/components.py" in set(callers())
    assert {c for c in callers() if not c.startswith("devices/driven")} <= MAY
