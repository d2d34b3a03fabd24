"""Two looks at one arm, brought together: places known in both crops."""

import numpy as np

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.any_arm.evidence import Evidence, log_places, surface_of, together
from armsight.recognition.any_arm.heat import read_heat
from armsight.recognition.any_arm.views import FIRST, SIDE, Crop, take_crop

CELLS = SIDE // 4
LENS = PinholeCamera(640, 480, 520.0, 520.0, 330.0, 235.0)
IMAGE = np.zeros((480, 640, 3), np.uint8)
OUTSIDE = np.array([-30.0], np.float32)


def _crops() -> tuple[Crop, Crop]:
    """As in use: the first one has fewer pixels."""
    wide = take_crop(IMAGE, LENS, np.array([150.0, 100.0]), np.array([450.0, 380.0]), 1.3, FIRST)
    near = take_crop(IMAGE, LENS, np.array([240.0, 160.0]), np.array([420.0, 330.0]), 1.3)
    return wide, near


def _evidence(
    at: np.ndarray,
    sigma: float,
    types: tuple[float, ...] = (2.0, 0.0, 0.0),
    arm: float = 0.0,
    cells: int = CELLS,
) -> Evidence:
    """A landmark's Gaussian about a pixel, and an arm of one logit everywhere."""
    column, row = np.meshgrid(np.arange(cells), np.arange(cells))
    x, y = (at - 1.5) / 4
    heat = -0.5 * ((column - x) ** 2 + (row - y) ** 2) / sigma**2
    places, outside = log_places(heat[None].astype(np.float32), OUTSIDE)
    links = np.zeros((10, cells, cells), np.float32)
    links[0] = -arm
    blank = np.zeros((3, cells, cells), np.float32)
    logits = np.array(types)
    return Evidence(
        surface_of(links, blank, blank[0]),
        {},
        {"ur5": places},
        {"ur5": outside},
        logits - np.log(np.exp(logits).sum()),
        {},
    )


def test_a_point_of_one_crop_is_found_in_the_other() -> None:
    wide, near = _crops()
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 1.5], [0.2, 0.2, 2.5], (20, 3))
    pixels = np.hstack([near.pixels(points), np.ones((20, 1))]) @ near.onto(wide).T
    np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:], wide.pixels(points), atol=1e-9)


def test_looks_that_agree_say_it_in_the_second_crop() -> None:
    wide, near = _crops()
    point = np.array([[0.02, 0.05, 2.0]])
    a, b = wide.pixels(point)[0], near.pixels(point)[0]
    one = _evidence(b, 1.2)
    other = _evidence(a, 1.2 * wide.f / near.f, cells=FIRST // 4)
    both = together(other, one, near.onto(wide))
    found = read_heat(both.heat["ur5"], both.outside["ur5"])
    np.testing.assert_allclose(found.mean[0] * 4 + 1.5, b, atol=0.3)
    alone = read_heat(one.heat["ur5"], one.outside["ur5"])
    np.testing.assert_allclose(found.covariance[0], alone.covariance[0], rtol=0.15, atol=0.02)
    assert found.mass[0] > 0.95


def test_looks_that_disagree_are_unsure() -> None:
    first, second = _evidence(np.array([40.0, 60.0]), 1.0), _evidence(np.array([120.0, 60.0]), 1.0)
    both = together(first, second, np.eye(3))
    found = read_heat(both.heat["ur5"], both.outside["ur5"])
    alone = read_heat(second.heat["ur5"], second.outside["ur5"])
    np.testing.assert_allclose(found.mass, 0.5 * alone.mass, rtol=1e-3)
    assert np.trace(found.covariance[0]) > 2.0 * np.trace(alone.covariance[0])


def test_where_the_first_did_not_look_the_second_one_speaks() -> None:
    wide, near = _crops()
    first, second = (
        _evidence(np.array([80.0, 80.0]), 2.0, arm=4.0),
        _evidence(np.array([80.0, 80.0]), 2.0, cells=FIRST // 4),
    )
    both = together(first, second, wide.onto(near))  # the second crop is the wider one here
    corner, middle = both.surface.links[0, 0, 0], both.surface.links[0, FIRST // 8, FIRST // 8]
    assert corner == second.surface.links[0, 0, 0]
    np.testing.assert_allclose(
        middle, 0.5 * (first.surface.links[0, 0, 0] + second.surface.links[0, 0, 0]), rtol=1e-5
    )


def test_the_types_of_two_looks_are_probabilities_between_theirs() -> None:
    at = np.array([80.0, 80.0])
    first, second = _evidence(at, 2.0, (3.0, 0.0, 0.0)), _evidence(at, 2.0, (0.0, 1.0, 0.0))
    types = np.exp(together(first, second, np.eye(3)).types)
    np.testing.assert_allclose(types.sum(), 1.0)
    assert np.exp(second.types[0]) < types[0] < np.exp(first.types[0])
