"""The way out of a contact: what it may slide along, and when it is over."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.geometry.pose import make_pose
from armsight.geometry.shapes import Solid
from armsight.mapping.snapshot import OCCUPIED
from armsight.motion.collision import CollisionModel
from armsight.motion.depth_kernels import sink
from armsight.motion.escape import leaves
from armsight.motion.evasion import RUBS
from armsight.motion.executed import Executed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_office import PermitOffice
from armsight.motion.permitted import Grant
from armsight.motion.regions import Region
from armsight.motion.retreat import (
    ARRIVED,
    CARRIED,
    CLEAR,
    FOLLOWED,
    LOST_CLEAR,
    PACE,
    UNSEEN,
    YIELDS,
    YIELDS_MOST,
    Retreat,
    behind,
    gap,
    gap_to_seen,
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


@pytest.mark.parametrize(("deeper", "leaving"), [(-0.004, True), (0.004, False)])
def test_a_way_out_does_not_lead_deeper_where_a_centre_is_inside_already(deeper, leaving):
    """Small parts of a tool were as deep as they are thick, and went on through to the far side."""
    R = tcp_pose(ROBOT, ROBOT.home)[:3, :3]
    assert R[2, 2] < -0.999, "the tool looks down, and so is the grid aligned with it"
    slab = Solid("slab", "box", (0.2, 0.2, 0.14), make_pose(None, TIP - [0.0, 0.0, 0.05]))
    seen, model = make_snapshot([slab], counts_unknown=False), CollisionModel(ROBOT)
    grid = seen.grid
    column = seen.state[tuple(grid.index(TIP[None])[0][:2])]
    top = grid.origin[2] + grid.voxel * (np.flatnonzero(column == OCCUPIED).max() + 1)
    q = ROBOT.home
    for _ in range(3):  # the foremost sphere's middle is 4 mm inside, the next is 8 mm outside
        q = moved(q, [0.0, 0.0, top - 0.0177 - tcp_pose(ROBOT, q)[2, 3]])[1]
    clear = model.clearances(q, seen)
    assert (clear < 0.0).sum() == 1
    assert leaves(model, moved(q, [0.0, 0.0, -deeper]), seen, q) == leaving


@pytest.mark.parametrize("permitted", [False, True])
def test_how_deep_a_centre_is_in_what_is_solid(permitted):
    """Against a search over all cubes."""
    rng = np.random.default_rng(4)
    solids = [Solid("a", "box", (0.2, 0.3, 0.16), make_pose(None, (0.5, 0.0, 0.4)))]
    solids.append(Solid("b", "sphere", (0.1, 0.0, 0.0), make_pose(None, (0.1, 0.4, 0.5))))
    model = CollisionModel(ROBOT)
    ob = model.obstacles(make_snapshot(solids, counts_unknown=False), ROBOT.home)
    if permitted:
        state = np.where(ob.state == 2, np.uint8(4), ob.state)
        ob = ob._replace(state=state, touching=np.arange(300) % 2 == 0)
    near = np.argwhere(ob.state >= 2)
    centers = ob.origin + ob.voxel * (
        near[rng.integers(len(near), size=300)] + rng.random((300, 3))
    )
    out = np.zeros(300)
    sink(ob, centers, 0.06, out)
    low, high = np.maximum(near.min(axis=0) - 4, 0), near.max(axis=0) + 5
    around = ob.state[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    corner = ob.origin + ob.voxel * (np.argwhere(around < 2) + low)
    for k, center in enumerate(centers):
        gap = np.maximum(np.maximum(corner - center, center - corner - ob.voxel), 0.0)
        deep = min(float(np.linalg.norm(gap, axis=1).min()), 0.06)
        assert -out[k] == pytest.approx(0.0 if permitted and k % 2 == 0 else deep, abs=1e-9)
    assert (-out).max() > 0.05


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
    anew, _ = leaving(velocity=(0.0, 0.1, 0.0))
    anew.follow(anew.grant.region, 3.0)
    anew.grow_old(3.0 + 0.9 * FOLLOWED)
    assert anew.grant.region.speed == pytest.approx(0.1)
    anew.grow_old(3.0 + 1.1 * FOLLOWED)
    assert anew.grant.region.speed == 0.0


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


def tip_and_way(body, ball):
    """The nearest to a ball of the parts that may touch, and which way (3,) it leaves straight."""
    center, _ = body.motion(ROBOT.home, np.zeros(ROBOT.n))
    parts = np.arange(len(center))[-3:]
    part = int(parts[np.argmin(np.linalg.norm(center[parts] - ball, axis=1))])
    return part, center[part], unit(center[part] - ball)


def straight(body, part, way):
    """(n,) direction in the joints: damped least squares, by numpy's."""
    J = body.jacobian(ROBOT.home, part)[:3]
    rows = np.vstack([J, 0.1 * np.eye(ROBOT.n)])
    return unit(np.linalg.lstsq(rows, np.concatenate([way, np.zeros(ROBOT.n)]), rcond=None)[0])


@pytest.mark.parametrize(("person", "out"), [(True, None), (False, None), (False, np.ones(3))])
def test_at_once_only_a_thing_that_holds_nothing_is_left(person, out):
    assert leaving(person, out=out)[0].at_once == (not person and out is None)


@pytest.mark.parametrize("person", [False, True])
def test_a_thing_is_left_the_faster_the_harder_it_presses_and_somebody_is_not(person):
    retreat, body = leaving(person, force=20.0)
    _, _, out = tip_and_way(body, retreat.grant.region.center(1.0))

    def fastest(push):
        motion = retreat.motion(body, ROBOT.home, 1.0, 0.045, push)
        return body.fastest(ROBOT.home, motion, body.motion(ROBOT.home, motion)[1])

    calm = fastest(None)
    most = retreat.grant.force
    for share in (0.25, 0.5):  # something is in the way: an item on a bench was pressed with 400 N
        assert fastest(-share * most * out) == pytest.approx((1.0 - share) * calm)
    for share in (1.0, 3.0):
        still = retreat.motion(body, ROBOT.home, 1.0, 0.045, -share * most * out)
        assert np.abs(still).max() < 1e-12
    for force in (1.0, 5.0, 50.0):
        more = 0.0 if person else min(YIELDS * force, YIELDS_MOST)
        assert fastest(force * out) / calm == pytest.approx(1.0 + more / (PACE * 0.045))


def test_straight_out_is_where_it_is_pushed_as_well_if_the_two_agree():
    retreat, body = leaving(True)
    part, _, out = tip_and_way(body, retreat.grant.region.center(1.0))
    side = unit(np.cross(out, [1.0, 0.2, 0.1]))
    aside, against = unit(0.3 * out + side), unit(side - 0.3 * out)
    for push, way in (
        (None, out),
        (3.0 * aside, unit(out + aside)),
        (1.0 * aside, out),  # too little to say where from
        (3.0 * against, out),  # a sensor may lie
    ):
        motion = retreat.motion(body, ROBOT.home, 1.0, 0.045, push)
        assert unit(motion) == pytest.approx(straight(body, part, way), abs=1e-9)


@pytest.mark.parametrize(("aside", "turns"), [(0.3, 0.0), (0.0, 0.3)])
def test_it_does_not_go_the_way_it_came_where_that_leads_along_or_hardly_moves_the_part(
    aside, turns
):
    """A way that is 17 deg off the surface; one on which the wrist turns, more than it leaves."""
    still, body = leaving()
    part, _, out = tip_and_way(body, still.grant.region.center(1.0))
    J = tcp_jacobian(ROBOT, ROBOT.home)
    back = 0.03 * out + aside * unit(np.cross(out, [1.0, 0.2, 0.1])) * 0.3
    turn = J[3:].T @ np.array([1.0, 0.5, 0.2])
    turn = unit(turn - np.linalg.lstsq(J[:3], J[:3] @ turn, rcond=None)[0])
    came = np.linalg.lstsq(J, np.array([*back, 0, 0, 0]), rcond=None)[0] + turns * turn
    driven = Executed()
    driven.add(ROBOT.home + came)
    driven.add(ROBOT.home)
    retreat = Retreat("why", still.grant, driven, ROBOT.home, 1.0)
    motion = retreat.motion(body, ROBOT.home, 1.0, 0.045)
    assert unit(motion) == pytest.approx(straight(body, part, out), abs=1e-9)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_what_pushes_is_put_against_the_part_that_it_pushes(shape):
    """It is at rest there, and holds nothing, whatever it did where it was seen last."""
    retreat, body = leaving(velocity=(0.0, 0.1, 0.0), out=np.array([0.0, 0.0, 1.0]))
    seen = retreat.grant.region
    part, at, _ = tip_and_way(body, seen.center(1.0))
    thing = replace(seen, shape=shape, size=(0.05, 0.08, 0.06), drift=0.1)
    inside = 0.05 if shape == "sphere" else 0.025
    push = np.array([1.0, -2.0, 2.0])
    found = behind(replace(retreat.grant, region=thing), body, ROBOT.home, push, 1.0)
    there = at - (inside + body.radius[part]) * push / 3.0
    for when in (1.0, 4.0):
        assert found.region.center(when) == pytest.approx(there)
        assert found.region.deviation(when) == thing.deviation(1.0)
    assert found.out is None
    assert (found.touching == retreat.grant.touching).all()


def test_the_gap_to_what_is_seen_of_somebody_is_from_surface_to_surface():
    body = MovingBody(ROBOT, ROBOT.limits.acceleration)
    center, _ = body.motion(ROBOT.home, np.zeros(ROBOT.n))
    rng = np.random.default_rng(2)
    points = (TIP + rng.uniform(-0.4, 0.5, (90, 3))).astype(np.float32)
    off = np.abs(points - TIP - 0.15).max(axis=1)
    points, off = points[abs(off - 0.2) > 0.05], off[abs(off - 0.2) > 0.05]  # in it, or far from it
    empty = make_snapshot([], stamp=1.0)
    seen = replace(empty, hazards=points, hazard_unknown=np.zeros(len(points), bool))
    touching = np.zeros(len(ROBOT.spheres.radius), bool)
    touching[-3:] = True
    region = Region("box", (0.3, 0.3, 0.3), make_pose(None, TIP + 0.15), 1.0)
    away = np.linalg.norm(points[off < 0.2][:, None] - center[-3:], axis=2) - body.radius[-3:]
    grant = Grant(region, touching, True)
    expected = away.min() - seen.hazard_radius
    assert gap_to_seen(body, grant, ROBOT.home, seen) == pytest.approx(expected, abs=1e-6)
    assert gap_to_seen(body, grant, ROBOT.home, empty) == np.inf
    nobody = replace(grant, touching=0 * touching)
    assert gap_to_seen(body, nobody, ROBOT.home, seen) == np.inf


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
