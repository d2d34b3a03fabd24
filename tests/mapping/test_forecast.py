"""The occupancy forecast: features against plain definitions, the fit against known truth."""

import numpy as np
import pytest

from armsight.mapping import forecast as f
from armsight.mapping.snapshot import FREE, OCCUPIED, VoxelGrid, WorkspaceSnapshot

GRID = VoxelGrid(np.zeros(3), 0.1, (6, 5, 4))
ALL = np.ones(GRID.shape, np.uint8)


def at(*cells):
    mask = np.zeros(GRID.shape, np.uint8)
    for cell in cells:
        mask[cell] = 1
    return mask


def test_rates_are_counts_of_arrivals_over_observed_free_seconds():
    """Against the definition, summed event by event with its own forgetting."""
    watched = f.OccupancyForecast(GRID)
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.05, 0.4, 60))
    occupied = rng.random((60, *GRID.shape)) < 0.3
    seen = rng.random((60, *GRID.shape)) < 0.7
    for t, o, s in zip(times, occupied, seen):
        watched.observe(o, s | o, t)
    features = watched.features()
    cell = (2, 3, 1)
    for memory, forget in enumerate(f.FORGET):
        arrivals = seconds = 0.0
        was, last = False, None
        for t, o, s in zip(times, occupied, seen):
            o, s = o[cell], s[cell]
            elapsed = 0.0 if last is None else t - last
            weight = np.exp(-(times[-1] - t) / forget)
            if o and not was:
                arrivals += weight
            if s and not o:
                seconds += elapsed * weight
            was = o or (was and not s)  # not seen: as it was
            last = t
        rate = (arrivals + f.PRIOR_ARRIVALS) / (seconds + f.PRIOR_SECONDS[memory])
        assert features[cell][1 + memory] == pytest.approx(np.log(rate), abs=1e-4)


def test_hidden_and_shown_again_is_no_arrival():
    watched = f.OccupancyForecast(GRID)
    cell = (1, 1, 1)
    for k in range(10):  # every second look is blocked
        hidden = k % 2
        seen = ALL.copy()
        seen[cell] = not hidden
        watched.observe(at() if hidden else at(cell), seen, 0.1 * k)
    assert watched._arrivals[1][cell] == pytest.approx(1.0, abs=0.02)


def test_time_unseen_adds_nothing():
    watched = f.OccupancyForecast(GRID)
    for k in range(100):
        watched.observe(at(), at(), 0.1 * k)
    assert (watched._seconds == 0).all()


def test_closing_speed_of_something_that_comes_nearer():
    grid = VoxelGrid(np.zeros(3), 0.05, (20, 3, 3))
    watched = f.OccupancyForecast(grid)
    for k in range(8):  # one voxel each 0.1 s: 0.5 m/s along x
        mask = np.zeros(grid.shape, np.uint8)
        mask[k, 1, 1] = 1
        watched.observe(mask, np.ones(grid.shape), 0.1 * k)
    closing = watched.features()[..., -1]
    assert closing[12, 1, 1] == pytest.approx(0.5, abs=1e-3)
    assert closing[0, 1, 1] < 0  # it goes away from there


def test_probabilities_of_the_shipped_model():
    watched = f.OccupancyForecast(GRID)
    for k in range(10):
        watched.observe(at((0, 0, 0)), ALL, 0.1 * k)
    p = watched.probability()
    assert p.shape == GRID.shape
    assert p.dtype == np.float32
    assert ((p >= 0) & (p <= 1)).all()
    assert p[0, 0, 0] == pytest.approx(f.SHIPPED.stays)
    assert p[1, 0, 0] > p[5, 4, 3]  # near what is occupied, more probable
    points = GRID.center(np.array([[0, 0, 0], [3, 2, 1]]))
    np.testing.assert_allclose(watched.probability_at(points), [p[0, 0, 0], p[3, 2, 1]])
    assert watched.probability_at(np.array([[99.0, 0, 0]])) == [0.0]


def test_fit_finds_the_model_that_made_the_data():
    rng = np.random.default_rng(1)
    truth = np.array([-1.0, 0.5, -0.4, 2.0, -1.0, 0.7, 0.3])
    X = np.column_stack([np.ones(60_000), rng.standard_normal((60_000, 6))])
    occupied = rng.random(len(X)) < 0.2
    outcome = rng.random(len(X)) < np.where(occupied, 0.9, 1 / (1 + np.exp(-X @ truth)))
    model = f.fit_model(X, occupied, outcome, 2.0)
    np.testing.assert_allclose(model.weights, truth, atol=0.08)
    assert model.stays == pytest.approx(0.9, abs=0.01)


def test_fit_survives_data_that_a_plane_separates():
    X = np.column_stack([np.ones(100), np.linspace(-1, 1, 100), *np.zeros((5, 100))])
    model = f.fit_model(X, np.zeros(100), X[:, 1] > 0, 2.0)
    assert np.isfinite(model.weights).all()


def test_time_must_not_run_backwards():
    watched = f.OccupancyForecast(GRID)
    watched.observe(at(), ALL, 1.0)
    with pytest.raises(ValueError, match="backwards"):
        watched.observe(at(), ALL, 0.9)


def test_snapshots_are_watched_on_coarser_voxels():
    """Occupied if any fine voxel holds something seen, free if all are free, else unseen."""
    fine = VoxelGrid(np.zeros(3), 0.02, (7, 6, 6))
    watched = f.OccupancyForecast.coarser(fine, 3)
    assert watched.grid.shape == (3, 2, 2)
    state = np.full(fine.shape, FREE, np.uint8)
    state[0, 0, 0] = OCCUPIED
    state[4, 4, 4] = 0
    hazards = np.concatenate([fine.center(np.array([[0, 0, 0]])), [[9.0, 9, 9]]])
    for k in range(2):
        watched.watch(
            WorkspaceSnapshot(
                sequence=k,
                stamp=float(k),
                oldest=float(k),
                grid=fine,
                state=state,
                distance=np.zeros(fine.shape, np.float32),
                distance_cap=0.3,
                last_occupied=np.zeros(fine.shape, np.float32),
                hazards=hazards.astype(np.float32),
                hazard_radius=0.02,
                hazard_unknown=np.zeros(2, bool),
                cloud=np.zeros((0, 3), np.float32),
                cameras=(),
            ),
            float(k),
        )
    assert np.argwhere(watched._occupied).tolist() == [[0, 0, 0]]
    seen_free = watched._seconds[0] > 0
    assert not seen_free[0, 0, 0]
    assert not seen_free[1, 1, 1]  # one of its fine voxels is unseen
    assert not seen_free[2].any()  # reaches beyond the map
    assert seen_free[1, 0, 0]
