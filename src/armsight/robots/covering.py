"""Covering points with few balls or capsules that stay close to a body.

A capsule whose axis lies in a body at depth ``d`` (the least distance of the axis to the outside)
and whose radius is ``d + excess`` overshoots the body by at most ``excess``. Candidates are many
axes times a few excesses. The cover sought makes

    price * number of capsules + integral of (distance to the body) over the overshoot's volume

small: a greedy choice first, then neighbourhoods of the cover are taken out and covered anew, and
what is better is kept (large neighbourhood search). At the end the axes move freely, and capsules
whose neighbours can take over for less than the price are left out. A ball is a capsule of no
length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, Ints, Points
from armsight.robots.covering_kernels import axis_distances, refine_cover, search_cover


@dataclass(frozen=True)
class Axes:
    """Candidate axes in a body.

    Attributes:
        start, end: (k, 3) [m]; equal for balls.
        depth: (k,) least distance of the axis to the outside [m].
    """

    start: Points
    end: Points
    depth: Floats

    def take(self, index: Ints) -> Axes:
        """Some of the axes, in the order given."""
        return Axes(self.start[index], self.end[index], self.depth[index])


@dataclass(frozen=True)
class Surroundings:
    """Points outside the body that overshoot should spare.

    Attributes:
        points: (m, 3) [m].
        weight: (m,) volume of the cell times the squared distance to the body [m^5].
    """

    points: Points
    weight: Floats


def cover(
    points: Points,
    around: Surroundings,
    axes: Axes,
    excesses: Floats,
    price: float,
    rounds: int,
    rng: np.random.Generator,
) -> tuple[Axes, Floats, float]:
    """A good cover of (n, 3) points: axes, radii [m] and what it costs [m^5].

    Args:
        points: to be covered [m].
        around: what overshoot should spare.
        axes: the candidates.
        excesses: (e,) overshoots to choose from [m].
        price: of one capsule [m^5].
        rounds: of taking out and covering anew.
        rng: chooses what is taken out.
    """
    near = axis_distances(points, axes.start, axes.end)
    far = axis_distances(around.points, axes.start, axes.end)
    reach = (axes.depth[:, None] + excesses[None, :]).ravel()
    which = np.repeat(np.arange(len(axes.depth)), len(excesses))
    covers = (near[which] <= reach[:, None]).astype(np.uint8)
    spills = (far[which] <= reach[:, None]).astype(np.uint8)
    reachable = np.asarray(covers.any(axis=0), np.bool_)
    middle = 0.5 * (axes.start + axes.end)[which]
    chosen = search_cover(
        covers,
        np.ascontiguousarray(covers.T),
        spills,
        around.weight,
        reachable,
        middle,
        price,
        rng.random((rounds, 2)),
    )
    return refine(points, around, axes.take(which[chosen]), reach[chosen], price)


def refine(
    points: Points, around: Surroundings, axes: Axes, radius: Floats, price: float, sweeps: int = 20
) -> tuple[Axes, Floats, float]:
    """Improve a cover by moving its axes freely, and leave out what is not worth its price.

    Each capsule in turn tries small moves of its ends; its radius is what the points that no other
    capsule covers ask for. Then capsules are left out, as long as their neighbours can take over
    for less overshoot than the price; at price 0 none is.

    Returns:
        Axes (their depth is not kept up), radii [m], which together cover all points, and what
        they cost.
    """
    start, end, radius, overshoot = refine_cover(
        points, around.points, around.weight, axes.start, axes.end, radius, price, sweeps
    )
    cost = float(overshoot) + price * len(radius)
    return Axes(start, end, np.zeros(len(radius))), radius, cost
