"""Who holds a ball, and recorded hands, in trials without pictures."""

from __future__ import annotations

import numpy as np
import pytest

from armsight.errors import ArmsightError
from armsight.experiments.recorded_hands import (
    PLAYS,
    SLOWS,
    RecordedHand,
    recorded_hand,
    recorded_path,
)
from armsight.experiments.servo_apart import KEPT, apart, first_apart
from armsight.experiments.servo_ball import LIMIT, one_held, waypoints
from armsight.experiments.servo_eyes import Errors
from armsight.experiments.servo_held import (
    BEYOND,
    RADII,
    Holder,
    demonstrator,
    held_setup,
    recorded_holder,
    touch_held,
)
from armsight.experiments.servo_presses import Presses
from armsight.experiments.servo_world import make_eyes, set_up, world_to_base
from armsight.motion.permits import Permit, PermitState
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.docking import Touchable, docking
from armsight.simulation.skeleton import INDEX
from armsight.simulation.truth import Contact

SETUP = held_setup(set_up(1.0, 1.0))
T_BASE_WORLD = np.linalg.inv(SETUP.workcell.robot.T_world_base)
UP, FRONT = T_BASE_WORLD[:3, 2], T_BASE_WORLD[:3, 0]


@pytest.fixture
def clips():
    try:
        return recorded_hand(np.random.default_rng(0))
    except ArmsightError as missing:
        pytest.skip(str(missing))


def test_a_recorded_hand_is_played_slows_down_and_rests():
    """As fast as recorded for so long, then evenly slower, over half of what it would have gone."""
    joints = np.zeros((800, 19, 3))
    joints[:, INDEX["right_hand"], 0] = 0.3 * np.arange(800) / 100.0
    hand = RecordedHand("made up", 100.0, joints)
    assert hand.fastest == pytest.approx(0.3)
    for time in (0.0, 1.234, PLAYS):
        assert hand.hand(time)[0] == pytest.approx(0.3 * time)
    half = hand.hand(PLAYS + 0.5 * SLOWS)[0] - hand.hand(PLAYS)[0]
    assert half == pytest.approx(0.3 * SLOWS * 0.375)
    rests = 0.3 * (PLAYS + 0.5 * SLOWS)
    assert hand.hand(PLAYS + SLOWS)[0] == pytest.approx(rests)
    assert hand.hand(LIMIT)[0] == pytest.approx(rests)


def test_recorded_people_stand_and_hold_the_ball_about_the_middle(clips):
    middle = world_to_base(SETUP, [[0.8, 0.0, 1.3]])[0]
    holder = recorded_holder(middle, SETUP, np.random.default_rng(3))
    times = np.arange(0.0, PLAYS, 0.05)
    hands = np.array([holder.joints(t)[INDEX["right_hand"]] for t in times])
    feet = np.array([holder.joints(t)[INDEX["pelvis"]] for t in times])
    assert np.linalg.norm(hands.mean(axis=0) - middle) < 0.05
    assert np.ptp(feet, axis=0).max() < 1e-6
    for t in times[::20]:
        away = np.linalg.norm(holder.ball(t) - holder.joints(t)[INDEX["right_hand"]])
        assert away == pytest.approx(BEYOND)


@pytest.mark.parametrize("k", range(14))
def test_who_holds_a_ball_is_whole_and_their_head_is_not_in_what_may_be_touched(k):
    """The arm is; the region follows it, not the operator's side, which may be 20 deg off."""
    rng = np.random.default_rng(k)
    place = waypoints(SETUP)[k]
    holder = demonstrator(place, SETUP, rng)
    assert np.linalg.norm(holder.ball(0.0) - place) < 0.02
    joints = holder.joints(0.0)
    for a, b, least, most in (
        ("right_shoulder", "right_elbow", 0.28, 0.36),
        ("right_elbow", "right_wrist", 0.22, 0.28),
        ("right_wrist", "right_hand", 0.07, 0.10),
    ):
        assert least < np.linalg.norm(joints[INDEX[a]] - joints[INDEX[b]]) < most
    seen = Touchable(0.0, place, np.zeros(3), np.zeros((3, 3)), along=holder.along(0.0))
    region = docking("held_ball").request(seen, -FRONT, UP, FRONT).region
    assert region.distance(joints[[INDEX["head"]]], 0.0)[0] > RADII["head"]
    for joint in ("right_hand", "right_wrist", "right_elbow"):
        assert region.distance(joints[[INDEX[joint]]], 0.0)[0] < 0.02
    assert apart(SETUP.robot, SETUP.robot.home, holder.skin(0.0)) > 0.0


def test_who_stands_between_hides_the_ball_from_a_fixed_camera():
    eyes = make_eyes(SETUP, Errors(*[0.0] * 10), np.random.default_rng(0))
    place = waypoints(SETUP)[8]
    holder = demonstrator(place, SETUP, np.random.default_rng(1))
    home = SETUP.robot.home
    free = [not eyes._covered(home, c.true[:3, 3], place) for c in eyes.fixed]
    eyes.screens = holder.screens(0.0)
    left = [not eyes._covered(home, c.true[:3, 3], place) for c in eyes.fixed]
    behind = [c.true[:3, 3] @ FRONT > 1.0 for c in eyes.fixed]
    assert sum(left) < sum(free)
    assert all(seen for seen, hides in zip(left, behind) if not hides)
    beyond = holder.joints(0.0)[INDEX["neck"]] + 2.0 * FRONT
    assert eyes._covered(home, beyond, holder.joints(0.0)[INDEX["neck"]] - 0.5 * FRONT)


def test_a_recorded_hand_rests_where_it_is_asked_to(clips):
    place, base = np.array([0.7, 0.1, 0.8]), SETUP.workcell.robot.T_world_base
    path, _, _ = recorded_path(place, base, np.random.default_rng(3), rests=True)
    about, _, _ = recorded_path(place, base, np.random.default_rng(3))
    assert path(PLAYS + SLOWS) == pytest.approx(place)
    assert path(LIMIT) == pytest.approx(place)
    assert path(1.0) - path(2.0) == pytest.approx(about(1.0) - about(2.0))


def test_the_arm_begins_apart_from_somebody_or_as_far_as_there_is_room():
    """Trial 16 of seed 14 began at home, 0.2 m from who held the ball: nothing else was free."""
    robot, home = SETUP.robot, np.array(SETUP.robot.home)
    near, far = home + 0.1 * np.eye(6)[0], home + 0.6 * np.eye(6)[0]
    skin = tcp_pose(robot, home)[:3, 3] + [[0.0, 0.0, 0.1]]
    assert apart(robot, near, skin) < apart(robot, far, skin) < KEPT
    assert first_apart(robot, [near, far, near], skin) is far
    assert first_apart(robot, [near, far], skin + np.array([3.0, 0.0, 0.0])) is near


def test_of_a_ball_in_a_hand_it_is_told_how_fast_it_is_led(monkeypatch):
    """One that was swung at 2.5 m/s into an arm that stood had pressed it with 271 N, as harm."""
    led = []

    class Spy(Presses):
        def look(self, cell, permit, comes=0.0):
            led.append(comes)
            super().look(cell, permit, comes)

    monkeypatch.setattr("armsight.experiments.servo_held.Presses", Spy)
    rng, away = np.random.default_rng(1), np.array([0.0, 0.2, 0.0])
    still = demonstrator(waypoints(SETUP)[0], SETUP, rng)
    holder = Holder(lambda time: still.joints(0.0) + 2.0 * time * away)
    touch_held(SETUP, "ours", Errors(arm=0.0), holder, SETUP.robot.home, 0, rng, 0.04, 0.005)
    assert led == pytest.approx([0.4] * 5)


class Struck:
    """A cell in which the arm is touched with a force where it moves as fast as told [m/s]."""

    def __init__(self, speed, forces):
        self.robot, self.q, self.now = SETUP.robot, np.array(SETUP.robot.home), 0.0
        self.speed, self.forces = speed, forces
        self.contacts = [touch(speed)]

    def on(self, permit, comes=0.0, turns=0.5):
        presses = Presses()
        for force in self.forces:
            self.now += 0.008
            self.q = self.q + 0.008 * turns * np.eye(6)[0]  # the shoulder: all parts
            self.contacts[0].force = max(force, self.contacts[0].force)
            presses.look(self, permit, comes)
        return presses


def touch(speed):
    """A contact of the arm's second link, which is no faster there [m/s]."""
    return Contact("object", "hand", "", 2, 0.0, 0.0, 0.0, speed, np.zeros(3), force=0.0)


@pytest.mark.parametrize(
    ("speed", "state", "harm"),
    [
        (0.0, PermitState.REFUSED, False),
        (0.03, PermitState.REFUSED, False),
        (0.06, PermitState.REFUSED, True),
        (0.0, PermitState.GRANTED, True),
    ],
)
def test_who_runs_into_an_arm_that_stands_is_no_harm_of_it(speed, state, harm):
    permit = Permit("hand", "hand", state, force=25.0)
    presses = Struck(speed, [0.0] * 8 + [5.0, 60.0, 110.0, 110.0]).on(permit)
    assert presses.harm == harm
    assert (presses.force, presses.struck) == ((110.0, 0.0) if harm else (0.0, 110.0))


def test_another_contact_is_no_longer_hidden_by_a_stronger_one():
    """Until November 2026 what the arm did was seen only while it was the greatest force so far."""
    cell = Struck(0.0, [0.0] * 8)
    presses = cell.on(None)
    cell.contacts = [touch(0.0), touch(0.2)]
    cell.contacts[0].force, cell.contacts[1].force = 50.0, 20.0
    presses.look(cell, None)
    assert (presses.force, presses.struck) == (20.0, 50.0)


@pytest.mark.parametrize(
    ("comes", "turns", "state", "harm"),
    [
        (2.2, 0.1, PermitState.GRANTED, False),  # faster than the link, and than may be touched
        (0.9, 0.1, PermitState.GRANTED, True),
        (2.2, 5.0, PermitState.REFUSED, True),  # the link is faster
        (0.0, 0.0, PermitState.REFUSED, False),  # the arm was pushed: it had not moved before
    ],
)
def test_a_hand_that_strikes_an_arm_that_is_slower_is_no_harm_of_it(comes, turns, state, harm):
    permit = Permit("hand", "hand", state, force=25.0)
    presses = Struck(0.3, [0.0] * 8 + [60.0]).on(permit, comes, turns)
    assert presses.harm == harm
    assert max(presses.force, presses.struck) == 60.0


def test_what_a_permit_allows_is_no_harm():
    permit = Permit("hand", "hand", PermitState.GRANTED, force=25.0)
    assert not Struck(0.1, [0.0] * 8 + [5.0, 20.0]).on(permit).harm


@pytest.mark.slow
def test_a_ball_that_somebody_holds_is_touched_and_nobody_else():
    found = one_held(set_up(1.0, 1.0), "ours", "rest", Errors(arm=0.0), (64, 12))
    assert found["reached"]
    assert not found["harm"]
    assert found["heads"] == 0
