"""Pictures from outside: what can be read is upright 8-bit RGB, all else is one clear line."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from armsight.errors import RecognitionError
from armsight.recognition.inference.pictures import (
    left_out,
    pictures_in,
    read_picture,
    video_frames,
)

from ..films import write_film


def colourful(height: int = 60, width: int = 80) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_colour(tmp_path: Path) -> None:
    Image.fromarray(colourful()).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    assert np.array_equal(picture.image, colourful())
    assert picture.notes == ()


def test_transparency_is_dropped(tmp_path: Path) -> None:
    rgba = np.dstack([colourful(), np.full((60, 80), 255, np.uint8)])
    Image.fromarray(rgba, "RGBA").save(tmp_path / "a.png")
    assert np.array_equal(read_picture(tmp_path / "a.png").image, colourful())


def test_grey(tmp_path: Path) -> None:
    Image.fromarray(colourful()[..., 0]).save(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png")
    assert np.array_equal(picture.image, np.repeat(colourful()[..., :1], 3, axis=2))
    assert any("grey" in n for n in picture.notes)


def test_sixteen_bits(tmp_path: Path) -> None:
    values = np.linspace(0, 4095, 60 * 80).reshape(60, 80).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), values)
    picture = read_picture(tmp_path / "a.png")
    assert picture.image.dtype == np.uint8
    white = np.sort(values[values > 0])[int(0.995 * (values > 0).sum())]
    np.testing.assert_allclose(picture.image[..., 0], np.minimum(values / white, 1) * 255, atol=0.6)
    assert any("8 bits" in n for n in picture.notes)


@pytest.mark.parametrize("ending", ["png", "tiff"])
@pytest.mark.parametrize("channels", [3, 4])
def test_dark_colour_of_sixteen_bits(tmp_path: Path, ending: str, channels: int) -> None:
    """Twelve bits in sixteen, half as dark again: one scale for all colours, so none is another."""
    rng = np.random.default_rng(0)
    values = rng.integers(0, 2048, (60, 80, channels)).astype(np.uint16)
    values[..., 0] //= 4  # little blue: OpenCV writes BGR
    cv2.imwrite(str(tmp_path / f"a.{ending}"), values)
    picture = read_picture(tmp_path / f"a.{ending}")
    said = np.sort(values[..., :3][values[..., :3] > 0])
    white = said[int(0.995 * len(said))]
    shown = np.minimum(values[..., 2::-1] / white, 1) * 255
    np.testing.assert_allclose(picture.image, shown, atol=0.6)
    assert any("8 bits" in n for n in picture.notes)
    assert not any("grey" in n for n in picture.notes)


def test_deep_colour_is_turned_by_its_camera_and_cut_as_any_other(tmp_path: Path) -> None:
    values = np.repeat(np.linspace(0, 4095, 60 * 80).reshape(60, 80, 1), 3, 2).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), values)
    upright = read_picture(tmp_path / "a.png").image
    data = (tmp_path / "a.png").read_bytes()
    exif = b"eXIf" + b"II*\0\x08\0\0\0" + struct.pack("<HHHII", 1, 0x0112, 3, 1, 6) + bytes(4)
    after = data.index(b"IHDR") + 4 + 13 + 4
    chunk = struct.pack(">I", len(exif) - 4) + exif + struct.pack(">I", zlib.crc32(exif))
    (tmp_path / "b.png").write_bytes(data[:after] + chunk + data[after:])
    assert np.array_equal(read_picture(tmp_path / "b.png").image, np.rot90(upright, -1))
    (tmp_path / "c.png").write_bytes(data[: len(data) // 2])
    with pytest.raises(RecognitionError, match="truncated"):
        read_picture(tmp_path / "c.png")


def test_a_hot_pixel_and_what_was_not_measured_decide_nothing(tmp_path: Path) -> None:
    """Depth in millimetres, half of it 0, with pixels that say 65535; and as floats in metres."""
    depth = np.random.default_rng(0).integers(800, 2500, (60, 80)).astype(np.uint16)
    depth[:, :40] = 0
    clean, hot = tmp_path / "clean.png", tmp_path / "hot.png"
    cv2.imwrite(str(clean), depth)
    depth[[3, 20, 50], [60, 70, 45]] = 65535
    cv2.imwrite(str(hot), depth)
    a, b = (read_picture(f).image[..., 0].astype(int) for f in (clean, hot))
    same = depth < 65535
    assert np.abs(a - b)[same].max() <= 1
    assert b[~same].tolist() == [255] * 3
    assert b[:, 40:].min() > 0.3 * 255
    metres = np.where(same, 1e-3 * depth, np.inf).astype(np.float32)
    metres[7, 7] = np.nan
    metres[8, 8] = -np.inf
    Image.fromarray(metres).save(tmp_path / "metres.tiff")
    c = read_picture(tmp_path / "metres.tiff").image[..., 0].astype(int)
    assert np.abs(a - c)[same].max() <= 1
    assert c[~same].tolist() == [255] * 3


@pytest.mark.parametrize("value", [0, 65535])
def test_a_deep_picture_of_one_value(tmp_path: Path, value: int) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((60, 80), value, np.uint16))
    assert np.unique(read_picture(tmp_path / "a.png").image).tolist() == [value // 257]


def test_turned_by_its_camera(tmp_path: Path) -> None:
    image = Image.fromarray(colourful())
    exif = image.getexif()
    exif[0x0112] = 6  # turn by 90 degrees clockwise
    image.save(tmp_path / "a.png", exif=exif)
    assert np.array_equal(read_picture(tmp_path / "a.png").image, np.rot90(colourful(), -1))


@pytest.mark.parametrize("ending", ["jpg", "png", "webp", "gif", "bmp", "tiff"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.8])
def test_truncated(tmp_path: Path, ending: str, share: float) -> None:
    file = tmp_path / f"a.{ending}"
    Image.fromarray(colourful(200, 300)).save(file)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(RecognitionError) as caught:
        read_picture(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_picture(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("%!PS-Adobe-3.0 EPSF-3.0\n")
    with pytest.raises(RecognitionError, match="no picture"):
        read_picture(tmp_path / "a.png")
    with pytest.raises(RecognitionError, match="no such file"):
        read_picture(tmp_path / "b.png")


def test_phones_pictures_that_are_not_read_are_called_what_they_are(tmp_path: Path) -> None:
    """Whatever the file is called: phones hand them on as .jpg, too."""
    (tmp_path / "a.jpg").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
    with pytest.raises(RecognitionError, match=r"a\.jpg: is a HEIC .* save it as JPEG"):
        read_picture(tmp_path / "a.jpg")
    (tmp_path / "b.jpg").write_bytes(b"")
    with pytest.raises(RecognitionError, match=r"b\.jpg: is empty"):
        read_picture(tmp_path / "b.jpg")


def test_what_the_disk_refuses_is_no_damage(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="cannot be read") as caught:
        read_picture(tmp_path)
    assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("ending", ["gif", "webp", "png", "tiff"])
def test_of_a_film_the_first_picture_is_shown_and_it_is_said(tmp_path: Path, ending: str) -> None:
    shown = np.full((60, 80, 3), 200, np.uint8)
    shown[:, 40:] = 20
    frames = [Image.fromarray(image) for image in (shown, shown[::-1, ::-1], 255 - shown)]
    file = tmp_path / f"a.{ending}"
    frames[0].save(file, save_all=True, append_images=frames[1:])
    picture = read_picture(file)
    np.testing.assert_allclose(picture.image[:, 5:35], 200.0, atol=3)
    np.testing.assert_allclose(picture.image[:, 45:75], 20.0, atol=3)
    assert picture.notes == ("the first of 3 pictures in its file",)


def png_header(width: int, height: int) -> bytes:
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body))
        + struct.pack(">I", 10) + b"IDAT" + b"\0" * 14
    )  # fmt: skip


@pytest.mark.parametrize(("width", "height"), [(60000, 60000), (9000, 9000)])
def test_huge(tmp_path: Path, width: int, height: int) -> None:
    (tmp_path / "a.png").write_bytes(png_header(width, height))
    with pytest.raises(RecognitionError, match="shrink"):
        read_picture(tmp_path / "a.png")


@pytest.mark.parametrize("size", [(10, 10), (40, 1000)])
def test_tiny_and_strips(tmp_path: Path, size: tuple[int, int]) -> None:
    Image.fromarray(colourful(*size)).save(tmp_path / "a.png")
    with pytest.raises(RecognitionError):
        read_picture(tmp_path / "a.png")


def test_folders(tmp_path: Path) -> None:
    with pytest.raises(RecognitionError, match="no picture"):
        pictures_in(tmp_path)
    for name in ("b.JPG", "a.png", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    assert [p.name for p in pictures_in(tmp_path)] == ["a.png", "b.JPG"]
    with pytest.raises(RecognitionError, match="no such"):
        pictures_in(tmp_path / "missing")


def test_pictures_of_a_folder_that_are_not_read_are_said(tmp_path: Path) -> None:
    for name in ("a.HEIC", "b.heic", "c.mov", "notes.txt", ".d.heic", "f.recognised.mp4"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(RecognitionError, match=r"no picture .*; 2 \.heic, 1 \.mov left out"):
        pictures_in(tmp_path)
    (tmp_path / "e.jpg").write_bytes(b"")
    assert [p.name for p in pictures_in(tmp_path)] == ["e.jpg"]
    assert left_out(tmp_path).startswith("2 .heic, 1 .mov left out")
    for name in ("a.HEIC", "b.heic", "c.mov"):
        (tmp_path / name).unlink()
    assert left_out(tmp_path) == ""


def test_videos(tmp_path: Path) -> None:
    file = tmp_path / "a.avi"
    write_film(file, (np.full((60, 80, 3), 30 * k, np.uint8) for k in range(7)))
    frames = list(video_frames(file, every=3))
    assert [f.name for f in frames] == ["a.avi#0", "a.avi#3", "a.avi#6"]
    assert abs(int(frames[1].image.mean()) - 90) < 8
    (tmp_path / "b.mp4").write_bytes(b"no video")
    with pytest.raises(RecognitionError, match="video"):
        list(video_frames(tmp_path / "b.mp4"))


def with_tag(file: Path, tag: int, kind: int, value: bytes) -> None:
    """A JPEG on its side with one more tag, whatever is in it."""
    entries = [(0x0112, 3, b"\x06\0\0\0"), (tag, kind, value)]
    body = struct.pack("<H", 2) + b"".join(struct.pack("<HHI4s", t, k, 1, v) for t, k, v in entries)
    exif = b"Exif\0\0II*\0\x08\0\0\0" + body + b"\0\0\0\0"
    Image.fromarray(colourful()).save(file)
    data = file.read_bytes()
    file.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:])


@pytest.mark.parametrize(
    ("tag", "kind"), [(0x0100, 2), (0x0128, 7), (0x011A, 1), (0x010F, 11), (0x8769, 2)]
)
def test_a_tag_of_the_wrong_kind_spoils_no_picture(tmp_path: Path, tag: int, kind: int) -> None:
    with_tag(tmp_path / "a.jpg", tag, kind, b"ab\0\0")
    picture = read_picture(tmp_path / "a.jpg")
    assert picture.image.shape == (80, 60, 3)
    assert (picture.orientation, picture.camera) == (6, None)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_each_orientation_is_turned_as_pillow_does(tmp_path: Path, orientation: int) -> None:
    image = Image.fromarray(colourful())
    exif = image.getexif()
    exif[0x0112] = orientation
    image.save(tmp_path / "a.png", exif=exif)
    with Image.open(tmp_path / "a.png") as opened:
        expected = np.asarray(ImageOps.exif_transpose(opened))
    assert np.array_equal(read_picture(tmp_path / "a.png").image, expected)


def test_what_was_drawn_into_the_folder_is_no_picture_of_it(tmp_path: Path) -> None:
    for name in ("a.jpg", "._a.jpg", "a.recognised.png", "a.mask.png", "mask.png"):
        (tmp_path / name).write_bytes(b"")
    assert [p.name for p in pictures_in(tmp_path)] == ["a.jpg", "mask.png"]
