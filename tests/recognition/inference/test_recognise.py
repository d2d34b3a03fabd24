"""``armsight recognise`` from picture to JSON and drawing; the network's answers are known."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from armsight.cli import run
from armsight.recognition.inference.model import Model
from armsight.recognition.inference.overlay import draw
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.inference.recogniser import Recogniser

from ..films import write_film
from .conftest import BASE, card, network


def bright_block(height: int = 212, width: int = 256) -> np.ndarray:
    image = np.full((height, width, 3), 40, np.uint8)
    image[height // 4 : height // 2, width // 4 : width // 2] = 220
    return image


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    Image.fromarray(bright_block()).save(folder / "a.png")
    return folder / "a.png"


def asked(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, list[dict], str]:
    code = run(["recognise", *words])
    captured = capsys.readouterr()
    return code, [json.loads(line) for line in captured.out.splitlines()], captured.err


def test_a_picture(
    tmp_path: Path, network_file: Path, picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    code, found, _ = asked(capsys, str(picture), "--network", str(network_file), "--out", str(out))
    assert code == 0
    (answer,) = found
    assert answer["robot"] == "ur5"
    assert answer["probabilities"] == {"ur5": 0.9, "iiwa": 0.1}
    assert answer["base_camera_m"] == BASE
    assert len(answer["joints_camera_m"]) == 6  # a ur5 has six of the network's seven
    assert answer["intrinsics"] == "assumed"
    assert any("intrinsics" in n for n in answer["notes"])
    # f 48 of 64 px, so 192 of 256: base at 0.1, 0.2, 1.5 m.
    assert answer["base_px"] == pytest.approx([127.5 + 192 * 0.1 / 1.5, 105.5 + 192 * 0.2 / 1.5])
    mask = np.asarray(Image.open(out / "a.mask.png"))
    assert mask.shape == (212, 256)
    assert ((mask > 127) == (bright_block()[..., 0] > 128)).mean() > 0.98
    assert Image.open(out / "a.recognised.png").size == (256, 212)
    assert json.loads((out / "recognised.jsonl").read_text()) == answer


def test_given_intrinsics(
    network_file: Path, picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network = ("--network", str(network_file))
    _, found, _ = asked(capsys, str(picture), *network, "--intrinsics", "200,200,127.5,105.5")
    assert found[0]["intrinsics"] == "given"
    assert found[0]["base_px"][0] == pytest.approx(127.5 + 200 * 0.1 / 1.5, abs=0.01)
    code, _, error = asked(capsys, str(picture), *network, "--intrinsics", "200,200,900,105")
    assert code == 1
    assert "principal point" in error


def test_a_folder_goes_on_after_a_bad_picture(
    network_file: Path, picture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (picture.parent / "b.png").write_bytes(b"\x89PNG broken")
    Image.fromarray(bright_block()).save(picture.parent / "c.png")
    code, found, error = asked(capsys, str(picture.parent), "--network", str(network_file))
    assert code == 1
    assert [a["picture"] for a in found] == ["a.png", "c.png"]
    assert "b.png" in error


def test_an_empty_picture_shows_no_robot(
    network_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Image.fromarray(np.full((100, 120, 3), 30, np.uint8)).save(tmp_path / "a.png")
    _, found, _ = asked(capsys, str(tmp_path / "a.png"), "--network", str(network_file))
    assert found[0]["robot"] is None
    assert "no robot" in found[0]["reason"]
    assert found[0]["joints_camera_m"] is None


def test_half_a_robot_is_told(network_file: Path) -> None:
    image = bright_block()
    image[:, :80] = 230
    found = Recogniser(Model(network_file)).recognise(Picture("a", image))
    assert any("cut by the frame" in n for n in found.notes)


def test_a_weak_network_says_so(tmp_path: Path) -> None:
    for mean, told in ((250.0, True), (30.0, False)):
        (tmp_path / "n.onnx").write_bytes(network(about=card(mean)))
        found = Recogniser(Model(tmp_path / "n.onnx")).recognise(Picture("a", bright_block()))
        assert any("weak" in n for n in found.notes) == told


def test_drawings_have_the_pictures_size(network_file: Path) -> None:
    for size in ((53, 64), (720, 1280), (900, 300)):
        image = bright_block(*size)
        drawn = draw(image, Recogniser(Model(network_file)).recognise(Picture("a", image)))
        assert drawn.shape == image.shape
        assert drawn.dtype == np.uint8
        assert not np.array_equal(drawn, image)


def test_a_video(tmp_path: Path, network_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.avi"
    write_film(file, [bright_block()] * 4)
    out = tmp_path / "out"
    words = ("--network", str(network_file), "--out", str(out), "--every", "2")
    code, found, _ = asked(capsys, str(file), *words)
    assert code == 0
    assert [a["picture"] for a in found] == ["a.avi#0", "a.avi#2"]
    assert (out / "a.recognised.mp4").stat().st_size > 0
    assert {p.name for p in out.iterdir()} == {"a.recognised.mp4", "recognised.jsonl"}


def test_recognising_loads_no_torch(network_file: Path, picture: Path) -> None:
    script = (
        "import sys; from armsight.cli import run; "
        f"run(['recognise', {str(picture)!r}, '--network', {str(network_file)!r}]); "
        "print('torch' in sys.modules, 'mujoco' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "False False"
