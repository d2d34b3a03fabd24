"""Fitting spheres and capsules to the links of an arm, and measuring how well they fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, JointPath, JointVector, Points, Pose, Poses
from armsight.errors import RobotError
from armsight.geometry.pose import inverse, transform
from armsight.robots.chain import Chain, ChainLink
from armsight.robots.covering import Axes, Surroundings, axis_distances, cover, refine
from armsight.robots.meshes import Triangles, geometry_triangles, join_triangles
from armsight.robots.near_links import ROOM, LinkDistanceField, crowding, distance_field
from armsight.robots.pairs import PairStatistics, pair_statistics
from armsight.robots.shapes import BodyShapes, FitReport, make_capsules, make_spheres
from armsight.robots.solids import VoxelSolid, outer_surface, sample_surface, thin, voxelise

GAP = 0.03
"""[m] around a link within which it is asked whether other links pass."""


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        sphere_price, capsule_price: what one shape costs against overshoot, as the integral of
            the squared distance to the body over the volume of overshoot [m^5]: higher means fewer.
        sphere_excess, capsule_excess: overshoots to choose from [m].
        restarts: of the whole fit of a link, the best counts; rounds: of the search in each.
        completions: times that checked points left outside join those to cover.
        voxel: of the body's inside [m].
        spacing: of the points that a fit must cover [m].
        check_spacing: of the points that the finished fit is checked and completed with [m].
        margin: added to every radius, for what lies between two checked points [m].
        crowd: how many times worse overshoot is where other links always pass, see
            :mod:`armsight.robots.near_links`; configurations: tried to see where that is.
        most_axes, most_points, most_around, most_crowded: candidates, points to cover, points to
            spare, and those of them where others pass, of a link.
        seed: of the search.
    """

    sphere_price: float = 2.5e-9
    capsule_price: float = 1e-8
    sphere_excess: tuple[float, ...] = (0.002, 0.004, 0.007, 0.011, 0.018, 0.026)
    capsule_excess: tuple[float, ...] = (0.006, 0.012, 0.02, 0.03, 0.04, 0.055)
    restarts: int = 1
    rounds: int = 12
    completions: int = 4
    voxel: float = 0.003
    spacing: float = 0.006
    check_spacing: float = 0.0015
    margin: float = 0.0003
    crowd: float = 100.0
    configurations: int = 100
    most_axes: int = 1200
    most_points: int = 4000
    most_around: int = 8000
    most_crowded: int = 4000
    seed: int = 7


@dataclass(frozen=True)
class NeighbourLink:
    """A neighbour in the chain, which turns about the joint between.

    Attributes:
        solid: its inside.
        T_joint_link: the joint's frame from the fitted link's; T_fellow_joint: the neighbour's
            from the joint's; axis: (3,) of the joint in the joint's frame.
    """

    solid: VoxelSolid
    T_joint_link: Pose
    T_fellow_joint: Pose
    axis: Floats


@dataclass(frozen=True)
class NeighbourLinks:
    """The neighbours of a link. What they fill at every joint angle is no overshoot."""

    members: tuple[NeighbourLink, ...] = ()

    def always(self, points: Points) -> NDArray[np.bool_]:
        """(n,) whether a neighbour covers the point whatever the joint's angle."""
        result = np.zeros(len(points), bool)
        for fellow in self.members:
            in_joint = transform(fellow.T_joint_link, points)
            always = np.ones(len(points), bool)
            for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
                turned = Rotation.from_rotvec(angle * fellow.axis).apply(in_joint[always])
                always[always] = fellow.solid.contains(transform(fellow.T_fellow_joint, turned))
            result |= always
        return result


@dataclass(frozen=True)
class LinkBody:
    """A link made ready for fitting.

    Attributes:
        points: what a fit must cover; check: denser, for completing and measuring it.
        solid: what is inside.
        fellows: its neighbours.
        around: what overshoot should spare.
        balls, segments: candidate axes.
        mount: z of the mounting face of a base [m]; overshoot below it lies in what the arm is
            bolted to.
    """

    points: Points
    check: Points
    solid: VoxelSolid
    fellows: NeighbourLinks
    around: Surroundings
    balls: Axes
    segments: Axes
    mount: float | None = None


def prepare(
    triangles: Triangles,
    options: FitOptions,
    fellows: NeighbourLinks,
    floor: float | None = None,
    base: bool = False,
) -> LinkBody:
    """Sample, voxelise, and list candidate axes of one link.

    Args:
        triangles: in the link's frame.
        options: how to fit.
        fellows: the neighbours.
        floor: z [m] in the link's frame of what the arm stands on, where it is near; below it
            overshoot is much worse for a link that turns, and matters little for the base, which
            stands on it.
        base: whether this is the base.
    """
    solid = voxelise(triangles, options.voxel)
    check = thin(sample_surface(triangles, options.check_spacing), options.check_spacing)
    inside = solid.centers(solid.inside)
    # The middle must be covered as well: a thing that is wholly inside the body must be found.
    points = _at_most(
        options.most_points,
        options.spacing,
        lambda h: np.concatenate([thin(check, h), thin(inside, 3 * h)]),
    )
    tree = cKDTree(thin(outer_surface(check, solid), options.voxel))
    centers = _at_most(options.most_axes, 2 * options.voxel, lambda h: thin(inside, h))
    balls = Axes(centers, centers, np.asarray(tree.query(centers)[0]))
    segments = _segments(balls, solid, tree, options.most_axes)
    around = _surroundings(check, solid, fellows, options.most_around)
    if floor is not None:
        below = around.points[:, 2] < floor
        worse = 0.02 if base else 30.0
        around = replace(around, weight=np.where(below, worse * around.weight, around.weight))
    mount = floor if base else None
    return LinkBody(points, check, solid, fellows, around, balls, segments, mount)


def _at_most(most: int, spacing: float, make: Callable[[float], Points]) -> Points:
    """What ``make`` gives at the finest spacing that keeps it to so many points."""
    while len(points := make(spacing)) > most:
        spacing *= 1.1
    return points


def _surroundings(
    surface: Points, solid: VoxelSolid, fellows: NeighbourLinks, most: int, far: float = 0.07
) -> Surroundings:
    """A lattice of points outside a body, up to ``far`` away, that no neighbour always fills."""
    tree = cKDTree(thin(surface, 0.004))
    low, high = surface.min(axis=0) - far, surface.max(axis=0) + far
    cell = 0.006
    while True:
        axes = [np.arange(a, b, cell) for a, b in zip(low, high)]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        lattice = lattice[~solid.contains(lattice)]
        distance = np.asarray(tree.query(lattice, distance_upper_bound=far)[0])
        near = np.flatnonzero(distance < far)
        near = near[~fellows.always(lattice[near])]
        if len(near) <= most:
            return Surroundings(lattice[near], distance[near] ** 2 * cell**3)
        cell *= 1.1


def _segments(balls: Axes, solid: VoxelSolid, tree: cKDTree, most: int) -> Axes:
    """Axes between pairs of spread centres that stay inside the body."""
    chosen = [int(np.argmax(balls.depth))]
    gap = np.linalg.norm(balls.start - balls.start[chosen[0]], axis=1)
    while len(chosen) < min(100, len(balls.depth)):
        # Far from those chosen, and deep.
        chosen.append(int(np.argmax(gap + 2.0 * balls.depth * (gap > 0.0))))
        gap = np.minimum(gap, np.linalg.norm(balls.start - balls.start[chosen[-1]], axis=1))
    ends = balls.start[chosen]
    a, b = np.triu_indices(len(ends))
    steps = np.linspace(0.0, 1.0, 17)[:, None, None]
    along = ends[a] + steps * (ends[b] - ends[a])
    inside = solid.contains(along.reshape(-1, 3)).reshape(len(steps), -1).all(axis=0)
    along, a, b = along[:, inside], a[inside], b[inside]
    gaps = np.asarray(tree.query(along.reshape(-1, 3))[0])
    depth = gaps.reshape(len(steps), -1).min(axis=0)
    # Long, deep axes are what capsules are for; the rest, thinned, reaches thin and odd parts.
    order = np.argsort(-depth * (0.03 + np.linalg.norm(ends[a] - ends[b], axis=1)))
    rest = order[most // 2 :]
    order = np.concatenate([order[: most // 2], rest[:: max(1, -(-len(rest) // (most // 2)))]])
    return Axes(ends[a][order], ends[b][order], depth[order])


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


def measure(
    body: LinkBody, axes: Axes, radius: Floats, spacing: float = 0.004
) -> tuple[Floats, Floats]:
    """How far surface points lie outside the shapes, and the shapes' surface outside the body.

    Returns:
        (n,) signed distance of each checked point to the union, positive outside [m];
        (k,) distance of points spread on the union's surface to the body [m]; 0 inside it or
        where a neighbour is at every joint angle. What lies in the mount of a base is left out.
    """
    miss = (axis_distances(body.check, axes.start, axes.end) - radius[:, None]).min(axis=0)
    shell = union_surface(axes, radius, spacing)
    if body.mount is not None:
        shell = shell[shell[:, 2] >= body.mount]
    over = np.asarray(cKDTree(body.check).query(shell)[0])
    over[body.solid.contains(shell)] = 0.0
    over[body.fellows.always(shell)] = 0.0
    return miss, over


def union_surface(axes: Axes, radius: Floats, spacing: float) -> Points:
    """Points spread evenly on the surface of the union of capsules [m]."""
    points = []
    for k, (a, b, r) in enumerate(zip(axes.start, axes.end, radius)):
        skin = _capsule_surface(a, b, float(r), spacing)
        buried = axis_distances(skin, axes.start, axes.end) < radius[:, None]
        buried[k] = False
        points.append(skin[~buried.any(axis=0)])
    return np.concatenate(points)


def _capsule_surface(a: Points, b: Points, radius: float, spacing: float) -> Points:
    count = max(12, int(4.0 * np.pi * radius**2 / spacing**2))
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + 5.0**0.5) * k
    ball = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)
    length = float(np.linalg.norm(b - a))
    if length < 1e-9:
        return np.asarray(a + radius * ball)
    u = (b - a) / length
    side = ball @ u
    caps = np.where((side > 0)[:, None], b, a) + radius * ball
    helper = np.eye(3)[int(np.argmin(np.abs(u)))]
    v = np.cross(u, helper)
    v /= np.linalg.norm(v)
    w = np.cross(u, v)
    rows, around = max(2, int(length / spacing)), max(12, int(2 * np.pi * radius / spacing))
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = radius * (np.cos(angle)[:, None] * v + np.sin(angle)[:, None] * w)
    at = a + ((np.arange(rows) + 0.5) / rows * length)[:, None] * u
    return np.concatenate([caps, (at[:, None] + ring[None]).reshape(-1, 3)])


def report(parts: list[tuple[Floats, Floats]]) -> FitReport:
    """One report of many links' :func:`measure`."""
    miss = np.concatenate([m for m, _ in parts])
    over = np.concatenate([o for _, o in parts])
    median, p95 = (float(v) for v in np.percentile(over, [50, 95]))
    return FitReport(
        samples=len(miss),
        coverage=float((miss <= 0.0).mean()),
        deepest_miss=max(0.0, float(miss.max())),
        overshoot_median=round(median, 5),
        overshoot_p95=round(p95, 5),
        overshoot_max=round(float(over.max()), 5),
    )


def link_triangles(link: ChainLink) -> Triangles:
    """All triangles of a link: its visuals, or its collision geometry where it has no visual."""
    return join_triangles([geometry_triangles(g) for g in link.visuals or link.collisions])


def prepare_chain(
    chain: Chain,
    triangles: list[Triangles],
    lower: JointVector,
    upper: JointVector,
    options: FitOptions,
) -> list[LinkBody | None]:
    """Every link of an arm made ready for fitting; None for links without triangles."""
    n = len(chain.links) - 1
    solids = [voxelise(t, options.voxel) if len(t[1]) else None for t in triangles]
    bodies: list[LinkBody | None] = []
    for i, own in enumerate(triangles):
        if not len(own[1]):
            bodies.append(None)
            continue
        members = []
        before = solids[i - 1] if i > 0 else None
        joint = chain.links[i].joint
        if before is not None and joint is not None:
            members.append(
                NeighbourLink(before, np.eye(4), chain.links[i].T_parent_joint, joint.axis)
            )
        after = solids[i + 1] if i + 1 < len(solids) else None
        if after is not None and (joint := chain.links[i + 1].joint) is not None:
            T = inverse(chain.links[i + 1].T_parent_joint)
            members.append(NeighbourLink(after, T, np.eye(4), joint.axis))
        floor = _floor(chain, i, own)
        bodies.append(prepare(own, options, NeighbourLinks(tuple(members)), floor, i == 0))
    path = np.random.default_rng(options.seed).uniform(lower, upper, (options.configurations, n))
    fields = [None if solid is None else distance_field(solid, GAP + ROOM) for solid in solids]
    return [
        None if body is None else _spare_others(body, i, fields, path, chain, options)
        for i, body in enumerate(bodies)
    ]


def _spare_others(
    body: LinkBody,
    link: int,
    fields: list[LinkDistanceField | None],
    path: JointPath,
    chain: Chain,
    options: FitOptions,
) -> LinkBody:
    """A link's body with the places where other links pass among those that overshoot spares."""
    cell = 0.004
    axes = [
        np.arange(a, b, cell)
        for a, b in zip(body.check.min(axis=0) - GAP, body.check.max(axis=0) + GAP)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[~body.solid.contains(points)]
    own = np.asarray(cKDTree(thin(body.check, cell)).query(points, distance_upper_bound=GAP)[0])
    near = own < GAP
    if body.mount is not None:
        near &= points[:, 2] >= body.mount
    points, own = points[near], own[near]
    share = crowding(
        points, own, thin(body.check, 0.008), link, fields, path, *_chain_arrays(chain)
    )
    # Inside a neighbour too: there the shapes of its two neighbours would meet unpunished.
    crowded = np.flatnonzero(share > 0.02)
    if not len(crowded):
        return body
    # Close to the body more are drawn than their weights say: there the shapes will end.
    likely = share[crowded] * own[crowded]
    likely /= likely.sum()
    rng = np.random.default_rng(options.seed)
    drawn, times = np.unique(
        rng.choice(len(crowded), options.most_crowded, p=likely), return_counts=True
    )
    weight = options.crowd * share[crowded] * own[crowded] ** 2 * cell**3
    weight = times * weight[drawn] / (options.most_crowded * likely[drawn])
    around = Surroundings(
        np.concatenate([body.around.points, points[crowded[drawn]]]),
        np.concatenate([body.around.weight, weight]),
    )
    return replace(body, around=around)


def _chain_arrays(chain: Chain) -> tuple[Poses, Points]:
    """(n, 4, 4) joint frames in the links before them and (n, 3) axes."""
    moving = chain.links[1:]
    return (
        np.stack([link.T_parent_joint for link in moving]),
        np.stack([link.joint.axis for link in moving if link.joint]),
    )


def _floor(chain: Chain, link: int, triangles: Triangles) -> float | None:
    """Height of the mounting face in the frame of the base or of the link that turns on it."""
    if link > 1 or len(chain.links) < 2 or (joint := chain.links[1].joint) is None:
        return None
    T = chain.links[1].T_parent_joint
    if not (np.allclose(T[:3, :3] @ joint.axis, [0, 0, 1]) and np.allclose(T[:3, 2], [0, 0, 1])):
        return None
    return float(triangles[0][:, 2].min()) if link == 0 else float(-T[2, 3])


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
        *_chain_arrays(chain),
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


def _all_spheres(chain: Chain) -> bool:
    """Whether the collision geometry is there and made of spheres alone."""
    shapes = [shape for link in chain.links for shape in link.collisions]
    return bool(shapes) and all(shape.kind == "sphere" for shape in shapes)


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
        *_chain_arrays(chain),
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
