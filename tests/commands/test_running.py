"""What commands say and write: words as they are, figures as JSON knows them."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from armsight.commands.running import RunOptions, exit_code, run_session, say, write_summary
from armsight.errors import LoopError, RecordingError


class QuietRecorder:
    """As much of a recorder as a run touches."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        pass


class QuietSession:
    """As much of a session as a run touches."""

    wall, ended_by, task_failure, recording_failure = True, "time", "", ""

    def __init__(self, *args: object, **kwargs: object) -> None:
        pass

    def observe(self, component: object) -> None:
        pass

    def warm_up(self, progress: object) -> None:
        pass

    def run(self, seconds: float | None) -> None:
        pass


@pytest.mark.parametrize(
    "text",
    [
        "recorded /data/runs [old]/monday.mcap",
        "reason: expected metres [m], found [0, 0, 60]",
        "wrote /data/[/tmp]/a.json",  # was a traceback at the end of a run
    ],
)
def test_brackets_are_said_as_they_are(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    say(text)
    assert capsys.readouterr().err == text + "\n"


def test_a_figure_that_is_no_number_loses_none_of_the_others(tmp_path: Path) -> None:
    """A distance with nobody near is infinite: the whole file was not written."""
    inf, nan = float("inf"), float("nan")
    write_summary(tmp_path / "a.json", {"figures": {"near": inf, "n": 3}, "rows": [nan, 0.5]})
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "figures": {"near": None, "n": 3},
        "rows": [None, 0.5],
    }


@pytest.mark.parametrize("failure", ["", "x: the arm is lost"])
def test_a_failed_recording_loses_neither_figures_nor_the_reason(
    failure: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The disk was full: no figures, no JSON, and a lost arm was not even named."""
    words = "recording stopped: the disk is full"

    class Full(QuietRecorder):
        def close(self) -> Path:
            raise RecordingError(words)

    class Ended(QuietSession):
        def run(self, seconds: float | None) -> None:
            if failure:
                raise LoopError(failure)

    monkeypatch.setattr("armsight.recording.recorder.Recorder", Full)
    monkeypatch.setattr("armsight.runtime.session.Session", Ended)
    wanted = RunOptions(seconds=1.0, page=None, record=tmp_path / "a.mcap", make=lambda *a: None)
    cell = SimpleNamespace(simulated=False)
    if failure:
        with pytest.raises(LoopError, match=failure):
            run_session(cell, None, wanted)
    else:
        session = run_session(cell, None, wanted)  # figures are taken from it after this
        assert exit_code(session, 1.0) == 1
    assert words in capsys.readouterr().err
