"""The station in contact physics: whole visits, killed and started again, and what it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.charging.admittance import Admittance
from armsight.charging.eye import PortLook, SeenPort
from armsight.charging.insert import Answer, InsertOptions, Phase
from armsight.charging.journal import Entry, Journal, JournalError
from armsight.charging.looking import Looker
from armsight.charging.moves import before_port
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar, VehicleStatus
from armsight.charging.visit import Seen, State, StationOptions, Wish
from armsight.devices.data import JointState, Wrench
from armsight.experiments.station_bench import Peaks, StationBench, charging_cell
from armsight.geometry.pose import inverse, make_pose
from armsight.motion.data import GuardMode
from armsight.motion.ik import solve_ik
from armsight.motion.intents import JointIntent, Rest, VelocityIntent
from armsight.motion.permits import Permit, PermitState
from armsight.robots.kinematics import flange_pose
from armsight.workcell import robot_in

OPTIONS = StationOptions(
    insert=InsertOptions(admittance=Admittance((5000.0, 30.0), 0.074), port_depth=0.002)
)
PLUG_DEPTH = 0.035


@pytest.fixture(scope="module")
def cell():
    return charging_cell()


def station(cell, file=None, car=None, **options):
    robot = robot_in(cell)
    near = next(p.T_mount_camera for p in cell.stereo if p.mounted_on == "flange")
    car = car or SimulatedCar(seconds=1.0)
    return Station(robot, robot.home, car, Journal(file), replace(OPTIONS, **options), near)


def until(bench, station, done, seconds=40.0):
    end = bench.now + seconds
    while not done():
        assert bench.now < end, f"still in {station.state}: {station.words}"
        bench.step(station)


def test_it_plugs_in_and_comes_out_and_knows_after_a_kill_where_the_plug_is(cell, tmp_path):
    """Forty simulated seconds of contact physics: the one test of the whole chain."""
    file = tmp_path / "journal.json"
    bench, car = StationBench(cell, seed=1), SimulatedCar(seconds=1.0)
    first = station(cell, file, car)
    first.begin()
    until(bench, first, lambda: first.state is State.INSERT and bench.score()[0] > 0.012)
    assert file.exists()
    again = station(cell, file, car)  # killed half-way in
    until(bench, again, lambda: not again.busy)
    assert bench.score()[0] < -0.05
    assert not file.exists()
    assert again.outcomes[-1].out
    assert not again.outcomes[-1].seated
    again.begin()
    until(bench, again, lambda: again.state is State.CHARGE)
    depth, tilt = bench.score()
    assert depth > PLUG_DEPTH - 1e-3
    assert np.rad2deg(tilt) < 2.0
    third = station(cell, file, car)  # killed while it charges
    until(bench, third, lambda: third.state is State.LEAVE)
    assert third.outcome.charged
    assert third.outcome.out
    assert bench.score()[0] > -0.05
    assert file.exists()  # before the port nobody else knows that there is a car
    fourth = station(cell, file, car)  # killed 3 cm before the face
    until(bench, fourth, lambda: fourth.state is State.LEAVE)
    until(bench, fourth, lambda: fourth.state is State.STAND_BY)
    assert bench.score()[0] < -0.05
    assert bench.peaks.axial < 125.0


@pytest.mark.parametrize(
    ("jump", "words"),
    [((0.0, 0.0, 60.0), "mm deeper than its seat"), ((0.0, -50.0, -60.0), "plugging in: ")],
)
def test_a_sensor_that_jumps_in_the_socket_is_noticed_and_the_plug_comes_out(cell, jump, words):
    """The law would press with 85 N and what the sensor does not say."""
    bench, law = StationBench(cell, seed=3), replace(OPTIONS.insert, tries=1)
    it = station(cell, car=SimulatedCar(seconds=1.0), tries=1, insert=law)
    it.begin()
    until(bench, it, lambda: it.state is State.INSERT and bench.score()[0] > 0.012)
    bench.bias[:3] = jump
    until(bench, it, lambda: not it.busy, 90.0)
    assert words in it.outcomes[-1].problem
    assert it.outcomes[-1].out
    assert not it.outcomes[-1].seated
    assert bench.score()[0] < -0.05
    assert max(bench.peaks.axial, bench.peaks.lateral) < 125.0


def test_a_plug_goes_along_with_a_car_that_moves_while_it_charges(cell, tmp_path):
    """Pushed by 2 cm at 3 cm/s, across the port's axis and along it: a stiff arm feels 120 N."""
    file = tmp_path / "journal.json"
    bench, car = StationBench(cell, seed=1), SimulatedCar(seconds=18.0)
    it = station(cell, file, car)
    it.begin()
    until(bench, it, lambda: it.state is State.CHARGE)
    believed, before, seated = it.port.T_base_port, bench.T_base_port, bench.now
    until(bench, it, lambda: bench.now > seated + 2.5)
    for way in ((0, -20, 0), (0, 0, 20), (0, 0, -20), (0, 20, 0), (20, 0, 0)):
        bench.peaks = Peaks()
        stood, began = bench.world.car.T_world_socket, bench.now
        while bench.now < began + 3.0:
            share = min((bench.now - began) / 0.67, 1.0)
            bench.world.car.park(stood @ make_pose(None, 1e-3 * share * np.array(way, float)))
            bench.step(it)
        assert bench.peaks.lateral < 50.0
        assert bench.peaks.axial < 80.0
        went = bench.T_base_port[:3, 3] - before[:3, 3]
        followed = it.port.T_base_port[:3, 3] - believed[:3, 3]
        assert np.linalg.norm(followed - went) < 0.004, way
    np.testing.assert_allclose(Journal(file).read().T_base_port, it.port.T_base_port, atol=1e-6)
    until(bench, it, lambda: not it.busy)
    assert it.outcomes[-1].out
    assert it.outcomes[-1].problem == ""
    assert bench.score()[0] < -0.05


def test_a_cable_that_is_caught_while_it_goes_in_is_a_jam_and_the_plug_comes_out(cell):
    bench, law = StationBench(cell, seed=3), replace(OPTIONS.insert, tries=1)
    it = station(cell, car=SimulatedCar(seconds=1.0), tries=1, insert=law)
    it.begin()
    until(bench, it, lambda: it.state is State.INSERT and bench.score()[0] > 0.005)
    bench.catch_cable(slack=0.005)
    until(bench, it, lambda: not it.busy, 90.0)
    assert "jammed" in it.outcomes[-1].problem
    assert it.outcomes[-1].out
    assert not it.outcomes[-1].seated
    assert bench.score()[0] < -0.05
    assert max(bench.peaks.axial, bench.peaks.lateral) < 125.0


class Stub:
    """A robot that stands where it is put; the station's logic without physics."""

    def __init__(self, cell, station):
        self.robot, self.station = robot_in(cell), station
        self.q = station._stand_by_joints.copy()
        self.now, self.guard, self.looks = 0.0, None, ()
        self.hangs, self.noise = 16.0, 0.01  # [N]

    def step(self, seconds=0.008, wrench=True):
        self.now += seconds
        n = len(self.q)
        joints = JointState(self.now, self.q, np.zeros(n))
        shakes = self.noise * np.sin(1e3 * self.now)
        force = np.array([0.0, -self.hangs - shakes, 0.0])
        felt = Wrench(self.now, force, np.zeros(3)) if wrench else None
        return self.station.step(Seen(self.now, joints, felt, self.guard, self.looks))

    def rest(self, seconds, **kw):
        for _ in range(round(seconds / 0.008)):
            wish = self.step(**kw)
        return wish


def seen_port(cell, name="type2", score=0.9, away=0.0, doubtful=False):
    T = np.asarray(inverse(cell.robot.T_world_base) @ cell.simulation.car.pose)
    T = T @ make_pose(None, [0, 0, -away])
    return SeenPort(name, score, T, np.diag([1e-6] * 3 + [1e-4] * 3), doubtful)


@pytest.mark.parametrize(
    ("ports", "words"),
    [
        (lambda cell: (), "no port"),
        (lambda cell: (seen_port(cell, "type1"),), "the port is type1: the type2_plug does not"),
        (lambda cell: (seen_port(cell, score=0.4),), "no port that is clear enough"),
        (
            lambda cell: (seen_port(cell, score=0.4), seen_port(cell, "type1", 0.6)),
            "looks most like type1 (score 0.60), and there the type2_plug does not fit",
        ),
        (
            lambda cell: (seen_port(cell, score=0.45), seen_port(cell, "type1", 0.42)),
            "no port that is clear enough",
        ),
        (lambda cell: (seen_port(cell, away=0.8),), "out of reach"),
    ],
)
def test_what_it_finds_decides_and_is_said(cell, ports, words):
    stub = Stub(cell, station(cell))
    stub.station.begin()
    for _ in range(6):
        stub.rest(0.7)
        if not stub.station.busy:
            break
        stub.looks = (PortLook(stub.now, "post", ports(cell), np.zeros((4, 4, 3), np.uint8)),)
    assert not stub.station.busy
    assert words in stub.station.outcomes[-1].problem


def test_half_of_a_ccs2_is_not_told_as_another_type(cell):
    looker = Looker(replace(OPTIONS, plug="ccs2_plug"))
    for score, words in ((0.6, "no port that is clear enough"), (0.8, "the port is type2")):
        look = PortLook(0.0, "post", (seen_port(cell, "type2", score),), np.zeros((4, 4, 3)))
        assert looker.why_none(look).startswith(words)
        assert "looks most like" not in looker.why_none(look)


def test_a_look_from_before_the_arm_rested_is_not_taken(cell):
    stub = Stub(cell, station(cell))
    stub.station.begin()
    port = (seen_port(cell),)
    stub.looks = (PortLook(-1.0, "post", port, np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(1.0)
    assert stub.station.state is State.FIND
    stub.looks = (PortLook(stub.now, "post", port, np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(0.1)
    assert stub.station.state is State.LOOK


def test_how_sure_a_place_is_counts_what_arm_and_pair_add_to_the_look(cell):
    """The page showed what the look says of itself, 0.03 mm."""
    stub = Stub(cell, station(cell))
    assert (stub.station.port_covariance == 0.0).all()
    port = replace(seen_port(cell), covariance=1e-10 * np.eye(6))
    stub.station._found(SimpleNamespace(now=0.0), port, 0.0, stub.station.options.near_sigma)
    sigma = np.sqrt(np.diag(stub.station.port_covariance))
    assert sigma[:3] == pytest.approx(stub.station.options.near_sigma, rel=1e-3)
    assert sigma[3:] == pytest.approx(1e-5)


def before(stub, cell, distance):
    """Puts the arm where its plug is so far before the port, with leave to touch it."""
    port = seen_port(cell)
    T = before_port(port.T_base_port, distance)
    stub.q = solve_ik(stub.robot, T, stub.q, np.random.default_rng(0))[0]
    stub.station.port = port
    stub.station.permission.see(port, stub.now, 0.002)
    permit = stub.station.permission.ask(stub.now, None)
    granted = Permit(permit.name, "thing", PermitState.GRANTED)
    stub.guard = SimpleNamespace(
        permit=granted, reason="", reached=False, goal="", mode=GuardMode.VELOCITY
    )


def stub_in(cell, state=None, distance=0.015, file=None, wrench=True, **options):
    """A stub whose plug is so far before the port, its station in a state [m]."""
    stub = Stub(cell, station(cell, file, **options))
    stub.rest(0.1, wrench=wrench)
    before(stub, cell, distance)
    if state is State.INSERT:  # it tares first
        stub.station._go(State.TARE, stub.now)
        stub.rest(1.0)
        assert stub.station.state is State.INSERT
    elif state is not None:
        stub.station._go(state, stub.now)
    return stub


def test_nothing_goes_in_that_could_not_be_written_down(cell, tmp_path):
    (tmp_path / "no").write_text("a file where the folder should be")
    stub = stub_in(cell, State.TARE, file=tmp_path / "no" / "journal.json")
    stub.rest(1.0)
    assert stub.station.state is State.LEAVE
    assert "does not plug in" in stub.station.outcome.problem


def test_the_way_home_is_on_disk_before_the_arm_leaves_its_stand_by(cell, tmp_path):
    """Killed on its way to the port it did not know of the car, and the guard held it there."""
    file = tmp_path / "journal.json"
    stub = Stub(cell, station(cell, file))
    stub.station.begin()
    stub.rest(0.7)
    assert not file.exists()
    ports = (seen_port(cell),)
    stub.looks = (PortLook(stub.now, "post", ports, np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(0.1)
    assert stub.station.state is State.LOOK
    again = Stub(cell, station(cell, file))
    before(again, cell, 0.40)
    again.station.port = None
    wish = again.rest(60.0)
    assert isinstance(wish.intent, JointIntent)
    assert again.station.port is not None
    assert again.station.busy
    assert "is not back at its stand-by" in again.station.words
    assert file.exists()
    again.q = again.station._stand_by_joints.copy()
    again.rest(0.1)
    assert not again.station.busy
    assert not file.exists()
    assert again.station.outcomes[-1].problem == "was stopped with the plug out of the car"
    assert again.station.words == "was stopped with the plug out of the car"  # it is back


def test_a_plug_that_was_never_near_and_stands_as_if_in_the_car_is_somebodys_to_look_at(
    cell, tmp_path
):
    file = tmp_path / "journal.json"
    port = seen_port(cell)
    T = robot_in(cell).tool.T_flange_tcp
    Journal(file).write(Entry("type2", "type2_plug", port.T_base_port, port.covariance, T))
    stub = Stub(cell, station(cell, file))
    before(stub, cell, -0.02)
    stub.rest(0.1)
    assert stub.station.state is State.STUCK
    assert "look at the plug" in stub.station.words


def test_the_way_back_is_on_disk_before_the_plug_goes_near(cell, tmp_path):
    """Killed 16 mm before the face it goes back along the axis first."""
    file = tmp_path / "journal.json"
    stub = stub_in(cell, State.APPROACH, distance=0.10, file=file)
    assert not file.exists()
    stub.guard.reached, stub.guard.goal = True, f"approach {stub.station._goals}"
    stub.rest(0.6)
    assert stub.station.state is State.ALIGN
    assert Journal(file).read().plugged is False
    again = Stub(cell, station(cell, file))
    before(again, cell, 0.016)
    again.rest(0.1)
    assert again.station.state is State.LEAVE
    assert again.station.words == "was stopped before the port"


def test_nothing_goes_in_without_a_force_sensor_or_leave_to_touch(cell):
    stub = stub_in(cell, State.TARE, wrench=False)
    stub.rest(1.0, wrench=False)
    assert "nobody would feel" in stub.station.outcome.problem
    stub = stub_in(cell, State.TARE)
    stub.guard.permit = replace(stub.guard.permit, state=PermitState.REFUSED, reason="somebody")
    wish = stub.rest(2.0)
    assert stub.station.state is State.TARE
    assert isinstance(wish.intent, Rest)
    assert "somebody" in stub.station.words


def test_a_permit_that_is_lost_in_contact_lets_go_and_comes_out(cell):
    stub = stub_in(cell, State.INSERT)
    stub.guard.permit = replace(stub.guard.permit, state=PermitState.WITHDRAWN, reason="a hand")
    wish = stub.step()
    assert stub.station.state is State.HELD
    assert isinstance(wish.intent, Rest)
    assert wish.intent.permit is None
    stub.guard.permit = None
    wish = stub.rest(2.0)
    assert stub.station.state is State.LEAVE
    assert isinstance(wish.intent, VelocityIntent)
    assert stub.station.outcome.problem == "a hand"


def lose(stub, pressed=40.0, reason="something else is too near"):
    """The guard withdraws the permit; what it had granted."""
    granted = replace(stub.guard.permit, force=125.0, pressed=pressed)
    stub.guard.permit = replace(granted, state=PermitState.WITHDRAWN, reason=reason)
    stub.guard.mode = GuardMode.REFLEX
    wish = stub.step()
    assert isinstance(wish.intent, Rest)
    assert wish.intent.permit is None, "what was withdrawn is asked for anew after a round without"
    stub.guard.permit = replace(granted, state=PermitState.REFUSED, reason=reason)
    return granted


def grant(stub, granted):
    stub.guard.permit, stub.guard.mode = granted, GuardMode.VELOCITY


@pytest.mark.parametrize("distance", [0.010, -0.012])
def test_who_comes_near_is_waited_for_and_is_no_try(cell, distance):
    """Visits were given up, or began again from the second look, whenever a visitor came."""
    short = replace(OPTIONS.insert, seconds=5.0)
    stub = stub_in(cell, State.INSERT, insert=short, patience=8.0)
    for _ in range(4):
        before(stub, cell, distance)
        granted = lose(stub)
        wish = stub.rest(6.0)
        assert stub.station.words == "waits: something else is too near"
        assert isinstance(wish.intent, Rest)
        assert wish.intent.permit is not None, "it asks again"
        grant(stub, granted)
        wish = stub.rest(0.1)
        assert isinstance(wish.intent, VelocityIntent)
    assert stub.station.state is State.INSERT
    assert stub.station.outcome.problem == ""
    assert stub.station.outcome.tries == 1


def test_a_plug_that_was_led_back_meanwhile_goes_in_anew(cell):
    stub = stub_in(cell, State.INSERT)
    granted = lose(stub)
    before(stub, cell, 0.05)
    lose(stub)
    stub.rest(1.0)
    assert stub.station.state is State.INSERT
    grant(stub, granted)
    stub.step()
    assert stub.station.state is State.ALIGN


def test_a_plug_before_the_port_keeps_to_its_way(cell):
    """The guard let it slide aside, 5 cm, along a visitor; then it sought the port on the flank."""
    stub = stub_in(cell, State.INSERT)
    wish = stub.rest(0.2)
    assert stub.station.answer.depth < 0.0
    assert wish.intent.bound
    aside = make_pose(None, [0.03, 0.0, 0.0])
    port = stub.station.port
    stub.station.port = replace(port, T_base_port=port.T_base_port @ aside)
    stub.step()
    assert stub.station.state is State.LEAVE
    assert stub.station.outcome.problem == "the plug was led aside"


def test_who_stays_for_longer_than_is_waited_ends_the_attempt(cell):
    stub = stub_in(cell, State.INSERT, patience=3.0)
    lose(stub)
    stub.rest(3.5)
    assert stub.station.state is State.LEAVE
    words = "insert: no end after 3 s (waits: something else is too near)"
    assert stub.station.outcome.problem == words


@pytest.mark.parametrize(("pressed", "most"), [(124.0, 10), (0.0, 0)])
def test_who_pressed_too_hard_is_not_waited_for(cell, pressed, most):
    stub = stub_in(cell, State.INSERT, interruptions=most)
    granted = lose(stub, pressed, "why")
    assert stub.station.state is State.HELD
    grant(stub, granted)
    stub.rest(2.0)
    assert stub.station.state is State.LEAVE
    assert stub.station.outcome.problem == "why"


def test_somebody_who_comes_between_is_no_jam(cell):
    """The guard held the arm for a visitor, and the law gave up: no progress."""
    short = replace(OPTIONS.insert, seconds=2.0)
    stub = stub_in(cell, State.INSERT, insert=short)
    stub.rest(0.5)
    stub.guard.mode = GuardMode.STOPPED
    stub.rest(6.0)
    assert stub.station.state is State.INSERT
    stub.guard.mode = GuardMode.VELOCITY
    stub.rest(1.0)
    assert stub.station.state is State.INSERT
    stub.rest(1.0)
    assert stub.station.outcome.problem == "plugging in: gave up after 2 s"


def test_a_force_sensor_that_dies_is_said_and_nothing_is_pulled_by_feel(cell):
    stub = stub_in(cell, State.INSERT)
    stub.rest(0.6, wrench=False)
    assert stub.station.state is State.LEAVE  # not in yet
    assert stub.station.outcome.problem == "the force sensor is silent"
    stub.station._go(State.INSERT, stub.now)
    stub.rest(0.1)
    before(stub, cell, -0.02)
    wish = stub.rest(0.6, wrench=False)
    assert stub.station.state is State.STUCK
    assert "the plug is in the car: mend the sensor" in stub.station.words
    assert wish.intent.fault


def test_a_force_sensor_that_repeats_itself_is_dead(cell):
    """Its stamps went on; the plug was pressed with 246 N by what it had said before."""
    stub = stub_in(cell, State.INSERT)
    stub.noise = 0.0
    wish = stub.rest(0.45)
    assert isinstance(wish.intent, Rest)
    stub.rest(0.3)
    assert stub.station.state is State.LEAVE  # not in yet
    assert stub.station.outcome.problem == "the force sensor repeats itself"
    stub = stub_in(cell, State.INSERT)
    before(stub, cell, -0.02)
    stub.noise = 0.0
    wish = stub.rest(0.8)
    assert stub.station.state is State.STUCK
    assert "repeats itself and the plug is in the car: mend the sensor" in stub.station.words
    assert wish.intent.fault
    stub = Stub(cell, station(cell))
    stub.noise = 0.0
    stub.rest(0.5)
    before(stub, cell, 0.015)
    stub.station._go(State.TARE, stub.now)
    stub.rest(1.0)
    assert "nobody would feel" in stub.station.outcome.problem


def test_a_cable_that_is_caught_on_the_way_stops_the_arm_where_it_is(cell):
    """It was noticed before the port only, if the arm got there: it pulled with 235 N."""
    stub = Stub(cell, station(cell))
    stub.station.begin()
    stub.rest(0.7)
    stub.looks = (PortLook(stub.now, "post", (seen_port(cell),), np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(0.5)
    assert stub.station.state is State.LOOK
    stub.hangs = 60.0  # a swing
    stub.rest(0.5)
    assert stub.station.state is State.LOOK
    stub.hangs = 75.0
    wish = stub.rest(0.05)
    assert stub.station.state is State.STUCK
    assert wish.intent.fault
    problem = stub.station.outcome.problem
    assert "hold the plug in free air, 16 when it set out: is its cable caught?" in problem


def test_a_cable_that_is_caught_on_the_way_home_stops_the_arm_too(cell, tmp_path):
    stub = stub_in(cell, State.LEAVE, distance=0.10, file=tmp_path / "journal.json")
    stub.station._hung = 16.0
    stub.rest(0.1)
    assert stub.station.state is State.STAND_BY
    assert stub.station.busy
    stub.hangs = 75.0
    stub.rest(0.1)
    assert stub.station.state is State.STUCK
    stub = stub_in(cell, State.STAND_BY, distance=0.10)
    stub.station._hung = 16.0
    stub.hangs = 75.0  # nobody is on the way: it may be handled
    stub.rest(0.5)
    assert stub.station.state is State.STAND_BY


def test_a_plug_that_stays_in_the_car_is_said(cell):
    """The mount gave way as it charged: the hand came out alone, and the visit was told as good."""
    stub = stub_in(cell, State.LEAVE, distance=0.10, cable=0.0)
    stub.station.visits.note(seated=True, charged=True)
    stub.hangs = 2.0
    stub.rest(0.5)
    stub.station._go(State.LEAVE, stub.now)
    stub.rest(0.1)
    problem = stub.station.outcomes[-1].problem
    assert "out again, the plug weighs 2 N" in problem
    assert "it is missing" in problem


def test_a_plug_that_was_dropped_on_the_way_is_not_pushed_in(cell):
    stub = stub_in(cell, State.TARE, cable=15.0)  # 31 N are expected, 16 are felt
    stub.rest(1.0)
    assert stub.station.state is State.LEAVE
    assert "the plug weighs 16 N, with its cable 31 are expected" in stub.station.outcome.problem


def test_what_fails_again_and_again_ends(cell):
    """A sensor that could not be tared sent the arm back and forth for ever."""
    stub = stub_in(cell, distance=0.10, tries=3)
    states = []
    for _ in range(3):
        stub.station.visits.blame("the force sensor is silent or noisy")
        stub.station._go(State.LEAVE, stub.now)
        stub.step()
        states.append(stub.station.state)
    assert states == [State.LOOK, State.LOOK, State.STAND_BY]
    assert "silent or noisy" in stub.station.outcomes[-1].problem


def test_a_plug_that_does_not_come_out_is_somebodys_to_help(cell):
    stub = stub_in(cell, distance=-0.03, patience=2.0)
    stub.station._begin_unplug(Seen(stub.now, JointState(stub.now, stub.q, np.zeros(6))))
    stub.station.feeling.tare = np.zeros(6)
    stub.rest(2.5)
    assert stub.station.state is State.STUCK
    assert "unplug: no end after 2 s; help by hand" in stub.station.words


def test_a_port_of_a_car_that_is_not_expected_is_left_alone(cell):
    stub = Stub(cell, station(cell))
    stub.station._contradiction = lambda T: "not the car that is expected: too low"
    stub.station.begin()
    stub.rest(0.7)
    port = (seen_port(cell),)
    stub.looks = (PortLook(stub.now, "post", port, np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(0.1)
    assert not stub.station.busy
    assert stub.station.outcomes[-1].problem == "not the car that is expected: too low"


def test_a_car_that_moves_is_left(cell):
    car = SimulatedCar()
    stub = stub_in(cell, State.ALIGN, distance=0.05, car=car)
    stub.step()
    car.parked = False
    stub.step()
    assert stub.station.state is State.LEAVE
    assert "moves" in stub.station.outcome.problem


class OddCar(SimulatedCar):
    """Says what a test wants it to say."""

    says = None

    def status(self, now):
        return self.says


def test_a_car_that_says_it_has_another_inlet_is_believed(cell):
    stub = Stub(cell, station(cell, car=SimulatedCar("type1")))
    stub.station.begin()
    stub.rest(0.1)
    assert not stub.station.busy
    assert "the car says that it has type1: the type2_plug does not fit" in (
        stub.station.outcomes[-1].problem
    )


def test_a_silent_car_is_waited_for_and_said(cell):
    stub = Stub(cell, station(cell, car=OddCar()))
    stub.station.begin()
    stub.rest(0.5)
    assert stub.station.state is State.STAND_BY
    assert "nothing is heard of the car" in stub.station.words


def test_a_car_that_goes_silent_while_it_charges_leaves_the_end_to_people(cell):
    stub = stub_in(cell, State.CHARGE, distance=-PLUG_DEPTH, car=OddCar())
    stub.rest(0.2)
    assert stub.station.state is State.CHARGE
    assert "end by hand" in stub.station.words
    stub.station.end()
    stub.rest(0.2)
    assert stub.station.state is State.UNPLUG


@pytest.mark.parametrize(
    ("locked", "words"),
    [(True, "unlock it at the car"), (False, "the car says that it still charges")],
)
def test_a_car_that_has_enough_and_does_not_let_go_is_not_pulled_at(cell, locked, words):
    """105 N against a lock would break it; without one the contacts would part under load."""
    car = OddCar()
    car.says = VehicleStatus(parked=True, locked=locked, charging=True, enough=True)
    stub = stub_in(cell, State.CHARGE, distance=-PLUG_DEPTH, car=car, patience=1.0)
    states = set()
    for _ in range(20):
        stub.rest(0.1)
        states.add(stub.station.state)
    assert states == {State.CHARGE, State.STUCK}
    assert words in stub.station.words
    assert words in stub.station.outcome.problem


def test_of_two_ports_the_surer_one_is_taken(cell):
    stub = Stub(cell, station(cell))
    stub.station.begin()
    stub.rest(0.7)
    ports = (seen_port(cell, score=0.7, away=0.1), seen_port(cell, score=0.9))
    stub.looks = (PortLook(stub.now, "post", ports, np.zeros((4, 4, 3), np.uint8)),)
    stub.rest(0.1)
    assert stub.station.state is State.LOOK
    assert stub.station.port is ports[1]


def test_a_journal_of_another_plug_or_a_broken_one_stops_the_station(cell, tmp_path):
    file = tmp_path / "j.json"
    T = seen_port(cell).T_base_port
    Journal(file).write(Entry("type1", "type1_plug", T, np.eye(6), make_pose(None, [0, 0, 0.2])))
    stub = Stub(cell, station(cell, file))
    wish = stub.step()
    assert stub.station.state is State.STUCK
    assert wish.intent.fault
    assert not stub.station.outcome.out  # as far as anybody knows
    assert f"look at the plug, bring the arm out by hand and remove {file}" in stub.station.words
    file.write_text("nonsense")
    with pytest.raises(JournalError, match="look whether"):
        station(cell, file)


def test_a_killed_station_whose_plug_is_out_stands_by(cell, tmp_path):
    file = tmp_path / "j.json"
    port, robot = seen_port(cell), robot_in(cell)
    Journal(file).write(
        Entry("type2", "type2_plug", port.T_base_port, np.eye(6), robot.tool.T_flange_tcp)
    )
    stub = Stub(cell, station(cell, file))
    stub.step()
    assert flange_pose(robot, stub.q)[0, 3] < 0.5  # it stands by
    assert stub.station.state is State.STAND_BY
    assert not file.exists()


@pytest.mark.parametrize("says", [{"locked": True}, {"charging": True}])
def test_a_car_that_holds_or_charges_a_plug_that_is_out_is_not_plugged_in(cell, says):
    car = OddCar()
    stub = stub_in(cell, State.TARE, car=car)
    car.says = VehicleStatus(parked=True, **says)
    stub.rest(1.0)
    assert stub.station.state is State.LEAVE
    assert "and the plug is not in it" in stub.station.outcome.problem


def test_cameras_that_contradict_each_other_are_said_to_be_uncalibrated(cell):
    stub = Stub(cell, station(cell, patience=1000.0))
    stub.station.begin()
    for _ in range(12):
        stub.rest(0.7)
        far = stub.station.state is State.FIND
        port = (seen_port(cell, away=0.0 if far else 0.11),)
        pair = "post" if far else "flange"
        stub.looks = (PortLook(stub.now, pair, port, np.zeros((4, 4, 3), np.uint8)),)
        if not stub.station.busy:
            break
        stub.guard = SimpleNamespace(
            permit=None, reason="", reached=True, mode=GuardMode.VELOCITY,
            goal=f"look {stub.station._goals}",
        )  # fmt: skip
    problem = stub.station.outcomes[-1].problem
    assert "11 cm from where post saw it: calibrate the cameras" in problem


def test_a_pair_that_sends_nothing_ends_the_visit_in_words(cell):
    stub = Stub(cell, station(cell, patience=2.0))
    stub.station.begin()
    stub.rest(2.5)
    problem = stub.station.outcomes[-1].problem
    assert problem == "find: no end after 2 s (waits for pictures of post)"


def test_a_car_that_drives_off_while_it_is_plugged_is_unplugged(cell):
    car = SimulatedCar()
    stub = stub_in(cell, State.CHARGE, distance=-0.03, car=car)
    stub.station.feeling.tare = np.zeros(6)
    car.parked = False
    stub.step()
    assert stub.station.state is State.UNPLUG
    assert "moves" in stub.station.outcome.problem


def test_a_sensor_that_stands_at_its_limit_is_no_plug_and_pushes_nothing(cell):
    """Saturated before the port it is a weight that cannot be; while plugging in the law yields."""
    stub = stub_in(cell, State.INSERT)
    tip = stub.robot.tool.T_flange_tcp[:3, 3]
    pressed = np.array([0.0, -16.0, -300.0])
    for _ in range(60):
        stub.now += 0.008
        joints = JointState(stub.now, stub.q, np.zeros(6))
        shakes = 0.01 * np.sin(1e3 * stub.now)
        wrench = Wrench(stub.now, pressed, np.cross(tip, pressed) + shakes)
        wish = stub.station.step(Seen(stub.now, joints, wrench, stub.guard))
    assert isinstance(wish.intent, VelocityIntent)
    assert wish.intent.velocity[2] < 0.0
    assert "weighs" in stub.station.feeling.not_ours(31.0)


def test_who_is_stuck_keeps_its_leave_while_the_car_holds_the_plug_and_only_then(cell):
    """A permit that nobody renews ends after a minute, and the guard backs out of contact."""
    stub = stub_in(cell, State.STUCK, distance=-0.03)
    permit = stub.rest(2.0).intent.permit
    assert permit.region.exposure == pytest.approx(stub.now)
    stub = stub_in(cell, State.STUCK, distance=0.08)
    assert stub.rest(0.1).intent.permit is None


class ToldCar(OddCar):
    """And keeps what it is told."""

    def __init__(self, **says):
        super().__init__()
        self.says, self.told = VehicleStatus(parked=True, **says), []

    def tell(self, word, now):
        self.told.append(word)


def test_a_sensor_that_dies_while_the_car_holds_what_is_pulled_leaves_the_plug_in_the_car(cell):
    """The mount gives by 20 mm there: by its joints alone the hand was out, and pulled on."""
    stub = stub_in(cell, State.INSERT)
    before(stub, cell, 0.005)
    stub.station._begin_unplug(Seen(stub.now, JointState(stub.now, stub.q, np.zeros(6))))
    stub.rest(0.1, wrench=False)
    stub.station._hand.answer = Answer(np.zeros(6), Phase.PULL, "", 0.015)  # of the last reading
    stub.rest(0.5, wrench=False)
    assert stub.station.state is State.STUCK
    assert "the plug is in the car" in stub.station.words


def test_a_plug_that_comes_out_for_any_reason_is_told_to_the_car_before(cell):
    """A car that drove off, or a port that pressed too hard: it charged while it was pulled at."""
    car = ToldCar(charging=True, locked=True)
    stub = stub_in(cell, State.CHARGE, distance=-PLUG_DEPTH, car=car)
    stub.station.visits.note(seated=True, out=False)
    stub.step()
    car.says = VehicleStatus(parked=False, charging=True, locked=True)
    stub.step()
    assert stub.station.state is State.UNPLUG
    assert car.told == ["stop"]


def test_a_car_that_holds_a_plug_that_was_held_up_is_not_pulled_at(cell):
    car = ToldCar(charging=True, locked=True)
    stub = stub_in(cell, State.HELD, distance=-PLUG_DEPTH, car=car, patience=4.0)
    stub.rest(2.0)
    assert stub.station.state is State.HELD
    assert car.told == ["stop"]
    car.says = VehicleStatus(parked=True)
    stub.rest(0.1)
    assert stub.station.state is State.UNPLUG
    stub = stub_in(cell, State.HELD, distance=-PLUG_DEPTH, car=ToldCar(locked=True), patience=2.0)
    stub.rest(4.0)
    assert stub.station.state is State.STUCK
    assert "unlock it at the car" in stub.station.words


def seats(stub):
    """The law of a stub says that the plug is seated."""
    seated = Answer(np.zeros(6), Phase.SEATED, "seated at 35.0 mm", PLUG_DEPTH)
    stub.station._hand.by_force = lambda *a: (seated, Wish(Rest("")))
    stub.step()
    assert stub.station.state is State.CHARGE


def test_every_visit_tells_the_car_to_stop(cell):
    """One that was told in a visit that ended otherwise was not told in the next, and held on."""
    car = ToldCar()
    stub = stub_in(cell, State.INSERT, car=car)
    stub.station._told = "stop"
    before(stub, cell, -PLUG_DEPTH)
    seats(stub)
    car.says = VehicleStatus(parked=True, locked=True, enough=True)
    stub.rest(0.1)
    assert car.told == ["plugged", "stop"]
    assert stub.station.state is State.CHARGE


def test_a_seat_that_could_not_be_written_down_is_said(cell):
    stub = stub_in(cell, State.INSERT, car=ToldCar())
    stub.station._keep = lambda plugged=False: "j.json: cannot be written: No space left on device"
    seats(stub)
    assert "seated at 35.0 mm; j.json: cannot be written" in stub.station.words


def test_a_car_that_has_enough_while_somebody_is_waited_for_is_told_at_once(cell):
    car = ToldCar(charging=True, locked=True)
    stub = stub_in(cell, State.CHARGE, distance=-PLUG_DEPTH, car=car)
    stub.step()
    lose(stub)
    car.says = VehicleStatus(parked=True, charging=True, problem="too hot")
    wish = stub.rest(0.2)
    assert isinstance(wish.intent, Rest)
    assert stub.station.state is State.CHARGE
    assert car.told == ["stop"]


def test_a_car_that_does_not_charge_is_said(cell):
    car = ToldCar()
    stub = stub_in(cell, State.CHARGE, distance=-PLUG_DEPTH, car=car, patience=2.0)
    stub.rest(2.5)
    assert "the car does not charge" in stub.station.words
    car.says = VehicleStatus(parked=True, charging=True)
    stub.rest(0.1)
    assert stub.station.words == ""


def test_what_is_not_waited_for_any_more_is_not_said(cell):
    stub = Stub(cell, station(cell, car=OddCar()))
    stub.station.begin()
    stub.rest(0.1)
    assert "nothing is heard of the car" in stub.station.words
    stub.station.end()
    stub.rest(0.1)
    assert stub.station.words == ""


def test_a_pair_on_the_flange_that_sends_nothing_is_named(cell):
    stub = stub_in(cell, State.LOOK, distance=0.36, patience=2.0)
    stub.guard.reached, stub.guard.goal = True, f"look {stub.station._goals}"
    stub.rest(2.1)
    problem = stub.station.outcome.problem
    assert problem == "second look: no end after 2 s (waits for pictures of flange)"


def test_a_finger_that_was_left_at_a_lid_is_not_dragged_home_by_a_station_without_one(
    cell, tmp_path
):
    file = tmp_path / "j.json"
    port, T = seen_port(cell), robot_in(cell).tool.T_flange_tcp
    T_lid = port.T_base_port @ make_pose(None, [0.0, 0.0, 0.03])
    left = Entry("type2", "type2_plug", port.T_base_port, port.covariance, T, np.zeros(6))
    Journal(file).write(replace(left, T_base_lid=T_lid, at_lid=True))
    stub = Stub(cell, station(cell, file))
    wish = stub.rest(0.1)
    assert stub.station.state is State.STUCK
    assert isinstance(wish.intent, Rest)
    assert "a finger at a lid, and here is none; look at the finger" in stub.station.words
    assert file.exists()


def test_a_cable_is_noticed_on_the_way_home_of_a_killed_station_too(cell, tmp_path):
    file = tmp_path / "j.json"
    port, T = seen_port(cell), robot_in(cell).tool.T_flange_tcp
    Journal(file).write(Entry("type2", "type2_plug", port.T_base_port, port.covariance, T))
    stub = Stub(cell, station(cell, file))
    before(stub, cell, 0.40)
    stub.station.port = None
    stub.rest(0.5)
    assert stub.station.state is State.STAND_BY
    stub.hangs = 75.0
    stub.rest(0.1)
    assert stub.station.state is State.STUCK
