"""The packaged charging cell: plug and port as physics has them, what its file may not say."""

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.charging.admittance import Admittance
from armsight.charging.hanging import hung
from armsight.devices.history import JointHistory
from armsight.errors import UsageError, WorkcellError
from armsight.experiments.station_bench import StationBench, charging_cell
from armsight.geometry.pose import inverse, log, transform
from armsight.mapping.self_filter import SelfFilter, body_fields
from armsight.motion.guard_config import GuardConfig
from armsight.motion.nearest import Hazards, MovingBody
from armsight.motion.separation_monitor import SeparationMonitor
from armsight.motion.task import Subscriptions
from armsight.robots.kinematics import flange_pose
from armsight.runtime.picture_orders import PictureOrders
from armsight.tasks.charge import ChargeOptions
from armsight.workcell import parse_workcell, world_spec


@pytest.fixture(scope="module")
def bench():
    bench = StationBench(charging_cell(), seed=4)
    bench.world.advance(0.6)  # the plug hangs still
    return bench


def test_the_plug_hangs_where_force_sensor_and_springs_say(bench):
    world = bench.world
    readings = []
    while (reading := world.wrench.read()) is not None:
        readings.append(np.concatenate([reading.force, reading.torque]))
    wrench = np.mean(readings[-100:], axis=0)
    T_tip = bench.robot.tool.T_flange_tcp
    believed = flange_pose(bench.robot, world.arm.read().position) @ hung(
        T_tip, wrench, Admittance((5000.0, 30.0), 0.07)
    )
    true = bench.T_base_port @ world.plugged.T_socket_plug
    off = log(inverse(believed) @ true)
    nominal = flange_pose(bench.robot, bench.robot.home) @ T_tip
    sag = log(inverse(nominal) @ true)
    assert np.linalg.norm(sag[:3]) > 0.004
    assert np.linalg.norm(sag[3:]) > np.deg2rad(2.0)
    assert np.linalg.norm(off[:3]) < 0.003  # half of an arm's absolute error is in it
    assert np.linalg.norm(off[3:]) < np.deg2rad(0.6)


def test_the_self_filter_has_the_plug_where_it_truly_hangs(bench):
    """It was looked for where it was mounted, 3 cm beside, and the guard took it for somebody."""
    world, tool = bench.world, bench.robot.tool
    world.advance(world.clock.now() + 0.6)
    history = JointHistory()
    while (reading := world.wrench.read()) is not None:
        history.feel(reading)
    joints = world.arm.read()
    felt = history.felt(world.clock.now() - 0.02)
    body = SelfFilter(bench.robot).pose(joints.position, joints.velocity, felt)
    plain = SelfFilter(bench.robot).pose(joints.position, joints.velocity)
    gives = body_fields(bench.robot).gives
    assert gives.any()
    assert not gives.all()
    root = transform(inverse(tool.T_flange_tcp), np.zeros((1, 3)))
    true = transform(bench.T_base_port @ world.plugged.T_socket_plug, root)[0]
    T_base_tip = flange_pose(bench.robot, joints.position) @ tool.T_flange_tcp
    nominal = transform(T_base_tip, root)[0]
    m = int(np.flatnonzero(gives)[0])
    in_cells = transform(plain.T_cells_base[m], nominal[None])
    believed = transform(np.linalg.inv(body.T_cells_base[m]), in_cells)[0]
    assert np.linalg.norm(true - nominal) > 0.015
    assert np.linalg.norm(true - believed) < 0.004  # half of an arm's absolute error is in it


def test_the_ports_frame_is_upright_and_looks_out_of_the_car(bench):
    car = bench.workcell.simulation.car
    np.testing.assert_allclose(car.pose[:3, 2], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(car.pose[:3, 1], [0, 0, 1], atol=1e-12)
    # x is to the right of who looks at it: along world -x, up is z
    np.testing.assert_allclose(car.pose[:3, 0], np.cross([-1, 0, 0], [0, 0, 1]) * -1, atol=1e-12)
    leaning = car.model_copy(update={"yaw_deg": 90.0, "lean_deg": 30.0}).pose
    np.testing.assert_allclose(leaning[:3, 2], [0, np.cos(np.pi / 6), 0.5], atol=1e-12)
    assert np.linalg.det(leaning[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('kind = "type2_plug"', 'kind = "type3_plug"', "no port or plug 'type3_plug'"),
        ('kind = "type2_plug"', 'kind = "type2"', "type2 is an inlet; plugs are type1_plug"),
        ('port = "type2"', 'port = "type2_plug"', "no inlet type2_plug; there are type1"),
        ('tool = "type2_plug"', 'tool = "none"', "needs a \\[wrench\\] and robot.tool"),
        ('tool = "type2_plug"', 'tool = "ccs2_plug"', "robot.tool is ccs2_plug: name the same"),
    ],
)
def test_a_plug_or_port_that_cannot_be_is_said(old, new, words):
    text = charging_cell().text
    assert old in text
    with pytest.raises(WorkcellError, match=words):
        world_spec(parse_workcell(text.replace(old, new)))


def test_a_cell_without_a_plug_cannot_charge():
    cell = SimpleNamespace(
        workcell=SimpleNamespace(name="bare", plug=None),
        robot=SimpleNamespace(tool=None),
        wrench=None,
        stereo=(),
    )
    with pytest.raises(UsageError, match="bare: charging needs a"):
        ChargeOptions().make(cell)


class Pair:
    """A pair that notes what it is asked for."""

    def __init__(self, name):
        self.info, self.wanted = SimpleNamespace(name=name), []

    def want_pictures(self, wanted):
        self.wanted.append(wanted)


def test_a_pair_that_is_looked_at_on_demand_is_spared_until_the_task_wants_it():
    always = SimpleNamespace(cameras=(), stereo=("a",))
    sometimes = SimpleNamespace(cameras=(), stereo=("b",), on_demand=True)
    task = SimpleNamespace(name="t", subscriptions=Subscriptions())
    pairs = [Pair("a"), Pair("b")]
    orders = PictureOrders(task, [always, sometimes], [], pairs, nullcontext())
    orders.place()
    assert [p.wanted[-1] for p in pairs] == [True, False]
    task.subscriptions = Subscriptions(stereo=("b",))
    orders.place()
    assert [p.wanted[-1] for p in pairs] == [True, True]
    task.subscriptions = Subscriptions()
    orders.place()
    assert [p.wanted[-1] for p in pairs] == [True, False]


def test_what_is_kept_of_a_world_puts_arm_plug_and_car_where_they_stood(bench):
    """For a program that takes over from one that was killed."""
    world = bench.world
    kept = json.loads(json.dumps(world.memory.take()))
    before, now = world.plugged.T_socket_plug.copy(), world.clock.now()
    for k in range(40):
        world.arm.command_velocity(np.full(6, 0.3))
        world.advance(now + 0.01 * k)
    assert np.linalg.norm((inverse(before) @ world.plugged.T_socket_plug)[:3, 3]) > 0.02
    world.arm.stop()
    world.advance(world.clock.now() + 0.3)
    world.memory.put(kept)
    np.testing.assert_allclose(world.plugged.T_socket_plug, before, atol=1e-5)
    world.advance(world.clock.now() + 0.3)
    assert np.linalg.norm((inverse(before) @ world.plugged.T_socket_plug)[:3, 3]) < 0.002


def test_the_guard_counts_with_how_far_the_plug_sags(bench):
    """Its spheres are those of a plug that nothing bends: they are kept wider by that."""
    workcell, tool = bench.workcell, bench.robot.tool
    body = MovingBody(bench.robot, bench.robot.limits.acceleration)
    counted = (body.shell - body.radius)[-len(tool.spheres.radius) :]
    assert not (body.shell - body.radius)[: -len(counted)].any()
    bolted = replace(bench.robot, tool=replace(tool, mount=None))
    assert np.array_equal(MovingBody(bolted, bolted.limits.acceleration).shell, body.radius)
    q = bench.robot.home
    center = body.motion(q, np.zeros(6))[0]
    hand = Hazards.at(center[-1:] + np.array([[0.0, 0.2, 0.1]]), 0.0)
    law = SeparationMonitor(bench.robot, GuardConfig(), body.brake).law
    away = np.linalg.norm(center - hand.blocks.points[0], axis=1) - body.shell
    assert body.view(q, np.zeros(6), hand, law).distance == pytest.approx(away, abs=1e-5)
    spheres = tool.spheres
    for q in (bench.robot.home, bench.robot.home + np.array([0.3, 0.4, -0.5, 0.8, 0.6, 1.2])):
        R = flange_pose(bench.robot, q)[:3, :3]
        down = R.T @ np.array([0.0, 0.0, -1.0])
        load = np.zeros(6)
        for weight, at in (
            (9.81 * tool.mass, tool.center_of_mass),
            (workcell.plug.cable_n, np.zeros(3)),
        ):
            load += np.concatenate([weight * down, np.cross(at, weight * down)])
        moved = transform(tool.mount.moved(tool.T_flange_tcp, load), spheres.center)
        sag = np.linalg.norm(moved - spheres.center, axis=1)
        assert sag.max() > 0.005
        assert (sag <= counted).all()
