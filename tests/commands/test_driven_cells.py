"""The command line on cells with drivers: looking commands nothing, a lost arm ends with exit 1."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from armsight.cli import run
from armsight.runtime import parts

DOUBLES = Path(__file__).resolve().parents[1] / "devices"
CELL = """
[cell]
name = "driven"
[robot]
model = "ur5"
driver = "plugged_doubles:Arm"
connection = { CONNECTION }
[mapping]
voxel = 0.1
[patrol.goals_deg]
A = [0, -90, 90, -90, -90, 0]
B = [30, -90, 90, -90, -90, 0]
"""


def armsight(folder, *words, connection=""):
    """Exit code, messages and what the arm's driver counted: commands and stops."""
    file, report = folder / "cell.toml", folder / "counted"
    file.write_text(CELL.replace("CONNECTION", connection))
    ended = subprocess.run(
        [sys.executable, "-m", "armsight", *words],
        cwd=folder,
        env=os.environ
        | {
            "PYTHONPATH": os.pathsep.join([str(DOUBLES), os.environ.get("PYTHONPATH", "")]),
            "PLUGGED_DOUBLES_REPORT": str(report),
            "ARMSIGHT_RUNTIME_DIR": str(folder),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return ended.returncode, ended.stderr, report.read_text() if report.exists() else ""


@pytest.mark.parametrize(
    "words",
    [
        ("view", "cell.toml", "--seconds", "0.3", "--headless"),
        ("record", "cell.toml", "look.mcap", "--watch", "--seconds", "0.3", "--headless"),
        ("doctor", "--driver", "plugged_doubles:Arm", "--kind", "arm", "--seconds", "0.3"),
    ],
)
def test_looking_sends_no_command(tmp_path, monkeypatch, words):
    monkeypatch.syspath_prepend(str(DOUBLES))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARMSIGHT_RUNTIME_DIR", str(tmp_path))
    monkeypatch.syspath_prepend(str(DOUBLES.parent / "runtime"))
    from doubles import FakeGuard, FakePlanner
    from plugged_doubles import LOG

    class NoMap:
        def update(self, frames, joints, now, tracked=None):
            return None

    few = parts.Parts(NoMap(), FakePlanner(), FakeGuard())  # the map is not what is looked at
    monkeypatch.setattr(parts, "make_parts", lambda cell, config: few)

    LOG.calls.clear()
    Path("cell.toml").write_text(CELL.replace("CONNECTION", ""))
    assert run(words) == 0
    assert [call[0] for call in LOG.calls if call[0] in ("command", "stop")] == []
    assert LOG.count("open") >= 1


def test_an_arm_that_hangs_ends_the_process_with_exit_1_and_its_reason(tmp_path):
    words = ("patrol", "cell.toml", "--seconds", "60", "--headless")
    code, told, counted = armsight(tmp_path, *words, connection='hangs_later = "read"')
    assert code == 1, told
    assert "arm ur5: read() has not returned for 0.25 s" in told.strip().splitlines()[-1]
    assert int(counted.split()[1]) >= 1  # it was told to stop
