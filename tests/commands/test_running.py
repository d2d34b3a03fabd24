"""What commands say and write: words as they are, figures as JSON knows them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armsight.commands.running import say, write_summary


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
