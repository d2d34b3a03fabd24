"""The examples are short, numbered, shown in the documentation, and they run."""

import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
ARGUMENTS = {
    "01_watch": ["ur3_bench"],
    "02_patrol": ["2"],
    "07_calibrate": ["12"],
    "11_task": ["2"],
    "12_servo": ["1.2"],
    "13_charge": ["2.4"],
}
EXPECTED = {
    "01_watch": r"camera behind: \d+ frames, alive: True",
    "02_patrol": r"contacts while moving: 0",
    "03_replay": r"occupied voxels, live (\d+), replayed \1;",
    "04_kinematics": r"[4-8] ways to be 5 cm higher(.|\n)*error: \d\.\de-(0[7-9]|1\d)",
    "05_map": r"nearest thing 0\.(1[89]|20) m away",
    "06_plan": r"to A: \d+ poses(.|\n)*nearer than 0\.\d[1-9] m",
    "07_calibrate": r"(lens|infrared|color) +points 1 to 1.5 m away: \d+\.\d mm off",
    "08_recognise": r"[1-9] arm\(s\); truth: \w+",
    "09_urdf": r"flange with all joints at 0.5 rad: \[0\.168 0\.092 0\.751\] m",
    "10_labelled_pictures": r"5: \w+, \d+ x \d+ px, \d+\.\d% robot",
    "12_servo": r"ball is \d+ mm away, \d+ before;(.|\n)*the pair sees it(.|\n)*granted",
    "13_charge": r"type2 \(\d+ %\) at \[0\.9\d* 0\.0\d+ 0\.4\d*\] m(.|\n)*now: second look",
    "11_task": r"a box of \[ *0?\.?\d* *0\.(0[4-9]|1\d?)",
}
RENDERED = {"01_watch", "02_patrol", "03_replay", "06_plan", "08_recognise", "11_task", "12_servo"}
RENDERED |= {"10_labelled_pictures", "13_charge"}
FILES = sorted(EXAMPLES.glob("[0-9]*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_example(file: Path, tmp_path: Path, request, monkeypatch, capsys):
    if file.stem in RENDERED:
        request.getfixturevalue("gl")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", [str(file), *ARGUMENTS.get(file.stem, [])])
    monkeypatch.setattr("os.environ", os.environ.copy())
    runpy.run_path(str(file), run_name="__main__")
    assert re.search(EXPECTED[file.stem], capsys.readouterr().out)


def test_they_are_numbered_short_and_shown():
    assert [int(file.stem[:2]) for file in FILES] == list(range(1, len(FILES) + 1))
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    for file in FILES:
        assert len(file.read_text(encoding="utf-8").splitlines()) <= 60, file.name
        assert f"../examples/{file.name}" in page, f"docs/examples.md does not show {file.name}"


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
