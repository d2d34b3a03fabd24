"""The task in the whole rendered cell: what it sees, what it asks for, what it shows."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armsight.errors import UsageError
from armsight.geometry.pose import inverse
from armsight.motion.face import face_fault
from armsight.motion.intents import JointIntent, PoseIntent, Rest, VelocityIntent, refusal
from armsight.motion.permits import Permit, PermitState
from armsight.motion.task import Observation, Perceived
from armsight.robots import load_robot
from armsight.robots.kinematics import tcp_jacobian, tcp_pose
from armsight.robots.sprung_tip import SprungTip
from armsight.runtime.session import Session
from armsight.servoing.aim_kernels import aimed_joints
from armsight.servoing.approach import Funnel
from armsight.servoing.color_kernels import chroma_along, pick_color
from armsight.servoing.detour import BEFORE
from armsight.servoing.docking import DOCK_NAMES, docking
from armsight.servoing.eyes import Eye, WristEye
from armsight.servoing.kernels import last_steps_down
from armsight.servoing.modes import ChaseConfig, make_chase
from armsight.servoing.sighting import Look, Looks, sighting_fault
from armsight.servoing.targets import ball, bullseye, held_ball, mouth, palm
from armsight.servoing.targets.ball import Ball
from armsight.servoing.targets.mouth import Mouth
from armsight.servoing.targets.palm import Palm
from armsight.tasks.catalogue import make_task
from armsight.tasks.handover import HandoverTask
from armsight.tasks.servo import ServoOptions, ServoTask
from armsight.workcell import open_cell
from armsight.workcell.packaged import load

from .test_laws import FRONT, HOME, UP, JointState, Word
from .test_laws import look as look_at_place
from .traced import frame

UR10 = load_robot("ur10")


class Unknown:
    """A perceiver of a pair that is not there."""

    name, period, cameras, stereo = "odd", 0.1, (), ("shoulder",)

    def update(self, frames):
        return None


@pytest.mark.usefixtures("gl")
def test_half_a_second_of_the_rendered_cell():
    """All five see the ball, the estimate is right to what the cell's calibration is, it is asked
    for by a permit, and the tip comes nearer."""
    with open_cell(load("ur10_servoing"), seed=1) as cell:
        task = ServoOptions().make(cell)
        session = Session(cell, task, seed=1)
        with pytest.raises(UsageError, match=r"no stereo pair 'shoulder'.*there are: wrist"):
            Session(cell, None, perceivers=(Unknown(),))
        session.run(0.6)
        chase, face = task.chase, task.face()
        ball = next(m for m in cell.world.movers() if m.name == "ball").T_world_solid[:3, 3]
        truth = inverse(cell.T_world_base) @ np.array([*ball, 1.0])
        assert np.linalg.norm(chase.place - truth[:3]) < 0.02
        assert {p.name for p in face.pictures} == {c.info.name for c in cell.cameras} | {"wrist"}
        shown = {p.name: p.image for p in face.pictures}
        green = (shown["wrist"] == (20, 230, 60)).all(axis=2).any(axis=0)
        third = len(green) // 3
        assert green[:third].any(), "the ball is drawn in by the left lens"
        assert green[third : 2 * third].any(), "and by the right one"
        assert [curve.name for curve in face.curves] == ["distance", "force", "source"]
        assert face_fault(face) == ""
        assert face.state == "near"
        assert session.status().permit is not None
        assert session.task_failure == ""
        begin = chase.distance
        session.run(0.4)
        assert chase.distance < begin - 0.01


def test_a_cell_without_colour_is_refused():
    class Camera:
        def __init__(self, info):
            self.info = replace(info, color=None)

    with open_cell(load("ur10_inverted"), seed=0) as cell:
        cell.cameras = tuple(Camera(c.info) for c in cell.cameras)
        with pytest.raises(UsageError, match="no camera with a colour lens"):
            ServoOptions().make(cell)


class Lacking:
    """A cell whose gripper or pairs are taken away, or which has another gripper."""

    def __init__(self, cell, **other):
        self._cell, self._other = cell, other

    def __getattr__(self, name):
        return self._other[name] if name in self._other else getattr(self._cell, name)


class Narrow:
    opening = 0.05


def test_what_a_cell_lacks_for_a_task_is_said_and_its_own_gripper_is_used():
    with open_cell(load("ur10_handover"), seed=0) as cell:
        with pytest.raises(UsageError, match=r"no \[gripper\]"):
            ServoOptions("hand").make(Lacking(cell, gripper=None))
        with pytest.raises(UsageError, match="no stereo pair on the flange"):
            ServoOptions("hand", "paper").make(Lacking(cell, stereo=()))
        for wrong in ({"standoff": -0.1}, {"standoff": float("nan")}, {"ball_radius": 0.0}):
            with pytest.raises(UsageError, match="expected 0 or more"):
                ServoOptions(**wrong).make(cell)
        # One of 5 cm is open at 5 cm, not jammed.
        handover = ServoOptions("hand").make(Lacking(cell, gripper=Narrow))
        assert isinstance(handover, HandoverTask)
        assert handover.opening == handover._width == 0.05
        # At a stand-off a hand is followed: nothing is let go.
        follows = ServoOptions("hand", standoff=0.2).make(Lacking(cell, gripper=None))
        assert not isinstance(follows, HandoverTask)
        assert follows.chase.config.funnel.gap == 0.2


def test_a_target_of_ones_own_is_a_detector_and_a_docking():
    """The example: its detector finds a ball to a centimetre, its task runs in V's cell."""
    example = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "own_target.py"))
    ball = np.array([0.1, 0.0, 2.0])
    (seen,) = example["RedThing"]().in_frame(frame([(ball, 0.04, (205, 30, 25))], np.eye(4)))
    assert np.linalg.norm(seen.position - ball) < 0.01
    assert sighting_fault(seen) == ""
    with open_cell(load("ur10_servoing"), seed=0) as cell:
        task = make_task("own_target:Follow", example["Follow"](0.05), cell)
    assert [eye.name for eye in task.perceivers][-1] == "eye/wrist"
    assert task.chase.config.funnel.gap == 0.05
    task.chase.see(look_at_place("front_left", (1.7, 1.4, -0.1), (0.8, 0.1, 0.7), 1.0))
    permit = task.update(observe(1.05)).permit
    assert (permit.name, permit.kind) == ("red thing", "thing")


@pytest.mark.parametrize("name", DOCK_NAMES)
def test_eyes_and_task_compile_what_they_need_before_time_begins(name):
    """What finds the target has run to its end; the detector that is used remembers nothing."""
    rehearsed = {
        "ball": ball, "held_ball": held_ball, "bullseye": bullseye, "straw": mouth, "hand": palm,
    }[name].rehearsed  # fmt: skip
    assert rehearsed(), "a painted one is found"
    assert name != "held_ball" or rehearsed()[0].along is not None
    target = docking(name).detector()
    mind = {key: value for key, value in vars(target).items() if key in ("_down", "_offset")}
    Eye("a", target).warm_up()
    WristEye("b", target, UR10, Ball(0.005, "mark")).warm_up()
    assert mind == {key: vars(target)[key] for key in mind}
    task = task_of(dock=name)
    task.warm_up()
    assert task.chase.estimate is None
    for kernel in (pick_color, chroma_along, last_steps_down, aimed_joints):
        assert kernel.signatures


def test_a_cell_that_begins_anew_is_looked_at_anew():
    class Remembers:
        name, told, seen = "x", 0, []

        def reset(self):
            Remembers.told += 1

    Eye("a", Remembers()).reset()
    WristEye("b", Remembers(), UR10).reset()
    assert Remembers.told == 2
    for target, field, value in ((Mouth(), "_down", UP), (Palm(), "_glove", {"a": (UP, UP)})):
        setattr(target, field, value)
        Eye("a", target).reset()
        assert not getattr(target, field)


def task_of(mode="ours", standoff=0.0, dock="ball"):
    config = ChaseConfig(UP, FRONT, 0.04, funnel=Funnel(standoff))
    chase = make_chase(mode, UR10, ("a", "b", "wrist"), "wrist", config)
    return ServoTask(docking(dock), mode, chase, [], config, standoff)


def observe(now, q=HOME, command=None):
    guard = None
    if command is not None:
        guard = Word(now - 0.008, command)
    return Observation(now, UR10, JointState(now, np.array(q), np.zeros(6)), guard)


def test_an_arm_that_sees_nothing_looks_from_home():
    """Before a bulls-eye the arm hid it from all cameras that could have seen it, for good."""
    task, away = task_of("ours"), np.array(UR10.home) + 0.3
    for now in (0.5, 1.5, 2.4):
        assert isinstance(task.update(observe(now, away)), Rest)
    goal = task.update(observe(2.6, away))
    assert isinstance(goal, JointIntent)
    assert (goal.position == UR10.home).all()
    assert refusal(goal, UR10) == ""
    assert isinstance(task.update(observe(2.7, np.array(UR10.home))), Rest), "it is there"
    for stamp in (2.7, 2.8):
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), (0.8, 0.1, 0.7), stamp))
    assert isinstance(task.update(observe(2.9, away)), VelocityIntent)
    for now in (4.5, 6.0):  # lost: it is waited for anew before the arm goes
        assert isinstance(task.update(observe(now, away)), Rest)
    assert isinstance(task.update(observe(6.6, away)), JointIntent)
    assert isinstance(task_of("paper").update(observe(9.0, away)), Rest), "V's mode waits"


@pytest.mark.parametrize("mode", ["ours", "paper", "fixed"])
def test_a_target_that_nobody_sees_any_more_is_not_chased(mode):
    task = task_of(mode)
    assert isinstance(task.update(observe(0.5)), Rest)
    for stamp in (0.6, 0.8, 1.0):
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), (0.8, 0.1, 0.7), stamp))
    intent = task.update(observe(1.1))
    assert isinstance(intent, VelocityIntent)
    assert intent.exposure == 1.0
    assert refusal(intent, UR10, 1.1) == ""
    late = task.update(observe(2.5))
    assert isinstance(late, Rest)


@pytest.mark.parametrize("mode", ["ours", "paper", "fixed"])
def test_velocities_stay_within_the_limits_wherever_the_target_jumps(mode):
    """100 places, far out of reach among them, one each tenth of a second."""
    rng = np.random.default_rng(0)
    task, q = task_of(mode), HOME.copy()
    limits = UR10.limits.scaled(0.5, 0.6)
    command = np.zeros(6)
    for k in range(1000):
        now = 1.0 + 0.008 * k
        if k % 12 == 0:
            place = rng.uniform((-2, -2, -1), (3, 2, 2))
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now))
        intent = task.update(observe(now, q, command))
        command = intent.velocity if isinstance(intent, VelocityIntent) else np.zeros(6)
        assert np.isfinite(command).all()
        if mode == "ours":
            assert (np.abs(command) <= limits.velocity * 1.0001).all()
        q = np.clip(q + 0.008 * command, UR10.limits.lower, UR10.limits.upper)


def test_nothing_is_learned_from_the_mark_on_a_tip_that_is_pushed_aside():
    """Of the pair's looks those go on without it that were exposed while something was felt."""
    sprung = SprungTip(200.0, 0.03, 1.0)
    for dock, tip, kept in (("ball", None, True), ("ball", sprung, False), ("straw", None, False)):
        task = task_of(dock=dock)
        task.config = replace(task.config, tip=tip)
        seen = []
        task.chase.see = seen.append
        felt = Permit("ball", "thing", PermitState.GRANTED, pressed=3.0)
        for k, now in enumerate((1.0, 1.1, 1.18)):
            guard = Word(now, np.zeros(6))
            guard.permit = felt if k == 1 else replace(felt, pressed=0.0)
            mark = np.zeros(3)
            pair = replace(look_at_place("wrist", (0.6, 0, 0.5), None, now - 0.09), mark=mark)
            joints = JointState(now, HOME.copy(), np.zeros(6))
            published = (Perceived("eye/wrist", Looks(pair.stamp, (pair,))),)
            task._take(Observation(now, UR10, joints, guard, perceived=published))
        assert [one.mark is not None for one in seen] == [True, True, kept]


def test_a_permit_is_asked_for_near_a_thing_also_at_a_stand_off_but_there_not_for_somebody():
    """Without one the guard takes a ball for a person, and the arm follows 0.4 m behind it."""
    for dock, standoff, asked in (("ball", 0.0, True), ("ball", 0.1, True), ("straw", 0.1, False)):
        task = task_of(standoff=standoff, dock=dock)
        for stamp in (0.6, 0.8, 1.0):
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), (0.8, 0.1, 0.7), stamp))
        intent = task.update(observe(1.05))
        assert (intent.permit is not None) == asked
        if asked:
            assert intent.permit.region.size[0] == 0.04
            assert intent.permit.kind == "thing"


def test_the_region_of_a_target_on_a_curve_moves_as_the_target_will_when_the_command_acts():
    """A region that kept the velocity of its exposure limited an arm that goes along with it."""
    task, turn = task_of(), 0.25 / 0.2

    def ball(t):
        return np.array((0.8, 0.2 * np.sin(turn * t), 0.7 + 0.2 * np.cos(turn * t)))

    for k in range(60):
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), ball(0.05 * k), 0.05 * k))
    now = 3.10
    region = task.update(observe(now)).permit.region
    acts = now + task.config.law.delay
    velocity = (ball(acts + 0.001) - ball(acts - 0.001)) / 0.002
    old = (ball(region.exposure + 0.001) - ball(region.exposure - 0.001)) / 0.002
    assert np.linalg.norm(old - velocity) > 0.06
    assert np.linalg.norm(region.velocity - velocity) < 0.05
    assert np.linalg.norm(region.center(acts) - ball(acts)) < 0.006


def test_the_mark_on_the_tool_keeps_no_target_alive():
    """The pair goes on seeing its own tool; the ball that nobody sees is stale all the same, and
    the tip goes back from it first."""
    task = task_of()
    for k in range(8):
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), (0.8, 0.1, 0.7), 0.6 + 0.05 * k))
    near = task.update(observe(1.0)).velocity
    for k in range(30):
        stamp = 1.0 + 0.05 * k
        task.chase.see(Look("wrist", stamp, True, np.eye(4), (), np.zeros(3), 1e-6 * np.eye(3)))
        intent = task.update(observe(stamp + 0.08))
        if isinstance(intent, VelocityIntent):
            assert intent.exposure == pytest.approx(0.95)
    assert isinstance(intent, Rest)
    assert "not seen" in intent.reason
    assert np.isfinite(near).all()


def published(camera, place, stamp):
    return Perceived(f"eye/{camera}", Looks(stamp, (look_at_place(camera, UP, place, stamp),)))


def test_a_look_from_the_future_is_not_taken_and_said():
    """Once in the estimate it would lie ahead of all that is seen after it, and never grow old."""
    task, place = task_of(), (0.8, 0.1, 0.7)
    ahead = (published("b", place, 99.0),)
    intent = task.update(replace(observe(1.0), perceived=ahead))
    assert isinstance(intent, Rest)
    assert intent.reason == "b: seen 98.000 s in the future; check clocks"
    for k in range(5):
        now = 1.1 + 0.1 * k
        seen = (*ahead, published("a", place, now - 0.05))
        intent = task.update(replace(observe(now), perceived=seen))
        assert isinstance(intent, VelocityIntent)
        assert intent.exposure == now - 0.05


def test_a_permit_for_somebody_rests_on_pictures_that_showed_them():
    """What is refused as another's, in every picture since, keeps no face's permit alive."""
    task = task_of(dock="straw")
    for k in range(8):
        now = 1.0 + 0.05 * k
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), (0.8, 0.1 + 0.1 * now, 0.7), now))
    seen, fresh = now, task.update(observe(now + 0.05)).permit.region
    assert fresh.exposure == seen
    for k in range(2):  # elsewhere each time: no other target either
        elsewhere = (1.2 + 0.4 * k, -0.5, 0.3 + 0.5 * k)
        task.chase.see(look_at_place("b", (1.7, 1.4, -0.1), elsewhere, now + 0.1 * (k + 1)))
    region = task.update(observe(now + 0.25)).permit.region
    assert region.exposure == seen
    assert np.allclose(region.center(seen), fresh.center(seen), atol=0.01)


def test_where_its_own_way_is_blocked_it_asks_for_a_planned_one_and_goes_on_from_there():
    """The guard drives nothing of what is wanted, though it may touch: half a second is enough."""
    place, began = np.array([0.8, 0.1, 0.7]), None
    for blocked in (False, True):
        task, kinds = task_of(), []
        for k in range(200):
            now = 1.0 + 0.008 * k
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
            observed = observe(now, command=np.full(6, 0.0 if blocked else 0.4))
            observed.guard.wanted = np.full(6, 0.5)
            observed.guard.permit = Permit("ball", "thing", PermitState.GRANTED)
            if began is not None and k > began + 60:
                observed.guard.goal, observed.guard.reached = "way to ball", True
            intent = task.update(observed)
            kinds.append(type(intent))
            if isinstance(intent, PoseIntent):
                began = began if began is not None else k
                assert refusal(intent, UR10, now) == ""
                away = place - intent.T_base_tcp[:3, 3]
                assert np.linalg.norm(away) == pytest.approx(0.04 + BEFORE, abs=0.01)
                assert away @ intent.T_base_tcp[:3, 2] == pytest.approx(np.linalg.norm(away))
        assert (PoseIntent in kinds) == blocked
    assert 20 < began < 80
    assert kinds[began + 61 : began + 100] == [VelocityIntent] * 39


def test_past_who_holds_the_ball_the_planner_leads_from_the_beginning():
    """The law's own way led to within 40 cm of their shoulder, and stood there."""
    for far, planned in ((True, True), (False, False)):
        task, kinds = task_of(dock="held_ball"), []
        tip = tcp_pose(UR10, HOME)[:3, 3]
        for k in range(40):
            now = 1.0 + 0.008 * k
            place = np.array([0.8, 0.1, 0.7]) if far else tip + np.array([0.08, 0.0, 0.0])
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
            observed = observe(now, command=np.full(6, 0.4))
            observed.guard.wanted = np.full(6, 0.5)
            state = PermitState.GRANTED if k >= 20 else PermitState.REFUSED
            observed.guard.permit = Permit("held_ball", "hand", state)
            kinds.append(type(task.update(observed)))
        assert PoseIntent not in kinds[:20]
        assert (PoseIntent in kinds) == planned


@pytest.mark.parametrize("dock", ["straw", "bullseye"])
def test_what_the_permits_own_law_slows_is_no_blocked_way(dock):
    """The last centimetres before a face or a thing are slow: a planned way to 7 cm before it would
    lead there again and again."""
    task = task_of(dock=dock)
    tip = tcp_pose(UR10, HOME)[:3, 3]
    for k in range(120):
        now = 1.0 + 0.008 * k
        place = tip + np.array([0.08, 0.0, 0.0])
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
        observed = observe(now, command=np.zeros(6))
        observed.guard.wanted = np.full(6, 0.5)
        observed.guard.permit = Permit(dock, task.dock.permit, PermitState.GRANTED)
        assert not isinstance(task.update(observed), PoseIntent)


@pytest.mark.parametrize(("away", "gentle"), [(0.2, True), (0.45, True), (0.65, False)])
def test_near_somebody_no_more_is_wished_than_the_guard_lets_be_driven(away, gentle):
    """From 0.3 to 0.5 m the law wished for ten times as much, took its way for blocked, and asked
    for a planned one: a ball in a hand 0.46 m away was touched after 9.9 s."""
    config = ChaseConfig(UP, FRONT, 0.04, gentle=0.1)
    chase = make_chase("ours", UR10, ("a",), "", config)
    place = tcp_pose(UR10, HOME)[:3, 3] + (away + 0.04, 0.0, 0.0)
    for k in range(20):
        now = 1.0 + 0.008 * k
        chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
        wish = chase.step(now, JointState(now, HOME.copy(), np.zeros(6)), None)
    speed = np.linalg.norm(tcp_jacobian(UR10, HOME)[:3] @ wish.velocity)
    assert (speed < 0.12) == gentle


@pytest.mark.parametrize("dock", ["straw", "ball"])
def test_a_command_that_goes_elsewhere_is_not_driven_for_its_speed(dock):
    """Where the wrist folds against the forearm there is no room to stop, and the command goes to
    and fro as fast as one that gets there: a straw never came to a face at rest."""
    task, place = task_of(dock=dock), tcp_pose(UR10, HOME)[:3, 3] + (0.3, 0.0, 0.0)
    kinds = []
    for k in range(120):
        now = 1.0 + 0.008 * k
        task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, now - 0.02))
        aside = 0.4 * np.array([1.0, -1.0, 1.0, -1.0, 0.0, 0.0]) * (1 if k // 10 % 2 else -1)
        observed = observe(now, command=aside)
        observed.guard.wanted = np.full(6, 0.4)
        observed.guard.permit = Permit(dock, task.dock.permit, PermitState.GRANTED)
        kinds.append(type(task.update(observed)))
    assert PoseIntent in kinds


def test_the_tip_gives_way_to_what_presses_and_to_nothing_below_it():
    """2.5 N on 0.15 N/mm bend 10 mm beyond what is noise: by so much the goal goes back."""
    place = np.array([0.8, 0.1, 0.7])
    gives = {}
    for felt in (float("nan"), 0.9, 2.5, 50.0):
        task = task_of(dock="straw")
        for k in range(40):
            observed = observe(1.0 + 0.008 * k, command=np.zeros(6))
            observed.guard.permit = Permit("straw", "face", PermitState.GRANTED, pressed=felt)
            task.chase.see(look_at_place("a", (1.7, 1.4, -0.1), place, 0.98 + 0.008 * k))
            task.update(observed)
        gives[felt] = task.chase.give
    none, noise, pressed, hard = gives.values()
    assert none == noise == 0.0
    assert pressed == pytest.approx(0.010, abs=0.001)
    assert 0.03 < hard <= 0.05
