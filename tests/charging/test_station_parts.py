"""The station's small parts: journal, hanging plug, straight lines, simulated car, permission."""

import errno
import json
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.charging.admittance import Admittance
from armsight.charging.eye import PortEye, SeenPort, picture_fault
from armsight.charging.feeling import Feeling
from armsight.charging.hanging import hung, tip_twist
from armsight.charging.journal import Entry, Journal, JournalError
from armsight.charging.moves import apart, before_port, looking_pose, straight
from armsight.charging.permission import RENEW, Permission
from armsight.charging.vehicle import SimulatedCar
from armsight.charging.visit import StationOptions
from armsight.devices.data import Wrench
from armsight.geometry.camera import PinholeCamera
from armsight.geometry.pose import exp, from_rpy, inverse, log, make_pose
from armsight.motion.executed import Executed
from armsight.motion.ik import solve_ik
from armsight.motion.nearest import MovingBody
from armsight.motion.permits import Permit, PermitState, touching
from armsight.motion.permitted import Grant
from armsight.motion.retreat import Retreat
from armsight.robots.kinematics import tcp_jacobian
from armsight.robots.soft_mount import at_plug
from armsight.workcell import robot_in
from armsight.workcell.packaged import load

RNG = np.random.default_rng(3)
PORT = from_rpy((0.3, -1.2, 0.4), (0.9, 0.1, 0.4))


def entry(plugged=False):
    T, six = make_pose(None, [0, 0, 0.2]), np.diag([1e-6] * 3 + [1e-4] * 3)
    return Entry("type2", "type2_plug", PORT, six, T, np.arange(6.0), plugged)


def test_a_journal_says_after_a_restart_what_was_written(tmp_path):
    file = tmp_path / "cell.station.json"
    assert Journal(file).read() is None
    Journal(file).write(entry(plugged=True))
    read = Journal(file).read()
    assert (read.port, read.plug, read.plugged) == ("type2", "type2_plug", True)
    np.testing.assert_array_equal(read.T_base_port, PORT)
    np.testing.assert_array_equal(read.tare, np.arange(6.0))
    np.testing.assert_array_equal(read.covariance, entry().covariance)
    Journal(file).write(replace(entry(), tare=None))
    assert Journal(file).read().tare is None
    Journal(file).clear()
    assert Journal(file).read() is None
    Journal(file).clear()  # clearing nothing is nothing
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: "{", "is no journal"),
        (lambda d: "[" * 5000, "is no journal"),
        (lambda d: " " * 200_000, "too long"),
        (lambda d: json.dumps({**d, "version": 1}), "version 3"),
        (lambda d: json.dumps({**d, "at_lid": True}), "T_base_lid is none"),
        (lambda d: json.dumps({**d, "T_base_lid": [[1.0]]}), "T_base_lid is no"),
        (lambda d: json.dumps({**d, "tare": [0, 1]}), "tare"),
        (lambda d: json.dumps({**d, "covariance": [0, 1]}), "covariance is no"),
        (lambda d: json.dumps({**d, "covariance": (-np.eye(6)).tolist()}), "covariance is none"),
        (lambda d: json.dumps({**d, "plugged": "yes"}), "plugged"),
        (lambda d: json.dumps({**d, "port": 5}), "port"),
        (lambda d: json.dumps({**d, "T_base_port": [[1, 0], [0, 1]]}), "T_base_port is no"),
        (lambda d: json.dumps({**d, "T_flange_plug": (2 * np.eye(4)).tolist()}), "no pose"),
        (lambda d: json.dumps({k: v for k, v in d.items() if k != "tare"}), "tare"),
    ],
)
def test_a_journal_that_cannot_be_believed_is_an_error_that_says_what_to_do(
    tmp_path, change, words
):
    file = tmp_path / "j.json"
    Journal(file).write(entry())
    file.write_text(change(json.loads(file.read_text())))
    with pytest.raises(JournalError, match=words) as error:
        Journal(file).read()
    assert "look whether the plug is in the car" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_journal_whose_name_no_disk_takes_is_an_error_in_words(tmp_path):
    with pytest.raises(JournalError, match="cannot be read: File name too long"):
        Journal(tmp_path / ("j" * 300)).read()


def test_a_journal_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "folder").write_text("a file where the folder should be")
    with pytest.raises(JournalError, match="cannot be written"):
        Journal(tmp_path / "folder" / "j.json").write(entry())


def test_a_full_disk_leaves_no_half_of_a_journal(tmp_path, monkeypatch):
    file = tmp_path / "j.json"
    Journal(file).write(entry())
    before = file.read_bytes()

    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(JournalError, match="cannot be written: No space left on device"):
        Journal(file).write(entry(plugged=True))
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_a_journal_is_in_its_folder_when_it_was_written(tmp_path, monkeypatch):
    """After a loss of power a file whose folder was not written is not there."""
    settled, fsync = [], os.fsync

    def noted(descriptor):
        settled.append(os.fstat(descriptor).st_ino)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    file = tmp_path / "j.json"
    Journal(file).write(entry())
    assert settled == [file.stat().st_ino, tmp_path.stat().st_ino]


def test_a_plug_hangs_as_far_as_its_weight_over_the_springs_says():
    mount, T_tip = Admittance((5000.0, 30.0), 0.07), make_pose(None, [0, 0, 0.2])
    # 20 N down (-y of a level plug) at 6 cm behind the tip: the sensor feels it at the flange
    force, at = np.array([0.0, -20.0, 0.0]), np.array([0.0, 0.0, 0.14])
    wrench = np.concatenate([force, np.cross(at, force)])
    off = log(inverse(T_tip) @ hung(T_tip, wrench, mount))
    assert off[1] == pytest.approx(-20.0 / 5000.0, abs=2e-4)
    # its rear sinks, so its mouth looks up: about x by r x f, r = -6 cm along z
    assert off[3] == pytest.approx((-0.06 * 20.0) / 30.0 * 1.0, abs=1e-3)
    np.testing.assert_allclose(at_plug(wrench, T_tip)[3:], [-1.2, 0, 0], atol=1e-12)


def test_the_tips_twist_moves_the_plug_as_wished():
    T_tip, T_plug = make_pose(None, [0, 0, 0.2]), from_rpy((0.05, -0.03, 0.1), (0.004, -0.006, 0.2))
    wish = RNG.normal(size=6) * 0.1
    twist = tip_twist(wish, T_tip, T_plug)
    dt = 1e-6  # a rigid step of the flange by the tip's twist, seen at the plug
    moved = T_tip @ exp(twist * dt) @ inverse(T_tip) @ T_plug
    np.testing.assert_allclose(log(inverse(T_plug) @ moved) / dt, wish, atol=1e-5)


def test_a_straight_line_comes_in_along_the_axis():
    goal = before_port(PORT, 0.015)
    plug = before_port(PORT, 0.1) @ exp(np.array([0.01, -0.008, 0.0, 0.05, 0.04, 0.06]))
    for _ in range(2000):
        before = log(inverse(goal) @ plug)
        plug = plug @ exp(0.008 * straight(plug, goal, 0.06))
        after = log(inverse(goal) @ plug)
        if np.hypot(*before[:2]) > 0.007:  # it does not go in before it is on the axis
            assert after[2] - before[2] < 1e-4
    distance, angle = apart(plug, goal)
    assert distance < 1e-4
    assert angle < 1e-3


@pytest.mark.parametrize("side", range(5))
def test_a_second_look_has_the_port_in_its_middle_from_so_far_off_its_axis(side):
    T = looking_pose(PORT, 0.36, np.deg2rad(22), side)
    port = inverse(T) @ PORT
    np.testing.assert_allclose(port[:3, 3], [0, 0, 0.36], atol=1e-12)
    assert np.rad2deg(np.arccos(-port[2, 2])) == pytest.approx(22.0)


def test_a_simulated_car_locks_charges_and_opens():
    car = SimulatedCar("type2", seconds=3.0, unlock=0.5)
    assert car.status(0.0).parked
    assert not car.status(0.0).locked
    car.tell("plugged", 1.0)
    assert car.status(2.0).locked
    assert car.status(2.0).charging
    assert not car.status(2.0).enough
    assert car.status(4.0).enough
    assert not car.status(4.0).charging
    car.tell("stop", 4.5)
    assert car.status(4.9).locked
    assert not car.status(5.0).locked
    car.tell("unplugged", 6.0)
    assert not car.status(7.0).locked
    assert not car.status(7.0).enough


def test_a_permit_is_asked_for_about_the_port_and_renewed_before_it_ends():
    options = StationOptions()
    permission = Permission(options)
    assert permission.ask(0.0, None) is None
    port = SeenPort("type2", 0.9, PORT, np.diag([1e-6, 1e-6, 4e-6, 1e-4, 1e-4, 1e-4]), False)
    permission.see(port, 1.0, 0.002)
    first = permission.ask(1.0, None)
    assert first.kind == "thing"
    assert first.parts == ("tool",)
    sides = first.region.distance(PORT[:3, 3][None], 1.0)
    assert sides[0] == pytest.approx(-options.aside)
    sigma = np.sqrt(np.linalg.eigvalsh(first.region.covariance)[-1])
    assert sigma == pytest.approx(np.hypot(0.002, 0.002))
    assert first.out == pytest.approx(PORT[:3, 2]), "a socket has one way out"
    later = permission.ask(1.0 + RENEW + 0.1, None)
    assert later.name != first.name
    assert first.seconds > RENEW + 10.0


def test_a_permit_is_not_renewed_while_the_plug_presses_hard():
    """What is felt before a permit is granted speaks against it: the plug stood without one."""
    permission = Permission(StationOptions())
    port = SeenPort("type2", 0.9, PORT, np.diag([1e-6] * 3 + [1e-4] * 3), False)
    permission.see(port, 1.0, 0.002)
    first = permission.ask(1.0, None)
    permit = Permit(first.name, "thing", PermitState.GRANTED, pressed=80.0)
    late = 1.0 + RENEW + 0.1
    assert permission.ask(late, SimpleNamespace(permit=permit)).name == first.name
    permit = replace(permit, pressed=20.0)
    assert permission.ask(late, SimpleNamespace(permit=permit)).name != first.name


@pytest.mark.parametrize("depth", [0.005, 0.020, 0.035])
@pytest.mark.parametrize("name", ["ur10_charging", "ur10_charging_ccs2", "ur10_charging_lid"])
def test_a_permit_that_is_lost_in_the_socket_brings_the_plug_out_along_its_axis_alone(name, depth):
    """It was led away from the middle of what may be touched: at 20 mm, 110 deg off the axis."""
    cell = load(name)
    robot = robot_in(cell)
    T = np.asarray(inverse(cell.robot.T_world_base) @ cell.simulation.car.pose)
    permission = Permission(StationOptions())
    permission.see(SeenPort("type2", 0.9, T, 1e-6 * np.eye(6), False), 0.0, 0.002)
    asked = permission.ask(0.0, None)
    q = solve_ik(robot, before_port(T, -depth), robot.home, np.random.default_rng(0))[0]
    body, executed = MovingBody(robot, robot.limits.acceleration), Executed()
    executed.add(q)
    grant = Grant(asked.region, touching(robot, asked), out=asked.out, force=asked.force)
    retreat = Retreat("a test", grant, executed, q, 0.0)

    def goes(push):
        return tcp_jacobian(robot, q) @ retreat.motion(body, q, 0.1, 0.045, push)

    free = goes(np.zeros(3))
    assert free[:3] @ T[:3, 2] > 0.99 * np.linalg.norm(free[:3])
    assert np.linalg.norm(free[3:]) < np.deg2rad(0.1)
    assert 0.02 < np.linalg.norm(free[:3]) < 0.045
    held = goes(-0.8 * asked.force * T[:3, 2])
    assert held == pytest.approx(0.2 * free, abs=1e-9), "slower where it pulls hard"
    assert not goes(-asked.force * T[:3, 2]).any(), "no harder than it was granted"
    assert not goes(None).any(), "nothing is pulled that nobody feels"


def test_pictures_that_show_nothing_are_said():
    lens = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
    good = RNG.integers(0, 255, (48, 64, 3)).astype(np.uint8)
    assert picture_fault(good, good, lens, lens) == ""
    assert "covered" in picture_fault(good, np.full_like(good, 7), lens, lens)
    assert "right picture is 32x48" in picture_fault(good, good[:, :32], lens, lens)
    assert PortEye("post", ("type2",)).on_demand


@pytest.mark.parametrize(
    ("newton", "words"),
    [
        (30.0, ""),
        (4.0, "weighs 4 N, with its cable 31 are expected: it is missing"),
        (55.0, "caught"),
    ],
)
def test_a_plug_that_is_gone_and_a_cable_that_is_caught_are_felt(newton, words):
    feeling = Feeling(np.eye(4), Admittance())
    for k in range(100):
        force = np.array([0.0, -newton - 0.01 * (k % 3), 0.0])
        seen = SimpleNamespace(wrench=Wrench(0.01 * k, force, np.zeros(3)))
        feeling.take(seen)
    said = feeling.not_ours(31.0)
    assert words in said
    assert bool(words) == bool(said)
