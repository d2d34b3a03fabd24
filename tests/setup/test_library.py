"""armsight as a library: lazy names with types, and a wheel that stands alone."""

import ast
import os
import subprocess
import sys
import venv
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

import armsight

ROOT = Path(__file__).resolve().parents[2]


def test_every_name_is_what_its_room_calls_it():
    for name in set(armsight.__all__) - {"__version__"}:
        home = import_module(f"armsight.{armsight._HOME[name]}")
        assert getattr(armsight, name) is getattr(home, name)
    with pytest.raises(AttributeError, match="no attribute 'Robots'"):
        _ = armsight.Robots


def test_types_and_lazy_names_say_the_same():
    """What a type checker sees is what is there at run time: the same names from the same homes."""
    typed = {}
    for node in ast.walk(ast.parse((ROOT / "src/armsight/__init__.py").read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("armsight."):
            typed |= {alias.name: node.module.removeprefix("armsight.") for alias in node.names}
    assert typed == armsight._HOME
    assert sorted([*typed, "__version__"]) == sorted(armsight.__all__) == dir(armsight)


def test_names_are_documented():
    for name in set(armsight.__all__) - {"__version__"}:
        assert (getattr(armsight, name).__doc__ or "").strip(), f"{name} has no docstring"


def test_nothing_is_loaded_before_it_is_used():
    code = "import sys, armsight; print({'numpy', 'numba', 'mujoco', 'cv2'} & set(sys.modules))"
    assert run(sys.executable, "-c", code).strip() == "set()"
    code = code.replace("armsight;", "armsight.cli;")
    assert run(sys.executable, "-c", code).strip() == "set()"


def run(*command: str | Path, cwd: Path | None = None) -> str:
    here = {
        k: v for k, v in os.environ.items() if k != "PYTHONPATH" or command[0] == sys.executable
    }
    ended = subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, check=False, cwd=cwd, env=here
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built without a network from a copy of what git would send."""
    pytest.importorskip("hatchling", reason="needs hatchling, which ./run test installs")
    place = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", place, cwd=ROOT)
    (file,) = place.glob("armsight-*.whl")
    return file


def test_the_wheel_holds_everything(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    source = ROOT / "src"
    wanted = {
        str(f.relative_to(source))
        for f in (source / "armsight").rglob("*")
        if f.is_file() and "__pycache__" not in f.parts and not f.name.startswith(".")
    }
    wanted |= {f"armsight/cells/{f.name}" for f in (ROOT / "workcells").glob("*.toml")}
    assert wanted <= names, sorted(wanted - names)[:10]
    assert "armsight/py.typed" in names


def test_the_wheel_runs_in_an_environment_of_its_own(wheel, tmp_path):
    """Installed by pip without a network; its dependencies are those of this environment."""
    place = tmp_path / "env"
    venv.create(place, system_site_packages=False, with_pip=False)
    (site,) = place.glob("lib/python*/site-packages")
    pip = ("-m", "pip", "--python", place / "bin" / "python", "install", "-q", "--no-compile")
    run(sys.executable, *pip, "--no-index", "--no-deps", wheel)
    # Behind the wheel's own folder, so that its armsight is found before an editable one.
    third_party = Path(import_module("numpy").__file__).parents[1]
    (site / "third_party.pth").write_text(f"{third_party}\n")
    python = place / "bin" / "python"
    where = run(python, "-I", "-c", "import armsight; print(armsight.__file__)").strip()
    assert Path(where).is_relative_to(place)
    told = run(place / "bin" / "armsight", "check", "ur5_four_cameras", cwd=tmp_path)
    assert "ur5_four_cameras" in told
    code = "import armsight; print(armsight.load_robot('ur5').n, len(armsight.packaged()))"
    count = len([f for f in (ROOT / "workcells").glob("*.toml") if f.stem != "blank"])
    assert run(python, "-I", "-c", code, cwd=tmp_path).split() == ["6", str(count)]
