"""Sensor errors: what is random has the stated size, what is missing is missing where stated."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.camera_models import CAMERA_MODELS, camera_info
from armsight.simulation.rendering import DepthPicture
from armsight.simulation.sensor_errors import (
    DEPTH_ERRORS,
    INTERFERENCE,
    DepthErrors,
    DepthSensor,
    UnitErrors,
    draw_unit,
    noise_sigma,
    structured,
)

PLAIN, BLACK, SHINY = 0, 1, 2
PERFECT = UnitErrors()


def flat(model, z):
    """A wall square to the view at depth z [m], with its camera."""
    info = camera_info("c", model)
    shape = (info.depth.height, info.depth.width)
    return info, DepthPicture(np.full(shape, z, np.float32), np.zeros(shape, np.int16))


def sensor(info, errors=None, unit=PERFECT, materials=(PLAIN,), seed=(0, 1)):
    return DepthSensor(info, np.array(materials, np.uint8), seed, errors, unit)


def near_axis(info, limit=0.12):
    return np.sum(info.depth.rays**2, axis=2) < limit**2


@pytest.mark.parametrize(
    ("model", "distances"),
    [
        ("kinect_v1", (0.8, 2.0, 3.5)),
        ("kinect_v2", (0.8, 2.0, 4.0)),
        ("r200", (0.8, 1.5, 3.0)),
        ("f200", (0.3, 0.5, 1.0)),
    ],
)
def test_random_error_has_the_stated_size(model, distances):
    errors = replace(DEPTH_ERRORS[model], quantum=0.0)
    for z in distances:
        info, picture = flat(model, z)
        middle = near_axis(info)
        measured = sensor(info, errors).measure(picture, 5, 0.0)[middle]
        assert np.isnan(measured).mean() < 0.01
        off = measured[~np.isnan(measured)] - z
        assert np.std(off) == pytest.approx(noise_sigma(errors, np.array(z)), rel=0.06, abs=1e-5)
        assert abs(np.mean(off)) < 4 * np.std(off) / np.sqrt(middle.sum())


def test_published_figures():
    """At 2 m: 6 mm with a Kinect v1 (Nguyen at 1.6 m further), 1.7 mm with a Kinect v2."""
    assert noise_sigma(DEPTH_ERRORS["kinect_v2"], np.array(2.0)) == pytest.approx(1.7e-3)
    assert noise_sigma(DEPTH_ERRORS["kinect_v1"], np.array(2.0)) == pytest.approx(6.064e-3)
    # Intel: 0.08 px of disparity at 2 m is 14 mm over 50 mm of baseline, 7.5 mm over 95 mm.
    assert noise_sigma(DEPTH_ERRORS["d435"], np.array(2.0)) == pytest.approx(14.6e-3, rel=0.01)
    assert noise_sigma(DEPTH_ERRORS["d455"], np.array(2.0)) == pytest.approx(7.84e-3, rel=0.01)
    assert noise_sigma(DEPTH_ERRORS["r200"], np.array(0.772)) == pytest.approx(2.42e-3, rel=0.01)


@pytest.mark.parametrize("model", sorted(CAMERA_MODELS))
def test_what_a_consumer_may_assume_bounds_the_error(model):
    """The camera's public noise is at least four fifths of the simulated one, in range."""
    info = camera_info("c", model)
    errors = DEPTH_ERRORS[model]
    z = np.linspace(*info.range, 20)
    step = errors.quantum * z * z / np.sqrt(12)
    spread = np.sqrt(noise_sigma(errors, z) ** 2 + step**2)
    assert np.all(info.noise.sigma(z) > 0.8 * spread)


def test_error_grows_with_incidence():
    info, _ = flat("kinect_v2", 2.0)
    slope = np.tan(np.deg2rad(70.0))
    z = 2.0 / (1.0 - slope * info.depth.rays[..., 0])
    z = np.where((z > 0.6) & (z < 4.4), z, np.nan).astype(np.float32)
    picture = DepthPicture(z, np.where(np.isnan(z), -1, 0).astype(np.int16))
    normal = np.array([slope, 0.0, -1.0]) / np.hypot(slope, 1.0)
    rays = np.concatenate([info.depth.rays, np.ones((*z.shape, 1))], axis=2)
    th = np.arccos(np.abs(rays @ normal) / np.linalg.norm(rays, axis=2))
    g = th**2 / (np.pi / 2 - th) ** 2
    stated = noise_sigma(DEPTH_ERRORS["kinect_v2"], z) + 0.1e-3 * z**1.5 * g
    measured = sensor(info, DEPTH_ERRORS["kinect_v2"]).measure(picture, 0, 0.0)
    scaled = ((measured - z) / stated)[near_axis(info) & (th < np.deg2rad(75.0))]
    assert np.nanstd(scaled) == pytest.approx(1.0, rel=0.05)
    assert stated[near_axis(info, 0.02)].min() > 2 * noise_sigma(DEPTH_ERRORS["kinect_v2"], 2.0)


def test_same_seed_camera_and_number_same_bits():
    info, picture = flat("kinect_v2", 1.5)
    a = sensor(info, seed=(3, 1)).measure(picture, 7, 0.0)
    assert np.array_equal(a, sensor(info, seed=(3, 1)).measure(picture, 7, 0.0), equal_nan=True)
    for other, number in ((sensor(info, seed=(3, 1)), 8), (sensor(info, seed=(3, 2)), 7)):
        b = other.measure(picture, number, 0.0)
        noise = np.corrcoef((a - 1.5).ravel(), (b - 1.5).ravel())[0, 1]
        assert abs(noise) < 0.02


def test_noise_is_white():
    info, picture = flat("kinect_v2", 1.5)
    off = sensor(info).measure(picture, 0, 0.0) - np.float32(1.5)
    for shift in ((0, 1), (1, 0), (1, 1)):
        moved = np.roll(off, shift, (0, 1))
        assert abs(np.corrcoef(off.ravel(), moved.ravel())[0, 1]) < 0.02


def test_systematic_error_of_a_unit():
    """Without randomness: offset, scale, sine, corners and warm-up by their own formulas."""
    base = DEPTH_ERRORS["kinect_v2"]
    errors = replace(base, a=0, b=0, c=0, grazing=0, fly=0, fly_lost=0)
    unit = UnitErrors(0.013, 0.002, base.wiggle, 0.4, radial=0.004, drift=0.005)
    info, picture = flat("kinect_v2", 2.0)
    r2 = np.sum(info.depth.rays**2, axis=2)
    expected = (
        2.0
        + 0.013
        + 0.002 * 2.0
        + base.wiggle * np.sin(2 * np.pi * 2.0 / 0.9 + 0.4)
        + 0.004 * r2 / r2.max()
    )
    cold = sensor(info, errors, unit).measure(picture, 0, 0.0)
    assert np.allclose(cold, expected, atol=2e-5)
    warm = sensor(info, errors, unit).measure(picture, 0, 1800.0)
    assert np.allclose(warm - cold, 0.005 * (1 - np.exp(-3.0)), atol=2e-5)


def test_units_differ_as_stated():
    rng = np.random.default_rng(0)
    units = [draw_unit(DEPTH_ERRORS["kinect_v2"], rng) for _ in range(600)]
    assert np.std([u.offset for u in units]) == pytest.approx(0.020, rel=0.15)
    assert np.std([u.scale for u in units]) == pytest.approx(0.003, rel=0.15)


@pytest.mark.parametrize(("z", "seen"), [(0.3, False), (0.6, True), (4.3, True), (4.8, False)])
def test_range(z, seen):
    info, picture = flat("kinect_v2", z)
    measured = sensor(info).measure(picture, 0, 0.0)
    assert np.isnan(measured).mean() < 0.01 if seen else np.isnan(measured).all()


def test_black_plastic_gives_nothing_in_infrared():
    for model, lost in (("kinect_v2", True), ("kinect_v1", True), ("wrist_stereo", False)):
        info, picture = flat(model, 0.35 if model == "wrist_stereo" else 1.0)
        picture.geom[100:150, 100:200] = 1
        measured = sensor(info, materials=(PLAIN, BLACK)).measure(picture, 0, 0.0)
        assert np.isnan(measured[110:140, 110:190]).all() == lost
        assert np.isnan(measured[:80]).mean() < 0.05


def test_shiny_things_lose_some():
    info, picture = flat("kinect_v2", 1.0)
    picture.geom[:] = 1
    lost = np.isnan(sensor(info, materials=(PLAIN, SHINY)).measure(picture, 0, 0.0)).mean()
    assert lost == pytest.approx(DEPTH_ERRORS["kinect_v2"].shiny_lost, abs=0.02)


def test_flying_pixels_only_at_edges_and_between_both_depths():
    info, picture = flat("kinect_v2", 3.0)
    picture.depth[150:300, 200:350] = 1.0
    measured = sensor(info).measure(picture, 0, 0.0)
    between = (measured > 1.1) & (measured < 2.9)
    rows, columns = np.nonzero(between)
    assert len(rows) > 100
    on_rows = np.isin(rows, (149, 150, 299, 300)) & (columns > 197) & (columns < 353)
    on_columns = np.isin(columns, (199, 200, 349, 350)) & (rows > 147) & (rows < 303)
    assert np.all(on_rows | on_columns)
    edge = np.zeros_like(between)
    edge[149:301, 199:351] = True
    edge[151:299, 201:349] = False
    assert between[edge].mean() == pytest.approx(DEPTH_ERRORS["kinect_v2"].fly, abs=0.08)


def test_steep_surfaces_are_no_edges():
    info, _ = flat("kinect_v2", 2.0)
    slope = np.tan(np.deg2rad(60.0))
    z = (2.0 / np.maximum(1.0 - slope * info.depth.rays[..., 0], 0.45)).astype(np.float32)
    picture = DepthPicture(z, np.zeros(z.shape, np.int16))
    sure = (z > 0.7) & (z < 4.2)
    measured = sensor(info).measure(picture, 0, 0.0)
    assert np.isnan(measured[sure]).mean() < 0.005
    assert np.nanmax(np.abs(measured - z)[sure]) < 0.2


def test_grazing_surfaces_are_lost():
    info, _ = flat("kinect_v2", 2.0)
    lost = []
    for angle in (60.0, 82.0, 88.0):
        slope = np.tan(np.deg2rad(angle))
        z = 2.0 / (1.0 - slope * info.depth.rays[..., 0])
        z = np.where((z > 0.6) & (z < 4.4), z, np.nan).astype(np.float32)
        picture = DepthPicture(z, np.where(np.isnan(z), -1, 0).astype(np.int16))
        errors = replace(DEPTH_ERRORS["kinect_v2"], fly=0.0, fly_lost=0.0)
        measured = sensor(info, errors).measure(picture, 0, 0.0)
        middle = near_axis(info, 0.03) & ~np.isnan(z)
        lost.append(np.isnan(measured[middle]).mean())
    assert lost[0] == 0.0
    assert 0.2 < lost[1] < 0.9
    assert lost[2] > 0.95


def test_disparity_steps_of_a_kinect_v1():
    errors = replace(DEPTH_ERRORS["kinect_v1"], lateral=0.0)
    info, picture = flat("kinect_v1", 3.0)
    values = np.unique(sensor(info, errors).measure(picture, 0, 0.0))
    values = values[~np.isnan(values)].astype(float)
    step = np.diff(1.0 / values[::-1])
    assert np.allclose(step / errors.quantum, np.round(step / errors.quantum), atol=0.02)
    assert np.median(np.diff(values)) == pytest.approx(9.0 * errors.quantum, rel=0.1)  # 26 mm


def test_thirty_planes_of_the_stereo_pair():
    info, _ = flat("wrist_stereo", 0.3)
    h, w = info.depth.height, info.depth.width
    z = np.tile(np.linspace(0.201, 0.399, w, dtype=np.float32), (h, 1))
    measured = sensor(info).measure(DepthPicture(z, np.zeros((h, w), np.int16)), 0, 0.0)
    planes = np.unique(measured[~np.isnan(measured)])
    assert 28 <= len(planes) <= 31
    assert np.mean(np.diff(planes)) == pytest.approx(0.007, abs=0.001)


def test_projector_shadow_beside_things():
    info, picture = flat("kinect_v1", 2.0)
    picture.depth[80:160, 120:200] = 1.0
    measured = sensor(info).measure(picture, 0, 0.0)
    fx, b = info.depth.fx, DEPTH_ERRORS["kinect_v1"].baseline
    width = fx * b * (1 / 1.0 - 1 / 2.0)
    rows = slice(95, 145)
    dark = np.isnan(measured[rows, 120 - int(width) + 3 : 117]).mean()
    right = np.isnan(measured[rows, 204:225]).mean()
    far_left = np.isnan(measured[rows, 80 : 120 - int(width) - 4]).mean()
    assert dark > 0.95
    assert right < 0.05
    assert far_left < 0.05


def test_interference_loses_its_share_where_patterns_overlap():
    info, picture = flat("kinect_v1", 1.5)
    mask = np.zeros(picture.depth.shape, bool)
    mask[:, 160:] = True
    errors = replace(DEPTH_ERRORS["kinect_v1"], lateral=0.0, fly_lost=0.0, baseline=0.0)
    measured = sensor(info, errors).measure(picture, 0, 0.0, mask)
    assert np.isnan(measured[:, :160]).mean() < 0.005
    assert np.isnan(measured[:, 160:]).mean() == pytest.approx(INTERFERENCE, abs=0.02)


def test_who_disturbs_whom():
    assert {m for m in CAMERA_MODELS if structured(camera_info("c", m))} == {"kinect_v1", "f200"}


def test_an_error_free_sensor_is_the_truth():
    info, picture = flat("kinect_v2", 1.7)
    picture.depth[:50] = np.nan
    picture.geom[:50] = -1
    measured = sensor(info, DepthErrors(0.0, 0.0, 0.0)).measure(picture, 0, 0.0)
    assert np.array_equal(measured, picture.depth, equal_nan=True)
