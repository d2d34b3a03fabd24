"""Places read off heat maps against distributions that are known."""

import numpy as np

from armsight.recognition.any_arm.heat import GRAIN, read_heat


def _spot(x: float, y: float, sx: float, sy: float, side: int = 40) -> np.ndarray:
    column, row = np.meshgrid(np.arange(side), np.arange(side))
    return (-0.5 * (((column - x) / sx) ** 2 + ((row - y) / sy) ** 2)).astype(np.float32)


def test_a_gaussian_gives_its_mean_and_covariance() -> None:
    found = read_heat(_spot(12.3, 25.8, 1.2, 0.7)[None], np.array([-30.0], np.float32))
    np.testing.assert_allclose(found.mean[0], [12.3, 25.8], atol=0.02)
    wanted = np.diag([1.2**2 + GRAIN, 0.7**2 + GRAIN])
    np.testing.assert_allclose(found.covariance[0], wanted, atol=0.06)
    assert found.mass[0] > 0.99


def test_of_two_peaks_the_higher_is_taken_and_is_less_sure() -> None:
    heat = np.logaddexp(_spot(8, 8, 1, 1), _spot(30, 30, 1, 1) + np.log(1.5).astype(np.float32))
    found = read_heat(heat[None], np.array([-30.0], np.float32))
    np.testing.assert_allclose(found.mean[0], [30, 30], atol=0.05)
    np.testing.assert_allclose(found.mass[0], 0.6, atol=0.01)
    alone = read_heat(_spot(30, 30, 1, 1)[None], np.array([-30.0], np.float32))
    assert np.trace(found.covariance[0]) > 2 * np.trace(alone.covariance[0])


def test_what_lies_outside_has_no_mass() -> None:
    found = read_heat(np.zeros((1, 40, 40), np.float32), np.array([20.0], np.float32))
    assert found.mass[0] < 1e-4
    assert np.isfinite(found.mean).all()
    assert np.isfinite(found.covariance).all()
