"""The way out of a contact: what it may slide along, and when it is over."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.motion.collision import CollisionModel
from armsight.motion.escape import leaves
from armsight.motion.evasion import RUBS
from armsight.motion.executed import Executed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_office import PermitOffice
from armsight.motion.permitted import Grant
from armsight.motion.retreat import (
    ARRIVED,
    CARRIED,
    CLEAR,
    FOLLOWED,
    LOST_CLEAR,
    PACE,
    UNSEEN,
    Retreat,
    gap,
)
from armsight.robots.kinematics import tcp_jacobian, tcp_pose

from .scenes import make_snapshot
from .test_contact import ROBOT, TIP, Sprung
from .test_permits import request, sphere


def moved(q, shift):
    """(2, n) a path on which the tip goes (3,) that way [m]."""
    J = tcp_jacobian(ROBOT, q)
    return np.array([q, q + np.linalg.lstsq(J, np.array([*shift, 0, 0, 0]), rcond=None)[0]])


@pytest.mark.parametrize(
    ("deeper", "anywhere", "leaving"),
    [(-0.003, True, True), (0.003, False, True), (0.02, False, False)],
)
def test_what_is_left_may_be_slid_along(deeper, anywhere, leaving):
    """A map is two centimetres coarse: an arm that stood for half a millimetre was pressed on."""
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    thing = Solid("thing", "sphere", (0.05, 0.0, 0.0), make_pose(None, TIP + 0.06 * out))
    seen, model = make_snapshot([thing], counts_unknown=False), CollisionModel(ROBOT)
    q = moved(ROBOT.home, 0.0025 * out)[1]
    assert -0.002 < model.clearance(q, seen) < 0.0, "it touches"
    path = moved(q, deeper * out)
    assert leaves(model, path, seen, q) == anywhere
    assert leaves(model, path, seen, q, RUBS) == leaving


def test_who_presses_on_unseen_is_left_by_what_is_felt():
    """The task has lost the face, and the arm hides it: it comes on, and then it stays there.

    Until November 2026 the arm stopped where the face had been, pressed with 13 N.
    """

    def coming(t):
        way = np.interp(t, [1.0, 1.6, 2.2], [0.0, 0.03, 0.18])
        return TIP + np.array([0.0, 0.0, way - 0.18])

    cell = Sprung(coming, "face", False, stiffness=150.0, radius=0.17, soft=150.0)
    cell.touch(6.0, lost=1.6)
    assert any("backs out" in s.reason for s in cell.log)
    assert max(force for _, force in cell.pushed) > 2.5
    assert cell.pushed[-1][1] < 2.5


def test_the_gap_of_what_may_touch_is_its_surface_s():
    """Other parts are nearer; sphere by sphere, and inside it is negative."""
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    center, _ = body.motion(ROBOT.home, np.zeros(ROBOT.n))
    touching = np.zeros(len(ROBOT.spheres.radius), bool)
    touching[-3:] = True
    for at, radius in ((TIP + np.array([0.0, 0.3, 0.1]), 0.05), (center[0], 0.1), (TIP, 0.04)):
        away = np.linalg.norm(center - at, axis=1) - body.radius - radius
        found = gap(body, Grant(sphere(at, 1.0, radius=radius), touching), ROBOT.home, 1.0)
        assert found == pytest.approx(away[-3:].min(), abs=1e-9)
    nothing = Grant(sphere(TIP, 1.0), 0 * touching)
    assert gap(body, nothing, ROBOT.home, 1.0) == np.inf


def leaving(kind_of_person=False, velocity=(0.0, 0.0, 0.0), **grant):
    """A retreat of the tip from a ball before it that moves; and the moving body."""
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    touching = np.zeros(len(ROBOT.spheres.radius), bool)
    touching[-3:] = True
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    region = replace(sphere(TIP + 0.05 * out, 1.0), velocity=np.asarray(velocity, float))
    given = Grant(region, touching, kind_of_person, **grant)
    return Retreat("why", given, Executed(), ROBOT.home, 1.0), body


@pytest.mark.parametrize("person", [False, True])
def test_what_nobody_sees_any_more_is_left_farther_unless_it_is_somebody(person):
    retreat, _ = leaving(person)
    assert retreat.clearance(1.0 + 0.9 * UNSEEN) == CLEAR
    assert retreat.clearance(1.0 + 1.1 * UNSEEN) == (CLEAR if person else LOST_CLEAR)
    retreat.follow(retreat.grant.region, 3.0)
    assert retreat.clearance(3.0 + 0.9 * UNSEEN) == CLEAR
    assert retreat.clearance(3.0 + 1.1 * UNSEEN) == (CLEAR if person else LOST_CLEAR)


def test_what_nobody_sees_goes_on_for_a_while_and_then_stays_where_that_led():
    retreat, _ = leaving(velocity=(0.0, 0.1, 0.0))
    begins = retreat.grant.region.center(1.0)
    retreat.grow_old(1.0 + 0.9 * FOLLOWED)
    assert retreat.grant.region.speed == pytest.approx(0.1)
    retreat.grow_old(1.0 + 1.1 * FOLLOWED)
    assert retreat.grant.region.speed == 0.0
    ended = begins + np.array([0.0, 0.1 * 1.1 * FOLLOWED, 0.0])
    assert retreat.grant.region.center(9.0) == pytest.approx(ended)
    still, _ = leaving()
    before = still.grant
    still.grow_old(1.0 + 2.0 * FOLLOWED)
    assert still.grant is before


@pytest.mark.parametrize("speed", [0.1, 0.2, 0.5])
def test_an_arm_goes_along_with_what_comes_no_faster_than_it_may(speed):
    retreat, _ = leaving(velocity=(0.0, 0.0, -speed))
    assert retreat.carried == pytest.approx([0.0, 0.0, -min(speed, CARRIED)])


def test_the_way_straight_out_of_a_ball_is_away_from_its_middle_and_slow():
    retreat, body = leaving()
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    motion = retreat.motion(body, ROBOT.home, 1.0, 0.045)
    tip = tcp_jacobian(ROBOT, ROBOT.home)[:3] @ motion
    assert tip @ -out > 0.9 * np.linalg.norm(tip)
    velocity = body.motion(ROBOT.home, motion)[1]
    fastest = body.fastest(ROBOT.home, motion, velocity)
    assert fastest <= 0.045 * PACE + 1e-9
    assert fastest > 0.1 * 0.045


def test_where_something_holds_the_part_it_is_pulled_out_one_way_and_by_no_more_than_that_stands():
    """The harder it holds the slower; nothing without a sensor, or where no force is granted."""
    out = -tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    retreat, body = leaving(out=out, force=20.0)

    def speed(push, retreat=retreat):
        motion = retreat.motion(body, ROBOT.home, 1.0, 0.045, push)
        tip = tcp_jacobian(ROBOT, ROBOT.home)[:3] @ motion
        if not motion.any():
            return 0.0
        assert tip @ out > 0.95 * np.linalg.norm(tip)
        return body.fastest(ROBOT.home, motion, body.motion(ROBOT.home, motion)[1])

    free = speed(np.zeros(3))
    assert 0.1 * 0.045 < free <= PACE * 0.045 + 1e-9
    assert speed(5.0 * out) == pytest.approx(free), "pushed out"
    assert speed(-10.0 * out) == pytest.approx(0.5 * free, rel=1e-3)
    assert speed(-30.0 * out) == 0.0
    assert speed(None) == 0.0
    assert speed(np.zeros(3), leaving(out=out, force=0.0)[0]) == 0.0


def unit(way):
    return way / np.linalg.norm(way)


@pytest.mark.parametrize("seed", range(4))
def test_out_of_a_ball_it_goes_the_way_it_came_where_that_leaves_as_well(seed):
    """Back to the place it came from, in the joints, and not by the nearest joint motion."""
    _, body = leaving()
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    rng = np.random.default_rng(seed)
    J = tcp_jacobian(ROBOT, ROBOT.home)
    turn = J[3:].T @ rng.normal(0.0, 0.1, 3)  # of the wrist, besides
    came = ROBOT.home + np.linalg.lstsq(J, np.array([*(-0.1 * out), 0, 0, 0]), rcond=None)[0]
    came += turn - np.linalg.lstsq(J[:3], J[:3] @ turn, rcond=None)[0]
    driven = Executed()
    driven.add(came)
    driven.add(ROBOT.home)
    touching = np.zeros(len(ROBOT.spheres.radius), bool)
    touching[-3:] = True
    ball = Grant(sphere(TIP + 0.05 * out, 1.0), touching)
    retreat = Retreat("why", ball, driven, ROBOT.home, 1.0)
    motion = retreat.motion(body, ROBOT.home, 1.0, 0.045)
    assert motion == pytest.approx(np.linalg.norm(motion) * unit(came - ROBOT.home), abs=1e-9)
    assert np.linalg.norm(motion) > 0.0
    driven.clear()
    between = 0.7 * ROBOT.home + 0.3 * came + 0.03 * unit(turn)  # a bend in the way
    for place in (came, between, ROBOT.home):
        driven.add(place)
    retreat = Retreat("why", ball, driven, ROBOT.home, 1.0)
    there = between + 0.5 * ARRIVED * rng.uniform(-1.0, 1.0, ROBOT.n)
    motion = retreat.motion(body, there, 1.0, 0.045)
    assert motion == pytest.approx(np.linalg.norm(motion) * unit(came - there), abs=1e-9)


@pytest.mark.parametrize(("speed", "stays"), [(0.06, True), (-0.06, False), (0.0, False)])
def test_an_arm_has_not_left_what_comes_after_it(speed, stays):
    """25 mm off a ball: it goes on leaving one that is there within a second."""
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    retreat, body = leaving(velocity=-speed * out)
    away = CLEAR + 0.005 - gap(body, retreat.grant, ROBOT.home, 1.0)
    region = retreat.grant.region
    farther = replace(region, T_base_region=make_pose(None, region.center(1.0) + away * out))
    retreat.grant = replace(retreat.grant, region=farther)
    assert gap(body, retreat.grant, ROBOT.home, 1.0) > CLEAR
    office = PermitOffice(ROBOT, body, GuardConfig(), Executed())
    office.retreat, office.grant = retreat, retreat.grant
    still = JointState(1.0, ROBOT.home.copy(), np.zeros(ROBOT.n))
    office.consider(1.0, None, None, still)
    assert (office.retreat is not None) == stays


def test_a_permit_follows_its_region_where_there_is_no_map_for_a_moment():
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    out = tcp_pose(ROBOT, ROBOT.home)[:3, 2]
    office = PermitOffice(ROBOT, body, GuardConfig(), Executed())
    still = JointState(1.0, ROBOT.home.copy(), np.zeros(ROBOT.n))
    ball = sphere(TIP - 0.2 * out, 1.0)
    asked = request(ball)
    empty = make_snapshot([], counts_unknown=False, stamp=1.0)
    office.consider(1.0, asked, empty, still)
    assert office.permit.holds, office.permit.reason
    on = sphere(ball.center(1.0) + 0.01 * out, 1.1)
    office.consider(1.1, replace(asked, region=on), None, still)
    assert office.permit.holds
    assert office.permit.region is on
