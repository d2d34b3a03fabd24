"""The examples are short, and they run."""

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


@pytest.mark.parametrize("name", sorted(file.name for file in EXAMPLES.glob("*.py")))
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
