"""Maps that pass through shared memory arrive whole or not at all."""

import pickle

import numpy as np
import pytest
from process_doubles import snapshot

from armsight.experiments.quick_cell import Ball, QuickCell
from armsight.motion.guard import Guard
from armsight.runtime.snapshot_memory import (
    ARRAYS,
    BEGUN,
    SnapshotReader,
    SnapshotWriter,
    _head,
)


@pytest.fixture
def memory():
    writer, reader = SnapshotWriter(), SnapshotReader()
    yield writer, reader
    reader.close()
    writer.close()


def sent(ticket):
    """A ticket as the other process gets it."""
    return pickle.loads(pickle.dumps(ticket))


def test_a_map_arrives_bit_for_bit_and_nobody_can_change_it(memory):
    writer, reader = memory
    given = snapshot(3)
    got = reader.read(sent(writer.write(given)))
    for name in ARRAYS:
        there, here = getattr(got, name), getattr(given, name)
        assert there.dtype == here.dtype
        assert there.tobytes() == here.tobytes()
        assert not there.flags.writeable
    assert (got.sequence, got.stamp, got.oldest, got.cameras) == (
        given.sequence, given.stamp, given.oldest, given.cameras,
    )  # fmt: skip
    assert len(got.cloud) == 0  # the page's; it stays where it is


def test_what_was_read_stays_when_more_is_written(memory):
    writer, reader = memory
    first = reader.read(writer.write(snapshot(1)))
    for number in range(2, 6):
        writer.write(snapshot(number))
    assert np.array_equal(first.distance, snapshot(1).distance)


def test_the_newer_of_two_can_be_read_and_so_can_the_one_before(memory):
    writer, reader = memory
    tickets = [writer.write(snapshot(number)) for number in (1, 2)]
    assert [reader.read(t).sequence for t in tickets] == [1, 2]


def test_a_map_that_was_overwritten_is_not_taken_for_another(memory):
    writer, reader = memory
    old = writer.write(snapshot(1))
    writer.write(snapshot(2))
    writer.write(snapshot(3))  # in the place of the first
    assert reader.read(old) is None


def test_a_write_that_begins_while_the_map_is_copied_is_noticed(memory, monkeypatch):
    writer, reader = memory
    ticket = writer.write(snapshot(1))
    from armsight.runtime import snapshot_memory

    look, seen = snapshot_memory._look, []

    def torn(block, kind, shape, offset):
        seen.append(offset)
        if len(seen) == 3:  # half of the arrays are copied
            _head(block, ticket.offset)[BEGUN] = ticket.number + 2
        return look(block, kind, shape, offset)

    monkeypatch.setattr(snapshot_memory, "_look", torn)
    assert reader.read(ticket) is None
    assert len(seen) == len(ARRAYS)


def test_a_stamp_that_is_not_the_announced_one_is_noticed(memory):
    writer, reader = memory
    ticket = writer.write(snapshot(1))
    _head(writer._block, ticket.offset).view(np.float64)[2] += 0.1
    assert reader.read(ticket) is None


def test_a_map_that_outgrows_its_memory_gets_more(memory):
    writer, reader = memory
    small = writer.write(snapshot(1, hazards=5))
    assert reader.read(small).sequence == 1
    large = writer.write(snapshot(2, hazards=50_000))
    assert large.block != small.block
    assert len(reader.read(large).hazards) == 50_000
    assert reader.read(writer.write(snapshot(3, hazards=50_000))).sequence == 3


def test_a_ticket_of_a_writer_that_is_gone_is_no_map():
    writer, reader = SnapshotWriter(), SnapshotReader()
    ticket = writer.write(snapshot(1))
    writer.close()
    assert reader.read(ticket) is None


def test_a_guard_in_another_process_gives_the_same_commands_bit_for_bit(memory):
    """The guard's inputs as they arrive there, while somebody comes near a moving arm."""
    writer, reader = memory
    home = np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])
    goals = [home + np.array([0.6, 0.1, 0.0, 0.0, 0.0, 0.0]), home]
    ball = Ball(lambda t: np.array([0.9, 0.9 - 0.4 * t, 0.4]))
    cell = QuickCell([ball], goals, seed=1)
    there = Guard(cell.robot, [cell.info], cell.config)
    here, step = cell.guard, cell.guard.step
    last, commands = [None, None], []

    def both(now, joints, given, intent, plan):
        if given is not last[0]:  # as the relay does: what is not new is not sent
            last[:] = given, reader.read(sent(writer.write(given)))
        decision = step(now, joints, given, intent, plan)
        told = sent((joints, intent, plan))
        other = there.step(now, told[0], last[1], told[1], told[2])
        commands.append(decision.command)
        assert other.command.tobytes() == decision.command.tobytes()
        assert (other.brake, other.status.mode, other.status.reason) == (
            decision.brake, decision.status.mode, decision.status.reason,
        )  # fmt: skip
        assert (other.request is None) == (decision.request is None)
        return decision

    here.step = both
    cell.run(2.0)
    modes = {status.mode for status in cell.log}
    assert len(modes) > 2, modes
    assert np.abs(commands).max() > 0.1
