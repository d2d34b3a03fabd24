"""When a station calibrates again by itself, and what is made anew after it."""

import json
import math
from types import SimpleNamespace

import pytest

from armsight.charging.stale import Cause, Stale
from armsight.charging.vehicle import VehicleStatus
from armsight.charging.visit import Outcome
from armsight.commands import calibrate_plug, charging_runs
from armsight.commands.charge import Charge
from armsight.commands.charging_runs import ChargeRun
from armsight.errors import CalibrationError

ELSEWHERE, APART = "the plug's tip is 20 mm from where ...", "the two pairs saw ..."
GOOD = Outcome(seated=True, charged=True)
REFUSED = Outcome(problem=ELSEWHERE)


def stale(elsewhere="", apart="", busy=False, car=None, leaves=False, settled=()):
    station = SimpleNamespace(
        busy=busy,
        check=SimpleNamespace(elsewhere=elsewhere),
        vehicle=SimpleNamespace(status=lambda now: car),
    )
    return Stale(station, SimpleNamespace(words=apart), leaves, settled)


def test_a_tip_that_is_elsewhere_or_pairs_that_disagree_are_causes():
    assert stale(ELSEWHERE).cause(0.0) == Cause("plug", ELSEWHERE)
    assert stale(apart=APART).cause(0.0) == Cause("pairs", APART)
    assert stale(ELSEWHERE, APART, settled=["plug"]).cause(0.0) == Cause("pairs", APART)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"elsewhere": ELSEWHERE, "busy": True},  # the plug may be in the car
        {"elsewhere": ELSEWHERE, "settled": ["plug"]},  # once more would help no more
        {"elsewhere": ELSEWHERE, "leaves": True},  # nobody knows whether a car is there
        {"elsewhere": ELSEWHERE, "leaves": True, "car": VehicleStatus(parked=True)},
    ],
)
def test_nothing_asks_for_it_or_it_is_not_the_time(given):
    assert stale(**given).cause(0.0) is None


def test_it_is_the_time_once_the_car_has_left():
    left = VehicleStatus(parked=False)
    assert stale(ELSEWHERE, leaves=True, car=left).cause(0.0) == Cause("plug", ELSEWHERE)


@pytest.fixture
def scripted(monkeypatch):
    """Runs that come out as told; what was asked of each, and the calibrations."""
    script, asked, calibrated = [], [], []

    def run(wanted, settled):
        asked.append((wanted, tuple(settled)))
        outcomes, cause = script.pop(0)
        return ChargeRun("cell", outcomes, (), 20.0, 0, cause)

    def calibrate(workcell, options):
        calibrated.append(options)
        return 0

    monkeypatch.setattr(charging_runs, "_run", run)
    monkeypatch.setattr(calibrate_plug, "calibrate_plug", calibrate)
    return SimpleNamespace(script=script, asked=asked, calibrated=calibrated)


def charge(file, **given):
    return Charge("cell", headless=True, json=file, recalibrate=True, show_plug=True, **given)


def test_a_refused_visit_is_made_anew_with_what_was_calibrated(scripted, tmp_path):
    scripted.script += [((GOOD, REFUSED), Cause("plug", ELSEWHERE)), ((GOOD,), None)]
    file = tmp_path / "out.json"
    assert charge(file, visits=2, seconds=100.0, record=tmp_path / "a.mcap").run() == 0
    (_, before), (second, after) = scripted.asked
    assert (before, after) == ((), ("plug",))
    assert (second.visits, second.seconds, second.record.name) == (1, 80.0, "a-2.mcap")
    assert not second.show_plug  # it was just looked at 26 times
    assert [options.fresh for options in scripted.calibrated] == [True]
    summary = json.loads(file.read_text())
    assert summary["calibrations"] == [ELSEWHERE]
    assert [v["problem"] for v in summary["visits"]] == ["", ELSEWHERE, ""]
    assert summary["seconds"] == 40.0


def test_after_the_last_visit_it_calibrates_for_the_next_start_and_ends(scripted, tmp_path):
    scripted.script += [((GOOD, GOOD, GOOD), Cause("pairs", APART))]
    assert charge(tmp_path / "out.json", visits=3).run() == 0
    assert len(scripted.calibrated) == 1
    assert not scripted.script


def test_a_calibration_that_fails_is_the_end_and_loses_no_figures(
    scripted, tmp_path, monkeypatch, capsys
):
    def fails(workcell, options):
        raise CalibrationError("plug calibration: 2 good looks of 12")

    monkeypatch.setattr(calibrate_plug, "calibrate_plug", fails)
    scripted.script += [((REFUSED,), Cause("plug", ELSEWHERE))]
    file = tmp_path / "out.json"
    assert charge(file, visits=1).run() == 1
    assert "2 good looks" in capsys.readouterr().err
    (visit,) = json.loads(file.read_text())["visits"]
    assert visit["problem"] == ELSEWHERE
    assert visit["plugged"] is None
    assert math.isnan(REFUSED.plugged)  # JSON knows no NaN


def test_a_calibration_that_is_interrupted_interrupts_the_whole(scripted, tmp_path, monkeypatch):
    monkeypatch.setattr(calibrate_plug, "calibrate_plug", lambda workcell, options: 130)
    scripted.script += [((REFUSED,), Cause("plug", ELSEWHERE))]
    assert charge(tmp_path / "out.json", visits=1).run() == 130


def test_a_cause_that_stays_after_a_calibration_ends_the_visits_as_without_it(scripted, tmp_path):
    scripted.script += [((REFUSED,), Cause("plug", ELSEWHERE)), ((REFUSED,), None)]
    assert charge(tmp_path / "out.json", visits=1).run() == 1
    assert len(scripted.calibrated) == 1
