"""Where the pair takes over, what is servoed to goes on; where the target went, it goes at once."""

import numpy as np
import pytest

from armsight.servoing.estimate import TargetEstimate
from armsight.servoing.takeover import Takeover


def estimate(stamp: float, position: np.ndarray) -> TargetEstimate:
    """Of a target that moves at 0.1 m/s along x."""
    velocity = np.array([0.1, 0.0, 0.0])
    return TargetEstimate(
        stamp, position, velocity, np.zeros(3), np.eye(6), 1e6, 0.2, np.array([1.0])
    )


def course(correction: float) -> tuple[np.ndarray, np.ndarray]:
    """Places servoed to, tick by tick, and steps between; the 20th look corrects by so much."""
    takeover, places = Takeover(), []
    for k in range(80):
        now = 0.008 * k
        off = np.array([0.0, correction if k >= 20 else 0.0, 0.0])
        known = estimate(now - 0.08, np.array([0.1 * (now - 0.08), 0.0, 0.5]) + off)
        places.append(known.at(now)[0] + takeover.update(now, known))
    return np.array(places), np.linalg.norm(np.diff(places, axis=0), axis=1)


@pytest.mark.parametrize("correction", [0.003, 0.006, 0.009])
def test_what_a_look_corrects_is_passed_on_without_a_jump(correction: float) -> None:
    places, steps = course(correction)
    own = 0.1 * 0.008
    assert steps.max() < own + 0.3 * correction
    assert steps.min() > 0.9 * own, "it goes on with the target meanwhile"
    assert np.abs(places[-1] - [0.1 * 0.008 * 79, correction, 0.5]).max() < 1e-6


def test_a_target_that_went_elsewhere_is_followed_at_once() -> None:
    _, steps = course(0.012)
    assert steps.max() > 0.0119
