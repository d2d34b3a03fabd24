"""Signed distances of declared solids against dense sampling of their surfaces."""

import numpy as np
import pytest

from armsight.geometry.pose import from_rpy, transform
from armsight.geometry.shapes import Solid

T = from_rpy([0.4, -0.3, 1.2], [0.5, 0.2, -0.1])


def surface(solid, rng, n=60_000):
    """(n, 3) points on the surface in the owner's frame, made without using distances."""
    if solid.kind == "sphere":
        d = rng.normal(size=(n, 3))
        local = d / np.linalg.norm(d, axis=1, keepdims=True) * solid.size[0]
    elif solid.kind == "box":
        local = rng.uniform(-0.5, 0.5, (n, 3))
        face = rng.integers(0, 3, n)
        local[np.arange(n), face] = rng.choice([-0.5, 0.5], n)
        local *= solid.size
    else:
        a, r = rng.uniform(0, 2 * np.pi, n), solid.size[0]
        side = rng.random(n) < 0.5
        rr = np.where(side, r, r * np.sqrt(rng.random(n)))
        half = 0.5 * solid.size[1]
        z = np.where(side, rng.uniform(-half, half, n), rng.choice([-half, half], n))
        local = np.column_stack([rr * np.cos(a), rr * np.sin(a), z])
    return transform(solid.T_frame_solid, local)


@pytest.mark.parametrize(
    "solid",
    [
        Solid("b", "box", (0.3, 0.2, 0.5), T),
        Solid("c", "cylinder", (0.15, 0.4, 0.0), T),
        Solid("s", "sphere", (0.2, 0.0, 0.0), T),
    ],
)
def test_distance_is_that_to_the_nearest_surface_point(solid):
    rng = np.random.default_rng(1)
    points = transform(T, rng.uniform(-0.5, 0.5, (100, 3)))
    samples = surface(solid, rng)
    nearest = np.array([np.linalg.norm(samples - p, axis=1).min() for p in points])
    distance = solid.distance(points)
    np.testing.assert_allclose(np.abs(distance), nearest, atol=6e-3)
    center = solid.distance(T[:3, 3][None])
    assert center[0] < 0
    assert (distance > 0).any()
