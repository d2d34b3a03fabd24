"""``armsight run``: tasks by name and by module, their options, and every way to ask wrongly."""

import json

import pytest

from armsight.cli import run
from armsight.commands.run import run_with
from armsight.errors import TaskError
from armsight.tasks import catalogue
from armsight.tasks.catalogue import load_options, make_task, one_task

MODULE = '''
from dataclasses import dataclass
import numpy as np
from armsight.motion.face import Face, Figure
from armsight.motion.intents import VelocityIntent
from armsight.motion.task import Subscriptions

@dataclass
class Wave:
    """Turn the wrist."""
    rate: float = 0.2
    fail_at: float = 1e9
    name, period, subscriptions = "wave", 0.02, Subscriptions()

    def update(self, o):
        if o.now > self.fail_at:
            raise ValueError("tired")
        v = np.zeros(o.robot.n)
        v[-1] = self.rate
        return VelocityIntent("wave", v, "joint", o.now, o.now + 0.1)

    def face(self):
        return Face("waving", "", (Figure("rate", self.rate, "rad/s"),))

@dataclass
class Own:
    seconds: float = 1.0
    name, period, subscriptions = "own", 0.02, Subscriptions()
    def update(self, o): ...

class Plain:
    name, period, subscriptions = "plain", 0.02, Subscriptions()
    def update(self, o): ...

@dataclass
class Mute:
    name = "mute"

@dataclass
class NoPeriod:
    name = "x"
    def update(self, o): ...

@dataclass
class Picky:
    def make(self, cell):
        raise KeyError("no goals")
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "waving_task.py").write_text(MODULE)
    (tmp_path / "broken_task.py").write_text("1 / 0")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_task_of_ones_own_runs_with_its_options(folder, gl, capsys):
    words = "run ur3_bench --task waving_task:Wave --rate 0.1 --seconds 2 --headless --json w.json"
    assert run(words.split()) == 0, capsys.readouterr().err
    told = json.loads((folder / "w.json").read_text())
    assert told["task"] == "wave"
    assert told["state"] == "waving"
    assert told["figures"] == {"rate": 0.1}
    assert told["guard"] == "velocity"
    assert told["failure"] == ""


def test_a_task_that_fails_ends_a_headless_run_with_its_reason(folder, gl, capsys):
    words = (
        "run ur3_bench --task waving_task:Wave --fail-at 0.5 --seconds 60 --headless --json w.json"
    )
    assert run(words.split()) == 1
    assert "task wave failed: ValueError: tired" in capsys.readouterr().err
    assert json.loads((folder / "w.json").read_text())["seconds"] < 2.0


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("patorl", 'unknown task "patorl"; did you mean patrol?'),
        ("no_such_module:X", "task no_such_module:X cannot be loaded: ModuleNotFoundError"),
        ("waving_task:Nothing", "cannot be loaded: AttributeError"),
        ("broken_task:X", "cannot be loaded: ZeroDivisionError"),
        ("waving_task:Plain", "is no dataclass; its fields would be the options"),
        ("waving_task:Mute", "Mute has neither update(observation), as a task, nor make(cell)"),
    ],
)
def test_tasks_that_are_not_there_or_none_are_refused_in_a_line(folder, capsys, task, message):
    assert run(["run", "ur3_bench", "--task", task]) == 1
    said = capsys.readouterr().err
    assert message in said
    assert len(said.strip().splitlines()) == 1


def test_two_tasks_are_refused(capsys):
    words = ["run", "ur3_bench", "--task", "patrol", "--task=waving_task:Wave"]
    assert run(words) == 1
    assert "2 tasks given (patrol, waving_task:Wave); a cell runs one" in capsys.readouterr().err
    with pytest.raises(TaskError, match="no task given; there are: charge, patrol, servo"):
        one_task([])


def test_an_option_that_armsight_has_already_is_refused(folder):
    with pytest.raises(TaskError, match="its option seconds is one of armsight run"):
        run_with(["--task", "waving_task:Own"])


def test_what_cannot_begin_says_so(folder):
    with pytest.raises(TaskError, match="cannot begin: KeyError: 'no goals'"):
        make_task("picky", load_options("waving_task:Picky")(), cell=None)
    with pytest.raises(TaskError, match="NoPeriod has no period, subscriptions"):
        make_task("x", load_options("waving_task:NoPeriod")(), cell=None)


class Entry:
    def __init__(self, name, value):
        self.name, self.value = name, value

    def load(self):
        return catalogue.imported(self.value, self.name)


def test_entry_points_are_found_and_two_of_one_name_refused(folder, monkeypatch):
    entries = [Entry("wave", "waving_task:Wave")]
    monkeypatch.setattr(catalogue, "entry_points", lambda group: entries)
    assert load_options("wave").__name__ == "Wave"
    assert catalogue.task_names() == (*sorted(catalogue.OURS), "wave")
    entries.append(Entry("wave", "other:Wave"))
    with pytest.raises(TaskError, match=r"2 packages offer it .*other:Wave, waving_task:Wave"):
        load_options("wave")
    entries[:] = [Entry("bad", "broken_task:X")]
    with pytest.raises(TaskError, match=r"task bad \(broken_task:X\) cannot be loaded"):
        load_options("bad")
