"""The permit office alone, tick by tick, with a force sensor that says what it is told."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import JointState
from armsight.geometry.pose import make_pose
from armsight.mapping.tracked import SHELL, SURE
from armsight.motion.executed import Executed
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import MovingBody
from armsight.motion.permit_law import ARM_ERROR, gentle_speed, pressing_speed
from armsight.motion.permit_office import (
    AGAIN,
    FREE,
    LATTICE,
    PRESSED_ON,
    PUSHED,
    QUIET,
    PermitOffice,
)
from armsight.motion.permits import PermitState
from armsight.motion.permitted import grown_by, permitted
from armsight.motion.retreat import CLEAR, Retreat, gap
from armsight.robots.kinematics import flange_pose, tcp_pose

from .scenes import make_snapshot
from .test_contact import ROBOT, TIP, load
from .test_permits import RADIUS, request, sphere

BODY = MovingBody(ROBOT, ROBOT.limits.acceleration)
OUT = -tcp_pose(ROBOT, ROBOT.home)[:3, 2]
NOBODY = make_snapshot([], counts_unknown=False, stamp=0.0)
FORCE = 10.0
TICK = 0.008


class Office:
    """An office, 0.7 s old, of an arm that stands; nothing is pressed and nobody is about."""

    def __init__(self, config=None):
        self.office = PermitOffice(ROBOT, BODY, config or GuardConfig(), Executed())
        self.now, self.q, self.map = 0.0, ROBOT.home.copy(), NOBODY
        for _ in range(90):
            self.tick()

    def tick(self, ask=None, push=(0.0, 0.0, 0.0), feels=True):
        """One tick: what is asked, the force on the arm [N] in ``base``; the office's answer."""
        self.now += TICK
        self.map = replace(self.map, stamp=self.now)
        if feels:
            told = flange_pose(ROBOT, self.q)[:3, :3].T @ np.asarray(push, float)
            self.office.feel([load(self.q, told, stamp=self.now - 0.001)])
        if ask is not None:
            ask = replace(ask, region=replace(ask.region, exposure=self.now))
        still = JointState(self.now, self.q, np.zeros(ROBOT.n))
        return self.office.consider(self.now, ask, self.map, still)

    def ticks(self, seconds, *args, **more):
        for _ in range(round(seconds / TICK)):
            self.tick(*args, **more)
        return self.office

    def lean(self, force, ask=None):
        """It is pressed harder and harder, by 5 N/s, up to a force [N]."""
        for pressed in np.arange(0.0, force, 5.0 * TICK):
            self.tick(ask, pressed * OUT)
        return self.office

    def beside(self, there):
        """Somebody is close around what is asked for, or has gone."""
        around = TIP - RADIUS * OUT + (RADIUS + 0.055) * np.eye(3)
        points = np.asarray(around if there else np.empty((0, 3)), np.float32)
        self.map = replace(self.map, hazards=points, hazard_unknown=np.zeros(len(points), bool))


def asked(out=None, **more):
    """For a ball that the tip touches."""
    ball = sphere(TIP - RADIUS * OUT)
    return replace(request(ball, parts=("tool",), force=FORCE, out=out), **more)


def away(grant, distance):
    """The same somewhere else: so far from the parts that may touch."""
    region = grant.region
    T = np.array(region.T_base_region)
    T[:3, 3] -= (distance - gap(BODY, grant, ROBOT.home, region.exposure)) * OUT
    return replace(grant, region=replace(region, T_base_region=T))


@pytest.mark.parametrize("out", [OUT, None])
def test_only_beside_somebody_and_in_what_holds_it_the_arm_stands(out):
    made = Office()
    office = made.ticks(0.1, asked(out))
    before = office.permit
    assert before.holds
    made.beside(True)
    made.tick(asked(out))
    assert "beside it" in office.permit.reason
    assert office.retreat.stands == (None if out is None else before)
    pressed = Office()
    office = pressed.ticks(0.1, asked(out))
    pressed.tick(asked(out), push=30.0 * OUT)
    assert "pressed with" in office.permit.reason
    assert office.retreat.stands is None
    over = Office()
    office = over.ticks(0.3, asked(out, seconds=0.2))
    assert "time is over" in office.permit.reason
    assert office.retreat.stands is None
    office.withdraw("once more", over.now)
    assert "time is over" in office.permit.reason


@pytest.mark.parametrize("out", [OUT, None])
def test_what_stands_may_be_permitted_again_pressed_or_not_and_what_backs_out_may_not(out):
    made = Office()
    made.ticks(0.1, asked(out))
    made.beside(True)
    made.tick(asked(out))
    made.beside(False)
    office = made.lean(0.8 * FORCE)
    assert (office.retreat.stands is not None) == (out is not None)
    made.tick(asked(out), push=0.8 * FORCE * OUT)
    assert office.permit.holds == (out is not None)
    assert (office.retreat is None) == (out is not None)
    if out is None:
        assert "still backs out" in office.permit.reason


def test_what_stands_leaves_where_it_is_pressed_harder_than_it_was_permitted():
    made = Office()
    made.ticks(0.1, asked(OUT))
    made.beside(True)
    office = made.lean(0.8 * FORCE, asked(OUT))
    assert office.retreat.stands is not None
    made.tick(asked(OUT), push=1.5 * FORCE * OUT)
    assert office.retreat.stands is None
    assert "pressed with" in office.retreat.reason


@pytest.mark.parametrize(("share", "holds"), [(FREE - 0.05, True), (FREE + 0.05, False)])
def test_what_is_asked_for_must_not_be_felt_already(share, holds):
    made = Office()
    made.tick(asked(), push=share * FORCE * OUT)
    assert made.office.permit.holds == holds


def test_weight_is_no_push_however_the_arm_turns():
    made = Office()
    made.q = made.q + np.array([0.3, 0.2, -0.4, 1.3, 0.8, 0.5])
    made.tick(push=(0.0, 4.0, 0.0))
    assert made.office.push == pytest.approx([0.0, 4.0, 0.0], abs=0.1)


@pytest.mark.parametrize("out", [OUT, None])
def test_what_is_pulled_out_needs_a_force_that_is_said_now(out):
    made = Office()
    made.ticks(0.1, asked(out))
    office = made.office
    office.withdraw("a test", made.now)
    made.tick(push=3.0 * OUT)
    assert office.push == pytest.approx(3.0 * OUT, abs=0.1)
    made.ticks(0.05, feels=False)
    assert office.retreat is not None
    assert (office.push is None) == (out is not None)


def test_who_asks_is_told_when_what_may_be_touched_changes():
    made = Office()
    made.office.consider(made.now, None, None)  # nobody knows where the arm is
    assert not made.tick()
    assert made.office.apply(made.map) is made.map
    assert made.tick(asked())
    before = made.office.grant
    assert made.office.apply(made.map).grant is before
    assert made.tick(asked()), "its region is a newer one"
    assert made.office.grant is not before
    made.q = made.q - np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])  # what is touched is left first
    assert made.tick()
    assert made.office.grant is None
    assert not made.tick()


def test_what_is_in_contact_is_left_and_what_is_not_is_forgotten():
    for distance, touches in ((CLEAR - 0.005, True), (CLEAR + 0.005, False)):
        made = Office()
        office = made.ticks(0.1, asked())
        assert office.in_contact(made.now)
        grant = away(office.grant, distance)
        office.grant = grant
        assert office.in_contact(made.now) == touches
        office.withdraw("a test", made.now)
        assert (office.retreat is not None) == touches
    assert not office.one_way_out
    office.grant = None
    assert not office.in_contact(made.now)
    assert not office.one_way_out


def left(person=False, out=None, push=(0.0, 0.0, 0.0), distance=0.2):
    """An office whose arm backs out of something, so far away; a tick later."""
    made = Office()
    office = made.ticks(0.1, asked(out))
    grant = replace(away(office.grant, distance), person=person)
    office.retreat = Retreat("why", grant, Executed(), ROBOT.home, made.now)
    office.grant = grant
    made.tick(push=push)
    return made, office


@pytest.mark.parametrize(
    ("person", "out", "force", "stays"),
    [
        (True, None, PUSHED + 0.3, True),
        (True, None, PUSHED - 0.3, False),
        (False, None, PUSHED + 0.3, False),
    ],
)
def test_somebody_who_presses_on_is_left_for_a_while(person, out, force, stays):
    made, office = left(person, out, force * OUT)
    assert (office.retreat is not None) == stays
    if stays:
        assert gap(BODY, office.grant, ROBOT.home, made.now) < 0.005
        for passed, goes_on in ((PRESSED_ON - 0.5, True), (PRESSED_ON + 0.5, False)):
            office.grant = office.retreat.grant = away(office.grant, 0.2)
            office.retreat.began = made.now - passed
            made.tick(push=force * OUT)
            assert (office.retreat is not None) == goes_on, "a sensor may lie"


@pytest.mark.parametrize(
    ("quiet", "force", "later", "again"),
    [
        (0.0, PUSHED + 0.3, 0.0, True),
        (QUIET + 0.3, PUSHED + 0.3, 0.0, False),  # it was pushed all the time
        (0.0, PUSHED - 0.3, 0.0, False),
        (0.0, PUSHED + 0.3, AGAIN, False),
    ],
)
def test_what_was_left_and_comes_back_is_left_once_more(quiet, force, later, again):
    made, office = left(push=quiet * OUT)
    assert office.retreat is None
    made.ticks(0.1, push=quiet * OUT)
    made.now += later
    made.tick(push=quiet * OUT)
    assert office.retreat is None
    made.tick(push=force * OUT)
    assert (office.retreat is not None) == again
    if again:
        assert gap(BODY, office.grant, ROBOT.home, made.now) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("person", "out"), [(True, None), (False, OUT)])
def test_who_was_left_and_what_is_bolted_do_not_swing_back(person, out):
    made, office = left(person, out)
    assert office.retreat is None
    made.ticks(0.1)
    made.tick(push=5.0 * OUT)
    assert office.retreat is None


@pytest.mark.parametrize("out", [OUT, None])
def test_the_law_of_a_thing_has_its_region_with_what_is_not_known_of_it(out):
    made = Office()
    office = made.ticks(0.1, asked(out, stiffness=300.0))
    when = made.now + 0.5
    law = office.law(when, ROBOT.home, made.map)
    sure = office.grant.region.deviation(when)
    assert sure > 0.04
    assert law.margin == pytest.approx(ARM_ERROR + SURE * sure)
    assert law.speed == office.permit.speed == 0.02
    assert law.held == (out is not None)
    assert (law.parts == office.grant.touching[BODY.moving]).all()
    stiff = made.ticks(0.1, asked(out, stiffness=1e4))
    slow = pressing_speed(GuardConfig(), stiff.permit, 1e4)
    assert stiff.law(when, ROBOT.home, made.map).speed == slow < 0.02
    office.withdraw("a test", made.now)
    assert office.law(when, ROBOT.home, made.map).speed == GuardConfig().retreat_speed
    office.grant = None
    assert office.law(when, ROBOT.home, made.map) is None


@pytest.mark.parametrize("kind", ["hand", "face"])
def test_the_law_of_somebody_has_what_is_seen_and_of_a_face_all_of_its_region(kind):
    config = GuardConfig(head_height=1.2, base_height=0.5, soft=5e3)
    made = Office(config)
    ask = asked(kind=kind, force=4.0, torque=0.4, seconds=10.0, speed=0.1)
    office = made.ticks(0.1, ask)
    assert office.permit.holds, office.permit.reason
    assert office.grant.person
    if kind == "hand":
        up, height = office.grant.ceiling
        assert (up.tolist(), height) == ([0.0, 0.0, 1.0], pytest.approx(0.7))
    else:
        assert office.grant.ceiling is None
    seen = np.asarray([TIP - RADIUS * OUT], np.float32)
    made.map = replace(made.map, hazards=seen, hazard_unknown=np.zeros(1, bool))
    law = office.law(made.now, ROBOT.home, permitted(made.map, office.grant))
    lattice = office.grant.region.lattice(made.now, LATTICE)
    there = law.middle[None] if kind == "hand" else lattice
    expected = np.concatenate([seen, there])
    points = law.touchable.blocks.points
    assert sorted(points.tolist()) == sorted(expected.astype(np.float32).tolist())
    assert law.touchable.radius == made.map.hazard_radius
    slow = gentle_speed(ROBOT, config, office.permit, law.middle, ROBOT.home)
    assert law.speed == slow < office.permit.speed
    assert office.law(made.now, None, made.map).speed == office.permit.speed
    office.withdraw("a test", made.now)
    if office.retreat is not None:
        assert office.law(made.now, ROBOT.home, made.map).speed == config.retreat_speed


def test_a_hand_is_touched_where_it_is_felt_or_seen():
    """Its region is large: an arm that is in it need not touch."""
    for force, seen, touches in ((0.2, False, False), (1.0, False, True), (0.2, True, True)):
        made = Office()
        ask = asked(kind="hand", force=30.0, torque=1.0, seconds=10.0)
        office = made.ticks(0.2, ask, push=force * OUT)
        assert office.permit.holds, office.permit.reason
        at = np.asarray([TIP - RADIUS * OUT] if seen else np.empty((0, 3)), np.float32)
        made.map = replace(made.map, hazards=at, hazard_unknown=np.zeros(len(at), bool))
        made.tick(ask, push=force * OUT)
        assert office.in_contact(made.now) == touches


def test_refused_is_who_cannot_be_felt_or_has_no_soft_tip_and_who_asks_without_a_map():
    made = Office()
    office = made.office
    ask = asked(kind="face", force=4.0, torque=0.4, seconds=10.0)
    made.tick(ask)
    assert office.permit.state is PermitState.REFUSED
    assert "soft" in office.permit.reason
    deaf = PermitOffice(ROBOT, BODY, GuardConfig(soft=5e3), Executed())
    still = JointState(1.0, ROBOT.home, np.zeros(ROBOT.n))
    seen = replace(NOBODY, stamp=1.0)
    now = replace(ask, region=replace(ask.region, exposure=1.0))
    deaf.consider(1.0, now, seen, still)
    assert "nobody would feel" in deaf.permit.reason
    deaf.consider(1.0, replace(now, kind="thing"), seen, still)
    assert deaf.permit.holds, deaf.permit.reason
    blind = PermitOffice(ROBOT, BODY, GuardConfig(), Executed())
    blind.consider(1.0, replace(now, kind="thing"), None, still)
    assert "no map" in blind.permit.reason


def test_a_face_that_is_come_to_may_seem_a_little_faster_than_one_that_is_granted():
    made = Office(GuardConfig(soft=5e3))
    ask = asked(kind="face", force=4.0, torque=0.4, seconds=10.0)

    def at(speed):
        across = np.cross(OUT, [0.0, 0.0, 1.0])
        velocity = speed * across / np.linalg.norm(across)
        made.tick(replace(ask, region=replace(ask.region, velocity=velocity)))
        return made.office.permit

    assert at(0.22).state is PermitState.REFUSED
    assert at(0.19).state is PermitState.GRANTED
    assert at(0.22).state is PermitState.GRANTED
    assert at(0.25).state is PermitState.WITHDRAWN


@pytest.mark.parametrize("what", ["map", "region"])
def test_who_is_beside_is_looked_for_where_either_the_map_or_the_region_is_newer(what):
    """A thing that nobody sees anew, and somebody comes; one that moves to where somebody is."""
    made = Office()
    still = JointState(made.now, ROBOT.home, np.zeros(ROBOT.n))
    region = replace(asked().region, exposure=made.now)
    border = RADIUS + grown_by(NOBODY, region) + SHELL * NOBODY.grid.voxel
    off = 0.01 if what == "region" else -0.01
    way = np.array([[1.0, 0.0, 0.0], [1.0, 0.01, 0.0], [1.0, 0.0, 0.01]])
    points = (region.center(made.now) + (border + off) * way).astype(np.float32)
    seen = replace(made.map, hazards=points, hazard_unknown=np.zeros(3, bool))
    nearer = replace(region, exposure=made.now + 1e-3)
    aside = region.center(0.0) + np.array([0.02, 0.0, 0.0])
    nearer = replace(nearer, T_base_region=make_pose(None, aside))
    before, after = (seen, seen) if what == "region" else (made.map, seen)
    made.office.consider(made.now, replace(asked(), region=region), before, still)
    assert made.office.permit.holds, made.office.permit.reason
    newer = nearer if what == "region" else region
    made.office.consider(made.now, replace(asked(), region=newer), after, still)
    assert "beside it" in made.office.permit.reason


def renewed(out=None):
    """The same under another name, as who needs it for longer asks before the time is over."""
    return asked(out, name="the next")


@pytest.mark.parametrize("out", [OUT, None])
def test_a_permit_that_is_renewed_while_somebody_comes_ends_as_any_other(out):
    """Under its old name it would be withdrawn; the arm is in contact all the same."""
    made = Office()
    office = made.ticks(0.1, asked(out))
    before = office.permit
    made.beside(True)
    made.tick(renewed(out))
    assert office.permit.state is PermitState.WITHDRAWN
    assert office.permit.name == "the next"
    assert "beside it" in office.permit.reason
    assert office.retreat is not None
    assert office.grant is not None
    assert office.retreat.stands == (None if out is None else replace(before, name="the next"))
    made.tick()
    made.tick(renewed(out))
    assert office.retreat is not None, "somebody is still there"
    made.beside(False)
    made.tick(renewed(out))
    assert office.permit.holds == (out is not None)


@pytest.mark.parametrize("out", [OUT, None])
def test_a_renewal_that_cannot_be_ends_as_any_other_where_the_arm_touches(out):
    for wrong in ({"speed": -1.0}, {"parts": ("no such part",)}):
        made = Office()
        office = made.ticks(0.1, asked(out))
        made.tick(replace(renewed(out), **wrong))
        assert not office.permit.holds
        assert office.retreat is not None
        assert office.retreat.stands is None


def test_a_renewal_that_is_refused_before_anything_is_touched_may_be_granted_next():
    made = Office()
    office = made.ticks(0.1, asked())
    made.q = made.q - np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])
    made.tick(asked())
    assert office.permit.holds
    assert not office.in_contact(made.now)
    made.beside(True)
    made.tick(renewed())
    assert office.permit.state is PermitState.REFUSED
    assert office.retreat is None
    assert office.grant is None
    made.beside(False)
    made.tick(renewed())
    assert office.permit.holds


def blind(made, ask=None):
    """A tick in which the joints say nothing that could be used."""
    made.now += TICK
    made.map = replace(made.map, stamp=made.now)
    return made.office.consider(made.now, ask, made.map, None)


@pytest.mark.parametrize("out", [OUT, None])
def test_a_reading_of_the_joints_that_is_lost_ends_no_retreat(out):
    made = Office()
    office = made.ticks(0.1, asked(out))
    office.withdraw("a test", made.now, beside=True)
    retreat = office.retreat
    blind(made)
    assert office.retreat is retreat
    assert office.grant is retreat.grant
    made.tick()
    assert office.retreat is retreat


def test_what_is_withdrawn_while_no_joints_are_known_is_left_all_the_same():
    made = Office()
    office = made.ticks(0.1, asked())
    made.beside(True)
    blind(made, asked())
    assert office.permit.state is PermitState.WITHDRAWN
    assert office.retreat is not None


def test_a_reading_from_the_future_silences_none_that_follow():
    made = Office()
    office = made.ticks(0.1, asked())
    office.feel([load(made.q, stamp=made.now + 100.0)])
    made.tick(asked())
    assert office.permit.holds
    made.tick(asked(), push=30.0 * OUT)
    assert not office.permit.holds
    assert "pressed with 30" in office.permit.reason


def test_a_reading_that_is_stamped_a_little_ahead_of_the_clock_counts():
    """A sensor's clock may go before ours by as much as any stamp may."""
    made = Office()
    office = made.ticks(0.1, asked())
    told = flange_pose(ROBOT, made.q)[:3, :3].T @ (30.0 * OUT)
    office.feel([load(made.q, told, stamp=made.now + TICK + 0.8 * GuardConfig().future)])
    made.tick(asked(), feels=False)
    assert "pressed with 30" in office.permit.reason


def test_who_asks_for_something_else_in_the_same_region_is_granted_that():
    made = Office()
    ask = replace(asked(), region=replace(asked().region, exposure=made.now))
    still = JointState(made.now, made.q, np.zeros(ROBOT.n))

    def consider(request):
        made.office.feel([load(made.q, stamp=made.now)])
        made.now += TICK
        return made.office.consider(made.now, request, replace(NOBODY, stamp=made.now), still)

    consider(ask)
    grant = made.office.grant
    assert not consider(replace(ask, name="the next"))
    assert made.office.grant is grant, "it is the same in all but name"
    assert consider(replace(ask, name="held", out=OUT))
    assert made.office.one_way_out
    assert consider(replace(ask, name="palm", kind="hand", force=30.0, torque=1.0, seconds=10.0))
    assert made.office.grant.person
    assert made.office.grant.ceiling is not None


PRESSED = 70.0
"""As a plug in its seat is [N]: more than a sensor may err by."""
PORT = {"out": OUT, "force": 100.0, "torque": 10.0}


def killed_there(tare, force=PRESSED, moves=0.0, **more):
    """An office that begins while the arm stands in what it will ask for, pressing it.

    Args:
        tare: (6,) what is told that the sensor said before, or None.
        force: on the arm, on its way out [N].
        moves: the arm moves so far [rad] before it asks.
        more: terms of what it asks for.
    """
    made = Office.__new__(Office)
    config = GuardConfig(thing_force=100.0)
    made.office = PermitOffice(ROBOT, BODY, config, Executed())
    made.now, made.q, made.map = 0.0, ROBOT.home.copy(), NOBODY
    made.ticks(0.7, None, force * OUT)
    made.q[-1] += moves
    made.tick(None, force * OUT)
    ask = asked(**PORT | more, tare=tare)
    for _ in range(2):
        made.tick(ask, force * OUT)
    return made, ask


def said_before(*error):
    """(6,) of the sensor at ``home`` with nothing touched: the tool's weight, and its own error."""
    told = load(ROBOT.home, np.asarray(error, float), stamp=0.0)
    return np.concatenate([told.force, told.torque])


def test_a_guard_that_begins_in_contact_believes_what_the_sensor_said_before():
    blind, _ = killed_there(None)
    assert not blind.office.permit.holds
    assert "70 N" in blind.office.permit.reason  # taken for the sensor's error
    made, ask = killed_there(said_before(3.0, -2.0, 5.0))
    assert made.office.permit.holds, made.office.permit
    error = np.linalg.norm([3.0, -2.0, 5.0])
    assert abs(made.office.permit.pressed - PRESSED) < error + 0.1
    made.ticks(1.0, ask, PRESSED * OUT)
    assert made.office.permit.holds  # all the time, and it is no sensor's error later on
    made.ticks(0.3, ask)
    assert made.office.permit.pressed < error + 0.1
    made.tick(ask, 120.0 * OUT)
    assert "pressed with" in made.office.permit.reason


def test_a_press_above_the_permit_is_left_by_the_one_way_out():
    made, _ = killed_there(said_before(0, 0, 0), force=120.0)
    assert "pressed with 120" in made.office.permit.reason
    assert made.office.retreat is not None


@pytest.mark.parametrize(
    ("tare", "more"),
    [
        (said_before(0, 0, 0), {"moves": 0.02}),
        (said_before(0, 0, 0), {"kind": "hand"}),
        (said_before(0, 0, 80.0), {}),
        (said_before(0, 0, 0), {"region": sphere(TIP + 0.5 * OUT)}),
    ],
    ids=["it moved", "somebody's hand", "a sensor that errs too much", "it is elsewhere"],
)
def test_what_is_told_of_before_is_not_believed_where_it_could_hide_a_press(tare, more):
    made, _ = killed_there(tare, **more)
    assert not made.office.permit.holds
    assert "70 N" in made.office.permit.reason


@pytest.mark.parametrize("tare", [np.zeros(3), np.full(6, np.nan), "nothing"])
def test_a_tare_that_is_none_is_refused_in_words(tare):
    made, _ = killed_there(tare)
    assert "its tare is" in made.office.permit.reason
