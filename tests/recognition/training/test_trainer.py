"""Training: it learns, it repeats itself, it goes on exactly, and it touches only what it may."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.recognition.networks.architecture import Architecture
from armsight.recognition.training.config import Stage, TrainingConfig
from armsight.recognition.training.packed_set import PackedSet
from armsight.recognition.training.schedule import SaturationRule

from ..synthetic import synthetic_set
from ..torch_or_skip import torch

if torch:
    from armsight.recognition.networks.build import build_network
    from armsight.recognition.training.export import answers
    from armsight.recognition.training.figures import score
    from armsight.recognition.training.run import Wanted, train, transfer
    from armsight.recognition.training.trainer import Trainer, start_at_mean
    from armsight.recognition.training.transfer import extend
    from armsight.recognition.training.weights import load_weights

T5 = {"mask": 1.0, "joints": 1.5, "base": 1.5, "type": 0.3}
TINY = Architecture("multi-objective", ("ur3", "ur5"), 32, 26, 0.2, 0.02)


def quiet(words: str) -> None:
    """Nobody listens."""


@pytest.fixture(scope="module")
def data() -> PackedSet:
    return synthetic_set(40, 32, 26, ("ur3", "ur5"))


def config(updates: int = 60, **stage: object) -> TrainingConfig:
    return TrainingConfig("T5", TINY, (Stage("all", T5, batch=8, updates=updates, **stage),))


def weights(folder: Path) -> "dict[str, torch.Tensor]":
    return load_weights(folder / "weights.safetensors")[0].state_dict()


def same(one: "dict[str, torch.Tensor]", other: "dict[str, torch.Tensor]") -> bool:
    return all(torch.equal(one[k], other[k]) for k in one)


@pytest.mark.parametrize("optimiser", ["adam", "nesterov"])
def test_a_stopped_training_goes_on_bit_for_bit(
    tmp_path: Path, data: PackedSet, optimiser: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rate = (1e-3, 1e-4) if optimiser == "adam" else (1e-2, 1e-3)
    rule = SaturationRule(11, 9, 0.01)
    plan = config(optimiser=optimiser, learning_rate=rate, saturation=rule, wide_inputs=50)
    assert train(plan, data, Wanted(tmp_path / "whole", device="cpu"), quiet)
    clock = iter(np.arange(0.0, 1e5, 1.0))
    # Each look at the clock takes a second: some 25 updates an episode.
    monkeypatch.setattr(
        "armsight.recognition.training.trainer.time.monotonic", lambda: float(next(clock))
    )
    pieces = 0
    while not train(plan, data, Wanted(tmp_path / "pieces", 0.45, "cpu"), quiet):
        pieces += 1
    assert pieces >= 2
    assert same(weights(tmp_path / "whole"), weights(tmp_path / "pieces"))
    one, other = (
        load_weights(tmp_path / k / "weights.safetensors")[1] for k in ("whole", "pieces")
    )
    assert one["validation"] == other["validation"]


def test_the_same_seed_gives_the_same_weights(tmp_path: Path, data: PackedSet) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        plan = replace(config(20), seed=seed)
        train(plan, data, Wanted(tmp_path / name, device="cpu"), quiet)
    assert same(weights(tmp_path / "a"), weights(tmp_path / "b"))
    assert not same(weights(tmp_path / "a"), weights(tmp_path / "c"))


def test_a_checkpoint_of_another_training_is_refused(tmp_path: Path, data: PackedSet) -> None:
    train(config(10), data, Wanted(tmp_path, device="cpu"), quiet)
    with pytest.raises(RecognitionError, match="another configuration"):
        train(config(11), data, Wanted(tmp_path, device="cpu"), quiet)
    file = tmp_path / "checkpoint.safetensors"
    file.write_bytes(file.read_bytes()[:-10])
    with pytest.raises(RecognitionError, match="truncated"):
        train(config(10), data, Wanted(tmp_path, device="cpu"), quiet)


def test_data_of_another_size_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="pack it at that size"):
        train(config(), synthetic_set(20), Wanted(tmp_path, device="cpu"), quiet)


def test_a_loss_that_explodes_is_told(tmp_path: Path, data: PackedSet) -> None:
    plan = config(200, optimiser="nesterov", learning_rate=(10.0, 10.0))
    with pytest.raises(RecognitionError, match="learning rate"):
        train(plan, data, Wanted(tmp_path, device="cpu"), quiet)


def test_saturation_ends_a_stage(tmp_path: Path, data: PackedSet) -> None:
    plan = config(1000, learning_rate=(1e-9, 1e-9), saturation=SaturationRule(5, 2, 0.5))
    train(plan, data, Wanted(tmp_path, device="cpu"), quiet)
    stage = load_weights(tmp_path / "weights.safetensors")[1]["training"]["stages"][0]
    assert stage["why"] == "saturated"
    assert stage["updates"] == 15


def test_a_stage_that_was_over_when_it_was_killed_is_over(
    tmp_path: Path, data: PackedSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed after the checkpoint of its last update, and before that of the next stage."""
    plan = config(1000, learning_rate=(1e-9, 1e-9), saturation=SaturationRule(5, 2, 0.5))
    save = Trainer._save

    def killed(self: Trainer, optimiser: "torch.optim.Optimizer | None") -> None:
        if optimiser is None:
            raise KeyboardInterrupt
        save(self, optimiser)

    with monkeypatch.context() as patch:
        patch.setattr("armsight.recognition.training.trainer.CHECKPOINT_SECONDS", -1.0)
        patch.setattr(Trainer, "_save", killed)
        with pytest.raises(KeyboardInterrupt):
            train(plan, data, Wanted(tmp_path, device="cpu"), quiet)
    train(plan, data, Wanted(tmp_path, device="cpu"), quiet)
    [stage] = load_weights(tmp_path / "weights.safetensors")[1]["training"]["stages"]
    assert (stage["why"], stage["updates"]) == ("saturated", 15)


def test_t4_trains_one_network_after_the_other(tmp_path: Path, data: PackedSet) -> None:
    a = Architecture("cascaded", ("ur5",), 32, 26, 0.2, 0.05)
    first = Stage("mask", {"mask": 1.0}, ("mask",), batch=8, updates=10)
    second = Stage("coordinates", {"joints": 6 / 7, "base": 1 / 7}, ("coordinates",), True, 8, 10)
    train(TrainingConfig("T4", a, (first,)), data, Wanted(tmp_path / "a", device="cpu"), quiet)
    train(
        TrainingConfig("T4", a, (first, second)), data, Wanted(tmp_path / "b", device="cpu"), quiet
    )
    start, one, two = (
        build_network(a).state_dict(),
        weights(tmp_path / "a"),
        weights(tmp_path / "b"),
    )
    for name in one:
        if name.startswith("mask"):
            assert not torch.equal(one[name], start[name])
            assert torch.equal(one[name], two[name])
        elif name != "output.full.bias":
            assert torch.equal(one[name], start[name])
            assert not torch.equal(one[name], two[name])


def test_outputs_begin_at_the_mean(tmp_path: Path, data: PackedSet) -> None:
    trainer = Trainer(config(), data, build_network(TINY), tmp_path)
    start_at_mean(trainer.network, data, trainer.chosen)
    base = trainer.network.outputs["base"].full.bias.detach().numpy()
    np.testing.assert_allclose(base, data.base[trainer.chosen].mean(axis=0), rtol=1e-5)


WIDE = Architecture("multi-objective", ("ur3", "ur5", "iiwa"), 32, 26, 0.2, 0.02)


def test_an_extended_network_begins_with_all_the_old_one_knows() -> None:
    old = build_network(TINY, 1).eval()
    new = extend(old, WIDE, 2).eval()
    images = torch.from_numpy(synthetic_set(4, 32, 26).images)
    one, other = old(images), new(images)
    assert torch.equal(one.mask, other.mask)
    assert torch.equal(one.base, other.base)
    torch.testing.assert_close(one.joints, other.joints[:, :6])
    torch.testing.assert_close(one.type, other.type[:, :2])


def test_types_keep_their_rows_wherever_they_go() -> None:
    old = build_network(TINY, 1).eval()
    moved = Architecture("multi-objective", ("iiwa", "ur5", "ur3"), 32, 26, 0.2, 0.02)
    images = torch.from_numpy(synthetic_set(4, 32, 26).images)
    torch.testing.assert_close(extend(old, moved).eval()(images).type[:, [2, 1]], old(images).type)


@pytest.mark.parametrize(
    ("change", "says"),
    [({"width": 64}, "width"), ({"robots": ("ur3", "iiwa")}, "ur5"), ({"dense": 0.1}, "dense")],
)
def test_a_transfer_changes_robots_only(change: dict[str, object], says: str) -> None:
    with pytest.raises(RecognitionError, match=says):
        extend(build_network(TINY), replace(WIDE, **change))


def test_t6_leaves_the_frozen_layers_bit_for_bit(tmp_path: Path, data: PackedSet) -> None:
    train(config(10), data, Wanted(tmp_path / "t5", device="cpu"), quiet)
    more = synthetic_set(30, 32, 26, ("iiwa",), seed=1)
    stage = Stage("dense", T5, ("dense", "mask-last"), batch=8, updates=10)
    plan = TrainingConfig("T6", WIDE, (stage,), samples=("iiwa",))
    source = tmp_path / "t5" / "weights.safetensors"
    transfer(plan, more, source, Wanted(tmp_path / "t6", device="cpu"), quiet)
    old, new = weights(tmp_path / "t5"), weights(tmp_path / "t6")
    frozen = ("common", "mask.0", "mask.1", "second")
    for name in old:
        if name.startswith(frozen):
            assert torch.equal(old[name], new[name]), name
        elif old[name].shape == new[name].shape:
            assert not torch.equal(old[name], new[name]), name
    assert load_weights(tmp_path / "t6" / "weights.safetensors")[1]["parent"]["paper"] == "T5"


def test_t7_unlocks_later_convolutions_in_its_second_stage(tmp_path: Path) -> None:
    data = synthetic_set(45, 32, 26, ("ur3", "ur5", "iiwa"))
    old = TrainingConfig("T5", TINY, (Stage("all", T5, batch=8, updates=5),))
    train(old, data, Wanted(tmp_path / "t5", device="cpu"), quiet)
    late = ("dense", "mask-last", "mask-middle", "second")
    plan = TrainingConfig(
        "T7",
        WIDE,
        (
            Stage("1", T5, ("dense", "mask-last"), batch=8, updates=5),
            Stage("2", T5, late, batch=8, updates=5),
        ),
    )
    source = tmp_path / "t5" / "weights.safetensors"
    transfer(plan, data, source, Wanted(tmp_path / "t7", device="cpu"), quiet)
    before, after = weights(tmp_path / "t5"), weights(tmp_path / "t7")
    assert torch.equal(before["common.conv.weight"], after["common.conv.weight"])
    assert torch.equal(before["mask.0.conv.weight"], after["mask.0.conv.weight"])
    for name in ("mask.1.conv.weight", "second.0.conv.weight"):
        assert not torch.equal(before[name], after[name])


def test_only_a_multi_objective_network_is_transferred(tmp_path: Path, data: PackedSet) -> None:
    a = Architecture("cascaded", ("ur5",), 32, 26, 0.2, 0.05)
    plan = TrainingConfig("T4", a, (Stage("mask", {"mask": 1.0}, ("mask",), batch=8, updates=1),))
    train(plan, data, Wanted(tmp_path, device="cpu"), quiet)
    with pytest.raises(RecognitionError, match="multi-objective"):
        transfer(config(), data, tmp_path / "weights.safetensors", Wanted(tmp_path / "b"), quiet)


def test_wide_layers_take_smaller_steps(tmp_path: Path, data: PackedSet) -> None:
    """Adam's first step is the learning rate in every weight; a wide layer's is its share."""
    trainer = Trainer(config(1, wide_inputs=20), data, build_network(TINY), tmp_path)
    before = {k: v.clone() for k, v in trainer.network.state_dict().items()}
    trainer.run()
    inputs = before["dense_second.full.weight"].shape[1]
    assert inputs > 100
    for name, share in (
        ("dense_second.full.weight", 20 / inputs),
        ("dense_second.full.bias", 1.0),
        ("common.conv.weight", 1.0),
    ):
        step = (trainer.network.state_dict()[name] - before[name]).abs().max().item()
        assert step == pytest.approx(1e-3 * share, rel=0.01)


@pytest.mark.slow
def test_a_small_network_learns_32_images_by_heart(tmp_path: Path) -> None:
    """A minute or so: mask, type, base and joints of its own training images."""
    data = synthetic_set(46, 64, 53)
    a = Architecture("multi-objective", ("ur3", "ur5"), 64, 53, 0.5, 0.25)
    rate = (1e-3, 1e-5)
    plan = TrainingConfig("T5", a, (Stage("all", T5, batch=16, updates=500, learning_rate=rate),))
    trainer = Trainer(plan, data, build_network(a), tmp_path)
    start_at_mean(trainer.network, data, trainer.chosen)
    assert trainer.run().finished
    learned = trainer.chosen[:32]
    found = score(lambda x, _: answers(trainer.network, x), a, data, learned).summary()
    assert found["joint_mean_mm"] < 20
    assert found["base_mean_mm"] < 20
    assert found["type_accuracy"] == 1.0
    assert found["mask_accuracy"] > 0.95
