"""The thread in which a task or perceiver of others is called."""

import gc
import threading
import time

from armsight.runtime.foreign import ForeignThread


class Owner:
    """Knows its thread, and is known by its calls, as a session is."""

    def __init__(self) -> None:
        self.calls = 0
        self.thread = ForeignThread("task/of a test", 5.0)

    def call(self) -> int:
        self.calls += 1
        return self.calls


def threads() -> int:
    return sum(t.name == "task/of a test" for t in threading.enumerate())


def test_it_ends_with_its_owner():
    """One was left for every session: a process that ran many kept all their threads."""
    owner = Owner()
    assert [owner.thread.call(owner.call).value for _ in range(3)] == [1, 2, 3]
    assert threads() == 1
    del owner
    gc.collect()
    for _ in range(200):
        if threads() == 0:
            break
        time.sleep(0.01)
    assert threads() == 0


def test_a_fault_does_not_end_it():
    owner = Owner()
    assert owner.thread.call(lambda: 1 / 0).fault.startswith("ZeroDivisionError")
    assert owner.thread.call(owner.call).value == 1


def test_a_first_call_may_compile():
    """Eyes of a servoing task compiled for over a minute beside other programs, and were given up
    for good."""
    slow = threading.Event()
    thread = ForeignThread("compiles", 0.5)
    threading.Timer(1.0, slow.set).start()
    assert thread.call(slow.wait).value is True
    never = threading.Event()
    assert thread.call(never.wait).fault == "did not return within 0.5 s"
    assert thread.call(lambda: 1).fault == "has hung"
    never.set()
