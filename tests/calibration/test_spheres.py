"""The sphere marker: found in rendered depth by its shape, cameras registered by it."""

import numpy as np
import pytest

from armsight.calibration.sphere_sighting import find_sphere
from armsight.calibration.spheres import fit_sphere, procrustes_ransac, register_spheres
from armsight.devices.data import DepthNoise
from armsight.errors import CalibrationError
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, inverse, transform

LENS = PinholeCamera(512, 424, 365.0, 365.0, 255.5, 211.5, (0.09, -0.27, 0.0, 0.0, 0.1))
NOISE = DepthNoise(0.0015, 0.0, 0.0005)
R = 0.075


def depth_of(spheres, wall=3.0, noise=0.0, rng=None):
    """The depth picture of (centre, radius) spheres before a wall, by solving every ray."""
    ray = np.concatenate([LENS.rays, np.ones((LENS.height, LENS.width, 1))], axis=2)
    depth = np.full(ray.shape[:2], wall)
    for center, radius in spheres:
        a, b = np.sum(ray * ray, 2), ray @ center
        inside = b * b - a * (center @ center - radius**2)
        hit = inside > 0
        depth[hit] = np.minimum(depth[hit], (b[hit] - np.sqrt(inside[hit])) / a[hit])
    return depth if rng is None else depth + rng.normal(0.0, noise, depth.shape)


def cap(center, radius, rng, n=300, noise=0.0003):
    """Points on the half of a sphere that faces a camera at the origin."""
    d = rng.normal(size=(4 * n, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    d = d[d @ center < -0.3 * np.linalg.norm(center)][:n]
    p = center + radius * d
    return p + p / np.linalg.norm(p, axis=1, keepdims=True) * rng.normal(0, noise, (len(p), 1))


def test_sphere_of_known_radius(rng):
    center = np.array([0.3, -0.2, 2.2])
    points = cap(center, R, rng)
    points[:15] += rng.normal(0, 0.05, (15, 3))
    fit = fit_sphere(points, R)
    assert fit is not None
    assert np.linalg.norm(fit.center - center) < 1e-3
    assert fit_sphere(points[:5], R) is None


@pytest.mark.parametrize(
    "center", [(0.0, 0.0, 1.2), (0.5, -0.4, 1.6), (-0.7, 0.5, 2.2), (0.1, 0.1, 2.6)]
)
def test_a_sphere_is_found_by_its_shape_alone(rng, center):
    """A wrong guess, a smaller and a larger ball beside it, a wall close behind."""
    center = np.array(center)
    others = [
        (center + np.array([0.17, 0.05, 0.1]), 0.045),
        (center + np.array([-0.05, 0.25, 0.0]), 0.13),
    ]
    depth = depth_of([(center, R), *others], center[2] + 0.16, 0.0015, rng)
    guess = center + np.array([0.06, -0.05, 0.07])
    fit = find_sphere(depth, LENS, NOISE, R, guess, 0.15)
    assert fit is not None
    assert np.linalg.norm(fit.center - center) < 0.0012


def test_no_sphere_is_made_up(rng):
    center = np.array([0.2, 0.0, 1.8])
    wrong = [(center, 0.11)], [(center, 0.05)], []
    for spheres in wrong:
        depth = depth_of(spheres, 2.2, 0.0015, rng)
        assert find_sphere(depth, LENS, NOISE, R, center, 0.15) is None
    depth = depth_of([(center, R)], 2.2, 0.0015, rng)
    aside = center + np.array([0.4, 0.0, 0.0])
    assert find_sphere(depth, LENS, NOISE, R, aside, 0.15) is None  # elsewhere
    assert find_sphere(depth, LENS, NOISE, R, np.array([0, 0, -1.0]), 0.15) is None  # behind
    assert find_sphere(depth * np.nan, LENS, NOISE, R, center, 0.15) is None  # nothing seen
    before = center + np.array([0.03, 0.0, -0.2])
    hidden = depth_of([(center, R), (before, 0.06)], 2.2, 0.0015, rng)
    fit = find_sphere(hidden, LENS, NOISE, R, center, 0.15)
    assert fit is None or np.linalg.norm(fit.center - center) < 0.003  # mostly behind something


def arm_and_cameras(rng, bias=(0.0, 0.015, -0.01), arm_error=0.0005, places=24):
    """Flange poses, what three cameras see of the sphere on it, and the truth."""
    middle = np.array([0.0, 0.0, 2.0])
    cameras = [np.eye(4), exp([1.5, 0.1, 0.8, 0.1, -1.0, 0.1]), exp([-1.2, 0.2, 0.6, 0.2, 0.9, 0])]
    hangs = np.array([0.012, -0.008, 0.256])
    flange, seen = [], []
    for _ in range(places):
        T = exp([*rng.uniform(-0.5, 0.5, 3), *rng.normal(0, 1.0, 3)])
        T[:3, 3] += middle
        flange.append(T)
        center = T[:3, :3] @ hangs + T[:3, 3] + rng.normal(0, arm_error, 3)
        row = []
        for C, b in zip(cameras, bias):
            local = transform(inverse(C), center[None])[0]
            local = local * (1 + b / local[2]) + rng.normal(0, 0.001, 3)
            row.append(local if rng.random() > 0.15 else None)
        seen.append(row)
    return np.array(flange), seen, cameras, hangs, np.array(bias)


def test_cameras_are_registered_in_base_in_spite_of_depth_bias(rng):
    flange, seen, cameras, hangs, bias = arm_and_cameras(rng)
    seen[4][1] = np.array([0.0, 0.0, 3.0])  # a mistaken marker
    found = register_spheres(flange, seen, np.array([0.0, 0.0, 0.25]), rng)
    np.testing.assert_allclose(found.hangs, hangs, atol=0.002)
    np.testing.assert_allclose(found.offset, bias, atol=0.006)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (1.5, 2.5)])
    for T, truth in zip(found.T_base_camera, cameras):
        local = transform(inverse(truth), corners)
        assert np.linalg.norm(transform(T, local) - corners, axis=1).max() < 0.008


def test_the_stated_covariance_holds():
    """Normalised errors of sixty registrations: chi-squared of six a camera."""
    far = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        flange, seen, cameras, _, _ = arm_and_cameras(rng, arm_error=0.0)
        found = register_spheres(flange, seen, np.array([0.0, 0.0, 0.25]), rng, sigma=0.001)
        for T, C, truth in zip(found.T_base_camera, found.covariance, cameras):
            d = inverse(T) @ truth
            turn = 0.5 * np.array([d[2, 1] - d[1, 2], d[0, 2] - d[2, 0], d[1, 0] - d[0, 1]])
            e = np.concatenate([d[:3, 3], turn])
            far.append(e @ np.linalg.solve(C, e))
    assert 4.0 < np.mean(far) < 9.0
    assert np.mean(np.array(far) < 12.59) > 0.85  # 95 % of six degrees of freedom


def test_too_few_or_collinear_places_are_refused(rng):
    line = np.array([exp([0.1 * k, 0, 2.0, 0, 0, 0]) for k in range(8)])
    with pytest.raises(CalibrationError, match="line"):
        register_spheres(line, [[T[:3, 3]] for T in line], np.zeros(3), rng)
    with pytest.raises(CalibrationError, match="6 places"):
        register_spheres(line, [[None] for _ in line], np.zeros(3), rng)


def test_a_camera_that_saw_too_little_is_left_out(rng):
    flange, seen, _, _, _ = arm_and_cameras(rng)
    for row in seen[:-5]:
        row[2] = None
    found = register_spheres(flange, seen, np.array([0.0, 0.0, 0.25]), rng)
    assert found.used[2] == 0
    assert np.isnan(found.T_base_camera[2]).all()
    assert np.isfinite(found.T_base_camera[:2]).all()


def test_places_that_agree_with_no_arm_do_not_count(rng):
    """Six places were asked for before the mistaken ones were left out, not after."""
    flange, seen, _, _, _ = arm_and_cameras(rng)
    for row in seen[:-5]:
        row[2] = None if row[2] is None else rng.uniform([-1, -1, 1], [1, 1, 3])
    found = register_spheres(flange, seen, np.array([0.0, 0.0, 0.25]), rng, tolerance=0.02)
    assert found.used[2] == 0
    with pytest.raises(CalibrationError, match=r"of \d+ places of the sphere agree"):
        register_spheres(
            flange, [[row[2]] for row in seen], np.array([0.0, 0.0, 0.25]), rng, tolerance=0.02
        )


def test_how_thin_a_set_of_places_may_be_goes_by_what_it_is_judged_by(rng):
    """A pair on the wrist sees a ball within 2 to 3 cm of a line; that was "a line" to it."""
    T = exp([0.4, -0.1, 0.7, 0.3, -0.2, 0.5])
    places = rng.normal(0.0, 1.0, (20, 3)) * [0.04, 0.025, 0.015] + [0.0, 0.0, 0.35]
    found, good = procrustes_ransac(places, transform(T, places), rng, 0.03)
    assert good.all()
    np.testing.assert_allclose(found, T, atol=1e-9)
    with pytest.raises(CalibrationError, match="line"):
        procrustes_ransac(places, transform(T, places), rng, 0.05)
