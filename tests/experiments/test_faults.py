"""``faults``: what goes wrong does so as it is said, and its rows say what was seen."""

import math
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armsight.devices.data import JointState, RgbdFrame
from armsight.experiments import faults, faults_kill, faults_parts, faults_run
from armsight.experiments.faults_cases import CASES
from armsight.experiments.faults_devices import DRIFT, OFF, Trouble, TroubledArm, TroubledCamera
from armsight.experiments.faults_lab import SIZE, SharedTrouble, set_trouble
from armsight.experiments.faults_parts import STALL, FullDisk, Stall, TroubledMap, TroubledTime
from armsight.experiments.faults_rows import contact_row, kill_rows, lie_rows, other_rows
from armsight.experiments.wall_lab import LabArm
from armsight.motion.data import GuardMode, GuardStatus
from armsight.recording import messages
from armsight.recording.mcap_file import McapWriter
from armsight.recording.status_messages import guard_to_status
from armsight.runtime.shared_block import SharedBlock

BY_NAME = {case.name: case for case in CASES}


def trouble(name, jump=0.5):
    return Trouble(name, jump, 1, -1.0, begin=1.0, end=3.0)


class Clock:
    time = 0.0

    def now(self):
        return self.time


class Drives:
    """Moves on at 0.5 rad/s, and notes what it is told."""

    def __init__(self, clock):
        self.clock, self.told = clock, []

    def read(self):
        return JointState(self.clock.time, np.full(3, 0.5 * self.clock.time), np.full(3, 0.5))

    def command_velocity(self, velocity):
        self.told.append(np.array(velocity))
        return velocity

    def stop(self):
        self.told.append("stop")


def arm(name, jump=0.5):
    clock = Clock()
    drives = Drives(clock)
    return clock, drives, TroubledArm(drives, clock, trouble(name, jump))


def test_every_case_has_a_name_of_its_own_and_words():
    assert len(BY_NAME) == len(CASES)
    assert all(case.named and all(case.named) for case in CASES)
    assert len(CASES) % faults_kill.LINKS == 0


@pytest.mark.parametrize("name", ["still", "off", "drifts", "arm_back", "late"])
def test_before_and_after_an_arm_says_what_is_so(name):
    clock, drives, told = arm(name)
    for clock.time in (0.5, 3.0, 4.0):
        now, true = told.read(), drives.read()
        assert now.stamp == true.stamp
        assert now.position == pytest.approx(true.position)
        told.command_velocity(np.ones(3))
        assert drives.told[-1] == pytest.approx(np.ones(3))


def test_readings_stand_still_under_fresh_stamps():
    clock, _, told = arm("still")
    clock.time = 0.9
    before = told.read()
    for clock.time in (1.0, 2.0):
        now = told.read()
        assert now.stamp == clock.time
        assert now.position == pytest.approx(before.position)
        assert not now.velocity.any()


def test_readings_are_off_at_once_or_drift_there_as_their_speed_says():
    clock, drives, told = arm("off")
    clock.time = 1.0
    assert told.read().position - drives.read().position == pytest.approx([0.0, -OFF, 0.0])
    clock, drives, told = arm("drifts")
    clock.time = 1.0 + 0.25 * DRIFT
    now = told.read()
    assert now.position - drives.read().position == pytest.approx([0.0, -0.25 * OFF, 0.0])
    assert now.velocity - 0.5 == pytest.approx([0.0, -OFF / DRIFT, 0.0])
    clock.time = 1.5 + DRIFT
    assert told.read().position - drives.read().position == pytest.approx([0.0, -OFF, 0.0])
    assert told.read().velocity == pytest.approx(0.5)


def test_an_arms_clock_jumps():
    clock, _, told = arm("arm_back", -0.7)
    clock.time = 1.5
    assert told.read().stamp == pytest.approx(0.8)


def test_commands_are_lost_or_one_joint_does_not_follow():
    clock, drives, told = arm("deaf")
    clock.time = 1.5
    assert told.command_velocity(np.ones(3)) == pytest.approx(np.ones(3)), "it says that it did"
    told.stop()
    assert not drives.told
    clock, drives, told = arm("stuck")
    clock.time = 1.5
    assert told.command_velocity(np.ones(3)) == pytest.approx(np.ones(3))
    told.stop()
    assert drives.told[0] == pytest.approx([1.0, 0.0, 1.0])
    assert drives.told[1] == "stop"


def test_a_cameras_clock_jumps_and_nothing_else_changes():
    clock = Clock()
    frame = RgbdFrame("c", 0, 0.1, 0.12, np.zeros((2, 2), np.float32))
    camera = SimpleNamespace(read=lambda: replace(frame, stamp=clock.time), info="its info")
    told = TroubledCamera(camera, clock, trouble("camera_ahead", 0.4))
    assert told.info == "its info"
    for clock.time, stamp in ((0.5, 0.5), (1.5, 1.9), (3.5, 3.5)):
        assert told.read().stamp == pytest.approx(stamp)
    camera.read = lambda: None
    assert told.read() is None


class Map:
    def __init__(self):
        self.times = []

    def update(self, frames, joints, now, tracked=None):
        self.times.append(now)
        return len(self.times)


def test_a_map_raises_at_pictures_or_says_nothing_new():
    inner = Map()
    told = TroubledMap(inner, trouble("map_raises"))
    assert told.update(["a"], None, 0.5) == 1
    assert told.update([], None, 1.5) == 2, "without a picture there is nothing to do"
    with pytest.raises(ValueError, match="broadcast"):
        told.update(["a"], None, 1.5)
    hung = []
    told = TroubledMap(Map(), trouble("map_hangs"), lambda: hung.append(True))
    first = told.update(["a"], None, 0.5)
    assert told.update(["a"], None, 1.5) == first
    assert hung
    assert told.update(["a"], None, 3.5) == first + 1


def test_a_map_that_eats_memory_is_told_that_there_is_none(monkeypatch):
    monkeypatch.setattr(faults_parts, "BITE", 4 << 20)
    monkeypatch.setattr(faults_parts, "ROOM", 256 << 20)
    told = TroubledMap(Map(), trouble("map_eats"))
    with pytest.raises(MemoryError):
        told.update(["a"], None, 1.5)
    assert np.ones(512 << 20, np.uint8).all(), "there is some again"


def test_map_and_guard_are_told_another_time():
    inner = Map()
    told = TroubledTime(inner, trouble("clock_ahead", 2.0))
    inner.step = lambda now, *rest: (now, rest)
    for now, expected in ((0.5, 0.5), (1.5, 3.5), (3.0, 3.0)):
        told.update([], None, now)
        assert inner.times[-1] == expected
        assert told.step(now, 1, 2) == (expected, (1, 2))


def test_the_loop_stands_once():
    stood = []
    stall = Stall(trouble("late"), stood.append)
    for now in (0.5, 1.0, 1.5, 3.5):
        stall.update(now)
    assert stood == [1.0 + STALL]
    Stall(trouble("still"), stood.append).update(1.5)
    assert len(stood) == 1


def test_a_full_disk_has_room_again_afterwards(tmp_path):
    file = tmp_path / "a"
    file.write_bytes(bytes(10_000))
    disk = FullDisk(trouble("disk"), file)
    disk.update(1.5)
    try:
        with pytest.raises(OSError, match=r".*"), file.open("ab", buffering=0) as more:
            more.write(bytes(100))
    finally:
        disk.update(3.5)
    with file.open("ab", buffering=0) as more:
        assert more.write(bytes(100)) == 100


def test_what_another_process_writes_down_has_begun():
    block = SharedBlock(size=SIZE)
    about = {"case": "still", "jump": 0.1, "joint": 2, "sign": 1.0}
    shared = SharedTrouble(SharedBlock(block.name), about)
    assert not shared.at(5.0)
    set_trouble(block, 77.0)
    assert shared.at(5.0), "whatever its clock says"
    assert shared.begin == 5.0
    block.close()


def test_an_arm_stands_when_its_watchdog_has_stopped_it():
    block = SharedBlock(size=LabArm.needs())
    lab = LabArm(block)
    try:
        lab.command(np.full(6, 0.5), 0.1, np.full(6, 5.0))
        at = float(lab.commands()[-1])
        time.sleep(max(at + 0.3 - time.perf_counter(), 0.0))
        # 0.5 rad/s are reached and left within 0.1 s each; below 0.05 rad/s it stands.
        assert faults_kill.stood_after(lab, at) == pytest.approx(0.1 + 0.09, abs=0.005)
    finally:
        lab.close()
        block.close()


# -- rows -------------------------------------------------------------------------------------


def other(case, **changes):
    good = {"case": case, "named": 0.1, "stood": 0.2, "recovered": True, "contacts": 0}
    return good | {"early": False, "jump": 0.1, "failure": "", "last": ""} | changes


def lie(kind, count, named, **changes):
    good = {"kind": kind, "count": count, "named": named, "early": 0, "recovered": True}
    return good | {"stop": 0.2, "contacts": 0} | changes


def found(rows):
    return {(row.key, row.condition): row for row in rows}


def test_what_nobody_named_and_what_did_not_recover_is_missed():
    results = [other(case.name) for case in CASES] * 2
    rows = found(other_rows(results))
    assert all(row.met for row in rows.values() if row.must is not None)
    results[0] = other(CASES[0].name, named=math.inf, recovered=False)
    results[1] = other(CASES[1].name, stood=math.inf)
    rows = {row.key: row for row in other_rows(results)}
    assert rows["unnoticed"].value == pytest.approx(1 / len(results))
    assert not rows["unnoticed"].met
    assert not rows["recovered"].met
    assert not rows["stop_s"].met
    assert rows["stop_s"].why == "one went on"
    assert rows["named_s"].value == pytest.approx(0.1), "of those that were named"


def test_a_fault_that_is_no_reason_to_stop_counts_in_no_stop():
    results = [other(case.name, stood=0.2 if case.stops else math.inf) for case in CASES]
    rows = {row.key: row for row in other_rows(results)}
    assert rows["stop_s"].value == 0.2
    assert "disk_stop_s" not in rows


def test_lies_contacts_and_kills():
    lies = [lie("far", 4, [0.1, 0.2, math.inf, 0.1]), lie("bump", 1, [0.1], recovered=False)]
    rows = {row.key: row for row in lie_rows(lies)}
    assert rows["unnoticed"].value == pytest.approx(1 / 5)
    assert rows["recovered"].value == 1.0, "a bumped one is not used until it is calibrated"
    assert rows["stop_s"].value == 0.2
    assert contact_row(lies, [other("still", contacts=2)]).value == 2
    kill = {
        "began": True, "stood": 0.15, "lost": 1.0, "readable": True, "gone": True, "again": True,
        "left": ["run.mcap.partial"], "case": "still", "who": "both",
    }  # fmt: skip
    bad = [
        kill | {"left": ["run.mcap", "run.mcap.partial"]},
        kill | {"lost": 2.0, "readable": False},
    ]
    rows = {row.key: row for row in kill_rows([kill, *bad, kill | {"again": False}])}
    assert rows["kill_files"].value == 0.5
    assert rows["kill_restart"].value == 0.75
    assert rows["kill_stop_s"].met
    assert rows["kill_lost_s"].value == 1.0, "of those that can be read"
    assert len(list(faults._notes([other("still", named=math.inf)], bad))) == 3


# -- a run ------------------------------------------------------------------------------------


def test_a_loop_that_stood_is_named_and_the_cell_goes_on(gl, monkeypatch):
    monkeypatch.setattr(faults_run, "BEGINS", (1.5, 1.6))
    result = faults_run.episode(3, list(BY_NAME).index("late"))
    assert result["named"] < STALL + 0.02
    assert "late" in result["words"]
    assert result["stood"] < 0.5
    assert result["recovered"]
    assert result["contacts"] == 0


def test_the_last_words_of_a_program_are_those_it_said_most_often(tmp_path):
    (tmp_path / "run0").mkdir()
    for name in ("run0", "run1"):
        (tmp_path / f"{name}.err").write_bytes(b"a warning\nTrouble: the last line\n")
    writer = McapWriter(tmp_path / "run0" / "run.mcap")
    for tick in range(10):
        mode, reason = (GuardMode.STOPPED, f"camera a is {200 + tick} ms old")
        if tick >= 7:
            mode, reason = GuardMode.IDLE, ""
        status = GuardStatus(
            0.1 * tick, mode, reason, "", False, np.zeros(6), 0.0, 1.0, 1.0, None, None, None, None,
            1, 0.1,
        )  # fmt: skip
        data = messages.encode_diagnostics([guard_to_status(status)], status.stamp)
        writer.write("/guard/status", messages.DIAGNOSTICS, data, tick, tick)
    writer.flush()
    words = faults_kill.last_words(tmp_path, "run0")
    assert words == "70% stopped camera a is # ms old; 30% idle; Trouble: the last line"
    assert "run1" in faults_kill.last_words(tmp_path, "run1")
