"""A link made ready for fitting: sampled, voxelised, with candidate axes and surroundings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from armsight.arrays import Floats, JointPath, JointVector, Points, Pose, Poses
from armsight.geometry.pose import inverse, transform
from armsight.robots.chain import Chain, ChainLink
from armsight.robots.covering import Axes, Surroundings
from armsight.robots.meshes import Triangles, geometry_triangles, join_triangles
from armsight.robots.near_links import ROOM, LinkDistanceField, crowding, distance_field
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


def link_triangles(link: ChainLink) -> Triangles:
    """All triangles of a link: what is seen of it, or collision geometry where nothing is."""
    return join_triangles([geometry_triangles(shape) for shape in link.body])


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
    share = crowding(points, own, thin(body.check, 0.008), link, fields, path, *chain_arrays(chain))
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


def chain_arrays(chain: Chain) -> tuple[Poses, Points]:
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
