"""The joint fit of a port's known edges to any number of pictures of it.

Every edge is looked for along its projected normal, at its own depth; pose and what a make may
differ in (size, place and depth of each edge, each with its tolerance as prior) are solved by
Gauss-Newton. What lighting does to one edge in one picture (a chamfer lit from the side moves it)
is a small unknown of that edge and picture, so that the stated covariance does not count a
hundred points that err alike as a hundred opinions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, Mask, Points, Pose
from armsight.charging.kernels.edges import edge_search
from armsight.charging.looks import Look
from armsight.charging.ports.curves import Curves, curves
from armsight.charging.ports.table import Port
from armsight.geometry.pose import exp, inverse

POINT_SIGMA = 0.35
"""Standard deviation of one edge point [px]."""
SHIFT_SIGMA = 0.15
"""Standard deviation of what light does to the place of one edge in one picture [px]."""
SWELL_SIGMA = 0.35
"""The same for its size [px]."""
OVAL_SIGMA = 0.2
"""The same for its ovalness: the far wall of a groove shows below its rim, the near one not."""
ALIKE = 0.95
SIDE_BY_SIDE = 0.3
"""What light does is the same to this degree in pictures from one place, less where their lenses
are seen from the port so far apart [rad]: at the true poses and makes of rendered ports it had
correlations of 0.7 to 0.9 at 11 deg, 0.3 to 0.9 at 28 deg."""
MAKE = 5
"""Unknowns of make for each edge: size, x, y, z, and half the straight part of a slot: without the
last, a slot of other proportions than the table's would look tilted."""
LIGHT = 5
"""Unknowns of light for each edge in each picture."""
MISSING = 9.0
"""Cost of a point without an edge, in squared standard deviations."""


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        reach: of the first search along the normals [px].
        iterations: at the full reach and down to 2.5 px.
        makes: whether sizes and places of edges may differ from the table's.
        spacing: of points along the edges [px].
        most_spacing: the same in the port [m].
        matched: an edge this near to where it should be counts as found [px].
    """

    reach: float = 6.0
    iterations: int = 8
    makes: bool = True
    spacing: float = 2.0
    most_spacing: float = 0.003
    matched: float = 1.5


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes:
        T_ref_port: the pose.
        covariance: (6, 6) of the pose as a twist in the port's frame: metres, radians.
        score: share of the edge points that were found, 0..1.
        cost: sum of squared standardised residuals; a missing point costs :data:`MISSING`.
        points: how many points were looked for.
        make: (rims, 5) how size, x, y, z and a slot's straight part differ from the table [m].
        edges: one (n, 2) array of pixels a picture, NaN where no edge was found.
        found: (views * n,) which points were found.
        curves: the points that were looked for.
        rms: of what was found [px].
        rim_scores: (rims,) share found of each edge.
        corners: (2,) of each picture: what was fitted began at this pixel of it.
    """

    T_ref_port: Pose
    covariance: Floats
    score: float
    cost: float
    points: int
    make: Floats
    edges: tuple[Floats, ...]
    found: Mask
    curves: Curves
    rms: float
    rim_scores: Floats
    corners: tuple[Floats, ...] = ()


@dataclass(frozen=True)
class _Row:
    """Linear picture of one view about a pose."""

    pixels: Floats
    normals: Floats
    by_pose: Floats
    by_make: Floats


def spaced_curves(port: Port, looks: Sequence[Look], T: Pose, options: FitOptions) -> Curves:
    """Points along the port's edges about as dense as asked for in the sharpest picture."""
    fine = max(look.lens.fx / max((look.T_lens_ref @ T)[2, 3], 0.05) for look in looks)
    step = float(np.clip(options.spacing / fine, 0.0004, options.most_spacing))
    return curves(port, float(2.0 ** (0.5 * np.round(2.0 * np.log2(step)))))


def fit(
    looks: Sequence[Look],
    port: Port,
    T_ref_port: Pose,
    options: FitOptions | None = None,
) -> Fit:
    """Fit a port's pose to pictures.

    Args:
        looks: at least one.
        port: what is looked for.
        T_ref_port: where it is about.
        options: how.
    """
    options = options or FitOptions()
    model = spaced_curves(port, looks, T_ref_port, options)
    T = T_ref_port.copy()
    make = np.zeros((len(model.rims), MAKE))
    reaches = np.geomspace(max(options.reach, 2.5), 2.5, max(options.iterations - 2, 1))
    H, alike = np.eye(6), _alike(looks, T_ref_port)
    for i in range(options.iterations):
        reach = float(reaches[min(i, len(reaches) - 1)])
        rows = [_predict(view, model, T, make) for view in looks]
        offsets = [_search(view, row, reach) for view, row in zip(looks, rows)]
        bend = options.makes and i >= options.iterations // 2
        step, H, make = _solve(model, rows, offsets, make, alike if bend else None)
        T = T @ exp(step)
        if np.linalg.norm(step[:3]) < 2e-6 and np.linalg.norm(step[3:]) < 2e-5 and reach < 2.6:
            break
    return _result(looks, model, T, make, H, options.matched)


def _predict(view: Look, model: Curves, T_ref_port: Pose, make: Floats) -> _Row:
    """Where edges should be in a picture, and how pose and make move them."""
    p = _made(model, make)
    T = view.T_lens_ref @ T_ref_port
    R, lens = T[:3, :3], view.lens
    q = p @ R.T + T[:3, 3]
    tangent = np.stack([-model.normals[:, 1], model.normals[:, 0], np.zeros(len(p))], 1) @ R.T
    outward = model.normals @ R.T
    h = 1e-4
    pixels = lens.project(np.concatenate([q, q + h * tangent, q + h * outward]))
    u, along, out = np.split(pixels, 3)
    t = along - u
    n = np.stack([t[:, 1], -t[:, 0]], 1)
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-12)
    n *= np.where(np.einsum("ij,ij->i", n, out - u) < 0, -1.0, 1.0)[:, None]
    z = q[:, 2:]
    # change of pixel along the normal with the point's place in the lens's frame
    g = np.stack([n[:, 0] * lens.fx, n[:, 1] * lens.fy], 1) / z
    ray = q[:, :2] / z
    along_q = np.column_stack([g, -np.einsum("ij,ij->i", g, ray)])
    in_port = along_q @ R
    by_pose = np.column_stack([in_port, np.cross(p, in_port)])
    grown = np.einsum("ij,ij->i", in_port, model.normals)
    by_make = np.column_stack([grown, in_port, in_port[:, 0] * model.side])
    return _Row(u, n, by_pose, by_make)


def _search(view: Look, row: _Row, reach: float) -> Floats:
    least = max(2.5 * view.noise, 0.25)
    good = np.asarray(np.isfinite(row.pixels).all(axis=1))
    pixels = np.where(good[:, None], row.pixels, -1e6)
    offsets, _ = edge_search(
        view.gx, view.gy, pixels, row.normals, reach, max(0.6 * reach, 1.0), least, 0.92
    )
    return offsets


def _solve(
    model: Curves,
    rows: Sequence[_Row],
    offsets: Sequence[Floats],
    make: Floats,
    alike: Floats | None,
) -> tuple[Floats, Floats, Floats]:
    """One step: (6,) twist, (6, 6) information of the pose, new (rims, 5) make.

    Without ``alike`` (see :func:`_alike`) make and light are not unknown.
    """
    d = np.concatenate(offsets)
    seen = np.isfinite(d)
    r = np.where(seen, d, 0.0)
    if seen.sum() < 12:
        return np.zeros(6), np.eye(6) * 1e-3, make
    spread = max(1.4826 * float(np.median(np.abs(r[seen]))), POINT_SIGMA)
    size = np.abs(r) / (1.5 * spread)
    weight = np.where(seen, 1.0 / np.maximum(size, 1.0), 0.0)
    weight *= np.where(np.abs(r) > 4.0 * spread, 0.1, 1.0) / spread**2
    A = np.concatenate([row.by_pose for row in rows])
    H = A.T @ (A * weight[:, None]) + np.eye(6) * 1e-6
    g = A.T @ (weight * r)
    if alike is None:
        step = np.linalg.solve(H, g)
    else:
        rims = _by_rim(model, rows, r, weight, make, alike)
        known = np.linalg.solve(rims.own, np.concatenate([rims.cross, rims.g[:, :, None]], 2))
        taken = np.einsum("kip,kiq->pq", rims.cross, known)
        H = H - taken[:, :6]
        step = np.linalg.solve(H, g - taken[:, 6])
        make = make + (known[..., 6] - known[..., :6] @ step)[:, :MAKE]
    # a first guess may be far off, but not by more than what was searched
    too_far = max(np.linalg.norm(step[:3]) / 0.05, np.linalg.norm(step[3:]) / 0.25, 1.0)
    return step / too_far, H, make


@dataclass(frozen=True)
class _Rims:
    """Normal equations of each edge's own unknowns: make, then light in each picture.

    Attributes:
        own: (rims, m, m) among themselves, with what is known before.
        cross: (rims, m, 6) with the pose.
        g: (rims, m) right side.
    """

    own: Floats
    cross: Floats
    g: Floats


def _by_rim(
    model: Curves,
    rows: Sequence[_Row],
    r: Floats,
    weight: Floats,
    make: Floats,
    alike: Floats,
) -> _Rims:
    """Edges share nothing but the pose, so each has a small system of its own."""
    k, n, views = len(model.rims), len(model.points), len(rows)
    m = MAKE + LIGHT * views
    own, cross, g = np.zeros((k, m, m)), np.zeros((k, m, 6)), np.zeros((k, m))
    own += _known_before(model, alike)
    g[:, :MAKE] -= np.einsum("kii->ki", own)[:, :MAKE] * make
    for v, row in enumerate(rows):
        x, y = row.normals.T
        lit = np.column_stack([x, y, np.ones(n), x * x - y * y, 2.0 * x * y])
        at = np.r_[:MAKE, MAKE + LIGHT * v : MAKE + LIGHT * (v + 1)]
        A, b = np.column_stack([row.by_make, lit]), weight[v * n : (v + 1) * n]
        Ab = A * b[:, None]
        for i in range(k):
            of = model.rim == i
            own[i][np.ix_(at, at)] += Ab[of].T @ A[of]
            cross[i, at] += Ab[of].T @ row.by_pose[of]
            g[i, at] += Ab[of].T @ r[v * n : (v + 1) * n][of]
    return _Rims(own, cross, g)


def _known_before(model: Curves, alike: Floats) -> Floats:
    """(rims, m, m) information of make by its tolerances, and of what light may do."""
    size, place, depth = np.array(
        [(rim.radius_tolerance, rim.place_tolerance, rim.depth_tolerance) for rim in model.rims]
    ).T
    tolerance = np.column_stack([size, place, place, depth, size])
    light = np.array([SHIFT_SIGMA, SHIFT_SIGMA, SWELL_SIGMA, OVAL_SIGMA, OVAL_SIGMA])
    deep = np.array([2.0 if rim.kind == "mouth" else 1.0 for rim in model.rims])
    lit = np.kron(np.linalg.inv(alike), np.diag(light**-2.0))
    m = MAKE + len(lit)
    known = np.zeros((len(model.rims), m, m))
    known[:, range(MAKE), range(MAKE)] = tolerance**-2.0
    known[:, MAKE:, MAKE:] = lit / deep[:, None, None] ** 2
    return known


def _alike(looks: Sequence[Look], T_ref_port: Pose) -> Floats:
    """(views, views) correlation of what light does to an edge in two pictures.

    Lenses that stand side by side see the same chamfers and the same far walls of grooves: taken
    for two opinions these would hide what the pair tells of the tilt.
    """
    away = np.array([inverse(look.T_lens_ref)[:3, 3] - T_ref_port[:3, 3] for look in looks])
    sight = away / np.linalg.norm(away, axis=1, keepdims=True)
    angle = np.arccos(np.clip(sight @ sight.T, -1.0, 1.0))
    near = np.exp(-0.5 * (angle / SIDE_BY_SIDE) ** 2)
    return np.asarray(ALIKE * near + (1.0 - ALIKE) * np.eye(len(looks)))


def _result(
    looks: Sequence[Look],
    model: Curves,
    T: Pose,
    make: Floats,
    information: Floats,
    matched: float,
) -> Fit:
    rows = [_predict(view, model, T, make) for view in looks]
    offsets = [_search(view, row, matched + 1.0) for view, row in zip(looks, rows)]
    d = np.concatenate(offsets)
    found = np.abs(np.where(np.isfinite(d), d, 99.0)) <= matched
    squares = np.where(np.isfinite(d), np.minimum((d / POINT_SIGMA) ** 2, MISSING), MISSING)
    rms = float(np.sqrt(np.mean(d[found] ** 2))) if found.any() else float("nan")
    inflation = max((rms / POINT_SIGMA) ** 2, 1.0) if found.any() else 1.0
    covariance = np.asarray(np.linalg.pinv(information) * inflation, np.float64)
    edges = tuple(
        row.pixels + np.asarray(o)[:, None] * row.normals for row, o in zip(rows, offsets)
    )
    views = len(looks)
    rim_scores = _share(np.tile(model.rim, views), found, len(model.rims))
    return Fit(
        T,
        covariance,
        float(found.mean()),
        float(squares.sum()),
        len(d),
        make,
        edges,
        found,
        model,
        rms,
        rim_scores,
    )


def _share(index: Ints, found: Mask, size: int) -> Floats:
    total = np.maximum(np.bincount(index, minlength=size), 1)
    return np.asarray(np.bincount(index, found, size) / total, np.float64)


def turned(T_ref_port: Pose, lean_x: float = 0.0, lean_y: float = 0.0, roll: float = 0.0) -> Pose:
    """The pose turned about the port's own axes [rad]."""
    return np.asarray(T_ref_port @ exp(np.array([0, 0, 0, lean_x, lean_y, roll])))


def model_points(result: Fit) -> Points:
    """(n, 3) points of the fitted make in the reference frame [m]."""
    p = _made(result.curves, result.make)
    return np.asarray(p @ result.T_ref_port[:3, :3].T + result.T_ref_port[:3, 3])


def _made(model: Curves, make: Floats) -> Points:
    """(n, 3) points of a make in the port's frame [m]."""
    own = make[model.rim]
    p = model.points + own[:, :1] * model.normals + own[:, 1:4]
    p[:, 0] += own[:, 4] * model.side
    return np.asarray(p)
