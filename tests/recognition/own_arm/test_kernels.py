"""The compiled loops against plain numpy and finite differences."""

import numpy as np

from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, look_at, transform
from armsight.recognition.own_arm.kernels import (
    agreement,
    lens_array,
    normal_equations,
    project,
    rasterise,
)

LENS = PinholeCamera(24, 18, 20.0, 21.0, 11.0, 9.0, (0.1, -0.05, 0.002, -0.001, 0.01))


def ray_depth(vertices: np.ndarray, faces: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """(h, w) nearest hit of each pixel's ray with the fronts of triangles, by solving for it."""
    out = np.full((18, 24), np.inf)
    for a, b, c in vertices[faces]:
        n = np.cross(b - a, c - a)
        for v in range(18):
            for u in range(24):
                ray = np.array([(u - lens[2]) / lens[0], (v - lens[3]) / lens[1], 1.0])
                if n @ ray >= 0:
                    continue
                s, t, z = np.linalg.solve(np.column_stack([b - a, c - a, -ray]), -a)
                if s >= 0 and t >= 0 and s + t <= 1 and z > 0:
                    out[v, u] = min(out[v, u], z)
    return out


def test_projection_is_that_of_the_camera() -> None:
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 1.0], [0.5, 0.4, 2.0], (20, 3))
    found = [project(x / z, y / z, lens_array(LENS)) for x, y, z in points]
    assert np.allclose(found, LENS.project(points), atol=1e-9)


def test_rasteriser_finds_what_rays_hit() -> None:
    rng = np.random.default_rng(1)
    vertices = rng.uniform([-0.6, -0.5, 1.0], [0.6, 0.5, 2.5], (24, 3))
    faces = np.arange(24).reshape(8, 3)
    lens = np.array([20.0, 21.0, 11.0, 9.0, 0, 0, 0, 0, 0])
    depth = np.full((18, 24), np.inf, np.float32)
    face = np.full((18, 24), -1, np.int32)
    rasterise(vertices, faces, lens, 0.1, depth, face)
    expected = ray_depth(vertices, faces, lens)
    assert np.array_equal(np.isfinite(depth), np.isfinite(expected))
    hit = np.isfinite(expected)
    assert hit.sum() > 30
    assert np.allclose(depth[hit], expected[hit], rtol=1e-5)
    assert np.array_equal(face >= 0, hit)


def test_agreement_counts_hits_and_what_is_seen_through() -> None:
    """A plane of points a metre ahead, before readings at, behind and before it."""
    v, u = np.mgrid[2:16, 2:22]
    rays = LENS.normalise(np.stack([u.ravel(), v.ravel()], 1))
    points = np.column_stack([rays, np.ones(len(rays))])[None]
    normals = np.tile([0.0, 0.0, -1.0], (1, len(rays), 1))
    poses, credit = np.eye(4)[None], np.ones((1, 18, 24), np.float32)
    for reading, expected in ((1.0, 1.0), (1.5, -1.0), (0.5, 0.0), (np.nan, 0.0)):
        depths = np.full((1, 18, 24), reading, np.float32)
        found = agreement(poses, points, normals, depths, credit, lens_array(LENS), 0.02)
        assert np.isclose(found[0], expected, atol=1e-6)
    near = np.full((1, 18, 24), 1.02, np.float32)
    found = agreement(poses, points, normals, near, 0.5 * credit, lens_array(LENS), 0.02)
    assert np.isclose(found[0], 0.5 * np.exp(-0.5), atol=1e-4)


def test_normal_equations_follow_the_cost() -> None:
    """The gradient is half the derivative of the weighted cost, for fixed weights."""
    rng = np.random.default_rng(2)
    T = inverse(look_at((1.0, 0.3, 0.4), (0.0, 0.0, 0.0)))
    seen = rng.uniform([-0.3, -0.25, 0.9], [0.3, 0.25, 1.2], (200, 3))
    points = transform(inverse(T), seen)
    sight = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    tilted = -sight + 0.3 * rng.standard_normal((200, 3))
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    normals = tilted @ T[:3, :3]
    # Flat readings: moving by less than a pixel changes which one is read, not what it says.
    depth = np.full((18, 24), 1.05, np.float32)
    sigma, lens = np.array([0.5, 0.0, 0.0]), lens_array(LENS)  # so rough that all weigh the same

    def terms(T: np.ndarray, bias: float) -> tuple[np.ndarray, np.ndarray, float]:
        H, g = np.zeros((2, 7, 7)), np.zeros((2, 7))
        group = np.arange(200) % 2
        cost, used = normal_equations(
            T, bias, points, normals, group, depth, LENS.rays, lens, 1.0, sigma, H, g
        )
        assert used > 150
        assert H.any(axis=(1, 2)).all()
        return H.sum(0), g, cost

    H, g, _ = terms(T, 0.0)
    assert np.allclose(H, H.T)
    assert np.linalg.eigvalsh(H).min() > 0
    step = 1e-6
    for k in range(7):
        d = np.zeros(7)
        d[k] = step
        up = terms(exp(d[:6]) @ T, d[6])[2]
        down = terms(exp(-d[:6]) @ T, -d[6])[2]
        # Within the weights' own change, which a reading this rough makes small.
        assert np.isclose((up - down) / (2 * step), 2 * g.sum(0)[k], rtol=0.05, atol=2.0)
