"""Configuration files: the packaged ones are the papers', the broken ones are told."""

from pathlib import Path

import pytest

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.learning.plan import is_plan, read_plan
from armsight.recognition.training.config import PACKAGED, config_file, read_config

GOOD = """
network = "multi-objective"
robots = ["ur3", "ur5"]
[[stage]]
name = "all"
loss = { mask = 1, joints = 1.5 }
"""


def test_packaged_ones_are_read() -> None:
    names = {p.stem for p in PACKAGED.glob("*.toml")}
    assert {"t4", "t5", "t6", "t7"} <= names
    for file in map(config_file, names):
        read_plan(file) if is_plan(file) else read_config(file)


def test_the_papers_numbers() -> None:
    t4, t5, t6, t7 = (read_config(config_file(n)) for n in ("t4", "t5", "t6", "t7"))
    assert all((c.architecture.width, c.architecture.height) == (256, 212) for c in (t4, t5, t6))
    assert t4.stages[0].batch == 128
    assert t4.stages[0].learning_rate == (1e-3, 1e-6)
    assert t4.stages[1].learning_rate == (0.03, 1e-4)
    assert t4.stages[1].momentum == (0.9, 0.999)
    assert t4.stages[1].true_masks
    assert t5.stages[0].batch == 64
    for config in (t5, t6):
        assert config.stages[0].loss == {"mask": 1.0, "joints": 1.5, "base": 1.5, "type": 0.3}
        assert config.stages[0].learning_rate == (1e-3, 1e-6)
    assert t6.limit == 312
    assert t6.trained_robots == ("iiwa",)
    assert t6.stages[0].trains == ("dense", "mask-last")
    assert t7.limit == 500
    assert len(t7.architecture.robots) == 5
    for stage in t7.stages:
        assert stage.loss == {"mask": 1.2, "joints": 1.2, "base": 1.2, "type": 0.6}
    assert t7.stages[0].saturation.window > 0
    assert set(t7.stages[0].trains) < set(t7.stages[1].trains)


def test_a_good_file(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(GOOD)
    config = read_config(tmp_path / "a.toml")
    assert config.stages[0].loss == {"mask": 1, "joints": 1.5}
    assert config.split == "frame"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("network", "netwok"), "netwok"),
        (('"ur5"', '"ur7"'), "ur3"),
        (("mask = 1", "mask = -1"), "above 0"),
        (("mask = 1", "mask = nan"), "expected a number"),
        (("mask = 1", "masc = 1"), "masc"),
        (('name = "all"', ""), "name"),
        (('name = "all"', 'name = "all"\nupdates = 0'), "updates"),
        (('name = "all"', 'name = "all"\nbatch = true'), "batch"),
        (('name = "all"', 'name = "all"\nlearning_rate = [1]'), "learning_rate"),
        (('name = "all"', 'name = "all"\nfall = "steep"'), "fall"),
        (('name = "all"', 'name = "all"\nmomentum = [0.9, 1.0]'), "momentum"),
        (("[[stage]]", "[data]\nsplit = 'moon'\n[[stage]]"), "split"),
        (("[[stage]]", "[data]\nsamples = ['iiwa']\n[[stage]]"), "samples"),
        (("[[stage]]", "[size]\nwidth = 10000000\n[[stage]]"), "pixels"),
        (("[[stage]]", "[stage]"), "stage"),
        (("[[stage]]", "]["), "TOML"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    file = tmp_path / "a.toml"
    file.write_text(GOOD.replace(*change))
    with pytest.raises(RecognitionError, match=says) as caught:
        read_config(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="t5"):
        config_file("t55")
    with pytest.raises(RecognitionError, match="no configuration"):
        config_file("../configs/t5")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RecognitionError, match="TOML"):
        read_config(tmp_path / "b.toml")
