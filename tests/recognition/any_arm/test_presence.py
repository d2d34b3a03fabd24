"""What in a crop is an arm: cells, landmarks and type decide together."""

import numpy as np
import pytest

from armsight.recognition.any_arm.evidence import Surface
from armsight.recognition.any_arm.heat import Places
from armsight.recognition.any_arm.model import Look
from armsight.recognition.any_arm.presence import is_arm, is_speck, may_be_arm


def _look(clear: float, found: float, none: float, unknown: float) -> Look:
    """A look whose arm's cells, landmarks and types are as sure as that."""
    links = np.zeros((10, 12, 12), np.float32)
    links[0] = 1.0
    links[0, 4:8, 4:8], links[1, 4:8, 4:8] = 1.0 - clear, clear
    surface = Surface(links, np.zeros((12, 12, 3), np.float32), np.ones((12, 12), np.float32))
    places = Places(np.zeros((5, 2)), np.tile(np.eye(2), (5, 1, 1)), np.full(5, found))
    types = {"ur5": 1.0 - none - unknown, "none": none, "unknown": unknown}
    return Look(surface, {}, types, {"ur5": places})


@pytest.mark.parametrize(("clear", "found", "none", "unknown"), [
    (0.73, 0.31, 0.05, 0.06),  # in four numbers, arms of tuning frames that are surely none
    (0.83, 0.19, 0.02, 0.10),
    (0.88, 0.24, 0.01, 0.03),
    (0.84, 0.28, 0.01, 0.02),
])  # fmt: skip
def test_a_large_thing_of_a_sure_type_may_be_an_arm_with_doubtful_cells_or_landmarks(
    clear: float, found: float, none: float, unknown: float
) -> None:
    seen = _look(clear, found, none, unknown)
    assert not is_arm(seen, 1.0 / 3.0)
    assert may_be_arm(seen, 60.0)
    assert not may_be_arm(seen, 20.0)  # as small as a lamp


@pytest.mark.parametrize(("clear", "found", "none", "unknown"), [
    (0.72, 0.22, 0.11, 0.11),  # what empty rooms of tuning sets look like
    (0.68, 0.25, 0.07, 0.35),
    (0.63, 0.11, 0.11, 0.35),
    (0.76, 0.28, 0.13, 0.69),
    (0.95, 0.60, 0.60, 0.05),  # the network says that there is none
    (0.95, 0.10, 0.02, 0.02),  # a disc: all arm, no joints
])  # fmt: skip
def test_what_only_looks_a_little_like_one_is_none(
    clear: float, found: float, none: float, unknown: float
) -> None:
    seen = _look(clear, found, none, unknown)
    assert not is_arm(seen, 1.0 / 3.0)
    assert not may_be_arm(seen, 60.0)


def test_a_speck_that_nothing_speaks_for_is_no_arm() -> None:
    mask = np.zeros((100, 100), np.float32)
    mask[:6, :8] = 0.9  # 48 of 10,000
    assert is_speck(mask, 0.0)
    assert not is_speck(mask, 0.06)
    mask[6, :3] = 0.9
    assert not is_speck(mask, 0.0)
