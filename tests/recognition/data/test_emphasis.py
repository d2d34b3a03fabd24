"""Weights of bins: the file, the chance, and the sets that come of it."""

from pathlib import Path

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.recognition.data.crews import draw_batch
from armsight.recognition.data.emphasis import Emphasis, parse_emphasis, read_emphasis
from armsight.recognition.data.order import make_order

FAR = Emphasis((("distance", (0.0, 1.5, 10.0), (0.0, 2.0)),))


def test_chances_follow_the_weights() -> None:
    both = Emphasis((*FAR.bins, ("seen", (0.0, 0.5, 1.01), (4.0, 1.0))))
    assert both.chance({"distance": 2.0, "seen": 0.2}) == 1.0
    assert both.chance({"distance": 2.0, "seen": 1.0}) == 0.25
    assert both.chance({"distance": 1.0, "seen": 0.2}) == 0.01
    assert both.chance({"distance": 99.0, "seen": 0.2}) == 0.01
    assert parse_emphasis(both.text()) == both
    assert parse_emphasis("") == Emphasis()


def test_a_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "more.toml"
    path.write_text("[distance]\nedges = [0, 1.5, 10]\nweights = [0, 2]\n")
    assert read_emphasis(path) == FAR


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "weighs nothing"),
        ("[color]\nedges = [0, 1]\nweights = [1]", '"color" cannot be weighed'),
        ("distance = 3", "is no table"),
        ("[distance]\nedges = [0, 1]", "lists of numbers"),
        ("[distance]\nedges = [0, nan]\nweights = [1]", "lists of numbers"),
        ("[distance]\nedges = [1, 0]\nweights = [1]", "rising edges"),
        ("[distance]\nedges = [0, 1]\nweights = [1, 2]", "rising edges"),
        ("[distance]\nedges = [0, 1]\nweights = [0]", "none above"),
        ("[distance", "is not TOML"),
    ],
)
def test_broken_files(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "more.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=words):
        read_emphasis(path)


def test_far_arms_come_more_often(gl: str) -> None:
    def distances(emphasis: Emphasis) -> list[float]:
        order = make_order("wild", {"ur5": 8}, 4, (64, 53), 8, emphasis)
        rows = [d.row for d in draw_batch(order, range(8))]
        return [float(np.linalg.norm(row.T_camera_base[:3, 3])) for row in rows]

    plain, far = distances(Emphasis()), distances(FAR)
    assert sum(d > 1.5 for d in far) > sum(d > 1.5 for d in plain)
    # What had been far stays as it was.
    assert all(a == b for a, b in zip(plain, far) if a > 1.5)
