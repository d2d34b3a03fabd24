"""A hung cable that does not reach a port, or would hang in the car, is said beforehand."""

import numpy as np
import pytest

from armsight.charging.cable_way import SPARE, cable_fault
from armsight.charging.feeling import TUG
from armsight.charging.journal import Journal
from armsight.charging.moves import before_port
from armsight.charging.station import Station
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.vehicle_file import load_vehicle
from armsight.geometry.pose import inverse, make_pose, transform
from armsight.robots.cable import HungCable
from armsight.simulation.cable import CableChain
from armsight.simulation.spec import CableSpec
from armsight.workcell import robot_in
from armsight.workcell.packaged import load

LENGTH = 1.6


def port_at(x, y=0.0, z=0.45):
    """A port that looks back at the base."""
    return make_pose(np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]), (x, y, z))


def chain(cable, T_base_port, before):
    """MuJoCo's chain with its end where the plug has it, and how hard it pulls when it hangs."""
    end = transform(before_port(T_base_port, before), np.array([cable.root]))[0]
    spec = CableSpec(cable.hanger, cable.length, bending=cable.bending)
    made = CableChain(spec, end)
    return made, float(np.linalg.norm(made.settle(3.0)))


@pytest.mark.parametrize("before", [0.10, 0.0])
def test_where_a_cable_is_said_to_reach_the_bending_chain_hangs_loosely_beside_the_car(before):
    cable = HungCable((0.0, -0.7, 1.6), LENGTH)
    body = load_vehicle("hatchback").solids
    T = port_at(0.85)
    assert cable_fault(cable, T, body) == ""
    made, pull = chain(cable, T, before)
    assert pull < TUG
    points = transform(inverse(T), made.joints)
    assert min(float(s.distance(points).min()) for s in body) > 0.0


def test_a_cable_that_is_too_short_is_said_and_the_chain_that_is_led_there_is_torn():
    """Just within its length it pulls hard already; farther it would have to be longer."""
    cable = HungCable((0.0, -0.7, 1.6), 1.25)
    T = port_at(0.85)
    words = cable_fault(cable, T)
    assert words.startswith("the cable's hanger is 1.")
    assert words.endswith("the cable 1.25 m long: too short")
    assert chain(cable, T, 0.0)[1] > TUG
    ends = [transform(before_port(T, b), np.array([cable.root]))[0] for b in (0.1, 0.0)]
    reach = max(float(np.linalg.norm(end - np.array(cable.hanger))) for end in ends)
    enough = HungCable(cable.hanger, reach + 1.01 * SPARE)
    assert cable_fault(enough, T) == ""


def test_a_hanger_behind_the_flank_would_have_the_cable_in_the_car():
    body = load_vehicle("hatchback").solids
    behind = HungCable((1.2, -0.2, 1.2), 1.9)
    assert "deep in the car" in cable_fault(behind, port_at(0.85), body)
    assert cable_fault(behind, port_at(0.85)) == ""


def test_the_packaged_cell_with_a_cable_reaches_its_car():
    cell = load("ur10_charging_cable")
    cable = robot_in(cell).tool.cable
    car = cell.simulation.car
    yaw = np.deg2rad(car.yaw_deg)
    z = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    R = np.stack([np.cross([0.0, 0.0, 1.0], z), [0.0, 0.0, 1.0], z], axis=1)
    T = inverse(cell.robot.T_world_base) @ make_pose(R, car.position)
    assert cable is not None
    assert cable_fault(cable, T, load_vehicle("hatchback").solids) == ""


def test_a_station_leaves_a_port_alone_that_its_cable_does_not_reach():
    robot = robot_in(load("ur10_charging_cable"))
    station = Station(robot, robot.home, SimulatedCar(), Journal(None))
    assert "too short" in station._impossible(port_at(0.5, 1.0, -0.2))
    assert station._impossible(port_at(0.85)) == ""
