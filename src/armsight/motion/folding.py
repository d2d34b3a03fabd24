"""A motion that would fold the arm onto itself, led beside that.

A stop that ends in the arm's own body is not free, so that an arm that is folded and follows a
velocity onto itself stands: in its own way. Where parts of it are near each other they come nearer
only so fast that it can always stop, and what is wanted is changed by as little as that takes:
first by how the tool turns, then by where its tip goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armsight.arrays import Floats, JointVector, Points
from armsight.motion.collision import CollisionModel
from armsight.motion.kernels import body_centers
from armsight.motion.slide_kernels import own_rows, project
from armsight.robots.kernels import chain_poses
from armsight.robots.kinematics import tcp_jacobian

NEAR = 0.06
"""Links that are farther apart than this do not count [m]."""
ROOM = 0.002
"""They keep this far apart, besides what every proof keeps [m]: so a stop beside it is free."""
SETTLES = 0.25
"""What is left of their distance may be closed in this time [s]: a command acts after 0.1 s, and
the arm stands 0.05 s later."""
PARTS = 0.5
"""Links that are nearer than they should be part at no more than this share of how fast they were
to close."""
LEVER = 0.03
"""A tip that turns by a radian counts as one that is moved by this [m]."""
IDLE = 0.01
"""And a joint that turns by one, besides what it does to the tip, as this [m]."""
SWEEPS = 50


@dataclass(frozen=True)
class Unfolded:
    """What is left of a motion.

    Attributes:
        motion: (n,) [rad/s].
        links: the two nearest links in whose way it is, by name; None where it is free.
    """

    motion: JointVector
    links: tuple[str, str] | None = None


def unfolded(
    model: CollisionModel, q: JointVector, stops: JointVector, wanted: JointVector
) -> Unfolded:
    """The motion nearest to a wanted one (n,) [rad/s] at (n,) [rad] that the arm leaves itself.

    Args:
        model: whose spheres and whose floor count.
        q: where the arm will be when it acts.
        stops: (n,) where it would stand if it braked there [rad]: braking, every joint stands when
            it can, and the arm leaves its way by centimetres.
        wanted: joint velocities.
    """
    if not wanted.any():
        return Unfolded(wanted)
    robot, body, floor = model.robot, model.body, model.config.floor
    q = np.ascontiguousarray(q, float)
    centers, later = (_centers(model, at) for at in (q, stops))
    poses = chain_poses(q, robot.T_link_joint, robot.axis)
    rows, gaps, links = own_rows(body, poses, robot.axis, centers, later, floor + NEAR)
    closing = rows @ wanted
    most = (gaps - floor - ROOM) / SETTLES
    tight = closing > np.maximum(most, 0.0)
    if not tight.any():
        return Unfolded(wanted)
    bounds = np.maximum(most, -PARTS * np.maximum(closing, 0.0))
    L = _metric(tcp_jacobian(robot, q))
    metric_rows = np.ascontiguousarray(np.linalg.solve(L, rows.T).T)
    motion = np.asarray(np.linalg.solve(L.T, project(L.T @ wanted, metric_rows, bounds, SWEEPS)))
    pair = links[int(np.argmin(np.where(tight, gaps, np.inf)))]
    return Unfolded(motion, (robot.link_names[pair[0]], robot.link_names[pair[1]]))


def _centers(model: CollisionModel, q: JointVector) -> Points:
    """(m + f, 3) of the model's spheres at (n,) [rad]."""
    scratch = model.scratch()
    body_centers(model.body, np.ascontiguousarray(q, float), scratch.centers)
    return np.array(scratch.centers)


def _metric(J: Floats) -> Floats:
    """(n, n) lower L with ``|L.T @ motion|`` how much a motion does, for a (6, n) Jacobian."""
    scale = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])[:, None]
    scaled = scale * J
    return np.asarray(np.linalg.cholesky(scaled.T @ scaled + IDLE**2 * np.eye(J.shape[1])))
