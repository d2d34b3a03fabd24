"""A tool in a soft mount that presses: the guard's spheres hold it where it is bent."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import Wrench
from armsight.geometry.pose import make_pose, transform
from armsight.geometry.shapes import Solid
from armsight.motion.guard import Guard
from armsight.motion.guard_config import GuardConfig
from armsight.motion.hung_cable import DraggedCable
from armsight.motion.nearest import Hazards
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.robots import load_robot
from armsight.robots.cable import HungCable
from armsight.robots.held import holding
from armsight.robots.kinematics import flange_pose
from armsight.robots.soft_mount import SoftMount

PLUG = Solid("plug", "box", (0.05, 0.05, 0.20), make_pose(translation=(0.0, 0.0, 0.10)))
T_TIP = make_pose(translation=(0.0, 0.0, 0.20))
MOUNT = SoftMount((5000.0, 30.0), (161.0, 22.0), (31.0, 3.0))
TOOL = replace(holding(None, [PLUG]), T_flange_tcp=T_TIP, mount=MOUNT)
BARE = load_robot("ur10")
ROBOT = BARE.with_tool(TOOL)
Q = ROBOT.home
PRESSED = np.array([10.0, 0.0, -85.0, 0.0, 9.0, 0.0])
"""On the tip: pressed home, and turned by 17 deg as at a latch."""


def reading(on_tip, stamp=0.1):
    """What the sensor at the flange says of a (6,) load on the tip, in its axes."""
    return Wrench(stamp, on_tip[:3], on_tip[3:] + np.cross(T_TIP[:3, 3], on_tip[:3]))


def monitor(robot=ROBOT):
    return SeparationMonitor(robot, GuardConfig(), robot.limits.acceleration)


def held(gate, on_tip):
    """(k,) by how much each point of the plug's skin lies outside the guard's spheres [m]."""
    half = 0.5 * np.array(PLUG.size)
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 0, 1)])
    moved = MOUNT.moved(T_TIP, np.concatenate([reading(on_tip).force, reading(on_tip).torque]))
    skin = transform(flange_pose(ROBOT, Q) @ moved @ PLUG.T_frame_solid, corners)
    body = gate.body
    centers = body.motion(Q, np.zeros(6))[0]
    away = np.linalg.norm(skin[:, None] - centers, axis=2) - body.shell
    return away.min(axis=1)


def test_a_plug_that_presses_is_in_its_spheres_where_it_is_bent():
    gate = monitor()
    assert held(gate, PRESSED).max() > 0.01  # by what weight and cable do alone it is not
    gate.feel([reading(np.zeros(6)), reading(PRESSED, 0.102)])
    assert held(gate, PRESSED).max() <= 0.0


def test_somebody_beside_it_is_nearer_by_as_much():
    gate = monitor()
    beside = flange_pose(ROBOT, Q) @ make_pose(translation=(0.3, 0.0, 0.02))
    person = Hazards.at(beside[None, :3, 3], 0.0)
    plug = slice(-len(TOOL.spheres.radius), None)
    before = gate.at_rest(Q, person).distance[plug].min()
    gate.feel([reading(PRESSED)])
    bent = (85.0 - MOUNT.rest[0]) / 5000.0 + 0.15 * (9.0 - MOUNT.rest[1]) / 30.0
    assert before - gate.at_rest(Q, person).distance[plug].min() > bent


def test_it_is_never_less_than_what_weight_and_cable_do_nor_more_than_is_believed():
    gate = monitor()
    rest = gate.body.shell.copy()
    gate.feel([reading(np.zeros(6))])
    np.testing.assert_allclose(gate.body.shell, rest)
    gate.feel([reading(100.0 * PRESSED)])
    most = gate.body.shell - gate.body.radius
    levers = np.linalg.norm(TOOL.spheres.center - T_TIP[:3, 3], axis=1)
    np.testing.assert_allclose(most[-len(levers) :], 161.0 / 5000.0 + levers * 22.0 / 30.0)
    assert (most[: -len(levers)] == 0.0).all()  # the arm itself does not bend


@pytest.mark.parametrize("silent", [[], [Wrench(0.2, np.full(3, np.nan), np.zeros(3))]])
def test_a_sensor_that_says_nothing_leaves_it_bent(silent):
    gate = monitor()
    gate.feel([reading(PRESSED)])
    bent = gate.body.shell.copy()
    gate.feel(silent)
    np.testing.assert_array_equal(gate.body.shell, bent)


def test_its_cable_is_held_there_too():
    tool = replace(TOOL, cable=HungCable((0.1, -0.7, 1.7), 2.1, root=(0.0, 0.0, -0.2)))
    cable = DraggedCable.of(BARE.with_tool(tool))
    before = cable.radius.copy()
    cable.feel(MOUNT.load(T_TIP, np.concatenate([reading(PRESSED).force, reading(PRESSED).torque])))
    assert cable.radius[0] > before[0] + 0.02
    assert cable.radius[-1] == pytest.approx(before[-1], abs=0.005)


def test_the_guard_passes_on_what_is_felt():
    guard = Guard(ROBOT, [])
    before = guard.body.shell.copy()
    guard.feel([reading(PRESSED)])
    assert (guard.body.shell - before).max() > 0.02
