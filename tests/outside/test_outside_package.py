"""A stranger's package of a camera, an arm and a task runs in a cell, without a line changed here.

Its wheel and ours are built and installed into a clean environment, which borrows the packages that
both depend on from the present one: nothing is fetched.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from armsight.recording.mcap_file import McapReader

ROOT = Path(__file__).resolve().parents[2]
STRANGER = Path(__file__).resolve().parent / "stranger"
DEPTH = "/ceiling/depth/image_rect_raw/compressedDepth"


def call(*words, **options):
    ended = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, check=False, **options
    )
    assert ended.returncode == 0, ended.stderr[-3000:] + ended.stdout[-1000:]
    return ended.stdout


def wheel(project, folder):
    """Build a project's wheel without touching its tree."""
    source = folder / f"{project.name}-source"
    shutil.copytree(
        project,
        source,
        ignore=shutil.ignore_patterns(".git", ".venv", "tests", "docs", "__pycache__"),
    )
    call(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, cwd=source)


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Python of an environment with both wheels, and nothing of this tree."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("outside")
    wheels = folder / "wheels"
    wheels.mkdir()
    wheel(ROOT, wheels)
    wheel(STRANGER, wheels)
    call(sys.executable, "-m", "venv", "--without-pip", folder / "env")
    python = folder / "env" / "bin" / "python"
    files = sorted(wheels.glob("*.whl"))
    assert len(files) == 2
    pip = ("-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index")
    call(sys.executable, *pip, *files)
    installed = next((folder / "env").glob("lib/python*/site-packages"))
    (installed / "borrowed.pth").write_text(sysconfig.get_paths()["purelib"])
    take_kernels_along(installed / "armsight")
    return python


def take_kernels_along(package):
    """Compiled kernels of the tree hold for equal files of the same age: it saves minutes."""
    tree = ROOT / "src" / "armsight"
    for file in tree.rglob("*.py"):
        twin = package / file.relative_to(tree)
        stat = file.stat()
        os.utime(twin, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    for cached in tree.rglob("__pycache__/*.nb[ci]"):
        twin = package / cached.relative_to(tree)
        twin.parent.mkdir(exist_ok=True)
        shutil.copy2(cached, twin)


@pytest.mark.slow  # two wheels, an environment and a real session: half a minute
def test_a_strangers_devices_and_task_run_in_a_cell(environment, tmp_path):
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    clean["ARMSIGHT_RUNTIME_DIR"] = str(tmp_path)
    shutil.copy(STRANGER / "cell.toml", tmp_path)
    options = {"cwd": tmp_path, "env": clean, "timeout": 500}
    where = call(
        environment, "-c", "import armsight, stranger_lab; print(armsight.__file__)", **options
    )
    assert str(environment.parents[1]) in where
    assert "good cell.toml" in call(environment, "-m", "armsight", "check", "cell.toml", **options)
    doctor = ("-m", "armsight", "doctor", "--seconds", "0.5", "--option", "height=2.4", "--driver")
    assert "Lab ToF: 320x240" in call(environment, *doctor, "lab_camera", **options)
    words = "run cell.toml --task nod --beat 0.25 --seconds 3 --headless --json - --record run.mcap"
    told = json.loads(call(environment, "-m", "armsight", *words.split(), **options))
    assert told["failure"] == ""
    assert told["task"] == "nod"
    assert told["ended_by"] == "time"
    reader = McapReader(tmp_path / "run.mcap")
    counts = dict.fromkeys((DEPTH, "/joint_states", "/guard/status"), 0)
    for topic, _, _ in reader.messages(list(counts)):
        counts[topic] += 1
    reader.close()
    assert min(counts.values()) > 3, counts
