"""How far answers are believed: the promise holds on each set that it was chosen on."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.recognition.any_arm.learning.trusting import WRONG, Judged, choose_trust
from armsight.recognition.any_arm.trust import FEATURES, GAP, LEAD, features, read_trust


def _judged(n: int, shift: float, seed: int) -> Judged:
    """Answers whose chance to be good rises with one feature; ``shift``: of that feature."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, len(FEATURES)))
    x[:, 0] = 1.0
    good = rng.random(n) < 1.0 / (1.0 + np.exp(-4.0 * (x[:, 2] - shift)))
    return Judged(x, np.where(good, 0.02, 0.5), rng.chisquare(3, (n, 4)))


def test_the_promise_holds_elsewhere_too() -> None:
    here, there = _judged(600, 0.0, 1), _judged(200, 1.0, 2)
    alone, _ = choose_trust(here)
    both, figures = choose_trust(here, there)
    assert (figures["frames"], figures["elsewhere"]) == (800, 200)
    for judged in (here, there):
        sure = np.array([both.of(f) for f in judged.features]) >= both.threshold
        assert sure.any()
        assert (judged.error[sure] > 0.1).mean() <= WRONG
    believed = np.array([alone.of(f) for f in there.features]) >= alone.threshold
    assert (there.error[believed] > 0.1).mean() > WRONG


def test_a_type_that_hardly_leads_says_less_than_one_that_leads_far() -> None:
    narrow, wide = (features(9.0, 30, 0.8, 0.9, 0.7, 0.05, lead, 9.0) for lead in (0.0, 5 * LEAD))
    at = FEATURES.index("lead")
    assert (narrow[at], wide[at]) == (-0.5, 0.5)
    np.testing.assert_array_equal(np.delete(narrow, at), np.delete(wide, at))


def test_a_pose_beside_another_that_explains_as_much_says_less() -> None:
    narrow, wide = (features(9.0, 30, 0.8, 0.9, 0.7, 0.05, 5.0, gap) for gap in (0.0, 5 * GAP))
    at = FEATURES.index("gap")
    assert (narrow[at], wide[at]) == (-0.5, 0.5)
    np.testing.assert_array_equal(np.delete(narrow, at), np.delete(wide, at))


@pytest.mark.parametrize("fewer", [0, 1, 2])
def test_a_card_from_before_the_last_features_gives_them_no_weight(fewer: int) -> None:
    weights = [0.1 * k for k in range(len(FEATURES) - fewer)]
    trust = read_trust({"trust": {"weights": weights, "threshold": 0.5, "widen": 1.5}})
    assert trust.weights == (*weights, *[0.0] * fewer)


@pytest.mark.parametrize("count", [0, len(FEATURES) - 3, len(FEATURES) + 1])
def test_a_card_with_too_few_or_too_many_weights_is_damaged(count: int) -> None:
    with pytest.raises(ValueError):
        read_trust({"trust": {"weights": [0.1] * count, "threshold": 0.5, "widen": 1.5}})


def test_where_no_threshold_keeps_the_promise_nothing_is_believed() -> None:
    """All answers are wrong, or there are none; or the one that would do lies very high."""
    wrong = replace(_judged(100, 0.0, 3), error=np.full(100, 0.5))
    nothing = Judged(np.empty((0, len(FEATURES))), np.empty(0), np.empty(0))
    for judged in (wrong, nothing):
        trust, figures = choose_trust(judged)
        assert trust.threshold == 1.0
        assert figures["believed"] == 0.0
        assert trust.of(np.full(len(FEATURES), 1e6)) < trust.threshold
        assert all(np.isfinite(v) for v in figures.values())
        assert read_trust({"trust": vars(trust)}) == trust
    x = np.zeros((60, len(FEATURES)))
    x[:, 0], x[:, 2] = 1.0, np.linspace(0.0, 60.0, 60)
    high = Judged(x, np.where(np.arange(60) > 50, 0.02, 0.5), np.ones((60, 4)))
    trust, _ = choose_trust(high)
    sure = np.array([trust.of(f) for f in high.features]) >= trust.threshold
    assert sure.any()
    assert (high.error[sure] > 0.1).mean() <= WRONG


def test_a_network_whose_trust_was_never_chosen_is_not_believed() -> None:
    trust = read_trust({})
    best = features(0.0, 30, 1.0, 1.0, 1.0, 0.001, LEAD, GAP)
    assert 0.99 < trust.of(best) < trust.threshold
