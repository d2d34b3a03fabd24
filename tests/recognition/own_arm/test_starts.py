"""Where searches begin: a beam that keeps unlike poses, and cameras that are held upright."""

import numpy as np

from armsight.geometry.pose import exp
from armsight.recognition.own_arm.color_search import ROTATIONS, UPRIGHT, upright_rotations
from armsight.recognition.own_arm.starts import Narrowing, narrowed

PIVOT = np.array([0.0, 0.0, 0.5])


def poses(places: list[float]) -> np.ndarray:
    return np.stack([exp([x, 0.0, 2.0, 0.0, 0.0, 0.0]) for x in places])


def score(candidates: np.ndarray) -> np.ndarray:
    """Two hills: a high one at x = 0, a low one at x = 1; whoever turns loses."""
    x = candidates[:, 0, 3]
    turned = 3.0 - np.trace(candidates[:, :3, :3], axis1=1, axis2=2)
    high, low = np.exp(-(x**2) / 0.08), 0.6 * np.exp(-((x - 1.0) ** 2) / 0.08)
    return np.asarray(np.maximum(high, low) - 1e5 * turned)


def test_many_ways_up_one_hill_do_not_crowd_out_another() -> None:
    many = poses([*np.linspace(-0.2, 0.2, 40), 1.1])
    plain = Narrowing(0.03, 0.01, 0.0, 0, 8, 8)
    alike, _ = narrowed(many, PIVOT, score, plain, np.random.default_rng(0))
    assert np.abs(alike[:, 0, 3]).max() < 0.3
    unlike = Narrowing(0.1, 0.05, 0.0, 0, 8, 8, apart=True)
    kept, values = narrowed(many, PIVOT, score, unlike, np.random.default_rng(0))
    assert np.abs(kept[:, 0, 3] - 1.0).min() < 0.15
    assert (np.diff(values) <= 0).all()
    # None has a better one within the changes' size; what is turned is another pose.
    places = kept[:, :3, :3] @ PIVOT + kept[:, :3, 3]
    for k in range(1, len(kept)):
        near = np.linalg.norm(places[:k] - places[k], axis=1) < 0.1
        cosine = 0.5 * (np.einsum("nij,ij->n", kept[:k, :3, :3], kept[k, :3, :3]) - 1.0)
        assert not (near & (cosine > np.cos(0.05))).any()


def test_upright_cameras_see_the_arm_stand() -> None:
    rotations = upright_rotations(np.random.default_rng(1))
    assert len(rotations) == ROTATIONS
    up = rotations @ [0.0, 0.0, 1.0]
    assert np.abs(up[:, 0]).max() < UPRIGHT[0]
    assert up[:, 1].max() < UPRIGHT[1]
    # All directions that such a camera can look in: along the horizon and straight down.
    assert up[:, 2].min() < -0.95
    assert up[:, 2].max() > 0.95
