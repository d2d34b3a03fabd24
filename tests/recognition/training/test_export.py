"""ONNX files against torch; weights against damage."""

from pathlib import Path

import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.recognition.inference.model import Model
from armsight.recognition.networks.architecture import JOINTS, Architecture
from armsight.recognition.training.tensors_file import read_tensors, write_tensors

from ..torch_or_skip import torch

if torch:
    from armsight.recognition.networks.build import build_network
    from armsight.recognition.training.export import (
        PARITY,
        answers,
        check_parity,
        rounded,
        to_onnx,
    )
    from armsight.recognition.training.weights import load_weights, save_weights

CARD = {"camera": {"K": [[48.0, 0, 31.5], [0, 48.0, 26], [0, 0, 1]]}, "paper": "T5"}
NETWORKS = [
    Architecture("cascaded", ("ur5",), 64, 53, 0.5, 0.1, 2),
    Architecture("cascaded", ("panda",), 48, 40, 0.25, 0.1, 3),
    Architecture("multi-objective", ("ur3", "ur5", "ur10"), 64, 53, 0.5, 0.1, 2),
    Architecture("multi-objective", tuple(JOINTS), 48, 40, 0.25, 0.1, 3),
]


def images(a: Architecture, count: int = 4) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.integers(0, 256, (count, a.height, a.width, 3), dtype=np.uint8)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("a", NETWORKS)
def test_parity(tmp_path: Path, a: Architecture, half: bool) -> None:
    network, file = build_network(a), tmp_path / "network.onnx"
    file.write_bytes(to_onnx(network, CARD, half))
    parity = check_parity(network, file, images(a), half)
    assert max(parity.metres, parity.probability) <= PARITY
    # And through the reader that armsight recognise uses.
    model = Model(file)
    assert model.architecture == a
    wanted = answers(rounded(network) if half else network, images(a, 1))
    found = model.run(images(a, 1)[0])
    np.testing.assert_allclose(found.joints, wanted["joints"][0], atol=PARITY)
    np.testing.assert_allclose(found.mask, wanted["mask"][0], atol=PARITY)


def test_half_precision_halves_the_file() -> None:
    network = build_network(Architecture("multi-objective", ("ur3", "ur5"), 96, 80, 0.5, 0.5, 2))
    assert len(to_onnx(network, CARD, True)) < 0.55 * len(to_onnx(network, CARD))


def test_a_file_of_other_weights_is_refused(tmp_path: Path) -> None:
    a = NETWORKS[2]
    (tmp_path / "a.onnx").write_bytes(to_onnx(build_network(a, 1), CARD))
    with pytest.raises(RecognitionError, match="must not be used"):
        check_parity(build_network(a, 2), tmp_path / "a.onnx", images(a))


def test_weights_come_back(tmp_path: Path) -> None:
    network = build_network(NETWORKS[2], 3)
    save_weights(tmp_path / "a", network, CARD)
    again, card = load_weights(tmp_path / "a")
    assert card == CARD
    assert again.architecture == network.architecture
    assert all(torch.equal(v, again.state_dict()[k]) for k, v in network.state_dict().items())


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda t, w: t.pop("common.conv.bias"), "missing"),
        (lambda t, w: t.update(more=np.zeros(3, np.float32)), "no layer"),
        (lambda t, w: t.update({"common.conv.bias": np.zeros(3, np.float32)}), "another network"),
        (lambda t, w: t["common.conv.bias"].fill(np.nan), "not finite"),
        (lambda t, w: w.update(format="other"), "no weights"),
        (lambda t, w: w.update(architecture="{}"), "field"),
        (lambda t, w: w.update(architecture="{"), "card"),
        (lambda t, w: w.update(card="[]"), "card"),
        (lambda t, w: w.pop("card"), "card"),
    ],
)
def test_damaged_weights(tmp_path: Path, damage: object, says: str) -> None:
    save_weights(tmp_path / "a", build_network(NETWORKS[2]), CARD)
    tensors, words = read_tensors(tmp_path / "a")
    damage(tensors, words)  # type: ignore[operator]
    write_tensors(tmp_path / "a", tensors, words)
    with pytest.raises(RecognitionError, match=says):
        load_weights(tmp_path / "a")
