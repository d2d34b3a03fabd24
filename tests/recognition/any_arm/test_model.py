"""The crop network's file: what is not as it should be is refused in words, before it is run."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armsight.errors import RecognitionError
from armsight.recognition.any_arm.landmarks import SLOTS, find_landmarks
from armsight.recognition.any_arm.model import FORMAT, CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.training.onnx_file import FLOAT, OnnxGraph
from armsight.robots.catalogue import load_robot


def bright_network(
    card: dict[str, Any], words: dict[str, str] | None = None, kind: np.ndarray | None = None
) -> bytes:
    """A graph of the shapes of a crop network's, whose arm is where the picture is bright."""
    graph = OnnxGraph("bright")
    image = graph.input("image", np.uint8, (1, "height", "width", 3))
    x = graph.node("Transpose", graph.node("Cast", image, to=FLOAT), perm=(0, 3, 1, 2))
    x = graph.node("AveragePool", x, kernel_shape=(4, 4), strides=(4, 4))

    def made(name: str, outputs: int, first: float = 0.0) -> str:
        weight = np.zeros((outputs, 3, 1, 1), np.float32)
        weight[0] = first
        bias = np.zeros(outputs, np.float32)
        if name == "links":
            bias[0], bias[1] = 8.0, 2.0
        constants = graph.constant(weight), graph.constant(bias)
        return graph.node("Conv", x, *constants, kernel_shape=(1, 1))

    cells = ("rows", "columns")
    for name, count, first in (("links", 10, -0.02), ("coordinates", 3, 0.0), ("spread", 1, 0.0)):
        graph.output(made(name, count, first), name, (1, count, *cells))
    pooled = graph.node("AveragePool", x, kernel_shape=(2, 2), strides=(2, 2))
    graph.output(pooled, "features", (1, 3, "eighths", "of_columns"))
    graph.output(graph.node("ReduceMean", x, axes=(2, 3), keepdims=0), "hidden", (1, 3))
    graph.output(made("heat", SLOTS), "heat_ur5", (1, SLOTS, *cells))
    graph.output(graph.constant(np.zeros((1, SLOTS), np.float32)), "outside_ur5", (1, SLOTS))
    kind = np.array([[3.0, 0.0, 0.0]], np.float32) if kind is None else kind
    graph.output(graph.constant(kind), "type", kind.shape)
    return graph.encode({"format": FORMAT, "card": json.dumps(card)} if words is None else words)


def bright_card() -> dict[str, Any]:
    return {"landmarks": {"ur5": find_landmarks(load_robot("ur5")).to_json()}}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "crops.onnx"
    path.write_bytes(bright_network(bright_card()))
    return path


def test_a_look_has_the_sizes_of_the_picture(file: Path) -> None:
    look = CropModel(file, 1).look(np.zeros((96, 160, 3), np.uint8))
    assert look.surface.links.shape == (10, 24, 40)
    assert look.surface.coordinates.shape == (24, 40, 3)
    np.testing.assert_allclose(look.surface.links.sum(axis=0), 1.0, rtol=1e-5)
    assert sum(look.types.values()) == pytest.approx(1.0)
    assert list(look.types) == ["ur5", "none", "unknown"]
    assert len(look.places["ur5"].mean) == 15


@pytest.mark.usefixtures("without_landmarks")
def test_nothing_bright_is_no_arm_and_two_bright_things_are_two(file: Path) -> None:
    recogniser = ArmRecogniser(CropModel(file, 1))
    dark = np.zeros((480, 640, 3), np.uint8)
    nothing = recogniser.recognise(Picture("dark", dark))
    assert nothing.arms == ()
    assert "no robot arm found" in nothing.notes
    dark[100:260, 60:160] = 255
    dark[200:400, 420:560] = 255
    found = recogniser.recognise(Picture("two", dark))
    assert len(found.arms) == 2
    assert found.intrinsics == "assumed"
    for arm in found.arms:
        assert not arm.believed
        assert arm.problem
        seen = arm.mask > 0.5
        assert (seen & (dark[..., 0] > 0)).sum() > 0.8 * seen.sum()
    json.loads(found.as_line())


@pytest.mark.parametrize(
    "damage",
    ["landmarks", "link", "trust", "infinite", "huge", "flat", "heavy", "long", "long trust"],
)
def test_a_damaged_card_is_refused(tmp_path: Path, damage: str) -> None:
    card = bright_card()
    if damage == "landmarks":
        del card["landmarks"]
    elif damage == "link":
        card["landmarks"]["ur5"]["link"][3] = 99
    elif damage == "huge":  # finite, but nothing that is worked out from it
        card["landmarks"]["ur5"]["point"][0][0] = 1e300
    elif damage == "flat":
        card["landmarks"]["ur5"]["half"][0] = [0.1, -0.1, 0.1]
    elif damage == "long":
        card["landmarks"]["ur5"]["point"][0][0] = 10**400
    elif damage == "long trust":
        card["trust"] = {"weights": [10**400] * 7, "threshold": 0.5, "widen": 1.0}
    elif damage == "heavy":
        card["trust"] = {"weights": [1e308] * 7, "threshold": 0.5, "widen": 1.0}
    elif damage == "infinite":
        card["landmarks"]["ur5"]["point"][0][0] = 1e999
    else:
        card["trust"] = {"weights": [1.0], "threshold": 0.5, "widen": 1.0}
    path = tmp_path / "bad.onnx"
    path.write_bytes(bright_network(card))
    with pytest.raises(RecognitionError, match="damaged"):
        ArmRecogniser(CropModel(path, 1))


def test_another_network_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.onnx"
    path.write_bytes(bright_network(bright_card(), {"format": "something", "card": "{}"}))
    with pytest.raises(RecognitionError, match="no crop network"):
        CropModel(path, 1)
