"""The mutation tester itself: its mutants are what they say, and are what the tests import."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from armsight.errors import UsageError
from armsight.experiments import mutants as experiment
from armsight.experiments.covered import Covered, read, together
from armsight.experiments.mutation import VARIABLE, mutant, sites

SOURCE = '''
def law(d: float, v: float = 1.0) -> float:
    """No - mistake + here."""
    if d < 0.5 and not v >= 2.0:
        return max(d - v, -d)
    raise ValueError("no" + "where")
'''


def test_every_mutant_is_one_change_that_does_something_else():
    all_of_them = [mutant(SOURCE, site) for site in sites(SOURCE)]
    said = {m.what for m in all_of_them}
    assert said == {
        "d < 0.5 and (not v >= 2.0) -> d < 0.5 or not v >= 2.0",
        "d < 0.5 -> d >= 0.5",
        "not v >= 2.0 -> v >= 2.0",
        "v >= 2.0 -> v < 2.0",
        "max(d - v, -d) -> min(d - v, -d)",
        "d - v -> d + v",
        "d - v -> d",
        "-d -> d",
    }
    assert [m.line for m in all_of_them] == [4, 4, 4, 4, 5, 5, 5, 5]

    def plays(source):
        space: dict = {}
        exec(compile(ast.parse(source), "law", "exec"), space)
        out = []
        for d, v in ((0.1, 1.0), (0.4, 3.0), (0.7, 3.0), (0.7, 0.1), (-0.2, -0.9)):
            try:
                out.append(space["law"](d, v))
            except ValueError:
                out.append(None)
        return out

    assert all(plays(m.source) != plays(SOURCE) for m in all_of_them)
    assert len({m.source for m in all_of_them}) == len(all_of_them)


SPEAKING = '''
def who(d: float) -> str:
    """Words whatever is found."""
    near = d - 0.1 < 0.5
    return f"something is {'near' if near else 'far'}" if d > 0 else "touches"

def seen(d: float) -> str:
    if d < 0.2:
        return "who?"
    return f"{d + 1} m"

def fault(d: float) -> str:
    if d < 0.3:
        return "too near"
    return ""

def state(d: float, box: list) -> str:
    box[0] = d - 0.4
    return "set"

def law(d: float) -> float:
    away, side = d - 0.5, d - 0.6
    late = d - 0.7
    room = late
    kept = d - 0.8
    said = d - 0.9
    if kept < 0.0:
        said = said - 1.1
        raise ValueError(f"{away + side} m, {room} s, {said}, {kept}")
    both, none = d - 1.2, d - 1.3
    print(f"{none}")
    return both
'''


def test_what_only_words_can_show_is_no_mistake():
    """A function that says something whatever it finds; names that only make words."""
    said = {mutant(SPEAKING, site).what.partition(" -> ")[0] for site in sites(SPEAKING)}
    one_of_two = {"d > 0"}  # an expression that chooses between texts is looked at as any other
    decides = {"d < 0.3", "d - 0.4", "d - 0.8", "kept < 0.0", "d - 1.2", "d - 1.3"}
    assert said == decides | one_of_two


def test_the_tests_import_the_mutant_and_nothing_in_the_tree_changes(tmp_path: Path):
    changed = tmp_path / "separation.py"
    changed.write_text("def protective():\n    return 'a mutant'\n", "utf-8")
    looks = tmp_path / "test_looks.py"
    looks.write_text(
        "from armsight.motion import separation\n"
        "def test_it(): assert separation.protective() == 'a mutant'\n",
        "utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "armsight.experiments.mutation", str(looks)],
        env={**os.environ, VARIABLE: f"armsight.motion.separation={changed}"},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_what_each_test_runs_is_known_line_by_line(tmp_path: Path):
    (tmp_path / "law.py").write_text(
        "A = 1\n\ndef low(d):\n    if d < A:\n        return 0\n"
        "    return (\n        d - A\n    )\n",
        "utf-8",
    )
    (tmp_path / "test_law.py").write_text(
        "import pytest, law\n"
        "@pytest.fixture(scope='module')\ndef two(): return law.low(3)\n"
        "def test_near(): assert law.low(0) == 0\n"
        "def test_far(two): assert law.low(3) == two\n"
        "def test_nothing(): pass\n",
        "utf-8",
    )
    told = tmp_path / "covered.json"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "armsight.experiments.covered", "test_law.py"],
        env={**os.environ, "ARMSIGHT_COVERED": f"{told}=law", "PYTHONPATH": _path(tmp_path)},
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr

    covered = read(told)
    near, far, nothing = (f"test_law.py::test_{n}" for n in ("near", "far", "nothing"))
    assert set(covered.tests("law", 1, 1)) == {near, far, nothing}  # runs on import
    assert set(covered.tests("law", 5, 5)) == {near}
    # The fixture is the module's: whoever asks for it first, all tests of the file hang on it.
    assert set(covered.tests("law", 7, 7)) == {near, far, nothing}
    assert covered.tests("law", 9, 20) == []


def test_the_lines_of_several_runs_are_put_together():
    one = Covered({"": {("law", 1)}, "a": {("law", 2)}}, {"a": 1.0})
    two = Covered({"": {("law", 3)}, "b": {("law", 2), ("law", 4)}}, {"b": 0.5})
    both = together([one, two])
    assert both.tests("law", 2, 2) == ["b", "a"]
    assert both.tests("law", 3, 3) == ["b", "a"], "it runs while modules are imported"
    assert both.tests("law", 4, 4) == ["b"]


def _path(folder: Path) -> str:
    return os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])


def test_parts_name_modules_and_tests_that_there_are(monkeypatch: pytest.MonkeyPatch):
    for modules in experiment.PARTS.values():
        assert all(experiment._source(module).is_file() for module in modules)
    for module, names in experiment.COMPILED.items():
        room = experiment._tests() / module.partition(".")[0]
        assert all((room / name).is_file() for name in names)
    first = [experiment.drawn("separation", 1, k)[1].what for k in range(3)]
    assert first == [experiment.drawn("separation", 1, k)[1].what for k in range(3)]
    monkeypatch.setattr(experiment, "__file__", "/nowhere/a/b/c/mutants.py")
    with pytest.raises(UsageError, match="in a checkout"):
        experiment._tests()
