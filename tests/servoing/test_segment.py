"""Regions and outlines: compiled loops against plain ones, the short way against the long."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from armsight.servoing.color_kernels import chroma_along
from armsight.servoing.kernels import disc_residuals, last_steps_down
from armsight.servoing.segment import Region, color_mask, regions, saturation
from armsight.servoing.targets.ball import RED, Ball
from armsight.servoing.targets.mouth import YELLOW
from armsight.servoing.targets.palm import BLUE, PINK
from armsight.servoing.targets.seen import LEAST_PAIR, half_size_mask, outlines_in_pair

from .traced import pair

COLOR = (205, 15, 18)


def plain_steps(signal, mask, corner, center, ways, step, samples, off, clear):
    """The twin: the last sample inside, levels beside it, the first crossing about it."""
    out = np.full(len(ways), -1.0)
    height, width = signal.shape
    for i, way in enumerate(ways):
        at = center + step * np.arange(1, samples + 1)[:, None] * way
        inside = map_coordinates(mask, (at - corner)[:, ::-1].T, order=0, mode="grid-constant")
        filled = np.flatnonzero(inside)
        if len(filled) == 0:
            continue
        row = map_coordinates(signal.astype(float), at[:, ::-1].T, order=1, mode="nearest")
        k = int(filled[-1])
        if k - off - 1 < 0 or k + off + 3 >= len(row):
            continue
        u, v = at[k + off + 2]
        if u < 0 or v < 0 or u > width - 1 or v > height - 1:
            continue
        low, high = row[k + off + 1 : k + off + 3].mean(), row[k - off - 1 : k - off + 1].mean()
        if high - low < clear:
            continue
        level = 0.5 * (low + high)
        crossings = [j for j in range(k - off, k + off + 1) if row[j] >= level > row[j + 1]]
        if crossings:
            j = crossings[0]
            out[i] = j + (row[j] - level) / (row[j] - row[j + 1])
    return out


@pytest.mark.parametrize("off", [3, 5])
@pytest.mark.parametrize("center", [(31.3, 24.6), (8.1, 40.7)])
def test_rays_fall_to_half_where_a_plain_loop_says(center, off):
    rng = np.random.default_rng(off)
    v, u = np.mgrid[:50, :60]
    away = np.hypot(u - center[0], v - center[1])
    signal = (30.0 * (away < 15.3) + rng.normal(0.0, 1.0, away.shape)).astype(np.float32)
    signal = cv2.GaussianBlur(signal, (5, 5), 1.0)
    top, left = max(int(center[1]) - 14, 0), max(int(center[0]) - 14, 0)
    mask = (away < 14.0).astype(np.uint8)[top : top + 29, left : left + 29] * np.uint8(255)
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False) + 1e-3
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    given = (signal, mask, np.array([left, top], float), np.array(center), ways, 0.5, 70, off, 8.0)
    out = np.empty(len(ways))
    last_steps_down(*given, out)
    expected = plain_steps(*given)
    assert (expected >= 0).sum() > 60
    assert (expected < 0).any() == (center[0] < 10.0)  # those that leave the picture
    np.testing.assert_allclose(out, expected, atol=1e-4)


def plain_lab(image):
    """CIE 15 in plain numpy: sRGB to light, to XYZ by BT.709's primaries, to Lab under D65."""
    v = image / 255.0
    light = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array(
        [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169],
         [0.019334, 0.119193, 0.950227]]
    )  # fmt: skip
    t = light @ to_xyz.T / to_xyz.sum(axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


@pytest.fixture(scope="module")
def every_fifth():
    """(2704, 52, 3) all pixels with every fifth level of each channel."""
    levels = np.arange(0, 256, 5, np.uint8)
    image = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1)
    return np.ascontiguousarray(image.reshape(-1, 52, 3))


@pytest.mark.parametrize("color", [RED, BLUE, YELLOW, PINK])
def test_a_pixel_has_a_colour_where_plain_lab_says(color, every_fifth):
    lab = plain_lab(every_fifth)
    hue = np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) - color.hue_deg
    off = np.abs((hue + 180.0) % 360.0 - 180.0)
    along = np.hypot(lab[..., 1], lab[..., 2]) * np.cos(np.radians(off))
    np.testing.assert_allclose(saturation(every_fifth, color), along, atol=2e-3)
    low, high = color.lightness
    slack = np.minimum.reduce([
        along - color.chroma, along - color.purity * lab[..., 0], color.width_deg - off,
        lab[..., 0] - low, high - lab[..., 0],
    ])  # fmt: skip
    mask = color_mask(every_fifth, color, opening=1) > 0
    assert (slack > 0).sum() > 500
    assert mask[slack > 2e-3].all()
    assert not mask[slack < -2e-3].any()


def test_a_turned_or_read_only_picture_is_looked_at_as_any_other(every_fifth):
    turned = np.ascontiguousarray(every_fifth[..., ::-1])[..., ::-1]
    turned.flags.writeable = False
    before = len(chroma_along.signatures)
    np.testing.assert_array_equal(saturation(turned, RED), saturation(every_fifth, RED))
    np.testing.assert_array_equal(color_mask(turned, RED), color_mask(every_fifth, RED))
    assert len(chroma_along.signatures) == before  # nothing is compiled for it


@pytest.mark.parametrize("size", [(480, 720), (239, 361)])
def test_regions_of_the_half_picture_are_those_of_its_mask_doubled(size):
    rng = np.random.default_rng(5)
    image = np.full((*size, 3), 120, np.uint8)
    for _ in range(4):
        at = rng.integers((30, 30), (size[1] - 30, size[0] - 30))
        cv2.circle(image, tuple(int(x) for x in at), int(rng.integers(6, 24)), COLOR, -1)
    lens = pair([], np.eye(4)).info.left
    found = [region for region, _ in outlines_in_pair(image, lens, RED)]
    long_way = regions(half_size_mask(image, RED), LEAST_PAIR)
    assert len(found) == len(long_way) > 0
    for a, b in zip(found, long_way):
        if size == (480, 720):  # an odd picture is stretched by the long way, not cut
            assert a.corner == b.corner
            np.testing.assert_array_equal(a.mask, b.mask)
            assert a.area == b.area
        np.testing.assert_allclose(a.center, b.center, atol=0.01 if size == (480, 720) else 1.5)
    whole = regions(color_mask(image, RED), LEAST_PAIR)
    for a, b in zip(found, whole):
        np.testing.assert_allclose(a.center, b.center, atol=1.0)


def test_a_mark_beside_the_ball_is_found_as_it_is_alone():
    balls = [
        (np.array([0.01, 0.0, 0.3]), 0.04, COLOR),
        (np.array([-0.03, 0.05, 0.25]), 0.008, COLOR),
    ]
    view = pair(balls, np.eye(4), np.random.default_rng(2))
    ball = Ball(0.04)
    together = [ball.in_pair(view), Ball(0.008, "mark", beside=ball).in_pair(view)]
    alone = [Ball(0.04).in_pair(view), Ball(0.008, "mark").in_pair(view)]
    for a, b in zip(together, alone):
        assert len(a) == len(b) == 1
        np.testing.assert_array_equal(a[0].position, b[0].position)
    other = pair([(np.array([0.0, 0.02, 0.28]), 0.04, COLOR)], np.eye(4))
    np.testing.assert_array_equal(
        ball.in_pair(other)[0].position, Ball(0.04).in_pair(other)[0].position
    )


def plain_residuals(center, normal, origin, rays, radius, sigma, surface, surface_sigma):
    """The twin, ray by ray: the angle to the circle's point nearest to where the ray meets it."""
    out = []
    for o, ray, R, s in zip(origin, rays, radius, sigma):
        on_plane = o + ray * ((center - o) @ normal) / (ray @ normal)
        away = on_plane - center
        rim = center + R * away / np.linalg.norm(away) - o
        cosine = rim @ ray / np.linalg.norm(rim)
        sine = np.linalg.norm(rim / np.linalg.norm(rim) - cosine * ray)
        out.append(np.copysign(sine, np.linalg.norm(away) - R) / s)
    return np.array([*out, *((surface - center) @ normal / surface_sigma)])


def test_residuals_of_a_disc_against_a_plain_loop():
    rng = np.random.default_rng(8)
    center, normal = np.array([0.1, 0.0, 0.5]), np.array([0.3, -0.2, -0.9])
    normal /= np.linalg.norm(normal)
    origin = rng.normal(size=(50, 3)) * 0.05
    rays = center + rng.normal(size=(50, 3)) * 0.03 - origin
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    radius, sigma = rng.choice([0.02, 0.04], 50), rng.uniform(1e-4, 1e-3, 50)
    surface = center + rng.normal(size=(12, 3)) * 0.02
    out = np.empty(62)
    disc_residuals(center, normal, origin, rays, radius, sigma, surface, 0.004, out)
    expected = plain_residuals(center, normal, origin, rays, radius, sigma, surface, 0.004)
    np.testing.assert_allclose(out, expected, rtol=1e-6, atol=1e-8)


def test_a_regions_hull_is_that_of_its_pixels():
    mask = np.zeros((60, 80), np.uint8)
    cv2.circle(mask, (30, 30), 20, 255, -1)
    cv2.circle(mask, (36, 28), 9, 0, -1)
    cv2.rectangle(mask, (60, 10), (75, 14), 255, -1)
    expected = cv2.contourArea(cv2.convexHull(cv2.findNonZero(mask)))
    assert Region(mask, (0, 0), np.zeros(2), 1.0).hull == pytest.approx(expected)
