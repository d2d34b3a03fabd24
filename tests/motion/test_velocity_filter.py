"""What limits a motion, in words, and what a twist becomes near a singularity."""

import re
from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.experiments.quick_cell import QuickCell
from armsight.geometry.pose import make_pose
from armsight.motion.arm_model import ArmState
from armsight.motion.collision import CollisionModel
from armsight.motion.contact_speed import ContactSpeed
from armsight.motion.faults import FaultWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.looking import look
from armsight.motion.nearest import MovingBody
from armsight.motion.regions import Region
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
    filter_.measure(NOW, verdict.age, well=True)
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


def test_in_contact_no_ramp_makes_the_tool_faster_than_what_was_and_what_is_wanted():
    """Each joint as far as it can: a tip met a ball with 0.5 m/s on its way from 0.15 to 0.08."""
    filter_ = VelocityFilter(ROBOT, [QuickCell([]).info], CONFIG, CollisionModel(ROBOT))
    filter_.see(EMPTY)
    filter_.measure(NOW, 0.03, well=True)
    body, q = filter_.monitor.body, ROBOT.home.copy()
    part = int(np.flatnonzero(body.link == ROBOT.n)[-1])
    center = body.motion(q, np.zeros(6))[0][part]
    J, change = body.jacobian(q, part), filter_.arm.acceleration * CONFIG.period
    own = np.arange(len(body.radius)) == part
    rng = np.random.default_rng(5)
    unlike = 0
    for _ in range(60):
        moves = rng.normal(size=3) * 0.1
        region = Region("sphere", (0.05, 0.0, 0.0), make_pose(None, center), NOW, moves)

        def relative(motion, moves=moves):
            return float(np.linalg.norm(J[:3] @ motion - moves))

        def near(speed, moves=moves):
            """Joints that move the tip with it, turned anyhow."""
            way = rng.normal(size=3)
            v = moves + speed * way / np.linalg.norm(way)
            return np.linalg.solve(J, np.concatenate([v, rng.normal(size=3)]))

        before, wanted = near(0.1), near(0.04)
        joints = JointState(NOW, q, before)
        verdict = FaultWatch(ROBOT, [QuickCell([]).info], CONFIG).check(NOW, joints, EMPTY)
        tick = look(filter_, NOW, CONFIG.period, verdict, joints, EMPTY)
        tick.ahead = ArmState(NOW, q, before)
        tick.command = wanted
        filter_.monitor.contact = ContactSpeed("ball", own, region, NOW, 0.05, 0.004)
        got = filter_.followed(tick)
        assert (np.abs(got - before) <= change + 1e-12).all()
        assert relative(got) <= max(relative(before), relative(wanted)) + 1e-9
        each = before + np.clip(wanted - before, -change, change)
        unlike += relative(each) > max(relative(before), relative(wanted)) + 0.002
        filter_.monitor.contact = None
        np.testing.assert_array_equal(filter_.followed(tick), each)
    assert unlike > 5
