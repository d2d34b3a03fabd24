"""A map that raises, runs out of memory or hangs is replaced, and the run goes on."""

import itertools
import threading
from dataclasses import dataclass

import pytest
from doubles import FakeGuard, FakeMap, FakePlanner, make_cell

from armsight.devices.data import DeclaredSolids
from armsight.devices.history import JointHistory
from armsight.errors import LoopError, UsageError
from armsight.runtime import assembly
from armsight.runtime.config import SessionMode
from armsight.runtime.parts import Parts
from armsight.runtime.renewed_map import PAUSE, RenewedMap
from armsight.runtime.session import Session


@dataclass(frozen=True)
class Snapshot:
    sequence: int
    stamp: float
    cameras: tuple = ()
    inside: tuple = ()


class Frail(FakeMap):
    """Counts its rounds from 0, and fails when it is told to."""

    made: list
    fails: Exception | threading.Event | None = None

    def __init__(self):
        super().__init__()
        self.rounds = 0
        self.closed = False
        self.made.append(self)

    def update(self, frames, joints, now, tracked=None):
        if isinstance(self.fails, threading.Event):
            self.fails.wait(5.0)
        elif self.fails is not None:
            raise self.fails
        self.rounds += 1
        return Snapshot(self.rounds - 1, now)

    def told(self, word):
        self.calls.append((word.name, len(word.solids)))

    def close(self):
        self.closed = True


@pytest.fixture
def frail():
    return type("Frail", (Frail,), {"made": []})


SECONDS = itertools.count()


def look(made):
    """A second later."""
    return made.update([], JointHistory(), float(next(SECONDS)))


def test_between_two_there_is_a_pause(frail):
    """One that fails at every picture would take a core by being made."""
    made = RenewedMap(frail)
    frail.fails = ValueError("shapes")
    for k in range(60):
        with pytest.raises(LoopError, match="shapes"):
            made.update([], JointHistory(), 0.1 * k)
    assert len(frail.made) == pytest.approx(6.0 / PAUSE, abs=1)
    frail.fails = None
    assert made.update([], JointHistory(), -3.0).sequence == 0, "the clock was turned back"


@pytest.mark.parametrize("error", [ValueError("shapes"), MemoryError(), IndexError(3)])
def test_what_failed_is_thrown_away_and_its_numbers_go_on(frail, error):
    made = RenewedMap(frail)
    assert [look(made).sequence for _ in range(3)] == [0, 1, 2]
    frail.made[0].fails = error
    with pytest.raises(LoopError, match=f"the map failed \\({type(error).__name__}"):
        look(made)
    assert frail.made[0].closed
    assert [look(made).sequence for _ in range(3)] == [3, 4, 5]
    frail.made[1].fails = error
    with pytest.raises(LoopError):
        look(made)
    assert look(made).sequence == 6
    assert len(frail.made) == 3


def test_a_new_one_is_told_what_was_told_but_not_that_nobody_is_there(frail):
    made = RenewedMap(frail)
    info = make_cell().cameras[0].info
    box = ("solid",)
    made.declare_empty()
    made.exclude("c", "was moved")
    made.exclude("d", "was moved")
    made.told(DeclaredSolids(0.0, "car", box))
    made.told(DeclaredSolids(0.0, "crate", box))
    made.told(DeclaredSolids(1.0, "crate"))
    made.place(info)
    frail.made[0].fails = ValueError("x")
    with pytest.raises(LoopError):
        look(made)
    made.told(DeclaredSolids(2.0, "cart", box))  # while there is none
    look(made)
    assert frail.made[1].calls == [
        ("placed", info.name),
        ("d", "was moved"),
        ("car", 1),
        ("cart", 1),
    ]


def test_a_word_that_the_new_one_refuses_does_no_harm(frail):
    def refuse(self, word):
        raise UsageError("it lies outside")

    made = RenewedMap(frail)
    made.told(DeclaredSolids(0.0, "car", ("solid",)))
    frail.made[0].fails = ValueError("x")
    frail.told = refuse
    with pytest.raises(LoopError):
        look(made)
    assert look(made).sequence == 0


def test_one_that_cannot_be_made_is_tried_again(frail):
    made = RenewedMap(frail)
    frail.made[0].fails = ValueError("x")
    make, made.make = made.make, lambda: (_ for _ in ()).throw(MemoryError())
    for word in ("ValueError", "MemoryError", "MemoryError"):
        with pytest.raises(LoopError, match=word):
            look(made)
    made.make = make
    assert look(made).sequence == 0


def test_one_that_hangs_is_left_to_itself(frail):
    made = RenewedMap(frail, patience=0.05)
    first = look(made)
    frail.made[0].fails = end = threading.Event()
    with pytest.raises(LoopError, match=r"did not return within 0\.05 s"):
        look(made)
    assert look(made).sequence == first.sequence + 1
    end.set()
    assert look(made).sequence == first.sequence + 2, "what the first found at last is dropped"
    assert frail.made[1].rounds == 2


@pytest.mark.parametrize("wall", [False, True])
def test_a_run_goes_on_and_says_what_was_wrong(frail, wall):
    made = RenewedMap(frail)
    parts = Parts(made, FakePlanner(), FakeGuard())
    session = Session(
        make_cell(), None, mode=SessionMode(wall=wall), make=lambda cell, config: parts
    )
    session.run(0.2)
    last = session.snapshot()
    frail.fails = ValueError("shapes")
    session.run(0.2)
    # Under the simulated clock one was on its way when the first run ended.
    assert session.snapshot().sequence == last.sequence + (not wall)
    problem = {h.name: h.problem for h in session.health()}["mapping"]
    assert problem == "the map failed (ValueError: shapes); it begins anew"
    frail.fails = None
    session.run(PAUSE + 0.3)
    assert session.snapshot().sequence > last.sequence
    assert not {h.name: h.problem for h in session.health()}["mapping"]


def test_in_real_time_a_map_that_hangs_is_given_up(frail, monkeypatch):
    monkeypatch.setattr(assembly, "MAP_PATIENCE", 0.1)
    made = RenewedMap(frail)
    frail.made[0].fails = end = threading.Event()
    parts = Parts(made, FakePlanner(), FakeGuard())
    session = Session(
        make_cell(), None, mode=SessionMode(wall=True), make=lambda cell, config: parts
    )
    session.run(0.3)
    problem = {h.name: h.problem for h in session.health()}["mapping"]
    assert problem == "the map failed (did not return within 0.1 s); it begins anew"
    session.run(PAUSE + 0.3)
    end.set()
    assert session.snapshot() is not None
    assert len(frail.made) == 2


def test_closing_it_ends_the_threads_of_the_map_that_lives(frail):
    made = RenewedMap(frail)
    made.close()
    assert [one.closed for one in frail.made] == [True]
    made.close()  # may be repeated
