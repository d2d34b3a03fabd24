"""``armsight charge``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from armsight.commands.live import Working

if TYPE_CHECKING:
    from armsight.commands.charging_runs import ChargeRun


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
        recalibrate: where the plug's tip or the pairs are not where the calibration has them, show
            the plug and calibrate again by itself, between visits, after the car has left; once a
            cause. It writes the cell's calibration file, as `armsight calibrate CELL --plug` does.
        seconds: at most, on the cell's clock; 180 a visit and its charging if left out and nobody
            watches.
    """

    inlet: Literal["auto", "type1", "type2", "ccs1", "ccs2"] = "auto"
    mode: Literal["ours", "paper"] = "ours"
    visits: int = 1
    charging: float = 5.0
    state: Path | None = None
    show_plug: bool = False
    recalibrate: bool = False

    def run(self) -> int:
        """Charge; prints how each visit went; 1 where one went wrong."""
        from armsight.commands.charging_runs import charge_runs
        from armsight.commands.running import write_summary

        self._check()
        runs = charge_runs(self)
        if self.json is not None:
            write_summary(self.json, self._summary(runs))
        counted = [outcome for run in runs for outcome in run.counted]
        good = all(o.seated and o.out and not o.problem for o in counted)
        return runs[-1].code or int(self.visits > 0 and not (good and len(counted) >= self.visits))

    def _check(self) -> None:
        """Refuse what could not end or makes no sense."""
        from math import inf

        from armsight.errors import UsageError

        if self.visits < 0:
            raise UsageError(f"--visits is {self.visits}; expected 0 or more")
        if self.headless and self.charging == inf:
            raise UsageError("--charging inf never ends, and with --headless nobody would end it")
        if not self.charging >= 0.0:
            raise UsageError(f"--charging is {self.charging:g} s; expected 0 or more")
        if self.headless and self.visits == 0:
            raise UsageError("--headless needs --visits: nobody would press the button")

    def _summary(self, runs: Sequence[ChargeRun]) -> dict[str, Any]:
        """Of all runs, for the file."""
        touched = None
        if all(run.touched is not None for run in runs):
            touched = [what for run in runs for what in run.touched or ()]
        return {
            "workcell": runs[0].workcell,
            "mode": self.mode,
            "seed": self.seed,
            "seconds": round(sum(run.seconds for run in runs), 3),
            "contacts": None if touched is None else len(touched),
            "touched": touched,
            "visits": [asdict(outcome) for run in runs for outcome in run.outcomes],
            "calibrations": [run.cause.words for run in runs if run.cause is not None],
        }
