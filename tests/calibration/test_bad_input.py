"""Bad input: one line that names the file and says what was expected; nothing is overwritten."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from armsight.calibration.boards import parse_board
from armsight.calibration.pictures import FIRST, MOST, read_gray
from armsight.commands.calibrate import Calibrate
from armsight.errors import ArmsightError, UsageError

BOARD = "checkerboard:10x7:25"


def pictures(folder: Path, count: int, size: tuple[int, int] = (64, 48)) -> None:
    folder.mkdir(exist_ok=True)
    for k in range(count):
        Image.new("L", size, 100 + k % 50).save(folder / f"im_{k}.png")


def refused(folder: Path, out: Path, board: str | None = BOARD) -> str:
    """What is said of a set that cannot be solved; an earlier result must stay as it was."""
    out.mkdir(exist_ok=True)
    (out / "calibration.json").write_text("an earlier one")
    with pytest.raises(ArmsightError) as caught:
        Calibrate(from_=folder, board=board, out=out).run()
    assert [f.name for f in out.iterdir()] == ["calibration.json"]
    assert (out / "calibration.json").read_text() == "an earlier one"
    words = str(caught.value)
    assert "\n" not in words
    return words


def test_no_picture_that_can_be_read(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    for k in range(4):
        (folder / f"im_{k}.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))
    words = refused(folder, tmp_path / "out")
    assert "none of 4 pictures can be read, such as im_0.png" in words


def test_a_board_in_no_picture(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    pictures(folder, 4)
    (folder / "poses.csv").write_text("x,y,z,rx,ry,rz\n" + "0.1,0.2,0.3,0,0,1\n" * 4)
    words = refused(folder, tmp_path / "out")
    assert str(folder) in words
    assert "10x7 squares" in words
    assert "check the board's kind and size" in words


def test_ten_thousand_pictures_are_not_all_looked_at(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    Image.new("L", (64, 48), 100).save(folder / "im_0.png")
    data = (folder / "im_0.png").read_bytes()
    for k in range(1, 10_000):
        (folder / f"im_{k}.png").write_bytes(data)
    (folder / "poses.txt").write_text("0.1 0.2 0.3 0 0 1\n" * 10_000)
    words = refused(folder, tmp_path / "out")
    assert f"in any of {MOST} pictures" in words
    assert f"not looked at: no board in {FIRST} others" in words


def test_half_a_pose_file_is_named_with_its_line(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    pictures(folder, 4)
    lines = ["0.1 0.2 0.3 0 0 1"] * 3 + ["the arm was moved by hand here"] + ["0.1 0.2 0.3 0"]
    (folder / "poses.txt").write_text("\n".join(lines) + "\n")
    words = refused(folder, tmp_path / "out")
    assert "poses.txt" in words


def test_folders_that_are_none(tmp_path: Path) -> None:
    assert "missing" in refused(tmp_path / "missing", tmp_path / "out")
    file = tmp_path / "poses.csv"
    file.write_text("1,2,3\n")
    assert "give a folder" in refused(file, tmp_path / "out")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert str(empty) in refused(empty, tmp_path / "out")
    pictures(tmp_path / "set", 3)
    assert "give --board" in refused(tmp_path / "set", tmp_path / "out", None)


def test_pictures_that_would_fill_the_memory(tmp_path: Path) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 0, 0, 0, 0)
    bomb = tmp_path / "bomb.png"
    bomb.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(bytes(1000)))
        + chunk(b"IEND", b"")
    )
    said = read_gray(bomb)
    assert isinstance(said, str)
    assert "cannot be read" in said or "million pixels" in said


def test_pictures_of_every_depth_and_colour_are_grey(tmp_path: Path) -> None:
    ramp = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))
    deep = ramp.astype(np.uint16) * 16  # 12 bits in 16
    colours = np.dstack([ramp] * 3)
    kinds = {
        "grey.png": Image.fromarray(ramp),
        "deep.png": Image.fromarray(deep),
        "deep.tiff": Image.fromarray(deep),
        "rgb.bmp": Image.fromarray(colours),
        "rgba.png": Image.fromarray(np.dstack([colours, np.full_like(ramp, 7)])),
        "palette.png": Image.fromarray(ramp).convert("P"),
        "light.webp": Image.fromarray(colours),
    }
    for name, image in kinds.items():
        image.save(tmp_path / name)
        gray = read_gray(tmp_path / name)
        assert not isinstance(gray, str), name
        assert gray.shape == (48, 64)
        assert np.corrcoef(gray[20].astype(float), ramp[20])[0, 1] > 0.99, name


def test_a_turned_picture_is_read_as_the_sensor_saw_it(tmp_path: Path) -> None:
    picture = Image.fromarray(np.tile(np.arange(64, dtype=np.uint8) * 3, (48, 1)))
    exif = Image.Exif()
    exif[274] = 6  # the viewer shall turn it
    picture.save(tmp_path / "im.jpg", exif=exif, quality=95)
    gray = read_gray(tmp_path / "im.jpg")
    assert not isinstance(gray, str)
    assert gray.shape == (48, 64)


@pytest.mark.parametrize(
    "words",
    [
        "checkerboard:100000x7:25",
        "checkerboard:10x7:1e99",
        "checkerboard:10x7:-25",
        "checkerboard:10x7:nan",
        "apriltag:999x999:30",
        "charuco:5000x5000:30:20",
        "circles:0x5:30",
        "tag:48:99999999",
        "chequers:9x6:25",
        "",
        "checkerboard:" + "9" * 4000,
    ],
)
def test_boards_that_are_none_are_refused_in_a_line(words: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_board(words)
    assert "\n" not in str(caught.value)
