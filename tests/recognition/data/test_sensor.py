"""The sensor chain, step against what it should do."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from armsight.geometry.camera import PinholeCamera
from armsight.recognition.data.recipe import WILD
from armsight.recognition.data.sensor import (
    GAINS,
    TARGET,
    Sensor,
    develop,
    distort,
    draw_sensor,
    expose,
    to_jpeg,
)

CLEAN = Sensor(1.0, 1.0, 1.0, 0.0, 0.0, (0.0, 0.0), 1e9, 0.0, 0.0, 1.0, 2.2, cv2.INTER_AREA, 95)


@pytest.mark.parametrize("color", [(200, 120, 60), (60, 120, 200), (120, 120, 120)])
def test_a_clean_camera_keeps_colours(color: tuple[int, int, int]) -> None:
    """Red stays red through mosaic and demosaic, but for the automatic exposure."""
    seen = np.empty((80, 96, 3), np.uint8)
    seen[:] = color
    picture = develop(CLEAN, expose(CLEAN, seen, np.random.default_rng(0)), (48, 40))
    linear = (np.array(color) / 255.0) ** 2.2
    gain = np.clip(TARGET / linear[1], *GAINS)
    expected = 255.0 * np.clip(linear * gain, 0, 1) ** (1 / 2.2)
    assert picture.shape == (40, 48, 3)
    np.testing.assert_allclose(picture[5:-5, 5:-5].reshape(-1, 3).mean(0), expected, atol=2.5)


def test_noise_has_the_variance_that_it_says() -> None:
    sensor = replace(CLEAN, photons=1000.0, read_noise=0.02)
    seen = np.full((400, 400, 3), 124, np.uint8)  # linear 0.2: gain 1
    mosaic = expose(sensor, seen, np.random.default_rng(1))
    mean = float(mosaic.mean())
    assert mean == pytest.approx(TARGET, rel=0.01)
    assert mosaic.std() == pytest.approx(np.sqrt(mean / 1000.0 + 0.02**2), rel=0.02)


def test_defocus_and_motion_keep_the_light() -> None:
    seen = np.full((80, 96, 3), 100, np.uint8)
    seen[40, 48] = 255
    sharp = expose(CLEAN, seen, np.random.default_rng(0))
    for sensor in (replace(CLEAN, defocus=1.0), replace(CLEAN, motion=(3.0, 1.0))):
        soft = expose(sensor, seen, np.random.default_rng(0))
        assert soft.max() < sharp.max()
        assert soft.mean() == pytest.approx(sharp.mean(), rel=0.01)


def test_the_bend_is_that_of_the_lens() -> None:
    """Dots at known directions land where the bent lens projects them."""
    lens = PinholeCamera(200, 160, 150.0, 150.0, 99.5, 79.5, (-0.02, 0.0, 0.0, 0.0, 0.0))
    wide = PinholeCamera(240, 200, 150.0, 150.0, 119.5, 99.5)
    for x, y in [(-0.5, -0.4), (0.0, 0.0), (0.55, 0.45), (0.3, -0.45)]:
        picture = np.zeros((200, 240), np.uint8)
        u, v = wide.project(np.array([[x, y, 1.0]]))[0]
        rows, columns = np.mgrid[0:200, 0:240]
        picture[:] = 255 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 18.0)
        bent = distort(picture, wide, lens, nearest=False).astype(float)
        rows, columns = np.mgrid[0:160, 0:200]
        found = [(bent * columns).sum() / bent.sum(), (bent * rows).sum() / bent.sum()]
        np.testing.assert_allclose(found, lens.project(np.array([[x, y, 1.0]]))[0], atol=0.12)


def test_every_drawn_camera_makes_a_picture() -> None:
    rng = np.random.default_rng(3)
    seen = rng.integers(0, 256, (84, 100, 3), dtype=np.uint8)
    for _ in range(20):
        sensor = draw_sensor(WILD, rng)
        picture = develop(sensor, expose(sensor, seen, rng), (50, 42))
        data = to_jpeg(sensor, picture)
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape == (42, 50, 3)
        assert 30 <= sensor.quality <= 95
