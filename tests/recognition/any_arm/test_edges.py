"""A mask by cells, brought to the edges of its picture."""

import numpy as np
import pytest

from armsight.recognition.any_arm.edges import COLUMNS, ROWS, at_edges
from armsight.recognition.any_arm.pixel_kernels import guided

SIDE, CELL = 160, 4


def _disc(radius: float) -> np.ndarray:
    y, x = np.mgrid[:SIDE, :SIDE]
    return np.hypot(x - 83.0, y - 71.0) < radius


def _picture(thing: np.ndarray, contrast: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    image = np.full((SIDE, SIDE, 3), 90.0)
    image[thing] += [contrast, -contrast, 0.5 * contrast]
    return np.clip(image + rng.normal(0.0, 5.0, image.shape), 0, 255).astype(np.uint8)


def _cells(thing: np.ndarray) -> np.ndarray:
    return thing.reshape(SIDE // CELL, CELL, SIDE // CELL, CELL).mean((1, 3)).astype(np.float32)


def _overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("radius", [6.0, 25.0, 50.0])
def test_the_mask_ends_where_the_colour_does(radius: float) -> None:
    thing = _disc(radius)
    # A network is off by a cell: what it says is moved.
    said = np.roll(_cells(thing), 1, axis=1)
    raw = np.kron(said, np.ones((CELL, CELL))) > 0.5
    found = at_edges(said, _picture(thing, 60)) > 0.5
    assert _overlap(found, thing) > 0.5 * (1.0 + _overlap(raw, thing))


def test_without_an_edge_in_the_picture_the_mask_stays_about_where_it_was() -> None:
    thing = _disc(40.0)
    found = at_edges(_cells(thing), np.full((SIDE, SIDE, 3), 127, np.uint8))
    assert found.shape == (SIDE, SIDE)
    assert found.min() >= 0.0
    assert found.max() <= 1.0
    assert _overlap(found > 0.5, thing) > 0.85


def test_nothing_stays_nothing() -> None:
    none = np.zeros((SIDE // CELL, SIDE // CELL), np.float32)
    assert at_edges(none, _picture(_disc(30.0), 80)).max() < 1e-3


def test_a_window_is_fitted_as_least_squares_fit_it() -> None:
    """Of many colours and a mask the moments; the line through them is numpy's."""
    rng = np.random.default_rng(5)
    colours = rng.uniform(size=(4, 5, 60, 3))
    mask = colours @ [0.5, -0.3, 0.2] + 0.1 + 0.05 * rng.normal(size=(4, 5, 60))
    mean, mean_p = colours.mean(2), mask.mean(2)
    pairs = (colours[..., ROWS] * colours[..., COLUMNS]).mean(2)
    products = (colours * mask[..., None]).mean(2)
    slope, offset = np.empty((4, 5, 3), np.float32), np.empty((4, 5), np.float32)
    moments = [x.astype(np.float32) for x in (mean, mean_p, pairs, products)]
    guided(*moments, 0.0, slope, offset)
    for row, column in np.ndindex(4, 5):
        design = np.hstack([colours[row, column], np.ones((60, 1))])
        true = np.linalg.lstsq(design, mask[row, column], rcond=None)[0]
        np.testing.assert_allclose(slope[row, column], true[:3], atol=1e-4)
        np.testing.assert_allclose(offset[row, column], true[3], atol=1e-4)
