"""``armsight recognise`` with our network, on what users and strangers hand to it."""

import io
import json
import math
import os
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

pytestmark = pytest.mark.usefixtures("without_landmarks")

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


def test_a_name_of_no_encoding_has_an_answer(asked: Asked, tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"arm\xff.png")
    buffer = io.BytesIO()
    Image.fromarray(lamp()).save(buffer, "PNG")
    try:
        file.write_bytes(buffer.getvalue())
    except OSError:
        pytest.skip("this file system takes no such name")
    code, [found], _ = asked(file, "--out", str(tmp_path / "out"))
    assert code == 0
    assert found["picture"] == file.name
    kept = json.loads((tmp_path / "out" / "recognised.jsonl").read_text())
    assert kept["picture"] == file.name


def test_pictures_that_differ_by_their_ending_have_drawings_of_their_own(
    asked: Asked, tmp_path: Path
) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("a.jpg", "a.png", "b.png"):
        Image.fromarray(lamp()).save(folder / name)
    for _ in range(2):  # the second time its own drawings are there, too
        code, found, _ = asked(folder, "--out", str(folder))
        assert code == 0
        assert [f["picture"] for f in found] == ["a.jpg", "a.png", "b.png"]
    drawn = {p.name for p in folder.glob("*.recognised.png")}
    assert drawn == {"a.jpg.recognised.png", "a.png.recognised.png", "b.recognised.png"}


def test_a_folder_named_like_a_video_is_a_folder(asked: Asked, tmp_path: Path) -> None:
    folder = tmp_path / "film.mp4"
    folder.mkdir()
    Image.fromarray(lamp()).save(folder / "a.png")
    code, found, _ = asked(folder)
    assert (code, len(found)) == (0, 1)


def test_a_bad_camera_file_is_told_once(asked: Asked, tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("a.png", "b.png"):
        Image.fromarray(lamp()).save(folder / name)
    (tmp_path / "camera.yaml").write_text("image_width: 160\n")
    code, found, error = asked(folder, "--camera", str(tmp_path / "camera.yaml"))
    assert (code, found) == (1, [])
    assert error.count("\n") == 1


def test_a_turned_picture_has_its_camera_turned(asked: Asked, tmp_path: Path) -> None:
    image = Image.fromarray(np.ascontiguousarray(np.rot90(lamp())))  # 120 x 160, lies
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(tmp_path / "a.png", exif=exif)
    numbers = [130.0, 0, 60, 0, 140, 75, 0, 0, 1]
    words = f"image_width: 120\nimage_height: 160\ncamera_matrix: {{data: {numbers}}}\n"
    (tmp_path / "camera.yaml").write_text(words)
    code, [found], _ = asked(tmp_path / "a.png", "--camera", str(tmp_path / "camera.yaml"))
    assert code == 0
    assert found["intrinsics"] == "given"
    assert found["K"] == [[140.0, 0.0, 84.0], [0.0, 130.0, 60.0], [0.0, 0.0, 1.0]]


def test_a_phone_that_is_held_upright_has_the_same_lens(asked: Asked, tmp_path: Path) -> None:
    Image.fromarray(lamp(120, 160)).save(tmp_path / "lying.png")
    Image.fromarray(lamp(160, 120)).save(tmp_path / "upright.png")
    (_, [a], _), (_, [b], _) = asked(tmp_path / "lying.png"), asked(tmp_path / "upright.png")
    assert (
        a["K"][0][0] == b["K"][0][0] == pytest.approx(80 / math.tan(math.radians(32.5)), abs=0.01)
    )


def test_a_graph_that_cannot_be_worked_out_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(bright_network(bright_card()))
    model = CropModel(tmp_path / "a.onnx", 1)

    class Broken:
        def run(self, *_: object) -> None:
            raise RuntimeError("Non-zero status code returned\nwhile running Conv")

    model._session = Broken()
    with pytest.raises(RecognitionError, match="does not run"):
        model.look(np.zeros((64, 96, 3), np.uint8))


@pytest.mark.parametrize("threads", ["-2", "1025"])
def test_threads_that_no_machine_has_are_not_the_networks_fault(
    asked: Asked, tmp_path: Path, threads: str
) -> None:
    """A hundred thousand filled the memory before the picture was looked at."""
    Image.fromarray(lamp()).save(tmp_path / "a.png")
    code, found, error = asked(tmp_path / "a.png", "--threads", threads)
    assert (code, found) == (2, [])
    assert "--threads" in error
