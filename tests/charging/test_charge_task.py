"""The task about the station: who speaks for the car, what the map is told, which visits count."""

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import numpy as np
import pytest
from test_station import Stub, seen_port, station

from armsight.charging.journal import Entry, Journal
from armsight.charging.vehicle import SimulatedCar, VehicleStatus
from armsight.charging.vehicle_file import load_vehicle
from armsight.charging.visit import Outcome, State
from armsight.commands.charging_runs import told
from armsight.devices.camera_models import stereo_pair
from armsight.devices.data import JointState, Wrench
from armsight.errors import TaskError, UsageError
from armsight.experiments.station_bench import charging_cell
from armsight.tasks import catalogue
from armsight.tasks.charge import ChargeOptions, ChargeTask
from armsight.tasks.parked_car import ParkedCarOnMap
from armsight.tasks.vehicles import GROUP, open_vehicle
from armsight.workcell import parse_workcell, robot_in
from armsight.workcell.packaged import load, packaged

MY_CAR = """
class Car:
    def __init__(self, connection):
        self.at = connection["address"]
    def status(self, now):
        return None
    def tell(self, word, now):
        pass

class Mute(Car):
    tell = None
"""


@pytest.fixture
def my_car(tmp_path, monkeypatch):
    (tmp_path / "my_car.py").write_text(MY_CAR)
    monkeypatch.chdir(tmp_path)
    yield
    sys.modules.pop("my_car", None)


def test_a_car_of_ones_own_speaks_for_itself(my_car):
    text = charging_cell().text
    own = text.replace("[plug]", '[plug]\ncar = "my_car:Car"\nconnection = { address = "can0" }')
    cell = SimpleNamespace(workcell=parse_workcell(own), world=None)
    car = ChargeOptions().speaker(cell)
    assert car.at == "can0"
    assert isinstance(ChargeOptions().speaker(replace_workcell(text)), SimulatedCar)


def replace_workcell(text):
    return SimpleNamespace(workcell=parse_workcell(text), world=None)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("my_car:Mute", r"has no tell\(\)"),
        ("my_car:None", "cannot be loaded"),
        ("no_such_module:Car", "cannot be loaded"),
        ("nobody", 'there is no vehicle "nobody"; installed are none .* armsight.vehicles'),
    ],
)
def test_a_car_that_cannot_speak_is_said(my_car, name, words):
    with pytest.raises(TaskError, match=words):
        open_vehicle(name, {"address": "can0"})


def test_of_two_packages_neither_speaks_for_the_car(my_car, monkeypatch):
    entries = [EntryPoint("taxi", "my_car:Car", GROUP)]
    monkeypatch.setattr(catalogue, "entry_points", lambda group: entries)
    monkeypatch.syspath_prepend(".")
    assert open_vehicle("taxi", {"address": "can0"}).at == "can0"
    entries.append(EntryPoint("taxi", "other:Car", GROUP))
    with pytest.raises(TaskError, match="2 packages offer it"):
        open_vehicle("taxi", {"address": "can0"})


def test_who_speaks_needs_what_it_is_called_with(my_car):
    with pytest.raises(TaskError, match="cannot be opened: KeyError"):
        open_vehicle("my_car:Car", {})


def test_no_real_arm_is_led_by_a_car_that_is_made_up():
    workcell = charging_cell()
    real = workcell.robot.model_copy(update={"driver": "tcp_arm:Arm"})
    cell = SimpleNamespace(workcell=workcell.model_copy(update={"robot": real}), world=None)
    with pytest.raises(UsageError, match="nobody speaks for the car"):
        ChargeOptions().speaker(cell)


def opened(workcell, *pairs):
    """As much of an open cell as making the task needs."""
    lenses = stereo_pair()
    infos = [
        SimpleNamespace(name=n, mounted_on=m, T_mount_camera=np.eye(4), lenses=lenses)
        for n, m in pairs
    ]
    return SimpleNamespace(
        workcell=workcell,
        robot=robot_in(workcell),
        wrench=object(),
        gripper=SimpleNamespace(opening=0.15),
        stereo=[SimpleNamespace(info=info) for info in infos],
        T_world_base=workcell.robot.T_world_base,
        world=None,
    )


def test_a_car_whose_inlet_the_plug_does_not_enter_and_a_lid_that_nobody_sees_are_said(tmp_path):
    wrong = charging_cell().text.replace('\nvehicle = "hatchback"', '\nvehicle = "city_car"', 1)
    options = ChargeOptions(state=tmp_path / "j.json")
    both = ("post", "base"), ("flange", "flange")
    with pytest.raises(UsageError, match="city_car has type1, which a type2_plug does not enter"):
        options.make(opened(parse_workcell(wrong), *both))
    lid = load("ur10_charging_lid")
    with pytest.raises(UsageError, match="a lid needs a stereo pair on the flange"):
        options.make(opened(lid, both[0]))
    assert options.make(opened(lid, *both)).station.finger is not None


def test_a_car_that_has_left_is_not_said_to_stand_where_it_was():
    """The next one stands elsewhere, and where the old one was may be anybody."""
    port = seen_port(charging_cell())
    car = SimpleNamespace(status=lambda now: VehicleStatus(parked=car.parked), parked=True)
    it = SimpleNamespace(vehicle=car, port=port, busy=False, lid_open=False, outcomes=[])
    it.state = State.STAND_BY
    it.options = SimpleNamespace(far="post", near="flange")
    task = ChargeTask(it, [], 0, ParkedCarOnMap(load_vehicle("hatchback"), np.eye(4)))
    round_ = SimpleNamespace(now=0.0, snapshot=None)
    for parked, stands in ((True, 1), (False, 0), (True, 0)):
        car.parked = parked
        task._on_map(round_)
        assert len(task.standing) == stands
    it.port = replace(port)  # seen anew
    task._on_map(round_)
    assert len(task.standing) == 1
    # Nothing could come out of a car whose side might be somebody.
    car.parked, it.busy = False, True
    for it.state in (State.CHARGE, State.UNPLUG, State.HELD):
        task._on_map(round_)
        assert len(task.standing) == 1
    it.state = State.LEAVE
    task._on_map(round_)
    assert not task.standing


def rounds(task, stub):
    """Some rounds of the task, the arm at its stand-by."""
    for i in range(20):
        now = 0.008 * (i + 1)
        task.update(
            SimpleNamespace(
                now=now,
                perceived=(),
                joints=JointState(now, stub.q, np.zeros(6)),
                wrench=Wrench(now, np.array([0.0, -16.0, 0.0]), np.zeros(3)),
                guard=None,
                gripper=None,
                snapshot=None,
                robot=stub.robot,
            )
        )


def test_who_is_stuck_offers_no_button_that_does_nothing(tmp_path):
    cell, file = charging_cell(), tmp_path / "j.json"
    port, T = seen_port(cell), robot_in(cell).tool.T_flange_tcp
    Journal(file).write(Entry("type1", "type1_plug", port.T_base_port, port.covariance, T))
    stub = Stub(cell, station(cell, file))
    task = ChargeTask(stub.station, [], 1, ParkedCarOnMap(None, np.eye(4)))
    rounds(task, stub)
    face = task.face()
    assert face.state == "stuck"
    assert not any(button.enabled for button in face.buttons)


@pytest.mark.parametrize("name", [n for n in packaged() if n.startswith("ur10_charging")])
def test_the_packaged_cells_charge(name, tmp_path):
    both = ("post", "base"), ("flange", "flange")
    task = ChargeOptions(state=tmp_path / "j.json").make(opened(load(name), *both))
    assert task.station.state.value == "stand by"


def test_what_is_out_of_reach_is_by_the_arm_and_not_by_a_ur10(tmp_path):
    """A longer arm was told that a port before it was out of reach."""
    cell = opened(charging_cell(), ("post", "base"), ("flange", "flange"))
    cell.robot = replace(cell.robot, reach=1.9)
    station_ = ChargeOptions(state=tmp_path / "j.json").make(cell).station
    far = np.eye(4)
    far[0, 3] = 1.8
    assert "out of reach" not in station_._impossible(far)
    far[0, 3] = 2.0
    assert "2.00 m from the base: out of reach" in station_._impossible(far)


def test_a_visit_that_a_killed_station_left_is_the_one_that_was_asked_for(tmp_path):
    """Nobody asked for another one, which began all the same."""
    cell, file = charging_cell(), tmp_path / "j.json"
    port, T = seen_port(cell), robot_in(cell).tool.T_flange_tcp
    Journal(file).write(Entry("type2", "type2_plug", port.T_base_port, port.covariance, T))
    stub = Stub(cell, station(cell, file))
    task, ended = ChargeTask(stub.station, [], 1, ParkedCarOnMap(None, np.eye(4))), []
    task.done = lambda: ended.append(True)
    rounds(task, stub)
    assert ended
    assert not stub.station.busy
    assert len(stub.station.outcomes) == 1


def test_a_visit_that_was_taken_over_says_no_time_that_nobody_knows():
    outcome = Outcome(seated=True, charged=True, port="type2", score=1.0, began=3.0)
    assert told(outcome) == "type2 found (100 %), seated, charged, out"
    without = Outcome(port="type2", began=3.0, problem="was stopped with the plug out of the car")
    assert told(without) == (
        "type2 known from before, out, was stopped with the plug out of the car"
    )
