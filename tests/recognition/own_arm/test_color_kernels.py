"""The compiled loops for outlines against plain numpy and finite differences."""

import numpy as np

from armsight.geometry.pose import exp, inverse, look_at, transform
from armsight.recognition.own_arm.color_kernels import (
    INSET,
    UNEXPLAINED,
    bilinear,
    outline_equations,
    silhouette_agreement,
)

LENS = np.array([30.0, 31.0, 19.5, 14.5])


def slow_agreement(
    T: np.ndarray, points: np.ndarray, patches: np.ndarray, areas: np.ndarray, spacing: float
) -> float:
    """The same by whole images."""
    frames, h, w = patches.shape
    seen = np.zeros(patches.shape, bool)
    outside = 0
    for f in range(frames):
        for p in transform(T, points[f]):
            if p[2] < 0.2:
                outside += 1
                continue
            u, v = np.floor(LENS[:2] * p[:2] / p[2] + LENS[2:] + 0.5).astype(int)
            if not (0 <= u < w and 0 <= v < h):
                outside += 1
                continue
            r = int(0.5 * spacing * LENS[0] / p[2] + 0.3)
            seen[f, max(v - r, 0) : v + r + 1, max(u - r, 0) : u + r + 1] = True
    usual = 2 * seen.sum(axis=0) > frames
    asked = seen & ~usual
    hits = asked & (patches > 0)
    beside = 0
    for f in range(frames):
        touched = np.unique(patches[f][hits[f]])
        explained = int((seen[f] & (patches[f] > 0) & (usual | hits[f])).sum())
        beside += max(int(areas[f][touched].sum()) - explained, 0)
    if asked.sum() < 4 * frames:
        return 0.0
    share = 1 - outside / points[..., 0].size
    return float(share * 2 * hits.sum() / (asked.sum() + hits.sum() + UNEXPLAINED * beside))


def test_silhouettes_are_compared_as_by_whole_images() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.6], (4, 60, 3))
    patches = np.zeros((4, 30, 40), np.int64)
    for f in range(4):
        patches[f, 5 + f : 18, 8 : 20 + 2 * f] = 1
        patches[f, 20:26, 25:38] = 2
    areas = np.stack([np.bincount(p.ravel(), minlength=3) for p in patches])
    poses = []
    for _ in range(12):
        eye = rng.uniform([0.8, -0.8, 0.2], [1.4, 0.8, 1.0])
        poses.append(inverse(look_at(eye, rng.uniform(-0.3, 0.3, 3))))
    poses.append(inverse(look_at((1.0, 0.0, 0.3), (5.0, 0.0, 0.3))))  # the arm is behind it
    found = silhouette_agreement(np.stack(poses), points, patches, areas, LENS, 0.06)
    expected = [slow_agreement(T, points, patches, areas, 0.06) for T in poses]
    assert np.allclose(found, expected)
    assert found[:-1].max() > 0.3
    assert found[-1] == 0.0


def test_bilinear_is_exact_on_a_ramp() -> None:
    v, u = np.mgrid[0:8, 0:9].astype(np.float32)
    image = np.stack([2 * u + 3 * v], axis=-1)
    assert np.isclose(bilinear(image, 3.25, 4.5, 0), 2 * 3.25 + 3 * 4.5)


def edge_image() -> np.ndarray:
    """(60, 80, 4) a soft upright edge at u = 40: dark and moved to the left of it."""
    u = np.arange(80, dtype=np.float32)
    left = 1.0 / (1.0 + np.exp((u - 40.0) / 0.7))
    row = np.stack([200 - 150 * left, 180 - 120 * left, 90 + 0 * u, 255 * left], axis=-1)
    return np.ascontiguousarray(np.broadcast_to(row, (60, 80, 4)), np.float32)


def test_outline_finds_the_edge_and_its_equations_lead_there() -> None:
    lens = np.array([80.0, 80.0, 39.5, 29.5])
    u = 40.0 + np.array([-4.0, -2.0, 0.0, 1.0, 3.0])
    v = np.array([10.0, 20.0, 30.0, 40.0, 50.0])
    z = np.array([1.0, 1.2, 1.1, 0.9, 1.3])
    points = np.stack([(u - 39.5) / 80 * z, (v - 29.5) / 80 * z, z], axis=1)
    normals = np.tile([1.0, 0.0], (5, 1))
    H, g, found = np.zeros((1, 6, 6)), np.zeros((1, 6)), np.empty(5)
    group = np.zeros(5, np.int64)
    used = outline_equations(
        np.eye(4), points, normals, group, edge_image(), lens, 8, 50.0, 20.0, H, g, found
    )
    assert used == 5
    assert np.allclose(found, 40.0 - u - INSET, atol=0.15)
    # Residual: edge less projection, along the normal; weights hardly differ at this scale.
    step, weight = 1e-6, 1 / 50.0**2
    J = np.zeros((5, 6))
    for k in range(6):
        d = np.zeros(6)
        d[k] = step
        moved = transform(exp(d), points)
        J[:, k] = (80 * moved[:, 0] / moved[:, 2] + 39.5 - u) / step
    assert np.allclose(H[0], weight * J.T @ J, rtol=0.02, atol=1e-3)
    assert np.allclose(g[0], -weight * J.T @ found, rtol=0.02, atol=1e-4)


def test_no_edge_is_no_equation() -> None:
    flat = np.full((60, 80, 4), 90, np.float32)
    H, g, found = np.zeros((1, 6, 6)), np.zeros((1, 6)), np.empty(1)
    point, normal = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0]])
    lens = np.array([80.0, 80.0, 39.5, 29.5])
    used = outline_equations(
        np.eye(4), point, normal, np.zeros(1, np.int64), flat, lens, 8, 3.0, 20.0, H, g, found
    )
    assert used == 0
    assert np.isnan(found[0])
    assert not H.any()
