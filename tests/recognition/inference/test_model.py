"""Opening networks: good ones answer, all others are refused in one line."""

import json
from pathlib import Path

import numpy as np
import pytest

from armsight.commands.recognise import DEFAULT_NETWORK
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.inference.model import (
    Model,
    network_file,
    open_session,
    shipped_networks,
)
from armsight.recognition.training import onnx_file
from armsight.recognition.training.onnx_file import OnnxGraph

from .conftest import BASE, JOINTS, card, network

GOOD = {
    "format": "armsight-network-1",
    "card": json.dumps(card()),
}


def test_a_good_network_answers(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(network())
    model = Model(tmp_path / "a.onnx")
    image = np.zeros((53, 64, 3), np.uint8)
    image[10:20] = 255
    answer = model.run(image)
    assert np.array_equal(answer.mask >= 0.5, image[..., 0] > 0)
    np.testing.assert_allclose(answer.base, BASE)
    np.testing.assert_allclose(answer.joints, JOINTS, rtol=1e-6)
    assert answer.type.tolist() == pytest.approx([0.9, 0.1])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.95, 0.99])
def test_truncated(tmp_path: Path, share: float) -> None:
    data = network()
    file = tmp_path / "a.onnx"
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecognitionError) as caught:
        Model(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_changed_byte_never_crashes(tmp_path: Path) -> None:
    data = network()
    rng = np.random.default_rng(0)
    for _ in range(60):
        changed = bytearray(data)
        changed[rng.integers(len(data))] = rng.integers(256)
        (tmp_path / "a.onnx").write_bytes(bytes(changed))
        try:
            Model(tmp_path / "a.onnx").run(np.zeros((53, 64, 3), np.uint8))
        except RecognitionError:
            continue


def test_a_pickle_is_never_unpickled(tmp_path: Path) -> None:
    import pickle

    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (Path.touch, (tmp_path / "sprung",))  # type: ignore[return-value]

    (tmp_path / "a.onnx").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(RecognitionError, match="no ONNX file"):
        Model(tmp_path / "a.onnx")
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({}, "no network of armsight"),
        ({"format": "yolo"}, "no network of armsight"),
        (GOOD, "card is damaged"),
        ({**GOOD, "architecture": "{"}, "card is damaged"),
        ({**GOOD, "architecture": "[" * 100000}, "card is damaged"),
        ({**GOOD, "architecture": '{"kind": "x"}'}, "field"),
    ],
)
def test_foreign_networks(tmp_path: Path, words: dict[str, str], says: str) -> None:
    (tmp_path / "a.onnx").write_bytes(network(words))
    with pytest.raises(RecognitionError, match=says):
        Model(tmp_path / "a.onnx")


@pytest.mark.parametrize("K", [None, [[1]], [[1, 0, 0], [0, -1, 0], [0, 0, 1]], "x"])
def test_a_card_without_a_camera(tmp_path: Path, K: object) -> None:
    (tmp_path / "a.onnx").write_bytes(network(about={**card(), "camera": {"K": K}}))
    with pytest.raises(RecognitionError, match="camera"):
        Model(tmp_path / "a.onnx")


def test_a_graph_that_does_not_fit_its_card(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(network(size=(32, 26)))
    with pytest.raises(RecognitionError, match="its own card"):
        Model(tmp_path / "a.onnx")


def test_an_answer_that_is_no_number(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(network(base=[np.nan, 0.0, 1.0]))
    with pytest.raises(RecognitionError, match="no number"):
        Model(tmp_path / "a.onnx").run(np.zeros((53, 64, 3), np.uint8))


def test_numbers_in_other_files_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An ONNX file may name any file of the machine as the place of its numbers."""

    def external(self: OnnxGraph, array: np.ndarray, name: str = "") -> str:
        name = name or self._fresh("constant")
        field, number = onnx_file._field, onnx_file._number
        place = field(1, b"location") + field(2, b"/etc/passwd")
        dims = b"".join(number(1, n) for n in array.shape)
        kind = number(2, 1)
        self._constants.append(
            dims + kind + field(8, name.encode()) + field(13, place) + number(14, 1)
        )
        return name

    monkeypatch.setattr(OnnxGraph, "constant", external)
    (tmp_path / "a.onnx").write_bytes(network())
    with pytest.raises(RecognitionError, match="other files"):
        Model(tmp_path / "a.onnx")


def _within(*path: int, tensor: bytes) -> bytes:
    """A tensor in fields of fields."""
    for number in reversed(path):
        tensor = onnx_file._field(number, tensor)
    return tensor


GRAPH, NODE, ATTRIBUTE = 7, 1, 5
PLACES = {
    "Constant": (GRAPH, NODE, ATTRIBUTE, 5),
    "tensors of an attribute": (GRAPH, NODE, ATTRIBUTE, 10),
    "subgraph": (GRAPH, NODE, ATTRIBUTE, 6, 5),
    "Constant of a subgraph": (GRAPH, NODE, ATTRIBUTE, 6, NODE, ATTRIBUTE, 5),
    "one of several subgraphs": (GRAPH, NODE, ATTRIBUTE, 11, 5),
    "sparse values": (GRAPH, 15, 1),
    "sparse indices": (GRAPH, 15, 2),
    "sparse attribute": (GRAPH, NODE, ATTRIBUTE, 22, 1),
    "sparse attributes": (GRAPH, NODE, ATTRIBUTE, 23, 2),
    "training's initialisation": (20, 1, 5),
    "training's algorithm": (20, 2, NODE, ATTRIBUTE, 5),
    "function": (25, 7, ATTRIBUTE, 5),
    "function's default": (25, 11, 5),
}
"""Where onnx.proto3 has tensors, by its field numbers."""


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("says", ["place", "kind"])
def test_numbers_in_other_files_are_refused_wherever_they_hide(
    tmp_path: Path, place: str, says: str
) -> None:
    where = onnx_file._field(1, b"location") + onnx_file._field(2, b"/etc/passwd")
    tensor = onnx_file._field(13, where) if says == "place" else onnx_file._number(14, 1)
    (tmp_path / "a.onnx").write_bytes(network() + _within(*PLACES[place], tensor=tensor))
    with pytest.raises(RecognitionError, match="other files"):
        Model(tmp_path / "a.onnx")


def test_what_is_no_number_of_a_field_and_what_is_too_deep_is_refused(tmp_path: Path) -> None:
    """A tag beyond 32 bits is cut by other readers: they would see an initialiser."""
    long = bytes([0x80 | (7 << 3 | 2), 0x80, 0x80, 0x80, 0x10, 0])
    deep = _within(GRAPH, *(NODE, ATTRIBUTE, 6) * 5000, tensor=b"")
    for extra in (long, deep, b"\0\0"):
        (tmp_path / "a.onnx").write_bytes(network() + extra)
        with pytest.raises(RecognitionError, match="no ONNX file"):
            Model(tmp_path / "a.onnx")


def test_a_file_of_another_format_is_not_run(tmp_path: Path) -> None:
    """onnxruntime also reads a format of its own, which nobody has looked into."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.optimized_model_filepath = str(tmp_path / "a.ort")
    options.add_session_config_entry("session.save_model_format", "ORT")
    onnxruntime.InferenceSession(network(), options, providers=["CPUExecutionProvider"])
    data = (tmp_path / "a.ort").read_bytes()
    assert onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"]).get_inputs()
    with pytest.raises(RecognitionError, match="damaged"):
        open_session(tmp_path / "a.ort", data, 1)


def test_names(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="no network"):
        network_file("yolo")
    with pytest.raises(RecognitionError, match="there is no such network"):
        Model(network_file(str(tmp_path / "missing.onnx")))
    with pytest.raises(RecognitionError, match="no network"):
        network_file("../weights/a")


def test_the_default_network_is_shipped() -> None:
    assert DEFAULT_NETWORK in shipped_networks()


@pytest.mark.parametrize("name", shipped_networks())
def test_shipped_networks_open_and_carry_their_card(name: str) -> None:
    model = CropModel(network_file(name), 1)
    model.look(np.zeros((64, 96, 3), np.uint8))
    assert model.card["licence"] == "Apache-2.0"
    assert model.card["trunk"]["licence"] == "Apache-2.0"
    assert {"data", "training", "validation", "landmarks", "trust"} <= set(model.card)
    assert network_file(name).stat().st_size < 20e6
    assert network_file(name).with_suffix(".md").is_file()
