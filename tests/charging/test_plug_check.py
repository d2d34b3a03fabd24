"""A plug that is exchanged without a word is noticed before it goes anywhere."""

import numpy as np
import pytest

from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.journal import Journal
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import Seen, State, StationOptions
from armsight.devices.camera_models import stereo_pair
from armsight.devices.data import JointState, Wrench
from armsight.experiments.station_bench import StationBench, charging_cell, make_station
from armsight.geometry.pose import from_rpy, inverse, make_pose
from armsight.mapping.snapshot import FREE, VoxelGrid, WorkspaceSnapshot
from armsight.motion.data import GuardMode
from armsight.robots.kinematics import flange_pose
from armsight.tasks.plug_places import PlugPlaces
from armsight.workcell import robot_in

WEIGHT = 31.0
NOBODY = np.zeros((0, 3), np.float32)


T_PORT = make_pose(from_rpy((np.pi / 2, 0.0, -np.pi / 2))[:3, :3], (0.92, 0.05, 0.45))


def places(cell, snapshot=None):
    """Where the plug is shown; nothing is in the way unless a map says so."""
    pair = next(p for p in cell.stereo if p.name == "post")
    T = inverse(cell.robot.T_world_base) @ pair.T_mount_camera
    found = PlugPlaces(robot_in(cell), stereo_pair(pair.model), T, cell.plug.kind)
    found.snapshot = snapshot or empty_map()
    return found


def empty_map(hazards=NOBODY, sequence=0):
    """A box in which all is seen to be free, but for hazards."""
    grid = VoxelGrid(np.array([-1.5, -1.5, -1.0]), 0.1, (30, 30, 30))
    state = np.full(grid.shape, FREE, np.uint8)
    far = np.full(grid.shape, 1.0, np.float32)
    never = np.full(grid.shape, -np.inf)
    unseen, nothing = np.zeros(len(hazards), bool), np.empty((0, 3), np.float32)
    return WorkspaceSnapshot(
        sequence, 0.0, 0.0, grid, state, far, 1.0, never, hazards, 0.02, unseen, nothing, ()
    )


class Hand:
    """A station whose arm is at once where it wants to be, with a sensor and looks as told."""

    def __init__(self, shows=1):
        cell = charging_cell()
        self.robot = robot_in(cell)
        options = StationOptions(cable=WEIGHT - 9.81 * self.robot.tool.mass)
        some = places(cell)()[:shows] if shows is not None else None
        self.station = Station(
            self.robot, self.robot.home, SimulatedCar(), Journal(None), options, shows=lambda: some
        )
        self.q, self.now, self.looks = self.robot.home, 0.0, ()
        self.hangs, self.aside = WEIGHT, 0.0
        self.goal = ""

    def rest(self, seconds, wrench=True, arrives=True):
        for _ in range(round(seconds / 0.008)):
            self.now += 0.008
            shake = 0.01 * np.sin(1e3 * self.now)
            R = flange_pose(self.robot, self.q)[:3, :3]
            force = R.T @ [self.aside, 0.0, -self.hangs - shake]
            felt = Wrench(self.now, force, np.zeros(3)) if wrench else None
            joints = JointState(self.now, self.q, np.zeros(6))
            guard = Guard(self.goal, arrives)
            wish = self.station.step(Seen(self.now, joints, felt, guard, self.looks))
            position = getattr(wish.intent, "position", None)
            self.goal = getattr(wish.intent, "name", "")
            if position is not None and arrives:
                self.q = position
        return wish

    def visit(self, **rests):
        """Somebody wants a visit, and post sees the port."""
        self.station.begin()
        self.rest(1.0)
        assert self.station.state is State.FIND
        seen = (SeenPort("type2", 0.9, T_PORT, np.eye(6) * 1e-8, False),)
        self.looks = (PortLook(self.now, "post", seen, np.zeros((4, 4, 3), np.uint8)),)
        self.rest(0.05, **rests)

    def shown(self, port, off=(0.0, 0.0, 0.0), turned=0.0, score=0.9):
        """A look at the plug that is shown, so far from where it is believed."""
        self.rest(0.7)
        assert self.station.shown is not None
        T = self.station.shown @ from_rpy((0.0, 0.0, turned)) @ make_pose(None, off)
        seen = (SeenPort(port, score, T, np.eye(6) * 1e-8, False),)
        self.looks = (PortLook(self.now, "post", seen, np.zeros((4, 4, 3), np.uint8)),)


class Guard:
    """A guard that lets everything go where it wants."""

    def __init__(self, goal, reached):
        self.goal, self.reached, self.reason = goal, reached, ""
        self.mode, self.permit = GuardMode.PREDICTIVE, None


def exchanged(hand, weight=WEIGHT, **rests):
    """Somebody takes the plug off and puts one on, while the arm stands by; then a visit."""
    hand.rest(2.0)
    hand.hangs = 0.0
    hand.rest(1.0)
    hand.hangs = weight
    hand.rest(1.0)
    hand.visit(**rests)


def test_a_plug_that_nobody_took_off_is_not_shown():
    """A knock, somebody who brushes the cable or holds it up, a sensor that drifts."""
    hand = Hand()
    hand.rest(2.0)
    for hangs, aside, seconds in (
        (5.0, 0.0, 0.1),
        (WEIGHT, 40.0, 2.0),
        (WEIGHT - 15.0, 0.0, 3.0),
        (WEIGHT + 6.0, 5.0, 2.0),
    ):
        hand.hangs, hand.aside = hangs, aside
        hand.rest(seconds)
    hand.aside = 0.0
    hand.visit()
    assert hand.station.state is State.APPROACH
    assert hand.station.outcome.warning == ""


def test_a_plug_that_was_taken_off_is_shown_and_believed_again_where_it_is_the_same():
    """Not before the port was found: the arm does not move beside a car that nobody explains."""
    hand = Hand()
    exchanged(hand)
    assert hand.station.state is State.SHOW
    assert "the plug was off at the stand-by (0 N instead of 31)" in hand.station.words
    hand.shown("type2_plug", (0.004, 0.0, 0.003))
    hand.rest(0.016)
    assert hand.station.state is State.APPROACH
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
        hand.rest(0.1)
    assert len(hand.station.outcomes) == 2
    # What a calibration would mend is told apart from what it would only hide.
    assert (hand.station.check.elsewhere == "") == (look["port"] == "type1_plug")
    hand.station.check.believe()
    assert hand.station.check.elsewhere == ""


def unclear(hand):
    for _ in range(4):
        hand.shown("type2_plug", score=0.6)  # too little to tell
        hand.rest(0.016)


def test_a_plug_that_nobody_can_look_at_is_used_and_that_is_said():
    """A doubt ends no visit: no place, none that can be reached in time, nothing to be seen."""
    hand = Hand()
    exchanged(hand)
    unclear(hand)
    assert hand.station.state is State.APPROACH
    assert "not looked at (the plug was off at the stand-by" in hand.station.outcome.warning
    assert "post: it is not seen clearly" in hand.station.outcome.warning
    none = Hand(shows=0)
    exchanged(none)
    assert none.station.state is State.APPROACH
    assert "no other place before it can be reached" in none.station.outcome.warning
    held = Hand(shows=3)
    exchanged(held, arrives=False)
    assert held.station.state is State.SHOW
    held.rest(20.0, arrives=False)
    assert held.station.state is State.APPROACH
    assert "not there after 20 s (on the way)" in held.station.outcome.warning
    unexplained = Hand(shows=None)
    exchanged(unexplained)
    assert unexplained.station.state is State.SHOW
    unexplained.rest(20.0)
    assert unexplained.station.state is State.APPROACH
    assert "the map does not count the car" in unexplained.station.outcome.warning
    assert unexplained.station.check.doubt  # the next visit tries again


def test_one_that_pulls_otherwise_since_is_not_used_unseen_but_the_next_visit_tries_again():
    hand = Hand()
    exchanged(hand, weight=25.0)
    unclear(hand)
    assert hand.station.state is State.STAND_BY
    assert "pulls otherwise since (25 N, 31 before)" in hand.station.outcomes[-1].problem
    hand.rest(2.0)
    hand.visit()
    assert hand.station.state is State.SHOW
    hand.shown("type2_plug")
    hand.rest(0.016)
    assert hand.station.state is State.APPROACH


def test_who_asked_for_a_look_gets_one_or_no_visit_but_may_say_that_it_is_the_right_one():
    hand = Hand()
    hand.station.check.ask()
    hand.rest(2.0)
    hand.visit()
    unclear(hand)
    assert "asked to look at the plug" in hand.station.outcomes[-1].problem
    assert "the next visit tries again" in hand.station.outcomes[-1].problem
    hand.rest(2.0)
    hand.station.check.believe()
    hand.visit()
    assert hand.station.state is State.APPROACH


def test_a_sensor_that_was_cut_off_asks_for_a_look_too():
    hand = Hand()
    hand.rest(2.0)
    hand.rest(1.5, wrench=False)
    hand.rest(1.0)
    hand.visit()
    assert hand.station.state is State.SHOW
    assert "silent" in hand.station.words


def test_places_where_the_guard_keeps_the_arm_away_are_not_gone_to():
    """An unexplained car 0.22 m beside the stand-by, as it once was: none is free of it."""
    cell = charging_cell()
    found = places(cell)
    free = found()
    assert len(free) == 3
    near = np.asarray([[0.3, 0.3, 0.5]], np.float32)
    found.snapshot = empty_map(near, 1)
    assert found() == ()
    found.snapshot = None
    assert found() is None


@pytest.mark.parametrize("there", ["type2", "type1"])
def test_the_standing_pair_tells_which_plug_the_arm_shows(gl, there):
    """Rendered and searched: the right one at the first look, a Type 1 by its name."""
    cell = charging_cell()
    bench = StationBench(parked_for(cell, there), 3, rendered=True)
    bench.workcell = cell  # what the station believes
    station = make_station(bench, None, SimulatedCar())
    station._shows = places(cell)
    station.check.ask()
    station.begin()
    with bench.world:
        while station.state in (State.STAND_BY, State.FIND, State.SHOW) and station.busy:
            assert bench.now < 30.0
            bench.step(station)
        touched = bench.peaks.axial
    assert touched == 0.0
    if there == "type2":
        assert station.state is State.LOOK
    else:
        assert "is a type1_plug: a type2_plug is expected" in station.outcomes[-1].problem


def parked_for(cell, plug):
    """A cell with another plug in its hand, and the car of the first one."""
    other = charging_cell(plug)
    return other.model_copy(update={"simulation": cell.simulation})
