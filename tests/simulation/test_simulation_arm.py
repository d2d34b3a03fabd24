"""The simulated arm: delay, limits, braking, watchdog, readings."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from simulation_cells import TABLE

from armsight.errors import DeviceError
from armsight.geometry.pose import from_rpy, inverse, make_pose, transform
from armsight.robots import load_robot
from armsight.robots.meshes import read_mesh
from armsight.simulation.arm_errors import true_geometry
from armsight.simulation.spec import ArmSpec, WorldSpec
from armsight.simulation.world import SimulatedWorld

DT = 0.002


def drive(world, velocity, seconds, period=0.02):
    """Command a velocity again and again; returns (k, n) true positions, one a step."""
    start = world.clock.now()
    track = []
    for k in range(round(seconds / period)):
        world.arm.command_velocity(np.asarray(velocity, float))
        for i in range(round(period / DT)):
            world.advance(start + k * period + (i + 1) * DT)
            track.append(world._data.qpos[:6].copy())
    return np.array(track)


def speeds(track):
    return np.diff(track, axis=0) / DT


def test_stands_still_at_home_without_commands(cell, robot):
    cell.advance(1.0)
    assert np.allclose(cell._data.qpos[:6], robot.home, atol=1e-4)
    assert cell.arm.joint_names == robot.joint_names


@pytest.mark.parametrize("delay", [0.0, 0.06])
def test_first_motion_comes_after_the_start_delay(arm_spec, delay):
    with SimulatedWorld(WorldSpec(replace(arm_spec, start_delay=delay))) as world:
        world.advance(0.5)
        track = drive(world, [0.5, 0, 0, 0, 0, 0], 0.3)
        moved = np.flatnonzero(np.abs(track[:, 0] - arm_spec.home[0]) > 1e-5)[0] * DT
        assert moved == pytest.approx(delay, abs=0.008)
        assert moved >= delay - DT


def test_follows_its_reference_within_a_milliradian(cell):
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(12):
        velocity = rng.uniform(-1, 1, 6)
        for _ in range(15):
            cell.arm.command_velocity(velocity)
            cell.advance(cell.clock.now() + 0.02)
            error = cell._data.qpos[:6] - cell.arm.reference_position
            worst = max(worst, np.abs(error).max())
    assert worst < 1e-3


def test_never_exceeds_speed_and_acceleration(cell, arm_spec):
    rng = np.random.default_rng(1)
    limits = arm_spec.robot.limits
    v_max, a_max = limits.velocity * arm_spec.speed, limits.acceleration * arm_spec.acceleration
    reference = []
    for _ in range(150):
        cell.arm.command_velocity(rng.uniform(-6, 6, 6))
        for _ in range(5):
            cell.advance(cell.clock.now() + DT)
            reference.append(cell.arm.reference_velocity.copy())
    reference = np.array(reference)
    assert np.all(np.abs(reference) <= v_max + 1e-9)
    assert np.all(np.abs(np.diff(reference, axis=0)) <= a_max * DT + 1e-9)
    assert np.abs(np.diff(reference, axis=0)).max() > 0.99 * a_max[0] * DT


def test_commands_are_slowed_as_one(cell, arm_spec):
    wanted = np.array([6.0, -3.0, 0.3, 0, 0, 0])
    sent = cell.arm.command_velocity(wanted)
    assert np.abs(sent).max() == pytest.approx(np.pi * arm_spec.speed)
    assert np.allclose(sent / sent[0], wanted / wanted[0])
    small = np.full(6, 0.1)
    assert np.array_equal(cell.arm.command_velocity(small), small)


@pytest.mark.parametrize("bad", [np.full(6, np.nan), np.zeros(5), np.array([np.inf] + [0] * 5)])
def test_nonsense_is_refused(cell, bad):
    with pytest.raises(DeviceError, match="6 finite numbers"):
        cell.arm.command_velocity(bad)


def test_stop_distance_is_delay_and_braking(cell, arm_spec):
    """x = v t_delay + v^2 / 2a at the drives' full deceleration."""
    drive(cell, [1.2, 0, 0, 0, 0, 0], 1.0)
    at_stop = cell._data.qpos[0]
    speed = cell._data.qvel[0]
    assert speed == pytest.approx(1.2, abs=0.01)
    cell.arm.stop()
    cell.advance(cell.clock.now() + 1.0)
    expected = speed * arm_spec.start_delay + speed**2 / (2 * arm_spec.robot.limits.acceleration[0])
    assert cell._data.qpos[0] - at_stop == pytest.approx(expected, abs=0.006)
    assert np.allclose(cell._data.qvel[:6], 0, atol=1e-3)
    cell.arm.stop()  # may be repeated


def test_watchdog_stops_a_silent_controller(cell, arm_spec):
    drive(cell, [0.5, 0, 0, 0, 0, 0], 0.5)
    before = cell._data.qpos[0]
    cell.advance(cell.clock.now() + 2.0)
    ran = cell._data.qpos[0] - before
    expected = 0.5 * (arm_spec.start_delay + arm_spec.watchdog) + 0.5**2 / 16
    assert ran == pytest.approx(expected, abs=0.015)
    assert abs(cell._data.qvel[0]) < 1e-3


def test_comes_to_rest_at_joint_limits(robot, arm_spec):
    limits = replace(robot.limits, upper=np.full(6, 2.0))
    limited = replace(arm_spec, robot=replace(robot, limits=limits))
    with SimulatedWorld(WorldSpec(limited)) as world:
        drive(world, [1.5, 0, 0, 0, 0, 0], 2.5)
        assert world._data.qpos[0] <= 2.0 + 1e-3
        assert world._data.qpos[0] == pytest.approx(2.0, abs=2e-3)


def test_readings_are_late_and_a_little_noisy(arm_spec):
    with SimulatedWorld(WorldSpec(replace(arm_spec, state_latency=0.01))) as world:
        assert world.arm.read() is None
        drive(world, [0.5, 0, 0, 0, 0, 0], 0.5)
        now = world.clock.now()
        state = world.arm.read()
        assert state.stamp == pytest.approx(now - 0.01, abs=DT + 1e-9)
        assert state.stamp <= now - 0.01 + 1e-9
        assert state.position[0] == pytest.approx(
            world._data.qpos[0] - 0.5 * (now - state.stamp), abs=1e-3
        )
        assert state.velocity[0] == pytest.approx(0.5, abs=0.01)
        again = world.arm.read()
        assert np.array_equal(again.position, state.position)


def test_state_rate(arm_spec):
    with SimulatedWorld(WorldSpec(replace(arm_spec, state_rate=125.0))) as world:
        stamps = set()
        while world.clock.now() < 0.4:
            world.advance(world.clock.now() + DT)
            state = world.arm.read()
            if state is not None:
                stamps.add(round(state.stamp, 6))
        assert np.allclose(np.diff(sorted(stamps)), 0.008)


def test_effort_carries_the_weight(cell, robot):
    """At rest the shoulder holds the weight of what hangs on it: m g times the lever, by hand."""
    cell.advance(0.3)
    poses = cell.truth.link_poses()
    axis = poses[2][:3, :3] @ robot.axis[1]
    pivot = poses[2][:3, 3]
    torque = 0.0
    for link in range(2, 7):
        com = poses[link][:3, :3] @ robot.link_com[link] + poses[link][:3, 3]
        torque += axis @ np.cross(com - pivot, [0, 0, -9.81 * robot.link_mass[link]])
    assert cell.arm.read().effort[1] == pytest.approx(-torque, rel=0.02)


def test_a_lost_arm_says_so_and_stops(cell):
    drive(cell, [0.5, 0, 0, 0, 0, 0], 0.3)
    cell.arm.fail("cable cut")
    with pytest.raises(DeviceError, match="cable cut"):
        cell.arm.read()
    with pytest.raises(DeviceError, match="cable cut"):
        cell.arm.command_velocity(np.zeros(6))
    cell.advance(cell.clock.now() + 1.0)
    cell.arm.mend()
    assert np.allclose(cell.arm.read().velocity, 0, atol=0.005)


def test_repeatability_of_the_tip(arm_spec):
    """The reading says where the arm thinks it is; the tip is off by about the stated amount."""
    spec = replace(arm_spec, repeatability=0.001)
    errors = []
    with SimulatedWorld(WorldSpec(spec), seed=3) as world:
        velocity = np.array([0.6, 0.3, 0, 0, 0, 0])
        for k in range(14):
            drive(world, velocity * (-1) ** k, 0.6)
            world.arm.command_velocity(np.zeros(6))
            world.advance(world.clock.now() + 0.5)
            errors.append(world.arm.read().position - world._data.qpos[:6])
    sigma = np.std(np.array(errors)) * 0.85 * 1.1
    assert 0.0004 < sigma < 0.0018


def test_kinematic_errors_have_the_stated_size(robot):
    rng = np.random.default_rng(5)
    nominal = robot.T_link_joint
    assert np.array_equal(true_geometry(robot, 0.0, rng), nominal)
    shifts, angles = [], []
    for _ in range(200):
        T = true_geometry(robot, 1.0, rng)
        assert np.array_equal(T[0], nominal[0])
        shifts.append((T[2, :3, 3] - nominal[2, :3, 3])[1:])
        turn = nominal[2, :3, :3].T @ T[2, :3, :3]
        angles.append(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    assert np.std(shifts) == pytest.approx(0.0005, rel=0.15)
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(np.deg2rad(0.05), rel=0.15)


def test_sag_lets_the_stretched_arm_droop(robot):
    """Readings of a compliant arm at rest, stretched out, differ from truth by 0.4 mm at reach."""
    stretched = np.array([0, 0, 0, 0, 0, 0.0])
    base = ArmSpec(robot, make_pose(None, (0, 0, 1.5)), stretched, kinematic_error=1.0)
    with SimulatedWorld(WorldSpec(replace(base, repeatability=0.0))) as world:
        world.advance(0.3)
        off = world.arm.read().position - world._data.qpos[:6]
    tip = abs(off[1]) * robot.reach
    assert 0.0001 < tip < 0.0006


def test_a_blocked_arm_does_not_wind_up(arm_spec):
    """Driven into the table it pushes with limited force, and leaves at once when told to."""
    with SimulatedWorld(WorldSpec(arm_spec, static=(TABLE,))) as world:
        drive(world, [0, 0.8, 0, 0, 0, 0], 2.0)
        gap = np.abs(world.arm.reference_position - world._data.qpos[:6]).max()
        assert gap <= 0.03
        assert any(c.owner == "table" for c in world.truth.contacts)
        deepest = max(c.depth for c in world.truth.contacts)
        assert deepest < 0.02
        before = world._data.qpos[1]
        drive(world, [0, -0.8, 0, 0, 0, 0], 0.7)
        assert world._data.qpos[1] < before - 0.1


def link_box(world, robot, link):
    """Corners of the box about a link's meshes as they were compiled [m]."""
    model, data = world._cell.model, world._data
    body = model.body(f"arm/{link}/{robot.link_names[link]}").id
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        mesh = model.geom_dataid[geom]
        if mesh >= 0:
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            turn = data.geom_xmat[geom].reshape(3, 3)
            found.append(model.mesh_vert[first : first + count] @ turn.T + data.geom_xpos[geom])
    points = np.concatenate(found)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def test_meshes_of_a_urdf_in_millimetres_and_out_of_place_are_put_right(tmp_path):
    """``load_urdf`` gives a mesh's pose and scale; the same arm must come of it."""
    robot, link = load_robot("ur5"), 2
    arm_spec = ArmSpec(robot, make_pose(None, (0, 0, 0.75)), robot.home)
    T = make_pose(from_rpy([0.3, -0.2, 0.5])[:3, :3], [0.05, -0.1, 0.2])
    meshes = []
    for mesh in robot.meshes:
        if mesh.link == link:
            vertices, faces = read_mesh(mesh)
            away = transform(inverse(T), vertices) * 1000.0
            path = tmp_path / mesh.path.name
            trimesh.Trimesh(away, faces, process=False).export(path)
            mesh = replace(mesh, path=path, T_link_mesh=T, scale=(1e-3, 1e-3, 1e-3))
        meshes.append(mesh)
    moved = replace(arm_spec, robot=replace(robot, meshes=tuple(meshes)))
    with SimulatedWorld(WorldSpec(arm_spec)) as world, SimulatedWorld(WorldSpec(moved)) as other:
        boxes = [link_box(w, robot, link) for w in (world, other)]
    np.testing.assert_allclose(boxes[1], boxes[0], atol=2e-3)
    assert np.ptp(boxes[0], axis=0).max() > 0.1


def test_the_drives_push_with_what_the_urdf_says():
    """A UR10's wrists have 56 N m; by their accelerations alone it would be 7 to 9."""
    ur10 = load_robot("ur10")
    spec = WorldSpec(ArmSpec(ur10, make_pose(None, (0, 0, 0.75)), ur10.home))
    with SimulatedWorld(spec) as world:
        greatest = world._cell.model.jnt_actfrcrange[:6, 1]
    assert np.all(greatest >= [330, 330, 150, 56, 56, 56])
    assert np.allclose(greatest[3:], 56)
