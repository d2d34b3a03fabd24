"""Words over a picture, and its skeleton."""

import numpy as np
import pytest

from armsight.recognition.drawing import draw_words

LONG = (
    "ur10 96 %, base 1.50 m away; its lens is not known, which leaves 324 mm open (through the "
    "right one 97 % sure that joints are right to 10 cm); give --camera or --intrinsics"
)


@pytest.mark.parametrize("width", [320, 640, 1600])
def test_words_wider_than_the_picture_go_on_in_the_next_line(width: int) -> None:
    """What one should do stood at the end, beyond the edge."""
    short, long = (np.zeros((width, width, 3), np.uint8) for _ in range(2))
    draw_words(short, [LONG[:20]], 1700)
    draw_words(long, [LONG], 1700)
    assert not long[:, -5:].any()
    written = (np.flatnonzero(image.any(axis=(1, 2))).max() for image in (short, long))
    one, all_of_it = written
    assert all_of_it > 1.7 * one


def test_a_word_wider_than_the_picture_has_a_line_of_its_own() -> None:
    image = np.zeros((200, 60, 3), np.uint8)
    draw_words(image, ["extraordinarily-long-name", "", "b"], 1700)
    assert image[:17].any()
    assert image[17:40].any()
