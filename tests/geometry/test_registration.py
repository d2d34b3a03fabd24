import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armsight.geometry.pose import exp, transform
from armsight.geometry.registration import procrustes


@settings(max_examples=50, deadline=None)
@given(st.integers(3, 40), st.integers(0, 2**31))
def test_procrustes_recovers_an_exact_pose(n, seed):
    rng = np.random.default_rng(seed)
    T = exp(np.concatenate([rng.normal(size=3), rng.uniform(-1.7, 1.7, 3)]))
    source = rng.normal(size=(n, 3))
    np.testing.assert_allclose(procrustes(source, transform(T, source)), T, atol=1e-9)


def test_procrustes_is_the_best_rotation_even_for_mirrored_points():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(20, 3))
    target = source * [1, 1, -1]
    T = procrustes(source, target)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    best = ((transform(T, source) - target) ** 2).sum()
    for _ in range(200):  # no nearby pose is better
        other = T @ exp(rng.normal(size=6) * 0.01)
        assert ((transform(other, source) - target) ** 2).sum() >= best - 1e-9


def test_weights_silence_points():
    rng = np.random.default_rng(5)
    T = exp([0.1, 0.2, 0.3, 0.3, -0.2, 0.1])
    source = rng.normal(size=(10, 3))
    target = transform(T, source)
    target[0] += 5.0
    weights = np.ones(10)
    weights[0] = 0.0
    np.testing.assert_allclose(procrustes(source, target, weights), T, atol=1e-9)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (np.zeros((2, 3)), "at least 3"),
        (np.zeros((4, 2)), "shapes"),
        (np.outer(np.arange(5.0), [1, 2, 3]), "line"),
    ],
)
def test_procrustes_refuses(source, words):
    with pytest.raises(ValueError, match=words):
        procrustes(source, source)
