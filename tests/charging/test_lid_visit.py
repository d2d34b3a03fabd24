"""A lid in the visit: found in pictures, opened before and shut after, under a permit."""

import json
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from test_station import OPTIONS, Stub

from armsight.charging.journal import Journal
from armsight.charging.lid import R_LID_FINGER, LidHand, LidOptions
from armsight.charging.lid_eye import LidLook
from armsight.charging.lid_find import find_lid, fit_lid
from armsight.charging.lid_finger import OUT, LidSetup
from armsight.charging.permission import LID_BOX
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.vehicle_file import LidShape, load_vehicle
from armsight.charging.visit import State
from armsight.devices.camera_models import stereo_pair
from armsight.experiments.station_bench import StationBench, make_station
from armsight.geometry.pose import exp, from_rpy, inverse, log, make_pose, transform
from armsight.mapping.snapshot import Declared
from armsight.motion.data import GuardMode
from armsight.motion.ik import solve_ik
from armsight.motion.intents import PoseIntent, Rest, VelocityIntent
from armsight.motion.permits import Permit, PermitState
from armsight.tasks.parked_car import ParkedCarOnMap
from armsight.workcell import robot_in
from armsight.workcell.car import finger_pose
from armsight.workcell.packaged import load

CAR = load_vehicle("hatchback_lid")
LEFT_LID = make_pose(np.diag([1.0, -1.0, -1.0]), [0.02, -0.05, 1.55]) @ from_rpy(
    (np.deg2rad(-6.0), np.deg2rad(-27.0), np.deg2rad(1.0))
)


def painted(T_left_lid, lid=True, seed=0, model="converging_pair"):
    """The pair's pictures of a lid, painted polygon by polygon: nothing of the renderer's."""
    pair = stereo_pair(model)
    rng = np.random.default_rng(seed)
    out = []
    for lens, T in ((pair.left, np.eye(4)), (pair.right, inverse(pair.T_left_right))):
        image = np.full((lens.height, lens.width), 62.0)
        for x0, x1, half, level in ((-0.079, 0.12, 0.079, 18.0), (-0.075, 0.075, 0.075, 66.0)):
            along = np.linspace(-1.0, 1.0, 30)
            xs, ys = 0.5 * (x0 + x1) + 0.5 * (x1 - x0) * along, half * along
            sides = [
                np.column_stack([xs, np.full(30, -half)]),
                np.column_stack([np.full(30, x1), ys]),
                np.column_stack([xs[::-1], np.full(30, half)]),
                np.column_stack([np.full(30, x0), ys[::-1]]),
            ]
            border = np.column_stack([np.concatenate(sides), np.zeros(120)])
            pixels = lens.project(transform(T @ T_left_lid, border))
            if lid:
                at = np.round(16 * pixels).astype(np.int32)
                cv2.fillPoly(image, [at], level, cv2.LINE_AA, 4)
        image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0.0, 1.2, image.shape)
        out.append(np.clip(image, 0, 255).astype(np.uint8))
    return tuple(out), pair


def test_a_painted_lid_is_found_where_it_was_painted_and_a_plain_side_holds_none():
    images, pair = painted(LEFT_LID)
    found = find_lid(images, pair, CAR.lid)
    away = log(inverse(LEFT_LID) @ found.T_left_lid)
    assert np.abs(away[:3]).max() < 0.005  # the gap is 3 px wide: either of its edges may be taken
    assert np.rad2deg(np.abs(away[3:])).max() < 1.0
    assert found.score > 0.8
    assert find_lid(painted(LEFT_LID, lid=False)[0], pair, CAR.lid) is None


def hidden(image, lens, T_lens_lid, corners):
    """The picture with the body's plain paint over a part of the lid's plane."""
    at = lens.project(transform(T_lens_lid, np.column_stack([np.array(corners), np.zeros(4)])))
    mask = cv2.fillPoly(np.zeros_like(image), [np.round(at).astype(np.int32)], 255)
    noise = np.random.default_rng(1).normal(62.0, 1.2, image.shape)
    return np.where(mask > 0, np.clip(noise, 0, 255).astype(np.uint8), image)


def strip(x0, x1, y0, y1):
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


@pytest.mark.parametrize(
    ("unseen", "in_both"),
    [
        pytest.param(strip(-0.09, -0.065, -0.08, 0.08), False, id="the-gap-at-the-hinge-in-one"),
        pytest.param(strip(0.04, 0.08, 0.06, 0.09), True, id="a-quarter-of-the-upper-gap"),
    ],
)
def test_a_lid_is_found_though_a_part_of_its_gap_does_not_show(unseen, in_both):
    """On a flank seen askew the gap is lost in the hinge's corner, or in a reflection."""
    images, pair = painted(LEFT_LID)
    left = hidden(images[0], pair.left, LEFT_LID, unseen)
    right = images[1]
    if in_both:
        right = hidden(right, pair.right, inverse(pair.T_left_right) @ LEFT_LID, unseen)
    found = find_lid((left, right), pair, CAR.lid)
    away = log(inverse(LEFT_LID) @ found.T_left_lid)
    assert np.abs(away[:3]).max() < 0.005
    assert np.rad2deg(np.abs(away[3:])).max() < 1.5


def test_a_frame_of_another_size_is_no_lid():
    """A number plate, a window: seen farther off by the two pictures than a lid of its looks is."""
    (left, right), pair = painted(LEFT_LID)
    moved = cv2.warpAffine(left, np.array([[1.0, 0, 40], [0, 1, 0]]), left.shape[::-1])
    assert find_lid((moved, right), pair, CAR.lid) is None


def test_from_about_where_it_is_the_near_look_needs_no_search():
    near = make_pose(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 0.40]) @ from_rpy((0.3, 0.1, 0.0))
    images, pair = painted(near, model="flange_pair")
    start = near @ exp(np.array([0.003, -0.003, 0.004, 0.01, -0.01, 0.01]))
    away = log(inverse(near) @ fit_lid(images, pair, start).T_left_lid)
    assert np.abs(away[:2]).max() < 0.0005
    assert abs(away[2]) < 0.0015
    assert np.rad2deg(np.abs(away[3:])).max() < 0.5
    assert fit_lid(images, pair, near @ make_pose(None, [0.15, 0.0, 0.0])) is None


@pytest.mark.parametrize(
    ("hinge", "free"),
    [("left", [1, 0, 0]), ("right", [-1, 0, 0]), ("top", [0, -1, 0]), ("bottom", [0, 1, 0])],
)
def test_a_lid_is_turned_so_that_its_hinge_is_where_the_file_says(hinge, free):
    """And it stands open on that side, its free edge away from the car."""
    car = CAR.model_copy(update={"lid": LidShape(latch="push", hinge=hinge, opens_deg=90.0)})
    np.testing.assert_allclose(car.T_port_lid[:3, :3] @ [1.0, 0, 0], free, atol=1e-12)
    assert car.T_port_lid[2, 3] == pytest.approx(0.030)
    leaf = car.open_lid
    middle = leaf.T_frame_solid[:3, 3]
    assert middle @ free == pytest.approx(-0.075, abs=0.006)
    assert middle[2] == pytest.approx(0.030 + 0.075, abs=0.006)


class LidStub(Stub):
    """A station with a finger, its robot put where it wants to be."""

    def __init__(self, journal=None):
        cell = load("ur10_charging_lid")
        robot = robot_in(cell)
        near = next(p.T_mount_camera for p in cell.stereo if p.mounted_on == "flange")
        setup = LidSetup(CAR, finger_pose(cell.plug), 0.15)
        self.car = SimulatedCar()
        station = Station(robot, robot.home, self.car, Journal(journal), OPTIONS, near, lid=setup)
        super().__init__(cell, station)
        T_base_port = inverse(cell.robot.T_world_base) @ cell.simulation.car.pose
        self.T_base_lid = T_base_port @ CAR.T_port_lid
        self.lids, self.drawn_back = (), 0.15
        self.guard = SimpleNamespace(
            permit=None, reason="", reached=False, goal="", mode=GuardMode.VELOCITY
        )

    def step(self, seconds=0.008, wrench=True):
        inner = self.station.step
        self.station.step = lambda seen: inner(
            replace(seen, lids=self.lids, drawn_back=self.drawn_back)
        )
        try:
            wish = super().step(seconds, wrench)
        finally:
            self.station.step = inner
        intent = wish.intent
        self.drawn_back = self.drawn_back if intent.width is None else intent.width
        if intent.permit is not None:
            state = PermitState.GRANTED
            self.guard.permit = Permit(intent.permit.name, "thing", state)
        if isinstance(intent, PoseIntent):
            self.guard.goal, self.guard.reached = intent.name, True
        if self.station.state is State.LID_ALIGN:
            T_tip = self.station.finger.before() @ inverse(self.station.feeling.T_flange_plug)
            T_tip = T_tip @ self.robot.tool.T_flange_tcp
            self.q = solve_ik(self.robot, T_tip, self.q, np.random.default_rng(0))[0]
        return wish

    def see(self, pair, T=None):
        picture = np.zeros((4, 4, 3), np.uint8)
        T = self.T_base_lid if T is None else T
        self.lids = (LidLook(self.now, pair, T, np.diag([1e-6] * 6), 0.9, picture),)

    def to(self, state):
        """On the way of a visit until it is in a state."""
        self.station.begin()
        for _ in range(12):
            if self.station.state is state:
                self.lids = ()
                return self
            self.rest(0.7)
            self.see("flange" if self.station.state is State.LID_LOOK else "post")
        raise AssertionError(f"still in {self.station.state}: {self.station.words}")


def test_a_shut_lid_is_looked_at_from_near_and_touched_with_leave_and_a_finger_that_is_out():
    stub = LidStub().to(State.LID_LOOK)
    permission = stub.station.permission
    assert stub.drawn_back == 0.15
    stub.to(State.LID_WORK)
    assert stub.drawn_back == 0.0
    region = permission.ask(stub.now, None).region
    np.testing.assert_allclose(region.size, LID_BOX[1] - LID_BOX[0])
    middle = inverse(stub.T_base_lid) @ region.T_base_region
    np.testing.assert_allclose(middle[:3, 3], LID_BOX.mean(axis=0), atol=1e-6)
    assert stub.station.outcome.port == "type2"
    wish = stub.rest(0.2)
    assert isinstance(wish.intent, VelocityIntent)
    assert wish.intent.bound
    assert wish.intent.permit.name.startswith("lid")


def test_nothing_touches_the_lid_without_leave_or_before_the_finger_is_out():
    stub = LidStub().to(State.LID_TARE)
    stub.step = lambda *a, **k: Stub.step(stub, *a, **k)  # the finger does not come
    stub.rest(2.0)
    assert stub.station.state is State.LID_TARE
    assert "finger" in stub.station.words
    stub.guard.permit = replace(stub.guard.permit, state=PermitState.REFUSED, reason="somebody")
    wish = stub.rest(1.0)
    assert "somebody" in stub.station.words
    assert isinstance(wish.intent, Rest)


def test_a_lid_that_is_not_seen_from_near_and_one_out_of_reach_end_the_visit_in_words():
    stub = LidStub().to(State.LID_LOOK)
    for _ in range(8):
        stub.rest(0.7)
        stub.see("flange", T=None)
        stub.lids = (replace(stub.lids[0], T_base_lid=None),)
    assert "not seen from near" in stub.station.outcomes[-1].problem
    stub = LidStub()
    stub.station.begin()
    stub.rest(0.7)
    stub.see("post", stub.T_base_lid @ make_pose(None, [0.0, 0.0, -0.9]))
    stub.rest(0.1)
    assert "out of reach" in stub.station.outcomes[-1].problem


def test_a_permit_that_is_lost_at_the_lid_brings_the_finger_away_from_it():
    stub = LidStub().to(State.LID_WORK)
    stub.step = lambda *a, **k: Stub.step(stub, *a, **k)
    stub.guard.permit = replace(stub.guard.permit, state=PermitState.WITHDRAWN, reason="a hand")
    stub.rest(0.02)
    assert stub.station.state is State.HELD
    stub.guard.permit = None
    wish = stub.rest(2.0)
    assert stub.station.state is State.LID_AWAY
    assert wish.intent.width == 0.0
    assert stub.station.outcome.problem == "a hand"


def test_a_dead_force_sensor_at_the_lid_is_somebodys_to_help_and_a_car_that_moves_is_left():
    stub = LidStub().to(State.LID_WORK)
    stub.rest(0.7, wrench=False)
    assert stub.station.state is State.STUCK
    assert "the finger is at the lid" in stub.station.words
    stub = LidStub().to(State.LID_WORK)
    stub.car.parked = False
    stub.rest(0.1)
    assert stub.station.state is State.LID_AWAY


def test_a_finger_that_does_not_come_away_from_an_open_lid_is_somebodys_to_help():
    """What kept it there was not said, and the arm set out for the second look with it."""
    hand = LidHand(LidOptions("push"))
    hand._find_shut, hand._unlatch, hand._lead = (_done,) * 3
    hand._against = lambda *a: _done(True)
    hand._plan = hand._open()
    held = make_pose(R_LID_FINGER, [0.02, 0.0, 0.10])
    wrench = np.array([30.0, 0.0, 30.0, 0.0, 0.0, 0.0])  # against the way out
    for i in range(50):
        hand.step(0.008 * i, held, wrench)
    assert hand.ended
    assert hand.problem == ""
    assert hand.caught == "something is in the way"
    stub = LidStub().to(State.LID_WORK)
    stub.station.finger.hand = hand
    stub.rest(0.1)
    assert stub.station.state is State.STUCK
    assert "coming away from the lid: something is in the way; help by hand" in stub.station.words


def _done(*result):
    """A plan that ends at once."""
    yield from ()
    return result[0] if result and result[0] is True else ""


def test_what_was_opened_is_shut_whatever_came_of_the_visit():
    stub = LidStub().to(State.LID_WORK)
    stub.station._lid_worked(SimpleNamespace(now=stub.now), "")
    assert stub.station.state is State.LOOK
    assert stub.station.lid_open
    stub.station._fail(SimpleNamespace(now=stub.now), "second look: its roll cannot be told")
    assert stub.station.state is State.LID_BEFORE
    assert stub.station.finger.shutting
    stub.station._go(State.LID_WORK, stub.now)
    assert not stub.station.lid_open
    stub.station._lid_worked(SimpleNamespace(now=stub.now), "")
    last = stub.station.outcomes[-1]
    assert (last.lid_opened, last.lid_shut) == (True, True)
    assert last.problem == "second look: its roll cannot be told"


def test_a_station_that_was_killed_at_the_lid_comes_away_and_says_so(tmp_path):
    file = tmp_path / "journal.json"
    LidStub(file).to(State.LID_WORK)
    assert Journal(file).read().at_lid
    again = LidStub(file)
    again.rest(0.1)
    assert again.station.state is State.LID_AWAY
    assert again.drawn_back == 0.0
    np.testing.assert_allclose(again.station.finger.T_base_lid, again.T_base_lid, atol=1e-9)


def test_an_open_lid_is_said_to_the_map_beside_the_car_and_again_where_the_arm_was_in_the_way():
    body = ParkedCarOnMap(CAR, np.eye(4))
    T_port = make_pose(None, [0.9, 0.0, 0.45])
    body.found(T_port, np.zeros((6, 6)))
    body.lid(T_port)
    car, lid = body.standing
    np.testing.assert_allclose(
        body.standing[lid][0].T_frame_solid, T_port @ CAR.open_lid.T_frame_solid
    )
    taken = Declared(car, (), taken=True)
    refused = Declared(lid, (), reason="refused: the arm itself is there")
    said = body.told(SimpleNamespace(declared=(taken, refused)))
    assert said == "the open lid: refused: the arm itself is there"
    body.lid(T_port)
    first, second = body.standing
    assert (first, second != lid) == (car, True)
    body.lid(None)
    assert list(body.standing) == [car]


def test_what_is_kept_of_a_lid_and_its_finger_puts_them_where_they_stood():
    """A push latch that has just let go lets go, and a finger that is out stays out."""
    bench, other = (StationBench(load("ur10_charging_lid"), seed=s) for s in (3, 4))
    bench.world.gripper.move(0.0)
    bench.world.advance(2.5)
    bench.world.lid.latch = (False, True)
    bench.world.advance(bench.now + 0.5)
    open_by = bench.world.lid.angle
    assert open_by > 0.1
    other.world.memory.put(json.loads(json.dumps(bench.world.memory.take())))
    other.world.advance(other.now + 0.3)
    assert not other.world.lid.shut
    assert other.world.lid.angle == pytest.approx(open_by, abs=0.05)
    assert other.world.gripper.read().width < OUT


@pytest.mark.slow  # a whole visit: a hundred simulated seconds of contact physics
def test_a_visit_opens_the_lid_plugs_in_comes_out_and_shuts_it():
    bench = StationBench(load("ur10_charging_lid"), seed=3)
    bench.world.advance(0.5)
    places = [{m.name: m.T_world_solid for m in bench.world.movers()}]
    bench.world.gripper.move(0.0)
    bench.world.advance(2.5)
    places.append({m.name: m.T_world_solid for m in bench.world.movers()})
    way = (places[1]["lid finger"] - places[0]["lid finger"])[:3, 3]
    assert np.linalg.norm(way) == pytest.approx(0.15, abs=0.003)
    assert bench.world.gripper.read().width < OUT
    assert bench.world.lid.shut
    station = make_station(bench, None, SimulatedCar(seconds=1.0))
    station.begin()
    assert bench.run(station, 150.0)
    outcome = station.outcomes[-1]
    assert outcome.problem == ""
    assert (outcome.lid_opened, outcome.seated, outcome.out, outcome.lid_shut) == (True,) * 4
    assert bench.world.lid.shut
    assert bench.score()[0] < -0.05
