"""Who goes first: what was changed is changed back, and a refusal changes nothing."""

import os
import sys
import threading

import pytest

from armsight.runtime import priority

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads have priorities on Linux")


def standing(thread):
    number = thread.native_id
    return os.getpriority(os.PRIO_PROCESS, number), os.sched_getscheduler(number)


@pytest.fixture
def threads():
    done = threading.Event()
    made = [
        threading.Thread(target=done.wait, name=name, daemon=True)
        for name in ("armsight-camera 'front'", "page")
    ]
    for thread in made:
        thread.start()
    yield made
    done.set()


def test_a_run_favours_its_threads_and_lets_go_of_that(threads):
    camera, page = threads
    before = [standing(t) for t in threads]
    _, real_time, share = priority.offered()
    with priority.favoured():
        assert (standing(camera)[1] == os.SCHED_FIFO) == real_time
        assert standing(page)[1] == os.SCHED_OTHER  # never the page: it may compute for long
        assert (standing(page)[0] <= priority.NICE) == share
    assert [standing(t) for t in threads] == before


def test_what_is_refused_is_left_as_it_was(threads, monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", refuse)
    before = [standing(t) for t in threads]
    with priority.favoured():
        priority.go_first()
        assert "refused" in priority.raise_priority()
        assert [standing(t) for t in threads] == before
    words, real_time, share = priority.offered()
    assert not real_time
    assert not share
    assert words.count("refused") == 2
