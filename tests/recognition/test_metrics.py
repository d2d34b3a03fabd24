"""Figures against their definitions, computed the slow way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.recognition import metrics


def test_masks_against_counting() -> None:
    rng = np.random.default_rng(0)
    estimate, truth = rng.random((2, 5, 7, 9)) < 0.4
    accuracy, iou = metrics.mask_accuracy(estimate, truth), metrics.mask_iou(estimate, truth)
    for n in range(5):
        right = both = either = 0
        for a, b in zip(estimate[n].ravel(), truth[n].ravel(), strict=True):
            right += a == b
            both += a and b
            either += a or b
        assert accuracy[n] == pytest.approx(right / 63)
        assert iou[n] == pytest.approx(both / either)


def test_two_empty_masks_agree() -> None:
    empty = np.zeros((1, 4, 4), bool)
    assert metrics.mask_iou(empty, empty)[0] == 1.0


@settings(deadline=None)
@given(st.lists(st.floats(0, 0.5), min_size=1, max_size=30))
def test_auc_is_the_area_under_the_curve(add: list[float]) -> None:
    steps = np.linspace(0, 0.1, 20001)
    share = np.searchsorted(np.sort(add), steps, side="right") / len(add)
    area = np.trapezoid(share, steps) / 0.1
    assert metrics.add_auc(np.array(add)) == pytest.approx(area, abs=1e-4)


def test_a_frame_without_an_answer_counts_in_full() -> None:
    assert metrics.add_auc(np.array([0.0, np.inf])) == 0.5
    assert metrics.share_over(np.array([0.0, np.inf, np.nan, 0.2])) == 0.75


def test_auc_of_nothing_is_no_figure() -> None:
    assert np.isnan(metrics.add_auc(np.array([])))


def test_points_joint_by_joint() -> None:
    truth = np.zeros((2, 3, 3))
    truth[1, 2] = np.nan
    estimate = truth + np.array([[[3.0, 0, 4], [0, 0, 1], [0, 2, 0]]])
    estimate[0, 1] = np.nan
    errors = metrics.point_errors(estimate, truth)
    np.testing.assert_allclose(errors[0], [5, np.inf, 2])
    np.testing.assert_allclose(errors[1], [5, 1, np.nan])
    np.testing.assert_allclose(metrics.frame_errors(errors), [np.inf, 3])


def test_recognised_needs_type_and_place() -> None:
    add = np.array([0.01, 0.01, 0.3, np.inf])
    right = np.array(["a", "b", "a", "a"])
    assert metrics.recognised(add, np.array(["a", "a", "a", "a"]), right) == 0.25


def test_bins_hold_every_value_once() -> None:
    rng = np.random.default_rng(3)
    by, values = rng.uniform(1, 3, 200), np.arange(200.0)
    bins = metrics.against(values, by, np.array([1.0, 1.5, 2.0, 3.0]))
    assert sorted(np.concatenate([v for _, _, v in bins])) == list(values)
