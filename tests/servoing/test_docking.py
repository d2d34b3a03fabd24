"""What is asked of the guard for each of V's targets, and the phases of a hand-over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import GripperState, JointState
from armsight.motion.intents import Rest, VelocityIntent
from armsight.motion.permits import LIMITS, request_fault
from armsight.motion.task import Observation
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import tcp_pose
from armsight.servoing.approach import Funnel
from armsight.servoing.docking import DOCK_NAMES, Touchable, docking
from armsight.servoing.modes import ChaseConfig, make_chase
from armsight.tasks.handover import LETS_GO, WAITS, HandoverTask

from .test_laws import FRONT, HOME, UP, look

UR10 = load_robot("ur10").with_tool(load_tool("gripper"))


@pytest.mark.parametrize("name", DOCK_NAMES)
def test_every_docking_asks_for_what_may_be_granted(name):
    dock = docking(name)
    normal = -FRONT if name != "hand" else UP
    seen = Touchable(1.0, np.array([0.8, 0.1, 0.7]), np.zeros(3), 1e-6 * np.eye(3), normal=normal)
    request = dock.request(seen, normal, UP, FRONT)
    limits = LIMITS[dock.permit]
    assert request_fault(request, UR10, 1.1) == ""
    assert request.region.extent <= limits.extent
    assert request.force <= limits.force
    assert request.speed <= limits.speed
    # The target's own point is in its region, or on its border.
    assert request.region.distance(seen.position[None], 1.0)[0] < 0.01


def test_the_region_of_a_face_holds_the_box_behind_the_mouth():
    """24 x 24 x 12 cm, the mouth 45 mm below its middle; corners to the map's own margin."""
    dock, mouth = docking("straw"), np.array([0.8, 0.0, 0.7])
    seen = Touchable(1.0, mouth, np.zeros(3), np.zeros((3, 3)), normal=-FRONT)
    region = dock.request(seen, -FRONT, UP, FRONT).region
    side = np.cross(UP, FRONT)
    for a in (-0.12, 0.12):
        for b in (-0.12, 0.12):
            for c in (0.0, 0.12):
                corner = mouth + a * side + (0.045 + b) * UP + c * FRONT
                assert region.distance(corner[None], 1.0)[0] < 0.017


class Arm:
    """Stands where it is put; sees a palm where it is."""

    def __init__(self):
        config = ChaseConfig(UP, FRONT, 0.0, direction="down", funnel=Funnel(0.07))
        chase = make_chase("ours", UR10, ("a",), "", config)
        self.task = HandoverTask(docking("hand"), "ours", chase, [], config)
        self.now = 0.0
        self.tip = tcp_pose(UR10, HOME)[:3, 3]

    def stay(self, palm, seconds, gripper=None):
        """The last intent after some time with the palm at a place, the gripper's (width, holding)
        as given."""
        intent = None
        for _ in range(round(seconds / 0.02)):
            self.now += 0.02
            self.task.chase.see(look("a", (1.7, 1.4, -0.1), palm, self.now))
            joints = JointState(self.now, HOME.copy(), np.zeros(6))
            state = (
                None if gripper is None else GripperState(self.now, gripper[0], False, gripper[1])
            )
            intent = self.task.update(Observation(self.now, UR10, joints, gripper=state))
        return intent


def test_the_item_is_let_go_only_above_the_palm():
    arm = Arm()
    beside = arm.tip - WAITS * UP + 0.05 * FRONT
    arm.stay(beside, 2.0)
    assert arm.task.phase == "wait"
    arm.task.chase.reset()
    arm.stay(arm.tip - WAITS * UP, 1.0)
    assert arm.task.phase == "lower"
    assert arm.task.chase.config.funnel.gap == LETS_GO
    intent = arm.stay(arm.tip - LETS_GO * UP, 0.6)
    assert arm.task.phase in ("let go", "leave")
    assert arm.task.released < arm.now
    assert isinstance(intent, VelocityIntent)
    assert intent.width == HandoverTask.opening


def test_a_jammed_gripper_is_not_waited_for_on_somebody_s_palm():
    """It leaves with the item and says so; one that opens late is given the time."""
    for late, says in (((0.04, True), "did not open: 40 mm"), ((0.085, False), "handed over")):
        arm = Arm()
        arm.stay(arm.tip - WAITS * UP, 1.0, (0.04, True))
        arm.task.chase.reset()
        palm = arm.tip - LETS_GO * UP
        arm.stay(palm, 1.2, (0.04, True))
        assert arm.task.phase == "let go"
        leaving = arm.stay(palm, 1.3, late)
        assert arm.task.phase == "leave"
        # One that comes free on the way lets nothing fall.
        assert leaving.width == (late[0] if late[1] else HandoverTask.opening)
        intent = arm.stay(palm, 2.2, late)
        assert isinstance(intent, Rest)
        assert says in intent.reason
        assert says in arm.task.face().reason


def test_an_empty_gripper_hands_nothing_over_and_says_no_such_thing():
    for gripper, says in (((0.085, False), "did not feel"), (None, "no gripper says")):
        arm = Arm()
        arm.stay(arm.tip - WAITS * UP, 1.0, gripper)
        arm.task.chase.reset()
        intent = arm.stay(arm.tip - LETS_GO * UP, 4.0, gripper)
        assert arm.task.phase == "done"
        assert says in intent.reason


def test_an_item_that_slips_is_brought_to_nobody():
    arm = Arm()
    arm.stay(arm.tip - WAITS * UP + 0.05 * FRONT, 0.5, (0.04, True))
    intent = arm.stay(arm.tip - WAITS * UP + 0.05 * FRONT, 0.1, (0.0, False))
    assert isinstance(intent, Rest)
    assert "slipped" in intent.reason
    assert arm.task.released == np.inf


def test_a_palm_that_goes_on_is_waited_for_again():
    arm = Arm()
    arm.stay(arm.tip - WAITS * UP, 1.0)
    assert arm.task.phase == "lower"
    arm.task.chase.reset()
    arm.stay(arm.tip - WAITS * UP + 0.2 * FRONT, 0.1)
    assert arm.task.phase == "wait"
    assert arm.task.released == np.inf


def swung(arm, seconds, speed):
    """The last intent while a palm swings about below the tip, and the greatest of its speed."""
    begin, intent = arm.now, None
    width = 0.1
    while arm.now < begin + seconds:
        turn = speed / width * (arm.now - begin)
        palm = arm.tip - (WAITS + 0.1) * UP + width * np.sin(turn) * np.cross(UP, FRONT)
        intent = arm.stay(palm, 0.02)
    return intent


def test_nobody_comes_to_a_hand_that_swings_before_it_has_been_calm():
    """Recorded hands at 1.5 to 3 m/s ran into an arm that had come near in their pauses."""
    arm = Arm()
    intent = swung(arm, 1.0, 1.5)
    assert arm.task.restless
    assert isinstance(intent, Rest)
    assert "waits for a calm palm" in intent.reason
    assert intent.reason == arm.task.face().reason
    still = arm.tip - (WAITS + 0.1) * UP
    pause = arm.stay(still, 0.5)
    assert isinstance(pause, Rest), "it may only have paused"
    calm = arm.stay(still, 2.0)
    assert isinstance(calm, VelocityIntent)
    assert calm.permit is not None


def test_an_item_that_slips_while_a_swung_hand_is_waited_for_ends_it_too():
    arm = Arm()
    arm.stay(arm.tip - (WAITS + 0.1) * UP, 0.5, (0.04, True))
    swung(arm, 0.6, 1.5)
    assert arm.task.restless
    intent = arm.stay(arm.tip - (WAITS + 0.1) * UP, 0.1, (0.0, False))
    assert isinstance(intent, Rest)
    assert "slipped" in intent.reason


def test_a_palm_that_wanders_is_come_to_at_once_and_one_that_starts_is_left():
    arm = Arm()
    assert swung(arm, 1.0, 0.2).permit is not None
    assert not arm.task.restless
    arm.task.chase.reset()
    arm.stay(arm.tip - WAITS * UP, 1.0)
    assert arm.task.phase == "lower"
    assert isinstance(swung(arm, 0.5, 1.5), Rest)
    assert arm.task.phase == "wait"


def test_the_region_of_a_hand_lies_along_its_forearm_where_that_was_seen():
    """A forearm of 27 cm turned by 40 deg from the person's side is in it to its end; the region
    along the person's side leaves it out, and with it the arm could not come near."""
    aside = np.cos(0.7) * FRONT + np.sin(0.7) * np.cross(UP, FRONT)
    seen = Touchable(0.0, np.array([0.8, 0.0, 0.8]), np.zeros(3), np.eye(3) * 1e-6, along=aside)
    end = (seen.position + 0.267 * aside)[None]
    lies = docking("hand").request(seen, UP, UP, FRONT).region
    unseen = docking("hand").request(replace(seen, along=None), UP, UP, FRONT).region
    assert lies.distance(end, 0.0)[0] < 0.0 < unseen.distance(end, 0.0)[0]
    points = seen.position + np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 3))
    inside = points[lies.distance(points, 0.0) < 0.0]
    reach = np.abs(inside - lies.center(0.0)).max(axis=0)
    assert (reach <= lies.half_box() + 1e-9).all()
    assert (reach > lies.half_box() - 0.06).all()
