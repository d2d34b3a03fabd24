"""What limits a motion, in words, and what a twist becomes near a singularity."""

import re
from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.experiments.quick_cell import QuickCell
from armsight.motion.collision import CollisionModel
from armsight.motion.faults import FaultWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.looking import look
from armsight.motion.nearest import MovingBody
from armsight.motion.steering import SINGULAR, joints_of_twist
from armsight.motion.velocity_filter import VelocityFilter
from armsight.robots import load_robot
from armsight.robots.kinematics import link_poses, tcp_jacobian

from .scenes import make_snapshot

ROBOT = load_robot("ur5")
CONFIG = GuardConfig()
NOW = 10.0
EMPTY = make_snapshot([], stamp=NOW - 0.03)
TURN = np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0])


def words(points, motion, unseen=False, seen=True):
    """What is said of a motion from home, and the view that it is said of."""
    cameras = [QuickCell([]).info]
    filter_ = VelocityFilter(ROBOT, cameras, CONFIG, CollisionModel(ROBOT))
    points = np.asarray(points, np.float32).reshape(-1, 3)
    snapshot = replace(EMPTY, hazards=points, hazard_unknown=np.full(len(points), unseen))
    if seen:
        filter_.see(snapshot)
    joints = JointState(NOW, ROBOT.home.copy(), np.zeros(6))
    verdict = FaultWatch(ROBOT, cameras, CONFIG).check(NOW, joints, snapshot)
    filter_.measure(NOW, verdict.age)
    tick = look(filter_, NOW, CONFIG.period, verdict, joints, snapshot)
    view = filter_.judge(tick, motion)
    return filter_.who(view), view


def gap(link, point):
    """From the surface of a link's spheres to that of a hazard [m]."""
    poses, spheres = link_poses(ROBOT, ROBOT.home), ROBOT.spheres
    own = np.flatnonzero(spheres.link == ROBOT.link_names.index(link))
    centers = spheres.center[own] @ poses[spheres.link[own[0]], :3, :3].T
    centers = centers + poses[spheres.link[own[0]], :3, 3]
    away = np.linalg.norm(centers - point, axis=1) - spheres.radius[own]
    return float(away.min()) - EMPTY.hazard_radius


def tcp():
    center = link_poses(ROBOT, ROBOT.home)[-1, :3, 3]
    side = np.cross([0.0, 0.0, 1.0], center)
    return center, side / np.linalg.norm(side)


@pytest.mark.parametrize("unseen", [False, True])
def test_who_limits_a_motion(unseen):
    """One hazard right in the way, another on the other side, from which it moves away."""
    center, side = tcp()
    ahead, behind = center + 0.6 * side, center - 1.1 * side
    said, view = words([behind, ahead], TURN, unseen)
    assert view.allowed < 1.0
    kind, meters, link, x, y, z = re.fullmatch(
        r"(.*) (\S+) m from (\S+), at \((.*), (.*), (.*)\)", said
    ).groups()
    assert kind == ("unseen space" if unseen else "something")
    assert (float(x), float(y), float(z)) == pytest.approx(ahead, abs=0.006)
    assert float(meters) == pytest.approx(gap(link, ahead), abs=0.006)


def test_the_part_that_limits_most_is_named_not_the_nearest():
    """The tip is fast; a slower part of the arm is nearer to the same hazard."""
    center, side = tcp()
    said, view = words([[-0.8, 0.0, 0.3], center + 0.8 * side], TURN)
    links = MovingBody(ROBOT, ROBOT.limits.acceleration).link
    most, nearest = (ROBOT.link_names[links[k]] for k in (np.argmin(view.share), view.closest))
    assert most != nearest
    assert f" from {most}," in said


def test_who_is_near_an_arm_that_stands():
    center, side = tcp()
    said, view = words([center - 0.9 * side, center + 0.5 * side], 0.0 * TURN)
    assert view.allowed >= 1.0
    x, y, z = center + 0.5 * side
    assert said.endswith(f"at ({x:.2f}, {y:.2f}, {z:.2f})")


@pytest.mark.parametrize("points", [[], [[9.0, 0.0, 0.0]]])
def test_nobody_near(points):
    assert words(points, TURN)[0] == "nothing near"
    assert words(points, TURN, seen=False)[0] == "nothing near"


@pytest.mark.parametrize("elbow", [0.0, 0.01, 0.02, 1.0])
def test_a_twist_is_damped_as_the_paper_has_it(elbow):
    """Chiaverini's closed form, J^T (J J^T + mu^2)^-1 v, at a stretched arm and away from it."""
    q = np.array([0.3, -1.2, elbow, -0.7, 0.9, 0.2])
    J = tcp_jacobian(ROBOT, q)
    least = float(np.linalg.svd(J, compute_uv=False)[-1])
    assert (least < SINGULAR) == (elbow < 0.5)
    mu2 = SINGULAR**2 * (1 - (least / SINGULAR) ** 2) if least < SINGULAR else 0.0
    twist = np.array([0.1, -0.2, 0.1, 0.3, 0.1, -0.2])
    expected = J.T @ np.linalg.solve(J @ J.T + (mu2 + 1e-12) * np.eye(6), twist)
    assert joints_of_twist(J, twist) == pytest.approx(expected, abs=1e-8)
