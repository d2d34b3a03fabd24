"""``armsight recognise`` with our network, on what users and strangers hand to it."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from armsight.cli import run
from armsight.errors import RecognitionError
from armsight.recognition.any_arm.model import CropModel
from armsight.recognition.any_arm.recogniser import ArmRecogniser
from armsight.recognition.inference.pictures import Picture

from .test_model import bright_card, bright_network

Asked = Callable[..., tuple[int, list[dict], str]]  # type: ignore[type-arg]


def lamp(height: int = 120, width: int = 160) -> np.ndarray:
    """Something bright, which the network takes for an arm, off the middle."""
    image = np.full((height, width, 3), 30, np.uint8)
    image[height // 8 : height // 2, width // 8 : width // 3] = 240
    return image


@pytest.fixture
def network(tmp_path: Path) -> Path:
    file = tmp_path / "crops.onnx"
    file.write_bytes(bright_network(bright_card()))
    return file


@pytest.fixture
def asked(network: Path, capsys: pytest.CaptureFixture[str]) -> Asked:
    def ask(picture: Path, *words: str) -> tuple[int, list[dict], str]:  # type: ignore[type-arg]
        code = run(["recognise", str(picture), "--threads", "1", "--network", str(network), *words])
        captured = capsys.readouterr()
        return code, [json.loads(line) for line in captured.out.splitlines()], captured.err

    return ask


def test_a_picture_turned_by_its_camera_is_answered_as_the_upright_one(
    asked: Asked, tmp_path: Path
) -> None:
    Image.fromarray(lamp()).save(tmp_path / "upright.png")
    lying = Image.fromarray(np.ascontiguousarray(np.rot90(lamp())))
    exif = lying.getexif()
    exif[0x0112] = 6
    lying.save(tmp_path / "lying.png", exif=exif)
    (_, [a], _), (_, [b], _) = asked(tmp_path / "upright.png"), asked(tmp_path / "lying.png")
    assert a["arms"]
    assert {**a, "picture": ""} == {**b, "picture": ""}


@pytest.mark.parametrize("mode", ["L", "1", "P", "RGBA", "CMYK", "I;16"])
def test_any_kind_of_picture_has_an_answer(asked: Asked, tmp_path: Path, mode: str) -> None:
    file = tmp_path / "a.tiff"
    if mode == "I;16":
        Image.fromarray(lamp()[..., 0].astype(np.uint16) * 16).save(file)
    else:
        Image.fromarray(lamp()).convert(mode).save(file)
    code, [answer], _ = asked(file)
    assert code == 0
    assert len(answer["arms"]) == 1
    assert any("grey" in n for n in answer["notes"]) == (mode in ("L", "1", "I;16"))


@pytest.mark.parametrize("size", [(32, 32), (33, 255), (32, 256), (3000, 40 * 10)])
def test_any_shape_has_an_answer(asked: Asked, tmp_path: Path, size: tuple[int, int]) -> None:
    for k, image in enumerate((lamp(*size), np.full((*size, 3), 255, np.uint8))):
        Image.fromarray(image).save(tmp_path / f"{k}.png")
        code, [answer], _ = asked(tmp_path / f"{k}.png", "--out", str(tmp_path / "out"))
        assert code == 0
        for arm in answer["arms"]:
            assert not arm["believed"]
        assert Image.open(tmp_path / "out" / f"{k}.recognised.png").size == size[::-1]


@pytest.mark.parametrize(
    "words",
    ["", "1", "1,2,3", "a,b,c,d", "nan,100,80,60", "inf,inf,80,60", "0,0,80,60", "-90,90,80,60",
     "90,9000,80,60", "1e300,1e300,80,60", "90,90,800,60", "90,90,80,-600"],
)  # fmt: skip
def test_absurd_intrinsics_are_one_line(asked: Asked, tmp_path: Path, words: str) -> None:
    Image.fromarray(lamp()).save(tmp_path / "a.png")
    code, found, error = asked(tmp_path / "a.png", "--intrinsics", words)
    assert (code, found) == (1, [])
    assert error.startswith("--intrinsics")
    assert error.count("\n") == 1


@pytest.mark.parametrize("kind", ["empty", "text", "cut", "html", "elf"])
def test_what_is_no_picture_is_one_line(asked: Asked, tmp_path: Path, kind: str) -> None:
    file = tmp_path / "a.jpg"
    Image.fromarray(lamp()).save(file)
    data = {
        "empty": b"",
        "text": b"a robot\n",
        "cut": file.read_bytes()[:-300],
        "html": b"<!doctype html><title>404</title>",
        "elf": b"\x7fELF" + bytes(4096),
    }
    file.write_bytes(data[kind])
    code, found, error = asked(file)
    assert (code, found) == (1, [])
    assert str(file) in error
    assert error.count("\n") == 1


class _Trap:
    def __init__(self, file: Path) -> None:
        self._file = file

    def __reduce__(self) -> tuple[object, tuple[Path]]:
        return Path.touch, (self._file,)


@pytest.mark.parametrize("what", ["network", "extension"])
@pytest.mark.parametrize("hostile", ["pickle", "empty", "zip", "random"])
def test_hostile_weights_are_one_line_and_nothing_of_them_is_run(
    asked: Asked, tmp_path: Path, what: str, hostile: str
) -> None:
    Image.fromarray(lamp()).save(tmp_path / "a.png")
    data = {
        "pickle": pickle.dumps(_Trap(tmp_path / "sprung")),
        "empty": b"",
        "zip": b"PK\x03\x04" + bytes(200),
        "random": np.random.default_rng(0).bytes(5000),
    }
    file = tmp_path / ("bad.onnx" if what == "network" else "bad.safetensors")
    file.write_bytes(data[hostile])
    code, found, error = asked(tmp_path / "a.png", f"--{what}", str(file))
    assert (code, found) == (1, [])
    assert str(file) in error
    assert error.count("\n") == 1
    assert not (tmp_path / "sprung").exists()


def test_a_card_that_describes_another_robot_is_not_believed(tmp_path: Path) -> None:
    """Its link numbers would reach beyond the robot's, in compiled code."""
    card = bright_card()
    marks = card["landmarks"]["ur5"]
    marks["middle"] += marks["middle"]
    marks["half"] += marks["half"]
    marks["link"] = [13] * len(marks["link"])
    (tmp_path / "a.onnx").write_bytes(bright_network(card))
    recogniser = ArmRecogniser(CropModel(tmp_path / "a.onnx", 1))
    with pytest.raises(RecognitionError, match="another ur5"):
        recogniser.recognise(Picture("a", lamp()))


def test_answers_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    kind = np.array([[np.nan, 0.0, 0.0]], np.float32)
    (tmp_path / "a.onnx").write_bytes(bright_network(bright_card(), kind=kind))
    with pytest.raises(RecognitionError, match="no number"):
        CropModel(tmp_path / "a.onnx", 1).look(np.zeros((64, 64, 3), np.uint8))
    kind = np.zeros((1, 9), np.float32)
    (tmp_path / "a.onnx").write_bytes(bright_network(bright_card(), kind=kind))
    with pytest.raises(RecognitionError, match="another size"):
        CropModel(tmp_path / "a.onnx", 1).look(np.zeros((64, 64, 3), np.uint8))


def test_a_robot_that_the_network_does_not_know_is_named(asked: Asked, tmp_path: Path) -> None:
    Image.fromarray(lamp()).save(tmp_path / "lamp.png")
    code, [found], _ = asked(tmp_path / "lamp.png", "--robot", "ur5")
    assert code == 0
    assert found["arms"][0]["robot"] == "ur5"
    code, lines, said = asked(tmp_path / "lamp.png", "--robot", "iiwa")
    assert code != 0
    assert not lines
    assert "does not know iiwa, only ur5" in said
