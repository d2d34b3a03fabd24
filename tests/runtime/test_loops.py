"""Both loops run components on their periods, count what is missed, and end on failure."""

import contextlib
import gc
import sys
import threading
import time

import pytest

from armsight.devices.clock import WallClock
from armsight.errors import DeviceError, LoopError
from armsight.runtime.simulated_loop import SimulatedLoop
from armsight.runtime.slot import LONGEST, Slot
from armsight.runtime.wall_loop import WallLoop


class Ticker:
    def __init__(self, name, period, clock=None, charge=0.0, fail_at=None, error=None):
        self.name, self.period, self.charge = name, period, charge
        self.fail_at, self.error = fail_at, error or ValueError("boom")
        self.times = []

    def update(self, now):
        if self.fail_at is not None and now >= self.fail_at:
            raise self.error
        self.times.append(now)


class Clock:
    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def advance(self, until):
        assert until >= self.time
        self.time = until


def simulated(*components):
    clock = Clock()
    return clock, SimulatedLoop(clock.now, clock.advance, components)


def test_periods_are_kept_without_drift():
    a, b = Ticker("a", 0.004), Ticker("b", 0.1)
    clock, loop = simulated(a, b)
    loop.run(10.0)
    assert clock.time == 10.0
    assert len(a.times) == 2501
    assert a.times == pytest.approx([k * 0.004 for k in range(2501)])
    assert b.times == pytest.approx([k * 0.1 for k in range(101)])
    assert loop.meters["a"].report().missed == 0


def test_components_due_together_run_in_their_order():
    order = []
    parts = [Ticker(n, 0.01) for n in "cab"]
    for part in parts:
        part.update = lambda now, n=part.name: order.append(n)
    _, loop = simulated(*parts)
    loop.run(0.02)
    assert "".join(order) == "cabcabcab"


def test_charged_time_makes_a_component_late_and_is_counted():
    slow = Ticker("slow", 0.01, charge=0.025)
    _, loop = simulated(slow)
    loop.run(0.1)
    assert slow.times == pytest.approx([0.0, 0.025, 0.05, 0.075, 0.1])
    assert loop.meters["slow"].report().missed == 6


def test_wake_adds_a_round_and_waits_for_a_busy_component():
    part = Ticker("p", 1.0, charge=0.2)
    _, loop = simulated(part)
    loop.wake("p", 0.05)
    loop.wake("p", 0.5)
    loop.run(0.9)
    assert part.times == pytest.approx([0.0, 0.2, 0.5])


def test_call_at_runs_once_at_its_time():
    clock, loop = simulated(Ticker("p", 1.0))
    seen = []
    loop.call_at(0.25, lambda: seen.append(clock.time))
    loop.run(0.5)
    assert seen == [0.25]


def test_run_can_be_continued():
    part = Ticker("p", 0.01)
    _, loop = simulated(part)
    loop.run(0.095)
    loop.run(0.2)
    assert part.times == pytest.approx([k * 0.01 for k in range(21)])


def test_a_run_ends_when_what_is_computed_beside_it_has_ended_and_hands_it_over_in_the_next():
    # A map that was at work when the program ended found its threads gone and said that it failed.
    ended, handed = [], []

    def job():
        time.sleep(0.1)
        ended.append(True)
        return "map"

    _, loop = simulated(Ticker("map", 0.05))
    loop.beside("map", 0.2, job, handed.append)
    loop.run(0.1)
    assert (ended, handed) == ([True], [])
    loop.run(0.3)
    assert handed == ["map"]


@pytest.mark.parametrize("fails", [False, True])
def test_a_run_leaves_old_objects_to_no_collection_and_the_interpreter_as_it_was(fails):
    """A full collection of a cell takes 0.15 s: many ticks without a command."""
    seen = []
    a = Ticker("a", 0.004, fail_at=0.01 if fails else None)
    a.update = lambda now, update=a.update: (seen.append(gc.get_freeze_count()), update(now))
    interval = sys.getswitchinterval()
    for wall in (False, True):
        loop = WallLoop(WallClock(), [a]) if wall else simulated(a)[1]
        with contextlib.suppress(LoopError):
            loop.run(0.02)
        assert min(seen) > 1000
        assert gc.get_freeze_count() == 0
        assert sys.getswitchinterval() == interval
        seen.clear()


@pytest.mark.parametrize("period", [0.0, -0.1, float("nan"), float("inf")])
def test_a_component_without_a_period_is_refused(period):
    """Its thread divided by it, and ended in silence."""
    with pytest.raises(ValueError, match="odd: its period is"):
        WallLoop(WallClock(), [Ticker("odd", period)])


def test_names_must_be_unique():
    with pytest.raises(ValueError, match="unique"):
        simulated(Ticker("a", 1.0), Ticker("a", 1.0))


@pytest.mark.parametrize("error", [ValueError("boom"), DeviceError("cable is out")])
def test_a_failing_component_ends_the_loop_with_its_name(error):
    _, loop = simulated(Ticker("good", 0.01), Ticker("bad", 0.01, fail_at=0.05, error=error))
    with pytest.raises(LoopError, match="bad") as caught:
        loop.run(1.0)
    assert caught.value.__cause__ is error
    assert str(error) in loop.meters["bad"].report().problem


def test_speed_paces_the_simulation():
    _, loop = simulated(Ticker("a", 0.01))
    loop.set_speed(4.0)
    began = time.perf_counter()
    loop.run(0.4)
    assert time.perf_counter() - began > 0.09


def test_pause_and_post_and_stop_from_another_thread():
    part = Ticker("p", 0.01)
    _clock, loop = simulated(part)
    loop.pause(True)
    runner = threading.Thread(target=loop.run, args=(None,))
    runner.start()
    answered = threading.Event()
    loop.post(answered.set)
    assert answered.wait(5)
    assert part.times == []
    loop.pause(False)
    while len(part.times) < 5:
        time.sleep(0.001)
    loop.stop()
    runner.join(5)
    assert not runner.is_alive()


def test_wall_loop_runs_each_in_its_thread():
    names = {}
    parts = [Ticker(n, 0.005) for n in "ab"]
    for part in parts:
        part.update = lambda now, n=part.name: names.setdefault(n, threading.get_ident())
    loop = WallLoop(WallClock(), parts)
    loop.run(0.1)
    assert len(set(names.values()) | {threading.get_ident()}) == 3
    assert loop.meters["a"].report().rounds >= 1


def test_wall_loop_counts_missed_deadlines_and_wakes():
    slow = Ticker("slow", 0.002)
    slow.update = lambda now: time.sleep(0.01)
    lazy = Ticker("lazy", 100.0)
    clock = WallClock()
    loop = WallLoop(clock, [slow, lazy])
    threading.Timer(0.05, lambda: loop.wake("lazy", 0.0)).start()
    loop.call_at(0.06, lambda: loop.wake("lazy", 0.0))
    loop.run(0.2)
    assert loop.meters["slow"].report().missed > 0
    assert len(lazy.times) == 3


def test_wall_loop_stops_the_arm_at_once_when_a_component_fails():
    stopped = threading.Event()
    parts = [Ticker("bad", 0.002, fail_at=0.0), Ticker("good", 0.002)]
    loop = WallLoop(WallClock(), parts, halt=stopped.set)
    with pytest.raises(LoopError, match="bad"):
        loop.run(5.0)
    assert stopped.is_set()


def test_the_arm_is_stopped_before_a_thread_that_hangs_is_waited_for():
    """A task that does not come back held up the stop for as long as the threads were joined."""
    began, told = threading.Event(), []
    hung = Ticker("hung", 0.002)
    hung.update = lambda now: (began.set(), time.sleep(0.6))
    loop = WallLoop(WallClock(), [hung], halt=lambda: told.append(time.monotonic()))
    threading.Thread(target=lambda: began.wait(5.0) and loop.stop()).start()
    loop.run(None)
    assert time.monotonic() - told[0] > 0.3


def test_a_component_that_hung_in_a_run_does_not_wake_up_in_the_next(monkeypatch):
    monkeypatch.setattr("armsight.runtime.wall_loop.JOIN_SECONDS", 0.05)
    hangs, threads = [True], set()
    part = Ticker("part", 0.002)

    def update(now):
        threads.add(threading.get_ident())
        if hangs and hangs.pop():
            time.sleep(0.3)

    part.update = update
    loop = WallLoop(WallClock(), [part])
    loop.run(0.05)
    first = set(threads)
    threads.clear()
    loop.run(0.6)  # 0.6 s on the clock: the first thread comes back in it
    assert len(threads) == 1
    assert not threads & first


def test_a_component_that_leaves_its_thread_ends_the_loop():
    stopped = threading.Event()
    parts = [Ticker("good", 0.002), Ticker("quitter", 0.002, fail_at=0.0, error=SystemExit(0))]
    with pytest.raises(LoopError, match=r"quitter ended itself \(SystemExit\)"):
        WallLoop(WallClock(), parts, halt=stopped.set).run(5.0)
    assert stopped.is_set()


def test_wall_clock_pauses_resumes_restarts():
    ticks = iter([0.0, 1.0, 2.0, 5.0, 6.0, 7.0, 8.0])
    clock = WallClock(source=lambda: next(ticks))
    assert clock.now() == 1.0
    clock.pause()  # at 2
    assert clock.now() == 2.0
    clock.resume()  # source says 5
    assert clock.now() == 3.0
    clock.restart()  # source says 7
    assert clock.now() == 1.0


def test_what_nobody_reads_takes_no_more_room_with_time():
    """A session without a page: a face every 20 ms that nobody looks at, for an hour."""
    slot: Slot[int] = Slot()
    for k in range(50 * 3600):
        slot.publish(k, 0.02 * k + 0.1)
    assert len(slot._pending) <= 50 * LONGEST + 2
    assert slot.read(3600.01) == 50 * 3600 - 5, "0.1 s late, as ever"
    assert slot.read(3600.11) == 50 * 3600 - 1


def test_late_values_become_visible_in_their_order_whether_read_or_not():
    slot: Slot[str] = Slot()
    slot.publish("early", 1.0)
    slot.publish("next", 8.0)
    slot.publish("late", 11.0)
    assert slot.read(0.5) is None
    assert slot.read(2.0) == "early"
    assert slot.read(9.0) == "next"
    assert slot.read(12.0) == "late"
