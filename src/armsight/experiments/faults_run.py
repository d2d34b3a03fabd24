"""One run of the packaged cell in which something goes wrong while its arm moves."""

from __future__ import annotations

import contextlib
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armsight.experiments.episodes import packaged_cell
from armsight.experiments.faults_cases import ARM, CASES, JUMPED, MAP, SILENT, Case
from armsight.experiments.faults_devices import Trouble, TroubledArm, TroubledCamera
from armsight.experiments.faults_parts import FullDisk, Stall, troubled_parts

if TYPE_CHECKING:
    from armsight.runtime.session import Session

BEGINS, WAITS = (2.0, 6.0), 20.0
"""A fault begins when the arm moves, after a time between these [s], and within so long [s]."""
LASTS = 2.0
"""So long it lasts [s]."""
RECOVERS = 9.0
"""Within this time after its end all must be well [s]: an arm that did not follow is left alone for
five seconds, then it may try again."""
WELL, HOLDS = 0.5, 3.0
"""All is well when it has been for so long [s]; then the arm has this time to move again."""
MOVES, HELD = 0.15, 0.05
"""Faster than the first the arm moves, slower than the second it stands [rad/s, greatest joint]."""
EARLY = (*ARM, *MAP, *SILENT, JUMPED)
"""What nobody may say before something goes wrong."""
NEAR = 1.5
"""An arm that does not move again may stand for somebody who is nearer than this [m]."""
JUMPS = (0.1, 3.0)
"""Clocks jump by something between these, evenly in its logarithm [s]."""


class Director:
    """Lets the trouble begin and end, and keeps what is said and done: an observer.

    Attributes:
        named: from the beginning until it was named [s]; inf unless it was while it lasted.
        stood: from the beginning until the arm stood [s]; inf if never.
        well: since when all has been well again [s]; inf while it is not.
        words: what was said first; last: what was said in the end.
        moved: the arm has moved again since the trouble's end.
        early: an honest arm, clock or map was blamed before.
    """

    name, period = "director", 0.004

    def __init__(self, case: Case, trouble: Trouble, due: float, arm: Any) -> None:
        self._case, self._trouble, self._due, self._arm = case, trouble, due, arm
        self._session: Session | None = None
        self.named = self.stood = self.well = math.inf
        self.words = self.last = ""
        self.moved = self.early = False

    def attach(self, session: Session) -> None:
        """Called by the session."""
        self._session = session

    def update(self, now: float) -> None:
        """Look at the cell."""
        assert self._session is not None
        trouble = self._trouble
        speed = float(np.abs(self._arm.reference_velocity).max())
        if math.isinf(trouble.begin):
            self.early = self.early or any(word in self._said() for word in EARLY)
            if now >= self._due and (speed > MOVES or now > self._due + WAITS):
                trouble.joint = int(np.abs(self._arm.reference_velocity).argmax())
                trouble.begin, trouble.end = now, now + LASTS
            return
        since = now - trouble.begin
        said = self._said()
        lasts = now < trouble.end
        if lasts and math.isinf(self.named) and any(word in said for word in self._case.named):
            self.named, self.words = since, said
        if speed < HELD:
            self.stood = min(self.stood, since)
        if lasts:
            return
        self.moved = self.moved or speed > MOVES
        if self._well() and not any(word in said for word in self._case.named):
            self.well = min(self.well, now)
        else:
            self.well, self.last = math.inf, said
        done = now - self.well >= (WELL if self.moved else HOLDS)
        if done or now - trouble.end > RECOVERS:
            self._session.stop("over")

    def _said(self) -> str:
        assert self._session is not None
        status, snapshot = self._session.status(), self._session.snapshot()
        said = [] if status is None else [status.reason]
        said += [h.problem for h in self._session.health() if h.problem]
        said += [] if snapshot is None else [c.reason for c in snapshot.cameras if c.reason]
        return "; ".join(said)

    def _well(self) -> bool:
        """Every camera is believed, and the guard pursues its goal or waits for somebody."""
        assert self._session is not None
        snapshot, status = self._session.snapshot(), self._session.status()
        if snapshot is None or status is None or status.reason.startswith("recovering"):
            return False
        return all(c.alive and not c.reason for c in snapshot.cameras)


def episode(seed: int, run: int) -> dict[str, Any]:
    """One run; module-level, so that worker processes can import it."""
    from armsight.errors import ArmsightError
    from armsight.recording.recorder import Recorder
    from armsight.runtime.session import Session
    from armsight.tasks.patrol import PatrolTask
    from armsight.workcell import open_cell, simulated_world

    group, member = divmod(run, len(CASES))
    case = CASES[member]
    rng = np.random.default_rng((seed, group, member, 7))
    size = math.exp(rng.uniform(*np.log(JUMPS)))
    back = case.name.endswith("_back")
    trouble = Trouble(case.name, -size if back else size, 0, float(rng.choice([-1.0, 1.0])))
    due, camera = float(rng.uniform(*BEGINS)), int(rng.integers(4))
    workcell, failure = packaged_cell(), ""
    with contextlib.ExitStack() as stack:
        cell = stack.enter_context(open_cell(workcell, seed=int(rng.integers(2**31))))
        world, clock = simulated_world(cell), cell.clock
        if case.place in ("camera", "cameras"):
            cell.cameras = tuple(
                TroubledCamera(c, clock, trouble) if case.place == "cameras" or i == camera else c
                for i, c in enumerate(cell.cameras)
            )
        if case.place == "arm":
            cell.arm = TroubledArm(cell.arm, clock, trouble)
        observers: list[Any] = [Stall(trouble, world.advance)]
        recorder = None
        if case.place == "disk":
            file = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "run.mcap"
            recorder = Recorder(file, cell)
            disk = FullDisk(trouble, file.with_name("run.mcap.partial"))
            stack.callback(disk.close)
            observers += [recorder, disk]
        director = Director(case, trouble, due, world.arm)
        task = PatrolTask(workcell.goals, workcell.patrol.dwell_s)
        session = Session(
            cell, task, seed=group, observers=(*observers, director), make=troubled_parts(trouble)
        )
        try:
            session.run(BEGINS[1] + WAITS + LASTS + RECOVERS + 1.0)
        except ArmsightError as error:
            failure = str(error)
        near = world.truth.separations
        well = not failure and math.isfinite(director.well)
        if recorder is not None:
            well = not failure and _kept(recorder, trouble)
        return {
            "case": case.name,
            "begin": trouble.begin,
            "jump": trouble.jump,
            "named": director.named,
            "words": director.words,
            "last": director.last,
            "stood": director.stood,
            "well": director.well - trouble.end,
            "moved": director.moved,
            "early": director.early,
            "recovered": bool(well and (director.moved or (near and near[-1].distance < NEAR))),
            "failure": failure,
            "contacts": len(world.truth.moving_contacts),
        }


def _kept(recorder: Any, trouble: Trouble) -> bool:
    """Whether the recording can be read up to where the disk was full."""
    from armsight.errors import RecordingError
    from armsight.recording.mcap_file import McapReader

    with contextlib.suppress(RecordingError):
        recorder.close()
    with McapReader(recorder.path) as reader:
        first, last = reader.span
        return not reader.contents.cut and 1e-9 * (last - first) > trouble.begin - 1.5
