"""What waits for the writing thread: bounded by memory, and in real time by age."""

from armsight.recording.byte_queue import SMALL, ByteQueue


def nothing() -> None:
    """A job."""


def test_large_jobs_are_not_taken_while_the_oldest_is_late_and_small_ones_are():
    """A writer that was seconds behind lost twelve seconds when the program was killed."""
    clock = [0.0]
    queue = ByteQueue(10 * SMALL, 0.5, lambda: clock[0])
    assert queue.put(SMALL + 1, nothing, wait=False)
    clock[0] = 0.4
    assert queue.put(SMALL + 1, nothing, wait=False)
    clock[0] = 0.6
    assert not queue.put(SMALL + 1, nothing, wait=False)
    assert queue.put(1024, nothing, wait=False)
    assert queue.get() is nothing  # the next has waited for 0.2 s
    assert queue.put(SMALL + 1, nothing, wait=False)


def test_who_waits_loses_nothing_however_late_it_is():
    clock = [0.0]
    queue = ByteQueue(10 * SMALL, 0.5, lambda: clock[0])
    queue.put(SMALL + 1, nothing, wait=True)
    clock[0] = 9.0
    assert queue.put(SMALL + 1, nothing, wait=True)


def test_after_the_end_nothing_counts_as_dropped():
    clock = [0.0]
    queue = ByteQueue(10 * SMALL, 0.5, lambda: clock[0])
    queue.put(SMALL + 1, nothing, wait=False)
    queue.close()
    clock[0] = 9.0
    assert queue.put(SMALL + 1, nothing, wait=False)
