"""Terms of the guard that no test of a whole cell notices, each on its own."""

from types import SimpleNamespace

import numpy as np
import pytest

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.geometry.pose import make_pose
from armsight.motion.arm_model import ArmState
from armsight.motion.contact_speed import ContactSpeed, carried_along
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hung_cable import HARMLESS, DraggedCable
from armsight.motion.intents import JointIntent
from armsight.motion.looking import look
from armsight.motion.nearest import Hazards
from armsight.motion.reflex import ReflexStage
from armsight.motion.regions import Region
from armsight.motion.separation_monitor import RECEDE, SeparationMonitor
from armsight.motion.slide_kernels import project

from .test_contact import ROBOT
from .test_hung_cable import BARE, LONG, TOOL, Q, monitor, replace
from .test_monitor_terms import closing, crowd
from .test_steering import A, B, ready, wish


@pytest.mark.parametrize("joint", range(6))
def test_a_path_is_left_where_one_joint_is_off_it(joint):
    world = QuickCell(goals=[A, B])
    world.run(1.5)
    guard = world.guard
    route = guard._route
    assert route is not None
    for share, left in ((0.8, False), (1.2, True)):
        guard._goals.drop_request()
        there = route.wanted(np.zeros(6)).correction.copy()  # where the path is now
        there[joint] += share * guard.config.off_path
        tick = SimpleNamespace(
            brake=False, at_rest=True, now=world.now + 9.0, request=None,
            view=SimpleNamespace(allowed=1.0), ahead=SimpleNamespace(position=there),
        )  # fmt: skip
        guard._reconsider(tick)
        assert (guard._route is None) == left
        assert (tick.request is not None) == left
    assert tick.request.start == pytest.approx(there)


def test_a_cable_counts_while_any_joint_moves_it_and_not_only_all():
    """The first joint stands: spheres on its link need no time to stop, the cable does."""
    robot = BARE.with_tool(replace(TOOL, cable=LONG))
    gate, bare = monitor(robot), monitor(BARE)
    motion = np.array([0.0, 0.8, 0.0, 0.0, 0.0, 0.0])
    center, velocity = DraggedCable.of(robot).motion(Q, motion)
    fast = np.flatnonzero(np.linalg.norm(velocity, axis=1) > 1.2 * HARMLESS)
    lone = 0
    for part in fast:
        person = Hazards.at(center[part][None] + np.array([[0.0, -0.3, 0.0]]), 0.0)
        state = ArmState(0.0, Q, motion)
        assert not gate.stops_in_time(state, 0.2, person)
        lone += bare.stops_in_time(state, 0.2, person)
    assert lone > 0, "somewhere the arm alone would have been in time"


def test_without_a_cable_none_limits():
    gate = monitor(BARE)
    hand = Hazards.at(gate.body.motion(Q, np.zeros(6))[0][-1:] + 0.4, 0.0)
    view = gate.judge(Q, np.full(6, 0.3), hand)
    assert (view.cable, view.cable_excess, view.cable_hazard) == (np.inf, 0.0, -1)


def test_along_what_limits_it_a_motion_draws_away(monkeypatch):
    """What it is projected on is what is allowed less a hair, which rounding cannot turn round."""
    asked = []

    def told(wanted, rows, bounds, sweeps):
        asked.append((rows, bounds))
        return project(wanted, rows, bounds, sweeps)

    monkeypatch.setattr("armsight.motion.separation_monitor.project", told)
    looked = 0
    for seed in range(12):
        made, q, motion, hazards = crowd(seed, count=3, near=0.3, far=0.6)
        view = made.judge(q, motion, hazards)
        own, comes = closing(made, q, motion, view, hazards)
        made.slide(motion, q, hazards, view)
        for rows, bounds in asked[:1]:
            for row, bound in zip(rows, bounds):
                same = np.abs(comes - row @ motion) < 1e-5
                allowed = view.share[own] * comes
                assert np.abs(allowed[same] - RECEDE - bound).min() < 1e-5
                looked += 1
        asked.clear()
    assert looked > 20


def test_from_a_velocity_it_coasts_on_from_where_it_is_and_joins_the_plan_under_way(monkeypatch):
    """The first tick of coasting goes on by one: on its path then, and not two ticks from it."""
    world = ready()
    for _ in range(80):
        world.tick(goal=wish(world, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    guard, off, joins = world.guard, [], []
    coasts = guard._coast

    def coast(tick):
        done = coasts(tick)
        if done:
            off.append(np.abs(guard._route.wanted(tick.ahead.position).correction).max())
        return done

    monkeypatch.setattr(guard, "_coast", coast)
    for _ in range(60):
        world.tick(goal=JointIntent("B", B))
        joins.append(guard._joining)
    assert len(off) == 1
    assert off[0] < 0.1 * 0.2 * world.config.period
    assert any(joins), "the plan came while it moved"


def test_a_reflex_chooses_its_way_at_rest(monkeypatch):
    """Until then it slows down along its path: a way back does not begin at full speed."""
    cell = QuickCell(goals=[B], config=GuardConfig(reflex_distance=0.4))
    cell.q = A.copy()
    cell.run(1.8)
    center, velocity = (x[-1] for x in cell.guard.body.motion(cell.q, cell.v))
    ahead = center + 0.35 * velocity / np.linalg.norm(velocity)
    cell.balls = [Ball(lambda t: ahead, 0.05)]
    reflex, chosen, slows = cell.guard._reflex, [], 0
    chooses = reflex.choose

    def choose(*told):
        chosen.append(np.abs(cell.v).max())
        chooses(*told)

    monkeypatch.setattr(reflex, "choose", choose)
    while not chosen and cell.now < 4.0:
        cell.tick()
        slows += reflex.stage == ReflexStage.STOPPING
    assert chosen == pytest.approx([0.0], abs=0.01)
    assert slows > 2


def test_of_a_wish_that_comes_too_fast_to_what_may_be_touched_what_leads_beside_it_is_kept():
    """The tip, a centimetre before a ball: it is to lie before its place while it comes slowly."""
    gate = SeparationMonitor(ROBOT, GuardConfig(), ROBOT.limits.acceleration)
    gate.set_reaction(0.2, 0.0173)
    q, body = ROBOT.home, gate.body
    center, _ = body.motion(q, np.zeros(6))
    part, ball = len(center) - 1, 0.03
    way, beside = np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.8, 0.0])
    middle = center[part] + (body.radius[part] + 0.01 + ball) * way
    region = Region("sphere", (ball, 0, 0), make_pose(None, middle), 1.0, np.zeros(3))
    parts = np.arange(len(center)) == part
    contact = ContactSpeed("ball", parts, region, 1.0, 0.02, 0.0)
    wanted = carried_along(body, q, part, 0.3 * way + 0.08 * beside)
    tip = body.jacobian(q, part)[:3] @ contact.ease(body, q, wanted, gate.law)
    assert 0.0 < tip @ way < 0.2
    assert tip @ beside == pytest.approx(0.08, rel=0.05)


@pytest.mark.parametrize("now", [0.0, 0.2])
@pytest.mark.parametrize("then", [0.0, -0.2])
def test_an_arm_is_at_rest_where_it_stands_now_and_will_when_a_command_acts(now, then):
    def ahead(joints, time):
        return ArmState(
            time, np.zeros(6), np.array([0.0, now if time == 1.0 else then] + 4 * [0.0])
        )

    filter_ = SimpleNamespace(
        arm=SimpleNamespace(ahead=ahead), config=GuardConfig(), hazards=None,
        robot=SimpleNamespace(n=6), monitor=SimpleNamespace(at_rest=lambda q, hazards: None),
    )  # fmt: skip
    tick = look(filter_, 1.0, 0.008, None, None, None)
    assert tick.at_rest == (now == then == 0.0)
