"""Kernels beside plain-numpy twins."""

import numpy as np
import pytest
from painted_ports import LENS, facing, paint
from scipy.spatial.transform import Rotation

from armsight.charging.fit import FitOptions, fit
from armsight.charging.guesses import template
from armsight.charging.kernels.edges import edge_search, project_lens
from armsight.charging.kernels.rigid import fit_rigid, flat_pose, rim_shares
from armsight.charging.kernels.spots import spots
from armsight.charging.kernels.templates import best_rolls, climb, distinct, template_score
from armsight.charging.kernels.votes import edge_field, vote_centers, vote_crests
from armsight.charging.looks import gradients, look
from armsight.charging.ports.curves import curves
from armsight.charging.ports.table import PORTS
from armsight.charging.pyramid import pyramid
from armsight.geometry.pose import exp, inverse, log


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (60, 80)).astype(np.float32)
    return gradients(image, 1.0)


def test_the_field_keeps_directions_and_bounds_sizes(scene) -> None:
    gx, gy = scene
    field = edge_field(gx, gy, 5.0)
    size = np.sqrt(gx**2 + gy**2 + 25.0)
    assert field.dtype == np.int8
    assert np.abs(field[..., 0] - 127.0 * gx / size).max() < 0.501
    assert np.abs(field[..., 1] - 127.0 * gy / size).max() < 0.501


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_votes_meet_in_the_middle_of_a_ring(tilt: float) -> None:
    """Every edge of a disc votes for its centre, at its radius and tilt."""
    y, x = np.mgrid[0:64, 0:64]
    squeeze = np.diag([np.cos(tilt), 1.0])
    disc = 200.0 / (1 + np.exp(np.hypot((x - 30.0) / np.cos(tilt), y - 33.0) - 8.0))
    gx, gy = gradients(disc.astype(np.float32), 0.5)
    shapes = np.array([squeeze], np.float32)
    votes = vote_centers(gx, gy, 3.0, shapes, np.array([8.0], np.float32))
    crests = vote_crests(votes, 20)
    best = crests[np.argmax(crests[:, 0])]
    assert abs(2 * best[1] + 0.5 - 30) <= 1.5
    assert abs(2 * best[2] + 0.5 - 33) <= 1.5


@pytest.mark.parametrize("turn", [3, 20, 45, 70, 101])
def test_an_edge_votes_for_the_cells_across_it(turn: int) -> None:
    """Wherever in its cell of two by two pixels it lies, and for squeezed circles, too."""
    angle = 2 * np.pi * turn / 128
    m = np.array([np.cos(angle), np.sin(angle)])
    shapes = np.array([np.eye(2), np.diag([0.8, 1.0])], np.float32)
    for y, x in ((24, 31), (25, 30), (24, 30), (25, 31)):
        gx, gy = np.zeros((2, 50, 60), np.float32)
        gx[y, x], gy[y, x] = 9.0 * m
        votes = vote_centers(gx, gy, 3.0, shapes, np.array([5.0, 8.0], np.float32))
        for shape, mine in zip(shapes.astype(float), votes):
            across = shape @ (shape @ m) / np.linalg.norm(shape @ m)
            middles = [np.array([x, y]) + r * across for r in (-8.0, -5.0, 5.0, 8.0)]
            cells = np.array([np.floor(0.5 * at + 0.25) for at in middles]).astype(int)
            wanted = np.zeros_like(mine)
            np.add.at(wanted, (cells[:, 1], cells[:, 0]), 1)
            np.testing.assert_array_equal(mine, wanted)


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
    field = edge_field(*scene, 4.0)
    model = curves(PORTS["type2_plug"], 0.003)
    points, normals = model.points.astype(np.float32), model.normals[:, :2].astype(np.float32)
    guess = np.array([40.0, 30.0, 600.0, 0.3, -0.2, 0.7])
    at, A = _flat(points.astype(float), guess)
    x, y = np.floor(at + 0.5).astype(int).T
    inside = (x >= 0) & (x < 80) & (y >= 0) & (y < 60)
    n = normals @ np.linalg.inv(A)  # normals go with the inverse transpose
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    g = field[y[inside], x[inside]] / 127.0
    along = np.sum(g * n[inside], axis=1)
    value = 2 * along**2 - np.sum(g**2, axis=1)
    value = np.where((value > 0) & (along < 0), 0.2 * value, value)
    found = template_score(field, points, normals, guess, 0.2, 0.0)
    assert found == pytest.approx(value.sum() / len(points), abs=1e-4)


def test_a_template_sees_which_side_is_dark_and_climbs_to_where_it_fits() -> None:
    """A painted port scores high where it is, little where light and dark are exchanged."""
    T = facing(0.0, 0.0, 1.2, (0.0, 0.0), 0.0)
    image = paint(PORTS["type2"], T, LENS, 0)
    points, normals = template("type2")
    u, v = LENS.project(T[None, :3, 3])[0]
    true = np.array([u, v, LENS.fx / 1.2, 0.0, 0.0, 0.0])
    level = pyramid(image)[0]
    negative = pyramid(255 - image)[0]
    start = true + np.array([1.0, -1.0, 12.0, 0.05, 0.0, 0.06])
    score, end = climb(level.field, points, normals, start, 1.5, 6, 0.2)
    wrong, _ = climb(negative.field, points, normals, start, 1.5, 6, 0.2)
    assert score > 0.6
    assert wrong < 0.3
    assert np.hypot(*(end[:2] - true[:2])) < 0.8
    rolls = np.deg2rad(np.arange(-50.0, 51.0, 10.0))
    tried = true[None] + [0, 0, 0, 0, 0, 1.0]
    best = best_rolls(level.field, points, normals, tried, rolls, 0.2, 0.1)
    assert best[0] > 0.5
    assert abs(tried[0, 5]) < 0.01


def test_distinct_rings_are_few_at_one_place() -> None:
    ring = np.array([0.9, 50.0, 50.0, 0.0, 0.0, 20.0])
    rows = np.tile(ring, (4, 1))
    rows[1, [1, 5]] += 1.0, 0.5
    rows[2, 5] += 3.0
    rows[3, 1] += 30.0
    assert distinct(rows, 10, 5).tolist() == [0, 2, 3]
    assert distinct(rows, 10, 1).tolist() == [0, 3]
    assert distinct(rows, 1, 5).tolist() == [0]


def test_edge_search_finds_a_straight_edge_to_a_twentieth() -> None:
    x = np.arange(60.0)
    row = 100.0 / (1 + np.exp(-(x - 30.3) / 0.8))
    gx, gy = gradients(np.tile(row, (40, 1)).astype(np.float32), 0.0)
    d, strength = edge_search(
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
    assert strength[0] > 10.0  # lighter along the normal


def test_the_quick_fit_ends_where_the_full_one_does() -> None:
    T = facing(0.01, -0.02, 0.5, (0.25, 0.1), 0.2)
    image = paint(PORTS["type2"], T, LENS, 0)
    start = T @ exp(np.array([0.001, -0.001, 0.004, 0.05, -0.05, 0.03]))
    view = look(image, LENS)
    model = curves(PORTS["type2"], 0.002)
    numbers = np.array([LENS.fx, LENS.fy, LENS.cx, LENS.cy, *LENS.distortion])
    reaches = np.array([5.0, 5.0, 4.0, 3.0, 2.5, 2.5, 2.5, 2.5])
    alone = np.full((len(model.points), 2), -1)
    quick, d, _, _ = fit_rigid(
        view.gx, view.gy, numbers, model.points, model.normals, alone, start, reaches, 0.5, 0.2
    )
    full = fit([view], PORTS["type2"], start, FitOptions(makes=False, iterations=10))
    assert np.mean(np.abs(np.nan_to_num(d, nan=9.0)) < 1.5) > 0.9
    assert np.abs(log(inverse(full.T_ref_port) @ quick)).max() < 2e-3
    assert np.allclose(
        project_lens(numbers, 0.1, 0.05, 0.8), LENS.project(np.array([[0.1, 0.05, 0.8]]))[0]
    )


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.7), (0.2, -0.1, 0.9), (1e-7, 0.0, 1.0)])
@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.3, -0.5), (1e-8, 0.0)])
def test_a_flat_guess_turns_with_its_ray_as_scipy_has_it(place, lean) -> None:
    T = flat_pose(*place, *lean, 0.4)
    turn = Rotation.from_rotvec([*lean, 0.0]) * Rotation.from_rotvec([0.0, 0.0, 0.4])
    ray = np.array(place) / np.linalg.norm(place)
    axis = np.cross([0.0, 0.0, 1.0], ray)
    size = np.linalg.norm(axis)
    if size > 1e-9:
        turn = Rotation.from_rotvec(axis / size * np.arcsin(size)) * turn
    expected = turn.as_matrix() @ np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(T[:3, :3], expected, atol=1e-12)
    np.testing.assert_array_equal(T[:3, 3], place)


def test_shares_of_edges_are_those_of_numpy() -> None:
    rng = np.random.default_rng(1)
    rim = rng.permutation(np.repeat(np.arange(5), 20))
    offsets = np.where(rng.random(100) < 0.3, np.nan, rng.normal(0, 2, 100))
    rise, darker = rng.normal(0, 1, 100), np.array([-1, 1, -1, 1, -1])
    reach = np.array([1.0, 2.0, 3.0, 0.5, 9.0])
    near = np.abs(np.where(np.isfinite(offsets), offsets, 99.0)) <= reach[rim]
    right = near & (np.sign(rise) == darker[rim])
    expected = np.bincount(rim, right, 5) / np.bincount(rim)
    np.testing.assert_array_equal(rim_shares(offsets, rise, rim, darker, reach), expected)


def test_spots_are_those_that_numpy_sees() -> None:
    """All of a circle darker, or lighter, than its middle, which may lie a pixel aside."""
    rng = np.random.default_rng(0)
    soft = rng.integers(0, 40, (90, 120)).astype(np.int16)
    middles = np.column_stack([rng.uniform(-0.2, 0.2, (30, 2)), np.zeros(30)])
    T = facing(0.01, -0.02, 1.0, (0.3, 0.2), 0.4)
    lens = np.array([200.0, 200.0, 59.5, 44.5, 0.0, 0.0, 0.0, 0.0, 0.0])

    def seen(points):
        place = points @ T[:3, :3].T + T[:3, 3]
        return 200.0 * place[:, :2] / place[:, 2:] + (59.5, 44.5)

    at = seen(middles)
    y, x = np.mgrid[0:90, 0:120]
    for k, (u, v) in enumerate(at):
        soft[np.hypot(x - u, y - v) < 2.5] += (100, -100, 0)[k % 3]
    kernel = np.outer([1, 2, 1], [1, 2, 1]) / 16.0

    def smooth(u, v):
        column, row = round(min(max(u, 1), 118)), round(min(max(v, 1), 88))
        return float((soft[row - 1 : row + 2, column - 1 : column + 2] * kernel).sum())

    angle = 2.0 * np.pi * np.arange(8) / 8
    expected = np.zeros((2, 30), bool)
    for k, middle in enumerate(middles):
        around = middle + 0.03 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
        circle = seen(around)
        for off in np.ndindex(3, 3):
            u, v = at[k] + np.array(off) - 1
            more = np.array([smooth(*(c + np.array(off) - 1)) for c in circle]) - smooth(u, v)
            expected[:, k] |= [(more < -15.0).all(), (more > 15.0).all()]
    found = spots(soft, lens, T, middles, np.full(30, 0.03), 15.0)
    np.testing.assert_array_equal(found, expected)
    assert expected.any(axis=1).all()
    assert not expected.all()
