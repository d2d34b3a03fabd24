"""The command line: exit codes, one-line errors, help, and the README's commands."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from armsight import __version__
from armsight.cli import COMMANDS, main, name_of, run
from armsight.commands.doctor import findings
from armsight.commands.running import _Ticker
from armsight.workcell.packaged import find

ROOT = Path(__file__).resolve().parents[2]


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"armsight {__version__}\n"


def test_a_process_that_is_not_armsights_own_is_not_ended(monkeypatch):
    """A driver's thread that hung in one test ended the process in which another called this."""
    monkeypatch.setattr("armsight.devices.line._left_behind", ["a driver hangs"])
    monkeypatch.setattr("os._exit", lambda code: pytest.fail("the caller's process ended"))
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0


@pytest.mark.parametrize("words", [["--help"], [], *([name_of(c), "--help"] for c in COMMANDS)])
def test_help(words, capsys):
    with pytest.raises(SystemExit) as ended:
        run(words)
    assert ended.value.code == 0
    assert "usage: armsight" in capsys.readouterr().out


def test_help_of_every_command_has_an_example():
    for command in COMMANDS:
        name = name_of(command)
        assert re.search(rf"Examples?: armsight {name}\b", command.__doc__ or ""), name


@pytest.mark.parametrize(
    "words",
    [["nonsense"], ["patrol"], ["patrol", "x", "--seconds", "soon"], ["demo", "--prot", "1"]],
)
def test_what_is_not_understood_exits_2(words, capsys):
    with pytest.raises(SystemExit) as ended:
        run(words)
    assert ended.value.code == 2
    assert "help" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        (["check", "no.toml"], 1, "no.toml: no such file"),
        (["patrol", "no.toml"], 1, "no.toml: no such file"),
        (["patrol", "ur5_four_cameras", "--headless"], 2, "--headless needs --seconds"),
        (["view", "ur5_four_cameras", "--headless"], 2, "--headless needs --seconds"),
        (["patrol", "ur3_bench", "--headless", "--seconds", "-1"], 2, "--seconds is -1; exp"),
        (
            ["patrol", "ur3_bench", "--headless", "--seconds", "nan"],
            2,
            "--seconds is nan; exp",
        ),
        (["charge", "ur10_charging", "--charging", "inf", "--headless"], 2, "never ends"),
        (["charge", "ur10_charging", "--visits", "-1"], 2, "--visits is -1; expected 0 or more"),
        (["charge", "ur10_charging", "--headless", "--visits", "0"], 2, "--headless needs --vis"),
        (["charge", "ur10_charging", "--charging", "nan"], 2, "--charging is nan s; expected 0"),
        (["replay", "no.mcap"], 1, "no.mcap: no such recording"),
        (["experiment", "patrol-smook"], 2, 'did you mean "patrol-smoke"'),
        (["experiment", "patrol-smoke", "--runs", "0"], 2, "--runs is 0, expected at least 1"),
        (["new", "x.toml", "--robot", "ur50"], 2, 'unknown robot "ur50"; did you mean "ur5"'),
    ],
)
def test_errors_are_one_line(words, code, expected, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(words) == code
    out, err = capsys.readouterr()
    told = err or out
    assert expected in told
    assert told.count("\n") == 1
    assert "Traceback" not in told


def test_debug_shows_the_trace():
    from armsight.errors import ArmsightError

    with pytest.raises(ArmsightError):
        run(["patrol", "no.toml", "--debug"])


def test_blank_goals_are_told(tmp_path, capsys):
    file = tmp_path / "cell.toml"
    assert run(["new", str(file)]) == 0
    assert run(["patrol", str(file), "--seconds", "1", "--headless"]) == 2
    assert "a patrol needs at least two goals" in capsys.readouterr().err


def test_new_then_check(tmp_path, capsys):
    file = tmp_path / "my cell.toml"
    assert run(["new", str(file), "--robot", "iiwa"]) == 0
    assert 'name = "my_cell"' in file.read_text()
    assert run(["check", str(file)]) == 0
    assert "my_cell, iiwa, 2 cameras" in capsys.readouterr().out


SPHERES = """<robot name="mine">
<link name="a"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="b"/><joint name="j" type="revolute"><parent link="a"/>
<child link="b"/><limit lower="-1" upper="1" velocity="1"/></joint></robot>"""


def test_new_with_an_arm_of_ones_own(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'my "arm".urdf').write_text(SPHERES)
    # The path begins where one stands; in the file it begins where that lies.
    for file in ("cell.toml", "cells/cell.toml"):
        (tmp_path / "cells").mkdir(exist_ok=True)
        assert run(["new", file, "--robot", 'my "arm".urdf']) == 0
        monkeypatch.chdir("/")
        assert run(["check", str(tmp_path / file)]) == 0
        monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    assert run(["new", "other.toml", "--robot", "./none.urdf"]) == 1
    assert "none.urdf: no such folder or URDF" in capsys.readouterr().err
    assert not (tmp_path / "other.toml").exists()


def test_new_says_what_can_be_typed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["new", "--", "-cell.toml"]) == 0
    assert "armsight check ./-cell.toml" in capsys.readouterr().err


def test_new_never_overwrites(tmp_path, capsys):
    file = tmp_path / "cell.toml"
    file.write_text("precious")
    assert run(["new", str(file)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert file.read_text() == "precious"


def test_new_with_a_bad_name_writes_nothing(tmp_path, capsys):
    file = tmp_path / "cell.toml"
    assert run(["new", str(file), "--name", "two words"]) == 1
    assert 'cell.name: found "two words"' in capsys.readouterr().err
    assert not file.exists()


def test_check_tells_of_every_file(tmp_path, capsys):
    bad = tmp_path / "bad.toml"
    bad.write_text("[cell]\nname = 'x'\n[robot]\nmodel = 'ur5'\nspeed = 3\nsped = 2\n")
    assert run(["check", str(bad), "ur5_four_cameras", str(tmp_path / "no.toml")]) == 1
    out = capsys.readouterr().out
    assert f"{bad}: robot.speed: found 3, expected at most 1" in out
    assert f"{bad}: robot.sped: unknown key" in out
    assert "good ur5_four_cameras" in out
    assert "no.toml: no such file" in out


def test_check_says_what_is_better_otherwise(tmp_path, capsys):
    """Two of 19 arms stood before what might have been behind a wall, their plug half in."""
    cell = find("ur10_charging").read_text()
    far = tmp_path / "far.toml"
    far.write_text(cell.replace("upper = [1.30,", "upper = [1.34,"))
    assert run(["check", "ur10_charging", str(far)]) == 0
    out = capsys.readouterr().out
    assert "hint ur10_charging" not in out
    assert f"hint {far}: the map reaches 0.03 m past wall_front" in out


def test_robots_lists_what_there_is(capsys):
    assert run(["robots"]) == 0
    out = capsys.readouterr().out
    for word in ("ur3", "panda", "gripper", "BSD-3", "kinect_v2", "512x424", "simulated"):
        assert word in out


def test_experiments_are_listed(capsys):
    assert run(["experiment"]) == 0
    assert "patrol-smoke" in capsys.readouterr().out


def test_doctor_looks_at_everything_and_survives(monkeypatch):
    from armsight.commands import doctor

    monkeypatch.setattr(doctor, "_memory", lambda: 1 / 0)
    monkeypatch.setattr(doctor, "_rendering", lambda: doctor.Finding("good", "rendering", "x"))
    found = {finding.title: finding for finding in findings(0)}
    assert {"Python", "cores", "OpenGL", "disk", "port", "cells"} <= set(found)
    assert found["memory"].verdict == "missing"
    assert all(f.mend for f in found.values() if f.verdict in ("slow",))


def test_doctor_sees_a_port_in_use():
    import socket

    from armsight.commands import doctor

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert doctor._port(port).verdict == "slow"
    assert doctor._port(port).verdict == "good"


def test_nothing_heavy_is_imported_for_help():
    heavy = ["numpy", "mujoco", "numba", "viser", "pydantic", "scipy", "cv2", "ompl", "matplotlib"]
    code = (
        "import sys\nfrom armsight.cli import run\n"
        "try:\n    run(['--help'])\nexcept SystemExit: pass\n"
        f"print([m for m in {heavy} if m in sys.modules], file=sys.stderr)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stderr.strip() == "[]"


def test_reader_gone():
    ended = subprocess.run(
        f"{sys.executable} -m armsight robots | head -c 1",
        shell=True,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in ended.stderr
    assert "BrokenPipe" not in ended.stderr


def commands_of(page: str) -> list[list[str]]:
    """The ``./run ...`` and ``armsight ...`` lines of a page's code blocks."""
    found = []
    for block in re.findall(r"```(?:sh|bash|)\n(.*?)```", (ROOT / page).read_text(), re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = line.partition("#")[0].split()
            if words[:1] in (["./run"], ["armsight"]) and words[1:2] not in (["test"], ["docs"]):
                found.append(words[1:])
    return found


@pytest.mark.parametrize(
    "page",
    ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))],
)
def test_commands_of_the_pages_exist(page, monkeypatch):
    for command in COMMANDS:
        monkeypatch.setattr(command, "run", lambda self: 0)
    monkeypatch.chdir(ROOT / "examples")  # where the tasks of the examples are found
    for words in commands_of(page):
        assert run(words or ["--version"]) == 0, words


def test_the_readme_shows_the_two_commands():
    assert ["demo"] in commands_of("README.md")
    assert "./run test" in (ROOT / "README.md").read_text()


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_patrol_ends_in_order(gl, how, tmp_path):
    """Ctrl-C and SIGTERM: the figures so far are still written, and nothing is left over."""
    file = tmp_path / "patrol.json"
    words = f"patrol ur3_bench --seconds 3600 --headless --json {file}".split()
    patrol = subprocess.Popen(
        [sys.executable, "-m", "armsight", *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    try:
        deadline = time.monotonic() + 240
        assert patrol.stderr is not None
        for line in patrol.stderr:
            if " of 3600 s" in line or time.monotonic() > deadline:
                break
        patrol.send_signal(how)
        _, err = patrol.communicate(timeout=60)
    finally:
        patrol.kill()
    assert "Traceback" not in err
    assert patrol.returncode == 130
    assert json.loads(file.read_text())["workcell"] == "ur3_bench"


@pytest.mark.parametrize(
    ("seconds", "now", "words", "share"),
    [
        (0.0, [0.0], "0 of 0 s", 1.0),
        (None, [3.2], "3 s", 0.0),
        (8.0, [0.0, 2.0], "2 of 8 s", 0.25),
        (8.0, [42.0, 44.0], "2 of 8 s", 0.25),  # a real cell's clock, which ran before it
        (8.0, [0.0, 6.0, 0.0, 2.0], "2 of 8 s", 0.25),  # somebody pressed Reset
    ],
)
def test_a_run_says_how_far_it_is(seconds, now, words, share):
    ticker, told = _Ticker(seconds), []
    ticker.progress = lambda stage, done: told.append((stage, done))
    for moment in now:
        ticker.update(moment)
    assert told[-1] == (words, share)
