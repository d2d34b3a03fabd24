"""The mutation tester itself: its mutants are what they say, and are what the tests import."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from armsight.errors import UsageError
from armsight.experiments import mutants as experiment
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


def test_parts_name_modules_and_tests_that_there_are(monkeypatch: pytest.MonkeyPatch):
    for modules, tests in experiment.PARTS.values():
        assert all(experiment._source(module).is_file() for module in modules)
        assert all((experiment._tests() / test).is_file() for test in tests)
    first = [experiment.drawn("separation", 1, k)[1].what for k in range(3)]
    assert first == [experiment.drawn("separation", 1, k)[1].what for k in range(3)]
    monkeypatch.setattr(experiment, "__file__", "/nowhere/a/b/c/mutants.py")
    with pytest.raises(UsageError, match="in a checkout"):
        experiment._tests()
