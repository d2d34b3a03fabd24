"""The danger-map experiment: its parts against plain definitions, on small data."""

import numpy as np
import pytest

from armsight.experiments import danger_map as d
from armsight.experiments import forecast_clips as c
from armsight.mapping.danger import ALPHA, decay_time
from armsight.mapping.forecast import FEATURES, SHIPPED


def test_auc_and_brier_against_their_definitions():
    rng = np.random.default_rng(0)
    p, y = np.round(rng.random(80), 1), rng.random(80) < 0.3  # rounded: there are ties
    pairs = [(a > b) + 0.5 * (a == b) for a in p[y] for b in p[~y]]
    assert c.auc(p, y) == pytest.approx(np.mean(pairs))
    assert c.brier(p, y) == pytest.approx(np.mean([(a - b) ** 2 for a, b in zip(p, y)]))
    assert np.isnan(c.auc(p, np.zeros(80)))


@pytest.mark.parametrize("reading", d.READINGS)
def test_mean_on_a_circle_is_that_of_one_visit_a_round(reading):
    """A voxel visited once in 44.85 s has the mean that its visits and the decay give."""
    outer = d.drive_circles(20, reading).on(d.RADII[2])
    expected = d.mean_between_visits(sum(d.PERIODS))
    assert np.median(outer) == pytest.approx(expected, abs=0.04)


def test_hiding_the_inner_area_raises_the_inner_circle_alone():
    seen, hidden = (d.drive_circles(3, r) for r in d.READINGS[1:])
    assert hidden.on(d.RADII[0]).mean() > seen.on(d.RADII[0]).mean() + 0.2
    np.testing.assert_allclose(hidden.on(d.RADII[2]), seen.on(d.RADII[2]))


def test_mean_between_visits():
    assert d.mean_between_visits(0.5) == pytest.approx(0.999)
    long = 100 * decay_time()
    one_decay = d.mean_between_visits(decay_time(), stay=0.0) * decay_time()
    assert d.mean_between_visits(long, stay=0.0) == pytest.approx(one_decay / long, rel=0.02)


def test_decay_does_not_hang_on_the_rate():
    by_age, stepped = d.decay_times((5.0, 30.0, 120.0))
    np.testing.assert_allclose(by_age, decay_time(ALPHA), atol=0.01)
    assert np.ptp(stepped) > 0.05


def test_a_person_fills_the_voxels_that_its_capsules_touch():
    joints = np.tile([1.6, 0.0, 1.0], (19, 1))  # all in one place: balls
    occupied = c.body_occupancy(joints)
    centers = c.GRID.center(np.argwhere(np.ones(c.GRID.shape, bool)))
    near = np.linalg.norm(centers - joints[0], axis=1) < max(c.RADII.values()) + 0.025
    np.testing.assert_array_equal(occupied.reshape(-1), near)
    assert not c.body_occupancy(joints + 50.0).any()


def test_forecasts_are_judged_on_clips_that_the_model_has_not_seen():
    """A feature that tells the outcome in one clip and lies in the other gives no skill."""
    rng = np.random.default_rng(0)
    n = 4000
    features = np.column_stack([np.ones(2 * n), *rng.standard_normal((len(FEATURES) - 1, 2 * n))])
    clip = np.repeat([0, 1], n)
    outcome = (features[:, 1] > 0) == (clip == 0)
    samples = c.Samples(features, np.zeros(2 * n), np.zeros(2 * n), outcome.astype(np.uint8), clip)
    forecast = c.cross_validated(samples, rng)
    assert c.auc(forecast, samples.outcome) < 0.2


def test_recorded_people(shared_data):
    """The shipped weights on one clip (of those they are fitted to) against T2's rule."""
    folder = shared_data / "motion" / "human_motion"
    if not folder.is_dir():
        pytest.skip("no motion clips in ../shared/data")
    paths = sorted(folder.glob("*/*.csv.gz"))[:1]
    samples, names = c.gather(paths, 0, lambda stage, share: None)
    assert len(names) == 1
    free = samples.occupied == 0
    ours = SHIPPED.probability(samples.features, samples.occupied)[free]
    paper, outcome = samples.paper[free], samples.outcome[free]
    assert c.auc(ours, outcome) > c.auc(paper, outcome)
    assert c.brier(ours, outcome) < 0.6 * c.brier(paper, outcome)
