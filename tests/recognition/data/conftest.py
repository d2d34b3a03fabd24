"""Two tiny sets, rendered once."""

from pathlib import Path

import pytest

from armsight.recognition.data.generate import generate
from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.order import make_order
from armsight.recognition.data.sample import KNOWN_ROBOTS


@pytest.fixture(scope="session")
def paper_like(gl: str, tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    """Three samples of each robot, 192 x 159, two shards."""
    folder = tmp_path_factory.mktemp("sets") / "paper_like"
    order = make_order("paper-like", dict.fromkeys(KNOWN_ROBOTS, 3), 11, (192, 159), 8)
    generate(order, folder)
    return LabelledSet.open(folder)


@pytest.fixture(scope="session")
def wild(gl: str, tmp_path_factory: pytest.TempPathFactory) -> LabelledSet:
    """Two samples of each robot, two without, two of unknown arms, 192 x 159."""
    folder: Path = tmp_path_factory.mktemp("sets") / "wild"
    counts = dict.fromkeys((*KNOWN_ROBOTS, "none", "unknown"), 2)
    generate(make_order("wild", counts, 12, (192, 159), 1000), folder)
    return LabelledSet.open(folder)
