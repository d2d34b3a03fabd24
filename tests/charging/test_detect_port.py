"""``armsight detect-port`` on painted pictures and on what is none."""

import json
from pathlib import Path

import cv2
import pytest
from painted_ports import LENS, facing, paint

from armsight.charging.ports.table import PORTS
from armsight.cli import run

LENS_WORDS = ["--intrinsics", f"{LENS.fx},{LENS.fy},{LENS.cx},{LENS.cy}"]


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    file = tmp_path / "port.png"
    image = paint(PORTS["type2"], facing(0.0, 0.0, 0.5, (0.3, 0.1), 0.1), LENS, 0)
    cv2.imwrite(str(file), image)
    return file


def test_a_port_is_printed_written_and_drawn(picture: Path, tmp_path: Path, capsys) -> None:
    out, lines = tmp_path / "found.png", tmp_path / "found.jsonl"
    words = ["detect-port", str(picture), *LENS_WORDS, "--out", str(out), "--json", str(lines)]
    assert run(words) == 0
    row = json.loads(capsys.readouterr().out.splitlines()[0])
    assert row["port"] == "type2"
    assert row["position_m"][2] == pytest.approx(0.5, abs=0.01)
    assert json.loads(lines.read_text().splitlines()[0]) == row
    assert cv2.imread(str(out)).shape == (480, 640, 3)


def test_a_lens_file_is_read_and_has_to_fit(picture: Path, tmp_path: Path, capsys) -> None:
    lens = tmp_path / "lens.yaml"
    text = (
        "image_width: {}\nimage_height: {}\ndistortion_model: plumb_bob\n"
        f"camera_matrix: {{{{rows: 3, cols: 3, data: [{LENS.fx}, 0, {LENS.cx}, 0, {LENS.fy}, "
        f"{LENS.cy}, 0, 0, 1]}}}}\n"
        "distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}\n"
    )
    lens.write_text(text.format(640, 480))
    assert run(["detect-port", str(picture), "--camera", str(lens)]) == 0
    z = json.loads(capsys.readouterr().out.splitlines()[0])["position_m"][2]
    assert z == pytest.approx(0.5, abs=0.01)
    lens.write_text(text.format(1280, 960))
    assert run(["detect-port", str(picture), "--camera", str(lens)]) == 2
    assert "the picture 640x480" in capsys.readouterr().err


def test_no_port_is_exit_code_1(tmp_path: Path, capsys) -> None:
    file = tmp_path / "wall.png"
    cv2.imwrite(str(file), paint(PORTS["type2"], facing(0, 0, 0.5, (0, 0), 0), LENS, 0) // 255)
    assert run(["detect-port", str(file)]) == 1
    assert "no port of type1" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing.png"], "there is no such picture"),
        (["PICTURE", "PICTURE", "PICTURE"], "3 pictures; give one, or a pair"),
        (["PICTURE", "PICTURE"], "a pair needs --baseline"),
        (["PICTURE", "--ports", "chademo"], "no port or plug 'chademo'"),
        (["PICTURE", "--intrinsics", "1,2"], "expected fx,fy,cx,cy"),
        (["PICTURE", "--least-score", "2"], "expected above 0, at most 1"),
        (["TEXT"], "no picture that can be read"),
    ],
)
def test_bad_input(words, message: str, picture: Path, tmp_path: Path, capsys) -> None:
    text = tmp_path / "notes.png"
    text.write_text("no picture")
    names = {"PICTURE": str(picture), "TEXT": str(text)}
    assert run(["detect-port", *(names.get(w, w) for w in words)]) == 2
    assert message in capsys.readouterr().err
