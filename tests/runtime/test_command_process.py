"""The command path in a process of its own: whatever dies, the arm is told to stop."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parent))
from doubles import FakeGuard, GoTo
from process_doubles import Failing, NotedArm, StubbornArm, make_parts_for, snapshot

from armsight.devices.clock import WallClock
from armsight.devices.driven_arm import ArmRecipe, DrivenArm
from armsight.devices.port import ArmSettings
from armsight.errors import DeviceError, DeviceLostError, LoopError
from armsight.motion.data import PlanRequest
from armsight.motion.intents import JointIntent, Rest
from armsight.motion.plan import Plan
from armsight.robots.robot import JointLimits
from armsight.runtime import command_process
from armsight.runtime.channels import Channels, TaskWord
from armsight.runtime.command_link import CommandLink, movable
from armsight.runtime.command_messages import (
    Begin,
    Close,
    Closed,
    End,
    Ended,
    Halt,
    Halted,
    News,
    Open,
    Opened,
    Ready,
    Run,
    State,
    Times,
)
from armsight.runtime.command_process import CommandPath
from armsight.runtime.command_relay import CommandRelay, _plain
from armsight.runtime.config import SessionMode
from armsight.runtime.remote_arm import RemoteArm
from armsight.runtime.session import Session
from armsight.runtime.snapshot_memory import SnapshotWriter
from armsight.runtime.wire import Wire
from armsight.workcell import Cell

TWO = np.ones(2)
LIMITS = JointLimits(-9.0 * TWO, 9.0 * TWO, 2.0 * TWO, 9.0 * TWO, 99.0 * TWO)


def recipe(log, driver=NotedArm):
    settings = ArmSettings("double", {"log": str(log)}, ("a", "b"), TWO, TWO, 250.0, 0.3)
    return ArmRecipe(settings, LIMITS, driver)


def calls(log):
    """(process, call) of every line, in order."""
    lines = log.read_text(encoding="utf-8").splitlines()
    return [(int(pid), what) for pid, what in (line.split() for line in lines)]


def until(what, seconds=20.0):
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.005)


# --- the process's own code, here, over two pipes ------------------------------------------------


class Talk:
    """A command path in a thread, and the session's end of its pipes."""

    def __init__(self):
        (self.theirs, out), (inn, self.ours) = os.pipe(), os.pipe()
        self.path = CommandPath(Wire(os.fdopen(inn, "rb"), os.fdopen(out, "wb")))
        self.out = os.fdopen(self.ours, "wb")
        self.wire = Wire(os.fdopen(self.theirs, "rb"), self.out)
        self.thread = threading.Thread(target=self.path.serve, daemon=True)
        self.thread.start()
        self.states = []

    def ask(self, order, kind):
        self.wire.send(order)
        return self.get(kind)

    def get(self, kind):
        while True:
            word = self.wire.receive()
            if isinstance(word, State):
                self.states.append(word)
            if isinstance(word, kind):
                return word


def times():
    return Times(100.0, time.perf_counter())


@pytest.fixture
def talk(monkeypatch):
    monkeypatch.setattr(command_process, "raise_priority", lambda: "as it was")
    talk = Talk()
    yield talk
    talk.wire.close()
    talk.thread.join(5.0)
    assert not talk.thread.is_alive()


def begin(make=FakeGuard):
    return Begin(make, 0.004, 0.008, "go", 30.0)


def test_it_drives_where_the_task_wants_and_says_what_it_does(talk, tmp_path):
    log = tmp_path / "log"
    assert talk.ask(Open(recipe(log), times()), Opened).problem == ""
    assert talk.ask(begin(), Ready).problem == ""
    talk.wire.send(Run(times()))
    until(lambda: talk.get(State).status is not None)
    assert 100.0 <= talk.states[-1].status.stamp < 200.0  # the session's time
    goal = JointIntent("G", np.array([0.05, -0.05]))
    talk.wire.send(News(False, TaskWord(100.0, goal)))
    until(lambda: talk.get(State).request is not None)
    assert talk.states[-1].request.goal.name == "G"
    writer = SnapshotWriter()
    plan = SimpleNamespace(request=0, failure="")
    talk.wire.send(News(False, None, plan, ticket=writer.write(snapshot(4))))
    until(lambda: np.allclose(talk.get(State).joints.position, goal.position, atol=0.01))
    seen = talk.path._running.guard._guard.seen
    assert seen[-1][2].sequence == 4
    assert np.array_equal(seen[-1][2].distance, snapshot(4).distance)
    until(lambda: talk.get(State).health is not None)
    assert talk.states[-1].health.rounds > 10
    talk.wire.send(News(True))  # held: nothing is pursued
    until(lambda: seen[-1][3] is None)
    assert talk.ask(End(), Ended).problem == ""
    assert talk.ask(Close(), Closed).problem == ""
    assert [what for _, what in calls(log)][-2:] == ["stop", "close"]
    writer.close()


def test_a_word_that_is_too_old_is_not_pursued(talk, tmp_path):
    talk.ask(Open(recipe(tmp_path / "log"), times()), Opened)
    talk.ask(begin(), Ready)
    talk.wire.send(Run(times()))
    talk.wire.send(News(False, TaskWord(60.0, JointIntent("G", TWO))))
    running = talk.path._running
    until(lambda: any(isinstance(s[3], Rest) for s in running.guard._guard.seen))
    assert "task go has said nothing for" in running.guard._guard.seen[-1][3].reason


def test_it_stops_the_arm_when_its_session_is_gone(talk, tmp_path):
    log = tmp_path / "log"
    talk.ask(Open(recipe(log), times()), Opened)
    talk.ask(begin(), Ready)
    talk.wire.send(Run(times()))
    until(lambda: (0, "command") in [(0, what) for _, what in calls(log)])
    talk.wire.close()  # what a session that was killed leaves behind
    talk.thread.join(5.0)
    words = [what for _, what in calls(log)]
    assert words[-1] == "close"
    assert "stop" in words[words.index("command") :]


def test_a_run_that_is_ended_before_it_began_ends(talk, tmp_path):
    log = tmp_path / "log"
    talk.ask(Open(recipe(log), times()), Opened)
    talk.ask(begin(), Ready)
    for order in (Run(times()), End()):
        talk.wire.send(order)
    assert talk.get(Ended).problem == ""
    assert talk.ask(Run(times()), State).problem == ""  # and another begins
    until(lambda: talk.get(State).status is not None)


def test_a_guard_that_fails_ends_its_run_with_the_reason_and_the_arm_stopped(talk, tmp_path):
    log = tmp_path / "log"
    talk.ask(Open(recipe(log), times()), Opened)
    talk.ask(begin(Failing), Ready)
    assert "on purpose" in talk.ask(Run(times()), Ended).problem
    assert calls(log)[-1][1] == "stop"


def test_after_a_halt_nothing_is_commanded_until_another_run_begins(talk, tmp_path):
    """The session fails and says stop; that the run is over it says later."""
    log = tmp_path / "log"
    talk.ask(Open(recipe(log), times()), Opened)
    talk.ask(begin(), Ready)
    talk.wire.send(Run(times()))
    until(lambda: "command" in [what for _, what in calls(log)])
    assert talk.ask(Halt(1), Halted).problem == ""
    time.sleep(0.1)
    assert calls(log)[-1][1] == "stop"
    assert talk.ask(End(), Ended).problem == ""
    before = len(calls(log))
    talk.wire.send(Run(times()))
    until(lambda: "command" in [what for _, what in calls(log)[before:]])


def test_an_arm_that_cannot_be_stopped_is_said_so(talk, tmp_path):
    talk.ask(Open(recipe(tmp_path / "log", StubbornArm), times()), Opened)
    assert "no brakes" in talk.ask(Halt(7), Halted).problem


def test_an_arm_that_cannot_be_opened_is_said_so(talk, tmp_path):
    assert (
        "No such file" in talk.ask(Open(recipe(tmp_path / "no" / "log"), times()), Opened).problem
    )


# --- what is moved, and what is told -------------------------------------------------------------


def test_only_what_another_process_can_import_is_moved(tmp_path):
    class Local(NotedArm):
        pass

    assert movable(recipe(tmp_path))
    assert not movable(recipe(tmp_path, Local))
    assert not movable(recipe(tmp_path, lambda settings: NotedArm(settings)))


class Strange(JointIntent):
    """A stranger's own kind of intent."""


@pytest.mark.parametrize(
    "wanted", [Strange("G", TWO), "north", JointIntent("G", SimpleNamespace()), lambda: None]
)
def test_what_a_stranger_defines_is_refused_in_words_and_never_sent(wanted):
    word = _plain(TaskWord(1.0, wanted))
    assert isinstance(word.intent, Rest)
    assert word.intent.fault


def test_orders_that_cannot_be_sent_are_said_at_once(tmp_path):
    link = CommandLink(recipe(tmp_path / "log"), WallClock())
    try:
        link.begin(Begin(lambda: None, 0.004, 0.008, "", 1.0))
        began = time.monotonic()
        with pytest.raises(DeviceError, match=r"cannot be handed over .*lambda"):
            link.wait_ready()
        assert time.monotonic() - began < 5.0
    finally:
        link.close()


def test_a_plan_that_cannot_be_sent_is_said_and_keeps_nothing_back():
    told, channels = [], Channels()
    link = SimpleNamespace(ended=None, slow=False, tell=told.append)
    relay = CommandRelay(channels, link, None, lambda: 1.0)
    request = PlanRequest(7, TWO, JointIntent("G", TWO))
    relay._hear(State(None, None, request=request))
    channels.plan.publish(Plan(7, np.zeros((2, 2)), lambda: None, 1.0, 1, 0.0, 0.0), 1.0)
    relay.held = True
    relay.update(1.0)
    (news,) = told
    assert pickle.loads(pickle.dumps(news)).held  # a pause comes through whatever a planner says
    assert news.plan.request == 7
    assert not news.plan.good
    assert "a lambda" in news.plan.failure
    assert "no path: the planner's answer" in relay.problem


# --- real processes ------------------------------------------------------------------------------


def driven_cell(log, driver=NotedArm):
    clock = WallClock()
    made = recipe(log, driver)
    return Cell(
        SimpleNamespace(name="apart"),
        SimpleNamespace(name="double"),
        np.eye(4),
        clock,
        DrivenArm(made.settings, made.limits, made.opener, clock),
        (),
        (),
    )


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_session_runs_its_guard_apart_and_survives_its_death(tmp_path, how):
    log = tmp_path / "log"
    make = make_parts_for(partial(FakeGuard))
    with driven_cell(log) as cell:
        session = Session(cell, GoTo((0.05, -0.05)), make=make)
        session.run(1.0)  # to the end, in order
        assert isinstance(cell.arm, RemoteArm)
        assert session.view().joints.position == pytest.approx([0.05, -0.05], abs=0.03)
        assert session.status().goal == "G"
        assert next(h for h in session.health() if h.name == "guard").rounds > 20
        assert {device.stage for device in cell.health()} == {"open"}
        ours, pid = os.getpid(), cell.arm.link.pid
        assert {p for p, what in calls(log) if what == "command"} == {pid}
        assert calls(log)[-1] == (pid, "stop")
        reason = "SIGKILL" if how == signal.SIGKILL else "has said nothing for"
        threading.Timer(0.3, os.kill, (pid, how)).start()
        with pytest.raises(LoopError, match=reason):
            session.run(30.0)
        # The arm was told to stop through another connection.
        assert [what for p, what in calls(log) if p == ours][-3:] == ["open", "stop", "close"]
        with pytest.raises(DeviceLostError):
            cell.arm.read()
        assert cell.health()[0].stage == "lost"
    session.stop()
    cell.arm.stop()  # after it was let go of: nothing is left to be told


KILLED = """
import os, signal, sys, time
sys.path[:0] = {path!r}
from functools import partial
from pathlib import Path
import test_command_process as t
link = t.CommandLink(t.recipe(Path({log!r})), t.WallClock())
link.begin(t.begin(partial(t.FakeGuard)))
link.wait_ready()
link.run()
t.until(lambda: "command" in [what for _, what in t.calls(Path({log!r}))])
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_arm_is_stopped_when_the_session_is_killed(tmp_path):
    log = tmp_path / "log"
    text = KILLED.format(path=[p for p in sys.path if p], log=str(log))
    done = subprocess.run([sys.executable, "-c", text], timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL
    until(lambda: calls(log)[-1][1] == "close")
    words = [what for _, what in calls(log)]
    assert "stop" in words[words.index("command") :]


class Busy(NotedArm):
    """Refuses its first connections: the one of the process that died has not been noticed yet."""

    refusals = 0

    def __init__(self, settings):
        type(self).refusals += 1
        if 2 <= type(self).refusals <= 3:
            raise ConnectionRefusedError("busy")
        super().__init__(settings)


def test_an_arm_that_takes_no_second_connection_at_first_is_asked_again(tmp_path, monkeypatch):
    log = tmp_path / "log"
    link = CommandLink(recipe(log), WallClock())
    monkeypatch.setattr(Busy, "refusals", 1)
    link.arm = recipe(log, Busy)
    link.give_up("it hangs")
    link.halt()
    assert Busy.refusals == 4
    assert [what for p, what in calls(log) if p == os.getpid()] == ["open", "stop", "close"]
    link.close()


def test_looking_and_own_process_false_leave_the_arm_where_it_is(tmp_path):
    make = make_parts_for(partial(FakeGuard))
    for mode in (SessionMode(look_only=True), SessionMode(own_process=False)):
        with driven_cell(tmp_path / "log") as cell:
            Session(cell, None, make=make, mode=mode).run(0.1)
            assert isinstance(cell.arm, DrivenArm)


def test_a_link_whose_arm_cannot_be_opened_says_why_and_leaves_nothing_behind(tmp_path):
    with pytest.raises(DeviceError, match="No such file"):
        CommandLink(recipe(tmp_path / "no" / "log"), WallClock())
