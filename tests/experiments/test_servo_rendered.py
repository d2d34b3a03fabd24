"""Trials in the rendered cell begin like the others, and are said to agree with them or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.experiments.servo_ball import (
    REACHED,
    _drawn,
    joints_before,
    one_rendered,
    waypoints,
)
from armsight.experiments.servo_ball_rows import _why
from armsight.experiments.servo_bullseye import one_rendered as dock_rendered
from armsight.experiments.servo_eyes import RADIUS, Errors
from armsight.experiments.servo_mark import SETTLES, Mark, Marking
from armsight.experiments.servo_onlooker import COMES, OUTSIDE, Onlooker, begun, posed
from armsight.experiments.servo_rendered import Reaching, Trials, agreement
from armsight.experiments.servo_sip import HOLDS, Sip
from armsight.experiments.servo_straw import one_rendered as sip_rendered
from armsight.experiments.servo_world import (
    Trial,
    make_eyes,
    make_task,
    set_up,
    start_below,
    world_to_base,
)
from armsight.geometry.pose import exp, make_pose, transform
from armsight.mapping.snapshot import FREE, OCCUPIED
from armsight.motion.permits import Permit, PermitState
from armsight.robots.kinematics import sphere_centers
from armsight.runtime.config import SessionMode
from armsight.runtime.session import Session
from armsight.simulation.truth import Contact
from armsight.workcell import open_cell, simulated_world

SETUP = set_up(1.0, 1.0)
BALL = "ball"


def trials(seconds, lost=0):
    return Trials([True] * len(seconds) + [False] * lost, list(seconds))


def ball_at(place, start):
    """The cell's file with the ball at (3,) in ``base``."""
    world = transform(SETUP.workcell.robot.T_world_base, place[None])[0]
    return begun(SETUP, {"position": tuple(world.tolist())}, start)


@pytest.mark.parametrize(
    ("shown", "bulk", "agree"),
    [
        (trials([1.9, 2.0, 2.1]), trials(np.linspace(1.5, 2.5, 60)), True),
        (trials([1.9, 2.0, 2.1], lost=3), trials(np.linspace(1.5, 2.5, 60)), False),
        (trials([5.0, 5.2, 5.4]), trials(np.linspace(1.5, 2.5, 60)), False),
        (trials([2.0]), trials(np.linspace(1.5, 2.5, 60)), True),
    ],
    ids=["as long", "some lost", "slower", "one alone"],
)
def test_shares_and_times_have_to_agree_within_their_intervals(shown, bulk, agree):
    harm = [False] * len(shown.good)
    rows = {row.key: row for row in agreement("ball", "it is so", "at rest", shown, bulk, harm)}
    assert rows["rendered_agrees"].value == agree
    assert rows["rendered_agrees"].n == len(shown.good)
    assert rows["rendered_ball_success"].must is None, "the share of all trials has the budget"
    assert rows["harm"].value == 0.0


@pytest.mark.parametrize("motion", ["rest", "moving"])
def test_a_rendered_trial_begins_where_the_other_does_and_the_ball_gives_way(motion):
    _, ball, _, _, start = _drawn(SETUP, motion, Errors(), (64, 3))
    workcell = ball_at(ball(0.0), start)
    with open_cell(workcell, seed=1) as cell:
        assert cell.robot.home == pytest.approx(start)
        world = simulated_world(cell)
        placed = next(m for m in world.movers() if m.name == BALL).T_world_solid[:3, 3]
        base = SETUP.workcell.robot.T_world_base
        assert placed == pytest.approx(transform(base, ball(0.0)[None])[0])
        assert workcell.simulation.contact_pushes


def test_no_trial_begins_above_what_its_cell_maps():
    """Before V's upper places the elbow was 13 cm above it: nothing is seen there, and the arm
    stood where it began for 12 s."""
    low, high = (joints_before(SETUP, waypoints(SETUP)[k]) for k in (0, 1))
    mapping = SETUP.workcell.mapping
    flat = mapping.model_copy(update={"upper": (*mapping.upper[:2], 1.95)})
    lower = replace(SETUP, workcell=SETUP.workcell.model_copy(update={"mapping": flat}))
    assert start_below(lower, low) is low
    assert start_below(lower, high) is SETUP.robot.home


def test_the_map_reaches_above_the_elbow_before_every_place_of_v():
    """The rendered cell's ended 30 cm below it, the other trials' 80 cm above."""
    for place in waypoints(SETUP):
        start = joints_before(SETUP, place)
        assert start_below(SETUP, start) is start


def test_a_lost_trial_is_explained_by_what_held_the_arm_not_by_a_permit_that_was_granted():
    lost = {"away": 0.03, "last": "unseen space 0.55 m from upper_arm_link", "height": 1.3}
    granted = {**lost, "permit": "contact with ball (thing) granted"}
    refused = {**lost, "permit": "contact with ball (thing) refused: it is too fast"}
    assert (
        _why(granted) == "30 mm away (unseen space 0.55 m from upper_arm_link, the ball at 1.30 m)"
    )
    assert "refused: it is too fast" in _why(refused)
    assert "granted" in _why({**granted, "last": ""})


class World:
    """A tip and a ball."""

    contacts = ()

    def __init__(self):
        self.truth, self.tip, self.place, self.name = self, np.zeros(3), np.ones(3), BALL

    def tip_position(self):
        return self.tip

    def movers(self):
        return [self]

    @property
    def T_world_solid(self):
        return make_pose(None, self.place)

    def follow(self, name, path):
        assert name == BALL
        self.path = path


class Stoppable:
    """Where the arm is, and whether it was stopped."""

    guard, stopped = None, ""

    @property
    def joints(self):
        return type("", (), {"position": np.array(SETUP.robot.home), "velocity": np.zeros(6)})

    def view(self):
        return self

    def stop(self, why):
        self.stopped = why


def test_the_onlooker_leads_the_ball_and_ends_the_run_after_the_touch():
    world, session, judge = World(), Stoppable(), Reaching(REACHED)
    base = SETUP.workcell.robot.T_world_base
    start = make_pose(None, world.place)
    looks = Onlooker(world, SETUP, BALL, start, lambda t: np.array([0.8, 0.1 * t, 0.7]), judge)
    looks.attach(session)
    for k in range(100):
        now = 0.008 * k
        at = transform(base, np.array([[0.8, 0.1 * now, 0.7]]))[0]
        world.tip = at + np.array([0.0, 0.0, RADIUS + max(0.1 - 0.4 * now, 0.002)])
        world.place = at
        looks.update(now)
        np.testing.assert_allclose(world.path(now), at, atol=1e-12)
        if session.stopped:
            break
    assert judge.gap == pytest.approx(0.002)
    assert judge.reached == pytest.approx(0.2375, abs=0.009)
    assert session.stopped
    assert now == pytest.approx(judge.reached + 0.3, abs=0.009)


def test_a_hand_is_outside_until_it_is_wanted_and_its_trial_begins_when_it_is_there():
    world, session, judge = World(), Stoppable(), Reaching(REACHED)
    base = SETUP.workcell.robot.T_world_base
    world.tip = np.array([0.0, 0.0, 5.0])
    # The solid that is led stands 2 cm above the target.
    target = make_pose(None, world.place - [0.0, 0.0, 0.02])
    looks = Onlooker(
        world, SETUP, BALL, target, lambda t: np.array([0.8, 0.1 * t, 0.7]), judge,
        lambda now: now > 0.5,
    )  # fmt: skip
    looks.attach(session)
    upper = SETUP.workcell.mapping.upper
    first = transform(base, np.array([[0.8, 0.0, 0.7]]))[0]
    led = []
    for k in range(1000):
        now = 0.008 * k
        looks.update(now)
        led.append(world.path(now) - [0.0, 0.0, 0.02])
        if now <= 0.5:
            assert led[-1] == pytest.approx([OUTSIDE, *first[1:]])
            assert led[-1][0] > upper[0] + 0.2
    assert looks.begins == pytest.approx(0.5 + COMES, abs=0.009)
    then = int(np.ceil(looks.begins / 0.008))
    np.testing.assert_allclose(led[then - 120 : then - 2], [first] * 118, atol=1e-12)
    np.testing.assert_allclose(
        looks.path(looks.begins + 1.0), [0.8, 0.1, 0.7], atol=1e-12, err_msg="its own path then"
    )


def test_a_pose_is_what_a_target_s_section_makes_of_it():
    T = make_pose(exp([0, 0, 0, 0.3, -0.2, 2.5])[:3, :3], (0.8, -0.1, 1.1))
    workcell = begun(SETUP, posed(T), SETUP.robot.home)
    np.testing.assert_allclose(workcell.simulation.target[0].pose, T, atol=1e-9)


def test_the_other_trials_have_the_map_of_the_rendered_cell():
    """Theirs was 1.1 m higher and had neither bench nor column, and the law knew of no ceiling."""
    place = waypoints(SETUP)[0]
    eyes = make_eyes(SETUP, Errors(), np.random.default_rng(0))
    task = make_task(SETUP, "ours")
    cell = Trial(SETUP, eyes, task, lambda time: place, SETUP.robot.home).cell
    mapping = SETUP.workcell.mapping
    edges = np.array(cell.grid.shape) * cell.grid.voxel
    assert edges == pytest.approx(np.subtract(mapping.upper, mapping.lower), abs=cell.grid.voxel)
    assert task.chase.config.law.ceiling is not None
    there = world_to_base(SETUP, [[0.85, 0.0, 0.74], [0.0, 0.0, 2.1], [0.85, 0.0, 1.3]])
    state = [cell.state[tuple(index)] for index in cell.grid.index(there)]
    assert state == [OCCUPIED, OCCUPIED, FREE]
    reach = [cell.field[tuple(index)] for index in cell.grid.index(there)]
    assert reach == pytest.approx([0.0, 0.0, 0.3], abs=1e-6)


@pytest.mark.usefixtures("gl")
def test_at_home_nothing_unseen_is_so_near_that_it_holds_the_arm():
    """It was 0.52 m away, where the arm stands for good: cameras hung at the height of the elbow,
    and looked past the bench's edge and the front border from one side alone."""
    place = world_to_base(SETUP, [[0.85, 0.0, 1.15]])[0]
    workcell = ball_at(place, SETUP.robot.home).model_copy(update={"stereo": ()})
    with open_cell(workcell, seed=5) as cell:
        session = Session(cell, None, seed=5, mode=SessionMode(cell_is_empty=True))
        session.run(0.3)
        snapshot = session.snapshot()
    moves = np.asarray(SETUP.robot.spheres.link) > 1  # base and shoulder stay where they are
    center = sphere_centers(SETUP.robot, SETUP.robot.home)[moves]
    unseen = snapshot.hazards[snapshot.hazard_unknown]
    unseen = unseen[np.linalg.norm(unseen - place, axis=1) > 0.3]  # the ball hides some, too
    away = np.linalg.norm(unseen[:, None] - center[None], axis=2)
    assert (away - SETUP.robot.spheres.radius[moves]).min() > 0.9


class Look:
    """A tip before a target, and what was touched."""

    def __init__(self, begins=2.0):
        self.robot, self.q, self.v = SETUP.robot, np.array(SETUP.robot.home), np.zeros(6)
        self.now, self.begins, self.contacts = 0.0, begins, []
        self.at, self.target = np.array([0.5, 0.0, 0.0]), np.zeros(3)

    def tip(self):
        return self.at

    def place(self, time):
        return self.target


def contact(owner, force):
    return Contact(owner, owner, "", 6, 0.0, 0.0, 0.0, 0.1, np.zeros(3), force=force)


@pytest.mark.parametrize(
    ("owner", "force", "granted", "guarded", "harm"),
    [
        ("face", 4.0, 5.0, True, False),
        ("face", 6.0, 5.0, True, True),
        ("face", 6.0, 5.0, False, False),
        ("face", 200.0, 5.0, False, True),
        ("bench", 0.1, 5.0, True, True),
        ("face", 0.1, 0.0, True, True),
    ],
)
def test_a_straw_is_judged_by_its_first_touch_and_the_hardest(owner, force, granted, guarded, harm):
    seen, sip = Look(), Sip(np.array([-1.0, 0.0, 0.0]), guarded)
    permit = Permit("straw", "face", PermitState.GRANTED, force=granted)
    for k in range(700):
        seen.now = 0.01 * k
        if k == 300:
            seen.at, seen.contacts = np.array([-0.01, 0.003, 0.004]), [contact(owner, 0.1)]
        if k == 400:
            seen.at = np.array([-0.01, 0.05, 0.0])  # it slides along the face: that counts no more
            seen.contacts[0].force = force
        sip.look(seen, permit)
        if sip.over:
            break
    found = sip.found()
    assert found["mm"] == pytest.approx(5.0)
    assert found["seconds"] == pytest.approx(1.0), "counted from where the trial begins"
    assert found["force"] == force
    assert found["harm"] == harm
    assert seen.now == pytest.approx(3.0 + HOLDS, abs=0.011)


def test_a_straw_that_touches_nothing_has_done_nothing():
    sip = Sip(np.array([-1.0, 0.0, 0.0]))
    sip.look(Look(), None)
    found = sip.found()
    assert not found["touched"]
    assert not found["harm"]
    assert found["mm"] is None
    assert found["seconds"] is None


def test_a_mark_is_where_the_tip_comes_to_the_plate_and_not_where_it_passes_it():
    T = exp([0.1, 0.2, 0.3, 0.4, -0.3, 0.2])

    def at(u, v, height):
        return transform(T, np.array([[u, v, height]]))[0]

    mark = Mark(T)
    mark.follow(0.0, at(0.2, 0.0, 0.0))
    assert not mark.made, "beside the plate"
    mark.follow(1.0, at(0.003, 0.0, 0.004))
    assert not mark.made, "4 mm before it, and on its way"
    mark.follow(1.1, at(0.001, -0.002, 0.0005))
    assert mark.made
    assert mark.found()["mark"] == pytest.approx([1.0, -2.0])
    assert mark.found()["mm"] == pytest.approx(np.hypot(1.0, 2.0))
    waits = Mark(T)
    waits.follow(1.0, at(0.003, 0.0, 0.004))
    waits.follow(1.0 + SETTLES + 0.01, at(0.002, 0.0, 0.003))
    assert waits.found()["mm"] == pytest.approx(2.0), "it goes no farther"
    assert Mark(T).found() == {"mm": 200.0, "mark": None}


def test_a_rendered_mark_counts_from_where_the_trial_begins():
    seen, judge = Look(begins=2.0), Marking(np.eye(4), 12.0)
    for k in range(1000):
        seen.now = 0.008 * k
        seen.at = np.array([0.001, 0.0, 0.0 if seen.now < 1.0 else max(0.3 - 0.1 * seen.now, 0.0)])
        judge.look(seen, None)
    assert judge.over
    assert judge.seconds == pytest.approx(0.99, abs=0.02), "what lay on the plate before is none"
    assert judge.mark.found()["mm"] == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_a_bulls_eye_and_a_mouth_are_touched_in_the_rendered_cell_too():
    docked = dock_rendered(set_up(1.0, 1.0, "ur10_bullseye"), (64, 0))
    assert docked["mm"] < 5.0
    assert not docked["harm"]
    brought = sip_rendered(set_up(1.0, 1.0, "ur10_straw"), (64, 0))
    assert brought["mm"] < 15.0
    assert not brought["harm"]


@pytest.mark.slow
@pytest.mark.usefixtures("gl")
def test_a_ball_at_rest_is_touched_in_the_rendered_cell_too():
    found = one_rendered(SETUP, "rest", (64, 3))
    assert found["reached"]
    assert not found["harm"]
