"""A mask by cells, brought to the edges of its picture."""

import numpy as np
import pytest

from armsight.recognition.any_arm.edges import COLUMNS, ROWS, _solved, at_edges

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


def test_systems_of_three_are_solved_as_lapack_solves_them() -> None:
    rng = np.random.default_rng(5)
    half = rng.normal(size=(7, 9, 3, 3))
    whole = half @ np.swapaxes(half, 2, 3) + 1e-3 * np.eye(3)
    right = rng.normal(size=(7, 9, 3)).astype(np.float32)
    found = _solved(whole[..., ROWS, COLUMNS], right)
    np.testing.assert_allclose(found, np.linalg.solve(whole, right[..., None])[..., 0], rtol=1e-4)
