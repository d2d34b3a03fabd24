"""The crop network's training, small: what it starts from, what it is taught, how it goes on."""

import multiprocessing
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.landmarks import SLOTS
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.data import LabelledSet
from armsight.recognition.data.sample import KNOWN_ROBOTS
from armsight.recognition.inference.model import network_file

from ..torch_or_skip import torch

if torch:
    from armsight.recognition.any_arm.learning import adopting, shipping
    from armsight.recognition.any_arm.learning.adopting import Origin, adopt, find_origin
    from armsight.recognition.any_arm.learning.changes import Changes, make_batch
    from armsight.recognition.any_arm.learning.examples import (
        UNSEEN,
        Examples,
        held_back,
    )
    from armsight.recognition.any_arm.learning.export import answers, check_parity, to_onnx
    from armsight.recognition.any_arm.learning.feeding import feed
    from armsight.recognition.any_arm.learning.network import CropNet, Shape, build
    from armsight.recognition.any_arm.learning.plan import Plan, read_plan
    from armsight.recognition.any_arm.learning.shipping import make_card
    from armsight.recognition.any_arm.learning.trainer import CropTrainer
    from armsight.recognition.any_arm.learning.trunk import Trunk, load_pretrained
    from armsight.recognition.any_arm.learning.trusting import Judged, logistic
    from armsight.recognition.training.checkpoint import Progress

NAMES = ("ur5", "iiwa", "none", "unknown")


def _crops(count: int = 24) -> Examples:
    """Bright bars on noise: the bar is an arm of two links, its ends are landmarks."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 90, (count, 64, 64, 3), dtype=np.uint8)
    links = np.zeros((count, 64, 64), np.uint8)
    points = np.full((count, SLOTS, 2), np.nan, np.float32)
    robot = np.arange(count) % 3
    for k in range(count):
        if robot[k] == 2:
            continue
        ends = np.array([[rng.uniform(8, 24), rng.uniform(8, 56)], [rng.uniform(40, 56), 32]])
        a, b = (tuple(int(v) for v in np.round(e)) for e in ends)
        half = tuple(int(v) for v in np.round(ends.mean(axis=0)))
        tint = [(255, 120, 0), (0, 160, 255)][robot[k]]
        cv2.line(images[k], a, b, tint, 5)
        cv2.line(links[k], a, half, 1, 5)
        cv2.line(links[k], half, b, 2, 5)
        points[k, :2] = ends
    coordinates = np.full((count, 32, 32, 3), UNSEEN, np.int8)
    return Examples(NAMES, images, links, coordinates, points, robot, np.arange(count))


def _plan(**words: object) -> Plan:
    kept = {"robots": ("ur5", "iiwa"), "size": 64, "batch": 4, "updates": 8, "validate": 4}
    return Plan(**{**kept, **words})  # type: ignore[arg-type]


def _started(network: CropNet) -> None:
    """Any trunk will do here, as long as it is the same one."""
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in network.trunk.parameters():
            if weight.dim() == 4:
                size = float(weight[0].numel())
                weight.copy_(torch.randn(weight.shape, generator=generator) * (2.0 / size) ** 0.5)


def _trainer(folder: Path, plan: Plan | None = None) -> CropTrainer:
    torch.set_num_threads(1)
    return CropTrainer(plan or _plan(), _crops(), folder, torch.device("cpu"), _started)


def test_batch_normalisation_is_folded_into_the_weights(tmp_path: Path) -> None:
    from torch import nn

    torch.manual_seed(0)
    trunk = Trunk()
    raw = {}
    norms = []
    layers = [("_conv_stem", "_bn0", trunk.stem.conv)]
    for k, block in enumerate(trunk.blocks):
        if block.expand is not None:
            layers.append((f"_blocks.{k}._expand_conv", f"_blocks.{k}._bn0", block.expand.conv))
        layers.append((f"_blocks.{k}._depthwise_conv", f"_blocks.{k}._bn1", block.depthwise.conv))
        layers.append((f"_blocks.{k}._project_conv", f"_blocks.{k}._bn2", block.project.conv))
    for conv, norm, layer in layers:
        n = layer.out_channels
        bn = nn.BatchNorm2d(n, eps=1e-3).eval()
        bn.weight.data.uniform_(0.5, 1.5)
        bn.bias.data.normal_()
        bn.running_mean.normal_()
        bn.running_var.uniform_(0.5, 2.0)
        raw[f"{conv}.weight"] = torch.randn(layer.weight.shape)
        raw |= {f"{norm}.{k}": v for k, v in bn.state_dict().items()}
        norms.append(bn)
    file = tmp_path / "weights.pth"
    torch.save(raw, file)
    load_pretrained(trunk, file)
    stem = layers[0][2]
    x = torch.rand(1, 3, 33, 33)
    plain = torch.nn.functional.conv2d(x, raw["_conv_stem.weight"], stride=2)
    folded = torch.nn.functional.conv2d(x, stem.weight, stem.bias, stride=2)
    torch.testing.assert_close(norms[0](plain), folded, rtol=1e-4, atol=1e-4)
    last = layers[-1][2]
    y = torch.rand(1, last.in_channels, 2, 2)
    plain = torch.nn.functional.conv2d(y, raw["_blocks.15._project_conv.weight"])
    torch.testing.assert_close(norms[-1](plain), last(y), rtol=1e-3, atol=1e-3)


def test_foreign_weights_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "weights.pth"
    torch.save({"something": torch.zeros(3)}, file)
    with pytest.raises(RecognitionError, match="EfficientNet-Lite0"):
        load_pretrained(Trunk(), file)
    file.write_bytes(b"cos\nsystem\n(S'true'\ntR.")  # a hostile pickle
    with pytest.raises(RecognitionError, match="EfficientNet-Lite0"):
        load_pretrained(Trunk(), file)


def test_other_processes_make_the_batches_that_would_have_been_made_here() -> None:
    data, plan = _crops(), _plan(updates=6)
    alone = list(feed(data, data.part(validation=False), plan, 2, workers=0, pinned=False))
    ahead = list(feed(data, data.part(validation=False), plan, 2, workers=2, pinned=False))
    assert len(alone) == len(ahead) == 4
    for one, other in zip(alone, ahead, strict=True):
        for a, b in zip(one, other, strict=True):
            torch.testing.assert_close(a, b, rtol=0, atol=0, equal_nan=True)


def test_a_process_that_is_killed_is_said_in_words(tmp_path: Path) -> None:
    def kill(progress: Progress) -> None:
        for child in multiprocessing.active_children():
            child.kill()

    plan = _plan(updates=400, validate=400)
    trainer = CropTrainer(plan, _crops(), tmp_path, torch.device("cpu"), _started, workers=1)
    with pytest.raises(RecognitionError, match="was killed"):
        trainer.run(told=kill)
    assert trainer.progress.update < 400


def test_a_cell_holds_the_share_of_each_link() -> None:
    data = _crops(3)
    batch = make_batch(data, np.arange(3), None, 0, Changes(size=64, zoom=(1.0, 1.0)))
    for k in range(3):
        ids = cv2.warpAffine(data.links[k], _moved(data.links[k]), (64, 64), flags=0)
        for link in range(10):
            cells = (ids == link).reshape(16, 4, 16, 4).mean((1, 3))
            np.testing.assert_allclose(batch.links[k, link], cells, atol=1e-6)


def _moved(links: np.ndarray) -> np.ndarray:
    """What puts an unchanged crop's arm into the middle."""
    row, column = np.nonzero(links)
    A = np.eye(2, 3)
    if len(row):
        ends = [(v.min() + v.max()) / 2 for v in (column, row)]
        A[:, 2] = [31.5 - e for e in ends]
    return A


def test_landmarks_move_with_the_picture() -> None:
    data = _crops(6)
    # A bright dot on each first landmark, so that the picture itself tells where it went.
    data.images[:] = 0
    for k in range(2):
        x, y = data.points[k, 0]
        cv2.circle(data.images[k], (round(float(x)), round(float(y))), 2, (255, 255, 255), -1)
    how = Changes(size=64, noise=0, cover=0, jpeg=0, blur=0, grey=0, gain=0, tint=0)
    for number in range(12):
        batch = make_batch(data, np.array([number % 2]), np.array([number]), 3, how)
        grey = batch.images[0].astype(float).mean(axis=2)
        at = batch.points[0, 0] * 4 + 1.5
        if not (6 < at[0] < 57 and 6 < at[1] < 57):
            continue
        x, y = (int(v) for v in np.round(at))
        window = grey[y - 3 : y + 4, x - 3 : x + 4]
        assert window.max() > 120, (number, at)


def test_an_arm_made_much_smaller_does_not_alias_and_stays_in_its_place() -> None:
    """Crops are rendered larger than they are learned: small arms in them are shrunk by area."""
    side = 256
    data = _crops(1)
    column = np.arange(side)
    stripes = np.where((column // 2 % 2)[None, :, None] == 0, 40, 200).astype(np.uint8)
    images = np.broadcast_to(stripes, (1, side, side, 3)).copy()
    links = np.zeros((1, side, side), np.uint8)
    links[0, 100:130, 20:236], images[0, 100:130, 20:236] = 1, 255
    whole = Examples(
        data.names, images, links, np.full((1, side // 2, side // 2, 3), UNSEEN, np.int8),
        np.full((1, SLOTS, 2), np.nan, np.float32), data.robot[:1], data.scene[:1],
    )  # fmt: skip
    how = Changes(
        size=96, wide=1.0, least=0.3, extent=(0.31, 1.0), turn_deg=0.0, noise=0, cover=0, jpeg=0,
        blur=0, grey=0, gain=0, tint=0, shaded=0, surrounded=0, elsewhere=0,
    )  # fmt: skip
    batch = make_batch(whole, np.array([0]), np.array([2]), 3, how)
    image = batch.images[0, ..., 0].astype(float)
    # Exposure bends the curve a little: compared by halves.
    cells = image.reshape(24, 4, 24, 4)
    arm = batch.links[0, 0] < 0.01
    assert arm.any()
    assert cells.mean((1, 3))[arm].min() > 200
    inside = (batch.links[0, 0] > 0.99) & (np.abs(cells.mean((1, 3)) - 127) > 1)  # not the grey
    assert cells.std((1, 3))[inside].mean() < 25  # stripes of 40 and 200 are not seen any more


def test_a_longer_plan_goes_on_and_what_is_finished_stays(tmp_path: Path) -> None:
    whole = _trainer(tmp_path / "whole")
    (tmp_path / "parts").mkdir()
    (tmp_path / "whole").mkdir()
    assert whole.run()
    part = _trainer(tmp_path / "parts", _plan(updates=3))
    part.run()
    part = _trainer(tmp_path / "parts")
    assert part.progress.update == 3
    assert part.run()
    # The rate falls by the number of updates: the same plan from the same point is the same.
    assert part.progress.update == whole.progress.update == 8
    again = _trainer(tmp_path / "whole")
    for a, b in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(a, b)


def test_stopping_changes_nothing(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    one = _trainer(tmp_path / "one")
    one.run()
    two = _trainer(tmp_path / "two")
    two.run(minutes=-1.0)  # stopped before the first update
    for _ in range(4):
        two = _trainer(tmp_path / "two")
        batches_before = two.progress.update
        steps = two._step
        count = 0

        def step(batch: object, steps=steps) -> None:
            nonlocal count
            count += 1
            steps(batch)
            if count == 2:
                raise KeyboardInterrupt

        two._step = step  # type: ignore[method-assign]
        try:
            two.run()
        except KeyboardInterrupt:
            two._save()
        assert two.progress.update == batches_before + 2
    for a, b in zip(one.mean.parameters(), two.mean.parameters(), strict=True):
        assert torch.equal(a, b)


def test_a_loss_that_is_no_number_is_told_and_leaves_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "armsight.recognition.any_arm.learning.trainer.total",
        lambda terms: sum(terms.values()) * float("nan"),
    )
    with pytest.raises(RecognitionError, match="the loss is nan at update 1"):
        _trainer(tmp_path).run()
    assert not list(tmp_path.iterdir())


def test_too_few_crops_are_told(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="1 crops are too few"):
        CropTrainer(_plan(), _crops(1), tmp_path, torch.device("cpu"), _started)


def test_another_plan_is_not_gone_on_with(tmp_path: Path) -> None:
    _trainer(tmp_path, _plan(updates=1)).run()
    with pytest.raises(RecognitionError, match="another"):
        _trainer(tmp_path, _plan(rate=0.01))


def test_the_finer_head_begins_at_nothing_and_moves_its_own_cells() -> None:
    """Weights from before it answer as they did; then it says something of each cell of 4 px."""
    network = build(Shape(("ur5", "iiwa")), 3)
    _started(network)
    image = torch.randint(0, 256, (1, 64, 64, 3), generator=torch.Generator().manual_seed(2))
    image = image.to(torch.uint8)
    robot = torch.tensor([1])
    with torch.no_grad():
        before = network(image)
        network.from4.weight.zero_()
        assert torch.equal(network(image).links, before.links)
        network.fine_surface.bias.fill_(0.5)
        network.fine_heat["iiwa"].bias.fill_(0.25)
        after = network(image)
    torch.testing.assert_close(after.coordinates, before.coordinates + 0.5)
    torch.testing.assert_close(after.heat[:, 1], before.heat[:, 1] + 0.25)
    torch.testing.assert_close(after.heat[:, 0], before.heat[:, 0])
    torch.testing.assert_close(network(image, robot).heat[:, 0], after.heat[:, 1])


def test_what_a_link_looks_like_begins_at_nothing_and_tells_the_type_alone() -> None:
    network = build(Shape(("ur5", "iiwa")), 3)
    _started(network)
    image = torch.randint(0, 256, (1, 64, 64, 3), generator=torch.Generator().manual_seed(2))
    image = image.to(torch.uint8)
    with torch.no_grad():
        network.surface.weight.mul_(20.0)  # so that it sees other links in other places
        before = network(image)
        network.hidden.bias.fill_(1.0)
        plain = network(image).type
        network.of_links.weight.normal_(std=0.3)
        after = network(image)
    assert not torch.allclose(after.type, plain)
    for name in ("links", "coordinates", "spread", "heat"):
        assert torch.equal(getattr(after, name), getattr(before, name)), name


def test_a_network_from_before_the_links_spoke_is_begun_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed (part of the extra train)")
    older = {k: v for k, v in adopting._constants(network_file("arms")).items() if "of_" not in k}
    monkeypatch.setattr(adopting, "_constants", lambda file: older)
    network = build(Shape(KNOWN_ROBOTS), 5)
    with torch.no_grad():
        network.of_links.weight.fill_(1.0)
    adopt(network, find_origin(network_file("arms")))
    assert not network.of_links.weight.any()
    torch.testing.assert_close(network.hidden.weight.detach(), older["hidden.weight"])


def test_the_exported_network_answers_alike(tmp_path: Path) -> None:
    network = build(Shape(("ur5", "iiwa")), 3)
    _started(network)
    with torch.no_grad():
        for name, weight in network.named_parameters():
            if name.startswith(("fine_", "of_links")):  # they begin at nothing
                weight.normal_(std=0.1)
    file = tmp_path / "network.onnx"
    file.write_bytes(to_onnx(network, {}))
    images = np.random.default_rng(0).integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    assert check_parity(network, file, images) < 1e-3


def _shipped() -> CropNet:
    """The network that comes with armsight, taken out of its ONNX file."""
    pytest.importorskip("onnx", reason="onnx is not installed (part of the extra train)")
    network = build(Shape(KNOWN_ROBOTS), 5)
    adopt(network, find_origin(network_file("arms")))
    return network


def test_a_network_taken_out_of_its_file_answers_as_the_file_does() -> None:
    image = np.random.default_rng(1).integers(0, 256, (1, 96, 64, 3), dtype=np.uint8)
    assert check_parity(_shipped(), network_file("arms"), image) < 1e-3


def test_a_training_begins_from_a_finished_network_and_only_it_goes_on(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed (part of the extra train)")
    (tmp_path / "first").mkdir()
    finished = _trainer(tmp_path / "first")
    finished.run()
    first = finished.mean
    file = tmp_path / "network.onnx"
    file.write_bytes(to_onnx(first, make_card(finished)))
    origin = find_origin(file)
    crops = len(finished.learned)
    assert (origin.updates, origin.crops) == (8, crops)

    def trainer(begun: Origin | None) -> CropTrainer:
        return CropTrainer(
            _plan(updates=2), _crops(), tmp_path, torch.device("cpu"),
            lambda network: adopt(network, origin), origin=begun,
        )  # fmt: skip

    begun = trainer(origin)
    image = _crops(1).images[0]
    for name, value in answers(first, image).items():
        np.testing.assert_allclose(answers(begun.network, image)[name], value, atol=1e-4)
    assert begun.run()
    assert make_card(begun)["training"]["begun_from"] == {
        "sha256": origin.sha256, "updates": 8, "crops": crops
    }  # fmt: skip
    assert trainer(origin).progress.update == 2
    with pytest.raises(RecognitionError, match="another"):
        trainer(None)


def test_what_is_written_lies_between_what_was_learned_and_what_it_began_from(
    tmp_path: Path,
) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed (part of the extra train)")
    first = _trainer(tmp_path)
    first.run()
    file = tmp_path / "first.onnx"
    file.write_bytes(to_onnx(first.mean, make_card(first)))
    origin = find_origin(file)
    folder = tmp_path / "second"
    folder.mkdir()
    trainer = CropTrainer(
        _plan(updates=3, blend=0.25), _crops(), folder, torch.device("cpu"),
        lambda network: adopt(network, origin), origin=origin,
    )  # fmt: skip
    trainer.run()
    learned = folder / "learned.onnx"
    learned.write_bytes(to_onnx(trainer.mean, make_card(trainer)))
    written = adopting._constants(shipping.ship(trainer, folder, None))
    old, new = adopting._constants(file), adopting._constants(learned)
    moved = [k for k in new if not torch.equal(old[k], new[k])]
    assert len(moved) > 50
    for name, weight in written.items():
        torch.testing.assert_close(weight, 0.75 * old[name] + 0.25 * new[name])
    assert "25% what it learned" in (folder / "CARD.md").read_text(encoding="utf-8")
    assert CropModel(folder / "network.onnx", 1).card["validation"]["update"] == 3


def test_a_network_of_other_robots_is_not_begun_from(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="onnx is not installed (part of the extra train)")
    with pytest.raises(RecognitionError, match=r"heat\.fr3\.weight.* is missing"):
        adopt(build(Shape(("ur5", "fr3")), 0), find_origin(network_file("arms")))


def test_trust_is_chosen_on_pictures_of_another_renderer_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)

    def judged(count: int, off: float = 1.0) -> Judged:
        features = np.hstack([np.ones((count, 1)), rng.normal(size=(count, 6))])
        error = np.where(features[:, 1] > 0.5, 0.02, 0.5)
        return Judged(features, error, off**2 * rng.chisquare(3, (count, 4)))

    def elsewhere(model: CropModel, pictures: LabelledSet) -> Judged:
        return judged(len(pictures), off=4.0)

    monkeypatch.setattr(shipping, "judge", lambda *_: judged(2000))
    monkeypatch.setattr(shipping, "judge_pictures", elsewhere)
    pictures = cast(LabelledSet, range(500))
    file = shipping.ship(_trainer(tmp_path), tmp_path, cast(LabelledSet, ()), pictures)
    trust = CropModel(file, 1).card["trust"]
    assert (trust["chosen_on"]["frames"], trust["chosen_on"]["elsewhere"]) == (2500, 500)
    assert trust["widen"] == pytest.approx(4.0, rel=0.1), "the few that are harder tell the width"
    assert "500 answers on tuning pictures" in (tmp_path / "CARD.md").read_text(encoding="utf-8")


def test_rooms_stay_in_their_part_when_a_set_grows() -> None:
    robot, scene = np.repeat([0, 1, 2], 4000), np.tile(np.arange(4000), 3)
    held = held_back(robot, scene)
    assert 0.06 < held.mean() < 0.10
    np.testing.assert_array_equal(held_back(robot[:100], scene[:100]), held[:100])


def test_the_logistic_finds_weights_that_made_the_truth() -> None:
    rng = np.random.default_rng(1)
    x = np.hstack([np.ones((4000, 1)), rng.normal(size=(4000, 2))])
    true = np.array([0.5, 2.0, -1.0])
    y = rng.random(4000) < 1 / (1 + np.exp(-x @ true))
    np.testing.assert_allclose(logistic(x, y), true, atol=0.2)


@pytest.mark.parametrize(
    "text",
    ['network = "crop"\nsize = 100', 'network = "crop"\nbatch = 0', 'network = "crop"\nfoo = 1',
     'network = "crop"\nrobots = ["a", "a"]', 'network = "crop"\nrate = "fast"', "size = ["],
)  # fmt: skip
def test_a_wrong_plan_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(text)
    with pytest.raises(RecognitionError, match="plan"):
        read_plan(file)
