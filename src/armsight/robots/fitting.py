"""Fitting spheres and capsules to the links of an arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armsight.arrays import Floats, JointVector, Points
from armsight.errors import RobotError
from armsight.robots.chain import LONGEST, Chain, ChainLink
from armsight.robots.covering import Axes, cover, refine
from armsight.robots.covering_kernels import axis_distances
from armsight.robots.fit_quality import measure, report
from armsight.robots.link_body import (
    FitOptions,
    LinkBody,
    chain_arrays,
    link_triangles,
    prepare_chain,
)
from armsight.robots.meshes import Triangles
from armsight.robots.pairs import PairStatistics, pair_statistics
from armsight.robots.shapes import BodyShapes, make_capsules, make_spheres
from armsight.robots.solids import thin

SMALLEST_LINK = 0.01
"""[m] The largest link of an arm is never smaller."""


def fit_body(body: LinkBody, options: FitOptions, what: str) -> tuple[Axes, Floats]:
    """Spheres (``balls``) or capsules (``segments``) that cover a link: axes and radii [m]."""
    spheres = what == "balls"
    candidates = body.balls if spheres else body.segments
    excesses = np.array(options.sphere_excess if spheres else options.capsule_excess)
    price = options.sphere_price if spheres else options.capsule_price
    rng = np.random.default_rng(options.seed)
    fits = [
        cover(body.points, body.around, candidates, excesses, price, options.rounds, rng)
        for _ in range(options.restarts)
    ]
    axes, radius, _ = min(fits, key=lambda fit: fit[2])
    # The check's points are too many to fit; those that stick out join the points to cover.
    points = body.points
    for _ in range(options.completions):
        distance = axis_distances(body.check, axes.start, axes.end)
        lack = (distance - radius[:, None]).min(axis=0)
        out = np.flatnonzero(lack > 0.0)
        if not len(out):
            break
        points = np.concatenate([points, thin(body.check[out], 2 * options.check_spacing)])
        axes, radius, _ = refine(points, body.around, axes, radius, 0.0)
    radius = complete(body.check, axes, radius) + options.margin
    return without_idle(np.concatenate([body.points, body.check]), axes, radius)


def without_idle(points: Points, axes: Axes, radius: Floats) -> tuple[Axes, Floats]:
    """Without shapes that others make superfluous, the smallest first."""
    inside = axis_distances(points, axes.start, axes.end) <= radius[:, None]
    kept = np.ones(len(radius), bool)
    count = inside.sum(axis=0)
    for k in np.argsort(radius):
        if (count[inside[k]] > 1).all():
            kept[k] = False
            count -= inside[k]
    return axes.take(np.flatnonzero(kept)), radius[kept]


def complete(points: Points, axes: Axes, radius: Floats) -> Floats:
    """Radii grown just so far that no point is left outside."""
    radius = radius.copy()
    distance = axis_distances(points, axes.start, axes.end)
    lack = (distance - radius[:, None]).min(axis=0)
    for p in np.argsort(-lack):
        if lack[p] <= 0.0:
            break
        nearest = int(np.argmin(distance[:, p] - radius))
        radius[nearest] = max(radius[nearest], distance[nearest, p])
    return radius


def fit_chain(
    chain: Chain,
    lower: JointVector,
    upper: JointVector,
    options: FitOptions | None = None,
    triangles: list[Triangles] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> BodyShapes:
    """Fit spheres and capsules to an arm and find the pairs of links worth checking.

    Args:
        chain: the arm.
        lower: (n,) least joint positions [rad], for sampling pairs of links.
        upper: (n,) greatest joint positions [rad].
        options: how to fit.
        triangles: per link, in its frame; the URDF's own geometry when None.
        say: told of progress.

    Raises:
        RobotError: a mesh cannot be read, or no link has any geometry.
    """
    options = options or FitOptions()
    given = [sphere_collisions(link) for link in chain.links]
    if triangles is None and _all_spheres(chain):
        return _given_shapes(chain, lower, upper, given, options.seed)
    triangles = triangles or [link_triangles(link) for link in chain.links]
    if not any(len(faces) for _, faces in triangles):
        raise RobotError("the robot has no geometry to fit spheres to; give it visuals or shapes")
    _check_sizes(chain, triangles)
    bodies = prepare_chain(chain, triangles, lower, upper, options)
    balls: list[tuple[int, list[float]]] = []
    rods: list[tuple[int, list[float]]] = []
    ball_fit: list[tuple[Floats, Floats]] = []
    rod_fit: list[tuple[Floats, Floats]] = []
    for i, body in enumerate(bodies):
        if body is None:
            continue
        # The base never moves: its spheres meet the arm alone, so many cost little.
        ours = replace(options, sphere_price=0.3 * options.sphere_price) if i == 0 else options
        axes, radius = fit_body(body, ours, "balls")
        balls += [(i, [*c, r]) for c, r in zip(axes.start.tolist(), radius.tolist())]
        ball_fit.append(measure(body, axes, radius))
        axes, radius = fit_body(body, options, "segments")
        ends = zip(axes.start.tolist(), axes.end.tolist(), radius.tolist())
        rods += [(i, [*a, *b, r]) for a, b, r in ends]
        rod_fit.append(measure(body, axes, radius))
        one, many = report(ball_fit[-1:]), sum(link == i for link, _ in balls)
        say(f"{chain.links[i].name}: {many} spheres, overshoot p95 {one.overshoot_p95:.4f} m")
    spheres = make_spheres(balls)
    statistics = pair_statistics(
        *chain_arrays(chain),
        lower,
        upper,
        spheres,
        [None if b is None else (thin(b.check, 0.008), b.solid) for b in bodies],
        np.random.default_rng(options.seed),
    )
    for line in pair_lines(statistics, chain):
        say(line)
    return BodyShapes(
        spheres,
        make_capsules(rods),
        statistics.worth_checking(),
        statistics.worth_checking_with_tool(len(chain.links) - 1),
        report(ball_fit),
        report(rod_fit),
    )


def _check_sizes(chain: Chain, triangles: list[Triangles]) -> None:
    """Refuses links in millimetres, and those made a thousand times too small."""
    sizes = [
        float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0 for corners, _ in triangles
    ]
    largest = int(np.argmax(sizes))
    name, size = chain.links[largest].name, sizes[largest]
    if size > LONGEST:
        raise RobotError(
            f'link "{name}": its shapes are {size:.3g} m long; lengths are in metres, and a mesh '
            'in millimetres needs scale="0.001 0.001 0.001"'
        )
    if size < SMALLEST_LINK:
        raise RobotError(
            f'the largest link, "{name}", is {1e3 * size:.2g} mm long; lengths are in metres, and '
            "a mesh in metres needs no scale"
        )


def _all_spheres(chain: Chain) -> bool:
    """Whether there is collision geometry, made of spheres alone, for all that is seen."""
    return any(link.collisions for link in chain.links) and all(
        link.spheres for link in chain.links
    )


def _given_shapes(
    chain: Chain,
    lower: JointVector,
    upper: JointVector,
    given: list[tuple[Axes, Floats] | None],
    seed: int,
) -> BodyShapes:
    """The spheres of a "spherized" URDF as they are; as capsules too, which need no length."""
    balls: list[tuple[int, list[float]]] = []
    rods: list[tuple[int, list[float]]] = []
    for i, found in enumerate(given):
        if found is not None:
            for c, r in zip(found[0].start.tolist(), found[1].tolist()):
                balls.append((i, [*c, r]))
                rods.append((i, [*c, *c, r]))
    spheres = make_spheres(balls)
    statistics = pair_statistics(
        *chain_arrays(chain),
        lower,
        upper,
        spheres,
        None,
        np.random.default_rng(seed),
    )
    return BodyShapes(
        spheres,
        make_capsules(rods),
        statistics.worth_checking(),
        statistics.worth_checking_with_tool(len(chain.links) - 1),
        None,
        None,
    )


def sphere_collisions(link: ChainLink) -> tuple[Axes, Floats] | None:
    """The spheres of a link whose collision geometry is spheres only, as "spherized" URDFs have."""
    shapes = link.collisions
    if not shapes or any(shape.kind != "sphere" for shape in shapes):
        return None
    centers = np.stack([shape.T_link_geometry[:3, 3] for shape in shapes])
    return Axes(centers, centers, np.zeros(len(centers))), np.array([s.size[0] for s in shapes])


def pair_lines(statistics: PairStatistics, chain: Chain) -> list[str]:
    """The statistics of pairs of links in words."""
    names = [link.name for link in chain.links]
    kept = {tuple(pair) for pair in statistics.worth_checking().tolist()}
    return [
        f"{names[i]} - {names[j]}: spheres {s:.4f}, meshes {m:.4f}, false alarms {f:.4f}, "
        f"least gap {g:.3f} m{', checked' if (i, j) in kept else ''}"
        for (i, j), s, m, f, g in zip(
            statistics.pairs.tolist(),
            statistics.spheres_touch,
            statistics.meshes_touch,
            statistics.false_alarm,
            statistics.least_gap,
        )
    ]
