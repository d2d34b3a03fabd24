"""Schedules, saturation and batches: the parts of a training that decide its course."""

import numpy as np
import pytest

from armsight.recognition.training.batches import Batches
from armsight.recognition.training.schedule import Saturation, SaturationRule, ramp


def test_ramps_begin_and_end_where_they_should() -> None:
    for fall in ("linear", "geometric"):
        assert ramp((1e-3, 1e-6), 0.0, fall) == pytest.approx(1e-3)
        assert ramp((1e-3, 1e-6), 1.0, fall) == pytest.approx(1e-6)
        assert ramp((1e-3, 1e-6), 7.0, fall) == pytest.approx(1e-6)
    assert ramp((0.9, 0.999), 0.5) == pytest.approx(0.9495)
    assert ramp((1e-2, 1e-6), 0.5, "geometric") == pytest.approx(1e-4)


def ends_at(losses: list[float], rule: SaturationRule) -> int | None:
    watch = Saturation(rule)
    for k, loss in enumerate(losses, 1):
        if watch.saturated(loss):
            return k
    return None


def test_a_falling_loss_does_not_saturate() -> None:
    falling = list(np.exp(-np.arange(400) / 50))
    assert ends_at(falling, SaturationRule(10, 2, 0.01)) is None


def test_a_flat_loss_saturates_after_its_patience() -> None:
    losses = [*np.linspace(5, 1, 50), *[1.0] * 100]
    # Windows of 10; the first flat one still improves, the next three do not.
    assert ends_at(losses, SaturationRule(10, 3, 0.01)) == 90


def test_noise_that_falls_slowly_is_improvement() -> None:
    rng = np.random.default_rng(0)
    losses = np.linspace(2, 1, 500) + rng.normal(0, 0.3, 500)
    assert ends_at(list(losses), SaturationRule(50, 3, 0.01)) is None


def test_a_rule_without_a_window_never_ends() -> None:
    assert ends_at([1.0] * 1000, SaturationRule(0)) is None


def test_saturation_goes_on_exactly_from_its_state() -> None:
    rng = np.random.default_rng(1)
    losses = list(1 + rng.random(300))
    rule = SaturationRule(7, 4, 0.02)
    whole = Saturation(rule)
    said = [whole.saturated(v) for v in losses]
    first = Saturation(rule)
    again = [first.saturated(v) for v in losses[:100]]
    second = Saturation(rule, first.state())
    assert again + [second.saturated(v) for v in losses[100:]] == said


@pytest.mark.parametrize(("count", "size"), [(10, 3), (7, 7), (5, 16), (1, 1)])
def test_each_pass_takes_every_sample_once(count: int, size: int) -> None:
    batches = Batches(count, size, seed=3, stage=0)
    taken = np.concatenate([batches[k] for k in range(3 * count)])
    assert all(len(batches[k]) == size for k in range(3))
    for n in range(len(taken) // count):
        assert sorted(taken[n * count : (n + 1) * count]) == list(range(count))


def test_batches_do_not_depend_on_what_was_asked_before() -> None:
    one, other = (Batches(50, 8, 5, 1) for _ in range(2))
    for k in range(40):
        one[k]
    assert np.array_equal(one[40], other[40])
    assert np.array_equal(one[2], other[2])


def test_stages_and_seeds_differ() -> None:
    orders = [tuple(Batches(50, 50, s, g)[0]) for s, g in ((0, 0), (0, 1), (1, 0))]
    assert len(set(orders)) == 3
