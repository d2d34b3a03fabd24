"""The runs of ``armsight charge``: one, and one more after each calibration between visits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from armsight.commands.ending import EndsWhen
from armsight.errors import CalibrationError

if TYPE_CHECKING:
    from armsight.charging.stale import Cause, Kind
    from armsight.charging.visit import Outcome
    from armsight.commands.charge import Charge
    from armsight.runtime.session import Session
    from armsight.tasks.charge import ChargeTask


@dataclass(frozen=True)
class ChargeRun:
    """What came of one session.

    Attributes:
        workcell: its name.
        outcomes: of its visits.
        touched: what was touched otherwise, None where nobody knows.
        seconds: on the cell's clock; code: that it ends with.
        cause: why it ended for a calibration, or None.
    """

    workcell: str
    outcomes: tuple[Outcome, ...]
    touched: tuple[str, ...] | None
    seconds: float
    code: int
    cause: Cause | None

    @property
    def counted(self) -> tuple[Outcome, ...]:
        """Without those that were refused for what a calibration mended: they are made anew."""
        cause = self.cause
        return tuple(o for o in self.outcomes if cause is None or o.problem != cause.words)


def charge_runs(asked: Charge) -> list[ChargeRun]:
    """Charge, calibrating between visits where that was asked for, to the end of the visits.

    A calibration that fails is said, and is the end: the last run's code is not 0.
    """
    from armsight.commands.calibrate import Calibrate
    from armsight.commands.calibrate_plug import LOOKS, PlugOptions, calibrate_plug
    from armsight.commands.running import say

    runs: list[ChargeRun] = []
    settled: list[Kind] = []
    now = asked
    while True:
        run = _run(now, settled)
        runs.append(run)
        if run.cause is None:
            return runs
        settled.append(run.cause.kind)
        say(f"calibrates pair and plug again: {run.cause.words}")
        page = None if asked.headless else asked.page
        options = PlugOptions(
            Calibrate.out,
            pair=None,
            looks=LOOKS,
            write=True,
            fresh=True,
            seed=asked.seed,
            cell_is_empty=asked.cell_is_empty,
            page=page,
        )
        try:
            code = calibrate_plug(asked.workcell, options)
        except CalibrationError as error:
            say(str(error))
            code = 1
        if code:
            runs[-1] = replace(run, code=code)
            return runs
        now = _rest(asked, runs)
        if asked.visits and asked.headless and not now.visits:
            return runs


def _rest(asked: Charge, runs: list[ChargeRun]) -> Charge:
    """What is left of what was asked for."""
    visits = max(0, asked.visits - sum(len(run.counted) for run in runs))
    seconds, record = asked.seconds, asked.record
    if seconds is not None:
        seconds = max(0.0, seconds - sum(run.seconds for run in runs))
    if record is not None:
        record = record.with_stem(f"{record.stem}-{len(runs) + 1}")
    return replace(asked, visits=visits, seconds=seconds, record=record, show_plug=False)


def _run(asked: Charge, settled: list[Kind]) -> ChargeRun:
    """One session."""
    from armsight.charging.stale import Stale
    from armsight.commands.running import exit_code, ran, say
    from armsight.tasks.charge import ChargeOptions

    limited = asked
    if asked.headless and asked.seconds is None:
        limited = replace(asked, seconds=asked.visits * (180.0 + asked.charging))
    options = ChargeOptions(
        asked.inlet, asked.mode, asked.visits, asked.charging, asked.state, asked.show_plug
    )
    made: list[ChargeTask] = []
    ended: list[bool] = []

    def over() -> bool:  # with a page somebody watches after the visits, too
        return made[0].stale_by is not None or (asked.headless and bool(ended))

    def make(cell: Any) -> tuple[ChargeTask, tuple[Any, ...]]:
        task = options.make(cell)
        made.append(task)
        task.done = lambda: ended.append(True)
        if asked.recalibrate:
            task.stale = Stale(task.station, task.apart, not cell.simulated, settled)
        ends = asked.headless or asked.recalibrate
        return task, (_Parking(task), *((EndsWhen(over, "time"),) if ends else ()))

    with ran(limited, make) as session:
        task = made[0]
        outcomes = [*task.station.outcomes]
        if task.station.outcome not in outcomes and task.station.busy:
            outcomes.append(task.station.outcome)
        truth = getattr(session.cell.world, "truth", None)
        touched = None
        if truth is not None:
            touched = tuple(f"{c.owner} {c.part}".strip() for c in truth.moving_contacts)
        seconds, name = session.now(), session.cell.workcell.name
    for i, outcome in enumerate(outcomes):
        say(f"visit {i + 1}: {told(outcome)}")
    if task.apart.words:
        say(task.apart.words)
    cause = task.stale_by if session.ended_by == "time" else None
    code = exit_code(session, None if asked.headless else asked.seconds)
    return ChargeRun(name, tuple(outcomes), touched, seconds, code, cause)


def told(outcome: Outcome) -> str:
    """How a visit went, in words."""
    words = []
    if outcome.port:
        known = outcome.score != outcome.score  # NaN: before the station that goes on was started
        how = "known from before" if known else f"found ({100 * outcome.score:.0f} %)"
        words.append(f"{outcome.port} {how}")
    if outcome.lid_opened:
        words.append("lid opened")
    if outcome.seated:  # NaN: before the station that took the plug out was started
        after = outcome.plugged - outcome.began
        words.append("seated" if after != after else f"seated after {after:.1f} s")
    if outcome.charged:
        words.append("charged")
    words.append("out" if outcome.out else "NOT out")
    if outcome.lid_opened:
        words.append("lid shut" if outcome.lid_shut else "lid NOT shut")
    words += [said for said in (outcome.problem, outcome.warning) if said]
    return ", ".join(words)


class _Parking:
    """Lets the task's button park a simulated car anew."""

    name = "parking"
    period = 1.0

    def __init__(self, task: ChargeTask) -> None:
        self._task = task

    def attach(self, session: Session) -> None:
        """The session is there."""
        car = getattr(session.cell.world, "car", None)
        if car is not None:
            self._task.park = lambda: session.post(car.anew)

    def update(self, now: float) -> None:
        """Nothing to do."""
