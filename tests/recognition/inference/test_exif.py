"""The focal length that a picture's own file tells, and files that tell nonsense."""

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from armsight.recognition.inference.pictures import read_picture

FOCAL, FOCAL_35, RESOLUTION, UNIT, WIDTH, HEIGHT = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003
PHONE = {FOCAL_35: 26, WIDTH: 400, HEIGHT: 300}


def photograph(
    folder: Path, tags: dict[int, object], size: tuple[int, int] = (400, 300), orientation: int = 1
) -> Path:
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769).update(tags)
    file = folder / "photo.jpg"
    Image.fromarray(np.full((size[1], size[0], 3), 90, np.uint8)).save(file, exif=exif)
    return file


def test_equivalent_focal_length_is_of_the_diagonal(tmp_path: Path) -> None:
    camera = read_picture(photograph(tmp_path, PHONE)).camera
    assert camera is not None
    assert (camera.width, camera.height, camera.cx, camera.cy) == (400, 300, 199.5, 149.5)
    # 26 mm before a film of 36 x 24 mm see 79.5 deg from corner to corner.
    corner = 2 * math.degrees(math.atan(0.5 * math.hypot(400, 300) / camera.fx))
    assert corner == pytest.approx(79.5, abs=0.1)
    assert camera.fy == camera.fx


def test_a_shrunk_picture_sees_the_same_angle(tmp_path: Path) -> None:
    large = read_picture(photograph(tmp_path, PHONE)).camera
    small = read_picture(photograph(tmp_path, PHONE, (200, 150))).camera
    assert large is not None
    assert small is not None
    assert small.fx == pytest.approx(0.5 * large.fx)


def test_a_picture_on_its_side_is_turned_with_its_camera(tmp_path: Path) -> None:
    picture = read_picture(photograph(tmp_path, PHONE, orientation=6))
    assert picture.camera is not None
    assert picture.image.shape[:2] == (400, 300)
    assert (picture.camera.width, picture.camera.height) == (300, 400)


def test_focal_length_by_the_sensor(tmp_path: Path) -> None:
    """4 mm before 100 pixels a millimetre are 400 pixels."""
    tags = {FOCAL: IFDRational(4), RESOLUTION: IFDRational(1000), UNIT: 3, WIDTH: 400, HEIGHT: 300}
    camera = read_picture(photograph(tmp_path, tags)).camera
    assert camera is not None
    assert camera.fx == pytest.approx(400.0)


@pytest.mark.parametrize(
    ("tags", "size"),
    [
        ({}, (400, 300)),
        (PHONE, (300, 300)),  # cut
        ({**PHONE, FOCAL_35: 60000}, (400, 300)),
        ({**PHONE, FOCAL_35: 0}, (400, 300)),
        ({FOCAL: IFDRational(4, 0), RESOLUTION: IFDRational(1000), UNIT: 3}, (400, 300)),
        ({FOCAL: IFDRational(4), RESOLUTION: IFDRational(1000), UNIT: 77}, (400, 300)),
    ],
)
def test_what_no_camera_says_is_left_out(
    tags: dict[int, object], size: tuple[int, int], tmp_path: Path
) -> None:
    assert read_picture(photograph(tmp_path, tags, size)).camera is None


def test_damaged_tags_do_not_spoil_the_picture(tmp_path: Path) -> None:
    file = photograph(tmp_path, PHONE)
    data = bytearray(file.read_bytes())
    at = data.find(b"Exif\0\0") + 14
    data[at : at + 60] = np.random.default_rng(0).bytes(60)
    file.write_bytes(data)
    assert read_picture(file).image.shape == (300, 400, 3)
