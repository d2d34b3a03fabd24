"""Kernels beside plain-numpy twins."""

import numpy as np
import pytest
from painted_ports import LENS, facing, paint

from armsight.charging import kernels
from armsight.charging.fit import FitOptions, fit
from armsight.charging.looks import gradients, look
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import PORTS
from armsight.charging.pyramid import spread_bits
from armsight.geometry.pose import exp, inverse, log


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (60, 80)).astype(np.float32)
    gx, gy = gradients(image, 1.0)
    size, angle = np.hypot(gx, gy), np.mod(np.arctan2(gy, gx), 2 * np.pi).astype(np.float32)
    return gx, gy, size.astype(np.float32), angle


def test_direction_bits(scene) -> None:
    _, _, size, angle = scene
    bits = kernels.direction_bits(size, angle, 5.0)
    k = np.floor(angle * np.float32(kernels.BINS / np.pi) + np.float32(0.5)).astype(int)
    twin = np.zeros_like(bits)
    for step in (-1, 0, 1):
        twin |= (1 << np.mod(k + step, kernels.BINS)).astype(np.uint16)
    assert np.array_equal(bits, np.where(size >= np.float32(5.0), twin, 0))


def test_spread_bits_is_the_union_of_nine() -> None:
    bits = np.random.default_rng(1).integers(0, 2**16, (20, 30)).astype(np.uint16)
    wide = np.pad(bits, 1)
    twin = np.zeros_like(bits)
    for dy in range(3):
        for dx in range(3):
            twin |= wide[dy : dy + 20, dx : dx + 30]
    assert np.array_equal(spread_bits(bits), twin)


def test_votes_meet_in_the_middle_of_a_ring() -> None:
    """Every edge of a disc votes for its centre, at its radius."""
    y, x = np.mgrid[0:64, 0:64]
    disc = 200.0 / (1 + np.exp(np.hypot(x - 30.0, y - 33.0) - 8.0))
    gx, gy = gradients(disc.astype(np.float32), 0.5)
    size, angle = np.hypot(gx, gy), np.mod(np.arctan2(gy, gx), 2 * np.pi)
    step = 2 * np.pi * np.arange(64) / 64
    shift = np.stack([np.cos(step), np.sin(step)], 1)[None].astype(np.float32)
    votes = kernels.vote_centers(
        size.astype(np.float32), angle.astype(np.float32), 3.0, shift, np.array([8])
    )
    v, u = np.unravel_index(np.argmax(votes[0]), votes[0].shape)
    assert abs(u - 30) <= 1
    assert abs(v - 33) <= 1


def _flat(points, guess):
    """Template points in the picture: squeeze . turn . flip, and the rise."""
    u, v, scale, lx, ly, roll = guess
    tilt = np.hypot(lx, ly)
    a = np.array([lx, ly]) / tilt
    squeeze = np.outer(a, a) + np.cos(tilt) * (np.eye(2) - np.outer(a, a))
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    A = scale * squeeze @ turn @ np.diag([1.0, -1.0])
    rise = scale * np.sin(tilt) * np.array([-a[1], a[0]])
    return points[:, :2] @ A.T + points[:, 2:] * rise + [u, v], A


def test_scores_of_a_flat_template(scene) -> None:
    gx, gy, size, angle = scene
    model = curves(PORTS["type2_plug"], 0.003)
    points, normals = model.points.astype(np.float32), model.normals[:, :2].astype(np.float32)
    guess = np.array([40.0, 30.0, 600.0, 0.3, -0.2, 0.7])
    at, A = _flat(points.astype(float), guess)
    x, y = np.floor(at + 0.5).astype(int).T
    inside = (x >= 0) & (x < 80) & (y >= 0) & (y < 60)
    n = normals @ np.linalg.inv(A)  # normals go with the inverse transpose
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    g = np.stack([gx[y[inside], x[inside]], gy[y[inside], x[inside]]], 1)
    twin = np.abs(np.sum(g * n[inside], axis=1)) / (np.linalg.norm(g, axis=1) + 4.0)
    found = kernels.fine_score(gx, gy, 4.0, points, normals, guess)
    assert found == pytest.approx(twin.sum() / len(points), rel=1e-4)
    bits = kernels.direction_bits(size, angle, 3.0)
    k = np.floor(np.arctan2(n[:, 1], n[:, 0]) * kernels.BINS / np.pi + kernels.BINS + 0.5)
    hit = (bits[y[inside], x[inside]] >> (k[inside].astype(int) % kernels.BINS)) & 1
    rough = kernels.rough_score(bits, points, normals, guess)
    assert abs(rough - hit.sum() / len(points)) < 3 / len(points)  # a normal on a bin's border


def test_edge_search_finds_a_straight_edge_to_a_twentieth() -> None:
    x = np.arange(60.0)
    row = 100.0 / (1 + np.exp(-(x - 30.3) / 0.8))
    gx, gy = gradients(np.tile(row, (40, 1)).astype(np.float32), 0.0)
    d, strength = kernels.edge_search(
        gx,
        gy,
        np.array([[28.0, 20.0], [50.0, 20.0]]),
        np.array([[1.0, 0.0], [1.0, 0.0]]),
        5.0,
        3.0,
        1.0,
        0.9,
    )
    assert d[0] == pytest.approx(2.3, abs=0.05)
    assert np.isnan(d[1])
    assert strength[0] > 10.0


def test_the_quick_fit_ends_where_the_full_one_does() -> None:
    T = facing(0.01, -0.02, 0.5, (0.25, 0.1), 0.2)
    image = paint(PORTS["type2"], T, LENS, 0)
    start = T @ exp(np.array([0.001, -0.001, 0.004, 0.05, -0.05, 0.03]))
    view = look(image, LENS)
    model = curves(PORTS["type2"], 0.002)
    numbers = np.array([LENS.fx, LENS.fy, LENS.cx, LENS.cy, *LENS.distortion])
    reaches = np.array([5.0, 5.0, 4.0, 3.0, 2.5, 2.5, 2.5, 2.5])
    score, quick = kernels.fit_rigid(
        view.gx, view.gy, numbers, model.points, model.normals, start, reaches, 0.5
    )
    full = fit([view], PORTS["type2"], start, FitOptions(makes=False, iterations=10))
    assert score > 0.9
    assert np.abs(log(inverse(full.T_ref_port) @ quick)).max() < 2e-3
    assert np.allclose(
        kernels.project_lens(numbers, 0.1, 0.05, 0.8), LENS.project(np.array([[0.1, 0.05, 0.8]]))[0]
    )
