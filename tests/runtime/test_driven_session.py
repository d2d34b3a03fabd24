"""A session on real devices: whatever a driver does, the run ends in order and says why."""

import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "devices"))
from doubles import FakeMap, GoTo, make_cell, make_fake_parts
from port_doubles import ArmDouble, CameraDouble, Log

from armsight.devices.clock import WallClock
from armsight.devices.data import RgbdCameraInfo
from armsight.devices.driven_arm import DrivenArm
from armsight.devices.driven_cameras import DrivenCamera
from armsight.devices.port import ArmSettings, CameraSettings
from armsight.errors import CellBusyError, DeviceError, LoopError, UsageError
from armsight.robots.robot import JointLimits
from armsight.runtime.config import SessionMode
from armsight.runtime.parts import Parts
from armsight.runtime.session import Session
from armsight.workcell import Cell

TWO = np.ones(2)
LIMITS = JointLimits(-9.0 * TWO, 9.0 * TWO, 2.0 * TWO, 9.0 * TWO, 99.0 * TWO)


def driven_cell(arm_hangs=(), camera_hangs=(), guard=True, name="driven", connection=None):
    """A cell of doubles behind drivers, the doubles, and what was asked of them."""
    log, made, clock = Log(), {}, WallClock()

    def arm(settings):
        made["arm"] = ArmDouble(settings, log, arm_hangs, n=2)
        return made["arm"]

    def camera(settings):
        made["camera"] = CameraDouble(settings, Log(), camera_hangs)
        return made["camera"]

    def describe(r):
        return RgbdCameraInfo(
            "c", r.model, r.depth, None, np.eye(4), "base", np.eye(4), r.rate, 0.0, r.range,
            r.noise, guard=guard,
        )  # fmt: skip

    settings = ArmSettings("double", connection or {}, ("a", "b"), TWO, TWO, 250.0, 0.3)
    cell = Cell(
        SimpleNamespace(name=name),
        SimpleNamespace(name="double"),
        np.eye(4),
        clock,
        DrivenArm(settings, LIMITS, arm, clock),
        (DrivenCamera(CameraSettings("c"), camera, describe, clock),),
        (),
    )
    return cell, made, log


def after(seconds, action):
    threading.Timer(seconds, action).start()


def test_a_real_cell_runs_its_task_and_its_arm_is_told_to_stop():
    cell, _, log = driven_cell()
    with cell:
        session = Session(cell, GoTo((0.05, -0.05)), make=make_fake_parts)
        assert session.wall
        session.run(1.0)
        assert session.view().joints.position == pytest.approx([0.05, -0.05], abs=0.03)
        assert session.view().readings[0].mode == "running"
        assert {d.stage for d in session.view().devices} == {"open"}
    assert [c[0] for c in log.calls[-2:]] == ["stop", "close"]


HERE = {"host": "198.51.100.7", "port": 7001}


@pytest.mark.parametrize(
    ("name", "connection", "same"),
    [
        ("left", HERE, True),
        ("right", HERE, True),
        ("right", {**HERE, "host": "198.51.100.7 ", "timeout": 2.0}, True),
        ("right", {**HERE, "port": 7002}, False),
        ("left", {**HERE, "host": "198.51.100.8"}, False),
    ],
)
def test_two_cells_cannot_drive_one_arm(name, connection, same):
    cell, _, _ = driven_cell(name="left", connection=HERE)
    with cell, driven_cell(name=name, connection=connection)[0] as other:
        session = Session(cell, GoTo((0.05, -0.05)), make=make_fake_parts)
        second = Session(other, GoTo((0.05, -0.05)), make=make_fake_parts)
        after(1.0, lambda: session.stop("enough"))
        errors = []

        def run_second():
            try:
                second.run(0.1)
            except CellBusyError as error:
                errors.append(str(error))

        beside = threading.Timer(0.5, run_second)
        beside.start()
        session.run(5.0)
        beside.join()
    assert bool(errors) == same
    if same:
        assert "host=198.51.100.7" in errors[0]
        assert "(cell 'left') is working with it already" in errors[0]


@pytest.mark.parametrize("what", ["read", "command", "stop", "close"])
def test_an_arm_that_hangs_ends_the_run_with_its_reason(what):
    cell, made, log = driven_cell()
    task = GoTo((5.0, 5.0))

    def run():
        with cell:
            Session(cell, task, make=make_fake_parts).run(
                3.0 if what in ("read", "command") else 0.3
            )

    after(0.2, lambda: made["arm"].hangs.add(what))
    began = time.monotonic()
    with pytest.raises((LoopError, DeviceError)) as told:
        run()
    print(f"\n{what}: {time.monotonic() - began:.2f} s")
    name = "command_velocity" if what == "command" else what
    assert f"arm double: {name}() has not returned" in str(told.value)
    assert log.count("stop") >= 1


def test_both_an_arm_that_is_lost_and_one_that_cannot_be_stopped_are_told():
    cell, made, _ = driven_cell(arm_hangs=("stop",))
    after(0.2, lambda: made["arm"].hangs.add("read"))
    with pytest.raises(LoopError) as told, cell:
        Session(cell, GoTo((5.0, 5.0)), make=make_fake_parts).run(3.0)
    assert "read() has not returned" in str(told.value)
    assert "stop() has not returned" in str(told.value)


@pytest.mark.parametrize("wall", [False, True])
def test_an_arm_that_raises_for_long_ends_the_run_of_a_simulated_cell_too(wall):
    cell = make_cell()
    cell.arm.lost = True
    session = Session(cell, GoTo(), make=make_fake_parts, mode=SessionMode(wall=wall))
    with pytest.raises(LoopError, match=r"check its cable .the arm has not answered for 0.5 s"):
        session.run(10.0)
    assert session.now() < 5.0
    assert cell.arm.stops >= 1


def test_a_camera_that_hangs_is_named_and_the_run_goes_on():
    cell, made, _ = driven_cell()
    with cell:
        after(0.2, lambda: made["camera"].hangs.add("read"))
        session = Session(cell, GoTo((0.05, 0.0)), make=make_fake_parts)
        session.run(1.6)
        problems = {h.name: h.problem for h in session.health()}
        assert "camera 'c': read() has not returned" in problems["sensing"]
        assert session.ended_by == "time"


def test_looking_is_not_touching():
    cell, _, log = driven_cell()
    with cell:
        session = Session(cell, None, make=make_fake_parts, mode=SessionMode(look_only=True))
        session.run(0.5)
        session.pause()
        session.run(0.1)
        assert session.view().joints is not None
    assert [call[0] for call in log.calls] == ["open", "close"]


def test_a_silent_guard_is_noticed_without_the_supervisor_waiting_for_the_arm():
    cell, _, log = driven_cell(arm_hangs=("stop",))

    class Sleeper:
        seen = 0

        def step(self, now, joints, snapshot, goal, plan):
            self.seen += 1
            if self.seen == 10:
                time.sleep(1.0)
            return make_fake_parts(None, None).guard.step(now, joints, snapshot, None, None)

    fake = make_fake_parts(None, None)
    parts = Parts(FakeMap(), fake.planner, Sleeper())
    with pytest.raises((DeviceError, LoopError), match=r"stop\(\) has not returned"), cell:
        Session(cell, None, make=lambda c, s: parts).run(5.0)
    assert log.count("stop") == 1


def test_what_a_guard_decided_before_it_hung_is_not_sent():
    cell, _, log = driven_cell()
    fake = make_fake_parts(None, None)
    told = []

    class Sleeper:
        ticks = 0

        def step(self, *inputs):
            self.ticks += 1
            decision = fake.guard.step(*inputs)
            slow = self.ticks == 10
            if slow:
                time.sleep(0.5)
                told.append(len(log.calls))
            decision.command = np.array([0.3, 0.3]) if slow else np.zeros(2)
            return decision

    parts = Parts(FakeMap(), fake.planner, Sleeper())
    with cell:
        Session(cell, None, make=lambda c, s: parts).run(1.2)
    assert log.calls[told[0]][0] == "stop"
    assert not any(np.any(v) for what, v in log.calls if what == "command")


@pytest.mark.parametrize("guard", [True, False])
def test_a_camera_without_guard_is_shown_and_is_no_evidence(guard):
    cell, _, _ = driven_cell(guard=guard)
    assert len(cell.guard_cameras) == guard
    parts = make_fake_parts(None, None)
    with cell:
        session = Session(cell, None, make=lambda c, s: parts)
        session.run(0.4)
        assert [f.camera for f in session.view().frames] == ["c"]
    mapped = [frames for _, frames, _ in parts.workspace.calls if frames]
    assert bool(mapped) == guard


def test_time_cannot_be_turned_back_in_a_real_cell():
    cell, _, _ = driven_cell()
    with cell, pytest.raises(UsageError, match="only a simulated"):
        Session(cell, None, make=make_fake_parts).reset()
