"""What stands in for hardware in wall-loop behaves as hardware; its rows say what was measured."""

import math
import time

import numpy as np
import pytest

from armsight.devices.port import ArmSettings, CameraSettings
from armsight.experiments import wall_lab, wall_loop
from armsight.experiments.wall_lab import Arm, Camera, LabArm, moved, record
from armsight.experiments.wall_lab_kernels import draw
from armsight.robots import load_robot
from armsight.runtime.shared_block import SharedBlock
from armsight.workcell import open_cell, simulated_world

SIX = np.ones(6)


@pytest.fixture
def lab():
    block = SharedBlock(size=LabArm.needs())
    arm = LabArm(block)
    yield block, arm
    arm.close()
    block.close()


def test_the_arm_moves_as_small_steps_of_a_ramp_do():
    q, v, target = np.zeros(6), 0.3 * SIX, np.array([0.5, -0.5, 0.0, 0.3, 1.0, 0.29])
    most, dt = 2.0 * SIX, 1e-4
    stepped, speed = q.copy(), v.copy()
    for _ in range(4000):
        speed = speed + np.clip(target - speed, -most * dt, most * dt)
        stepped = stepped + speed * dt
    at, fast = moved(q, v, target, most, 0.4)
    assert at == pytest.approx(stepped, abs=2e-4)
    assert fast == pytest.approx(speed, abs=1e-9)


def test_the_arm_notes_its_commands_and_rests_when_none_come(lab):
    block, arm = lab
    arm.place(0.1 * SIX)
    names, connection = tuple("abcdef"), {"lab": block.name, "robot": "ur5"}
    driver = Arm(ArmSettings("a", connection, names, SIX, 5.0 * SIX, 500.0, 0.1))
    assert driver.read().position == pytest.approx(0.1 * SIX)
    before = time.perf_counter()
    driver.command_velocity(0.2 * SIX)
    (noted,) = arm.commands()
    assert before <= noted <= time.perf_counter()
    far, speed = arm.joints(noted + 10.0)  # its watchdog has ended the motion
    assert speed == pytest.approx(np.zeros(6), abs=1e-12)
    # Ramps of 0.04 s up and down about 0.06 s at speed, all at 0.2 rad/s at most.
    assert far == pytest.approx((0.1 + 0.2 * 0.1) * SIX, abs=1e-6)
    driver.stop()
    stopped = arm.commands()[-1]
    _, speed = arm.joints(stopped)
    _, slower = arm.joints(stopped + 0.005)
    braked = load_robot("ur5").limits.acceleration * 0.005  # as its guard is told that it can
    assert slower == pytest.approx(np.maximum(speed - braked, 0.0), abs=1e-9)
    driver.close()


def test_a_triangle_hides_what_is_behind_it_and_nothing_else():
    recorded = np.full((40, 60), 2.0, np.float32)
    recorded[:, 50:] = np.nan
    quiet = np.zeros_like(recorded)
    corners = np.array([[-0.2, -0.2, 1.0], [0.2, -0.2, 1.0], [-0.2, 0.2, 1.5], [5.0, 0.0, 3.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    out = np.empty_like(recorded)
    draw(recorded, quiet, (0.0, 0.0, 0.0), corners[:3], faces[:1], (50.0, 50.0, 30.0, 20.0), out)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    v, u = np.mgrid[:40, :60]
    rays = np.stack([(u - 30.0) / 50.0, (v - 20.0) / 50.0, np.ones((40, 60))], axis=-1)
    plane = (normal @ corners[0]) / (rays @ normal)
    hit = out < 1.9
    assert 150 < hit.sum() < 400
    assert out[hit] == pytest.approx(plane[hit], abs=1e-6)
    assert np.array_equal(out[~hit], recorded[~hit], equal_nan=True)
    farther = np.full_like(recorded, 0.5)  # something stands before the triangle
    draw(farther, quiet, (0.0, 0.0, 0.0), corners[:3], faces[:1], (50.0, 50.0, 30.0, 20.0), out)
    assert np.array_equal(out, farther)


def test_a_drawn_picture_is_what_the_simulator_shows(lab, tmp_path):
    block, arm = lab
    cell_file = wall_loop._empty()
    one = cell_file.model_copy(update={"camera": cell_file.camera[:1]})
    goals = list(one.goals.values())
    q = 0.5 * (goals[0] + goals[-1])
    with open_cell(one, 0) as cell:
        record(cell, goals[0], 1, tmp_path)
        world = simulated_world(cell)
        seen = None
        for _ in range(100):
            world.show_joints(q)
            world.advance(world.clock.now() + 0.004)
            frame = cell.cameras[0].read()
            seen = frame.depth if frame is not None else seen
    arm.place(q)
    driven = wall_loop.behind_drivers(one, block.name, tmp_path).camera[0]
    camera = Camera(CameraSettings(driven.name, driven.connection, driven.rate_hz))
    reading = camera.read()
    camera.close()
    both = np.isfinite(seen) & np.isfinite(reading.depth)
    assert both.mean() > 0.8
    same = np.abs(seen - reading.depth)[both] < 0.06
    assert same.mean() > 0.99
    empty = np.load(tmp_path / f"{driven.name}.npy")[0]
    drawn = np.isfinite(reading.depth) & ~(reading.depth > empty - 0.15)
    assert drawn.sum() > 2000
    assert (np.abs(seen - reading.depth)[drawn] < 0.06).mean() > 0.85


def window(ms, goals, failure=""):
    return wall_loop.Window(20.0, 1e-3 * np.asarray(ms, float), goals, failure, 0.5)


def test_rows_tell_intervals_goals_and_what_ended_too_early():
    windows = {
        ("process", "alone"): window([8.0] * 99 + [30.0], 10),
        ("process", "busy"): window([8.0] * 99 + [90.0], 6),
        ("threads", "alone"): window([50.0] * 100, 4),
        ("threads", "busy"): window([500.0] * 10, 0, "arm: lost"),
    }
    rows = {row.key: row for row in wall_loop._rows(windows)}
    assert rows["tick_max_ms"].value == pytest.approx(30.0)
    assert rows["tick_max_ms"].met
    assert rows["tick_busy_max_ms"].value == pytest.approx(90.0)
    assert rows["busy_goals_share"].value == pytest.approx(0.6)
    assert rows["busy_goals_share"].met
    assert rows["tick_threads_ms"].value == pytest.approx(50.0)
    assert math.isnan(rows["tick_threads_busy_max_ms"].value)  # cut short: no greatest interval
    assert "arm: lost" in rows["tick_threads_busy_max_ms"].why
    assert rows["busy_goals_threads_share"].value == 0.0
    assert any("arm: lost" in note for note in wall_loop._notes(windows))


def test_a_lab_that_is_gone_is_said_so():
    from armsight.errors import DeviceError

    with pytest.raises(DeviceError, match="the lab of wall-loop is gone"):
        wall_lab._attach({"lab": "no-such-lab"})
