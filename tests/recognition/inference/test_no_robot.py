"""The share of a picture below which no robot is said: chosen rightly, believed only if sane."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.errors import RecognitionError
from armsight.recognition.inference.model import Model
from armsight.recognition.inference.no_robot import (
    DEFAULT_SHARE,
    LARGEST_SHARE,
    choose_share,
)
from armsight.recognition.inference.pictures import Picture
from armsight.recognition.inference.recogniser import Recogniser

from .conftest import card, network

SHARES = st.lists(st.integers(0, 40).map(lambda n: n / 200), min_size=1, max_size=12)


def rate(cut: float, without: np.ndarray, shown: np.ndarray) -> float:
    return float((without < cut).mean() + (shown >= cut).mean())


@settings(deadline=None)
@given(SHARES, SHARES)
def test_no_other_share_tells_better(empty: list[float], arms: list[float]) -> None:
    without, shown = np.array(empty), np.array(arms)
    best = max(rate(cut, without, shown) for cut in np.linspace(0, LARGEST_SHARE, 401))
    cut = choose_share(without, shown)
    assert 0.0 <= cut <= LARGEST_SHARE
    assert rate(cut, without, shown) >= best - 1e-9


def test_between_two_pictures_the_middle_is_taken() -> None:
    assert choose_share(np.array([0.0, 0.01]), np.array([0.03, 0.1])) == pytest.approx(0.02)


def test_arms_that_look_like_nothing_are_not_overlooked_for_nothing() -> None:
    assert choose_share(np.array([0.05, 0.06]), np.array([0.01, 0.02])) == 0.0


def test_both_kinds_of_pictures_are_needed() -> None:
    with pytest.raises(ValueError, match="without and with"):
        choose_share(np.array([]), np.array([0.1]))


@pytest.mark.parametrize(("share", "found"), [(0.04, True), (0.06, False)])
def test_the_card_says_which_share(tmp_path: Path, share: float, found: bool) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(network(about={**card(), "no_robot": {"share": share}}))
    image = np.zeros((53, 64, 3), np.uint8)
    image[20:30, 10:27] = 255  # 5.0 % of it
    answer = Recogniser(Model(file)).recognise(Picture("a", image))
    assert (answer.robot is not None) is found


def test_a_card_without_one_has_the_default(network_file: Path) -> None:
    assert Model(network_file).no_robot_share == DEFAULT_SHARE


@pytest.mark.parametrize(
    "named",
    [None, 0.1, {}, *({"share": s} for s in (-0.01, 0.5, True, "0.1", None, [0.1], 10**400))],
)
def test_an_absurd_share_is_refused(tmp_path: Path, named: Any) -> None:
    file = tmp_path / "a.onnx"
    file.write_bytes(network(about={**card(), "no_robot": named}))
    with pytest.raises(RecognitionError, match="names no share") as caught:
        Model(file)
    assert "\n" not in str(caught.value)
