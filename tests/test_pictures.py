import struct
import zlib

import cv2
import numpy as np
import pytest

from armsight.pictures import decode_picture, read_picture

GRAY = np.random.default_rng(0).integers(0, 255, (12, 9), np.uint8)


def claims(width, height):
    """A PNG that says it is so large, and has a few bytes."""

    def chunk(name, data):
        check = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data)) + name + data + check

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + pixels + chunk(b"IEND", b"")


def test_a_picture_is_read_as_it_was_written(tmp_path):
    file = tmp_path / "gray.png"
    cv2.imwrite(str(file), GRAY)
    assert np.array_equal(read_picture(file, cv2.IMREAD_GRAYSCALE), GRAY)
    assert np.array_equal(decode_picture(file.read_bytes(), cv2.IMREAD_GRAYSCALE), GRAY)
    whole = np.frombuffer(file.read_bytes(), np.uint8)
    assert np.array_equal(decode_picture(whole, cv2.IMREAD_GRAYSCALE), GRAY)


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(b"", id="empty"),
        pytest.param(b"no picture", id="words"),
        pytest.param(claims(60000, 60000), id="larger-than-is-read"),
        pytest.param(claims(2**31 - 1, 2**31 - 1), id="as-large-as-can-be-said"),
        pytest.param(claims(0, 0), id="of-no-size"),
    ],
)
def test_what_is_none_raises_nothing(data, tmp_path):
    file = tmp_path / "x.png"
    file.write_bytes(data)
    assert read_picture(file, cv2.IMREAD_UNCHANGED) is None
    assert decode_picture(data, cv2.IMREAD_UNCHANGED) is None
    assert read_picture(tmp_path / "missing.png", cv2.IMREAD_UNCHANGED) is None
