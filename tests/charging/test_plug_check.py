"""A plug that is exchanged without a word is noticed before it goes anywhere."""

import numpy as np
import pytest

from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.journal import Journal
from armsight.charging.plug_views import show_places
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import Seen, State, StationOptions
from armsight.devices.camera_models import stereo_pair
from armsight.devices.data import JointState, Wrench
from armsight.experiments.station_bench import StationBench, charging_cell, make_station
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.motion.data import GuardMode
from armsight.robots.kinematics import flange_pose
from armsight.workcell import robot_in

WEIGHT = 31.0


def places(cell):
    pair = next(p for p in cell.stereo if p.name == "post")
    T = inverse(cell.robot.T_world_base) @ pair.T_mount_camera
    return show_places(robot_in(cell), stereo_pair(pair.model), T, cell.plug.kind)


class Hand:
    """A station whose arm is at once where it wants to be, with a sensor and looks as told."""

    def __init__(self, shows=1):
        cell = charging_cell()
        self.robot = robot_in(cell)
        options = StationOptions(cable=WEIGHT - 9.81 * self.robot.tool.mass)
        some = places(cell)[:shows]
        self.station = Station(
            self.robot, self.robot.home, SimulatedCar(), Journal(None), options, shows=some
        )
        self.q, self.now, self.hangs, self.looks = self.robot.home, 0.0, WEIGHT, ()
        self.goal = ""

    def rest(self, seconds, wrench=True, arrives=True):
        for _ in range(round(seconds / 0.008)):
            self.now += 0.008
            shake = 0.01 * np.sin(1e3 * self.now)
            R = flange_pose(self.robot, self.q)[:3, :3]
            force = R.T @ [0.0, 0.0, -self.hangs - shake]
            felt = Wrench(self.now, force, np.zeros(3)) if wrench else None
            joints = JointState(self.now, self.q, np.zeros(6))
            guard = Guard(self.goal, arrives)
            wish = self.station.step(Seen(self.now, joints, felt, guard, self.looks))
            position = getattr(wish.intent, "position", None)
            self.goal = getattr(wish.intent, "name", "")
            if position is not None and arrives:
                self.q = position
        return wish

    def shown(self, port, off=(0.0, 0.0, 0.0), turned=0.0, score=0.9):
        """A look at the plug that is shown, so far from where it is believed."""
        assert self.station.shown is not None
        T = self.station.shown @ from_rpy((0.0, 0.0, turned)) @ make_pose(None, off)
        seen = (SeenPort(port, score, T, np.eye(6) * 1e-8, False),)
        self.looks = (PortLook(self.now, "post", seen, np.zeros((4, 4, 3), np.uint8)),)


class Guard:
    """A guard that lets everything go where it wants."""

    def __init__(self, goal, reached):
        self.goal, self.reached, self.reason = goal, reached, ""
        self.mode, self.permit = GuardMode.PREDICTIVE, None


def exchanged(hand, **rests):
    """Somebody takes the plug off and puts one on, while the arm stands by; then a visit."""
    hand.rest(2.0)
    hand.hangs = 0.0
    hand.rest(1.0)
    hand.hangs = WEIGHT
    hand.rest(1.0)
    hand.station.begin()
    hand.rest(2.0, **rests)


def test_a_plug_that_nobody_had_hold_of_is_not_shown():
    hand = Hand()
    hand.rest(2.0)
    hand.hangs = 5.0
    hand.rest(0.1)  # a knock
    hand.hangs = WEIGHT + 6.0  # a cable that swings, a sensor that drifts
    hand.rest(2.0)
    hand.station.begin()
    hand.rest(0.1)
    assert hand.station.state is State.FIND


def test_a_plug_that_was_taken_off_is_shown_and_believed_again_where_it_is_the_same():
    hand = Hand()
    exchanged(hand)
    assert hand.station.state is State.SHOW
    assert "somebody had hold of the plug at the stand-by (0 N instead of 31)" in hand.station.words
    hand.shown("type2_plug", (0.004, 0.0, 0.003))
    hand.rest(0.1)
    assert hand.station.state is State.FIND
    assert hand.station.check.doubt == ""
    assert hand.station.shown is None


@pytest.mark.parametrize(
    ("look", "words"),
    [
        ({"port": "type1_plug"}, "the plug in the hand is a type1_plug: a type2_plug is expected"),
        ({"port": "type2_plug", "off": (0.0, 0.02, 0.0)}, "the plug's tip is 20 mm and 0 deg from"),
        ({"port": "type2_plug", "turned": 0.3}, "the plug's tip is 0 mm and 17 deg from"),
    ],
)
def test_another_plug_of_like_weight_ends_the_visit_before_it_begins(look, words):
    """Also the next one: it is still another plug."""
    hand = Hand()
    for _ in range(2):
        exchanged(hand)
        hand.shown(**look)
        hand.rest(0.1)
        assert hand.station.state is State.STAND_BY
        assert words in hand.station.outcomes[-1].problem
    assert len(hand.station.outcomes) == 2


def test_a_plug_that_is_not_seen_or_cannot_be_shown_is_not_used():
    hand = Hand()
    exchanged(hand)
    for _ in range(4):
        hand.shown("type2_plug", score=0.6)  # too little to tell
        hand.rest(0.1)
    assert "post does not see it clearly" in hand.station.outcomes[-1].problem
    none = Hand(shows=0)
    exchanged(none)
    assert "cannot be shown to post" in none.station.outcomes[-1].problem
    held = Hand(shows=2)
    exchanged(held, arrives=False)
    assert held.station.state is State.SHOW
    held.rest(60.0, arrives=False)  # half the patience of each of both places
    assert "cannot be shown to post" in held.station.outcomes[-1].problem


def test_a_sensor_that_was_cut_off_asks_for_a_look_too():
    hand = Hand()
    hand.rest(2.0)
    hand.rest(1.5, wrench=False)
    hand.rest(1.0)
    hand.station.begin()
    hand.rest(0.1)
    assert hand.station.state is State.SHOW
    assert "silent" in hand.station.words


@pytest.mark.parametrize("there", ["type2", "type1"])
def test_the_standing_pair_tells_which_plug_the_arm_shows(gl, there):
    """Rendered and searched: the right one at the first look, a Type 1 by its name."""
    cell = charging_cell()
    bench = StationBench(charging_cell(there), 3, rendered=True)
    bench.workcell = cell  # what the station believes
    station = make_station(bench, None, SimulatedCar())
    station._shows = places(cell)
    station.check.doubt = "asked"
    station.begin()
    with bench.world:
        while station.state in (State.STAND_BY, State.SHOW) and station.busy:
            assert bench.now < 20.0
            bench.step(station)
        touched = bench.peaks.axial
    assert touched == 0.0
    if there == "type2":
        assert station.state is State.FIND
    else:
        assert "is a type1_plug: a type2_plug is expected" in station.outcomes[-1].problem
