"""A session of doubles: data flows, latencies are charged, every end stops the arm."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from doubles import FakeGuard, FakeMap, FakePlanner, GoTo, make_cell, make_fake_parts

from armsight.devices.data import Wrench
from armsight.errors import CellBusyError, LoopError, UsageError
from armsight.runtime.config import SessionConfig, SessionMode
from armsight.runtime.lock import cell_lock
from armsight.runtime.parts import Parts
from armsight.runtime.session import Session


def session_of(cell=None, task=None, parts=None, **kwargs):
    make = make_fake_parts if parts is None else lambda cell, config: parts
    return Session(cell or make_cell(), task, make=make, **kwargs)


def test_runs_a_task_to_its_goal_and_stops_the_arm():
    cell = make_cell()
    session = session_of(cell, GoTo())
    session.run(10.0)
    assert cell.arm.q == pytest.approx([1.0, -1.0], abs=0.02)
    assert cell.arm.stops >= 1
    assert cell.arm.v == pytest.approx([0.0, 0.0])
    assert session.ended_by == "time"
    assert session.now() == pytest.approx(10.0)


def test_two_runs_are_the_same_bit_for_bit_warmed_up_or_not():
    logs = []
    for warm in (False, True):
        cell = make_cell()
        session = session_of(cell, GoTo(), seed=3)
        if warm:
            session.warm_up()
        session.run(2.0)
        logs.append(cell.arm.log)
    assert logs[0] == logs[1]


def test_reset_gives_the_same_run_again():
    cell = make_cell()
    session = session_of(cell, GoTo())
    session.run(2.0)
    first = list(cell.arm.log)
    cell.arm.log.clear()
    session.reset()
    session.run(2.0)
    assert cell.arm.log == first


def test_reset_while_running():
    cell = make_cell()
    session = session_of(cell, GoTo())
    session.post(lambda: None)
    done = []

    class Resetter:
        name, period = "resetter", 0.1

        def update(self, now):
            if now > 0.5 and not done:
                done.append(now)
                session.reset()

    session.observe(Resetter())
    session.run(1.0)
    assert cell.world.resets == 1
    assert session.now() == pytest.approx(1.0)


def test_snapshots_and_plans_become_visible_after_their_latency():
    guard = FakeGuard()
    parts = Parts(FakeMap(), FakePlanner(), guard)
    config = SessionConfig(mapping_latency=0.03, planning_latency=0.2, guard_latency=0.0)
    session_of(task=GoTo(), parts=parts, config=config).run(0.6)
    with_frame = next(i for i, call in enumerate(parts.workspace.calls) if call[1])
    first = next(s for s in guard.seen if s[2] is not None and s[2].sequence > with_frame)
    assert first[0] == pytest.approx(parts.workspace.calls[with_frame][0] + 0.03, abs=1e-9)
    requested = next(s[0] for s in guard.seen if s[3] is not None and s[1] is not None)
    planned = next(s[0] for s in guard.seen if s[4] is not None)
    assert planned >= requested + 0.2
    assert planned <= requested + 0.25


def test_measured_compute_time_is_charged():
    class SlowMap(FakeMap):
        def update(self, frames, joints, now, tracked=None):
            time.sleep(0.02)
            return super().update(frames, joints, now)

    guard = FakeGuard()
    parts = Parts(SlowMap(), FakePlanner(), guard)
    session_of(parts=parts, config=SessionConfig(charge="measured")).run(0.2)
    newer = [s for s in guard.seen if s[2] is not None]
    assert all(
        s[0] - s[2].stamp >= 0.02 for s in newer if parts.workspace.calls[s[2].sequence - 1][1]
    )


def test_a_dead_camera_is_reported_not_fatal():
    cell = make_cell()
    cell.cameras[0].dead = True
    session = session_of(cell, GoTo())
    session.run(0.5)
    problems = {h.name: h.problem for h in session.health()}
    assert "unplugged" in problems["sensing"]


def test_a_lost_arm_is_reported_and_the_guard_gets_no_new_joints():
    cell = make_cell()
    session = session_of(cell, GoTo())
    session.run(0.2)
    cell.arm.lost = True
    session.run(0.2)
    assert "check its cable" in session.view().guard.reason
    assert {h.name: h.problem for h in session.health()}["guard"]
    cell.arm.lost = False
    session.run(0.2)
    assert not {h.name: h.problem for h in session.health()}["guard"]


@pytest.mark.parametrize("wall", [False, True])
def test_a_failing_guard_stops_the_arm_and_says_so(wall):
    cell = make_cell()
    parts = Parts(FakeMap(), FakePlanner(), FakeGuard(fail_at=0.1))
    session = session_of(cell, GoTo(), parts, mode=SessionMode(wall=wall))
    with pytest.raises(LoopError, match="guard failed"):
        session.run(5.0)
    assert cell.arm.stops >= 1
    assert cell.arm.v == pytest.approx([0.0, 0.0])
    assert "on purpose" in {h.name: h.problem for h in session.health()}["guard"]


def test_a_failing_observer_stops_the_arm_too():
    cell = make_cell()

    class Bad:
        name, period = "bad", 0.1

        def update(self, now):
            raise KeyError("x")

    with pytest.raises(LoopError, match="bad"):
        session_of(cell, observers=[Bad()]).run(1.0)
    assert cell.arm.stops >= 1


def test_view_is_consistent_and_readable_by_another_thread():
    session = session_of(task=GoTo())
    session.run(0.3)
    view = session.view()
    assert view.running
    assert view.joints.stamp <= view.now
    assert view.guard.goal == "G"
    assert [f.camera for f in view.frames] == ["c"]
    names = {h.name for h in view.health}
    assert names == {"sensing", "mapping", "planning", "task/go", "guard"}
    seen = []
    thread = threading.Thread(target=lambda: seen.append(session.view()))
    thread.start()
    thread.join()
    assert seen


def test_pause_resume_stop_speed_and_drag_from_outside():
    cell = make_cell()
    session = session_of(cell, GoTo())
    session.set_speed(5.0)
    session.pause()
    runner = threading.Thread(target=session.run)
    runner.start()
    session.drag("box", np.array([1.0, 2.0, 3.0]))
    deadline = time.monotonic() + 10
    while not cell.world.dragged and time.monotonic() < deadline:
        time.sleep(0.001)
    assert cell.world.dragged == [("box", (1.0, 2.0, 3.0))]
    assert session.now() == 0.0
    session.resume()
    while session.now() < 0.05 and time.monotonic() < deadline:
        time.sleep(0.001)
    session.stop("page")
    runner.join(10)
    assert session.ended_by == "page"
    assert cell.arm.stops >= 1


def test_bad_speed_and_late_observers_are_refused():
    session = session_of()
    with pytest.raises(UsageError, match="above 0"):
        session.set_speed(0.0)
    session.run(0.01)
    with pytest.raises(UsageError, match="before"):
        session.observe(GoTo())


def test_wall_clock_runs_the_same_components_in_threads():
    cell = make_cell()
    session = session_of(cell, GoTo((0.1, -0.1)), mode=SessionMode(wall=True))
    session.run(0.6)
    assert cell.arm.stops >= 1
    assert cell.arm.log
    assert session.view().snapshot is not None
    with pytest.raises(UsageError, match="second"):
        session.set_speed(2.0)


@pytest.mark.parametrize("wall", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_in_order(number, wall):
    cell = make_cell()
    session = session_of(cell, GoTo(), mode=SessionMode(wall=wall))
    session.set_speed(1.0)
    timer = threading.Timer(0.2, lambda: os.kill(os.getpid(), number))
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    timer.start()
    try:
        session.run(30.0)
    finally:
        timer.cancel()  # a run that failed must not have the tests killed
        signal.signal(signal.SIGHUP, before)
    assert session.ended_by == number.name
    assert cell.arm.stops >= 1
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_who_told_us_to_ignore_a_hangup_is_obeyed():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
    try:
        session = session_of(task=GoTo())
        session.post(lambda: os.kill(os.getpid(), signal.SIGHUP))
        session.run(0.1)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert session.ended_by == "time"


@pytest.mark.parametrize("wall", [False, True])
def test_a_stop_during_the_preparation_is_heard(wall):
    cell, task = make_cell(), GoTo()
    session = session_of(cell, task, mode=SessionMode(wall=wall))
    stops = lambda *args: session.stop("page")  # noqa: E731
    task.warm_up = stops
    if not wall:
        session._say_empty = stops
    session.run(30.0)
    assert session.ended_by == "page"
    assert cell.arm.log == []


def test_what_a_task_does_to_what_it_sees_reaches_nobody_else():
    """``q = seen.joints.position; q += ...`` moved the arm in map and guard."""

    class Scribbler(GoTo):
        def update(self, seen):
            if seen.joints is not None:
                seen.joints.position += 7.0
                seen.joints.velocity[:] = 7.0
            if seen.wrench is not None:
                seen.wrench.force -= seen.wrench.force
            return super().update(seen)

    session = session_of(
        task=Scribbler(), parts=Parts(FakeMap(), FakePlanner(), guard := FakeGuard())
    )
    told = Wrench(0.0, np.ones(3), np.ones(3))
    session._channels.readings.put(told)
    session.run(0.5)
    assert max(np.abs(s[1].position).max() for s in guard.seen if s[1] is not None) < 1.1
    assert max(np.abs(s[1].velocity).max() for s in guard.seen if s[1] is not None) < 1.1
    assert told.force == pytest.approx(np.ones(3))


def test_one_cell_one_process():
    code = (
        "import sys, time; from armsight.runtime.lock import cell_lock\n"
        "with cell_lock('fake'):\n print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline().strip() == "held"
        with pytest.raises(CellBusyError, match=rf"process {other.pid} \(cell 'fake'\) is working"):
            session_of(mode=SessionMode(exclusive=True)).run(0.1)
        session_of().run(0.1)  # simulated cells share unless asked not to
        other.stdin.close()
        other.wait(10)
    session_of(mode=SessionMode(exclusive=True)).run(0.1)
    with cell_lock("fake"), pytest.raises(CellBusyError):
        session_of(mode=SessionMode(exclusive=True)).run(0.1)
