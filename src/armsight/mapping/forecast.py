"""Which places will be occupied within the next seconds: a forecast with probabilities.

T2's danger says how long ago a place was occupied. This says how probable it is that the place
will be occupied within a horizon, from

* how often it became occupied for each second it was seen free, forgotten over seconds and over
  minutes: r = (n + a) / (e + b), with arrivals n, observed free seconds e and a prior a, b;
* how far it is from what is occupied now: people do not jump;
* how fast that distance has been falling over the last half second.

Both enter a logistic model, p = 1 / (1 + exp(-w . x)), fitted to recorded people by
``armsight experiment danger-map``; time in which a place is not seen adds nothing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Bytes, Floats, Floats32, Points
from armsight.mapping.distance_field import bounded_distance
from armsight.mapping.snapshot import FREE, VoxelGrid, WorkspaceSnapshot

FORGET = (3.0, 60.0)
"""Time constants of the two memories [s]."""
PRIOR_ARRIVALS, PRIOR_SECONDS = 0.02, (2.0, 5.0)
"""Arrivals and seconds believed before anything was seen, for each memory."""
LENGTHS = (0.06, 0.2, 0.6)
"""Decay lengths of nearness [m]."""
LOOK_BACK = 0.5
"""Over how long the speed of approach is taken [s]."""
FEATURES = (
    "1",
    "ln r_3s",
    "ln r_60s",
    *(f"exp(-d / {length} m)" for length in LENGTHS),
    "closing speed in m/s",
)
"""What the weights are of."""


@dataclass(frozen=True)
class ForecastModel:
    """Weights of the logistic model for one horizon.

    Attributes:
        horizon: [s].
        weights: (7,) of ``FEATURES``, for places that are free or unseen now.
        stays: probability that a place occupied now is occupied at some time within the horizon.
    """

    horizon: float
    weights: Floats
    stays: float = 1.0

    def probability(self, features: Floats, occupied: Bytes) -> Floats:
        """(n,) probabilities from (n, 7) features and (n,) whether occupied now."""
        p = 1.0 / (1.0 + np.exp(-(features @ self.weights)))
        return np.asarray(np.where(np.asarray(occupied) != 0, self.stays, p))


class OccupancyForecast:
    """Watches the voxels of a grid and forecasts them.

    Args:
        grid: usually coarser than the map's; see :meth:`coarser`.
        model: the fitted model; the one shipped if absent.
    """

    def __init__(self, grid: VoxelGrid, model: ForecastModel | None = None) -> None:
        self.grid = grid
        self.model = model or SHIPPED
        self._arrivals: Floats32 = np.zeros((2, *grid.shape), np.float32)
        self._seconds: Floats32 = np.zeros((2, *grid.shape), np.float32)
        self._occupied = np.zeros(grid.shape, bool)
        self._parts = 1
        self._now: float | None = None
        self._cap = 15 * grid.voxel
        self._distance: Floats32 = np.full(grid.shape, self._cap, np.float32)
        self._past: deque[tuple[float, Floats32]] = deque()

    @classmethod
    def coarser(
        cls, fine: VoxelGrid, parts: int = 3, model: ForecastModel | None = None
    ) -> OccupancyForecast:
        """A forecast on voxels of ``parts`` fine ones along each edge, fed by snapshots."""
        n = [-(-s // parts) for s in fine.shape]
        made = cls(VoxelGrid(fine.origin, fine.voxel * parts, (n[0], n[1], n[2])), model)
        made._parts = parts
        return made

    def watch(self, snapshot: WorkspaceSnapshot, now: float) -> None:
        """Take in a snapshot: moving things seen, and space seen free.

        Args:
            snapshot: of the fine grid that :meth:`coarser` was given.
            now: [s].
        """
        seen = np.zeros(snapshot.grid.shape, bool)
        hazards = snapshot.hazards[~snapshot.hazard_unknown]
        index = snapshot.grid.index(hazards)
        inside = ((index >= 0) & (index < snapshot.grid.shape)).all(axis=1)
        seen[tuple(index[inside].T)] = True
        occupied = _coarse(seen, self._parts, np.any)
        free = _coarse(snapshot.state == FREE, self._parts, np.all)
        self.observe(occupied, occupied | free, now)

    def observe(self, occupied: Bytes, observed: Bytes, now: float) -> None:
        """Take in what is occupied and what is seen at all, at a time.

        Args:
            occupied: (nx, ny, nz) truth values; what is occupied counts as seen.
            observed: (nx, ny, nz) truth values.
            now: [s]; never before the last call's.

        Raises:
            ValueError: time ran backwards.
        """
        o = np.asarray(occupied) != 0
        free = (np.asarray(observed) != 0) & ~o
        elapsed = 0.0 if self._now is None else now - self._now
        if elapsed < 0:
            raise ValueError(f"forecast: time ran backwards by {-elapsed:.3f} s")
        arrived = o & ~self._occupied
        for memory, forget in enumerate(FORGET):
            keep = np.float32(np.exp(-elapsed / forget))
            self._arrivals[memory] *= keep
            self._seconds[memory] *= keep
            self._arrivals[memory][arrived] += 1.0
            self._seconds[memory][free] += np.float32(elapsed)
        # Unseen places keep their last known state: hidden and shown again is no arrival.
        self._occupied = np.where(free, False, o | self._occupied)
        self._now = now
        self._distance = bounded_distance(self._occupied, self.grid.voxel, self._cap)
        self._past.append((now, self._distance))
        while len(self._past) > 1 and self._past[1][0] <= now - LOOK_BACK + 1e-9:
            self._past.popleft()

    def features(self) -> Floats:
        """(nx, ny, nz, 7) features of every voxel; see ``FEATURES``."""
        rates = [
            np.log((self._arrivals[m] + PRIOR_ARRIVALS) / (self._seconds[m] + PRIOR_SECONDS[m]))
            for m in range(2)
        ]
        near = [np.exp(-self._distance / length) for length in LENGTHS]
        return np.stack([np.ones(self.grid.shape), *rates, *near, self._closing()], axis=-1)

    def _closing(self) -> Floats32:
        """Speed at which what is occupied has come nearer to each voxel [m/s]."""
        if not self._past or self._past[-1][0] - self._past[0][0] < 0.5 * LOOK_BACK:
            return np.zeros(self.grid.shape, np.float32)
        (then, before), (now, distance) = self._past[0], self._past[-1]
        return np.asarray((before - distance) / np.float32(now - then))

    def probability(self) -> Floats32:
        """(nx, ny, nz) float32: probability of being occupied within the model's horizon."""
        flat = self.features().reshape(-1, len(FEATURES))
        p = self.model.probability(flat, self._occupied.reshape(-1))
        return p.reshape(self.grid.shape).astype(np.float32)

    def probability_at(self, points: Points) -> Floats:
        """(n,) the same at (n, 3) points; 0 outside the grid."""
        whole = self.probability()
        index = self.grid.index(points)
        inside = ((index >= 0) & (index < self.grid.shape)).all(axis=1)
        out = np.zeros(len(index))
        out[inside] = whole[tuple(index[inside].T)]
        return out


def fit_model(
    features: Floats, occupied: Bytes, outcome: Bytes, horizon: float, ridge: float = 1e-6
) -> ForecastModel:
    """Fit the weights by maximum likelihood (iteratively reweighted least squares).

    Args:
        features: (n, 7) see ``FEATURES``.
        occupied: (n,) whether occupied at the time of the forecast.
        outcome: (n,) whether occupied at some time within the horizon after it.
        horizon: [s].
        ridge: weight of a quadratic penalty per sample, which keeps the solution finite.
    """
    now = np.asarray(occupied) != 0
    y = np.asarray(outcome, float)
    X, z = np.asarray(features, float)[~now], y[~now]
    w = np.zeros(X.shape[1])
    penalty = ridge * len(z) * np.eye(len(w))
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-(X @ w)))
        hessian = X.T @ (X * (p * (1.0 - p))[:, None]) + penalty
        step = np.linalg.solve(hessian, X.T @ (z - p) - penalty @ w)
        w = w + step
        if np.abs(step).max() < 1e-8:
            break
    stays = float(y[now].mean()) if now.any() else 1.0
    return ForecastModel(horizon, w, min(max(stays, 0.5), 1.0))


def _coarse(fine: np.ndarray, parts: int, rule: np.ufunc | object) -> np.ndarray:
    """Blocks of ``parts`` cubed voxels by a rule (np.any, np.all), padded with False."""
    if parts == 1:
        return fine
    pad = [(0, -n % parts) for n in fine.shape]
    padded = np.pad(fine, pad)
    n = [s // parts for s in padded.shape]
    blocks = padded.reshape(n[0], parts, n[1], parts, n[2], parts)
    return np.asarray(rule(blocks, axis=(1, 3, 5)))  # type: ignore[operator]


SHIPPED = ForecastModel(
    2.0, np.array([-5.930, -0.547, 0.840, 0.797, -1.746, 7.239, 3.901]), stays=0.923
)
"""Fitted to all 28 recorded people; ``armsight experiment danger-map`` prints these weights."""
