"""Rows, intervals, tables, publishing, resuming."""

import json
import math

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import binomtest

from armsight.errors import ArmsightError, UsageError
from armsight.experiments import NAMES, load_experiment
from armsight.experiments.cache import RunCache
from armsight.experiments.code_digest import digest_of
from armsight.experiments.frame import (
    Experiment,
    Outcome,
    print_result,
    publish,
    run_experiment,
    write_atomically,
    write_json,
)
from armsight.experiments.rows import Row, bootstrap, poisson_bounds, wilson
from armsight.machine import commit, machine

ROW_KEYS = [
    "key",
    "measure",
    "condition",
    "value",
    "unit",
    "n",
    "low",
    "high",
    "paper",
    "must",
    "aim",
    "met",
]


def experiment(rows, plots=None):
    return Experiment("toy-test", "A toy", lambda runs, seed, progress: Outcome(rows, plots or {}))


def test_json_has_exactly_the_agreed_keys_in_order():
    result = run_experiment(experiment((Row("a", "about a", "", 1.5, "s", must=2.0),)), 3, 7)
    document = result.to_json()
    assert list(document) == ["name", "command", "commit", "machine", "seed", "rows"]
    assert document["name"] == "toy-test"
    assert document["command"] == "armsight experiment toy-test --runs 3 --seed 7"
    assert document["seed"] == 7
    assert list(document["rows"][0]) == ROW_KEYS
    json.loads(json.dumps(document, allow_nan=False))


@pytest.mark.parametrize(
    ("value", "better", "strict", "met"),
    [
        (0.9, "lower", False, True),
        (1.0, "lower", False, True),
        (1.0, "lower", True, False),
        (1.1, "lower", False, False),
        (1.1, "higher", False, True),
        (1.0, "higher", True, False),
        (0.9, "higher", False, False),
        (math.nan, "lower", False, False),
        (math.nan, "higher", False, False),
    ],
)
def test_met(value, better, strict, met):
    row = Row("k", "", "", value, must=1.0, better=better, strict=strict)
    assert row.met is met
    assert row.to_json()["met"] is met


def test_without_a_must_nothing_is_met_or_missed():
    assert Row("k", "", "", 1.0).met is None


def test_numbers_are_numbers():
    row = Row("k", "", "", 3.0, low=math.inf, high=math.nan, paper=np.float64(0.5)).to_json()
    assert row["value"] == 3
    assert isinstance(row["value"], int)
    assert row["low"] is None
    assert row["high"] is None
    assert row["paper"] == 0.5


def test_a_missing_figure_is_words_in_every_table(tmp_path):
    rows = (
        Row("a", "", "", math.nan, "min", must=1.0, why="not reached: the accuracy"),
        Row("b", "", "", math.nan, low=math.nan, high=math.nan),
    )
    result = run_experiment(experiment(rows), 1, 0)
    publish(result, tmp_path)
    page = (tmp_path / "toy-test.md").read_text()
    assert "| not reached: the accuracy |  | 1 |" in page
    assert "| no figure |  | 1 |" in page
    console = Console(record=True, width=200)
    print_result(result, console)
    for text in (page, console.export_text()):
        assert "nan" not in text.lower()


@pytest.mark.parametrize(("k", "n"), [(0, 10), (1, 10), (5, 10), (10, 10), (3, 1000), (0, 1)])
def test_wilson_against_scipy(k, n):
    expected = binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson(k, n) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_of_nothing_is_everything():
    assert wilson(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="5 of 3"):
        wilson(5, 3)


def test_poisson_rule_of_three():
    low, high = poisson_bounds(0)
    assert low == 0.0
    assert high == pytest.approx(-math.log(0.025))
    low, high = poisson_bounds(10)
    assert (low, high) == pytest.approx((4.795, 18.390), abs=1e-3)  # Garwood's table


def test_bootstrap_covers_the_mean():
    rng = np.random.default_rng(0)
    samples = rng.normal(3.0, 1.0, 400)
    low, high = bootstrap(list(samples), rng)
    assert low < samples.mean() < high
    assert high - low == pytest.approx(2 * 1.96 / 20, rel=0.2)
    assert all(map(math.isnan, bootstrap([1.0], rng)))


def test_two_rows_of_one_key_are_a_mistake():
    with pytest.raises(ValueError, match="share a key"):
        run_experiment(experiment((Row("a", "", "", 1.0), Row("a", "", "", 2.0))))


def test_table_stands_beside_the_paper():
    result = run_experiment(
        experiment((Row("ratio", "", "moving", 1.2, paper=1.66, must=1.5, aim=1.2),))
    )
    console = Console(record=True, width=140, file=open("/dev/null", "w"))  # noqa: SIM115
    print_result(result, console)
    text = console.export_text()
    for words in ("ratio", "moving", "1.2", "1.66", "≤ 1.5", "met"):
        assert words in text


def test_a_file_or_a_pipe_gets_whole_figures():
    condition = "second renderer, 640 x 480, base at 1.2 to 2.5 m, box not given"
    row = Row("type_accuracy", "", condition, 0.745, n=110, must=0.85, better="higher")
    console = Console(record=True, width=80, file=open("/dev/null", "w"))  # noqa: SIM115
    print_result(run_experiment(experiment((row,))), console)
    (line,) = [s for s in console.export_text().splitlines() if "type_accuracy" in s]
    for words in (condition, "0.745", "≥ 0.85", "missed"):
        assert words in line


def test_publish_writes_table_plot_and_json(tmp_path):
    from matplotlib.figure import Figure

    def draw():
        figure = Figure()
        figure.subplots().plot([1, 2], [3, 4])
        return figure

    rows = (Row("a", "about a", "x|y", 1.0, must=0.5), Row("a", "about a", "z", 2.0))
    files = publish(run_experiment(experiment(rows, {"line": draw})), tmp_path / "results")
    assert [f.name for f in files] == ["toy-test.json", "toy-test-line.png", "toy-test.md"]
    assert all(f.stat().st_size > 100 for f in files)
    page = files[-1].read_text()
    assert "![toy-test-line](toy-test-line.png)" in page
    assert "x\\|y" in page
    assert "**missed**" in page
    assert page.count("* `a`: about a") == 1
    assert not list((tmp_path / "results").glob(".*"))


def test_nothing_half_written(tmp_path):
    file = tmp_path / "deep" / "x.json"
    write_atomically(file, b"one")
    assert file.read_bytes() == b"one"
    (tmp_path / "plain").write_text("a file")
    with pytest.raises(ArmsightError, match="cannot be written"):
        write_json(run_experiment(experiment(())), tmp_path / "plain" / "x.json")


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "x.json"
    write_atomically(file, b"old")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ArmsightError, match="No space left on device"):
        write_atomically(file, b"new")
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


def test_finished_runs_are_kept(tmp_path):
    calls = []

    def compute(run):
        calls.append(run)
        return {"value": run * 1.5, "nan": math.nan}

    cache = RunCache("toy", 1, {"speed": 0.5}, tmp_path)
    for run in range(3):
        cache.get(run, lambda run=run: compute(run))
    again = RunCache("toy", 1, {"speed": 0.5}, tmp_path)
    assert len(again) == 3
    assert again.get(2, lambda: compute(2))["value"] == 3.0
    assert calls == [0, 1, 2]
    assert len(RunCache("toy", 2, {"speed": 0.5}, tmp_path)) == 0
    assert len(RunCache("toy", 1, {"speed": 0.6}, tmp_path)) == 0


def test_runs_of_other_code_do_not_count(tmp_path, monkeypatch):
    RunCache("toy", 1, None, tmp_path).get(0, lambda: "old")
    assert RunCache("toy", 1, None, tmp_path).get(0, lambda: "new") == "old"
    monkeypatch.setattr("armsight.experiments.cache.code_digest", lambda: "of other files")
    assert RunCache("toy", 1, None, tmp_path).get(0, lambda: "new") == "new"


def test_the_digest_of_code_sees_every_change_but_bytecode(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "a.py").write_text("1")
    (tmp_path / "room" / "b.toml").write_text("2")
    seen = [digest_of(tmp_path)]
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "a.pyc").write_text("anything")
    assert digest_of(tmp_path) == seen[0]
    (tmp_path / "room" / "b.toml").write_text("3")
    seen.append(digest_of(tmp_path))
    (tmp_path / "room" / "b.toml").rename(tmp_path / "b.toml")
    seen.append(digest_of(tmp_path))
    (tmp_path / "a.py").rename(tmp_path / "a")
    seen.append(digest_of(tmp_path))
    (tmp_path / "c").write_text("")
    seen.append(digest_of(tmp_path))
    assert len(set(seen)) == len(seen)


def test_a_line_cut_short_costs_one_run(tmp_path):
    cache = RunCache("toy", 0, None, tmp_path)
    for run in range(3):
        cache.get(run, lambda run=run: run)
    file = tmp_path / "toy.jsonl"
    file.write_bytes(file.read_bytes()[:-12])
    again = RunCache("toy", 0, None, tmp_path)
    assert len(again) == 2
    again.get(2, lambda: 2)
    assert len(RunCache("toy", 0, None, tmp_path)) == 3


def test_unknown_experiment_names_the_nearest():
    with pytest.raises(UsageError, match='did you mean "patrol-smoke"'):
        load_experiment("patrol-smok")


def test_every_named_experiment_loads():
    for name in NAMES:
        loaded = load_experiment(name)
        assert loaded.name == name
        assert loaded.runs >= 1


def test_machine_names_no_host():
    import socket

    assert "cores" in machine()
    assert socket.gethostname() not in machine()
    assert commit()


@pytest.mark.parametrize("value", [np.float64(2.0), np.int64(2), 2])
def test_a_row_of_numpys_numbers_is_missed_and_written_like_any_other(value):
    row = Row("key", "what", "condition", value, must=1.0, aim=3)
    assert row.met is False, "is, as whoever counts the missed ones asks"
    assert row.aimed is True
    assert json.loads(json.dumps(row.to_json()))["met"] is False
