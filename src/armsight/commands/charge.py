"""``armsight charge``."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from armsight.commands.ending import EndsWhen
from armsight.commands.live import Working

if TYPE_CHECKING:
    from armsight.charging.visit import Outcome
    from armsight.runtime.session import Session
    from armsight.tasks.charge import ChargeTask


@dataclass(frozen=True)
class Charge(Working):
    """Find a parked car's charging port, plug in, charge, unplug, stand by.

    Example: armsight charge ur10_charging

    With --headless it ends after the visits; exit code 1 if one of them went wrong. What the
    station needs to come out again is kept in a file: killed and started again, it knows.

    Attributes:
        inlet: what the car has; `auto` looks.
        mode: `ours`; `paper`: one look, a plane through the contacts, halted by force.
        visits: how many; 0: by the page's button alone.
        charging: how long a simulated car charges [s].
        state: the station's file; CELL.station.json in the working folder if left out.
        show_plug: show the plug to the standing pair in the first visit: is it the one that was
            calibrated? Without a look at it nothing is plugged in then. After it was off at the
            stand-by it is shown anyway.
        seconds: at most, on the cell's clock; 180 a visit and its charging if left out and nobody
            watches.
    """

    inlet: Literal["auto", "type1", "type2", "ccs1", "ccs2"] = "auto"
    mode: Literal["ours", "paper"] = "ours"
    visits: int = 1
    charging: float = 5.0
    state: Path | None = None
    show_plug: bool = False

    def run(self) -> int:
        """Charge; prints how each visit went; 1 where one went wrong."""
        from dataclasses import replace
        from math import inf

        from armsight.commands.running import exit_code, ran, say, write_summary
        from armsight.errors import UsageError
        from armsight.tasks.charge import ChargeOptions

        if self.visits < 0:
            raise UsageError(f"--visits is {self.visits}; expected 0 or more")
        if self.headless and self.charging == inf:
            raise UsageError("--charging inf never ends, and with --headless nobody would end it")
        if not self.charging >= 0.0:
            raise UsageError(f"--charging is {self.charging:g} s; expected 0 or more")
        if self.headless and self.visits == 0:
            raise UsageError("--headless needs --visits: nobody would press the button")
        asked = self
        if self.headless and self.seconds is None:
            asked = replace(self, seconds=self.visits * (180.0 + self.charging))
        options = ChargeOptions(
            self.inlet, self.mode, self.visits, self.charging, self.state, self.show_plug
        )
        made: list[ChargeTask] = []
        ended: list[bool] = []
        watch = (EndsWhen(lambda: bool(ended), "time"),) if self.headless else ()

        def make(cell: Any) -> tuple[ChargeTask, tuple[Any, ...]]:
            task = options.make(cell)
            made.append(task)
            task.done = lambda: ended.append(True)
            return task, (_Parking(task), *watch)

        with ran(asked, make) as session:
            station = made[0].station
            outcomes = [*station.outcomes]
            if station.outcome not in outcomes and station.busy:
                outcomes.append(station.outcome)
            truth = getattr(session.cell.world, "truth", None)
            touched = None
            if truth is not None:
                touched = [f"{c.owner} {c.part}".strip() for c in truth.moving_contacts]
            seconds = session.now()
        for i, outcome in enumerate(outcomes):
            say(f"visit {i + 1}: {told(outcome)}")
        if made[0].apart.words:
            say(made[0].apart.words)
        if self.json is not None:
            summary = {
                "workcell": session.cell.workcell.name,
                "mode": self.mode,
                "seed": self.seed,
                "seconds": round(seconds, 3),
                "contacts": None if touched is None else len(touched),
                "touched": touched,
                "visits": [_finite(asdict(outcome)) for outcome in outcomes],
            }
            write_summary(self.json, summary)
        code = exit_code(session, None if self.headless else self.seconds)
        good = all(o.seated and o.out and not o.problem for o in outcomes)
        return code or int(self.visits > 0 and not (good and len(outcomes) >= self.visits))


def told(outcome: Outcome) -> str:
    """How a visit went, in words."""
    words = []
    if outcome.port:
        words.append(f"{outcome.port} found ({100 * outcome.score:.0f} %)")
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


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """JSON knows no NaN."""
    return {k: None if isinstance(v, float) and v != v else v for k, v in values.items()}


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
