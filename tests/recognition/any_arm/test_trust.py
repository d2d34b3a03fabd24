"""How far answers are believed: the promise holds on each set that it was chosen on."""

import numpy as np
import pytest

from armsight.recognition.any_arm.learning.trusting import WRONG, Judged, choose_trust
from armsight.recognition.any_arm.trust import FEATURES, LEAD, features, read_trust


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
    narrow, wide = (features(9.0, 30, 0.8, 0.9, 0.7, 0.05, lead, 0.5) for lead in (0.0, 5 * LEAD))
    at = FEATURES.index("lead")
    assert narrow[at] == -0.5
    assert wide[at] == 0.5
    np.testing.assert_array_equal(np.delete(narrow, at), np.delete(wide, at))


@pytest.mark.parametrize("lacking", [1, 2])
def test_a_card_from_before_the_last_features_gives_them_no_weight(lacking: int) -> None:
    weights = [0.1 * k for k in range(len(FEATURES) - 2)]
    given = weights + [0.7] * (2 - lacking)
    trust = read_trust({"trust": {"weights": given, "threshold": 0.5, "widen": 1.5}})
    assert trust.weights == (*given, *[0.0] * lacking)
    with pytest.raises(ValueError):
        read_trust({"trust": {"weights": weights[:-1], "threshold": 0.5, "widen": 1.5}})
