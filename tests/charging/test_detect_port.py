"""``armsight detect-port`` on painted pictures and on what is none."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from painted_ports import LENS, PAIR, facing, paint
from tests.test_pictures import claims

from armsight.charging.ports.table import PORTS
from armsight.cli import run
from armsight.commands.detect_port import _draw
from armsight.errors import UsageError
from armsight.geometry.pose import inverse

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
        (["FOLDER"], "is a folder, expected a picture"),
        (["PICTURE", "--intrinsics", "1,2"], "expected fx,fy,cx,cy"),
        (["PICTURE", "--intrinsics", "900,900,nan,360"], "a middle at nan, 360 px cannot be"),
        (["PICTURE", "--least-score", "2"], "expected above 0, at most 1"),
        (["PICTURE", "--intrinsics", "nan,900,640,360"], "focal lengths of nan and 900 px cannot"),
        (["PICTURE", "--least-score", "0.97"], "one picture scores at most 0.95: give a pair"),
        (["CUT"], "no picture that can be read"),
        (["TEXT"], "no picture that can be read"),
        (["HUGE"], "no picture that can be read"),
        (["EMPTY"], "no picture that can be read"),
        (["LONG"], "9000x16 pixels; at most 8192 a side"),
        (["SPECK"], "40x40 pixels is too small"),
        (["PICTURE", "SPECK", "--baseline", "0.15"], "another size than"),
        (["PICTURE", "PICTURE", "--baseline", "-1"], "a pair needs --baseline"),
        ([], "0 pictures; give one, or a pair"),
        (["PICTURE", "--ports", ","], "--ports names no type"),
        (["PICTURE", "PICTURE", "--baseline", "0.2", "--toe-in-deg", "nan"], "--toe-in-deg is nan"),
    ],
)
def test_bad_input(words, message: str, picture: Path, tmp_path: Path, capsys) -> None:
    text = tmp_path / "notes.png"
    text.write_text("no picture")
    names = {"PICTURE": str(picture), "TEXT": str(text), "FOLDER": str(tmp_path)}
    short = picture.read_bytes()[:400]
    for name, data in (("HUGE", claims(60000, 60000)), ("EMPTY", b""), ("CUT", short)):
        names[name] = str(tmp_path / f"{name}.png")
        Path(names[name]).write_bytes(data)
    for name, shape in (("LONG", (16, 9000)), ("SPECK", (40, 40))):
        names[name] = str(tmp_path / f"{name}.png")
        cv2.imwrite(names[name], np.full(shape, 90, np.uint8))
    assert run(["detect-port", *(names.get(w, w) for w in words)]) == 2
    assert message in capsys.readouterr().err


def _rows(file: Path, image, capsys, *words: str) -> list[dict]:
    """What is found in a picture; the exit code says whether anything was."""
    cv2.imwrite(str(file), image)
    code = run(["detect-port", str(file), *LENS_WORDS, *words])
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert code == (0 if rows else 1)
    return rows


def test_sixteen_bits_and_transparency_are_searched(tmp_path: Path, capsys) -> None:
    image = paint(PORTS["type2"], facing(0.0, 0.0, 0.5, (0.3, 0.1), 0.1), LENS, 0)
    deep = image.astype(np.uint16) * 257
    clear = np.dstack([image] * 3 + [np.full_like(image, 200)])
    for name, kind in (("deep.png", deep), ("clear.png", clear)):
        assert [r["port"] for r in _rows(tmp_path / name, kind, capsys)] == ["type2"]


def test_two_ports_are_two_lines_each_with_its_type(tmp_path: Path, capsys) -> None:
    one = paint(PORTS["type2"], facing(-0.10, 0.0, 0.5, (0.1, 0.1), 0.1), LENS, 0)
    two = paint(PORTS["type1"], facing(0.10, 0.0, 0.5, (0.0, 0.2), 0.0), LENS, 1)
    image = np.hstack([one[:, :320], two[:, 320:]])
    rows = _rows(tmp_path / "two.png", image, capsys)
    assert sorted((r["port"], round(r["position_m"][0], 1)) for r in rows) == [
        ("type1", 0.1), ("type2", -0.1),
    ]  # fmt: skip


def test_a_covered_port_is_not_found(tmp_path: Path, capsys) -> None:
    """A cloth over it to a sliver; over its lower third alone it is found, and scored for it."""
    image = paint(PORTS["type2"], facing(0.0, 0.0, 0.4, (0.1, 0.1), 0.1), LENS, 0)
    whole = _rows(tmp_path / "whole.png", image, capsys)
    covered, third = image.copy(), image.copy()
    covered[190:, :] = 150
    third[265:, :] = 150
    assert _rows(tmp_path / "covered.png", covered, capsys) == []
    part = _rows(tmp_path / "third.png", third, capsys)
    assert all(r["score"] < whole[0]["score"] - 0.1 for r in part)


def test_through_a_dirty_lens_it_is_found_where_it_is_or_not_at_all(tmp_path: Path, capsys) -> None:
    """Smears of a few pixels and haze: no pose that is wrong may look good."""
    rng = np.random.default_rng(5)
    image = paint(PORTS["type2"], facing(0.0, 0.0, 0.5, (0.2, 0.1), 0.1), LENS, 0)
    veil = np.zeros(image.shape, np.float32)
    for _ in range(40):
        at = (int(rng.integers(640)), int(rng.integers(480)))
        cv2.circle(veil, at, int(rng.integers(3, 14)), float(rng.uniform(0.2, 0.8)), -1)
    veil = cv2.GaussianBlur(veil, (0, 0), 4.0)
    dirty = np.clip((1 - veil) * image + veil * 130, 0, 255).astype(np.uint8)
    for r in _rows(tmp_path / "dirty.png", dirty, capsys):
        assert r["port"] == "type2"
        assert np.allclose(r["position_m"], [0.0, 0.0, 0.5], atol=0.006)


def test_exchanged_cameras_show_no_port(tmp_path: Path, capsys) -> None:
    T = facing(0.02, 0.0, 0.6, (0.1, 0.1), 0.1)
    views = [("left", PAIR.left, T), ("right", PAIR.right, inverse(PAIR.T_left_right) @ T)]
    for seed, (side, lens, pose) in enumerate(views):
        cv2.imwrite(str(tmp_path / f"{side}.png"), paint(PORTS["type2"], pose, lens, seed))
    words = [*LENS_WORDS, "--baseline", "0.15", "--toe-in-deg", "12"]
    files = [str(tmp_path / "left.png"), str(tmp_path / "right.png")]
    assert run(["detect-port", *files, *words]) == 0
    capsys.readouterr()
    assert run(["detect-port", *files[::-1], *words]) == 1
    assert "no port" in capsys.readouterr().err


def test_a_kind_of_picture_that_nobody_writes_is_said(tmp_path: Path) -> None:
    image = np.zeros((LENS.height, LENS.width), np.uint8)
    with pytest.raises(UsageError, match=r"found\.xyz: not a kind of picture that can be written"):
        _draw(tmp_path / "found.xyz", image, LENS, [])
