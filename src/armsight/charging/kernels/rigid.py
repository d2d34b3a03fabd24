"""The quick fit of a rigid model's edges to one picture, to compare many guesses."""

from __future__ import annotations

import numpy as np
from numba import njit

from armsight.arrays import Floats, Floats32, Ints, Mask, SignedShorts
from armsight.charging.kernels.edges import crest_of, project_lens, sample_along, sample_room

ROUGH = 2.6
"""A search that reaches farther takes one sample a pixel, a nearer one two [px]."""
ALONG = 0.92
"""Cosine of the greatest angle between an edge's gradient and the normal."""
ASIDE = float(np.tan(np.arccos(ALONG)))
SLACK = 2.5
"""How far noise may draw what one point shows from what it shows with its neighbours: in standard
deviations."""
LAST = 2.5
"""Reach of the search at the end [px]."""


@njit(cache=True, nogil=True, error_model="numpy")
def fit_rigid(
    gx: Floats32 | SignedShorts,
    gy: Floats32 | SignedShorts,
    lens: Floats,
    points: Floats,
    normals: Floats,
    beside: Ints,
    pose: Floats,
    reaches: Floats,
    least: float,
    noise: float,
) -> tuple[Floats, Floats, Floats, Floats]:
    """A quick fit of a rigid model's edges to one picture, to compare many guesses.

    Args:
        gx: (h, w) gradient along x [levels/px].
        gy: (h, w) gradient along y.
        lens: see :func:`project_lens`.
        points: (n, 3) of the edges [m].
        normals: (n, 3) across them, in the plane z = const.
        beside: (n, 2) the points before and behind each one on its edge, -1 for none.
        pose: (4, 4) start.
        reaches: of the search, one an iteration [px].
        least: crests below this are none [levels/px].
        noise: standard deviation of gradients where there is nothing to see [levels/px].

    Returns:
        (4, 4) pose; (n,) distances of the edges at the end [px], NaN for none; (n,) gradients
        along the normals there [levels/px]; (6, 6) information of the pose for edges that are
        known to 1 px, as a twist in the model's frame.
    """
    n = len(points)
    T = pose.copy()
    d, rise, size = np.full(n, np.nan), np.zeros(n), np.empty(n)
    rows, H, g6 = np.empty((n, 6)), np.eye(6), np.zeros(6)
    samples = np.empty((n, 2, sample_room(max(reaches.max(), LAST))), np.float32)
    seen, mean = np.empty(n, np.bool_), np.empty(samples.shape[1:], np.float32)
    resting = False
    for i in range(len(reaches) + 1):
        final = i == len(reaches) or resting
        reach = LAST if final else reaches[i]
        each, width = 1 if reach > ROUGH else 2, max(0.6 * reach, 1.0)
        count = 0
        for k in range(n):
            line = _edge_line(lens, T, points[k], normals[k], rows[k])
            seen[k] = sample_along(gx, gy, line, reach, each, samples[k])
        for k in range(n):
            d[k], rise[k] = np.nan, 0.0
            if seen[k]:
                _with_neighbours(samples, seen, k, beside, mean)
                d[k], rise[k] = crest_of(mean, reach, each, width, least, ALONG)
                if np.isfinite(d[k]):
                    at = int(np.rint(d[k] * each)) + int(np.ceil(reach * each)) + each
                    if not _agrees(samples[k], at, rise[k], least, noise):
                        d[k], rise[k] = np.nan, 0.0
            if np.isfinite(d[k]):
                size[count] = abs(d[k])
                count += 1
        if final:
            break
        if count < 12:
            d[:] = np.nan
            break
        spread = max(1.4826 * np.median(size[:count]), 0.4)
        H[:], g6[:] = 0.0, 0.0
        for k in range(n):
            if np.isfinite(d[k]):
                far = abs(d[k])
                weight = 1.0 / max(far / (1.5 * spread), 1.0)
                if far > 4.0 * spread:
                    weight *= 0.1
                for a in range(6):
                    g6[a] += weight * rows[k, a] * d[k]
                    for b in range(a + 1):
                        H[a, b] += weight * rows[k, a] * rows[k, b]
        for a in range(6):
            H[a, a] *= 1.0 + 1e-6
            for b in range(a):
                H[b, a] = H[a, b]
        x = np.asarray(np.linalg.solve(H + 1e-9 * np.eye(6), g6), np.float64)
        # how far that moves the edges: g.x is the sum of their squares; a step that moves none by
        # a tenth of a pixel is the last but one
        resting = abs((g6 * x).sum()) < 0.01 * count
        _move(T, x)
    return T, d, rise, H


@njit(cache=True, nogil=True, error_model="numpy")
def _with_neighbours(samples: Floats32, seen: Mask, k: int, beside: Ints, mean: Floats32) -> None:
    """What is seen along a point's normal and those of the points beside it on the same edge.

    The same edge lies at the same place on all three, noise and other things do not.
    """
    mean[:] = samples[k]
    count = np.float32(1.0)
    for side in range(2):
        j = beside[k, side]
        if j >= 0 and seen[j]:
            mean += samples[j]
            count += np.float32(1.0)
    mean /= count


@njit(cache=True, nogil=True, error_model="numpy")
def _agrees(own: Floats32, at: int, rise: float, least: float, noise: float) -> bool:
    """Whether a point itself, but for noise, shows the edge that it shows with its neighbours.

    A strong edge of something else at one of them is none of the others'.
    """
    slack = SLACK * noise
    along = own[0, at] if rise > 0.0 else -own[0, at]
    aside = abs(own[1, at])
    return along >= least - slack and aside <= ASIDE * max(along, 0.0) + slack


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_line(
    lens: Floats, T: Floats, p: Floats, m: Floats, row: Floats
) -> tuple[float, float, float, float]:
    """Where a point of an edge is seen, and the edge's normal there; row: its Jacobian."""
    x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
    y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
    z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
    if z < 0.02:
        row[:] = 0.0
        return -1e6, -1e6, 1.0, 0.0
    h = 1e-4
    u, v = project_lens(lens, x, y, z)
    u2, v2 = project_lens(
        lens,
        x + h * (T[0, 1] * m[0] - T[0, 0] * m[1]),
        y + h * (T[1, 1] * m[0] - T[1, 0] * m[1]),
        z + h * (T[2, 1] * m[0] - T[2, 0] * m[1]),
    )
    du, dv = u2 - u, v2 - v
    norm = np.sqrt(du * du + dv * dv) + 1e-12
    nx, ny = dv / norm, -du / norm
    a, b = nx * lens[0] / z, ny * lens[1] / z
    c = -(a * x + b * y) / z
    for k in range(3):
        row[k] = a * T[0, k] + b * T[1, k] + c * T[2, k]
    row[3] = p[1] * row[2] - p[2] * row[1]
    row[4] = p[2] * row[0] - p[0] * row[2]
    row[5] = p[0] * row[1] - p[1] * row[0]
    return u, v, nx, ny


@njit(cache=True, nogil=True)
def rim_shares(offsets: Floats, rise: Floats, rim: Ints, darker: Ints, reach: Floats) -> Floats:
    """(rims,) share of each edge's points that lie near enough and have their dark side inwards.

    Args:
        offsets: (n,) of :func:`fit_rigid` [px].
        rise: (n,) of :func:`fit_rigid`.
        rim: (n,) edge of each point.
        darker: (rims,) sign of the gradient that each edge should have.
        reach: (rims,) how near is near [px].
    """
    found, count = np.zeros(len(reach)), np.zeros(len(reach))
    for i in range(len(rim)):
        k = rim[i]
        count[k] += 1.0
        if abs(offsets[i]) <= reach[k] and np.sign(rise[i]) == darker[k]:
            found[k] += 1.0
    return found / count


@njit(cache=True, nogil=True, error_model="numpy")
def flat_pose(x: float, y: float, z: float, lean_x: float, lean_y: float, roll: float) -> Floats:
    """(4, 4) pose of a port that faces the lens, rolled, then leaning, as seen along its ray.

    Args:
        x: of the place in the lens's frame [m].
        y: the same.
        z: the same, along the lens's axis.
        lean_x: about the picture's x [rad].
        lean_y: about its y [rad].
        roll: about the port's axis [rad].
    """
    facing = np.diag(np.array([1.0, -1.0, -1.0]))
    R = _turn(lean_x, lean_y, 0.0) @ (_turn(0.0, 0.0, roll) @ facing)
    far = np.sqrt(x * x + y * y + z * z)
    aside = np.sqrt(x * x + y * y) / far
    if aside > 1e-9:  # off the middle of the picture the port is turned with the ray
        angle = np.arcsin(min(aside, 1.0)) / (aside * far)
        R = _turn(-y * angle, x * angle, 0.0) @ R
    T = np.eye(4)
    T[:3, :3] = R
    T[0, 3], T[1, 3], T[2, 3] = x, y, z
    return T


@njit(cache=True, nogil=True)
def _turn(x: float, y: float, z: float) -> Floats:
    """(3, 3) rotation by a vector [rad]."""
    angle = np.sqrt(x * x + y * y + z * z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = 1.0, 0.5
    if angle > 1e-6:
        s, c = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    return np.eye(3) + s * K + c * (K @ K)


@njit(cache=True, nogil=True)
def _move(T: Floats, x: Floats) -> None:
    """Move a pose by a twist in its own frame, by 5 cm and a quarter of a radian at most."""
    far = max(np.sqrt((x[:3] ** 2).sum()) / 0.05, np.sqrt((x[3:] ** 2).sum()) / 0.25)
    if far > 1.0:
        x = x / far
    R = np.ascontiguousarray(T[:3, :3])
    T[:3, 3] += R @ x[:3]
    T[:3, :3] = R @ _turn(x[3], x[4], x[5])
