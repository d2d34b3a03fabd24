"""The item is fetched by contact in the simulated world, and whatever goes wrong is said."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.devices.data import GripperState, JointState
from armsight.errors import UsageError
from armsight.experiments.quick_cell import QuickCell
from armsight.experiments.servo_cell import OWN, plate
from armsight.experiments.servo_eyes import Errors
from armsight.experiments.servo_handover import CELL, _hand
from armsight.experiments.servo_world import declare, make_eyes, make_task, mapped_box, set_up
from armsight.geometry.pose import from_rpy, inverse
from armsight.motion.intents import PoseIntent, Rest
from armsight.motion.permits import PermitState
from armsight.motion.task import Observation
from armsight.robots.kinematics import sphere_centers
from armsight.simulation.targets import TargetSpec, target_object
from armsight.simulation.world import SimulatedWorld
from armsight.tasks.fetch import ABOVE, CLOSES, JAMMED, SLOWLY, SOFTLY, fetch_in, with_item
from armsight.tasks.servo import ServoOptions
from armsight.workcell import open_cell
from armsight.workcell.packaged import load
from armsight.workcell.simulated import world_spec

BARE = set_up(1.0, 1.0, CELL)
SETUP = replace(BARE, robot=with_item(BARE.robot, BARE.workcell.items.size))
BASE = SETUP.workcell.robot.T_world_base
OPENING = 0.085


def fetching():
    return fetch_in(SETUP.workcell, OPENING, BASE)


class ItemCell(QuickCell):
    """Guard and planner over the simulated world's arm, gripper and items, its map by the truth."""

    def __init__(self, item=True, palm=None):
        super().__init__(
            [], robot=SETUP.robot, config=SETUP.guard, rate=60.0, box=mapped_box(SETUP)
        )
        declare(self, SETUP)
        spec = world_spec(SETUP.workcell)
        objects = tuple(o for o in spec.objects if o.solid.name == "item" and item)
        self.eyes, self.skin, self.offered = None, np.zeros((0, 3)), np.zeros((0, 3))
        if palm is not None:
            hand = target_object(TargetSpec("hand", "hand", palm))
            objects += (replace(hand, mass=0.6, surface=75e3, hold=500.0),)
            T = inverse(BASE) @ palm
            self.skin, self.palm = _hand(T) + T[:3, 3], T[:3, 3]
            errors = replace(Errors(arm=0.0), hidden_near=0.5)
            self.eyes = make_eyes(SETUP, errors, np.random.default_rng(1))
            self.eyes.normal, self.eyes.along = T[:3, 2], -T[:3, 0]
            self.eyes.marked = False
        spec = replace(
            spec, cameras=(), stereo=(), objects=objects, arm=replace(spec.arm, kinematic_error=0.0)
        )
        self.world, self.has_item = SimulatedWorld(spec, 0), item
        self.width = None
        self.item = self.place()

    def place(self):
        """(3,) where the item is, in base."""
        if not self.has_item:
            return np.full(3, np.nan)
        return (inverse(BASE) @ self.world._pose("item"))[:3, 3]

    def snapshot_at(self, stamp):
        empty = super().snapshot_at(stamp)
        if not hasattr(self, "world") or not self.has_item:
            return empty
        points = np.concatenate([plate((0.04, 0.04), 0.05, np.eye(3), self.place()), self.offered])
        index = np.unique(self.grid.index(points), axis=0)
        points = self.grid.center(index)
        away = np.linalg.norm(points[:, None] - sphere_centers(self.robot, self.q)[None], axis=2)
        seen = ((away - self.robot.spheres.radius).min(axis=1) > OWN) & np.isfinite(points).all(1)
        hazards = np.asarray(points[seen], np.float32)
        return replace(
            empty, hazards=hazards, hazard_unknown=np.zeros(len(hazards), bool), cloud=hazards
        )

    def drive(self, until):
        sent = self.commands[-1]
        if sent[-1]:
            self.world.arm.stop()
        else:
            self.world.arm.command_velocity(sent[:-1])
        self.world.advance(until)
        state = self.world.arm.read()
        if state is not None:
            self.q, self.v = state.position, state.velocity
        self.now = until
        self.guard.feel(list(iter(self.world.wrench.read, None)))

    def round(self, task, gripper):
        """One round of a task; the newest state of the gripper."""
        gripper = self.world.gripper.read() or gripper
        status = self.log[-1] if self.log else None
        joints = JointState(self.now, self.q.copy(), self.v.copy())
        seen = ()
        if self.eyes is not None and task.fetch.done:  # the palm comes once it is fetched
            self.offered = self.skin
            self.eyes.expose(self.now, self.q, lambda _: self.palm)
            seen = self.eyes.arrived(self.now)
        wish = task.update(
            Observation(self.now, self.robot, joints, status, gripper=gripper, perceived=seen)
        )
        width = getattr(wish, "width", None)
        if width is not None and width != self.width:
            self.width = width
            self.world.gripper.move(width)
        self.tick(goal=wish)
        return gripper


def run(cell, task, seconds, until):
    gripper = None
    while cell.now < seconds and not until():
        gripper = cell.round(task, gripper)
    return gripper


def test_the_item_is_taken_from_its_place_held_and_lifted():
    cell, task = ItemCell(), make_task(SETUP, "ours", dock="hand")
    task.fetch = fetching()
    task.reset()
    began = cell.place()
    try:
        gripper = run(cell, task, 25.0, lambda: task.fetch.done)
        assert task.fetch.phase == "held", task.fetch.words
        for _ in range(60):  # it waits for a palm, with the item
            gripper = cell.round(task, gripper)
        up = task.config.vertical
        assert (cell.place() - began) @ up > 0.9 * ABOVE
        assert gripper.holding
        assert 0.035 < gripper.width < 0.045
        assert {c.owner for c in cell.world.truth.contacts} == {"item"}
        assert task.phase == "wait"
        assert not task.failed
    finally:
        cell.world.close()


def test_what_was_fetched_is_let_go_above_the_palm():
    """By contact alone: the fingers carry it and let go. It falls past the simulated palm, which
    holds nothing, down to the bench: what counts is beside what of the palm it fell."""
    palm = from_rpy((0.0, 0.0, np.pi), (0.80, 0.0, 1.08))
    cell, task = ItemCell(palm=palm), make_task(SETUP, "ours", dock="hand")
    task.fetch = fetching()
    task.reset()
    try:
        run(cell, task, 30.0, lambda: task.phase == "done")
        assert task.face().reason == "the item has been handed over", (
            task.phase, task.fetch.words, cell.log[-1].reason, str(cell.log[-1].permit),
        )  # fmt: skip
        away = BASE[:3, :3] @ (cell.place() - cell.palm)
        assert np.linalg.norm(away[:2]) < 0.03
        assert {c.owner for c in cell.world.truth.contacts} == {"item"}
    finally:
        cell.world.close()


def test_where_nothing_lies_it_is_tried_twice_and_said():
    cell, task = ItemCell(item=False), make_task(SETUP, "ours", dock="hand")
    task.fetch = fetching()
    task.reset()
    try:
        run(cell, task, 40.0, lambda: task.phase == "done")
        assert task.failed.startswith("no item where items lie: the gripper closed on nothing")
        assert task.face().reason == task.failed
        assert isinstance(task.update(Observation(cell.now, cell.robot)), Rest)
        assert not cell.world.truth.contacts
    finally:
        cell.world.close()


def told(fetch, seconds, gripper, reached="", permit=None, joints=None):
    """Rounds of an arm that is where it was sent; its gripper says the same all the time."""
    intents = []
    for k in range(round(seconds / 0.008)):
        now = told.now + 0.008 * k
        word = SimpleNamespace(
            goal=reached, reached=bool(reached), reason="somebody is near", permit=permit
        )
        at = JointState(now, SETUP.robot.home if joints is None else joints, np.zeros(6))
        state = None if gripper is None else replace(gripper, stamp=now)
        intents.append(fetch.update(Observation(now, SETUP.robot, at, word, gripper=state)))
    told.now = now + 0.008
    return intents


told.now = 1.0
OPEN = GripperState(0.0, OPENING, False, False)


def at_the_item(fetch):
    (*_, down) = told(fetch, 0.1, OPEN, "above the items")
    told(fetch, 0.1, OPEN, "the item")
    return down


def test_it_comes_down_straight_with_open_fingers_and_a_permit_for_the_item():
    fetch = fetching()
    (above, *_) = told(fetch, 0.05, OPEN)
    down = at_the_item(fetch)
    assert isinstance(above, PoseIntent)
    assert isinstance(down, PoseIntent)
    assert above.width == down.width == OPENING
    item = BASE @ above.permit.region.T_base_region
    assert np.allclose(item[:3, 3], SETUP.workcell.items.position, atol=1e-9)
    assert (np.array(above.permit.region.size) > SETUP.workcell.items.size).all()
    T = BASE @ above.T_base_tcp
    assert np.allclose(T[:3, 2], (0.0, 0.0, -1.0), atol=1e-9)
    assert np.allclose(T[:2, 3], SETUP.workcell.items.position[:2], atol=1e-9)
    assert T[2, 3] == pytest.approx(SETUP.workcell.items.position[2] + ABOVE, abs=0.01)


@pytest.mark.parametrize(
    ("width", "holding", "words"),
    [
        (OPENING, False, "did not close on the item: 85 mm; it is jammed"),
        (0.070, True, "did not close on the item: 70 mm"),
    ],
)
def test_a_gripper_that_does_not_close_on_the_item_is_said_after_a_while(width, holding, words):
    fetch = fetching()
    at_the_item(fetch)
    assert fetch.phase == "grip"
    told(fetch, JAMMED - 0.2, GripperState(0.0, width, False, holding))
    assert not fetch.done
    told(fetch, 0.4, GripperState(0.0, width, False, holding))
    assert fetch.phase == "failed"
    assert words in fetch.words


def test_fingers_come_softly_and_are_on_the_item_only_when_told_to_come_closer():
    """At their own speed they struck the wrist with 4 N, which was taken for a press."""
    fetch = fetching()
    at_the_item(fetch)
    intents = told(fetch, CLOSES + 0.05, GripperState(0.0, 0.052, False, True))
    widths = np.array([wish.width for wish in intents])
    wide = max(SETUP.workcell.items.size[:2])
    assert widths[0] == pytest.approx(SOFTLY * wide)
    assert (np.diff(widths) >= -SLOWLY * 0.008 - 1e-12).all()
    assert fetch.phase == "grip", "they stand where they were told to"
    told(fetch, 0.7, GripperState(0.0, 0.040, False, True))
    assert fetch.phase == "up"


def test_a_permit_that_was_withdrawn_on_the_way_is_asked_for_anew():
    """Braking above the item was felt as a press: the item, no longer permitted, was in the way,
    and the arm stood above it until it gave up."""
    fetch = fetching()
    told(fetch, 0.1, OPEN, "above the items")
    assert fetch.phase == "down"
    ended = SimpleNamespace(state=PermitState.WITHDRAWN, holds=False)
    asked = [goal.permit is not None for goal in told(fetch, 0.04, OPEN, permit=ended)]
    assert asked == [False, True, False, True, False], "a round without it, then anew"
    holds = SimpleNamespace(state=PermitState.GRANTED, holds=True)
    assert all(goal.permit is not None for goal in told(fetch, 0.04, OPEN, permit=holds))


def test_an_item_that_is_left_does_not_come_along():
    """Its region had gone along with the fingers: out of that nothing ever came."""
    fetch = fetching()
    at_the_item(fetch)
    told(fetch, CLOSES + 1.0, GripperState(0.0, 0.040, False, True))
    (wish, *_) = told(fetch, 0.1, GripperState(0.0, 0.040, False, True))
    assert np.allclose(wish.permit.out, wish.permit.region.T_base_region[:3, 2])
    place = np.array(wish.permit.region.T_base_region)
    withdrawn = SimpleNamespace(state=PermitState.WITHDRAWN)
    raised = SETUP.robot.home + np.array([0.0, -0.1, 0.0, 0.0, 0.0, 0.0])
    (*_, left) = told(fetch, 0.1, GripperState(0.0, 0.040, False, True), "", withdrawn, raised)
    np.testing.assert_allclose(left.permit.region.T_base_region, place)
    np.testing.assert_array_equal(left.permit.region.velocity, 0.0)
    (*_, again) = told(fetch, 0.1, GripperState(0.0, 0.040, False, True), "", None, raised)
    assert not np.allclose(again.permit.region.T_base_region, place, atol=0.01)


def test_what_slips_while_it_is_lifted_is_said():
    fetch = fetching()
    at_the_item(fetch)
    (*_, wish) = told(fetch, CLOSES + 0.7, GripperState(0.0, 0.040, False, True))
    assert fetch.phase == "up"
    assert wish.width == 0.0
    told(fetch, 0.05, GripperState(0.0, 0.002, False, False))
    assert fetch.phase == "failed"
    assert "slipped" in fetch.words


def test_a_way_that_is_not_free_and_a_gripper_that_is_dumb_are_said():
    fetch = fetching()
    told(fetch, 30.2, OPEN)
    assert fetch.words == "could not come to where items lie: somebody is near"
    fetch = fetching()
    told(fetch, 0.1, None, "above the items")
    told(fetch, 0.1, None, "the item")
    told(fetch, CLOSES + 0.1, None)
    assert "no gripper says" in fetch.words


def test_what_a_cell_lacks_for_fetching_is_said():
    bare = SETUP.workcell.model_copy(update={"items": None})
    with pytest.raises(UsageError, match=r"add \[items\]"):
        fetch_in(bare, OPENING, BASE)
    with pytest.raises(UsageError, match="do not go into a gripper that opens to 30 mm"):
        fetch_in(SETUP.workcell, 0.03, BASE)
    with (
        open_cell(load("ur10_servoing"), seed=0) as cell,
        pytest.raises(UsageError, match="fetch goes with a hand"),
    ):
        ServoOptions(fetch=True).make(cell)
    with open_cell(load(CELL), seed=0) as cell:
        assert ServoOptions("hand", fetch=True).make(cell).fetch is not None
        assert ServoOptions("hand").make(cell).fetch is None
