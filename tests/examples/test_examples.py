"""The examples are short, and they run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ARGUMENTS = {"patrol.py": ["2"], "watch.py": ["ur3_bench"], "replay.py": ["recording.mcap"]}
EXPECTED = {
    "patrol.py": "contacts while moving: 0",
    "watch.py": "camera behind:",
    "replay.py": "occupied voxels, live",
}


TASKS = {"keep_above.py"}  # run by `armsight run`


@pytest.mark.parametrize(
    "name", sorted(file.name for file in EXAMPLES.glob("*.py") if file.name not in TASKS)
)
def test_example(name: str, tmp_path: Path, gl: str):
    file = EXAMPLES / name
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 40
    ended = subprocess.run(
        [sys.executable, str(file), *ARGUMENTS[name]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert EXPECTED[name] in ended.stdout


def test_a_strangers_task_keeps_the_tcp_above_a_ball(tmp_path: Path, gl: str):
    """The command of its docstring: the ball is found, and the arm goes there by velocities."""
    file = EXAMPLES / "keep_above.py"
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 60
    told = tmp_path / "told.json"
    words = "run keep_above.toml --task keep_above:KeepAbove --seconds 1.5 --headless --json"
    ended = subprocess.run(
        [sys.executable, "-m", "armsight", *words.split(), str(told)],
        cwd=EXAMPLES,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    figures = json.loads(told.read_text())
    assert figures["guard"] in ("velocity", "slowed")
    assert figures["goal"] == "above the ball"
    assert figures["contacts"] == 0
