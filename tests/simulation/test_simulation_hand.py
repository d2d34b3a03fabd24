"""Force sensor and gripper of the simulation, against statics, filter theory and arithmetic."""

from dataclasses import replace

import numpy as np
import pytest

from armsight.devices.data import Wrench
from armsight.errors import DeviceError
from armsight.robots import load_robot, load_tool
from armsight.robots.kinematics import flange_pose
from armsight.simulation.clock import SimulatedClock
from armsight.simulation.gripper import SimulatedGripper
from armsight.simulation.spec import ArmSpec, GripperSpec, WorldSpec, WrenchSpec
from armsight.simulation.world import SimulatedWorld
from armsight.simulation.wrench import SimulatedWrench

EXACT = WrenchSpec(noise=(0.0, 0.0), bias=(0.0, 0.0), drift=(0.0, 0.0))
GRAVITY = np.array([0.0, 0.0, -9.81])


def weight(robot, q):
    """Force and torque of the tool's weight on the flange, in the flange's frame."""
    R = flange_pose(robot, q)[:3, :3]
    force = R.T @ (robot.tool.mass * GRAVITY)
    return force, np.cross(robot.tool.center_of_mass, force)


def run(spec, seconds, seed=0):
    readings = []
    with SimulatedWorld(spec, seed) as world:
        for i in range(int(seconds / 0.01)):
            world.advance(0.01 * (i + 1))
            readings.append(world.wrench.read())
    return [r for r in readings if r is not None]


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur5").with_tool(load_tool("type2_plug"))


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.4, -0.9, 0.7), (-0.3, 1.2, -2.0)])
def test_at_rest_it_feels_the_tools_weight(robot, turn):
    q = robot.home + np.concatenate([[0.0, 0.2, -0.1], turn])
    spec = WorldSpec(ArmSpec(robot, np.eye(4), q, repeatability=0.0), wrench=EXACT)
    last = run(spec, 0.4)[-1]
    force, torque = weight(robot, q)
    assert last.force == pytest.approx(force, abs=0.01)
    assert last.torque == pytest.approx(torque, abs=0.002)


def test_it_feels_an_acceleration(robot):
    """Newton: a wrist that turns with the tool feels its inertia beside its weight."""
    q = robot.home
    spec = WorldSpec(
        ArmSpec(robot, np.eye(4), q, repeatability=0.0, start_delay=0.0),
        wrench=replace(EXACT, rate=500.0, low_pass=5000.0, latency=0.0),
    )
    at, felt = [], []
    with SimulatedWorld(spec) as world:
        for i in range(250):
            world.arm.command_velocity(np.array([0.8 * np.sin(0.05 * i), 0, 0, 0, 0, 0]))
            world.advance(0.002 * (i + 1))
            at.append(world._data.qpos[:6].copy())
            felt.append(world.wrench.read().force)
    poses = [flange_pose(robot, x) for x in at]
    center = np.array([T[:3, :3] @ robot.tool.center_of_mass + T[:3, 3] for T in poses])
    pull = np.gradient(np.gradient(center, 0.002, axis=0), 0.002, axis=0)
    wanted = [
        T[:3, :3].T @ (robot.tool.mass * (GRAVITY - a)) for T, a in zip(poses, pull, strict=True)
    ]
    smooth = np.ones(15) / 15
    for axis in range(3):
        a = np.convolve(np.array(felt)[:, axis], smooth, "valid")[20:-20]
        b = np.convolve(np.array(wanted)[:, axis], smooth, "valid")[20:-20]
        assert np.median(np.abs(a - b)) < 0.05  # where it turns they are a step apart
    assert np.ptp(np.array(wanted), axis=0).max() > 3.0


def test_bias_noise_and_seed(robot):
    spec = WorldSpec(ArmSpec(robot, np.eye(4), robot.home, repeatability=0.0), wrench=WrenchSpec())
    force, _ = weight(robot, robot.home)
    told = np.array([r.force for r in run(spec, 3.0, seed=4)])
    again = np.array([r.force for r in run(spec, 3.0, seed=4)])
    other = np.array([r.force for r in run(spec, 3.0, seed=5)])
    assert np.array_equal(told, again)
    assert told.std(axis=0) == pytest.approx([0.1] * 3, rel=0.2)
    assert not np.allclose(told.mean(axis=0), other.mean(axis=0), atol=0.05)
    assert np.abs(told.mean(axis=0) - force).max() < 4.0


def test_its_low_pass_is_of_first_order():
    clock = SimulatedClock()
    sensor = SimulatedWrench(
        replace(EXACT, low_pass=10.0, rate=1000.0, latency=0.0), clock, 0.001, (0,)
    )
    zero = np.zeros(3)
    sensor.sense(0, 0.0, zero, zero)
    for i in range(1, 200):
        sensor.sense(i, 0.001 * i, np.array([1.0, 0.0, 0.0]), zero)
    clock._set(1.0)
    told = {round(1e3 * w.stamp): w.force[0] for w in list(sensor._waiting)}
    for ms in (5, 16, 50):
        assert told[ms] == pytest.approx(1.0 - np.exp(-2 * np.pi * 10.0 * ms * 1e-3), abs=0.01)
    came = list(iter(sensor.read, None))
    assert len(came) == 200, "every reading is handed over"
    assert isinstance(came[0], Wrench)


def test_without_a_sensor_nothing_of_the_cell_is_another(robot):
    """The tool is a body of its own only with a sensor: a cell without keeps its bits."""
    arm = ArmSpec(robot, np.eye(4), robot.home)
    with (
        SimulatedWorld(WorldSpec(arm)) as plain,
        SimulatedWorld(WorldSpec(arm, wrench=EXACT)) as feeling,
    ):
        assert plain.wrench is None
        assert plain._cell.model.nbody + 1 == feeling._cell.model.nbody
        assert plain._cell.model.nsensor == 0
        masses = [world._cell.model.body_mass.sum() for world in (plain, feeling)]
        assert masses[0] == pytest.approx(masses[1])


def test_a_gripper_goes_to_its_width_at_its_speed():
    clock = SimulatedClock()
    gripper = SimulatedGripper(GripperSpec(opening=0.08, speed=0.1, delay=0.03), clock)
    assert gripper.read().width == 0.08
    assert gripper.read() is None  # nothing new yet
    gripper.move(0.03)
    widths = {}
    for ms in range(20, 801, 20):
        clock._set(ms / 1e3)
        state = gripper.read()
        widths[ms] = state.width
        assert state.moving == (ms < 530)
    assert widths[20] == 0.08
    assert widths[280] == pytest.approx(0.08 - 0.1 * 0.25)
    assert widths[800] == 0.03
    gripper.move(0.08)
    clock._set(0.93)
    assert gripper.read().width == pytest.approx(0.04)
    with pytest.raises(DeviceError, match=r"a width is 0 to 0.08 m"):
        gripper.move(0.1)
    gripper.reset()
    clock._set(0.0)
    assert gripper.read().width == 0.08
