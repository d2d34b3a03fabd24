"""An arm in contact when its task ends, a camera dies, or the clock jumps."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.geometry.body_regions import BODY_REGIONS
from armsight.geometry.pose import make_pose
from armsight.motion.contact_limits import contact_speed, effective_mass
from armsight.motion.force_watch import TARED_OVER, ForceWatch
from armsight.motion.guard_config import GuardConfig
from armsight.motion.permit_law import UNSEEN, gentle_speed
from armsight.motion.permit_office import UNASKED
from armsight.motion.permits import Permit, PermitState
from armsight.motion.regions import region_fault

from .test_contact import ROBOT, TIP, load, tared
from .test_office_terms import FORCE, OUT, TICK, Office, asked
from .test_permits import sphere
from .test_socket import COMES, Socket, during, ends_at

# -- its task ends ----------------------------------------------------------------------------


@pytest.mark.parametrize("out", [OUT, None])
def test_what_no_task_asks_for_any_more_is_left_and_what_holds_a_part_is_stood_in(out):
    """Until November 2026 the grant was gone with the request: the arm stayed in contact with what
    counted as a person again, and nothing led it out."""
    made = Office()
    ask = asked(out)
    ask = replace(ask, region=replace(ask.region, drift=0.0))
    office = made.ticks(0.1, ask)
    before = office.permit
    made.ticks(0.9 * UNASKED)
    assert office.permit.holds, "a round that has lost sight of it ends nothing"
    made.ticks(0.2 * UNASKED)
    assert "no task asks" in office.retreat.reason
    assert office.retreat.stands == (None if out is None else before)
    assert office.grant is not None
    made.tick(ask)
    assert office.permit.holds == (out is not None)


def test_what_no_task_asks_for_is_watched_meanwhile_as_what_is_asked_for():
    says = {"force": "pressed with", "beside": "beside it", "time": "time is over", "": "known to"}
    for spoils, reason in says.items():
        made = Office()
        office = made.ticks(0.1, asked(seconds=0.2 if spoils == "time" else 10.0))
        made.tick()
        assert office.permit.holds
        made.beside(spoils == "beside")
        made.tick(push=(1.5 * FORCE if spoils == "force" else 0.0) * OUT)
        made.ticks({"time": 0.12, "": 0.35}.get(spoils, 0.0))
        assert reason in office.retreat.reason


def test_out_of_contact_a_permit_ends_with_its_request():
    made = Office()
    office = made.ticks(0.1, asked())
    made.q = made.q - np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0])
    made.tick(asked())
    assert office.permit.holds
    made.tick()
    assert office.permit is None
    assert office.grant is None
    assert office.retreat is None


def test_the_force_that_ends_a_permit_is_told_with_it():
    """What a task decides by, and the page shows, was of the tick before."""
    made = Office()
    office = made.ticks(0.1, asked(), push=0.2 * FORCE * OUT)
    assert office.permit.pressed == pytest.approx(0.2 * FORCE, abs=0.1)
    made.tick(asked(), push=1.5 * FORCE * OUT)
    assert office.permit.state is PermitState.WITHDRAWN
    assert office.permit.pressed == pytest.approx(1.5 * FORCE, abs=0.1)


# -- a camera dies ----------------------------------------------------------------------------


@pytest.mark.parametrize("out", [OUT, None])
def test_an_arm_that_presses_leaves_though_a_camera_is_dead(out):
    """It stood, pressing, for as long as the camera was silent."""
    socket = Socket(out)
    cell, heights, frozen = socket.cell, [], None
    for _ in socket.rounds(3.5):
        if cell.now > 1.0 and frozen is None:
            frozen = cell.snapshot
        pressed = 30.0 if 1.4 < cell.now < 1.5 else 0.0
        socket.round(pushed=pressed, snapshot=frozen)
        heights.append(ends_at(cell)[2])
    said = [s.reason for s in cell.log]
    before, after = (during(cell, at, at + 0.05).start for at in (1.35, 2.0))
    assert "camera cam is" in said[before], "it stands by its permit"
    assert "backs out of contact: pressed with" in said[after]
    assert heights[-1] > heights[before] + 0.02
    speed = np.abs(np.diff(heights)).max() / cell.config.period
    assert speed < (0.05 if out is not None else 0.15)


def test_an_arm_that_is_held_stands_though_a_camera_is_dead():
    socket = Socket(OUT)
    cell, heights, frozen = socket.cell, [], None
    for _ in socket.rounds(2.5):
        if cell.now > 1.0 and frozen is None:
            frozen = cell.snapshot
        socket.round(asks=cell.now < 1.0, snapshot=frozen)
        heights.append(ends_at(cell)[2])
    assert "camera cam is" in cell.log[-1].reason
    assert np.ptp(heights[during(cell, COMES, 2.5)]) < 1e-4


# -- the clock jumps --------------------------------------------------------------------------


def turned_back(made, seconds):
    """The clock of an office is turned back by a time [s]; a tick later."""
    made.now -= seconds
    made.office.forget_times(made.now + TICK)


def test_a_permit_lasts_no_longer_by_a_clock_that_is_turned_back():
    """It lasted for as much longer; a region that nobody saw anew, too, and moved on backwards."""
    made = Office()
    made.now = 100.0
    made.ticks(0.7)
    ask = asked(seconds=1.0)
    moving = replace(ask.region, velocity=np.array([0.0, 0.02, 0.0]), drift=0.02)
    office = made.ticks(0.1, replace(ask, region=moving))
    center, unsure = (
        f(made.now) for f in (office.grant.region.center, office.grant.region.deviation)
    )
    turned_back(made, 50.0)
    made.tick()
    assert office.permit.holds, "and the sensor's error is what it was"
    region = office.grant.region
    assert region.center(made.now) == pytest.approx(center, abs=1e-3)
    assert region.deviation(made.now) == pytest.approx(unsure, abs=1e-3)
    assert office.permit.until == pytest.approx(made.now + 0.9, abs=0.02)
    made.ticks(0.7, replace(ask, region=moving))
    assert office.permit.holds
    made.ticks(0.3, replace(ask, region=moving))
    assert "time is over" in office.permit.reason


@pytest.mark.parametrize("out", [OUT, None])
def test_a_way_out_leads_from_where_it_did_by_a_clock_that_is_turned_back(out):
    made = Office()
    made.now = 100.0
    made.ticks(0.7)
    ask = asked(out)
    office = made.ticks(0.1, replace(ask, region=replace(ask.region, velocity=0.05 * OUT)))
    office.withdraw("a test", made.now, beside=True)
    retreat = office.retreat
    assert (retreat.stands is not None) == (out is not None)
    made.tick()
    center, began = retreat.grant.region.center(made.now), made.now - retreat.began
    turned_back(made, 50.0)
    made.tick()
    assert office.retreat is retreat
    assert retreat.grant.region.center(made.now) == pytest.approx(center, abs=2e-3)
    assert office.grant is retreat.grant
    assert made.now - retreat.began == pytest.approx(began + TICK, abs=TICK)
    if out is not None:
        assert retreat.stands.until - made.now == pytest.approx(30.0, abs=0.2)


def test_what_was_left_may_come_back_for_no_longer_by_a_clock_that_is_turned_back():
    made = Office()
    made.now = 100.0
    made.office._left = (None, 99.0)
    made.office._now = 100.0
    turned_back(made, 50.0)
    assert made.office._left[1] == pytest.approx(49.0, abs=0.02)


def test_a_clock_that_says_no_number_for_a_tick_ends_no_contact():
    """The grant was gone, and with it the way out."""
    made = Office()
    office = made.ticks(0.1, asked())
    before = office.permit, office.grant
    assert not office.consider(np.nan, asked(), made.map)
    office.forget_times(np.nan)
    assert (office.permit, office.grant) == before
    assert office.law(np.nan, made.q, made.map) is None


# -- a region that cannot be ------------------------------------------------------------------


@pytest.mark.parametrize(
    "T",
    [np.diag([1.0, 1.0, -1.0, 1.0]), np.diag([1.0, 1.0, 1.0, 2.0]), np.eye(4) + np.eye(4)[::-1]],
)
def test_a_mirrored_pose_is_no_pose(T):
    region = sphere([0.4, 0.0, 0.3])
    assert region_fault(replace(region, T_base_region=make_pose(None, [0.4, 0.0, 0.3])), 10.0) == ""
    assert "rotation" in region_fault(replace(region, T_base_region=T), 10.0)


# -- terms of the watch and the law that no test looked at -------------------------------------


def test_what_is_left_is_not_followed_to_where_somebody_may_be():
    """Its own region would then be that of a hand beside it."""
    for beside in (False, True):
        made = Office()
        office = made.ticks(0.1, asked())
        office.withdraw("a test", made.now)
        before = office.retreat.grant.region.exposure
        made.beside(beside)
        made.tick(asked())
        assert (office.retreat.grant.region.exposure > before) != beside


def test_the_error_of_a_sensor_is_the_mean_of_the_last_half_second_by_any_clock():
    watch, q = tared(), ROBOT.home
    last = watch._free[-1][0]
    watch.turn_back(50.0)
    times = np.array([at for at, _ in watch._free])
    assert times[-1] == pytest.approx(last - 50.0)
    watch.take([load(q, bias=(3.0, -2.0, 5.0), stamp=last - 50.0 + 1.1 * TARED_OVER)], q, False)
    assert len(watch._free) == 1
    assert watch.fault(last - 50.0 + 1.1 * TARED_OVER) == ""


def test_a_sensor_that_begins_with_a_jolt_is_known_after_half_a_second():
    """Its first ten readings are no mean yet, and later on it may only drift."""
    watch, q = ForceWatch(ROBOT, (0.0, 0.0, -9.81)), ROBOT.home
    for k in range(60):
        jolt = (20.0 if k < 10 else 0.0, 0.0, 0.0)
        watch.take([load(q, bias=jolt, stamp=0.008 * k)], q, False)
    watch.take([load(q, stamp=0.49)], q, True)
    assert watch.pressed < 5.0


def test_somebody_is_met_more_slowly_by_what_arm_and_target_may_come_unseen():
    permit = Permit("x", "hand", PermitState.GRANTED, speed=0.1, force=5.0, torque=1.0)
    middle = TIP - 0.1 * OUT
    mass = effective_mass(ROBOT, ROBOT.home, ROBOT.n, TIP, -OUT)
    blow = contact_speed(BODY_REGIONS["hand"], mass, 5.0, np.inf)
    assert gentle_speed(ROBOT, GuardConfig(), permit, middle, ROBOT.home) == pytest.approx(
        blow - UNSEEN
    )
