"""The command lines: on this machine, and on one that has torch and numpy only."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armsight.cli import run
from armsight.recognition.training import entry
from armsight.recognition.training.packed_set import COLUMNS, FORMAT, PackedSet
from armsight.recognition.training.tensors_file import write_tensors

from ..synthetic import synthetic_set

CONFIG = """
paper = "T5"
network = "multi-objective"
robots = ["ur3", "ur5"]
[size]
width = 32
height = 26
filters = 0.2
dense = 0.02
[[stage]]
name = "all"
batch = 8
updates = 5
loss = { mask = 1.0, joints = 1.5, base = 1.5, type = 0.3 }
"""


def write_packed(folder: Path, data: PackedSet) -> None:
    arrays = {
        k: getattr(data, {"image": "images", "mask": "packed_masks"}.get(k, k)) for k in COLUMNS
    }
    words = {"format": FORMAT, "count": str(len(data)), "robots": '["ur3", "ur5"]', **data.source}
    write_tensors(folder / "pack-00000.safetensors", arrays, words)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "config.toml").write_text(CONFIG)
    write_packed(tmp_path / "data", synthetic_set(40, 32, 26))
    return tmp_path


BARE = """
import builtins, sys
real = builtins.__import__
def only(name, *rest):
    if name.split(".")[0] in {"cv2", "scipy", "tyro", "rich", "mujoco", "numba", "matplotlib",
                              "PIL", "yaml", "onnxruntime", "safetensors", "pydantic", "tomlkit"}:
        raise ImportError(name + " is not on a bare machine")
    return real(name, *rest)
builtins.__import__ = only
import importlib.util
find = importlib.util.find_spec
importlib.util.find_spec = lambda name, *r: None if name == "onnxruntime" else find(name, *r)
from armsight.recognition.training.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def test_a_bare_machine_trains(place: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed")
    words = [str(place / "config.toml"), "--data", str(place / "data"), "--out", str(place / "out")]
    done = subprocess.run(
        [sys.executable, "-c", BARE, *words, "--device", "cpu"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "no onnxruntime here" in done.stderr
    written = {p.name for p in (place / "out").iterdir()}
    assert written == {
        "checkpoint.safetensors", "curve.json", "weights.safetensors", "CARD.md", "network.onnx"
    }  # fmt: skip


def test_train_and_transfer_by_the_command_line(place: Path) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed")
    base = ["--data", str(place / "data"), "--device", "cpu"]
    out = ["--out", str(place / "t5")]
    assert run(["train", "--config", str(place / "config.toml"), *base, *out]) == 0
    assert (place / "t5" / "curve.png").stat().st_size > 0
    wide = CONFIG.replace('name = "all"', 'name = "dense"\ntrains = ["dense", "mask-last"]')
    (place / "t6.toml").write_text(wide)
    words = ["transfer", "--one-stage", "--config", str(place / "t6.toml"), *base]
    words += ["--from", str(place / "t5" / "weights.safetensors"), "--out", str(place / "t6")]
    assert run(words) == 0
    assert (place / "t6" / "network.onnx").is_file()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["train", "--config", "t55", "--data", "x"], "no configuration"),
        (["train", "--config", "t5", "--data", "x", "--seed", "-1"], "--seed"),
        (["train", "--config", "t5", "--data", "x", "--samples", "0"], "--samples"),
        (["train", "--config", "t5", "--data", "x", "--network", "cascaded"], "--network"),
        (["transfer", "--from", "a", "--data", "x", "--out", "y"], "one of"),
        (["transfer", "--from", "a", "--data", "x", "--out", "y", "--one-stage", "--two-stage"],
         "one of"),
        (["transfer", "--from", "a", "--data", "x", "--out", "y", "--one-stage", "--config", "t7"],
         "stages"),
    ],
)  # fmt: skip
def test_what_cannot_be(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words) in (1, 2)
    error = capsys.readouterr().err
    assert says in error
    assert len(error.strip().splitlines()) == 1


def test_without_torch_the_way_to_it_is_told(
    monkeypatch: pytest.MonkeyPatch, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda *a: None)
    words = ["train", "--config", str(place / "config.toml"), "--data", str(place / "data")]
    assert run(words) == 1
    assert "pip install torch" in capsys.readouterr().err


def test_data_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="PyTorch is not installed")
    words = ["train", "--config", "t5", "--data", str(tmp_path), "--out", str(tmp_path / "o")]
    assert run(words) == 1
    assert "labelled set" in capsys.readouterr().err


def test_seed_and_samples_override_the_file(place: Path) -> None:
    config = entry.read(str(place / "config.toml"), 5, 7)
    assert (config.seed, config.limit) == (5, 7)


def test_packed_data_is_found(place: Path) -> None:
    config = entry.read(str(place / "config.toml"), None, None)
    found = entry.packed(place / "data", config)
    assert np.array_equal(found.images, synthetic_set(40, 32, 26).images)


@pytest.mark.parametrize(
    "words",
    [("--seed", "-1"), ("--minutes", "nan"), ("--minutes", "-5"), ("--threads", "-2"),
     ("--threads", "100000")],
)  # fmt: skip
@pytest.mark.parametrize(
    "command", [["train", "--config", "ours"], ["transfer", "--one-stage", "--from", "a"]]
)
def test_numbers_that_no_training_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str], words: tuple[str, str]
) -> None:
    place = ("--data", str(tmp_path / "crops"), "--out", str(tmp_path / "out"))
    assert run([*command, *place, *words]) == 2
    assert capsys.readouterr().err.startswith(words[0])
    assert not (tmp_path / "out").exists()
