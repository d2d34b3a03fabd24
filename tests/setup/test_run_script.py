"""``./run`` without a network: a folder with spaces, a stamp that holds, too old a Python."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of what ``./run`` reads, in a folder with a space in its name."""
    place = tmp_path / "a place"
    (place / "src" / "armsight").mkdir(parents=True)
    (place / "src" / "armsight" / "kernels.py").write_text("@njit\ndef f(): pass\n")
    shutil.copytree(ROOT / "locks", place / "locks")
    shutil.copytree(ROOT / "scripts", place / "scripts")
    for name in ("run", "pyproject.toml"):
        shutil.copy2(ROOT / name, place / name)
    return place


def call(checkout: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    # Not the environment in which these tests run: the script would set that up for this checkout.
    inherited = {k: v for k, v in os.environ.items() if k != "ARMSIGHT_VENV"}
    return subprocess.run(
        [str(checkout / "run"), *words],
        capture_output=True,
        text=True,
        check=False,
        cwd="/",
        env={**inherited, "ARMSIGHT_NO_APT": "1", **environment},
    )


def script(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)


def made(checkout: Path, kind: str = "run") -> Path:
    """A pretended environment with a stamp that holds."""
    venv = checkout / ".venv"
    script(venv / "bin" / "python", 'for word in "$@"; do echo "<$word>"; done')
    stamp = subprocess.run(
        f'{{ printf "%s\\n%s\\n" "{checkout}" {kind} && cat "{checkout}/pyproject.toml" '
        f'"{checkout}/locks/{kind}.txt"; }} | cksum',
        shell=True,
        capture_output=True,
        text=True,
        check=True,
    )
    (venv / f"armsight-setup-{kind}").write_text(stamp.stdout)
    return venv


def test_it_is_plain_sh():
    for file in (ROOT / "run", ROOT / ".ci" / "run", ROOT / "scripts" / "lock.sh"):
        subprocess.run(["sh", "-n", str(file)], check=True)
        assert os.access(file, os.X_OK)


def test_the_second_time_nothing_is_set_up_and_arguments_arrive_whole(checkout: Path):
    made(checkout)
    ended = call(checkout, "patrol", "my cell.toml", "--seconds", "3", ARMSIGHT_PYTHON="/no/python")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split("\n")[:-1] == [
        "<-m>",
        "<armsight>",
        "<patrol>",
        "<my cell.toml>",
        "<--seconds>",
        "<3>",
    ]


def test_a_changed_lock_or_project_is_noticed(checkout: Path):
    for name in ("pyproject.toml", "locks/run.txt"):
        made(checkout)
        with (checkout / name).open("a") as file:
            file.write("# changed\n")
        (checkout / ".venv" / "bin" / "python").write_text("#!/bin/sh\nexit 1\n")
        ended = call(checkout, "--version", ARMSIGHT_PYTHON="/no/python")
        assert ended.returncode == 1
        assert "is not Python 3.11 or later" in ended.stderr


def test_an_interrupted_set_up_is_done_again(checkout: Path):
    venv = made(checkout)
    (venv / "armsight-unfinished").touch()
    ended = call(checkout, "--version", ARMSIGHT_PYTHON="/no/python")
    assert "is not Python 3.11 or later" in ended.stderr


def test_too_old_a_python_is_told(checkout: Path, tmp_path: Path):
    tools = tmp_path / "bin"
    for name in ("sh", "dirname", "id", "uname", "cat", "cksum", "printf", "grep", "sort", "xargs"):
        found = shutil.which(name)
        if found:
            script(tools / name, f'exec {found} "$@"')
    for name in ("find", "rm", "mkdir", "env"):
        script(tools / name, f'exec {shutil.which(name)} "$@"')
    script(tools / "python3", 'case "$1" in --version) echo "Python 3.9.2";; *) exit 1;; esac')
    if Path("/usr/bin/python3").exists():
        text = (checkout / "run").read_text().replace("/usr/bin/python3", "/no/python3")
        (checkout / "run").write_text(text)
    ended = call(checkout, "demo", PATH=str(tools))
    assert ended.returncode == 1
    assert "armsight needs Python 3.11 or later, found: Python 3.9.2" in ended.stderr
    assert "apt-get install python3 python3-venv" in ended.stderr


def test_missing_venv_module_is_told(checkout: Path, tmp_path: Path):
    python = tmp_path / "python3.12"
    script(
        python,
        'case "$2" in *ensurepip*) exit 1;; *venv\\"*) echo python3.12-venv;; esac',
    )
    ended = call(checkout, "demo", ARMSIGHT_PYTHON=str(python))
    assert ended.returncode == 1
    assert "its venv module is missing" in ended.stderr
    assert "sudo apt-get install" in ended.stderr


def compiled(checkout: Path, name: str) -> Path:
    """A file as numba leaves one beside ``name.py``."""
    file = checkout / "src" / "armsight" / "__pycache__" / f"{name}.f-1.py311.1.nbc"
    file.parent.mkdir(exist_ok=True)
    file.touch()
    return file


def test_only_kernels_that_something_changed_for_are_forgotten(checkout: Path):
    """A kernel file, one that calls it, one that takes a constant, and one that does neither."""
    script(made(checkout) / "bin" / "python", f'exec "{sys.executable}" "$@"')
    package = checkout / "src" / "armsight"
    (package / "caller.py").write_text("from armsight.kernels import f\n@njit\ndef g(): f()\n")
    (package / "reader.py").write_text("from armsight.plain import N\n@njit\ndef g(): N\n")
    (package / "plain.py").write_text("N = 1\n")
    (package / "other.py").write_text("@njit\ndef g(): pass\n")
    call(checkout, "--version")
    files = {name: compiled(checkout, name) for name in ("kernels", "caller", "reader", "other")}
    call(checkout, "--version")
    assert all(file.exists() for file in files.values())
    (package / "kernels.py").write_text("@njit\ndef f(): return 1\n")
    call(checkout, "--version")
    assert [name for name, file in files.items() if file.exists()] == ["reader", "other"]
    (package / "plain.py").write_text("N = 2\n")
    call(checkout, "--version")
    assert [name for name, file in files.items() if file.exists()] == ["other"]


def test_without_python_all_kernels_are_forgotten(checkout: Path):
    script(made(checkout) / "bin" / "python", "exit 1")
    kept = compiled(checkout, "kernels")
    call(checkout, "--version")
    assert not kept.exists()


def test_arguments_of_test_go_to_pytest(checkout: Path):
    made(checkout, "dev")
    ended = call(checkout, "test", "tests/a b.py", "-k", "x")
    assert ended.stdout.split("\n")[:-1] == ["<-m>", "<pytest>", "<tests/a b.py>", "<-k>", "<x>"]


def test_locks_name_no_registry():
    for lock in (ROOT / "locks").glob("*.txt"):
        text = lock.read_text()
        assert "://" not in text
        assert "--hash=sha256:" in text


def test_locks_hold_what_the_project_needs():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    run = (ROOT / "locks" / "run.txt").read_text()
    dev = (ROOT / "locks" / "dev.txt").read_text()
    for wanted in project["project"]["dependencies"] + project["dependency-groups"]["build"]:
        name = wanted.split("<")[0].split(">")[0].split("=")[0].split("[")[0]
        assert f"\n{name.lower()}==" in f"\n{run}", name
    groups = project["dependency-groups"]
    for wanted in groups["dev"] + groups["docs"]:
        assert f"\n{wanted.lower()}==" in f"\n{dev}", wanted
    pinned = {line.split(" \\")[0] for line in run.splitlines() if "==" in line}
    assert pinned <= {line.split(" \\")[0] for line in dev.splitlines() if "==" in line}
